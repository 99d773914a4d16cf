//! Every setting of a run, in one tree.

use sim_physics::WorldSettings;
use sim_physics::mecanum::MecanumPlantSettings;
use sim_physics::r150::R150PlantSettings;
use sim_settings::{Entry, Problem, Settings, Value, settings};

use crate::mecanum_device::settings::MecanumFirmwareSettings;
use crate::r150_device::settings::R150FirmwareSettings;

settings! {
    /// Every setting of a run.
    pub struct SimSettings {}
    groups {
        /// The plane that all vehicles share.
        world: WorldSettings,
        /// The XAG R150.
        r150: R150Settings,
        /// The mecanum car.
        mecanum: MecanumSettings,
    }
}

/// Joins a firmware's and a plant's settings under one name.
macro_rules! device_settings {
    ($( $(#[$meta:meta])* $name:ident { $firmware:ty, $plant:ty } )*) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, PartialEq, Default)]
        pub struct $name {
            /// The firmware.
            pub firmware: $firmware,
            /// The hardware around it.
            pub plant: $plant,
        }

        impl Settings for $name {
            fn visit(&self, prefix: &str, visit: &mut dyn FnMut(Entry)) {
                self.firmware.visit(prefix, visit);
                self.plant.visit(prefix, visit);
            }

            fn assign(&mut self, path: &str, value: &Value) -> Result<(), Problem> {
                match self.firmware.assign(path, value) {
                    Err(Problem::UnknownKey) => self.plant.assign(path, value),
                    outcome => outcome,
                }
            }
        }
    )* };
}

device_settings! {
    /// The R150.
    R150Settings { R150FirmwareSettings, R150PlantSettings }
    /// The mecanum car.
    MecanumSettings { MecanumFirmwareSettings, MecanumPlantSettings }
}

impl SimSettings {
    /// Checks what no setting can say alone.
    ///
    /// # Errors
    /// A sentence for each pair of settings that do not fit together, naming both.
    pub fn check(&self) -> Result<(), Vec<String>> {
        let protection = &self.r150.firmware.protection;
        let pwm = &self.r150.plant.pwm;
        let car = &self.mecanum.firmware;
        let pairs = [
            (
                "r150.protection.over_temperature_clear",
                protection.over_temperature_clear,
                "r150.protection.over_temperature",
                protection.over_temperature,
            ),
            (
                "r150.protection.undervoltage",
                protection.undervoltage,
                "r150.protection.undervoltage_clear",
                protection.undervoltage_clear,
            ),
            (
                "r150.pwm.input_frequency_min",
                pwm.input_frequency_min,
                "r150.pwm.input_frequency_max",
                pwm.input_frequency_max,
            ),
            (
                "mecanum.ultrasonic_nearest",
                car.ultrasonic_nearest,
                "mecanum.ultrasonic_farthest",
                car.ultrasonic_farthest,
            ),
        ];
        let wrong: Vec<String> = pairs
            .into_iter()
            .filter(|(_, low, _, high)| low > high)
            .map(|(low_key, low, high_key, high)| {
                format!("`{low_key}` ({low}) must not be above `{high_key}` ({high})")
            })
            .collect();
        if wrong.is_empty() { Ok(()) } else { Err(wrong) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::BTreeSet;

    #[test]
    fn every_default_is_allowed_and_every_key_is_there_once() {
        let mut seen = BTreeSet::new();
        let mut tree = SimSettings::default();
        let text = sim_settings::show_toml(&tree);
        sim_settings::load_toml(&text, "defaults", &mut tree).unwrap();
        assert_eq!(tree, SimSettings::default());
        Settings::visit(&tree, "", &mut |entry| {
            assert!(seen.insert(entry.key.clone()), "{} twice", entry.key);
            assert!(!entry.basis.source().is_empty());
        });
        assert!(seen.contains("r150.heartbeat_timeout"));
        assert!(seen.contains("r150.battery.initial_soc"));
        assert_eq!(tree.check(), Ok(()));
    }

    /// The page that sets documented and assumed behaviour side by side names every setting of the
    /// R150, by itself or with its group, and none that does not exist.
    #[test]
    fn the_r150_s_page_names_every_setting_and_no_other() {
        let page = include_str!("../docs/r150.md");
        let words: BTreeSet<&str> = page.split('`').skip(1).step_by(2).collect();
        let mut keys = BTreeSet::new();
        SimSettings::default().visit("", &mut |entry| {
            keys.insert(entry.key);
        });
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
    fn thresholds_in_the_wrong_order_are_refused_by_name() {
        let mut tree = SimSettings::default();
        tree.r150.firmware.protection.undervoltage_clear = 0.0;
        let wrong = tree.check().unwrap_err();
        assert_eq!(
            wrong,
            ["`r150.protection.undervoltage` (39) must not be above \
              `r150.protection.undervoltage_clear` (0)"]
        );
    }
}
