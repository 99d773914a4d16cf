//! Settings of an R150: of its firmware, and of the hardware around it.

use rigsim_physics::r150::R150PlantSettings;

use crate::device::DeviceSettings;
use crate::r150_device::settings::R150FirmwareSettings;
use crate::uart::Adapter;

crate::device_settings! {
    /// The XAG R150.
    pub struct R150Settings { R150FirmwareSettings, R150PlantSettings }
}

impl DeviceSettings for R150Settings {
    fn baud(&self, _link: usize) -> u32 {
        self.firmware.baud
    }

    fn adapter(&self, _link: usize) -> Adapter {
        self.firmware.adapter
    }
}
