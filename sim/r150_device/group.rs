//! Groups of outputs that are protected together.

use std::ops::Range;

use rigsim_physics::r150::R150Measurements;

use super::command::sys_status;

rigsim_settings::words! {
    /// Outputs that are protected together.
    pub enum Group {
        /// 12 V outputs A and B.
        Ab = "12 V A+B",
        /// 12 V outputs C and D.
        Cd = "12 V C+D",
        /// The 48 V output.
        V48 = "48 V",
        /// The 5 V outputs.
        V5 = "5 V",
    }
}

impl Group {
    /// Its bits in `powerStatus`.
    #[must_use]
    pub fn mask(self) -> u8 {
        self.rails().fold(0, |mask, rail| mask | 1 << rail)
    }

    /// Its rails.
    pub(super) fn rails(self) -> Range<usize> {
        [0..2, 2..4, 4..5, 5..6][self.index()].clone()
    }

    pub(super) fn overcurrent_bit(self) -> u32 {
        [
            sys_status::OVERCURRENT_AB,
            sys_status::OVERCURRENT_CD,
            sys_status::OVERCURRENT_48V,
            sys_status::OVERCURRENT_5V,
        ][self.index()]
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
        measured.temperature.get(self.index()).copied()
    }
}
