//! Actions of an operator, a scenario or bad luck to the vehicle.

use super::R150Plant;
use super::fuse::{FUSES, FuseId};
use super::signals::{Load, PwmSource, RAILS, Rail, Side, Sides};
use crate::faults::{MotorFaults, number, within};

/// Faults of the vehicle as a whole. They lie over what was set otherwise, so that taking
/// them away leaves no trace but what they did to charge, fuses and motion meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct R150Faults {
    /// Loads in place of those that are wired, by [`Rail::index`].
    pub loads: [Option<Load>; RAILS],
    /// Voltage that the battery lacks, V.
    pub supply_drop: f64,
    /// Resistance added to the battery, Ω.
    pub supply_resistance: f64,
    /// Charge that the battery lacks, 0–1.
    pub missing_charge: f64,
    /// Least temperature of a 12 V converter pair, °C.
    pub temperature: [Option<f64>; 2],
    /// The power module reports a fault in itself.
    pub power_module: bool,
    /// Fuses that are out, by their place in [`FuseId::ALL`].
    pub fuses_out: [bool; FUSES],
    /// The cables of the two motors and their encoders are swapped.
    pub sides_swapped: bool,
    /// Added to what the encoders read, rpm.
    pub encoder_error: Sides<f64>,
}

impl R150Faults {
    /// Holds everything in the ranges of the methods that set the same.
    fn within_limits(&self) -> Self {
        Self {
            loads: self.loads.map(|load| load.map(bounded)),
            supply_drop: number(self.supply_drop).clamp(0.0, 1000.0),
            supply_resistance: number(self.supply_resistance).clamp(0.0, 10.0),
            missing_charge: number(self.missing_charge).clamp(0.0, 1.0),
            temperature: self
                .temperature
                .map(|celsius| celsius.map(|celsius| number(celsius).clamp(-200.0, 1000.0))),
            encoder_error: Sides {
                right: within(self.encoder_error.right, 1e5),
                left: within(self.encoder_error.left, 1e5),
            },
            ..*self
        }
    }
}

impl R150Plant {
    /// Replaces all that is wrong with the vehicle as a whole. Only a change wakes the vehicle, and
    /// one of the encoders' readings alone does not.
    pub fn set_faults(&mut self, faults: &R150Faults) {
        let before = std::mem::replace(&mut self.faults, faults.within_limits());
        let but_for_errors = R150Faults {
            encoder_error: before.encoder_error,
            ..self.faults
        };
        if before == but_for_errors {
            return;
        }
        self.slow.battery.missing = self.faults.missing_charge;
        self.body.wake();
        self.solve_network();
    }

    /// Returns the faults of the vehicle as a whole.
    #[must_use]
    pub fn faults(&self) -> &R150Faults {
        &self.faults
    }

    /// Temperature of the 12 V converter pairs without what is wrong, °C.
    #[must_use]
    pub fn own_temperature(&self) -> [f64; 2] {
        self.slow.temperature
    }

    /// Charge without what is missing, 0–1.
    #[must_use]
    pub fn own_soc(&self) -> f64 {
        self.slow.battery.own_soc()
    }

    /// By how much a side's motor turns faster than its encoder says, rpm.
    #[must_use]
    pub fn encoder_lag(&self, side: Side) -> f64 {
        self.motor_rpm(side) - self.encoder_rpm[side.index()]
    }

    /// Wires a load to a rail. Power is held within 0–100 kW, resistance above 1 mΩ.
    pub fn set_load(&mut self, rail: Rail, load: Load) {
        self.loads[rail.index()] = bounded(load);
        self.solve_network();
    }

    /// Replaces all that is wrong with a side; only a change wakes the vehicle. Drag is held
    /// within 0–100 kN·m.
    pub fn set_side_faults(&mut self, side: Side, faults: MotorFaults) {
        let before = std::mem::replace(&mut self.side_faults[side], faults.within(1e5));
        if before == self.side_faults[side] {
            return;
        }
        if faults.blocked {
            self.drive.gear.stop(side.index());
        }
        self.solve_network();
        self.body.wake();
    }

    /// Returns the faults of a side.
    #[must_use]
    pub fn side_faults(&self, side: Side) -> MotorFaults {
        self.side_faults[side]
    }

    /// Returns whether a fuse has blown.
    #[must_use]
    pub fn is_fuse_blown(&self, fuse: FuseId) -> bool {
        self.slow.fuses[fuse.index()].blown || self.faults.fuses_out[fuse.index()]
    }

    /// Returns what is wired to a PWM input, 0–3.
    #[must_use]
    pub fn pwm_source(&self, input: usize) -> PwmSource {
        self.pwm_sources.get(input).copied().unwrap_or_default()
    }

    /// Wires a source to a PWM input, 0–3.
    pub fn set_pwm_source(&mut self, input: usize, source: PwmSource) {
        if let Some(wired) = self.pwm_sources.get_mut(input) {
            *wired = source;
        }
        self.capture_pwm();
    }
}

fn bounded(load: Load) -> Load {
    match load {
        Load::Power(power) => Load::Power(number(power).clamp(0.0, 1e5)),
        Load::Resistance(resistance) => Load::Resistance(number(resistance).clamp(1e-3, 1e9)),
        other => other,
    }
}
