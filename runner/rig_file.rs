//! Rig files: any number of devices in one world, each with its ports, settings and start.
//!
//! ```toml
//! schema = 1
//! world = "yard.toml"             # beside this file
//!
//! [[device]]
//! kind = "r150"
//! port = "/tmp/r150"
//! pose = { x = "1 m", y = "0 m", heading = "90 deg" }
//! settings = { heartbeat_timeout = "5s" }
//!
//! [[device]]
//! kind = "mecanum"
//! port = "/tmp/car"
//! ros_port = "/tmp/car-ros"
//! ```

mod form;
mod written;

use std::collections::BTreeSet;
use std::path::PathBuf;

use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::settings::SimSettings;
use rigsim_physics::Pose;
use rigsim_settings::{Source, apply_table};
use toml::de::DeTable;

pub(crate) use form::{
    DeviceText, RigText, SettingsText, device_schema, link_schema, settings_schema,
};

use crate::error::{FileError, FileErrors};
use crate::forgiving::{self, LeftOut};
use crate::problems::Problems;
use crate::schema;
use crate::sources::{Sources, element, table};
use form::OwnText;

/// Most devices of a rig.
pub const MOST_DEVICES: usize = 1000;

/// One device of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct DevicePlan {
    /// Unique in the rig.
    pub name: String,
    /// Row of its device.
    pub device: &'static DeviceSpec,
    /// Index of the state in which it starts, among those that it can start in.
    pub start: usize,
    /// Place and heading at the start.
    pub pose: Pose,
    /// The tree of settings as it holds for this device.
    pub settings: SimSettings,
    /// Paths of the ports of the links that are there; a port without one has no name but the
    /// system's.
    pub ports: Vec<Option<PathBuf>>,
}

/// Contents of a rig file.
#[derive(Debug, Clone, PartialEq)]
pub struct RigPlan {
    /// The world file, relative to the rig file.
    pub world: Option<PathBuf>,
    /// Seed of everything random.
    pub seed: Option<u64>,
    /// Settings that belong to no device.
    pub settings: SimSettings,
    /// The devices in the order of the file.
    pub devices: Vec<DevicePlan>,
}

impl RigPlan {
    /// Names and kinds of its devices.
    pub(crate) fn kinds(&self) -> Vec<(&str, &'static DeviceSpec)> {
        let devices = self.devices.iter();
        devices
            .map(|plan| (plan.name.as_str(), plan.device))
            .collect()
    }

    /// The JSON Schema of rig files with these devices.
    #[must_use]
    pub fn json_schema(devices: Devices) -> String {
        schema::compose::<RigText>(devices, |devices, generator| {
            vec![
                ("DeviceText", device_schema(devices, generator)),
                ("SettingsText", settings_schema(devices)),
            ]
        })
    }

    /// Reads a rig file; its settings change those of `base`.
    ///
    /// # Errors
    /// Names the file, the line, and what is allowed.
    pub fn parse(source: Source<'_>, base: &SimSettings) -> Result<Self, FileErrors> {
        let sources = Sources(&[source]);
        let mut problems = Problems::new(sources);
        let mut tables = sources.tables(0)?;
        if tables.contains_key("good_client") || tables.contains_key("title") {
            let why = "is a scenario file, not a rig file: `sim run` plays it";
            return Err(FileError::general(format!("{} {why}", source.file)).into());
        }
        let file = forgiving::read_table(&mut tables, &mut LeftOut::default(), &mut problems);
        let plan = file.and_then(|file| Self::check(&mut problems, &tables, base, file));
        problems.into_result()?;
        plan.ok_or_else(|| FileError::general(format!("{} is not a rig file", source.file)).into())
    }

    /// Reads a file that has these tables, and perhaps others. There is no plan if the kind of a device
    /// is not known.
    pub(crate) fn check(
        problems: &mut Problems<'_>,
        tables: &DeTable<'_>,
        base: &SimSettings,
        file: RigText,
    ) -> Option<Self> {
        if *file.schema.get_ref() != 1 {
            problems.add(file.schema.span(), "only schema 1 is known");
        }
        if file.device.is_empty() || file.device.len() > MOST_DEVICES {
            let why = format!("a rig has 1 to {MOST_DEVICES} [[device]] tables");
            problems.add_to_file(&why);
            return None;
        }
        let mut settings = base.clone();
        if let Some(table) = table(tables, "settings") {
            apply(problems, table, "", &mut settings);
        }
        let mut texts = Vec::new();
        for (index, device) in file.device.iter().enumerate() {
            let own = element(tables, "device", index)
                .cloned()
                .unwrap_or_default();
            texts.extend(OwnText::read(problems, base.table(), own, device.span()));
        }
        if texts.len() < file.device.len() {
            return None;
        }
        let mut names = BTreeSet::new();
        let mut paths = BTreeSet::new();
        let mut devices = Vec::new();
        for (index, text) in texts.iter().enumerate() {
            let OwnText { common, device, .. } = text;
            let (name, name_at) = match &common.name {
                Some(name) => (name.get_ref().clone(), name.span()),
                None => (default_name(&texts, index), file.device[index].span()),
            };
            if !is_name(&name) {
                let why = format!("\"{name}\" may have letters, digits, - and _ only");
                problems.add(name_at.clone(), &why);
            }
            if !names.insert(name.clone()) {
                let why = format!("two devices are named \"{name}\"");
                problems.add(name_at, &why);
            }
            for path in &text.paths {
                if !paths.insert(path.get_ref().clone()) {
                    let why = format!("two ports have the path {}", path.get_ref().display());
                    problems.add(path.span(), &why);
                }
            }
            let mut own = settings.clone();
            let own_table = element(tables, "device", index);
            if let Some(table) = own_table.and_then(|own| table(own, "settings")) {
                apply(problems, table, device.id, &mut own);
            }
            devices.push(DevicePlan {
                name,
                device,
                start: text.start,
                pose: common.pose.into(),
                settings: own,
                ports: text.ports.clone(),
            });
        }
        Some(Self {
            world: file.world,
            seed: file.seed,
            settings,
            devices,
        })
    }
}

/// Applies a table of settings, and reports what is wrong with it.
fn apply(
    problems: &mut Problems<'_>,
    table: &DeTable<'_>,
    prefix: &str,
    settings: &mut SimSettings,
) {
    let errors = apply_table(&|at| problems.origin(at), table, prefix, settings);
    problems.add_settings(errors);
}

/// The device's id, with a number if there are several of it.
fn default_name(texts: &[OwnText], index: usize) -> String {
    let device = texts[index].device;
    let same = |texts: &[OwnText]| texts.iter().filter(|text| text.device == device).count();
    if same(texts) == 1 {
        device.id.to_owned()
    } else {
        format!("{}-{}", device.id, same(&texts[..=index]))
    }
}

fn is_name(name: &str) -> bool {
    let allowed = |c: char| c.is_ascii_alphanumeric() || c == '-' || c == '_';
    !name.is_empty() && name.len() <= 64 && name.chars().all(allowed)
}

#[cfg(test)]
mod tests;
