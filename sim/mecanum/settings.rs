//! Settings of a mecanum car: of its firmware, and of the hardware around it.

use rigsim_physics::mecanum::MecanumPlantSettings;

use crate::device::DeviceSettings;
use crate::mecanum_device::settings::MecanumFirmwareSettings;
use crate::uart::Adapter;

crate::device_settings! {
    /// The mecanum car.
    pub struct MecanumSettings { MecanumFirmwareSettings, MecanumPlantSettings }
}

impl DeviceSettings for MecanumSettings {
    fn baud(&self, link: usize) -> u32 {
        match link {
            0 => self.firmware.baud,
            _ => self.firmware.ros_baud,
        }
    }

    fn adapter(&self, link: usize) -> Adapter {
        match link {
            0 => self.firmware.adapter,
            _ => self.firmware.ros_adapter,
        }
    }
}
