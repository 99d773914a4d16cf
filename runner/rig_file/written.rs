//! A rig file from a plan, for recordings of devices that were only served.

use std::collections::BTreeMap;
use std::fmt::Write as _;

use rigsim_physics::Pose;
use rigsim_settings::Settings;

use super::{DevicePlan, RigPlan};

impl RigPlan {
    /// A rig file that says the same, read with the settings of this plan as a base; but for the world
    /// file, the seed, and where ports are.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let usual = values(&self.settings);
        let mut text = "schema = 1\n".to_owned();
        for device in &self.devices {
            // Writing to a string cannot fail.
            let _ = device.write(&usual, &mut text);
        }
        text
    }
}

impl DevicePlan {
    fn write(&self, usual: &BTreeMap<String, String>, text: &mut String) -> std::fmt::Result {
        let (kind, Pose { x, y, heading }) = (self.device.id, self.pose);
        let heading = degrees(heading);
        writeln!(
            text,
            "\n[[device]]\nkind = \"{kind}\"\nname = \"{}\"",
            self.name
        )?;
        writeln!(
            text,
            "pose = {{ x = \"{x} m\", y = \"{y} m\", heading = \"{heading} deg\" }}"
        )?;
        if let Some(start) = self.start_word() {
            writeln!(text, "start = \"{start}\"")?;
        }
        let links = self.device.links.iter().take(self.ports.len());
        for link in links.filter(|link| link.optional.is_some()) {
            writeln!(text, "{} = true", link.id)?;
        }
        for (key, value) in values(&self.settings) {
            let own = key.split_once('.').filter(|(group, _)| *group == kind);
            if let Some((_, rest)) = own.filter(|_| usual.get(&key) != Some(&value)) {
                writeln!(text, "settings.{rest} = {value}")?;
            }
        }
        Ok(())
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

/// Every setting with its value as TOML.
fn values(settings: &dyn Settings) -> BTreeMap<String, String> {
    let entries = settings.entries().into_iter();
    entries.map(|entry| (entry.key, entry.value)).collect()
}

#[cfg(test)]
mod tests;
