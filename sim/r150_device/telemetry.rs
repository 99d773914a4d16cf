//! From what the sensors read to the fields of replies.

use super::R150Device;
use super::reply::{Reply, SystemInfo};
use super::settings::Voltage48v;

impl R150Device {
    /// The reply to 0x05.
    pub(super) fn pwm_inputs(&self) -> Reply {
        Reply::PwmInputs {
            frequency_hz: self.measured.pwm_in.map(|input| round(input.frequency)),
            duty: self.measured.pwm_in.map(|input| round(input.duty * 1000.0)),
        }
    }

    /// The reply to 0x12.
    pub(super) fn motor_reply(&self) -> Reply {
        Reply::Motors {
            right_rpm: round(self.measured.motor_rpm.right),
            left_rpm: round(self.measured.motor_rpm.left),
            soc: round(self.measured.soc * 1000.0),
        }
    }

    /// The reply to 0x06.
    pub(super) fn system_info(&mut self) -> SystemInfo {
        let measured = self.measured;
        let spread = self.settings.measurement_noise / 100.0;
        let noise = &mut self.noise;
        let mut spoil = |value: f64| {
            if spread > 0.0 {
                value * (1.0 + spread * noise.normal())
            } else {
                value
            }
        };
        let volts_48v = match self.settings.voltage_48v {
            Voltage48v::Supply => measured.bus_voltage,
            Voltage48v::Output => measured.rail_voltage[4],
        };
        let voltage = measured
            .rail_voltage
            .map(|volts| round(spoil(volts) * 1000.0));
        let current = measured
            .rail_current
            .map(|amperes| round(spoil(amperes) * 1000.0));
        let [v12a, v12b, v12c, v12d, ..] = voltage;
        let [i12a, i12b, i12c, i12d, i48, _] = current;
        let info = SystemInfo {
            voltage_12v: [v12a, v12b, v12c, v12d],
            voltage_48v: round(spoil(volts_48v) * 1000.0),
            current_12v: [i12a, i12b, i12c, i12d],
            current_48v: i48,
            temp_12v: measured.temperature.map(|celsius| round(celsius * 10.0)),
            ..self.system_status()
        };
        self.stick(info)
    }

    /// The part of the reply to 0x06 that no sensor gives.
    pub(super) fn system_status(&self) -> SystemInfo {
        let pwm = self.pwm_outputs();
        SystemInfo {
            sys_status: self.protection.sys_status(),
            power_ctrl_mode: u8::from(!self.control.power_by_client),
            pwm_ctrl_mode: u8::from(!self.control.pwm_by_client),
            power_status: self.power_status(),
            pwm_status: (0..4).fold(0, |bits, i| bits | u8::from(pwm[i] > 0) << i),
            ..SystemInfo::default()
        }
    }
}

/// Rounds to the nearest integer of a field, saturating at its ends; what is not a number is 0.
fn round<T: FromRounded>(value: f64) -> T {
    T::from_rounded(value.round())
}

trait FromRounded {
    fn from_rounded(value: f64) -> Self;
}

macro_rules! from_rounded {
    ($($field:ty),*) => { $(
        impl FromRounded for $field {
            #[allow(
                clippy::cast_possible_truncation,
                clippy::cast_sign_loss,
                reason = "a cast from a float saturates, as the documentation says; not every \
                          field can lose a sign"
            )]
            fn from_rounded(value: f64) -> Self {
                value as $field
            }
        }
    )* };
}

from_rounded!(u16, u32, i16, i32);
