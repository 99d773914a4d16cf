//! Limits of the motor drivers: ramps of the duty, limits of the current, shutting off when hot.

use super::network::MotorPort;
use super::settings::{MotorSettings, MotorThermalSettings};

/// Temperature of a driver above which it allows less current, °C; assumed: drivers begin at 70 to 85 °C
/// at their plate.
const DRIVER_DERATING: f64 = 80.0;
/// Temperature of a driver at which it shuts off, °C; assumed: drivers end at 85 to 100 °C.
const DRIVER_SHUT_OFF: f64 = 95.0;
/// A hot driver comes back when it is so much cooler than where it shut off, K.
const COOLED: f64 = 10.0;

/// One driver.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Driver {
    /// Duty of its bridge, behind the ramp, −1 to 1.
    pub(super) duty: f64,
    /// Most current, A.
    limit: Option<f64>,
    /// Set if heat lowers that limit.
    pub(super) derated: bool,
    pub(super) shut_off: bool,
}

impl Driver {
    pub(super) fn new(motor: &MotorSettings) -> Self {
        Self {
            limit: motor.current_limit,
            ..Self::default()
        }
    }

    /// Moves the duty towards what is wanted for so many seconds: away from zero by one ramp,
    /// towards zero by the other.
    pub(super) fn ramp(&mut self, wanted: f64, motor: &MotorSettings, seconds: f64) {
        let reach = |ramp: f64| if ramp > 0.0 { seconds / ramp } else { 2.0 };
        let (up, down) = (
            reach(motor.ramp_up.as_secs_f64()),
            reach(motor.ramp_down.as_secs_f64()),
        );
        if self.duty * wanted < 0.0 {
            // Through zero: what is left of the step raises it again.
            let spent = self.duty.abs() / down;
            if spent >= 1.0 {
                self.duty -= self.duty.signum() * down;
                return;
            }
            self.duty = wanted.clamp(-up * (1.0 - spent), up * (1.0 - spent));
            return;
        }
        let most = if wanted.abs() > self.duty.abs() {
            up
        } else {
            down
        };
        self.duty += (wanted - self.duty).clamp(-most, most);
    }

    /// Takes over how hot the motor and the driver are, °C.
    pub(super) fn warm(
        &mut self,
        motor: &MotorSettings,
        thermal: &MotorThermalSettings,
        stall: f64,
        [motor_celsius, driver_celsius]: [f64; 2],
    ) {
        let left = |celsius: f64, from: f64, to: f64| {
            ((to - celsius) / (to - from).max(0.1)).clamp(0.0, 1.0)
        };
        let share = left(
            motor_celsius,
            thermal.motor_derating,
            thermal.motor_shut_off,
        )
        .min(left(driver_celsius, DRIVER_DERATING, DRIVER_SHUT_OFF));
        let cooled = motor_celsius < thermal.motor_shut_off - COOLED
            && driver_celsius < DRIVER_SHUT_OFF - COOLED;
        self.derated = share < 1.0;
        self.shut_off = share <= 0.0 || (self.shut_off && !cooled);
        self.limit = if self.derated {
            Some(motor.current_limit.unwrap_or(stall) * share)
        } else {
            motor.current_limit
        };
    }

    /// The bridge as the bus sees it, which has `bus` V: where the whole duty would draw more
    /// current than is allowed it gives less. A bridge that is off still conducts through its
    /// diodes what a motor gives that turns faster than the bus allows.
    pub(super) fn port(&self, on: bool, duty: f64, bus: f64, motor: MotorPort) -> MotorPort {
        if !on || self.shut_off {
            return MotorPort {
                connected: motor.back_emf.abs() > bus,
                duty: motor.back_emf.signum(),
                ..motor
            };
        }
        let duty = self.limit.map_or(duty, |limit| {
            let reach = limit * motor.resistance;
            let (low, high) = (motor.back_emf - reach, motor.back_emf + reach);
            duty.clamp((low / bus).clamp(-1.0, 1.0), (high / bus).clamp(-1.0, 1.0))
        });
        MotorPort {
            connected: true,
            duty,
            ..motor
        }
    }
}

#[cfg(test)]
mod tests;
