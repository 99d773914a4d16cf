//! Settings of an R150: of its firmware, and of the hardware around it.

use sim_physics::r150::R150PlantSettings;

use crate::device::{DeviceSettings, LineSettings};
use crate::r150_device::settings::R150FirmwareSettings;

crate::device_settings! {
    /// The XAG R150.
    pub struct R150Settings { R150FirmwareSettings, R150PlantSettings }
}

impl DeviceSettings for R150Settings {
    fn line(&self, _link: usize) -> LineSettings {
        LineSettings::at(self.firmware.baud)
    }

    fn ordered(&self) -> Vec<[(&'static str, f64); 2]> {
        let protection = &self.firmware.protection;
        let pwm = &self.plant.pwm;
        vec![
            [
                (
                    "protection.over_temperature_clear",
                    protection.over_temperature_clear,
                ),
                ("protection.over_temperature", protection.over_temperature),
            ],
            [
                ("protection.undervoltage", protection.undervoltage),
                (
                    "protection.undervoltage_clear",
                    protection.undervoltage_clear,
                ),
            ],
            [
                ("pwm.input_frequency_min", pwm.input_frequency_min),
                ("pwm.input_frequency_max", pwm.input_frequency_max),
            ],
        ]
    }
}
