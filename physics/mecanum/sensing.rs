//! Measurements on the plant.

use super::MecanumPlant;
use super::signals::{MecanumCommands, MecanumMeasurements, PORTS, WHEELS, Wheel};
use crate::faults::number;
use crate::plant::{Motion, Plant as _};
use crate::running_gear::RunningGear;
use crate::traction::Slanted;

/// True state, for verdicts and summaries. No firmware sees this. Arrays are by
/// [`Wheel::index`].
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MecanumTruth {
    /// Pose and motion in the world.
    pub motion: Motion,
    /// Speed of each wheel, rad/s, forward positive.
    pub wheel_speed: [f64; WHEELS],
    /// Angle that each wheel has turned so far, rad, forward positive.
    pub wheel_angle: [f64; WHEELS],
    /// Torque of each motor at its wheel, N·m; brakes not included.
    pub motor_torque: [f64; WHEELS],
}

impl MecanumPlant {
    /// Reads the board's inputs now.
    #[must_use]
    pub fn measurements(&self) -> MecanumMeasurements {
        let mut measured = self.unspoilt();
        self.faults.spoil(&mut measured);
        measured
    }

    /// Reads the board's inputs as they would be if the sensors were whole.
    #[must_use]
    pub fn unspoilt(&self) -> MecanumMeasurements {
        let mut pulses = self.raw_pulses();
        for (pulses, offset) in pulses.iter_mut().zip(self.pulse_offset) {
            *pulses = pulses.wrapping_add(offset);
        }
        MecanumMeasurements {
            board_powered: self.is_supplied(),
            pulses,
            ..self.sensors.readings
        }
    }

    /// Returns whether board and motors have a supply.
    pub(super) fn is_supplied(&self) -> bool {
        !self.faults.unsupplied
    }

    /// Pulses by port as the wheels give them.
    pub(super) fn raw_pulses(&self) -> [u32; PORTS] {
        let mut pulses = [0; PORTS];
        for wheel in Wheel::ALL {
            pulses[self.faults.swaps.port(wheel).index()] = self.drive.pulses[wheel.index()].count;
        }
        pulses
    }

    /// Returns its wheels and what they did on the ground.
    #[must_use]
    pub fn gear(&self) -> &RunningGear<WHEELS, Slanted> {
        &self.drive.gear
    }

    /// The same, for tests that keep the balance of its energy.
    pub fn gear_mut(&mut self) -> &mut RunningGear<WHEELS, Slanted> {
        &mut self.drive.gear
    }

    /// Returns the true state.
    #[must_use]
    pub fn truth(&self) -> MecanumTruth {
        MecanumTruth {
            motion: self.motion(),
            wheel_speed: self.drive.gear.wheel_speed,
            wheel_angle: self.drive.wheel_angle,
            motor_torque: self.drive.motor_torque,
        }
    }
}

impl MecanumCommands {
    /// A speed voltage cannot leave its range; what is not a number is none.
    pub(super) fn within_limits(&self) -> Self {
        Self {
            speed_voltage: number(self.speed_voltage).clamp(0.0, 1.0),
            ..*self
        }
    }
}
