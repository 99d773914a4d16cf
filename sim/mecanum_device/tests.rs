//! The board against the article. The car here is ideal: its wheels follow the pins at once and
//! never slip, so that the source of every number is known.

mod choices;
mod movements;
mod remote;
mod reported_choices;
mod requests;
mod robustness;
mod ros;
mod status;

use crate::firmware::Firmware as _;
use std::time::Duration;

use rigsim_physics::mecanum::{MecanumMeasurements, PlugSwaps, PortCommand, WHEELS, Wheel};
use rigsim_settings::SimTime;

use super::codec;
use super::packet::{Request, Status};
use super::settings::ByteOrder;
use super::settings::MecanumFirmwareSettings;
use super::{Link, MecanumDevice};
use crate::event::EventKind;

/// The smallest step of simulated time.
const QUANTUM: Duration = Duration::from_nanos(1);
/// How often the car's pulses are read.
const TICK: Duration = Duration::from_millis(1);
const MS: fn(u64) -> SimTime = SimTime::from_millis;

/// Direction in which pins roll a wheel: 1 forward, −1 backward, 0 not at all.
fn rotation(pins: PortCommand) -> i8 {
    match pins {
        PortCommand { brake: true, .. } => 0,
        PortCommand { reverse: true, .. } => -1,
        PortCommand { reverse: false, .. } => 1,
    }
}

/// A board in a car on a bench.
struct Bench {
    device: MecanumDevice,
    now: SimTime,
    readings: MecanumMeasurements,
    /// How the motors are really plugged in.
    plugs: PlugSwaps,
    /// The motor that turns the wrong way.
    reversed: Option<Wheel>,
    /// Pulses that each wheel has turned, backward ones negative.
    turned: [f64; WHEELS],
    /// Pulses that each wheel has given.
    travel: [f64; WHEELS],
    /// Wheels that do not turn whatever their motor does.
    stuck: [bool; WHEELS],
}

impl Bench {
    fn new() -> Self {
        Self::with(false, |_| {})
    }

    fn with_ros() -> Self {
        Self::with(true, |_| {})
    }

    fn with(ros: bool, change: impl FnOnce(&mut MecanumFirmwareSettings)) -> Self {
        let mut settings = MecanumFirmwareSettings {
            // The wheels of this bench are there at once.
            motion_pause: Duration::ZERO,
            reversing_time: Duration::ZERO,
            braking_time: Duration::ZERO,
            ..MecanumFirmwareSettings::default()
        };
        change(&mut settings);
        let readings = MecanumMeasurements {
            // Just before the wrap, so that every test crosses it.
            pulses: [u32::MAX - 3; 5],
            ..MecanumMeasurements::default()
        };
        Self {
            device: MecanumDevice::new(SimTime::ZERO, settings, ros, readings),
            now: SimTime::ZERO,
            readings,
            plugs: PlugSwaps::default(),
            reversed: None,
            turned: [0.0; WHEELS],
            travel: [0.0; WHEELS],
            stuck: [false; WHEELS],
        }
    }

    /// Runs the car up to and including `at`.
    fn until(&mut self, at: SimTime) {
        while self.now < at {
            let next = self.now.next_multiple(TICK).min(at);
            let share = next.since(self.now).as_secs_f64();
            self.now = next;
            self.roll(share);
            self.device.sense(next, &self.readings);
            self.device.advance(next);
        }
    }

    fn run(&mut self, span: Duration) {
        self.until(self.now + span);
    }

    fn run_ms(&mut self, millis: u64) {
        self.run(Duration::from_millis(millis));
    }

    /// Full speed is 50 r/min, which is 50 pulses a second.
    fn roll(&mut self, seconds: f64) {
        let commands = self.device.commands();
        for wheel in Wheel::ALL {
            let at = wheel.index();
            if self.stuck[at] {
                continue;
            }
            let rotation = f64::from(rotation(commands.ports[self.plugs.port(wheel).index()]));
            let pulses = 50.0 * commands.speed_voltage * seconds;
            let way = if self.reversed == Some(wheel) {
                -1.0
            } else {
                1.0
            };
            self.turned[at] += way * rotation * pulses;
            // A pulse that is short of its place by rounding alone has come.
            let whole = |travel: f64| crate::rounding::round::<i64>((travel + 1e-9).floor());
            let before = whole(self.travel[at]);
            self.travel[at] += rotation.abs() * pulses;
            let came = u32::try_from(whole(self.travel[at]) - before).unwrap();
            let count = &mut self.readings.pulses[self.plugs.port(wheel).index()];
            *count = count.wrapping_add(came);
        }
    }

    /// Changes what the inputs read.
    fn read(&mut self, change: impl FnOnce(&mut MecanumMeasurements)) {
        change(&mut self.readings);
        self.device.sense(self.now, &self.readings);
    }

    fn send(&mut self, request: Request) {
        self.device
            .handle_bytes(self.now, Link::Main, &request.encode());
    }

    /// A motion that preempts.
    fn go(&mut self, moving_idx: u8, s: u16, v: i16) {
        self.motion(1, moving_idx, s, v);
    }

    fn motion(&mut self, is_reset: u8, moving_idx: u8, s: u16, v: i16) {
        self.send(Request::Motion {
            seq: 0,
            is_reset,
            moving_idx,
            s,
            v,
        });
    }

    fn line(&mut self, line: &str) {
        let line = line.as_bytes();
        self.device.handle_bytes(self.now, Link::Ros, line);
    }

    /// What the link's client has got since the last call.
    fn output(&mut self, link: Link) -> Vec<Vec<u8>> {
        let output = std::iter::from_fn(|| self.device.poll_output());
        let of_link = output.filter(|(of, _)| *of == link);
        of_link.map(|(_, bytes)| bytes).collect()
    }

    fn statuses(&mut self) -> Vec<Status> {
        let packets = self.output(Link::Main);
        packets
            .iter()
            .map(|bytes| codec::parse::<Status>(bytes, ByteOrder::Little).unwrap())
            .collect()
    }

    fn last_status(&mut self) -> Status {
        *self.statuses().last().unwrap()
    }

    /// Events since the last call.
    fn events(&mut self) -> Vec<(SimTime, EventKind)> {
        std::iter::from_fn(|| self.device.poll_event()).collect()
    }

    /// Codes of the events since the last call that are not traffic.
    fn codes(&mut self) -> Vec<&'static str> {
        let events = self.events().into_iter();
        let codes = events.map(|(_, event)| event.code().name);
        codes
            .filter(|code| !matches!(*code, "request" | "reply"))
            .collect()
    }

    /// Revolutions that each wheel has turned, to a tenth of one.
    fn tenths(&self) -> [i64; WHEELS] {
        self.turned
            .map(|pulses| crate::rounding::round::<i64>(pulses / 6.0))
    }

    fn is_driving(&self) -> bool {
        self.device.drive.rotations() != [0; WHEELS]
    }
}
