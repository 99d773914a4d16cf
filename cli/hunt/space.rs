//! The space of a search: kinds of faults with parameters and durations, schedules of them, and the
//! scenario files that schedules are.

use std::fmt::Write as _;
use std::path::{Component, Path, PathBuf};

use rigsim_core::device::EffectInfo;
use rigsim_core::effect;
use rigsim_runner::Scenario;
use schemars::SchemaGenerator;
use serde::{Deserialize, Serialize};
use serde_json::Value;

/// Most sets of parameters of a kind.
const MOST_SETS: usize = 5;
/// Durations to try, the shortest first; `None` is for good.
pub(super) const DURATIONS: [Option<u64>; 4] = [Some(50), Some(300), Some(2000), None];

/// A kind of fault or action on a device, with the values to try, the mildest last.
#[derive(Debug, Clone)]
pub(super) struct Kind {
    pub(super) id: &'static str,
    pub(super) key: &'static str,
    pub(super) device: String,
    pub(super) values: Vec<String>,
}

/// A fault of a schedule.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct Fault {
    pub(super) kind: String,
    pub(super) device: String,
    /// The line of the step that says what it does.
    pub(super) action: String,
    /// The line of the step that says when it begins.
    pub(super) trigger: String,
    /// Duration in milliseconds; `None` is for good.
    pub(super) lasts: Option<u64>,
}

impl Fault {
    /// The fault in words.
    pub(super) fn words(&self) -> String {
        let lasts = self.lasts.map_or("for good".to_owned(), |millis| {
            format!("for {}", duration(millis))
        });
        format!("{} {lasts}, {}", self.kind, self.trigger)
    }
}

pub(super) fn duration(millis: u64) -> String {
    match millis % 1000 {
        0 => format!("{} s", millis / 1000),
        _ => format!("{millis} ms"),
    }
}

impl Kind {
    pub(super) fn fault(&self, value: usize, trigger: &str, lasts: Option<u64>) -> Fault {
        Fault {
            kind: self.id.to_owned(),
            device: self.device.clone(),
            action: format!("{} = {}", self.key, self.values[value]),
            trigger: trigger.to_owned(),
            lasts,
        }
    }
}

/// Every kind of fault, and of action of a person, that the devices of a scenario have.
pub(super) fn kinds(scenario: &Scenario, only: &[String]) -> Vec<Kind> {
    let mut kinds = Vec::new();
    for plan in &scenario.rig.devices {
        for effects in effect::of(plan.device) {
            let mut generator = SchemaGenerator::default();
            let schema = (effects.schema)(&mut generator).to_value();
            let definitions = Value::Object(generator.take_definitions(true));
            for info in effects.kinds {
                let key = info.level.key();
                let wanted = only.is_empty() || only.iter().any(|id| id == info.id);
                if key == "world" || !wanted {
                    continue;
                }
                let values = values(info, &schema, &definitions);
                if !values.is_empty() {
                    kinds.push(Kind {
                        id: info.id,
                        key,
                        device: plan.name.clone(),
                        values,
                    });
                }
            }
        }
    }
    kinds
}

/// The values of a kind that are worth trying, as its declaration has them: what must be given takes each
/// of its words; what may be limited is tried once, too; and each direction.
fn values(info: &EffectInfo, schema: &Value, definitions: &Value) -> Vec<String> {
    let Some(form) = form_of(info, schema) else {
        return Vec::new();
    };
    if !info.is_fault() {
        return match form.get("const") {
            Some(word) => vec![word.to_string()],
            None if form["properties"][info.id]["type"] == "boolean" => {
                vec![format!("{{ {} = true }}", info.id)]
            }
            None => Vec::new(),
        };
    }
    let required = info.parameters.iter().filter(|one| one.required);
    let mut sets = vec![format!("kind = \"{}\"", info.id)];
    for parameter in required {
        let of = &form["properties"][parameter.name];
        let choices = choices(of, definitions);
        let with = |set: &String| {
            let all = choices.iter();
            all.map(|choice| format!("{set}, {} = {choice}", parameter.name))
                .collect::<Vec<_>>()
        };
        sets = sets.iter().flat_map(with).collect();
    }
    let Some(usual) = sets.first().cloned() else {
        return Vec::new();
    };
    let has = |name| info.parameters.iter().any(|one| one.name == name);
    sets.truncate(MOST_SETS - 2);
    if has("direction") {
        sets.push(format!("{usual}, direction = \"to-device\""));
    }
    if has("count") {
        let chance = if has("probability") {
            ", probability = 1.0"
        } else {
            ""
        };
        sets.push(format!("{usual}, count = 1{chance}"));
    }
    sets.iter().map(|set| format!("{{ {set} }}")).collect()
}

/// The alternative of a schema that is this kind.
fn form_of<'a>(info: &EffectInfo, schema: &'a Value) -> Option<&'a Value> {
    let alternatives = ["oneOf", "anyOf"]
        .iter()
        .find_map(|key| schema.get(key)?.as_array());
    alternatives?.iter().find(|form| {
        form["properties"]["kind"]["const"] == info.id
            || form.get("const").is_some_and(|word| word == info.id)
            || !info.is_fault() && form["properties"].get(info.id).is_some()
    })
}

/// The words that a parameter can be, or a number of its range.
fn choices(of: &Value, definitions: &Value) -> Vec<String> {
    let name = of["$ref"].as_str().and_then(|name| name.rsplit('/').next());
    let of = name.map_or(of, |name| &definitions[name]);
    let words = of["enum"].as_array().cloned().unwrap_or_else(|| {
        let all = of["oneOf"].as_array().into_iter().flatten();
        all.filter_map(|one| one.get("const").cloned()).collect()
    });
    if !words.is_empty() {
        return words.iter().map(ToString::to_string).collect();
    }
    let example = of["examples"].get(0).cloned();
    let number = (of["type"] == "integer" || of["type"] == "number").then(|| Value::from(1));
    example.or(number).iter().map(ToString::to_string).collect()
}

/// What all files of a search have in common.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    /// Path of the job as the files write it.
    base: String,
    title: String,
    /// Further rules, as tables of a file.
    rules: String,
}

impl Frame {
    pub(super) fn new(job: &Path, title: &str, folder: &Path, rules: String) -> Self {
        Self {
            base: relative(job, folder).display().to_string(),
            title: title.to_owned(),
            rules,
        }
    }

    /// The scenario file of a schedule. Comments, title and description are for people.
    pub(super) fn document(
        &self,
        schedule: &[Fault],
        head: &str,
        about: Option<(&str, &str)>,
    ) -> String {
        let (title, description) = about.unwrap_or((&self.title, "A schedule of a hunt."));
        let quoted = |text: &str| Value::from(text).to_string();
        let mut text = format!(
            "{head}schema = 1\ntitle = {}\ndescription = {}\nbase = {}\ntags = [\"hunt\"]\nmission_may_fail = true\n",
            quoted(title),
            quoted(description),
            quoted(&self.base)
        );
        // Writing to a string cannot fail.
        for (index, fault) in schedule.iter().enumerate() {
            let _ = write!(
                text,
                "\n[[step]]\nname = {}\ndevice = {}\n{}\n",
                quoted(&step_name(index)),
                quoted(&fault.device),
                fault.trigger
            );
            if let Some(millis) = fault.lasts {
                let _ = writeln!(text, "for = \"{}\"", duration(millis));
            }
            let _ = writeln!(text, "{}\noptional = true", fault.action);
        }
        if !self.rules.is_empty() {
            let _ = write!(text, "\n{}", self.rules);
        }
        text
    }
}

/// Name of the step of a fault.
pub(super) fn step_name(index: usize) -> String {
    format!("hunted {}", index + 1)
}

/// A path as it is seen from a folder.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let absolute = |path: &Path| std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned());
    let (path, folder) = (absolute(path), absolute(folder));
    let (to, from): (Vec<Component<'_>>, Vec<Component<'_>>) =
        (path.components().collect(), folder.components().collect());
    let shared = to.iter().zip(&from).take_while(|(one, other)| one == other);
    let shared = shared.count();
    let up = from[shared..].iter().map(|_| Component::ParentDir);
    up.chain(to[shared..].iter().copied()).collect()
}

/// The rules and responses of a file, as tables of another one.
///
/// # Errors
/// When it is no TOML.
pub(super) fn rules_of(text: &str) -> Result<String, toml::de::Error> {
    let mut table: toml::Table = text.parse()?;
    table.retain(|key, _| ["always", "never", "response", "parameters"].contains(&key));
    Ok(table.to_string())
}
