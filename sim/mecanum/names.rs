//! Names of conditions about a mecanum car.

use rigsim_physics::mecanum::MecanumMeasurements;

use super::Mecanum;
use crate::device::names::as_number;
use crate::device::{NameInfo, View};

fn car<'a>(view: &View<'a>) -> Option<&'a Mecanum> {
    view.device.get()
}

fn input<T: Default>(view: &View<'_>, get: impl FnOnce(MecanumMeasurements) -> T) -> T {
    car(view).map_or_else(T::default, |car| get(car.plant().measurements()))
}

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::flag("truth.tipping", "a wheel would lift: the car would tip over", |v| car(v).is_some_and(|c| c.plant().is_tipping())),
    NameInfo::flag("sensor.obstacle_ahead", "the infrared sensor sees something", |v| input(v, |m| m.obstacle_ahead)),
    NameInfo::number("sensor.tag", "", "number of the RFID tag under the reader, 0 for none", |v| f64::from(input(v, |m| m.tag))),
    NameInfo::number("sensor.magnetic_bar", "", "the magnetic bar's 16 channels", |v| f64::from(input(v, |m| m.magnetic_bar))),
    NameInfo::flag("sensor.strip", "a magnetic strip lies under the bar", |v| input(v, |m| m.magnetic_bar) != 0),
    NameInfo::flag("mode.remote", "the remote control drives", |v| car(v).is_some_and(|c| c.device().is_remote())),
    NameInfo::flag("motion.running", "a motion runs", |v| car(v).is_some_and(|c| c.device().running().is_some())),
    NameInfo::number("motion.waiting", "", "how many motions wait", |v| car(v).map_or(0.0, |c| as_number(c.device().waiting() as u64))),
    NameInfo::number("client.last_motion_age_s", "s", "time since the last motion was ordered; infinite before", |v| v.age_s(v.counters.last_motion.map(|(at, _)| at))),
];

/// Declares the distance that each ultrasonic sensor really sees.
macro_rules! echoes {
    ($($name:literal $at:literal),+) => {
        pub(super) static ECHOES: &[NameInfo] = &[$(NameInfo::number(
            concat!("sensor.", $name, "_m"),
            "m",
            concat!("ultrasonic sensor ", $name, ", counted from the left; infinite without an echo"),
            |view| input(view, |measured| measured.echoes[$at]).unwrap_or(f64::INFINITY),
        )),+];
    };
}

echoes! {
    "front1" 0, "front2" 1, "front3" 2, "front4" 3, "rear1" 4, "rear2" 5, "rear3" 6, "rear4" 7
}
