//! The form of a rig file. The comments are the descriptions in its JSON Schema.

use std::ops::Range;
use std::path::PathBuf;

use rigsim_core::device::{DeviceSpec, Devices};
use rigsim_core::settings::SimSettings;
use rigsim_physics::Pose;
use rigsim_settings::{Angle, Length, ReadError, nearest, or_allowed, read};
use schemars::{JsonSchema, SchemaGenerator};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::MOST_DEVICES;
use crate::forgiving::{self, LeftOut};
use crate::problems::Problems;
use crate::schema;

// Tables of settings are read a second time, with the places of their keys.

/// Devices for `sim --rig`, in one world. Paths are relative to this file; quantities are text with
/// a unit, as in "50 mm".
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "sim rig file", extend("required" = ["schema", "device"]))]
pub(crate) struct RigText {
    /// Version of the format.
    #[schemars(with = "u32", extend("minimum" = 1, "maximum" = 1))]
    pub(crate) schema: Spanned<u32>,
    /// The world file; default an empty field.
    pub(crate) world: Option<PathBuf>,
    /// Seed of all random numbers; default a random one, which is printed.
    pub(crate) seed: Option<u64>,
    /// Settings of all devices and of the world; `sim config` lists them.
    #[serde(default, rename = "settings")]
    #[schemars(with = "SettingsText")]
    pub(crate) _settings: toml::Table,
    /// The devices.
    #[serde(default)]
    #[schemars(with = "Vec<DeviceText>", extend("minItems" = 1, "maxItems" = MOST_DEVICES))]
    pub(crate) device: Vec<Spanned<toml::Table>>,
}

/// A device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct DeviceText {
    /// Kind of the device.
    #[schemars(with = "String")]
    kind: Spanned<String>,
    /// Unique name of letters, digits, - and _; default the kind, numbered if there are several.
    #[schemars(with = "Option<String>", extend("pattern" = "^[A-Za-z0-9_-]{1,64}$"))]
    pub(super) name: Option<Spanned<String>>,
    /// Place and heading at the start; default the origin, facing along x.
    #[serde(default)]
    pub(super) pose: PoseText,
    /// Path of the pseudo-terminal of its main link, or a URL to listen at: rfc2217://HOST:PORT or
    /// tcp://HOST:PORT; default a pseudo-terminal with only the system's name.
    #[schemars(with = "Option<PathBuf>")]
    port: Option<Spanned<PathBuf>>,
    /// Settings of this device, without its kind in front: `heartbeat_timeout = "5s"`.
    #[serde(default, rename = "settings")]
    #[schemars(schema_with = "any_table")]
    _settings: toml::Table,
}

/// Table of a device, with what only devices like it have.
pub(super) struct OwnText {
    pub(super) common: DeviceText,
    pub(super) device: &'static DeviceSpec,
    pub(super) start: usize,
    pub(super) ports: Vec<Option<PathBuf>>,
    /// Those that are given.
    pub(super) paths: Vec<Spanned<PathBuf>>,
}

impl OwnText {
    /// Reads a device's table and reports what is wrong with it; `None` if its kind is not known.
    pub(super) fn read(
        problems: &mut Problems<'_>,
        devices: Devices,
        mut table: DeTable<'_>,
        span: Range<usize>,
    ) -> Option<Self> {
        let own = own_keys(devices).into_iter();
        let own: Vec<_> = own
            .filter_map(|key| Some((table.remove(key.as_str())?, key)))
            .collect();
        let mut rest = Spanned::new(span, DeValue::Table(table));
        let left_out = &mut LeftOut::default();
        let common: DeviceText = forgiving::read(&mut rest, left_out, problems, &read)?;
        let kind = common.kind.get_ref();
        let known = |kind: &str| devices.iter().find(|device| device.id == kind);
        let device = known(kind).or_else(|| {
            let all: Vec<&str> = devices.iter().map(|device| device.id).collect();
            let why = format!("no device is a `{kind}`; {}", or_allowed(kind, &all));
            problems.add(common.kind.span(), &why);
            // The rest is looked at as if it were what it is most like.
            nearest(kind, all).and_then(known)
        });
        let device = *device?;
        let mut text = Self {
            start: 0,
            ports: vec![common.port.as_ref().map(|path| path.get_ref().clone())],
            paths: common.port.iter().cloned().collect(),
            device,
            common,
        };
        for (value, key) in own {
            match text.own_key(&value, &key) {
                Ok(()) => {}
                Err(Some(error)) => {
                    problems.read::<()>(value.span(), Err(error));
                    // It may have been a link, which nothing else is to miss then.
                    text.ports.resize(device.links.len(), None);
                }
                Err(None) => {
                    let able = devices.iter().filter(|device| has_key(device, &key));
                    let able: Vec<&str> = able.map(|device| device.title).collect();
                    let why = format!("only {} has one", able.join(" or "));
                    problems.add(value.span(), &why);
                }
            }
        }
        Some(text)
    }

    /// Takes what only some devices have; fails without an error if this one has it not.
    fn own_key(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
    ) -> Result<(), Option<ReadError>> {
        if !has_key(self.device, key) {
            return Err(None);
        }
        if key == "start" {
            let word: Spanned<String> = read(value)?;
            let starts = self.device.starts;
            let known = starts.iter().position(|start| start.id == *word.get_ref());
            self.start = known.ok_or_else(|| {
                let all: Vec<&str> = starts.iter().map(|start| start.id).collect();
                let allowed = or_allowed(word.get_ref(), &all);
                <ReadError as serde::de::Error>::custom(format!(
                    "no state `{}`; {allowed}",
                    word.get_ref()
                ))
            })?;
            return Ok(());
        }
        let (id, path) = match key.strip_suffix("_port") {
            Some(id) => (id, Some(read::<Spanned<PathBuf>>(value)?)),
            None if read::<bool>(value)? => (key, None),
            None => return Ok(()),
        };
        let index = self.device.link(id).unwrap_or(0);
        if self.ports.len() <= index {
            self.ports.resize(index + 1, None);
        }
        if let Some(path) = path {
            self.ports[index] = Some(path.get_ref().clone());
            self.paths.push(path);
        }
        Ok(())
    }
}

/// The keys that only some devices have.
fn own_keys(devices: Devices) -> Vec<String> {
    let mut keys = vec!["start".to_owned()];
    let links = devices.iter().flat_map(|device| device.links);
    for link in links.filter(|link| link.optional.is_some()) {
        keys.extend([link.id.to_owned(), format!("{}_port", link.id)]);
    }
    keys
}

fn has_key(device: &DeviceSpec, key: &str) -> bool {
    let id = key.strip_suffix("_port").unwrap_or(key);
    let mut links = device.links.iter();
    (key == "start" && !device.starts.is_empty())
        || links.any(|link| link.optional.is_some() && link.id == id)
}

/// The schema of a device's table.
pub(crate) fn device_schema(devices: Devices, generator: &mut SchemaGenerator) -> Value {
    let mut table = DeviceText::json_schema(generator).to_value();
    let kinds = devices.iter().map(|device| (device.id, device.about));
    table["properties"]["kind"] = schema::words(kinds);
    let mut more = Map::new();
    for device in devices.iter().filter(|device| !device.starts.is_empty()) {
        let starts = device.starts.iter().map(|start| (start.id, start.about));
        let mut words = schema::words(starts);
        let usual = device.starts[0].id;
        words["description"] =
            format!("State in which {} starts; default {usual}.", device.title).into();
        more.insert("start".to_owned(), words);
    }
    for device in devices {
        for link in device.links {
            let Some(costs) = link.optional else { continue };
            let (title, name) = (device.title, link.name);
            let about = format!("Whether {title} has a {name} link; {costs}.");
            more.insert(
                link.id.to_owned(),
                json!({ "type": "boolean", "description": about }),
            );
            let about = format!(
                "Path of the pseudo-terminal of the {name} link of {title}, which is there then."
            );
            let path = json!({ "type": "string", "description": about });
            more.insert(format!("{}_port", link.id), path);
        }
    }
    schema::add_properties(&mut table, more);
    let own = devices.iter().map(|device| {
        let settings = (device.settings)();
        rigsim_settings::schema_of(&*settings).to_value()
    });
    table["properties"]["settings"]["anyOf"] = own.collect();
    table
}

/// The schema of the names of links.
pub(crate) fn link_schema(devices: Devices) -> Value {
    let links = devices.iter().flat_map(|device| device.links);
    let mut names: Vec<&str> = links.map(|link| link.id).collect();
    names.sort_unstable();
    names.dedup();
    json!({ "description": "A serial link of a device.", "type": "string", "enum": names })
}

/// The schema of all settings.
pub(crate) fn settings_schema(devices: Devices) -> Value {
    rigsim_settings::schema_of(&SimSettings::new(devices)).to_value()
}

/// Settings of all devices and of the world.
#[derive(JsonSchema)]
pub(crate) struct SettingsText {}

pub(crate) fn any_table(_: &mut schemars::SchemaGenerator) -> schemars::Schema {
    schemars::json_schema!({"type": "object"})
}

/// A place and a direction in the world; what is not given is 0.
#[derive(Debug, Clone, Copy, Default, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields, default)]
pub(crate) struct PoseText {
    /// East.
    x: Option<Length>,
    /// North.
    y: Option<Length>,
    /// Counter-clockwise from x.
    heading: Option<Angle>,
}

impl From<PoseText> for Pose {
    fn from(text: PoseText) -> Self {
        Self {
            x: text.x.map_or(0.0, |x| x.0),
            y: text.y.map_or(0.0, |y| y.0),
            heading: text.heading.map_or(0.0, |heading| heading.0.to_radians()),
        }
    }
}
