//! Groups of outputs that are protected together, and the reasons to switch them off.

use std::fmt;
use std::ops::Range;

use rigsim_physics::r150::R150Measurements;

use super::command::sys_status;

/// Outputs that are protected together.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Group {
    /// 12 V outputs A and B.
    Ab,
    /// 12 V outputs C and D.
    Cd,
    /// The 48 V output.
    V48,
    /// The 5 V outputs.
    V5,
}

impl Group {
    pub(super) const ALL: [Self; 4] = [Self::Ab, Self::Cd, Self::V48, Self::V5];

    /// Its bits in `powerStatus`.
    #[must_use]
    pub fn mask(self) -> u8 {
        match self {
            Self::Ab => 0b00_0011,
            Self::Cd => 0b00_1100,
            Self::V48 => 0b01_0000,
            Self::V5 => 0b10_0000,
        }
    }

    /// Its rails.
    pub(super) fn rails(self) -> Range<usize> {
        match self {
            Self::Ab => 0..2,
            Self::Cd => 2..4,
            Self::V48 => 4..5,
            Self::V5 => 5..6,
        }
    }

    pub(super) fn overcurrent_bit(self) -> u32 {
        match self {
            Self::Ab => sys_status::OVERCURRENT_AB,
            Self::Cd => sys_status::OVERCURRENT_CD,
            Self::V48 => sys_status::OVERCURRENT_48V,
            Self::V5 => sys_status::OVERCURRENT_5V,
        }
    }

    pub(super) fn over_temperature_bit(self) -> u32 {
        match self {
            Self::Ab => sys_status::OVER_TEMPERATURE_AB,
            Self::Cd => sys_status::OVER_TEMPERATURE_CD,
            Self::V48 | Self::V5 => 0,
        }
    }

    /// Its temperature sensor, if it has one.
    pub(super) fn temperature_c(self, measured: &R150Measurements) -> Option<f64> {
        match self {
            Self::Ab => Some(measured.temperature[0]),
            Self::Cd => Some(measured.temperature[1]),
            Self::V48 | Self::V5 => None,
        }
    }
}

impl fmt::Display for Group {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Ab => "12 V A+B",
            Self::Cd => "12 V C+D",
            Self::V48 => "48 V",
            Self::V5 => "5 V",
        })
    }
}

/// Reason for which a group was switched off.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Cause {
    /// Too much current or power for too long.
    Overcurrent,
    /// Too hot.
    OverTemperature,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Overcurrent => "overcurrent",
            Self::OverTemperature => "over-temperature",
        })
    }
}
