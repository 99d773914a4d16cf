//! The names of a mecanum car.

use sim_core::mecanum::Mecanum;
use sim_core::mecanum_device::packet::Status;
use sim_physics::mecanum::{MecanumMeasurements, MecanumTruth, Wheel};

use super::names::{NameInfo, View};
use super::r150::length;
use super::seen::{age_s, as_number};

impl View<'_> {
    fn car(&self) -> Option<&Mecanum> {
        self.rig.mecanum(self.device)
    }
}

fn truth(view: &View<'_>, get: impl FnOnce(MecanumTruth) -> f64) -> f64 {
    view.car().map_or(0.0, |car| get(car.truth()))
}

fn input<T: Default>(view: &View<'_>, get: impl FnOnce(MecanumMeasurements) -> T) -> T {
    view.car()
        .map_or_else(T::default, |car| get(car.plant().measurements()))
}

/// What an ultrasonic sensor really sees; infinite without an echo.
fn echo<const AT: usize>(view: &View<'_>) -> f64 {
    input(view, |measured| measured.echoes[AT]).unwrap_or(f64::INFINITY)
}

fn told(view: &View<'_>, get: impl FnOnce(&Status) -> f64) -> f64 {
    view.seen
        .mecanum
        .status
        .map_or(0.0, |(_, status)| get(&status))
}

const LF: usize = Wheel::LeftFront.index();
const RF: usize = Wheel::RightFront.index();
const LR: usize = Wheel::LeftRear.index();
const RR: usize = Wheel::RightRear.index();

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::number("truth.x_m", "m", "true position, east of the origin", |v| truth(v, |t| t.pose.x)),
    NameInfo::number("truth.y_m", "m", "true position, north of the origin", |v| truth(v, |t| t.pose.y)),
    NameInfo::number("truth.heading_deg", "deg", "true heading, counter-clockwise from x", |v| truth(v, |t| t.pose.heading.to_degrees())),
    NameInfo::number("truth.speed_mps", "m/s", "true speed whichever way, never negative", |v| truth(v, |t| length(t.forward_speed, t.leftward_speed))),
    NameInfo::number("truth.forward_mps", "m/s", "true speed ahead, negative backward", |v| truth(v, |t| t.forward_speed)),
    NameInfo::number("truth.leftward_mps", "m/s", "true speed to the left", |v| truth(v, |t| t.leftward_speed)),
    NameInfo::number("truth.yaw_rate_deg_s", "deg/s", "true yaw rate, counter-clockwise", |v| truth(v, |t| t.yaw_rate.to_degrees())),
    NameInfo::number("truth.distance_m", "m", "length of the path driven so far", |v| truth(v, |t| t.distance)),
    NameInfo::flag("truth.at_rest", "nothing moves and nothing drives", |v| v.car().is_some_and(|c| c.truth().at_rest)),
    NameInfo::flag("truth.touching", "it touches an obstacle or another vehicle", |v| v.car().is_some_and(|c| v.rig.world().is_touching(c.body()))),
    NameInfo::number("truth.collisions", "", "how often it has come to touch something", |v| v.car().map_or(0.0, |c| as_number(v.rig.world().collisions(c.body())))),
    NameInfo::number("truth.mass_kg", "kg", "mass with payload", |v| truth(v, |t| t.mass)),
    NameInfo::number("wheel.lf_rad_s", "rad/s", "true speed of the left front wheel", |v| truth(v, |t| t.wheel_speed[LF])),
    NameInfo::number("wheel.rf_rad_s", "rad/s", "true speed of the right front wheel", |v| truth(v, |t| t.wheel_speed[RF])),
    NameInfo::number("wheel.lr_rad_s", "rad/s", "true speed of the left rear wheel", |v| truth(v, |t| t.wheel_speed[LR])),
    NameInfo::number("wheel.rr_rad_s", "rad/s", "true speed of the right rear wheel", |v| truth(v, |t| t.wheel_speed[RR])),
    NameInfo::number("wheel.lf_torque_nm", "N·m", "torque of the left front motor at its wheel", |v| truth(v, |t| t.motor_torque[LF])),
    NameInfo::number("wheel.rf_torque_nm", "N·m", "torque of the right front motor at its wheel", |v| truth(v, |t| t.motor_torque[RF])),
    NameInfo::number("wheel.lr_torque_nm", "N·m", "torque of the left rear motor at its wheel", |v| truth(v, |t| t.motor_torque[LR])),
    NameInfo::number("wheel.rr_torque_nm", "N·m", "torque of the right rear motor at its wheel", |v| truth(v, |t| t.motor_torque[RR])),
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
    NameInfo::flag("mode.remote", "the remote control drives", |v| v.car().is_some_and(|c| c.device().is_remote())),
    NameInfo::flag("mode.board_powered", "the board has a supply", |v| input(v, |m| m.board_powered)),
    NameInfo::flag("motion.running", "a motion runs", |v| v.car().is_some_and(|c| c.device().running().is_some())),
    NameInfo::number("motion.waiting", "", "how many motions wait", |v| v.car().map_or(0.0, |c| as_number(c.device().waiting() as u64))),
    NameInfo::number("reported.age_s", "s", "time since the last status packet began its way; infinite before", |v| age_s(v.rig.now(), v.seen.mecanum.status.map(|(at, _)| at))),
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
    NameInfo::number("reported.line_age_s", "s", "time since the last line on the ROS link; infinite before", |v| age_s(v.rig.now(), v.seen.mecanum.line.map(|(at, _)| at))),
    NameInfo::flag("client.attached", "a client has one of the ports open", |v| v.seen.attached > 0),
    NameInfo::number("client.last_request_age_s", "s", "time since the last valid packet or line arrived; infinite before", |v| age_s(v.rig.now(), v.seen.last_request)),
    NameInfo::number("client.last_motion_age_s", "s", "time since the last motion was asked for; infinite before", |v| age_s(v.rig.now(), v.seen.last_motion.map(|(at, _)| at))),
    NameInfo::number("client.travel_since_motion_m", "m", "path driven since the last motion was asked for; 0 before", |v| v.seen.last_motion.map_or(0.0, |(_, from)| v.rig.distance_m(v.device) - from)),
    NameInfo::number("client.motions", "", "motions asked for so far", |v| as_number(v.seen.motion_requests)),
    NameInfo::number("client.speed", "1/10 r/min", "speed of the last motion packet; 0 before", |v| f64::from(v.seen.mecanum.speed)),
    NameInfo::number("client.distance", "1/10 rev", "distance of the last motion; 0 before", |v| f64::from(v.seen.mecanum.distance)),
    NameInfo::flag("client.asked_remote", "the client last gave control to the remote control", |v| v.seen.mecanum.remote),
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
    NameInfo::count("count.power_lost", "power_lost", "times that the board lost its supply"),
    NameInfo::count("count.firmware_reset", "firmware_reset", "times that the firmware restarted by itself"),
];
