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

    /// The settings of this type; `None` if no device has such.
    #[must_use]
    pub fn of<T: DeviceSettings>(&self) -> Option<&T> {
        self.devices.iter().find_map(|own| own.get())
    }

    /// The settings of this type; `None` if no device has such.
    pub fn of_mut<T: DeviceSettings>(&mut self) -> Option<&mut T> {
        self.devices.iter_mut().find_map(|own| own.get_mut())
    }
}

impl Settings for SimSettings {
    fn list(&self, prefix: &str, entries: &mut Vec<Entry>) {
        self.world.list(&join(prefix, "world"), entries);
        for (device, own) in self.table.iter().zip(&self.devices) {
            own.list(&join(prefix, device.id), entries);
        }
    }

    fn assign(&mut self, key: &str, value: &Value) -> Result<(), Problem> {
        let (group, rest) = match key.split_once('.') {
            Some((group, rest)) => (group, Some(rest)),
            None => (key, None),
        };
        let own: &mut dyn Settings = if group == "world" {
            &mut self.world
        } else {
            let at = self.table.iter().position(|device| device.id == group);
            let own = at.and_then(|at| self.devices.get_mut(at));
            own.ok_or(Problem::UnknownKey)?.as_mut()
        };
        own.assign(rest.ok_or(Problem::IsGroup)?, value)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_default_is_allowed_and_every_key_is_there_once() {
        let mut seen = BTreeSet::new();
        let mut tree = SimSettings::new(crate::SHIPPED);
        let text = rigsim_settings::show_toml(&tree);
        rigsim_settings::load_toml(&text, "defaults", &mut tree).unwrap();
        assert_eq!(tree, SimSettings::new(crate::SHIPPED));
        for entry in tree.entries() {
            assert!(seen.insert(entry.key.clone()), "{} twice", entry.key);
            assert!(!entry.basis.source().is_empty());
        }
        assert!(seen.contains("r150.heartbeat_timeout"));
        assert!(seen.contains("r150.battery.initial_soc"));
    }

    /// The page that sets documented and assumed behaviour side by side names every setting of the
    /// R150, by itself or with its group, and none that does not exist.
    #[test]
    fn the_r150_s_page_names_every_setting_and_no_other() {
        let page = include_str!("../docs/r150.md");
        let words: BTreeSet<&str> = page.split('`').skip(1).step_by(2).collect();
        let entries = SimSettings::new(crate::SHIPPED).entries();
        let keys: BTreeSet<String> = entries.into_iter().map(|entry| entry.key).collect();
        for key in keys.iter().filter(|key| key.starts_with("r150.")) {
            let (group, last) = key.rsplit_once('.').unwrap();
            let ways = [key.clone(), format!(".{last}"), format!("{group}.*")];
            let named = ways.iter().any(|way| words.contains(way.as_str()));
            assert!(named, "docs/r150.md does not name `{key}`");
        }
        for word in words.iter().filter(|word| word.starts_with("r150.")) {
            let known = match word.strip_suffix('*') {
                Some(group) => keys.iter().any(|key| key.starts_with(group)),
                None => keys.contains(*word),
            };
            assert!(known, "docs/r150.md names `{word}`, which is no setting");
        }
    }

    #[test]
    fn the_settings_to_compare_first_are_there_and_few_enough_to_read() {
        let entries = SimSettings::new(crate::SHIPPED).entries();
        let keys: BTreeSet<String> = entries.into_iter().map(|entry| entry.key).collect();
        for device in crate::SHIPPED {
            assert_eq!(device.compare_first.len(), 20, "{}", device.id);
            for key in device.compare_first {
                let key = format!("{}.{key}", device.id);
                assert!(keys.contains(&key), "`{key}`");
            }
        }
    }
}
