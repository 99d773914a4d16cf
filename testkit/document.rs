//! Whole documents: scenario, rig and world files made of choices.
//!
//! Their vocabulary is that of the schemas, so a key that is added is written from then on. What a
//! schema does not say is said here: which keys exclude each other, and what names there are. Most
//! documents are sound and are played; in the others a value is one that nobody means, a key is
//! missing or is there for nothing.

mod choices;
mod condition;
pub mod play;
mod steps;

use std::sync::LazyLock;

use serde_json::Value as Json;
use sim_core::SHIPPED;
use sim_core::device::{DeviceSpec, Devices};
use sim_physics::WorldMap;
use sim_runner::{RigPlan, Scenario};
use toml::{Table, Value};

use crate::setting::SettingChoice;
use choices::Choices;

/// The text of a scenario file.
#[must_use]
pub fn scenario(choices: &[u8]) -> String {
    static SCHEMAS: LazyLock<Schemas> = LazyLock::new(|| Schemas::new(Scenario::json_schema));
    let mut writer = Writer::new(choices, &SCHEMAS);
    let devices = writer.devices(3);
    let mut document = Table::new();
    document.insert("device".to_owned(), devices);
    writer.begin(&mut document);
    document.insert("limit".to_owned(), writer.limit());
    if writer.choices.once_in(2) {
        let settings = writer.settings("");
        document.insert("settings".to_owned(), settings);
    }
    writer.steps(&mut document);
    text(&document)
}

/// The text of a rig file.
#[must_use]
pub fn rig(choices: &[u8]) -> String {
    static SCHEMAS: LazyLock<Schemas> = LazyLock::new(|| Schemas::new(RigPlan::json_schema));
    let mut writer = Writer::new(choices, &SCHEMAS);
    let mut document = Table::new();
    document.insert("device".to_owned(), writer.devices(6));
    writer.begin(&mut document);
    text(&document)
}

/// The text of a world file.
#[must_use]
pub fn world(choices: &[u8]) -> String {
    static SCHEMAS: LazyLock<Schemas> = LazyLock::new(|| Schemas::new(|_| WorldMap::json_schema()));
    let mut writer = Writer::new(choices, &SCHEMAS);
    match writer.object(writer.schema, &[]) {
        Value::Table(document) => text(&document),
        other => other.to_string(),
    }
}

/// The schemas of a kind of file.
struct Schemas {
    /// With all devices.
    all: Json,
    /// With each device alone.
    alone: Vec<(&'static DeviceSpec, Json)>,
}

impl Schemas {
    fn new(schema: impl Fn(Devices) -> String) -> Self {
        let parse = |devices| {
            serde_json::from_str(&schema(devices)).unwrap_or_else(|error| panic!("{error}"))
        };
        let alone = SHIPPED.iter().zip(SHIPPED.chunks(1));
        Self {
            all: parse(SHIPPED),
            alone: alone.map(|(own, one)| (*own, parse(one))).collect(),
        }
    }
}

fn is_null(schema: &Json) -> bool {
    schema["type"].as_str() == Some("null")
}

fn table<const N: usize>(entries: [(&str, Value); N]) -> Value {
    let entries = entries.map(|(key, value)| (key.to_owned(), value));
    Value::Table(Table::from_iter(entries))
}

fn text(document: &Table) -> String {
    toml::to_string(document).unwrap_or_else(|error| panic!("{error}"))
}

/// Numbers in places where any number may be.
const SIZES: &[&str] = &["1", "0", "0.5", "2", "5", "12", "40", "0.01", "100"];
/// Times in scenarios that last a second or so.
const TIMES: &[&str] = &[
    "100 ms",
    "0 s",
    "20 ms",
    "250 ms",
    "5 ms",
    "137 ms",
    "0.4 s",
    "600 ms",
    "1 us",
    "86.806 us",
];
/// Bytes, among them what looks like frames of each link.
const BYTES: &[&str] = &[
    "AA 55 00 07 C7 84",
    "AA",
    "AA 55 FF 12",
    "00 09 01 01 00 64 00 64 00",
    "58 35 0A",
];

/// Writes a document.
struct Writer<'b> {
    choices: Choices<'b>,
    schemas: &'static Schemas,
    /// That of all devices, or of the one that is spoken of alone.
    schema: &'static Json,
    devices: Vec<(String, &'static DeviceSpec)>,
    /// The device that is spoken of.
    kind: Option<&'static DeviceSpec>,
    names: usize,
}

impl<'b> Writer<'b> {
    fn new(choices: &'b [u8], schemas: &'static Schemas) -> Self {
        Self {
            choices: Choices::new(choices),
            schemas,
            schema: &schemas.all,
            devices: Vec::new(),
            kind: None,
            names: 0,
        }
    }

    /// Speaks of a device from now on: of what its row has, and no other.
    fn speak_of(&mut self, kind: &'static DeviceSpec) {
        let mut alone = self.schemas.alone.iter();
        let own = alone.find(|(own, _)| *own == kind);
        self.schema = own.map_or(&self.schemas.all, |(_, schema)| schema);
        self.kind = Some(kind);
    }

    /// Puts in what every file begins with.
    fn begin(&mut self, document: &mut Table) {
        let texts = [("title", "t"), ("good_client", "g")];
        let has = |key: &str| self.schema["properties"].get(key).is_some();
        for (key, text) in texts.into_iter().filter(|(key, _)| has(key)) {
            document.insert(key.to_owned(), Value::from(text));
        }
        let schema = self.value(&self.schema["properties"]["schema"], "schema");
        document.insert("schema".to_owned(), schema);
    }

    fn limit(&mut self) -> Value {
        if self.choices.is_odd() {
            return self.odd();
        }
        let limits = ["800 ms", "1 s", "1500 ms", "2.5 s"];
        Value::from(limits[self.choices.below(limits.len())])
    }

    /// One device or a few, well apart most of the time.
    fn devices(&mut self, most: usize) -> Value {
        let mut written = Vec::new();
        for number in 0..=self.choices.below(most) {
            let Some(kind) = self.choices.pick(SHIPPED).copied() else {
                continue;
            };
            self.speak_of(kind);
            let schema = &self.schema["$defs"]["DeviceText"];
            let left_out = ["kind", "name", "pose", "settings"];
            let mut device = match self.object(schema, &left_out) {
                Value::Table(device) => device,
                _ => Table::new(),
            };
            let word = kind.id;
            let name = format!("v{number}{}", ["", "-a"][self.choices.below(2)]);
            let kind_word = if self.choices.is_odd() {
                self.odd()
            } else {
                Value::from(word)
            };
            device.insert("kind".to_owned(), kind_word);
            device.insert("name".to_owned(), Value::from(name.as_str()));
            // The wheels of two that stand in each other push without end.
            let apart = if self.choices.once_in(16) {
                0
            } else {
                3 * number
            };
            let pose = table([("x", Value::from(format!("{apart} m")))]);
            device.insert("pose".to_owned(), pose);
            if self.choices.once_in(3) {
                let settings = self.settings(&format!("{word}."));
                device.insert("settings".to_owned(), settings);
            }
            self.devices.push((name, kind));
            written.push(Value::Table(device));
        }
        if self.choices.is_odd() {
            written.extend(written.first().cloned());
        }
        Value::Array(written)
    }

    /// Settings, or those of one device without what stands `before` them.
    fn settings(&mut self, before: &str) -> Value {
        let mut settings = Table::new();
        for _ in 0..=self.choices.below(3) {
            let which = u16::from_le_bytes([self.choices.byte(), self.choices.byte()]);
            let (key, literal) = SettingChoice::new(which, self.choices.byte()).pair();
            let Some(key) = key.strip_prefix(before) else {
                continue;
            };
            let read: Result<Table, _> = format!("x = {literal}").parse();
            let value = read.ok().and_then(|mut read| read.remove("x"));
            let value = if self.choices.is_odd() {
                Some(self.odd())
            } else {
                value
            };
            let mut group = &mut settings;
            let mut parts = key.split('.').peekable();
            while let (Some(part), Some(value)) = (parts.next(), &value) {
                if parts.peek().is_none() {
                    group.insert(part.to_owned(), value.clone());
                    break;
                }
                let inner = group
                    .entry(part)
                    .or_insert_with(|| Value::Table(Table::new()));
                match inner {
                    Value::Table(inner) => group = inner,
                    _ => break,
                }
            }
        }
        Value::Table(settings)
    }

    /// A value that this schema allows, as far as it says.
    fn value(&mut self, schema: &Json, key: &str) -> Value {
        if self.choices.is_odd() {
            return self.odd();
        }
        if let Some(reference) = schema["$ref"].as_str() {
            let name = reference.rsplit('/').next().unwrap_or_default();
            return self.defined(name, key);
        }
        if let Some(one) = schema.get("const").and_then(Json::as_str) {
            return Value::from(one);
        }
        for alternatives in ["oneOf", "anyOf"] {
            if let Some(all) = schema[alternatives].as_array() {
                let all: Vec<&Json> = all.iter().filter(|one| !is_null(one)).collect();
                return match self.choices.pick(&all) {
                    Some(one) => self.value(one, key),
                    None => self.odd(),
                };
            }
        }
        let kind = schema["type"]
            .as_str()
            .or_else(|| schema["type"][0].as_str());
        match kind {
            Some("object") => self.object(schema, &[]),
            Some("array") => {
                let least = schema["minItems"].as_u64().unwrap_or(0);
                let most = schema["maxItems"].as_u64().unwrap_or(least + 3);
                let more = self
                    .choices
                    .below(usize::try_from(most - least).unwrap_or(0) + 1);
                let count = usize::try_from(least).unwrap_or(0) + more;
                Value::Array(
                    (0..count)
                        .map(|_| self.value(&schema["items"], key))
                        .collect(),
                )
            }
            Some("boolean") => Value::from(self.choices.once_in(2)),
            Some("integer") => self.integer(schema),
            Some("number") => self.number(schema),
            Some("string") => Value::from(self.string(schema, key)),
            _ => self.odd(),
        }
    }

    /// A table with what must be in it and some of what may.
    fn object(&mut self, schema: &Json, left_out: &[&str]) -> Value {
        let mut table = Table::new();
        let required: Vec<&str> = schema["required"]
            .as_array()
            .map(|keys| keys.iter().filter_map(Json::as_str).collect())
            .unwrap_or_default();
        for (key, own) in schema["properties"].as_object().into_iter().flatten() {
            let must = required.contains(&key.as_str());
            let is_there = if must {
                !self.choices.is_odd()
            } else {
                self.choices.once_in(3)
            };
            if is_there && !left_out.contains(&key.as_str()) && !is_null(own) {
                let value = self.value(own, key);
                table.insert(key.clone(), value);
            }
        }
        if self.choices.is_odd() {
            let value = self.odd();
            table.insert("what_is_this".to_owned(), value);
        }
        Value::Table(table)
    }

    fn integer(&mut self, schema: &Json) -> Value {
        let low = schema["minimum"].as_i64().unwrap_or(-500);
        let high = schema["maximum"].as_i64().unwrap_or(1000).max(low);
        let numbers = [low, high, low + 1, 0, 1, 2, 5, 300].map(|number| number.clamp(low, high));
        Value::from(numbers[self.choices.below(numbers.len())])
    }

    fn number(&mut self, schema: &Json) -> Value {
        let low = schema["minimum"].as_f64().unwrap_or(0.0);
        let high = schema["maximum"].as_f64().unwrap_or(2.0);
        let numbers = [0.5, low, high, 0.0, 1.0, -1.0, 3.0, 0.01, 2.5, -2.0];
        Value::from(numbers[self.choices.below(numbers.len())].clamp(low, high))
    }

    fn string(&mut self, schema: &Json, key: &str) -> String {
        let example = schema["examples"][0].as_str().unwrap_or_default();
        match key {
            "that" | "when" | "whenever" | "then" => self.condition(),
            "bytes" => BYTES[self.choices.below(BYTES.len())].to_owned(),
            "line" => ["X10", "Y-5", "Z99999", "B1", "Q"][self.choices.below(5)].to_owned(),
            "remove" | "obstacle" => format!("o{}", self.choices.below(4)),
            "port" | "ros_port" | "name" => {
                self.names += 1;
                format!("o{}", self.names)
            }
            _ if example == "250ms" => TIMES[self.choices.below(TIMES.len())].to_owned(),
            _ if example.contains(' ')
                && schema["pattern"].as_str().is_some_and(|p| p.contains("eE")) =>
            {
                let (_, unit) = example.split_once(' ').unwrap_or_default();
                format!("{} {unit}", SIZES[self.choices.below(SIZES.len())])
            }
            _ if !example.is_empty() => example.to_owned(),
            _ => "x".to_owned(),
        }
    }

    /// A value that nobody means.
    fn odd(&mut self) -> Value {
        let date = || "1979-05-27".parse().map(Value::Datetime);
        match self.choices.below(16) {
            0 => Value::from(""),
            1 => Value::from("x".repeat(100_000)),
            2 => Value::from(-1),
            3 => Value::from(i64::MAX),
            4 => Value::from(i64::MIN),
            5 => Value::from(f64::NAN),
            6 => Value::from(f64::INFINITY),
            7 => Value::from(1e308),
            8 => Value::from(true),
            9 => Value::Array(Vec::new()),
            10 => Value::Table(Table::new()),
            11 => Value::from("1e400 m"),
            12 => Value::from("-5 s"),
            13 => Value::from("\u{0}\u{1F600}"),
            14 => Value::Array(vec![Value::from(0); 1000]),
            _ => date().unwrap_or(Value::from(0)),
        }
    }
}
