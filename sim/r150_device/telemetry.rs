//! From what the sensors read to the fields of replies.

use rigsim_physics::r150::{R150Measurements, RAILS, Rail};
use rigsim_settings::SimTime;

use super::R150Device;
use super::command::{Motors, PwmInputs, Reply, SystemInfo};
use super::settings::{Current48v, NoiseSettings, Voltage12v, Voltage48v};
use super::speed::Speedometer;
use crate::noise::Noise;
use crate::rounding::round;

impl R150Device {
    /// The reply to 0x05.
    pub(super) fn pwm_inputs(&self) -> Reply {
        Reply::PwmInputs(PwmInputs {
            frequency_hz: self.measured.pwm_in.map(|input| round(input.frequency)),
            duty: self.measured.pwm_in.map(|input| round(input.duty * 1000.0)),
        })
    }

    /// Counts the pulses of the motors' encoders into their speeds. Without a supply nothing
    /// counts.
    pub(super) fn read_encoders(&mut self, now: SimTime, measured: &R150Measurements) {
        let turns = [measured.motor_turns.right, measured.motor_turns.left];
        for (speed, turns) in self.speeds.iter_mut().zip(turns) {
            if self.measured.module_powered && measured.module_powered {
                speed.read(now, turns);
            } else {
                *speed = Speedometer::new(&self.settings, now, turns);
            }
        }
    }

    /// The reply to 0x12.
    pub(super) fn motor_reply(&mut self) -> Reply {
        let deviation = self.settings.noise.speed;
        let noise = &mut self.noise;
        let [right_rpm, left_rpm] = self.speeds.each_ref().map(|speed| {
            let turns = speed.rpm.round() != 0.0;
            let deviation = if turns { deviation } else { 0.0 };
            round(spoilt(noise, speed.rpm, deviation))
        });
        Reply::Motors(Motors {
            right_rpm,
            left_rpm,
            soc: round(self.measured.soc * 1000.0),
        })
    }

    /// The reply to 0x06.
    pub(super) fn system_info(&mut self) -> SystemInfo {
        let (volts, amperes) = self.rails_as_reported();
        let volts_48v = match self.settings.voltage_48v {
            Voltage48v::Supply => self.measured.bus_voltage,
            Voltage48v::Output => self.measured.rail_voltage[Rail::V48.index()],
        };
        let NoiseSettings {
            voltage,
            current,
            temperature,
            ..
        } = self.settings.noise;
        let noise = &mut self.noise;
        let [v12a, v12b, v12c, v12d, ..] =
            volts.map(|volts| round(spoilt(noise, volts, voltage) * 1000.0));
        let [i12a, i12b, i12c, i12d, i48, _] =
            amperes.map(|amperes| round(spoilt(noise, amperes, current) * 1000.0));
        let voltage_48v = round(spoilt(noise, volts_48v, voltage) * 1000.0);
        let celsius = self.measured.temperature;
        let temp_12v = celsius.map(|celsius| round(spoilt(noise, celsius, temperature) * 10.0));
        let info = SystemInfo {
            voltage_12v: [v12a, v12b, v12c, v12d],
            voltage_48v,
            current_12v: [i12a, i12b, i12c, i12d],
            current_48v: i48,
            temp_12v,
            ..self.system_status()
        };
        self.stick(info)
    }

    /// Voltage and current of each rail, measured where the settings say.
    fn rails_as_reported(&self) -> ([f64; RAILS], [f64; RAILS]) {
        let mut volts = self.measured.rail_voltage;
        let mut amperes = self.measured.rail_current;
        if self.settings.voltage_12v == Voltage12v::Converter {
            let on = self.power_status();
            for rail in [Rail::V12A, Rail::V12B, Rail::V12C, Rail::V12D] {
                if on >> rail.index() & 1 == 0 {
                    volts[rail.index()] = self.measured.converter_12v;
                }
            }
        }
        if self.settings.current_48v == Current48v::Supply {
            amperes[Rail::V48.index()] = self.measured.supply_current;
        }
        (volts, amperes)
    }

    /// The part of the reply to 0x06 that no sensor gives.
    pub(super) fn system_status(&self) -> SystemInfo {
        let pwm = self.pwm_outputs();
        SystemInfo {
            sys_status: self.protection.sys_status(),
            power_ctrl_mode: u8::from(!self.control.by_client.power),
            pwm_ctrl_mode: u8::from(!self.control.by_client.pwm),
            power_status: self.power_status(),
            pwm_status: (0..4).fold(0, |bits, i| bits | u8::from(pwm[i] > 0) << i),
            ..SystemInfo::default()
        }
    }
}

/// A reading with white noise of this standard deviation.
fn spoilt(noise: &mut Noise, value: f64, deviation: f64) -> f64 {
    if deviation > 0.0 {
        value + deviation * noise.normal()
    } else {
        value
    }
}
