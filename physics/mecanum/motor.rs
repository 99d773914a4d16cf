//! A brushless gear motor with its own speed control.

use super::settings::{CarMotorSettings, ZeroSpeed};

/// What the pins ask of a motor.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Order {
    /// Nothing: it turns freely.
    Coast,
    /// To hold.
    Brake,
    /// This speed of the wheel, rad/s.
    Turn(f64),
}

/// The controller of one motor. Speeds and torques are those of the wheel.
#[derive(Debug, Clone, Copy)]
pub(super) struct Motor {
    /// Where the ramp stands, rad/s.
    reference: f64,
}

/// How a motor works on its wheel over one step: a torque of `gain · (speed − speed of the wheel)`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Grip {
    /// N·m·s/rad
    pub(super) gain: f64,
    /// rad/s
    pub(super) speed: f64,
}

/// [`CarMotorSettings`] in the form that a step wants.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotorLaw {
    /// rad/s
    full_speed: f64,
    /// rad/s²
    ramp: f64,
    gain: f64,
    torque: f64,
    coasts_at_zero: bool,
}

impl Motor {
    pub(super) fn new() -> Self {
        Self { reference: 0.0 }
    }

    /// Carries out an order over a step of `dt` seconds, from the wheel's present speed.
    pub(super) fn carry_out(&mut self, order: Order, speed: f64, law: &MotorLaw, dt: f64) -> Grip {
        let Order::Turn(wanted) = order else {
            // The ramp begins where the wheel is found when it is driven again.
            self.reference = speed;
            return Grip::default();
        };
        let stretch = law.ramp * dt;
        self.reference += (wanted - self.reference).clamp(-stretch, stretch);
        let behind = (self.reference - speed).abs();
        // Less gain where the full one would ask for more torque than there is. The wheel then
        // cannot overshoot, as it could under a fixed torque over a whole step.
        let gain = if behind * law.gain > law.torque {
            law.torque / behind
        } else {
            law.gain
        };
        Grip {
            gain,
            speed: self.reference,
        }
    }
}

impl MotorLaw {
    pub(super) fn new(settings: &CarMotorSettings) -> Self {
        let full_speed = settings.full_speed * std::f64::consts::TAU / 60.0;
        Self {
            full_speed,
            ramp: full_speed / settings.ramp_time.as_secs_f64(),
            gain: settings.speed_gain,
            torque: settings.torque_limit,
            coasts_at_zero: settings.at_zero_speed == ZeroSpeed::Coast,
        }
    }

    /// What a motor without its brake makes of the speed voltage and its direction.
    pub(super) fn order(&self, speed_voltage: f64, reverse: bool) -> Order {
        if speed_voltage <= 0.0 && self.coasts_at_zero {
            return Order::Coast;
        }
        let speed = speed_voltage * self.full_speed;
        Order::Turn(if reverse { -speed } else { speed })
    }
}
