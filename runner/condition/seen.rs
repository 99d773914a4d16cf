//! What has been seen of a device: the events, as far as conditions ask for them.

use std::collections::BTreeMap;
use std::time::Duration;

use sim_core::SimTime;
use sim_core::event::{Event, Role};
use sim_core::mecanum_device::MecanumEvent;
use sim_core::mecanum_device::ascii;
use sim_core::mecanum_device::packet::{self, Status};
use sim_core::r150_device::R150Event;
use sim_core::r150_device::command::Request;
use sim_core::r150_device::reply::{Reply, SystemInfo};
use sim_core::report::Report;

/// What has been seen of one device since the start.
#[derive(Debug, Clone, Default)]
pub struct Seen {
    report: Report,
    /// Events by their codes, also those that are held against nobody.
    counts: BTreeMap<&'static str, u64>,
    pub(super) attached: u64,
    pub(super) last_request: Option<SimTime>,
    /// The last request that asks for motion, and how far the device had driven then.
    pub(super) last_motion: Option<(SimTime, f64)>,
    pub(super) motion_requests: u64,
    pub(super) last_reply: Option<SimTime>,
    pub(super) r150: R150Seen,
    pub(super) mecanum: MecanumSeen,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct R150Seen {
    /// As the client last sent them.
    pub motors: [i16; 2],
    pub power: u32,
    pub duty: [u16; 4],
    /// As the module last said.
    pub motors_reply: Option<(SimTime, [i16; 2], u16)>,
    pub info: Option<(SimTime, SystemInfo)>,
    pub last_bool: bool,
}

#[derive(Debug, Clone, Copy, Default)]
pub(super) struct MecanumSeen {
    /// Speed and distance of the motion that the client last asked for, 1/10 r/min and rev.
    pub speed: i16,
    pub distance: i32,
    pub remote: bool,
    pub status: Option<(SimTime, Status)>,
    pub line: Option<(SimTime, ascii::Report)>,
}

impl Seen {
    /// Takes note of an event of the device, which has driven so far; unless it is `excused`, it
    /// counts in the report.
    pub fn note(&mut self, event: &Event, distance_m: f64, excused: bool) {
        match event.kind.role() {
            Role::Attached => self.attached += 1,
            Role::Detached => self.attached = self.attached.saturating_sub(1),
            Role::Request => self.last_request = Some(event.at),
            Role::Reply => self.last_reply = Some(event.at),
            Role::HeartbeatLost | Role::Other => {}
        }
        match event.kind.get() {
            Some(R150Event::Request { request, .. }) => {
                self.r150_request(event.at, *request, distance_m);
            }
            Some(R150Event::Reply { reply, .. }) => self.r150_reply(event.at, *reply),
            _ => {}
        }
        if let Some(event_of_car) = event.kind.get() {
            self.mecanum(event.at, event_of_car, distance_m);
        }
        *self.counts.entry(event.kind.code().as_str()).or_default() += 1;
        if !excused {
            self.report.note(event);
        }
    }

    /// What happened, counted.
    #[must_use]
    pub fn report(&self) -> &Report {
        &self.report
    }

    pub(super) fn count(&self, code: &str) -> f64 {
        let count = self.counts.get(code).copied().unwrap_or(0);
        as_number(count)
    }

    fn r150_request(&mut self, at: SimTime, request: Request, distance_m: f64) {
        match request {
            Request::SetMotors { right, left } => {
                self.r150.motors = [right, left];
                self.motion(at, distance_m);
            }
            Request::PowerControl { status } => self.r150.power = status,
            Request::SetPwmOutputs { duty } => self.r150.duty = duty,
            _ => {}
        }
    }

    fn r150_reply(&mut self, at: SimTime, reply: Reply) {
        match reply {
            Reply::Motors {
                right_rpm,
                left_rpm,
                soc,
            } => self.r150.motors_reply = Some((at, [right_rpm, left_rpm], soc)),
            Reply::SystemInfo(info) => self.r150.info = Some((at, info)),
            Reply::Bool { success, .. } => self.r150.last_bool = success,
            _ => {}
        }
    }

    fn mecanum(&mut self, at: SimTime, event: &MecanumEvent, distance_m: f64) {
        match event {
            MecanumEvent::Request(packet::Request::Motion { s, v, .. }, _) => {
                (self.mecanum.distance, self.mecanum.speed) = (i32::from(*s), *v);
                self.motion(at, distance_m);
            }
            MecanumEvent::Command(command) => {
                self.mecanum.distance = command.tenths;
                self.motion(at, distance_m);
            }
            MecanumEvent::Request(packet::Request::ControlMode { mode, .. }, _) => {
                self.mecanum.remote = *mode == 1;
            }
            MecanumEvent::Status(status, _) => self.mecanum.status = Some((at, *status)),
            MecanumEvent::Report(report) => self.mecanum.line = Some((at, *report)),
            _ => {}
        }
    }

    fn motion(&mut self, at: SimTime, distance_m: f64) {
        self.last_motion = Some((at, distance_m));
        self.motion_requests += 1;
    }
}

/// Seconds from `then` to `now`; without end if it never was.
pub(super) fn age_s(now: SimTime, then: Option<SimTime>) -> f64 {
    then.map_or(f64::INFINITY, |then| {
        Duration::as_secs_f64(&now.since(then))
    })
}

#[expect(clippy::cast_precision_loss, reason = "nobody counts to 2^53")]
pub(super) fn as_number(count: u64) -> f64 {
    count as f64
}
