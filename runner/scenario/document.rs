//! The form of a scenario file. The comments are the descriptions in its JSON Schema.

use std::fmt;
use std::path::PathBuf;

use schemars::{JsonSchema, Schema};
use serde::de::value::MapAccessDeserializer;
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer};
use sim_core::fault::parameters::LinkName;
use sim_settings::{Angle, Length, Percent, Span};
use toml::Spanned;

use sim_core::fault::Fault;

use crate::rig_file::{DeviceText, SettingsText};

/// A scenario for `sim run`: devices in a world, what happens to them, and what must come of it.
/// Times and quantities are text with a unit, as in "250ms" or "48 V"; paths are relative to this
/// file. Conditions are CEL expressions over the names that `sim names` lists.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "sim scenario file", transform = needs_less_with_a_base)]
pub(crate) struct Document {
    /// Version of the form of this file.
    #[schemars(with = "u32", extend("minimum" = 1, "maximum" = 1))]
    pub schema: Spanned<u32>,
    /// The file that this one is based on: everything in that one holds here, unless it is given
    /// here. Devices, steps and rules of the same name are changed by what is given of them here.
    #[serde(default, rename = "base")]
    pub _base: Option<PathBuf>,
    /// Values for this file by name, as they are unless `--param` gives others: `"${pwm}"` stands
    /// for one in texts, `param.pwm` in conditions.
    #[serde(default, rename = "parameters")]
    #[schemars(with = "std::collections::BTreeMap<String, ParameterText>")]
    pub _parameters: toml::Table,
    /// Title: what is tried, in a few words.
    pub title: String,
    /// Description of what happens, for readers.
    pub description: Option<String>,
    /// Behaviour of a good client.
    pub good_client: String,
    /// Words by which runs select scenarios, as in `["drive"]`: lower-case letters, digits and `-`.
    #[serde(default)]
    #[schemars(with = "Vec<String>")]
    pub tags: Vec<Spanned<String>>,
    /// The world file; an empty field without one.
    pub world: Option<PathBuf>,
    /// Seed of everything random; the caller's if not given.
    pub seed: Option<u64>,
    /// Length of the run, in simulated time.
    #[schemars(with = "Span")]
    pub limit: Spanned<Span>,
    /// Time that it takes a good client, of which `at = "40 %"` is a share; the limit unless given.
    #[schemars(with = "Option<Span>")]
    pub takes: Option<Spanned<Span>>,
    /// Says that what is wrong may cost the mission: verdicts with `mission = true` do not count.
    #[serde(default)]
    pub mission_may_fail: bool,
    /// Time that it may take in real time with a client; no longer than simulated time needs, and a
    /// little more, unless given.
    pub wall_limit: Option<Span>,
    /// Settings of all devices and of the world; `sim config` lists them.
    #[serde(default)]
    #[schemars(with = "SettingsText")]
    pub settings: toml::Table,
    /// The devices.
    #[serde(default)]
    #[schemars(with = "Vec<DeviceText>", extend("minItems" = 1))]
    pub device: Vec<Spanned<toml::Table>>,
    /// Steps: what happens.
    #[serde(default)]
    #[schemars(with = "Vec<StepText>")]
    pub step: Vec<Spanned<StepText>>,
    /// Conditions that have to hold all the time.
    #[serde(default)]
    #[schemars(with = "Vec<RuleText>")]
    pub always: Vec<Spanned<RuleText>>,
    /// Conditions that must not hold at any time.
    #[serde(default)]
    #[schemars(with = "Vec<RuleText>")]
    pub never: Vec<Spanned<RuleText>>,
    /// Responses that have to come each time that something happens.
    #[serde(default)]
    #[schemars(with = "Vec<ResponseText>")]
    pub response: Vec<Spanned<ResponseText>>,
    /// Content that the client report may have; anything unless given.
    #[schemars(with = "Option<DemandText>")]
    pub client_report: Option<Spanned<DemandText>>,
}

/// Lets what must be there be in the file that this one is based on.
fn needs_less_with_a_base(schema: &mut Schema) {
    if let Some(required) = schema.remove("required") {
        let alone = serde_json::json!({ "required": required });
        let based = serde_json::json!({ "required": ["schema", "base"] });
        schema.insert("anyOf".to_owned(), serde_json::json!([alone, based]));
    }
}

/// One thing that happens: one of `at`, `when` and `after` says when, and one of `host`, `fault`,
/// `clear`, `operator`, `world` and `expect` says what. A step that only remembers, or that others
/// wait for, needs none of these. Times may be ranges, `{ min = "1 s", max = "5 s" }`, from which
/// one is drawn each time.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct StepText {
    /// Unique; other steps and messages call it so.
    #[schemars(with = "Option<String>")]
    pub name: Option<Spanned<String>>,
    /// So long after the start; or a share of what the job takes, as in "40 %".
    #[schemars(with = "Option<AtText>")]
    pub at: Option<Spanned<TimeText>>,
    /// As soon as this condition holds.
    #[schemars(with = "Option<String>")]
    pub when: Option<Spanned<String>>,
    /// As soon as the step of this name is done, with all its repetitions and what they last.
    #[schemars(with = "Option<String>")]
    pub after: Option<Spanned<String>>,
    /// So long after `when` or `after` says.
    #[schemars(with = "Option<TimeText>")]
    pub delay: Option<Spanned<TimeText>>,
    /// Time for which it lasts: the fault is cleared then, the key released, the load taken off.
    /// With a host's step, how long it is repeated.
    #[serde(rename = "for")]
    #[schemars(with = "Option<TimeText>")]
    pub lasts: Option<Spanned<TimeText>>,
    /// It ends as soon as this condition holds: it is repeated no more, and what it did is undone.
    #[schemars(with = "Option<String>")]
    pub until: Option<Spanned<String>>,
    /// Once more each time that so much time has passed.
    #[schemars(with = "Option<TimeText>")]
    pub every: Option<Spanned<TimeText>>,
    /// Fate of a repetition that falls into the last one's time; it waits unless given.
    #[serde(default)]
    pub overlap: Overlap,
    /// Number of times altogether; without end unless given.
    #[schemars(with = "Option<u32>", extend("minimum" = 1))]
    pub count: Option<Spanned<u32>>,
    /// Probability of each time, 0 to 1; certain unless given.
    #[schemars(with = "Option<f64>", extend("minimum" = 0, "maximum" = 1))]
    pub probability: Option<Spanned<f64>>,
    /// Nothing is wrong if this step never begins, or its fault never hits anything.
    #[serde(default)]
    pub may_not_trigger: bool,
    /// In which runs it counts; in all unless given.
    pub only: Option<Only>,
    /// It is a verdict of the mission, which does not count where that may fail.
    #[serde(default)]
    pub mission: bool,
    /// Values of expressions at this time, for conditions from then on: `{ x0 = "truth.x_m" }`
    /// gives `saved.x0`.
    #[serde(default)]
    #[schemars(with = "std::collections::BTreeMap<String, String>")]
    pub remember: std::collections::BTreeMap<Spanned<String>, Spanned<String>>,
    /// Device that it is about; may be left out when there is one.
    #[schemars(with = "Option<String>")]
    pub device: Option<Spanned<String>>,
    /// The scripted client does something. Where a real client is tested, these steps are left out:
    /// it stands in their place.
    #[schemars(with = "Option<HostText>")]
    pub host: Option<Spanned<HostText>>,
    /// Something breaks.
    #[schemars(with = "Option<Fault>")]
    pub fault: Option<Spanned<Fault>>,
    /// The fault of the step of this name is mended.
    #[schemars(with = "Option<String>")]
    pub clear: Option<Spanned<String>>,
    /// Somebody does something to the vehicle.
    #[schemars(with = "Option<OperatorText>")]
    pub operator: Option<Spanned<toml::Value>>,
    /// Something changes around the vehicle.
    #[schemars(with = "Option<WorldText>")]
    pub world: Option<Spanned<toml::Value>>,
    /// A condition holds now, or within a time.
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
    /// A part of what the job takes, from 0 to 1.
    #[schemars(skip)]
    Share(f64),
}

/// A time, a range, or a share of what the job takes.
#[derive(JsonSchema)]
#[serde(untagged)]
#[expect(dead_code, reason = "only its schema is used")]
pub(crate) enum AtText {
    /// A time or a range.
    Time(TimeText),
    /// A share of what the job takes.
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

/// Client of a device where there is a real one.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum ClientText {
    /// The real one.
    #[default]
    Live,
    /// The script, also then.
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

/// Fate of a repetition that falls into the last one's time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Overlap {
    /// It begins when the last one is over.
    #[default]
    Wait,
    /// It is left out.
    Drop,
}

/// With whom.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub enum Only {
    /// Only with the scripted client of this file.
    Scripted,
    /// Only with a real client.
    Live,
}

/// Deed of the scripted client: one of `send`, `bytes`, `port` and `baud`, and what it expects.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct HostText {
    /// On which link of a device with several; that of the command, or the main one, unless given.
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
    /// Sets the port's speed.
    pub baud: Option<u32>,
    /// Reply that has to come back.
    pub expect: Option<ReplyText>,
}

/// Deed at the port.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum PortText {
    /// Open it.
    Open,
    /// Close it.
    Close,
}

/// A command by name and fields. Numbers are as on the wire. Each device has its own.
#[derive(JsonSchema)]
pub(crate) struct CommandText {}

/// Reply that has to come back: any answer unless one of `reply`, `bytes` and `silence` says more.
/// An R150's next reply to the command has to match; of a mecanum car's packets, one has to.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ReplyText {
    /// By when.
    #[schemars(with = "Span")]
    pub within: Spanned<Span>,
    /// Fields of the reply with their values, as in `{ success = true }`. A number may also be a
    /// range: `{ min = 1, max = 5 }`.
    #[schemars(with = "Option<std::collections::BTreeMap<String, serde_json::Value>>")]
    pub reply: Option<Spanned<toml::Table>>,
    /// The bytes themselves, hexadecimal.
    #[schemars(with = "Option<String>")]
    pub bytes: Option<Spanned<String>>,
    /// Nothing at all may come.
    #[serde(default)]
    pub silence: bool,
}

/// Deed of an operator, the app or a passer-by. Each device has its own beside those of all.
#[derive(JsonSchema)]
pub(crate) struct OperatorText {}

/// A change around the vehicle, or of what hangs on it, of which each device has its own.
#[derive(JsonSchema)]
pub(crate) struct WorldText {}

/// A change around any vehicle.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub(crate) enum AnyWorldText {
    /// Puts things into the world, in the form of a world file: `wall`, `box`, `circle`, `slope`,
    /// `friction`, `tag`, `strip`. They stay; with `for`, which takes obstacles with names only,
    /// they are taken away after that.
    #[schemars(with = "std::collections::BTreeMap<String, serde_json::Value>")]
    Add(toml::Table),
    /// Moves an obstacle at once; with `for`, back after that.
    Move(MoveText),
    /// Takes the obstacle of this name away; with `for`, it is put back after that.
    Remove(String),
    /// Changes the friction of the ground wherever no area of the world has its own; with `for`,
    /// back after that.
    Friction(f64),
}

/// Place for an obstacle: the middle of a box or post, the first point of a wall.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct MoveText {
    /// Its name in the world file, or in the step that added it.
    pub obstacle: String,
    /// East.
    pub x: Length,
    /// North.
    pub y: Length,
    /// Counter-clockwise from x; its own unless given.
    pub heading: Option<Angle>,
}

/// A condition that is to hold.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ExpectText {
    /// The condition.
    #[schemars(with = "String")]
    pub that: Spanned<String>,
    /// By when; at once unless given.
    pub within: Option<Span>,
    /// Words for it if it does not.
    pub message: Option<String>,
}

/// A condition over the whole run, or a part of it.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct RuleText {
    /// Unique among rules of its kind; files that are based on this one change it by its name.
    pub name: Option<String>,
    /// The condition.
    #[schemars(with = "String")]
    pub that: Spanned<String>,
    /// Words for it if it is violated.
    pub message: Option<String>,
    /// It is violated when that has gone on for longer than this; at once unless given.
    pub longer_than: Option<Span>,
    /// From when on: so long after the start, or after the step that `after` names is done.
    pub from: Option<Span>,
    /// Until when: so long after the start, or after that step is done.
    #[schemars(with = "Option<Span>")]
    pub until: Option<Spanned<Span>>,
    /// Counts from when the step of this name is done.
    #[schemars(with = "Option<String>")]
    pub after: Option<Spanned<String>>,
    /// In which runs it counts; in all unless given.
    pub only: Option<Only>,
    /// It is a verdict of the mission, which does not count where that may fail.
    #[serde(default)]
    pub mission: bool,
}

/// Response that has to come each time that something happens: `whenever` or `step` says what.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct ResponseText {
    /// Unique among responses; files that are based on this one change it by its name.
    pub name: Option<String>,
    /// Each time that this condition becomes true.
    #[schemars(with = "Option<String>")]
    pub whenever: Option<Spanned<String>>,
    /// Each time that the step of this name happens.
    #[schemars(with = "Option<String>")]
    pub step: Option<Spanned<String>>,
    /// The condition that has to hold then.
    #[schemars(with = "String")]
    pub then: Spanned<String>,
    /// By when, after that; at once unless given.
    pub within: Option<Span>,
    /// It has to hold on until so long after that; for a moment unless given.
    #[schemars(with = "Option<Span>")]
    pub until: Option<Spanned<Span>>,
    /// Words for it if it does not.
    pub message: Option<String>,
    /// Nothing is said if it is never due. Otherwise the verdict says so, and passes all the same.
    #[serde(default)]
    pub may_not_trigger: bool,
    /// In which runs it counts; in all unless given.
    pub only: Option<Only>,
    /// It is a verdict of the mission, which does not count where that may fail.
    #[serde(default)]
    pub mission: bool,
}

/// Content that the client report may have: "empty" for nothing at all, or by kind.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(
    untagged,
    expecting = "\"empty\", or a table of `allowed` or `forbidden` kinds and perhaps `only`"
)]
pub(crate) enum DemandText {
    /// Nothing at all.
    Word(EmptyText),
    /// By kind.
    Kinds(KindsText),
}

/// Nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(rename_all = "lowercase")]
pub(crate) enum EmptyText {
    /// Nothing at all.
    Empty,
}

/// Kinds of the client report.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub(crate) struct KindsText {
    /// These kinds and no others.
    pub allowed: Option<Vec<String>>,
    /// Anything but these kinds.
    pub forbidden: Option<Vec<String>>,
    /// With whom; with anybody unless given.
    pub only: Option<Only>,
}
