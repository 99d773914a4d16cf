//! Fuses.

use super::settings::FuseSettings;

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

/// A wire that melts.
///
/// Its temperature follows the square of the current with one time constant, and it melts
/// at the temperature of its holding current. For currents far above the rating that is the usual
/// rule of a constant I²t; below, the fuse forgets, so that a rated current never blows it.
#[derive(Debug, Clone, Copy)]
pub(super) struct Fuse {
    /// Square of the current that it carries for ever, A².
    holding: f64,
    /// s
    time_constant: f64,
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
                FuseId::SmallModules => settings.small_modules,
            };
            let holding = rating * settings.holding_factor;
            Self {
                holding: holding * holding,
                time_constant: settings.time_constant.as_secs_f64(),
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
        let time =
            self.time_constant * libm::log((heating - self.warmth) / (heating - self.holding));
        Some(time.max(0.0))
    }

    /// Lets a steady current flow for a span after which `kept` is the share of the old warmth
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
mod tests {
    use super::*;

    #[test]
    fn each_fuse_carries_the_manuals_rating_and_not_twice_that() {
        let fuses = Fuse::all(&FuseSettings::default());
        for (fuse, rating) in fuses.iter().zip([50.0, 50.0, 60.0, 5.0]) {
            assert_eq!(fuse.time_to_blow(rating), None);
            let seconds = fuse.time_to_blow(2.0 * rating).unwrap();
            assert!((4.0..6.0).contains(&seconds), "{seconds}");
        }
    }
}
