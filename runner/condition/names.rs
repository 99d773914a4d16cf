//! The tree of names, by kind of device.

use std::fmt;

use sim_core::rig::Rig;

use super::seen::Seen;
use super::{mecanum, r150};
use crate::Kind;

/// What a name stands for.
#[derive(Debug, Clone, Copy)]
pub struct NameInfo {
    /// The name, to be written after the device's.
    pub name: &'static str,
    /// Its unit.
    pub unit: Unit,
    /// What it means.
    pub meaning: &'static str,
    getter: Getter,
}

/// What a name gives.
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

/// Everything that a condition can say of a device of this kind.
#[must_use]
pub fn names(kind: Kind) -> &'static [NameInfo] {
    match kind {
        Kind::R150 => r150::NAMES,
        Kind::Mecanum => mecanum::NAMES,
    }
}

/// A device as conditions see it.
pub(super) struct View<'a> {
    pub(super) rig: &'a Rig,
    pub(super) device: usize,
    pub(super) seen: &'a Seen,
}

/// The value of a name.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Reading {
    Number(f64),
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

/// How the value of a name is found.
#[derive(Debug, Clone, Copy)]
pub(super) enum Getter {
    Number(fn(&View<'_>) -> f64),
    Flag(fn(&View<'_>) -> bool),
    /// How many events of a code there were.
    Count(&'static str),
}

impl Getter {
    pub(super) fn read(self, view: &View<'_>) -> Reading {
        match self {
            Self::Number(get) => Reading::Number(get(view)),
            Self::Flag(get) => Reading::Flag(get(view)),
            Self::Count(code) => Reading::Number(view.seen.count(code)),
        }
    }
}

impl NameInfo {
    pub(super) const fn number(
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

    pub(super) const fn flag(
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

    /// `name` is `count.` and the code.
    pub(super) const fn count(
        name: &'static str,
        code: &'static str,
        meaning: &'static str,
    ) -> Self {
        Self {
            name,
            unit: Unit::Number(""),
            meaning,
            getter: Getter::Count(code),
        }
    }

    pub(super) fn getter(&self) -> Getter {
        self.getter
    }
}
