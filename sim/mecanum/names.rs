//! Names of conditions about a mecanum car.

use super::Mecanum;
use crate::device::names::as_number;
use crate::device::{NameInfo, View};

/// What a car says; the default of any other device.
fn on<T: Default>(view: &View<'_>, get: impl FnOnce(&Mecanum) -> T) -> T {
    view.device.get().map_or_else(T::default, get)
}

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::flag("sensor.obstacle_ahead", "the infrared sensor sees something", |v| on(v, |c| c.plant.measurements().obstacle_ahead)),
    NameInfo::number("sensor.tag", "", "number of the RFID tag under the reader, 0 for none", |v| f64::from(on(v, |c| c.plant.measurements().tag))),
    NameInfo::flag("sensor.strip", "a magnetic strip lies under the bar", |v| on(v, |c| c.plant.measurements().magnetic_bar) != 0),
    NameInfo::flag("mode.remote", "the remote control drives", |v| on(v, |c| c.device.is_remote())),
    NameInfo::flag("motion.running", "a motion runs", |v| on(v, |c| c.device.running().is_some())),
    NameInfo::number("motion.waiting", "", "how many motions wait", |v| on(v, |c| as_number(c.device.waiting() as u64))),
    NameInfo::number("client.last_motion_age_s", "s", "time since the last motion was ordered; infinite before", |v| v.age_s(v.counters.last_motion.map(|(at, _)| at))),
];

/// Declares the distance that each ultrasonic sensor really sees.
macro_rules! echoes {
    ($($name:literal $at:literal),+) => {
        pub(super) static ECHOES: &[NameInfo] = &[$(NameInfo::number(
            concat!("sensor.", $name, "_m"),
            "m",
            concat!("ultrasonic sensor ", $name, ", counted from the left; infinite without an echo"),
            |view| on(view, |car| car.plant.measurements().echoes[$at]).unwrap_or(f64::INFINITY),
        )),+];
    };
}

echoes! {
    "front1" 0, "front2" 1, "front3" 2, "front4" 3, "rear1" 4, "rear2" 5, "rear3" 6, "rear4" 7
}
