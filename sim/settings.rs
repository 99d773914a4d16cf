//! Every setting of a run, in one tree.

use rigsim_physics::WorldSettings;
use rigsim_settings::{Entry, Problem, Settings, Value, join};

use crate::device::{DeviceSettings, DeviceSpec, Devices};

/// Every setting of a run: those of the plane that all vehicles share, and those of each device that
/// there is, under its id.
#[derive(Debug, Clone, PartialEq)]
pub struct SimSettings {
    /// The plane that all vehicles share.
    pub world: WorldSettings,
    table: Devices,
    /// As the table has the devices.
    devices: Vec<Box<dyn DeviceSettings>>,
}

impl SimSettings {
    /// Every setting as it is by default, with these devices.
    #[must_use]
    pub fn new(devices: Devices) -> Self {
        Self {
            world: WorldSettings::default(),
            table: devices,
            devices: devices.iter().map(|device| (device.settings)()).collect(),
        }
    }

    /// The devices that there are.
    #[must_use]
    pub fn table(&self) -> Devices {
        self.table
    }

    /// The settings of a device; `None` if there is no such device.
    #[must_use]
    pub fn of_device(&self, device: &DeviceSpec) -> Option<&dyn DeviceSettings> {
        let at = self.table.iter().position(|known| *known == device)?;
        self.devices.get(at).map(Box::as_ref)
    }
}

impl Settings for SimSettings {
    fn list(&self, prefix: &str, entries: &mut Vec<Entry>) {
        self.world.list(&join(prefix, "world"), entries);
        for (device, settings) in self.table.iter().zip(&self.devices) {
            settings.list(&join(prefix, device.id), entries);
        }
    }

    fn assign(&mut self, key: &str, value: &Value) -> Result<(), Problem> {
        let (group, rest) = match key.split_once('.') {
            Some((group, rest)) => (group, Some(rest)),
            None => (key, None),
        };
        let part: &mut dyn Settings = if group == "world" {
            &mut self.world
        } else {
            let at = self.table.iter().position(|device| device.id == group);
            let part = at.and_then(|at| self.devices.get_mut(at));
            part.ok_or(Problem::UnknownKey)?.as_mut()
        };
        part.assign(rest.ok_or(Problem::IsGroup)?, value)
    }
}

#[cfg(test)]
mod tests;
