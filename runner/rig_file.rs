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

mod written;

use std::collections::BTreeSet;
use std::fmt;
use std::ops::Range;
use std::path::PathBuf;

use schemars::{JsonSchema, SchemaGenerator};
use serde::Deserialize;
use serde_json::{Map, Value, json};
use sim_core::device::{DeviceSpec, Devices};
use sim_core::settings::SimSettings;
use sim_physics::Pose;
use sim_settings::{Angle, Length, SettingsError, Source, apply_table};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::schema;
use crate::sources::Sources;
use crate::suggest::or_allowed;
use crate::tables::{self, Tables};

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
    /// Settings that are no device's own.
    pub settings: SimSettings,
    /// The devices in the order of the file.
    pub devices: Vec<DevicePlan>,
}

/// Errors of a rig file; each line names the file, the line, and what to do.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct RigFileError(pub Vec<String>);

impl fmt::Display for RigFileError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0.join("\n"))
    }
}

impl From<Vec<SettingsError>> for RigFileError {
    fn from(errors: Vec<SettingsError>) -> Self {
        Self(errors.iter().map(ToString::to_string).collect())
    }
}

impl RigPlan {
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
    pub fn parse(source: Source<'_>, base: &SimSettings) -> Result<Self, RigFileError> {
        let file: RigText = toml::from_str(source.text)
            .map_err(|error| RigFileError::from(vec![source.syntax(&error)]))?;
        let sources = Sources(&[source]);
        let tables = sources.tables(0).map_err(|line| RigFileError(vec![line]))?;
        let (plan, wrong) = Self::check(sources, &Tables(tables), base, file);
        match plan {
            Some(plan) if wrong.is_empty() => Ok(plan),
            _ => Err(RigFileError(wrong)),
        }
    }

    /// Reads a file that has these tables, and perhaps others; and lists what is wrong with
    /// it. There is no plan without every device.
    pub(crate) fn check(
        sources: Sources<'_>,
        tables: &Tables<'_>,
        base: &SimSettings,
        file: RigText,
    ) -> (Option<Self>, Vec<String>) {
        let mut wrong = Vec::new();
        if *file.schema.get_ref() != 1 {
            wrong.push(sources.wrong(file.schema.span().start, "only schema 1 is known"));
        }
        if file.device.is_empty() || file.device.len() > MOST_DEVICES {
            let why = format!("a rig has 1 to {MOST_DEVICES} [[device]] tables");
            let place = sources.place(0);
            wrong.push(format!("{place}: {why}"));
            return (None, wrong);
        }
        let mut settings = base.clone();
        if let Some(table) = tables.table("settings") {
            wrong.extend(applied(sources, table, "", &mut settings));
        }
        let mut texts = Vec::new();
        for (index, device) in file.device.iter().enumerate() {
            let own = tables.of("device", index).cloned().unwrap_or_default();
            match OwnText::read(sources, base.table(), own, device.span()) {
                Ok(text) => texts.push(text),
                Err(line) => wrong.push(line),
            }
        }
        if texts.len() < file.device.len() {
            return (None, wrong);
        }
        let mut names = BTreeSet::new();
        let mut paths = BTreeSet::new();
        let mut devices = Vec::new();
        for (index, text) in texts.iter().enumerate() {
            let OwnText { common, device, .. } = text;
            let (name, name_at) = match &common.name {
                Some(name) => (name.get_ref().clone(), name.span().start),
                None => (default_name(&texts, index), file.device[index].span().start),
            };
            if !is_name(&name) {
                let why = format!("\"{name}\" may have letters, digits, - and _ only");
                wrong.push(sources.wrong(name_at, &why));
            }
            if !names.insert(name.clone()) {
                let why = format!("two devices are named \"{name}\"");
                wrong.push(sources.wrong(name_at, &why));
            }
            for path in &text.paths {
                if !paths.insert(path.get_ref().clone()) {
                    let why = format!("two ports have the path {}", path.get_ref().display());
                    wrong.push(sources.wrong(path.span().start, &why));
                }
            }
            let mut own = settings.clone();
            let table = tables.of("device", index);
            if let Some(table) = table.and_then(|own| tables::table(own, "settings")) {
                wrong.extend(applied(sources, table, device.id, &mut own));
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
        let plan = Self {
            world: file.world,
            seed: file.seed,
            settings,
            devices,
        };
        (Some(plan), wrong)
    }
}

/// Applies a table of settings, and says what is wrong with it.
fn applied(
    sources: Sources<'_>,
    table: &DeTable<'_>,
    prefix: &str,
    settings: &mut SimSettings,
) -> Vec<String> {
    let place = |at| sources.place(at);
    let wrong = apply_table(&place, table, prefix, settings);
    let wrong = wrong.err().unwrap_or_default();
    wrong.iter().map(ToString::to_string).collect()
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

// The comments are the descriptions in the JSON Schema. Tables of settings are read a second time,
// with the places of their keys.

/// Devices for `sim --rig`, in one world. Paths are relative to this file; quantities are text with
/// a unit, as in "50 mm".
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "sim rig file", extend("required" = ["schema", "device"]))]
pub(crate) struct RigText {
    /// Version of the form of this file.
    #[schemars(with = "u32", extend("minimum" = 1, "maximum" = 1))]
    pub(crate) schema: Spanned<u32>,
    /// The world file; an empty field without one.
    pub(crate) world: Option<PathBuf>,
    /// Seed of everything random; a random one is chosen and printed if not given.
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
    /// Letters, digits, - and _; unique. The kind unless given, numbered if there are several.
    #[schemars(with = "Option<String>", extend("pattern" = "^[A-Za-z0-9_-]{1,64}$"))]
    name: Option<Spanned<String>>,
    /// Place and heading at the start; at the origin, looking along x, unless given.
    #[serde(default)]
    pose: PoseText,
    /// Path of the pseudo-terminal of its main link, or a URL to listen at: rfc2217://HOST:PORT or
    /// tcp://HOST:PORT. Without one it is a pseudo-terminal that has the system's name only.
    #[schemars(with = "Option<PathBuf>")]
    port: Option<Spanned<PathBuf>>,
    /// Settings of this device, without its kind in front: `heartbeat_timeout = "5s"`.
    #[serde(default, rename = "settings")]
    #[schemars(schema_with = "any_table")]
    _settings: toml::Table,
}

/// What a device's table says, with what only devices like it have.
struct OwnText {
    common: DeviceText,
    device: &'static DeviceSpec,
    start: usize,
    ports: Vec<Option<PathBuf>>,
    /// Those that are given.
    paths: Vec<Spanned<PathBuf>>,
}

impl OwnText {
    fn read(
        sources: Sources<'_>,
        devices: Devices,
        mut table: DeTable<'_>,
        span: Range<usize>,
    ) -> Result<Self, String> {
        let own = own_keys(devices).into_iter();
        let own: Vec<_> = own
            .filter_map(|key| Some((table.remove(key.as_str())?, key)))
            .collect();
        let rest = Spanned::new(span, DeValue::Table(table));
        let at = rest.span().start;
        let syntax = |error: &toml::de::Error| sources.syntax(at, error);
        let common: DeviceText = tables::read(&rest).map_err(|error| syntax(&error))?;
        let kind = common.kind.get_ref();
        let device = devices.iter().find(|device| device.id == *kind);
        let device = *device.ok_or_else(|| {
            let all: Vec<&str> = devices.iter().map(|device| device.id).collect();
            let why = format!("no device is a `{kind}`; {}", or_allowed(kind, &all));
            sources.wrong(common.kind.span().start, &why)
        })?;
        let mut text = Self {
            start: 0,
            ports: vec![common.port.as_ref().map(|path| path.get_ref().clone())],
            paths: common.port.iter().cloned().collect(),
            device,
            common,
        };
        for (value, key) in own {
            let at = value.span().start;
            text.own_key(&value, &key).map_err(|why| match why {
                Some(error) => syntax(&error),
                None => {
                    let able = devices.iter().filter(|device| has_key(device, &key));
                    let able: Vec<&str> = able.map(|device| device.title).collect();
                    let why = format!("only {} has one", able.join(" or "));
                    sources.wrong(at, &why)
                }
            })?;
        }
        Ok(text)
    }

    /// Takes what only some devices have; fails without an error if this one has it not.
    fn own_key(
        &mut self,
        value: &Spanned<DeValue<'_>>,
        key: &str,
    ) -> Result<(), Option<toml::de::Error>> {
        if !has_key(self.device, key) {
            return Err(None);
        }
        if key == "start" {
            let word: Spanned<String> = tables::read(value)?;
            let starts = self.device.starts;
            let known = starts.iter().position(|start| start.id == *word.get_ref());
            self.start = known.ok_or_else(|| {
                let all: Vec<&str> = starts.iter().map(|start| start.id).collect();
                let allowed = or_allowed(word.get_ref(), &all);
                <toml::de::Error as serde::de::Error>::custom(format!(
                    "no state `{}`; {allowed}",
                    word.get_ref()
                ))
            })?;
            return Ok(());
        }
        let (id, path) = match key.strip_suffix("_port") {
            Some(id) => (id, Some(tables::read::<Spanned<PathBuf>>(value)?)),
            None if tables::read::<bool>(value)? => (key, None),
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
        words["description"] = format!(
            "In which state {} begins; {usual} unless given.",
            device.title
        )
        .into();
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
        sim_settings::schema_of(&settings).to_value()
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
    sim_settings::schema_of(&SimSettings::new(devices)).to_value()
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

#[cfg(test)]
mod tests {
    use super::*;
    use sim_core::r150::R150Settings;

    fn parse(text: &str) -> Result<RigPlan, String> {
        let source = Source {
            file: "my-rig.toml",
            text,
        };
        RigPlan::parse(source, &SimSettings::new(sim_core::SHIPPED))
            .map_err(|error| error.to_string())
    }

    #[test]
    fn a_full_rig() {
        let plan = parse(
            "schema = 1\nworld = \"yard.toml\"\nseed = 7\n\
             [settings]\nworld.slope = \"3 deg\"\nr150.heartbeat_timeout = \"9s\"\n\
             [[device]]\nkind = \"r150\"\nport = \"/tmp/a\"\nstart = \"locked\"\n\
             pose = { x = \"1.5 m\", y = \"-20 cm\", heading = \"90 deg\" }\n\
             [device.settings]\nbattery.initial_soc = \"50 %\"\n\
             [[device]]\nkind = \"r150\"\nname = \"other\"\n",
        )
        .unwrap();
        assert_eq!(plan.seed, Some(7));
        assert_eq!(plan.world, Some(PathBuf::from("yard.toml")));
        let [first, second] = &plan.devices[..] else {
            panic!("{plan:?}")
        };
        assert_eq!(
            (first.name.as_str(), second.name.as_str()),
            ("r150-1", "other")
        );
        let r150 = |device: &DevicePlan| device.settings.of::<R150Settings>().unwrap().clone();
        assert_eq!(first.start, 1);
        assert_eq!((first.pose.x, first.pose.y), (1.5, -0.2));
        assert_eq!(first.pose.heading, std::f64::consts::FRAC_PI_2);
        assert_eq!(r150(first).plant.battery.initial_soc, 50.0);
        assert_eq!(r150(second).plant.battery.initial_soc, 80.0);
        assert_eq!(r150(second).firmware.heartbeat_timeout.as_secs(), 9);
        assert_eq!(plan.settings.world.slope, 3.0);
    }

    #[test]
    fn the_schema_is_the_published_one() {
        let schema = RigPlan::json_schema(sim_core::SHIPPED);
        assert!(
            schema == include_str!("../worlds/rig.schema.json"),
            "worlds/rig.schema.json is to read:\n{schema}"
        );
    }

    #[test]
    fn errors_name_file_line_and_key() {
        let one = "schema = 1\n[[device]]\nkind = \"r150\"\n";
        for (text, expected) in [
            (
                "schema = 2\n[[device]]\nkind = \"r150\"",
                "my-rig.toml:1:10: `schema`",
            ),
            ("schema = 1\n", "1 to 1000 [[device]]"),
            (
                "schema = 1\ndevices = 3\n",
                "my-rig.toml:2:1: `devices`: unknown field",
            ),
            (
                "schema = 1\n[[device]]\nkind = \"tank\"",
                "my-rig.toml:3:8: `device.kind`: ",
            ),
            (&format!("{one}color = \"red\""), "unknown field `color`"),
            (
                &format!("{one}pose = {{ x = \"1 V\" }}"),
                "my-rig.toml:4:14: `device.pose.x`: ",
            ),
            (
                &format!("{one}name = \"a b\""),
                "my-rig.toml:4:8: `device.name`: \"a b\" may have letters, digits",
            ),
            (
                &format!("{one}ros_port = \"/tmp/x\""),
                "my-rig.toml:4:12: `device.ros_port`: only a mecanum car",
            ),
            (
                &format!("{one}settings = {{ nonsense = 1 }}"),
                "my-rig.toml:4:14: no setting",
            ),
            (
                &format!("{one}port = \"/tmp/x\"\n[[device]]\nkind = \"r150\"\nport = \"/tmp/x\""),
                "my-rig.toml:7:8: `device.port`: two ports have the path /tmp/x",
            ),
            (
                &format!("{one}name = \"a\"\n[[device]]\nkind = \"r150\"\nname = \"a\""),
                "my-rig.toml:7:8: `device.name`: two devices are named",
            ),
        ] {
            let error = parse(text).unwrap_err();
            assert!(error.contains(expected), "{text}\ngave {error}");
        }
    }
}
