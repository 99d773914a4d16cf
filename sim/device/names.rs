//! Names of conditions about a device.

use std::fmt;
use std::time::Duration;

use rigsim_physics::World;
use rigsim_settings::SimTime;

use super::{Counters, Device, Motion};
use crate::event::Code;
use crate::message::{MessageInfo, Sender};

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
    /// The counters of its events.
    pub counters: &'a Counters,
}

impl View<'_> {
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
        self.counters
            .last_motion
            .map_or(0.0, |(_, from)| self.motion().distance - from)
    }

    fn motion(&self) -> Motion {
        self.device.plant().motion()
    }
}

/// A count as a number.
#[expect(clippy::cast_precision_loss, reason = "no count reaches 2^53")]
#[must_use]
pub fn as_number(count: u64) -> f64 {
    count as f64
}

/// Names about every vehicle: its true pose and motion, and its clients. How often an event happened is
/// `count.` and its code.
#[rustfmt::skip] // One line a name: a table to read.
pub static COMMON: &[NameInfo] = &[
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
    NameInfo::flag("truth.tipping", "a wheel would lift: the vehicle would tip over", |v| v.device.plant().is_tipping()),
    NameInfo::flag("client.attached", "a client has one of the ports open", |v| v.counters.report.attached > 0),
    NameInfo::count("count.requests", "request", "valid requests, packets and lines"),
    NameInfo::count("count.replies", "reply", "replies, packets and lines of the device"),
    NameInfo::count("count.actions", "action_applied", "actions on the vehicle, and changes around it"),
    NameInfo::number("truth.collisions", "", "number of collisions so far", |v| as_number(v.world.collisions(v.device.plant().body()))),
];

/// The length of the velocity; a square root is the same on every machine.
fn length(motion: Motion) -> f64 {
    let (ahead, left) = (motion.forward_speed, motion.leftward_speed);
    (ahead * ahead + left * left).sqrt()
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
            // Six digits are more than a reader needs, and no rounding error shows.
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
    /// Number in the last message that had it; 0 before.
    Field(&'static str),
    /// Bit or value in the last message that had it; false before.
    Bit(&'static str),
    /// Seconds since the last message of a kind; infinite before.
    Age(&'static str),
}

impl Getter {
    /// The value now.
    #[must_use]
    pub fn read(self, view: &View<'_>) -> Reading {
        match self {
            Self::Number(get) => Reading::Number(get(view)),
            Self::Flag(get) => Reading::Flag(get(view)),
            Self::Count(code) => Reading::Number(as_number(view.counters.count(code))),
            Self::Field(name) => Reading::Number(view.counters.field(name)),
            Self::Bit(name) => Reading::Flag(view.counters.field(name) != 0.0),
            Self::Age(name) => Reading::Number(view.age_s(view.counters.last_message(name))),
        }
    }
}

/// The names that the declaration of a message has.
pub(super) fn of_message(message: &'static MessageInfo) -> Vec<NameInfo> {
    let row = |name, unit, text: &'static str, getter| {
        NameInfo::new(name, unit, text.trim().trim_end_matches('.'), getter)
    };
    let mut names = Vec::new();
    if !message.age.is_empty() {
        let meaning = "time since the last such message; infinite before";
        let getter = Getter::Age(message.age);
        names.push(row(message.age, Unit::Number("s"), meaning, getter));
    }
    if message.sender == Sender::Client && !message.count.is_empty() {
        let meaning = "number of such messages that arrived";
        names.push(NameInfo::count(message.count, message.count, meaning));
    }
    for field in message.fields {
        let unit = Unit::Number(field.unit);
        let numbers = field.named.iter();
        names.extend(numbers.map(|name| row(name, unit, field.text, Getter::Field(name))));
        let flags = field.flags.iter().filter(|(name, _)| !name.is_empty());
        names.extend(flags.map(|(name, text)| row(name, Unit::Flag, text, Getter::Bit(name))));
    }
    names
}

/// The name for the number of events of a code.
pub(super) fn of_code(code: Code) -> NameInfo {
    let meaning = code.about.trim_end_matches('.');
    NameInfo::count(code.count, code.name, meaning)
}

impl NameInfo {
    const fn new(name: &'static str, unit: Unit, meaning: &'static str, getter: Getter) -> Self {
        Self {
            name,
            unit,
            meaning,
            getter,
        }
    }

    /// Returns whether it counts events of this code.
    pub(super) fn is_count_of(&self, code: Code) -> bool {
        matches!(self.getter, Getter::Count(counted) if counted == code.name)
    }

    /// A number with a unit.
    #[must_use]
    pub const fn number(
        name: &'static str,
        unit: &'static str,
        meaning: &'static str,
        get: fn(&View<'_>) -> f64,
    ) -> Self {
        Self::new(name, Unit::Number(unit), meaning, Getter::Number(get))
    }

    /// True or false.
    #[must_use]
    pub const fn flag(
        name: &'static str,
        meaning: &'static str,
        get: fn(&View<'_>) -> bool,
    ) -> Self {
        Self::new(name, Unit::Flag, meaning, Getter::Flag(get))
    }

    /// Describes the number of events of a code, where `count.` and the code is not its name.
    #[must_use]
    pub const fn count(name: &'static str, code: &'static str, meaning: &'static str) -> Self {
        Self::new(name, Unit::Number(""), meaning, Getter::Count(code))
    }
}
