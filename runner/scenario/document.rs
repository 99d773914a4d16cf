//! The form of a scenario file. The comments are the descriptions in its JSON Schema.

use std::fmt;
use std::path::PathBuf;

use rigsim_core::device::parameters::LinkName;
use rigsim_settings::{Percent, Span};
use schemars::{JsonSchema, Schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use toml::Spanned;

use crate::rig_file::{DeviceText, SettingsText};

/// A scenario for `sim run`: devices in a world, what happens to them, and what must follow. Times
/// and quantities are text with a unit, as in "250ms" or "48 V"; paths are relative to this file.
/// Conditions are CEL expressions over the names that `sim names` lists.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "sim scenario file", transform = needs_less_with_a_base)]
pub(crate) struct Document {
    /// Version of the format.
    #[schemars(with = "u32", extend("minimum" = 1, "maximum" = 1))]
    pub schema: Spanned<u32>,
    /// The base file: this file inherits everything from it and overrides what it defines itself.
    /// Devices, steps and rules with the name of one in the base change that one.
    #[serde(default, rename = "base")]
    pub _base: Option<PathBuf>,
    /// Values by name, which `--param` can change: `"${pwm}"` stands for one in texts, `param.pwm` in
    /// conditions.
    #[serde(default, rename = "parameters")]
    #[schemars(with = "std::collections::BTreeMap<String, ParameterText>")]
    pub _parameters: toml::Table,
    /// Title: what the scenario tests, in a few words.
    pub title: String,
    /// Description of what happens, for readers.
    pub description: Option<String>,
    /// What a good client does.
    pub good_client: String,
    /// Tags for `--tag`, as in `["drive"]`: lower-case letters, digits and `-`.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub tags: Vec<Spanned<String>>,
    /// The world file; default an empty field.
    pub world: Option<PathBuf>,
    /// Seed of all random numbers; default a random one.
    pub seed: Option<u64>,
    /// Length of the run, in simulated time.
    #[schemars(with = "Span")]
    pub limit: Spanned<Span>,
    /// Time that a good client needs; `at = "40 %"` is a share of it; default the limit.
    #[schemars(with = "Option<Span>")]
    pub nominal_duration: Option<Spanned<Span>>,
    /// The client may give up its mission: verdicts with `mission = true` do not count.
    #[serde(default)]
    pub mission_may_fail: bool,
    /// Settings of all devices and of the world; `sim config` lists them.
    #[serde(default)]
    #[schemars(with = "SettingsText")]
    pub settings: toml::Table,
    /// The devices.
    #[serde(default)]
    #[schemars(with = "Vec<DeviceText>", extend("minItems" = 1))]
    pub device: Vec<Spanned<toml::Table>>,
    /// The steps.
    #[serde(default)]
    #[schemars(with = "Vec<StepText>")]
    pub step: Vec<Spanned<StepText>>,
    /// Conditions that must hold at any time.
    #[serde(default)]
    #[schemars(with = "Vec<RuleText>")]
    pub always: Vec<Spanned<RuleText>>,
    /// Conditions that must not hold at any time.
    #[serde(default)]
    #[schemars(with = "Vec<RuleText>")]
    pub never: Vec<Spanned<RuleText>>,
    /// Responses that must come each time that something happens.
    #[serde(default)]
    #[schemars(with = "Vec<ResponseText>")]
    pub response: Vec<Spanned<ResponseText>>,
    /// What the client report may contain; default anything.
    #[schemars(with = "Option<DemandText>")]
    pub client_report: Option<Spanned<DemandText>>,
}

/// Allows the keys that must be there to stand in the base file.
fn needs_less_with_a_base(schema: &mut Schema) {
    if let Some(required) = schema.remove("required") {
        let alone = serde_json::json!({ "required": required });
        let based = serde_json::json!({ "required": ["schema", "base"] });
        schema.insert("anyOf".to_owned(), serde_json::json!([alone, based]));
    }
}

/// A step: `at`, `when` or `after` says when it begins, and `host`, `fault`, `operator`, `world` or
/// `expect` says what it does. A step that only remembers, or that others wait for, needs none of
/// these. Times may be ranges, `{ min = "1 s", max = "5 s" }`, from which one is drawn each time.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct StepText {
    /// Name of the step, unique; other steps and messages use it.
    #[schemars(with = "Option<String>")]
    pub name: Option<Spanned<String>>,
    /// Begins at this time after the start, or at a share of `nominal_duration`, as in "40 %".
    #[schemars(with = "Option<AtText>")]
    pub at: Option<Spanned<TimeText>>,
    /// Begins when this condition first holds.
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// Begins when the step of this name is done, with all its repetitions and their durations.
    #[schemars(with = "Option<String>")]
    pub after: Option<Spanned<String>>,
    /// Begins this long after `when` or `after`.
    #[schemars(with = "Option<TimeText>")]
    pub delay: Option<Spanned<TimeText>>,
    /// Duration; then the step is reverted: the fault is cleared, the key released, the load removed. A
    /// `host` or `expect` step is repeated for this long.
    #[serde(rename = "for")]
    #[schemars(with = "Option<TimeText>")]
    pub lasts: Option<Spanned<TimeText>>,
    /// Ends as soon as this condition holds: it is not repeated again, and its action is reverted.
    #[schemars(with = "Option<String>")]
    pub until: Option<Spanned<String>>,
    /// Repeated at this interval.
    #[schemars(with = "Option<TimeText>")]
    pub every: Option<Spanned<TimeText>>,
    /// Number of repetitions at most; default no limit.
    #[schemars(with = "Option<u32>", extend("minimum" = 1))]
    pub count: Option<Spanned<u32>>,
    /// Probability of each repetition, 0 to 1; default 1.
    #[schemars(with = "Option<f64>", extend("minimum" = 0, "maximum" = 1))]
    pub probability: Option<Spanned<f64>>,
    /// It is not a failure if this step never begins, or its fault hits nothing.
    #[serde(default)]
    pub optional: bool,
    /// In which runs it counts; default all.
    pub only: Option<Only>,
    /// A verdict of the mission, which does not count where the mission may fail.
    #[serde(default)]
    pub mission: bool,
    /// Stores the values of expressions for later conditions: `{ x0 = "truth.x_m" }` gives
    /// `saved.x0`.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, String>")]
    pub remember: std::collections::BTreeMap<Spanned<String>, Spanned<String>>,
    /// The device; not needed if there is only one.
    #[schemars(with = "Option<String>")]
    pub device: Option<Spanned<String>>,
    /// Action of the scripted client. A real client replaces these steps.
    #[schemars(with = "Option<HostText>")]
    pub host: Option<Spanned<HostText>>,
    /// Starts a fault.
    #[schemars(with = "Option<FaultText>")]
    pub fault: Option<Spanned<toml::Value>>,
    /// Action of an operator on the vehicle.
    #[schemars(with = "Option<OperatorText>")]
    pub operator: Option<Spanned<toml::Value>>,
    /// Change around the vehicle.
    #[schemars(with = "Option<WorldText>")]
    pub world: Option<Spanned<toml::Value>>,
    /// Condition that must hold now, or within a time.
    pub expect: Option<ExpectText>,
}

/// A time, or a range from which one is drawn.
#[derive(Debug, Clone, Copy, JsonSchema)]
#[serde(untagged)]
pub(crate) enum TimeText {
    /// Always the same.
    Exactly(Span),
    /// Drawn each time.
    Between(RangeText),
    /// A share of `nominal_duration`, from 0 to 1.
    #[schemars(skip)]
    Share(f64),
}

/// A time, a range, or a share of `nominal_duration`.
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) enum AtText {
    /// A time or a range.
    Time(TimeText),
    /// A share of `nominal_duration`.
    Share(Percent),
}

/// A parameter.
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) enum ParameterText {
    /// A text, for values.
    Text(String),
    /// A number, for values and conditions.
    Number(f64),
    /// True or false, for both.
    Flag(bool),
}

/// Client of a device in a run with a real client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ClientText {
    /// The real client.
    #[default]
    Live,
    /// The scripted client.
    Script,
}

/// A time between two others.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RangeText {
    /// The shortest.
    pub min: Span,
    /// The longest.
    pub max: Span,
}

impl<'de> Deserialize<'de> for TimeText {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;

        impl<'de> Visitor<'de> for Either {
            type Value = TimeText;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a time with its unit, as in \"250ms\" or \"3 s\", or a range, as in \
                     { min = \"1 s\", max = \"5 s\" }",
                )
            }

            fn visit_str<E: Error>(self, text: &str) -> Result<TimeText, E> {
                if text.trim_end().ends_with('%') {
                    let share = text.parse::<Percent>().map_err(E::custom)?;
                    return Ok(TimeText::Share(share.0 / 100.0));
                }
                text.parse().map(TimeText::Exactly).map_err(E::custom)
            }

            fn visit_map<A: MapAccess<'de>>(self, map: A) -> Result<TimeText, A::Error> {
                RangeText::deserialize(MapAccessDeserializer::new(map)).map(TimeText::Between)
            }
        }
        deserializer.deserialize_any(Either)
    }
}

/// In which runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Only {
    /// Only with the scripted client of this file.
    Scripted,
    /// Only with a real client.
    Live,
}

/// Action of the scripted client: one of `send`, `bytes`, `port` and `baud`, and what it expects.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct HostText {
    /// Link of a device with several; default the link of the command, or the main link.
    #[schemars(with = "Option<LinkName>")]
    pub link: Option<Spanned<String>>,
    /// Sends a command.
    #[serde(rename = "send")]
    #[schemars(with = "Option<CommandText>")]
    pub _send: Option<toml::Value>,
    /// Sends bytes: hexadecimal, as in "AA 55 00 07".
    #[schemars(with = "Option<String>")]
    pub bytes: Option<Spanned<String>>,
    /// Opens or closes the port; it is open at the start, and closes when its cable is pulled.
    pub port: Option<PortText>,
    /// Sets the baud rate of the port.
    pub baud: Option<u32>,
    /// Reply that must come back.
    pub expect: Option<ReplyText>,
}

/// Action at the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PortText {
    /// Open it.
    Open,
    /// Close it.
    Close,
}

/// A command by name and fields. Numbers are as on the wire. Each device has its own commands.
#[derive(JsonSchema)]
pub(crate) struct CommandText {}

/// Reply that must come back: any reply, unless `reply` or `silence` says more. An R150's next reply to
/// the command must match; of a mecanum car's packets, one must match.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReplyText {
    /// Within this time.
    #[schemars(with = "Span")]
    pub within: Spanned<Span>,
    /// Fields of the reply with their values, as in `{ success = true }`. A number may also be a
    /// range: `{ min = 1, max = 5 }`.
    #[schemars(with = "Option<std::collections::BTreeMap<String, serde_json::Value>>")]
    pub reply: Option<Spanned<toml::Table>>,
    /// No reply may come.
    #[serde(default)]
    pub silence: bool,
}

/// A fault. Each device has its own faults, beside those of every device.
#[derive(JsonSchema)]
#[schemars(rename = "Fault")]
pub(crate) struct FaultText {}

/// Action of an operator, the app or a passer-by. Each device has its own actions, beside those of
/// every device.
#[derive(JsonSchema)]
pub(crate) struct OperatorText {}

/// A change around the vehicle, or of what is connected to it. Each device has its own changes.
#[derive(JsonSchema)]
pub(crate) struct WorldText {}

/// A condition that must hold.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExpectText {
    /// The condition.
    #[schemars(with = "String")]
    pub that: Spanned<String>,
    /// Within this time; default at once.
    pub within: Option<Span>,
    /// Message if it does not hold.
    pub message: Option<String>,
}

/// A condition over the whole run, or a part of it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RuleText {
    /// Unique among rules of its kind; files with this base change it by its name.
    pub name: Option<String>,
    /// The condition.
    #[schemars(with = "String")]
    pub that: Spanned<String>,
    /// Message if the rule is violated.
    pub message: Option<String>,
    /// It is violated when this lasts for longer than this time; default at once.
    pub longer_than: Option<Span>,
    /// Counts from this long after the start, or after the end of the step that `after` names.
    pub from: Option<Span>,
    /// Counts until this long after the start, or after the end of that step.
    #[schemars(with = "Option<Span>")]
    pub until: Option<Spanned<Span>>,
    /// Counts from the end of the step of this name.
    #[schemars(with = "Option<String>")]
    pub after: Option<Spanned<String>>,
    /// In which runs it counts; default all.
    pub only: Option<Only>,
    /// A verdict of the mission, which does not count where the mission may fail.
    #[serde(default)]
    pub mission: bool,
}

/// Response that must come each time that something happens: `whenever` or `step` says what.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ResponseText {
    /// Unique among responses; files with this base change it by its name.
    pub name: Option<String>,
    /// Due each time that this condition becomes true.
    #[schemars(with = "Option<String>")]
    pub whenever: Option<Spanned<String>>,
    /// Due each time that the step of this name acts.
    #[schemars(with = "Option<String>")]
    pub step: Option<Spanned<String>>,
    /// The condition that must hold then.
    #[schemars(with = "String")]
    pub then: Spanned<String>,
    /// Within this time after that; default at once.
    pub within: Option<Span>,
    /// It must then hold until this long after that; default for a moment.
    #[schemars(with = "Option<Span>")]
    pub until: Option<Spanned<Span>>,
    /// Message if it does not hold.
    pub message: Option<String>,
    /// If it is never due, nothing is reported. Without this, the report lists it as not judged.
    #[serde(default)]
    pub optional: bool,
    /// In which runs it counts; default all.
    pub only: Option<Only>,
    /// A verdict of the mission, which does not count where the mission may fail.
    #[serde(default)]
    pub mission: bool,
}

/// What the client report may contain: "empty" for nothing, or by kind.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "\"empty\", or a table of `allowed` or `forbidden` kinds and perhaps `only`"
)]
pub(crate) enum DemandText {
    /// Nothing.
    Word(EmptyText),
    /// By kind.
    Kinds(KindsText),
}

/// Nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum EmptyText {
    /// Nothing.
    Empty,
}

/// Kinds of the client report.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct KindsText {
    /// Only these kinds.
    pub allowed: Option<Vec<String>>,
    /// Anything but these kinds.
    pub forbidden: Option<Vec<String>>,
    /// In which runs; default all.
    pub only: Option<Only>,
}
