//! Fuses.

use super::settings::{FuseLaw, FuseSettings};

/// A fuse of the junction box.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum FuseId {
    /// Supply of the right motor.
    MotorRight,
    /// Supply of the left motor.
    MotorLeft,
    /// Tail supply, which feeds the module and its outputs.
    Tail,
    /// The vehicle's small modules.
    SmallModules,
}

impl FuseId {
    /// All of them.
    pub const ALL: [Self; FUSES] = [
        Self::MotorRight,
        Self::MotorLeft,
        Self::Tail,
        Self::SmallModules,
    ];

    pub(super) const fn index(self) -> usize {
        self as usize
    }
}

pub(super) const FUSES: usize = 4;

/// A wire that melts by the law of the settings.
///
/// By default its temperature follows the square of the current with one time constant, and it melts
/// at the temperature of its holding current. For currents far above the rating that is the usual
/// rule of a constant I²t; below, the fuse forgets, so that a rated current never blows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fuse {
    law: FuseLaw,
    /// Square of the current that it carries for ever, A².
    holding: f64,
    /// s
    time_constant: f64,
    /// Warming: warmth in terms of the steady current that makes it, A². I²t: the sum so far, A²s.
    warmth: f64,
    blown: bool,
}

impl Fuse {
    pub(super) fn all(settings: &FuseSettings) -> [Self; FUSES] {
        FuseId::ALL.map(|id| {
            let rating = match id {
                FuseId::MotorRight | FuseId::MotorLeft => settings.motor,
                FuseId::Tail => settings.tail,
                FuseId::SmallModules => settings.small_modules,
            };
            let holding = rating * settings.holding_factor;
            Self {
                law: settings.law,
                holding: holding * holding,
                time_constant: settings.time_constant.as_secs_f64(),
                warmth: 0.0,
                blown: false,
            }
        })
    }

    pub(super) fn is_blown(&self) -> bool {
        self.blown
    }

    pub(super) fn blow(&mut self) {
        self.blown = true;
    }

    pub(super) fn replace(&mut self) {
        self.blown = false;
        self.warmth = 0.0;
    }

    /// Seconds until a steady current blows it.
    pub(super) fn time_to_blow(&self, current: f64) -> Option<f64> {
        let heating = current * current;
        if self.blown || heating <= self.holding {
            return None;
        }
        let time = match self.law {
            FuseLaw::Warming => {
                self.time_constant * libm::log((heating - self.warmth) / (heating - self.holding))
            }
            FuseLaw::I2t => (self.holding * self.time_constant - self.warmth) / heating,
            FuseLaw::Never => return None,
        };
        Some(time.max(0.0))
    }

    /// Lets a steady current flow for `seconds`, after which `kept` is the share of the old warmth
    /// that remains. Returns whether it blew.
    pub(super) fn carry(&mut self, current: f64, seconds: f64, kept: f64) -> bool {
        let heating = current * current;
        let melting = match self.law {
            FuseLaw::Warming => {
                self.warmth = heating + (self.warmth - heating) * kept;
                self.holding
            }
            FuseLaw::I2t => {
                let adds_up = heating > self.holding;
                self.warmth = if adds_up {
                    self.warmth + heating * seconds
                } else {
                    0.0
                };
                self.holding * self.time_constant
            }
            FuseLaw::Never => return false,
        };
        if self.blown || self.warmth < melting {
            return false;
        }
        self.blown = true;
        true
    }
}
