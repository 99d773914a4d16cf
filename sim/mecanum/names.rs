//! Names of conditions about a mecanum car.

use sim_physics::mecanum::{MecanumMeasurements, MecanumTruth, Wheel};
use sim_settings::SimTime;

use super::Mecanum;
use crate::device::names::as_number;
use crate::device::{NameInfo, Observer, View};
use crate::event::EventKind;
use crate::mecanum_device::packet::{Request, Status};
use crate::mecanum_device::{MecanumEvent, ascii};

/// Notes of a car's events.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noted {
    /// Speed and distance of the motion that the client last asked for, 1/10 r/min and rev.
    speed: i16,
    distance: i32,
    remote: bool,
    status: Option<(SimTime, Status)>,
    line: Option<(SimTime, ascii::Report)>,
}

impl Observer for Noted {
    fn note(&mut self, at: SimTime, event: &dyn EventKind) -> bool {
        match event.get() {
            Some(MecanumEvent::Request(Request::Motion { s, v, .. }, _)) => {
                (self.distance, self.speed) = (i32::from(*s), *v);
                return true;
            }
            Some(MecanumEvent::Command(command)) => {
                self.distance = command.tenths;
                return true;
            }
            Some(MecanumEvent::Request(Request::ControlMode { mode, .. }, _)) => {
                self.remote = *mode == 1;
            }
            Some(MecanumEvent::Status(status, _)) => self.status = Some((at, *status)),
            Some(MecanumEvent::Report(report)) => self.line = Some((at, *report)),
            _ => {}
        }
        false
    }
}

fn noted(view: &View<'_>) -> Noted {
    view.noted().copied().unwrap_or_default()
}

fn car<'a>(view: &View<'a>) -> Option<&'a Mecanum> {
    view.device.get()
}

fn truth(view: &View<'_>, get: impl FnOnce(MecanumTruth) -> f64) -> f64 {
    car(view).map_or(0.0, |car| get(car.truth()))
}

fn input<T: Default>(view: &View<'_>, get: impl FnOnce(MecanumMeasurements) -> T) -> T {
    car(view).map_or_else(T::default, |car| get(car.plant().measurements()))
}

/// Distance that an ultrasonic sensor really sees; infinite without an echo.
fn echo<const AT: usize>(view: &View<'_>) -> f64 {
    input(view, |measured| measured.echoes[AT]).unwrap_or(f64::INFINITY)
}

fn told(view: &View<'_>, get: impl FnOnce(&Status) -> f64) -> f64 {
    noted(view).status.map_or(0.0, |(_, status)| get(&status))
}

const LF: usize = Wheel::LeftFront.index();
const RF: usize = Wheel::RightFront.index();
const LR: usize = Wheel::LeftRear.index();
const RR: usize = Wheel::RightRear.index();

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::number("wheel.lf_rad_s", "rad/s", "true speed of the left front wheel", |v| truth(v, |t| t.wheel_speed[LF])),
    NameInfo::number("wheel.rf_rad_s", "rad/s", "true speed of the right front wheel", |v| truth(v, |t| t.wheel_speed[RF])),
    NameInfo::number("wheel.lr_rad_s", "rad/s", "true speed of the left rear wheel", |v| truth(v, |t| t.wheel_speed[LR])),
    NameInfo::number("wheel.rr_rad_s", "rad/s", "true speed of the right rear wheel", |v| truth(v, |t| t.wheel_speed[RR])),
    NameInfo::number("wheel.lf_torque_nm", "N·m", "torque of the left front motor at its wheel", |v| truth(v, |t| t.motor_torque[LF])),
    NameInfo::number("wheel.rf_torque_nm", "N·m", "torque of the right front motor at its wheel", |v| truth(v, |t| t.motor_torque[RF])),
    NameInfo::number("wheel.lr_torque_nm", "N·m", "torque of the left rear motor at its wheel", |v| truth(v, |t| t.motor_torque[LR])),
    NameInfo::number("wheel.rr_torque_nm", "N·m", "torque of the right rear motor at its wheel", |v| truth(v, |t| t.motor_torque[RR])),
    NameInfo::flag("truth.tipping", "a wheel would lift: the car would tip over", |v| car(v).is_some_and(|c| c.plant().is_tipping())),
    NameInfo::number("sensor.front1_m", "m", "front ultrasonic sensor 1, leftmost; infinite without an echo", echo::<0>),
    NameInfo::number("sensor.front2_m", "m", "front ultrasonic sensor 2", echo::<1>),
    NameInfo::number("sensor.front3_m", "m", "front ultrasonic sensor 3", echo::<2>),
    NameInfo::number("sensor.front4_m", "m", "front ultrasonic sensor 4", echo::<3>),
    NameInfo::number("sensor.rear1_m", "m", "rear ultrasonic sensor 1, leftmost", echo::<4>),
    NameInfo::number("sensor.rear2_m", "m", "rear ultrasonic sensor 2", echo::<5>),
    NameInfo::number("sensor.rear3_m", "m", "rear ultrasonic sensor 3", echo::<6>),
    NameInfo::number("sensor.rear4_m", "m", "rear ultrasonic sensor 4", echo::<7>),
    NameInfo::flag("sensor.obstacle_ahead", "the infrared sensor sees something", |v| input(v, |m| m.obstacle_ahead)),
    NameInfo::number("sensor.tag", "", "number of the RFID tag under the reader, 0 for none", |v| f64::from(input(v, |m| m.tag))),
    NameInfo::number("sensor.magnetic_bar", "", "the magnetic bar's 16 channels", |v| f64::from(input(v, |m| m.magnetic_bar))),
    NameInfo::flag("sensor.strip", "a magnetic strip lies under the bar", |v| input(v, |m| m.magnetic_bar) != 0),
    NameInfo::flag("mode.remote", "the remote control drives", |v| car(v).is_some_and(|c| c.device().is_remote())),
    NameInfo::flag("mode.board_powered", "the board has a supply", |v| input(v, |m| m.board_powered)),
    NameInfo::flag("motion.running", "a motion runs", |v| car(v).is_some_and(|c| c.device().running().is_some())),
    NameInfo::number("motion.waiting", "", "how many motions wait", |v| car(v).map_or(0.0, |c| as_number(c.device().waiting() as u64))),
    NameInfo::number("reported.age_s", "s", "time since the last status packet began its way; infinite before", |v| v.age_s(noted(v).status.map(|(at, _)| at))),
    NameInfo::number("reported.v_x", "1/10 r/min", "v_x in that packet; 0 before", |v| told(v, |s| f64::from(s.v_x))),
    NameInfo::number("reported.v_y", "1/10 r/min", "v_y in that packet", |v| told(v, |s| f64::from(s.v_y))),
    NameInfo::number("reported.axis_x", "1/10 rev", "axis_x in that packet", |v| told(v, |s| f64::from(s.axis_x))),
    NameInfo::number("reported.axis_y", "1/10 rev", "axis_y in that packet", |v| told(v, |s| f64::from(s.axis_y))),
    NameInfo::number("reported.ori_deg", "deg", "ori in that packet", |v| told(v, |s| f64::from(s.ori) / 10.0)),
    NameInfo::number("reported.rfid", "", "rfid in that packet", |v| told(v, |s| f64::from(s.rfid))),
    NameInfo::number("reported.magn", "", "magn in that packet", |v| told(v, |s| f64::from(s.magn))),
    NameInfo::number("reported.infra", "", "infra in that packet", |v| told(v, |s| f64::from(s.infra))),
    NameInfo::number("reported.front_mm", "mm", "the nearest of ut_f in that packet", |v| told(v, |s| f64::from(s.ut_f.into_iter().min().unwrap_or(0)))),
    NameInfo::number("reported.rear_mm", "mm", "the nearest of ut_b in that packet", |v| told(v, |s| f64::from(s.ut_b.into_iter().min().unwrap_or(0)))),
    NameInfo::number("reported.moto_state", "", "moto_state in that packet", |v| told(v, |s| f64::from(s.moto_state))),
    NameInfo::number("reported.mile_mm", "mm", "mile in that packet", |v| told(v, |s| f64::from(s.mile))),
    NameInfo::number("reported.line_age_s", "s", "time since the last line on the ROS link; infinite before", |v| v.age_s(noted(v).line.map(|(at, _)| at))),
    NameInfo::flag("client.attached", "a client has one of the ports open", |v| v.observed.attached > 0),
    NameInfo::number("client.last_request_age_s", "s", "time since the last valid packet or line arrived; infinite before", |v| v.age_s(v.observed.last_request)),
    NameInfo::number("client.last_motion_age_s", "s", "time since the last motion was asked for; infinite before", |v| v.age_s(v.observed.last_motion.map(|(at, _)| at))),
    NameInfo::number("client.travel_since_motion_m", "m", "path driven since the last motion was asked for; 0 before", |v| v.travel_since_motion_m()),
    NameInfo::number("client.motions", "", "motions asked for so far", |v| as_number(v.observed.motion_requests)),
    NameInfo::number("client.speed", "1/10 r/min", "speed of the last motion packet; 0 before", |v| f64::from(noted(v).speed)),
    NameInfo::number("client.distance", "1/10 rev", "distance of the last motion; 0 before", |v| f64::from(noted(v).distance)),
    NameInfo::flag("client.asked_remote", "the client last gave control to the remote control", |v| noted(v).remote),
    NameInfo::count("count.requests", "request", "valid packets and lines"),
    NameInfo::count("count.replies", "reply", "status packets and lines"),
    NameInfo::count("count.noise", "noise", "runs of bytes that begin no packet"),
    NameInfo::count("count.partial_packet", "partial_packet", "packets that were not finished"),
    NameInfo::count("count.bad_line", "bad_line", "lines that are no command"),
    NameInfo::count("count.speed_clamped", "speed_clamped", "speeds outside of the range"),
    NameInfo::count("count.queue_full", "queue_full", "motions refused because too many wait"),
    NameInfo::count("count.ignored_in_remote", "ignored_in_remote", "motions ignored because the remote control drives"),
    NameInfo::count("count.motion_started", "motion_started", "motions that began"),
    NameInfo::count("count.motion_done", "motion_done", "motions that came to their end"),
    NameInfo::count("count.motions_discarded", "motions_discarded", "times that motions were discarded"),
    NameInfo::count("count.link_timeout", "link_timeout", "times that the link timed out"),
    NameInfo::count("count.tipping", "tipping", "times that a wheel would have lifted"),
    NameInfo::count("count.power_lost", "power_lost", "times that the board lost its supply"),
    NameInfo::count("count.firmware_reset", "firmware_reset", "times that the firmware restarted by itself"),
];
