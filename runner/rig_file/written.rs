//! A rig file from a plan, for recordings of devices that were only served.

use std::collections::BTreeMap;

use rigsim_settings::Settings;
use toml::{Table, Value};

use super::{DevicePlan, RigPlan};

impl RigPlan {
    /// A rig file that says the same, read with the settings of this plan as a base; but for the world
    /// file, the seed, and where ports are.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let usual = values(&self.settings);
        let devices = self
            .devices
            .iter()
            .map(|device| device.table(&usual).into());
        let keys = [
            ("schema", Value::from(1)),
            ("device", Value::Array(devices.collect())),
        ];
        table(keys).to_string()
    }
}

impl DevicePlan {
    fn table(&self, usual: &BTreeMap<String, String>) -> Table {
        let quantity = |number: f64, unit: &str| Value::from(format!("{number} {unit}"));
        let pose = [
            ("x", quantity(self.pose.x, "m")),
            ("y", quantity(self.pose.y, "m")),
            ("heading", quantity(degrees(self.pose.heading), "deg")),
        ];
        let mut keys = table([
            ("kind", self.device.id.into()),
            ("name", self.name.clone().into()),
            ("pose", table(pose).into()),
        ]);
        if let Some(start) = self.start_word() {
            keys.insert("start".to_owned(), start.into());
        }
        let links = self.device.links.iter().take(self.ports.len());
        for link in links.filter(|link| link.optional.is_some()) {
            keys.insert(link.id.to_owned(), true.into());
        }
        let mut settings = Table::new();
        for (key, value) in values(&self.settings) {
            if let Some((kind, rest)) = key.split_once('.')
                && kind == self.device.id
                && usual.get(&key) != Some(&value)
            {
                insert(&mut settings, rest, &value);
            }
        }
        if !settings.is_empty() {
            keys.insert("settings".to_owned(), settings.into());
        }
        keys
    }
}

/// The degrees that are read as these radians to the last bit, which are rounded on their way.
fn degrees(radians: f64) -> f64 {
    let near = radians.to_degrees();
    let up = std::iter::successors(Some(near), |degrees| Some(degrees.next_up()));
    let down = std::iter::successors(Some(near), |degrees| Some(degrees.next_down()));
    let mut near_by = up.zip(down).take(4).flat_map(|(up, down)| [up, down]);
    near_by
        .find(|degrees| degrees.to_radians() == radians)
        .unwrap_or(near)
}

fn table<const N: usize>(keys: [(&str, Value); N]) -> Table {
    Table::from_iter(keys.map(|(key, value)| (key.to_owned(), value)))
}

/// Every setting with its value as TOML.
fn values(settings: &dyn Settings) -> BTreeMap<String, String> {
    let entries = settings.entries().into_iter();
    entries.map(|entry| (entry.key, entry.value)).collect()
}

/// Puts a value into the tables that its key names.
fn insert(settings: &mut Table, key: &str, value: &str) {
    if let Some((group, rest)) = key.split_once('.') {
        let inner = settings.entry(group).or_insert_with(|| Table::new().into());
        if let Value::Table(inner) = inner {
            insert(inner, rest, value);
        }
    } else if let Some(value) = toml::from_str::<Table>(&format!("value = {value}"))
        .ok()
        .and_then(|mut table| table.remove("value"))
    {
        settings.insert(key.to_owned(), value);
    }
}

#[cfg(test)]
mod tests;
