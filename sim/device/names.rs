//! Names of conditions about a device.

use std::fmt;
use std::time::Duration;

use sim_physics::World;
use sim_settings::SimTime;

use super::{Device, Motion, Observed};

/// Meaning, unit and source of a name.
#[derive(Debug, Clone, Copy)]
pub struct NameInfo {
    /// The name, to be written after the device's.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// Meaning in a sentence.
    pub meaning: &'static str,
    /// Way to its value.
    pub getter: Getter,
}

/// Unit of a name's value.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Unit {
    /// A number with a unit; pure numbers and counts have none.
    Number(&'static str),
    /// True or false.
    Flag,
}

impl fmt::Display for Unit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Number("") => "number",
            Self::Number(unit) => unit,
            Self::Flag => "true/false",
        })
    }
}

/// A device as conditions see it.
pub struct View<'a> {
    /// The present.
    pub now: SimTime,
    /// World around it.
    pub world: &'a World,
    /// The device itself.
    pub device: &'a dyn Device,
    /// Observations of it.
    pub observed: &'a Observed,
}

impl<'a> View<'a> {
    /// Returns the notes of the device's own observer, if it is of this type.
    #[must_use]
    pub fn noted<T: super::Observer>(&self) -> Option<&'a T> {
        (&*self.observed.own as &dyn std::any::Any).downcast_ref()
    }

    /// Seconds since `then`; without end if it never was.
    #[must_use]
    pub fn age_s(&self, then: Option<SimTime>) -> f64 {
        then.map_or(f64::INFINITY, |then| {
            Duration::as_secs_f64(&self.now.since(then))
        })
    }

    /// Path driven since motion was last asked for, m; 0 before.
    #[must_use]
    pub fn travel_since_motion_m(&self) -> f64 {
        self.observed
            .last_motion
            .map_or(0.0, |(_, from)| self.motion().distance - from)
    }

    fn motion(&self) -> Motion {
        self.device.plant().motion()
    }
}

/// A count as a number.
#[expect(clippy::cast_precision_loss, reason = "nobody counts to 2^53")]
#[must_use]
pub fn as_number(count: u64) -> f64 {
    count as f64
}

/// Names for the true pose and motion of every vehicle.
#[rustfmt::skip] // One line a name: a table to read.
pub static MOTION: &[NameInfo] = &[
    NameInfo::number("truth.x_m", "m", "true position, east of the origin", |v| v.motion().pose.x),
    NameInfo::number("truth.y_m", "m", "true position, north of the origin", |v| v.motion().pose.y),
    NameInfo::number("truth.heading_deg", "deg", "true heading, counter-clockwise from x", |v| v.motion().pose.heading.to_degrees()),
    NameInfo::number("truth.speed_mps", "m/s", "true speed whichever way, never negative", |v| length(v.motion())),
    NameInfo::number("truth.forward_mps", "m/s", "true speed ahead, negative backward", |v| v.motion().forward_speed),
    NameInfo::number("truth.leftward_mps", "m/s", "true speed to the left", |v| v.motion().leftward_speed),
    NameInfo::number("truth.yaw_rate_deg_s", "deg/s", "true yaw rate, counter-clockwise", |v| v.motion().yaw_rate.to_degrees()),
    NameInfo::number("truth.distance_m", "m", "length of the path driven so far", |v| v.motion().distance),
    NameInfo::number("truth.mass_kg", "kg", "mass with payload", |v| v.motion().mass),
    NameInfo::flag("truth.at_rest", "nothing moves and nothing drives", |v| v.device.plant().at_rest()),
    NameInfo::flag("truth.touching", "it touches an obstacle or another vehicle", |v| v.world.is_touching(v.device.plant().body())),
    NameInfo::count("count.deeds", "deed_done", "times that somebody did something to it or changed something around it"),
    NameInfo::number("truth.collisions", "", "how often it has come to touch something", |v| as_number(v.world.collisions(v.device.plant().body()))),
];

/// The length of the velocity; a square root is the same on every machine.
fn length(
    Motion {
        forward_speed,
        leftward_speed,
        ..
    }: Motion,
) -> f64 {
    (forward_speed * forward_speed + leftward_speed * leftward_speed).sqrt()
}

/// The value of a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Reading {
    /// A number.
    Number(f64),
    /// True or false.
    Flag(bool),
}

impl fmt::Display for Reading {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            // Six digits are more than anybody reads, and no rounding error shows.
            Self::Number(number) => write!(f, "{}", (number * 1e6).round() / 1e6),
            Self::Flag(flag) => write!(f, "{flag}"),
        }
    }
}

/// Way to the value of a name.
#[derive(Debug, Clone, Copy)]
pub enum Getter {
    /// A number.
    Number(fn(&View<'_>) -> f64),
    /// True or false.
    Flag(fn(&View<'_>) -> bool),
    /// Number of events of a code.
    Count(&'static str),
}

impl Getter {
    /// The value now.
    #[must_use]
    pub fn read(self, view: &View<'_>) -> Reading {
        match self {
            Self::Number(get) => Reading::Number(get(view)),
            Self::Flag(get) => Reading::Flag(get(view)),
            Self::Count(code) => Reading::Number(as_number(view.observed.count(code))),
        }
    }
}

impl NameInfo {
    /// A number with a unit.
    #[must_use]
    pub const fn number(
        name: &'static str,
        unit: &'static str,
        meaning: &'static str,
        get: fn(&View<'_>) -> f64,
    ) -> Self {
        Self {
            name,
            unit: Unit::Number(unit),
            meaning,
            getter: Getter::Number(get),
        }
    }

    /// True or false.
    #[must_use]
    pub const fn flag(
        name: &'static str,
        meaning: &'static str,
        get: fn(&View<'_>) -> bool,
    ) -> Self {
        Self {
            name,
            unit: Unit::Flag,
            meaning,
            getter: Getter::Flag(get),
        }
    }

    /// Describes the number of events of a code; `name` is `count.` and the code, or near it.
    #[must_use]
    pub const fn count(name: &'static str, code: &'static str, meaning: &'static str) -> Self {
        Self {
            name,
            unit: Unit::Number(""),
            meaning,
            getter: Getter::Count(code),
        }
    }
}
