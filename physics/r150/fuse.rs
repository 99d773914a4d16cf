//! Fuses.

use std::time::Duration;

use super::settings::FuseSettings;

/// Multiple of the rating that a fuse carries for ever: automotive blade and strip fuses.
const HOLDING_FACTOR: f64 = 1.2;
/// Rating of the small modules' fuse, A; manual section 1.
const SMALL_MODULES: f64 = 5.0;
/// Time constant of its warming; twice the rating then blows in about five seconds.
pub(super) const TIME_CONSTANT: Duration = Duration::from_secs(10);

rigsim_settings::file_words! {
    /// A fuse of the junction box.
    pub enum FuseId {
        /// Supply of the right motor.
        MotorRight = "motor-right",
        /// Supply of the left motor.
        MotorLeft = "motor-left",
        /// Tail supply, which feeds the module and its outputs.
        Tail = "tail",
        /// The vehicle's small modules.
        SmallModules = "small-modules",
    }
}

pub(super) const FUSES: usize = 4;

/// A wire that melts.
///
/// Its temperature follows the square of the current with one time constant, and it melts
/// at the temperature of its holding current. For currents far above the rating that is the usual
/// rule of a constant I²t; below, the fuse forgets, so that a rated current never blows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fuse {
    /// Square of the current that it carries for ever, A².
    holding: f64,
    /// In terms of the steady current that makes it, A².
    warmth: f64,
    pub(super) blown: bool,
}

impl Fuse {
    pub(super) fn all(settings: &FuseSettings) -> [Self; FUSES] {
        FuseId::ALL.map(|id| {
            let rating = match id {
                FuseId::MotorRight | FuseId::MotorLeft => settings.motor,
                FuseId::Tail => settings.tail,
                FuseId::SmallModules => SMALL_MODULES,
            };
            let holding = rating * HOLDING_FACTOR;
            Self {
                holding: holding * holding,
                warmth: 0.0,
                blown: false,
            }
        })
    }

    /// Seconds until a steady current blows it.
    pub(super) fn time_to_blow(&self, current: f64) -> Option<f64> {
        let heating = current * current;
        if self.blown || heating <= self.holding {
            return None;
        }
        let constants = libm::log((heating - self.warmth) / (heating - self.holding));
        Some((TIME_CONSTANT.as_secs_f64() * constants).max(0.0))
    }

    /// Applies a steady current for a span after which `kept` is the share of the old warmth
    /// that remains. Returns whether it blew.
    pub(super) fn carry(&mut self, current: f64, kept: f64) -> bool {
        let heating = current * current;
        self.warmth = heating + (self.warmth - heating) * kept;
        if self.blown || self.warmth < self.holding {
            return false;
        }
        self.blown = true;
        true
    }
}

#[cfg(test)]
mod tests;
