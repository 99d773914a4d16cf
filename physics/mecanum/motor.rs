//! A brushless gear motor with its own speed control.

use super::settings::CarMotorSettings;

/// Rate at which BK comes on, 1/s: a wheel that is stopped at once would jerk its gear.
const BRAKE_RATE: f64 = 1.0 / 0.02;

/// Order of the pins to a motor.
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
    /// Speed at which the ramp stands, rad/s.
    reference: f64,
    /// Speed of it when the motor was last asked to turn.
    aim: f64,
    /// Torque by which the control makes up for a lack of speed that stays, N·m.
    integral: f64,
    /// Part to which BK has come on, 0–1.
    brake: f64,
}

/// Effect of a motor on its wheel over a part of a step: a torque of
/// `gain · (speed − speed of the wheel)`.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Grip {
    /// N·m·s/rad
    pub(super) gain: f64,
    /// At the end of the part, rad/s.
    pub(super) speed: f64,
    /// Share of the torque of its brake with which it holds.
    pub(super) held: f64,
}

/// [`CarMotorSettings`] in the form that a step wants.
#[derive(Debug, Clone, Copy)]
pub(super) struct MotorLaw {
    /// rad/s
    full_speed: f64,
    /// rad/s²
    ramp: f64,
    /// Effect of BK on a wheel that is off the ground, rad/s².
    brake_deceleration: f64,
    gain: f64,
    /// N·m for each rad of angle that is lacking.
    integral_gain: f64,
    torque: f64,
}

impl Motor {
    pub(super) fn new() -> Self {
        Self {
            reference: 0.0,
            aim: 0.0,
            integral: 0.0,
            // It has stood for long.
            brake: 1.0,
        }
    }

    /// Returns whether an order moves the ramp, or the brake.
    pub(super) fn moves(&self, order: Order) -> bool {
        match order {
            Order::Turn(wanted) => wanted != self.reference,
            Order::Brake => self.brake < 1.0,
            Order::Coast => false,
        }
    }

    /// Carries out the orders of a part of `dt` seconds, at whose beginning the wheel has this speed:
    /// each for so many seconds, s.
    pub(super) fn carry_out(
        &mut self,
        orders: impl Iterator<Item = (Order, f64)>,
        speed: f64,
        law: &MotorLaw,
        dt: f64,
    ) -> Grip {
        // For how long it was asked to turn, and held with all its torque, s.
        let (mut turned, mut held) = (0.0, 0.0);
        for (order, seconds) in orders {
            let brake = self.brake;
            self.brake = if order == Order::Brake {
                (brake + seconds * BRAKE_RATE).min(1.0)
            } else {
                0.0
            };
            match order {
                Order::Turn(wanted) => {
                    let stretch = law.ramp * seconds;
                    self.reference += (wanted - self.reference).clamp(-stretch, stretch);
                    self.aim = self.reference;
                    turned += seconds;
                }
                // The ramp begins where the wheel is found when it is driven again.
                Order::Coast => self.reference = speed,
                Order::Brake => {
                    // It comes on evenly, and is on for the rest.
                    let rising = (self.brake - brake) / BRAKE_RATE;
                    held += rising * (brake + self.brake) / 2.0 + (seconds - rising);
                    let lost = held * law.brake_deceleration;
                    self.reference = speed - speed.clamp(-lost, lost);
                }
            }
        }
        let lack = self.aim - speed;
        if turned <= 0.0 {
            self.integral = 0.0;
        }
        let aim = self.aim + self.integral / law.gain;
        let behind = (aim - speed).abs();
        // Less gain where the full one would ask for more torque than there is. The wheel then
        // cannot overshoot, as it could under a fixed torque over a whole step.
        let gain = if behind * law.gain > law.torque {
            law.torque / behind
        } else {
            // Only within the limit, so that the integral does not grow for what cannot be had.
            let integral = self.integral + law.integral_gain * lack * turned;
            self.integral = integral.clamp(-law.torque, law.torque);
            law.gain
        };
        Grip {
            gain: gain * (turned / dt).min(1.0),
            speed: aim,
            held: (held / dt).min(1.0),
        }
    }
}

impl MotorLaw {
    pub(super) fn new(settings: &CarMotorSettings) -> Self {
        let full_speed = settings.full_speed * std::f64::consts::TAU / 60.0;
        Self {
            full_speed,
            ramp: full_speed / settings.ramp_time.as_secs_f64(),
            brake_deceleration: settings.brake_torque / settings.inertia,
            gain: settings.speed_gain,
            integral_gain: match settings.speed_integral.as_secs_f64() {
                0.0 => 0.0,
                time => settings.speed_gain / time,
            },
            torque: settings.torque_limit,
        }
    }

    /// Order to a motor without its brake from the speed voltage and its direction. Assumed: without a
    /// speed voltage it turns freely, since most controllers switch their bridge off.
    pub(super) fn order(&self, speed_voltage: f64, reverse: bool) -> Order {
        if speed_voltage <= 0.0 {
            return Order::Coast;
        }
        let speed = speed_voltage * self.full_speed;
        Order::Turn(if reverse { -speed } else { speed })
    }
}
