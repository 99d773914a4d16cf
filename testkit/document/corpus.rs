//! The documents that are mutated: scenario, rig and world files of the repository, and files with the
//! keys that are rare, in `corpus/`. A file that is based on another one is merged with it.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;
use std::sync::LazyLock;

use rigsim_core::device::Devices;
use rigsim_core::device::names::Unit;
use rigsim_core::settings::SimSettings;
use rigsim_physics::WorldMap;
use rigsim_runner::scenario::EXCLUSIVE;
use rigsim_runner::{RigPlan, Scenario};
use rigsim_settings::{Settings as _, show_toml};
use serde_json::Value as Json;
use toml::{Table, Value};

use crate::choice::Choice;
use crate::schema;
use crate::setting;

/// Kind of a file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Kind {
    /// A scenario.
    Scenario,
    /// A rig.
    Rig,
    /// A world.
    World,
}

impl Kind {
    fn of(document: &Table) -> Self {
        let has = |key| document.contains_key(key);
        match (has("title"), has("device")) {
            (true, _) => Self::Scenario,
            (false, true) => Self::Rig,
            (false, false) => Self::World,
        }
    }

    /// The schema of such files with these devices.
    #[must_use]
    pub fn schema(self, devices: Devices) -> Json {
        match self {
            Self::Scenario => schema::parsed(&Scenario::json_schema(devices)),
            Self::Rig => schema::parsed(&RigPlan::json_schema(devices)),
            Self::World => schema::parsed(&WorldMap::json_schema()),
        }
    }
}

/// The documents of a kind, merged with what they are based on.
#[must_use]
pub fn documents(kind: Kind) -> Vec<Table> {
    let root = Path::new(concat!(env!("CARGO_MANIFEST_DIR"), "/.."));
    let mut found = Vec::new();
    for folder in ["scenarios", "worlds", "testkit/corpus"] {
        find(&root.join(folder), &mut found);
    }
    found.retain(|document| Kind::of(document) == kind);
    found
}

fn find(folder: &Path, found: &mut Vec<Table>) {
    let entries = fs::read_dir(folder).unwrap_or_else(|error| panic!("{folder:?}: {error}"));
    let mut paths: Vec<_> = entries.flatten().map(|entry| entry.path()).collect();
    paths.sort();
    for path in paths {
        if path.is_dir() {
            find(&path, found);
        } else if path.extension().is_some_and(|ending| ending == "toml") {
            found.push(document(&path));
        }
    }
}

fn document(path: &Path) -> Table {
    let text = fs::read_to_string(path).unwrap_or_else(|error| panic!("{path:?}: {error}"));
    let mut over: Table = text
        .parse()
        .unwrap_or_else(|error| panic!("{path:?}: {error}"));
    match over.remove("base") {
        Some(Value::String(base)) => {
            let mut whole = document(&path.with_file_name(base));
            merge(&mut whole, over);
            whole
        }
        _ => over,
    }
}

/// Puts a table over another one, key by key. Tables in lists change those of the same name, or are
/// added.
pub(super) fn merge(into: &mut Table, over: Table) {
    for keys in EXCLUSIVE {
        if keys.iter().any(|key| over.contains_key(*key)) {
            keys.iter().for_each(|key| drop(into.remove(*key)));
        }
    }
    for (key, value) in over {
        match (into.get_mut(&key), value) {
            (Some(Value::Table(into)), Value::Table(over)) => merge(into, over),
            (Some(Value::Array(into)), Value::Array(over)) if over.iter().all(Value::is_table) => {
                for value in over {
                    let name = value.get("name");
                    let same = |own: &&mut Value| name.is_some() && own.get("name") == name;
                    match (into.iter_mut().find(same), value.clone()) {
                        (Some(Value::Table(into)), Value::Table(over)) => merge(into, over),
                        (_, value) => into.push(value),
                    }
                }
            }
            (_, value) => drop(into.insert(key, value)),
        }
    }
}

/// The documents about some devices, and what may stand at each of their keys.
pub(super) struct Family {
    pub documents: Vec<Table>,
    /// By the key of a table and its own, as in `step.fault`; of a list's elements, as in `step[]`.
    values: BTreeMap<String, Vec<Value>>,
}

impl Family {
    /// The documents of a kind about each device alone, and those about any.
    pub(super) fn all(kind: Kind) -> &'static [Self] {
        static ALL: LazyLock<[Vec<Family>; 3]> =
            LazyLock::new(|| [Kind::Scenario, Kind::Rig, Kind::World].map(Family::of));
        &ALL[kind as usize]
    }

    fn of(kind: Kind) -> Vec<Self> {
        let families = crate::groups().map(|devices| Self::new(kind, devices));
        families
            .filter(|family| !family.documents.is_empty())
            .collect()
    }

    fn new(kind: Kind, devices: Devices) -> Self {
        let is_about = |document: &Table| {
            let own = document.get("device").and_then(Value::as_array);
            let mut kinds = own
                .into_iter()
                .flatten()
                .filter_map(|own| own["kind"].as_str());
            kinds.all(|kind| devices.iter().any(|device| device.id == kind))
        };
        let mut documents = documents(kind);
        documents.retain(is_about);
        let mut family = Self {
            documents,
            values: BTreeMap::new(),
        };
        for document in family.documents.clone() {
            family.collect("", &Value::Table(document));
        }
        let schema = kind.schema(devices);
        family.collect_schema(&schema, &schema, "");
        if kind != Kind::World {
            family.collect_devices(devices);
        }
        family
    }

    /// What may stand at a place.
    pub(super) fn values(&self, place: &str) -> &[Value] {
        self.values.get(place).map_or(&[], Vec::as_slice)
    }

    fn add(&mut self, place: String, values: impl IntoIterator<Item = Value>) {
        self.values.entry(place).or_default().extend(values);
    }

    /// Adds what is in a value at a key.
    fn collect(&mut self, key: &str, value: &Value) {
        for (inner, value) in value.as_table().into_iter().flatten() {
            self.add(format!("{key}.{inner}"), [value.clone()]);
            self.collect(inner, value);
        }
        for value in value.as_array().into_iter().flatten() {
            self.add(format!("{key}[]"), [value.clone()]);
            self.collect(key, value);
        }
    }

    /// Adds the values that a schema names for keys in a table at `key`.
    fn collect_schema(&mut self, root: &Json, schema: &Json, key: &str) {
        for (inner, schema) in schema::properties(root, schema) {
            self.add(format!("{key}.{inner}"), schema::values(root, schema));
            self.collect_schema(root, schema, inner);
            for part in schema::parts(root, schema) {
                self.collect_schema(root, &part["items"], inner);
            }
        }
    }

    /// Adds settings, effects and conditions.
    fn collect_devices(&mut self, devices: Devices) {
        let shown = show_toml(&SimSettings::new(devices));
        let shown: Table = shown.parse().unwrap_or_else(|error| panic!("{error}"));
        for group in shown.values() {
            self.collect("settings", group);
        }
        let own = |key: &str| {
            let (group, own) = key.split_once('.')?;
            let is_device = devices.iter().any(|device| device.id == group);
            is_device.then(|| own.to_owned())
        };
        for entry in SimSettings::new(devices).entries() {
            for value in setting::values(&entry) {
                let table = |key: &str| {
                    let table: Result<Table, _> = setting::line(key, &value).parse();
                    Value::Table(table.unwrap_or_else(|error| panic!("{error}")))
                };
                self.add(".settings".to_owned(), [table(&entry.key)]);
                let own = own(&entry.key).map(|key| table(&key));
                self.add("device.settings".to_owned(), own);
            }
        }
        for device in devices {
            let effects = (0..8).flat_map(|value| Choice::effects(device, value));
            for (key, value) in effects {
                self.add(format!("step.{key}"), [value]);
            }
        }
        for info in devices.iter().flat_map(|device| device.all_names()) {
            let condition = match info.unit {
                Unit::Flag => info.name.to_owned(),
                _ => format!("{} > 0.5", info.name),
            };
            for place in ["step.when", "step.until", "always.that", "response.then"] {
                self.add(place.to_owned(), [Value::from(condition.as_str())]);
            }
        }
    }
}
