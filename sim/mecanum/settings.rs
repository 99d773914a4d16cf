//! Settings of a mecanum car: of its firmware, and of the hardware around it.

use sim_physics::mecanum::MecanumPlantSettings;

use crate::device::{DeviceSettings, LineSettings};
use crate::mecanum_device::settings::MecanumFirmwareSettings;

crate::device_settings! {
    /// The mecanum car.
    pub struct MecanumSettings { MecanumFirmwareSettings, MecanumPlantSettings }
}

impl DeviceSettings for MecanumSettings {
    fn line(&self, link: usize) -> LineSettings {
        let board = &self.firmware;
        let (baud, stop_bits) = match link {
            0 => (board.baud, board.stop_bits),
            _ => (board.ros_baud, board.ros_stop_bits),
        };
        LineSettings {
            baud,
            // The settings allow 1 and 2.
            stop_bits: u8::try_from(stop_bits).unwrap_or(1),
        }
    }

    fn ordered(&self) -> Vec<[(&'static str, f64); 2]> {
        let board = &self.firmware;
        vec![[
            ("ultrasonic_nearest", board.ultrasonic_nearest),
            ("ultrasonic_farthest", board.ultrasonic_farthest),
        ]]
    }
}
