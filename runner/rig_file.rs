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

use std::collections::BTreeSet;
use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::Deserialize;
use sim_core::r150_device::vehicle::Start;
use sim_core::settings::SimSettings;
use sim_physics::Pose;
use sim_settings::{Angle, Length, Origin, SettingsError, Source, apply_table, shorten};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// Most devices of a rig.
pub const MOST_DEVICES: usize = 1000;

/// Which device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Kind {
    /// XAG R150 unmanned ground vehicle.
    R150,
    /// Mecanum car on the rayland-dual board.
    Mecanum,
}

impl Kind {
    /// Its name in files, flags and settings.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::R150 => "r150",
            Self::Mecanum => "mecanum",
        }
    }
}

/// One device of a rig.
#[derive(Debug, Clone, PartialEq)]
pub struct DevicePlan {
    /// Unique in the rig.
    pub name: String,
    /// Which device.
    pub kind: Kind,
    /// State of an R150 at the start.
    pub start: Start,
    /// Where it stands at the start.
    pub pose: Pose,
    /// The tree of settings as it holds for this device.
    pub settings: SimSettings,
    /// Path of its main port; without one the port has no name but the system's.
    pub port: Option<PathBuf>,
    /// Whether a mecanum car's ROS link is configured.
    pub ros: bool,
    /// Path of a mecanum car's ROS port; without one the port has no name but the system's.
    pub ros_port: Option<PathBuf>,
}

/// What a rig file says.
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

/// What is wrong with a rig file; each line names the file, the line, and what to do.
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
    /// The JSON Schema of rig files.
    #[must_use]
    pub fn json_schema() -> String {
        format!("{:#}\n", schemars::schema_for!(RigText).as_value())
    }

    /// Reads a rig file; its settings change those of `base`.
    ///
    /// # Errors
    /// Names the file, the line, and what is allowed.
    pub fn parse(source: Source<'_>, base: &SimSettings) -> Result<Self, RigFileError> {
        let file: RigText = toml::from_str(source.text)
            .map_err(|error| RigFileError::from(vec![source.syntax(&error)]))?;
        Self::check(source, base, file)
    }

    /// What a file says that has these tables, and perhaps others.
    pub(crate) fn check(
        source: Source<'_>,
        base: &SimSettings,
        file: RigText,
    ) -> Result<Self, RigFileError> {
        let wrong =
            |origin: Origin, why: String| RigFileError(vec![format!("{origin}: {}", shorten(why))]);
        let at = |span: std::ops::Range<usize>, why: String| wrong(source.place(span.start), why);
        if *file.schema.get_ref() != 1 {
            return Err(at(
                file.schema.span(),
                "`schema`: only schema 1 is known".to_owned(),
            ));
        }
        if file.device.is_empty() || file.device.len() > MOST_DEVICES {
            let why = format!("a rig has 1 to {MOST_DEVICES} [[device]] tables");
            return Err(at(0..0, why));
        }
        let tables = Tables::parse(source)?;
        let mut settings = base.clone();
        if let Some(table) = tables.settings() {
            apply_table(source, table, "", &mut settings)?;
        }
        let mut names = BTreeSet::new();
        let mut paths = BTreeSet::new();
        let mut devices = Vec::new();
        for (index, text) in file.device.iter().enumerate() {
            let device = text.get_ref();
            let kind = device.kind;
            let (name, name_at) = match &device.name {
                Some(name) => (name.get_ref().clone(), name.span()),
                None => (default_name(&file.device, index), text.span()),
            };
            if !is_name(&name) {
                let why =
                    format!("`device.name`: \"{name}\" may have letters, digits, - and _ only");
                return Err(at(name_at, why));
            }
            if !names.insert(name.clone()) {
                let why = format!("`device.name`: two devices are named \"{name}\"");
                return Err(at(name_at, why));
            }
            if let (Kind::R150, Some(ros)) = (kind, &device.ros) {
                let why = "`device.ros`: only a mecanum car has one".to_owned();
                return Err(at(ros.span(), why));
            }
            if let (Kind::R150, Some(path)) = (kind, &device.ros_port) {
                let why = "`device.ros_port`: only a mecanum car has one".to_owned();
                return Err(at(path.span(), why));
            }
            if let (Kind::Mecanum, Some(start)) = (kind, &device.start) {
                let why = "`device.start`: only an R150 has one".to_owned();
                return Err(at(start.span(), why));
            }
            for (key, path) in [("port", &device.port), ("ros_port", &device.ros_port)] {
                let Some(path) = path else { continue };
                if !paths.insert(path.get_ref().clone()) {
                    let shown = path.get_ref().display();
                    let why = format!("`device.{key}`: two ports have the path {shown}");
                    return Err(at(path.span(), why));
                }
            }
            let mut own = settings.clone();
            if let Some(table) = tables.of_device(index) {
                apply_table(source, table, kind.word(), &mut own)?;
            }
            devices.push(DevicePlan {
                name,
                kind,
                start: device
                    .start
                    .as_ref()
                    .map_or(Start::Ready, |start| (*start.get_ref()).into()),
                pose: device.pose.into(),
                settings: own,
                port: device.port.as_ref().map(|path| path.get_ref().clone()),
                ros: device.ros.as_ref().is_some_and(|ros| *ros.get_ref())
                    || device.ros_port.is_some(),
                ros_port: device.ros_port.as_ref().map(|path| path.get_ref().clone()),
            });
        }
        Ok(Self {
            world: file.world,
            seed: file.seed,
            settings,
            devices,
        })
    }
}

/// The kind, with a number if there are several of it.
fn default_name(devices: &[Spanned<DeviceText>], index: usize) -> String {
    let kind = devices[index].get_ref().kind;
    let same = |devices: &[Spanned<DeviceText>]| {
        devices
            .iter()
            .filter(|device| device.get_ref().kind == kind)
            .count()
    };
    if same(devices) == 1 {
        kind.word().to_owned()
    } else {
        format!("{}-{}", kind.word(), same(&devices[..=index]))
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
    #[schemars(schema_with = "all_settings")]
    pub(crate) _settings: toml::Table,
    /// The devices.
    #[serde(default)]
    #[schemars(with = "Vec<DeviceText>", extend("minItems" = 1, "maxItems" = MOST_DEVICES))]
    pub(crate) device: Vec<Spanned<DeviceText>>,
}

/// A device.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct DeviceText {
    /// Which device.
    kind: Kind,
    /// Letters, digits, - and _; unique. The kind unless given, numbered if there are several.
    #[schemars(with = "Option<String>", extend("pattern" = "^[A-Za-z0-9_-]{1,64}$"))]
    name: Option<Spanned<String>>,
    /// In which state an R150 begins; ready unless given.
    #[schemars(with = "Option<StartText>")]
    start: Option<Spanned<StartText>>,
    /// Where it stands at the start; at the origin, looking along x, unless given.
    #[serde(default)]
    pose: PoseText,
    /// Path of the pseudo-terminal of its main link, or a URL to listen at: rfc2217://HOST:PORT or
    /// tcp://HOST:PORT. Without one it is a pseudo-terminal that has the system's name only.
    #[schemars(with = "Option<PathBuf>")]
    port: Option<Spanned<PathBuf>>,
    /// Whether a mecanum car has a ROS link; without it the magnetic sensor has its UART.
    #[schemars(with = "Option<bool>")]
    ros: Option<Spanned<bool>>,
    /// Path of the pseudo-terminal of a mecanum car's ROS link, which is there then, or a URL.
    #[schemars(with = "Option<PathBuf>")]
    ros_port: Option<Spanned<PathBuf>>,
    /// Settings of this device, without its kind in front: `heartbeat_timeout = "5s"`.
    #[serde(default, rename = "settings")]
    #[schemars(schema_with = "device_settings")]
    _settings: toml::Table,
}

/// The settings of all devices and of the world.
pub(crate) fn all_settings(_: &mut SchemaGenerator) -> Schema {
    sim_settings::schema_of(&SimSettings::default())
}

/// The settings of one device of any kind.
fn device_settings(_: &mut SchemaGenerator) -> Schema {
    let SimSettings { r150, mecanum, .. } = SimSettings::default();
    schemars::json_schema!({
        "anyOf": [sim_settings::schema_of(&r150), sim_settings::schema_of(&mecanum)]
    })
}

/// A state at the start.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
enum StartText {
    /// Unlocked, brake released, autonomous.
    Ready,
    /// Locked, parked, in remote mode, as the hardware starts.
    Locked,
}

impl From<StartText> for Start {
    fn from(text: StartText) -> Self {
        match text {
            StartText::Ready => Self::Ready,
            StartText::Locked => Self::Locked,
        }
    }
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

/// The tables of settings in a rig file, with the places of their keys.
struct Tables<'t>(Spanned<DeTable<'t>>);

impl<'t> Tables<'t> {
    fn parse(source: Source<'t>) -> Result<Self, RigFileError> {
        DeTable::parse(source.text)
            .map(Self)
            .map_err(|error| RigFileError::from(vec![source.syntax(&error)]))
    }

    fn settings(&self) -> Option<&DeTable<'t>> {
        table(self.0.get_ref(), "settings")
    }

    fn of_device(&self, index: usize) -> Option<&DeTable<'t>> {
        let DeValue::Array(devices) = self.0.get_ref().get("device")?.get_ref() else {
            return None;
        };
        let DeValue::Table(device) = devices.get(index)?.get_ref() else {
            return None;
        };
        table(device, "settings")
    }
}

fn table<'d, 't>(parent: &'d DeTable<'t>, name: &str) -> Option<&'d DeTable<'t>> {
    match parent.get(name)?.get_ref() {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn parse(text: &str) -> Result<RigPlan, String> {
        let source = Source {
            file: "my-rig.toml",
            text,
        };
        RigPlan::parse(source, &SimSettings::default()).map_err(|error| error.to_string())
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
        assert_eq!(first.start, Start::Locked);
        assert_eq!((first.pose.x, first.pose.y), (1.5, -0.2));
        assert_eq!(first.pose.heading, std::f64::consts::FRAC_PI_2);
        assert_eq!(first.settings.r150.plant.battery.initial_soc, 50.0);
        assert_eq!(second.settings.r150.plant.battery.initial_soc, 80.0);
        assert_eq!(second.settings.r150.firmware.heartbeat_timeout.as_secs(), 9);
        assert_eq!(plan.settings.world.slope, 3.0);
    }

    #[test]
    fn the_schema_is_the_published_one() {
        let schema = RigPlan::json_schema();
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
