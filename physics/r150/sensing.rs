//! Measurements on the plant.

use super::R150Plant;
use super::fuse::FuseId;
use super::network;
use super::pwm;
use super::signals::{R150Health, R150Measurements, R150Truth, Side};
use crate::faults::EncoderState;
use crate::plant::Plant as _;
use crate::running_gear::RunningGear;

impl R150Plant {
    /// Reads the firmware's sensors now.
    #[must_use]
    pub fn measurements(&self) -> R150Measurements {
        if !self.flow.module_powered {
            return R150Measurements::default();
        }
        R150Measurements {
            module_powered: true,
            motor_rpm: Side::ALL.map(|side| self.encoder(side)).into(),
            motor_turns: self.encoder_turns,
            soc: self.slow.battery.soc(),
            bus_voltage: self.flow.bus,
            rail_voltage: self.flow.rail_voltage,
            rail_current: self.flow.rail_current,
            converter_12v: network::VOLTAGE_12V,
            supply_current: self.flow.tail_current,
            temperature: self.temperature(),
            pwm_in: self.pwm_in,
            power_module_fault: self.faults.power_module,
        }
    }

    /// Returns its wheels and what they did on the ground.
    #[must_use]
    pub fn gear(&self) -> &RunningGear<2> {
        &self.drive.gear
    }

    /// The same, for tests that keep the balance of its energy.
    pub fn gear_mut(&mut self) -> &mut RunningGear<2> {
        &mut self.drive.gear
    }

    /// Returns the true state.
    #[must_use]
    pub fn truth(&self) -> R150Truth {
        R150Truth {
            motion: self.motion(),
            wheel_speed: self.drive.gear.wheel_speed.into(),
            motor_current: self.flow.motor_current.into(),
            motor_supply_current: self.flow.motor_supply.into(),
            battery_voltage: self.flow.bus,
            battery_current: self.flow.battery_current,
            soc: self.slow.battery.soc(),
            health: self.health(),
            motor_celsius: self.slow.motors.map(|[motor, _]| motor).into(),
            driver_celsius: self.slow.motors.map(|[_, driver]| driver).into(),
        }
    }

    /// Lists what is broken or too hot.
    #[must_use]
    pub fn health(&self) -> R150Health {
        R150Health {
            fuse_blown: FuseId::ALL.map(|fuse| self.is_fuse_blown(fuse)),
            derated: self.drive.drivers.map(|driver| driver.derated).into(),
            shut_off: self.drive.drivers.map(|driver| driver.shut_off).into(),
        }
    }

    /// Measures what has changed at the inputs.
    pub(super) fn capture_pwm(&mut self) {
        let own_duty = &self.commands.pwm_out_duty;
        for (reading, source) in self.pwm_in.iter_mut().zip(self.pwm_sources) {
            *reading = pwm::read(source, own_duty);
        }
    }

    pub(super) fn update_encoders(&mut self) {
        for side in Side::ALL {
            if self.side_faults[side].encoder != EncoderState::Stuck {
                self.encoder_rpm[side.index()] = self.motor_rpm(side);
            }
        }
    }

    /// Advances the encoders' counts by so many seconds.
    pub(super) fn count_turns(&mut self, seconds: f64) {
        for side in Side::ALL {
            self.encoder_turns[side] += self.encoder(side) / 60.0 * seconds;
        }
    }

    pub(super) fn motor_rpm(&self, side: Side) -> f64 {
        self.drive.motor_speed(side) * 60.0 / std::f64::consts::TAU
    }

    /// Speed that reaches the firmware's input for a side.
    fn encoder(&self, side: Side) -> f64 {
        // Swapped cables lead to the other side's encoder.
        let side = self.port_of(side);
        let rpm = match self.side_faults[side].encoder {
            EncoderState::Lost => 0.0,
            EncoderState::Working | EncoderState::Stuck => self.encoder_rpm[side.index()],
        };
        rpm + self.faults.encoder_error[side]
    }

    fn temperature(&self) -> [f64; 2] {
        let mut celsius = self.slow.temperature;
        for (celsius, least) in celsius.iter_mut().zip(self.faults.temperature) {
            *celsius = least.map_or(*celsius, |least| celsius.max(least));
        }
        celsius
    }
}
