//! Actions of an operator, a scenario or bad luck to the car.

use super::MecanumPlant;
use super::signals::{ECHOES, MecanumMeasurements, PlugSwaps, Wheel};
use crate::faults::{MotorFaults, number};

/// State of an ultrasonic sensor.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Ultrasonic {
    /// It measures.
    #[default]
    Working,
    /// It hears nothing.
    Missing,
    /// It gives this, whatever there is; m.
    Stuck(Option<f64>),
    /// It hears an echo from this distance, unless something is nearer; m.
    Ghost(f64),
}

/// Faults of the car as a whole. They lie over what was set otherwise, so that taking them
/// away leaves no trace but in how the car has moved meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct MecanumFaults {
    /// Board and motors have no supply.
    pub unsupplied: bool,
    /// Plugs that have changed places.
    pub swaps: PlugSwaps,
    /// The ultrasonic sensors, in the order of [`MecanumMeasurements::echoes`].
    pub ultrasonic: [Ultrasonic; ECHOES],
    /// Number that the reader takes any tag for.
    pub tag_reads_as: Option<u32>,
    /// The magnetic bar does not feel a strip.
    pub strip_lost: bool,
    /// Reading of the infrared sensor, whatever there is.
    pub infrared_stuck: Option<bool>,
}

impl MecanumFaults {
    /// Spoils what the sensors should see.
    pub fn spoil(&self, measured: &mut MecanumMeasurements) {
        for (echo, sensor) in measured.echoes.iter_mut().zip(self.ultrasonic) {
            *echo = match sensor {
                Ultrasonic::Working => *echo,
                Ultrasonic::Missing => None,
                Ultrasonic::Stuck(stuck) => stuck,
                Ultrasonic::Ghost(ghost) => Some(echo.map_or(ghost, |echo| echo.min(ghost))),
            };
        }
        if measured.tag != 0 {
            measured.tag = self.tag_reads_as.unwrap_or(measured.tag);
        }
        if self.strip_lost {
            measured.magnetic_bar = 0;
        }
        measured.obstacle_ahead = self.infrared_stuck.unwrap_or(measured.obstacle_ahead);
    }

    /// Holds everything in the ranges of the methods that set the same, and ghosts where a sensor
    /// can hear them.
    fn within_limits(&self, hearing: f64) -> Self {
        Self {
            ultrasonic: self.ultrasonic.map(|sensor| match sensor {
                Ultrasonic::Ghost(distance) => {
                    Ultrasonic::Ghost(number(distance).clamp(0.0, hearing))
                }
                other => other,
            }),
            ..*self
        }
    }
}

impl MecanumPlant {
    /// Replaces all that is wrong with the car as a whole; only a change wakes the car.
    pub fn set_faults(&mut self, faults: &MecanumFaults) {
        let faults = faults.within_limits(self.settings.ultrasonic.range);
        if faults == self.faults {
            return;
        }
        let before = self.raw_pulses();
        self.faults = faults;
        // A counter counts on from where it is, whichever wheel's wire it gets.
        let after = self.raw_pulses();
        for (port, offset) in self.pulse_offset.iter_mut().enumerate() {
            let jump = before[port].wrapping_sub(after[port]);
            *offset = offset.wrapping_add(jump);
        }
        self.body.wake();
    }

    /// Returns the faults of the car as a whole.
    #[must_use]
    pub fn faults(&self) -> &MecanumFaults {
        &self.faults
    }

    /// Interference adds pulses to a wheel's wire.
    pub fn add_pulses(&mut self, wheel: Wheel, pulses: u32) {
        let port = self.faults.swaps.port(wheel).index();
        self.pulse_offset[port] = self.pulse_offset[port].wrapping_add(pulses);
    }

    /// Replaces all that is wrong with a wheel; only a change wakes the car. Drag is held within
    /// 0–1000 N·m.
    pub fn set_wheel_faults(&mut self, wheel: Wheel, faults: MotorFaults) {
        let current = &mut self.wheel_faults[wheel.index()];
        let before = std::mem::replace(current, faults.within(1e3));
        if before == *current {
            return;
        }
        if faults.blocked {
            self.drive.gear.stop(wheel.index());
        }
        self.body.wake();
    }

    /// Returns the faults of a wheel.
    #[must_use]
    pub fn wheel_faults(&self, wheel: Wheel) -> MotorFaults {
        self.wheel_faults[wheel.index()]
    }
}
