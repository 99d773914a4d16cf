//! The space of a search: kinds of faults with parameters and durations, schedules of them, and the
//! scenario files that schedules are.

use std::fmt;
use std::path::{Component, Path, PathBuf};

use anyhow::bail;
use rigsim_core::device::EffectInfo;
use rigsim_core::effect;
use rigsim_runner::Scenario;
use serde_json::Value;
use toml::{Table, Value as Toml};

/// Durations to try unless a kind declares others, ms; 0 is for good.
const LASTS: &[u64] = &[50, 300, 2000, 0];
/// Keys of rules in a file, and the key of parameters, which rules may name.
const RULES: [&str; 3] = ["always", "never", "response"];
const PARAMETERS: &str = "parameters";
/// Duration of a fault that does not end, ms.
pub(super) const FOR_GOOD: u64 = u64::MAX;

/// A kind of fault or action on a device, with the forms of it to try.
#[derive(Debug, Clone)]
pub(super) struct Kind {
    pub(super) info: &'static EffectInfo,
    pub(super) device: String,
    /// The usual or strongest one first.
    pub(super) forms: Vec<Form>,
}

/// A set of parameters of a kind, with the durations to try.
#[derive(Debug, Clone)]
pub(super) struct Form {
    /// The line of the step with the action.
    pub(super) action: String,
    /// In milliseconds.
    pub(super) lasts: Vec<u64>,
}

/// When a fault begins.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) enum Trigger {
    /// After so many milliseconds.
    At(u64),
    /// When a condition becomes true.
    When(String),
}

impl fmt::Display for Trigger {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::At(millis) => write!(f, "at = \"{}\"", duration(*millis)),
            Self::When(condition) => write!(f, "when = {}", quoted(condition)),
        }
    }
}

/// A fault of a schedule.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Fault {
    pub(super) kind: &'static str,
    pub(super) device: String,
    pub(super) action: String,
    pub(super) trigger: Trigger,
    /// In milliseconds.
    pub(super) lasts: u64,
}

impl Fault {
    /// The fault in words.
    pub(super) fn words(&self) -> String {
        let parameters = self.parameters();
        let parameters = parameters.map_or_else(String::new, |all| format!(" ({all})"));
        let lasts = match (count(&self.action), self.lasts) {
            (Some(_), _) => String::new(),
            (None, FOR_GOOD) => " for good".to_owned(),
            (None, millis) => format!(" for {}", duration(millis)),
        };
        format!("{}{parameters}{lasts}, {}", self.kind, self.trigger)
    }

    /// The action's parameters, as in a scenario file.
    fn parameters(&self) -> Option<&str> {
        let (_, behind) = self.action.split_once(self.kind)?;
        let all = behind.strip_suffix(" }").unwrap_or(behind);
        let all = all.strip_prefix('"').unwrap_or(all);
        let all = all.trim_start_matches([',', '=', ' ']);
        Some(all).filter(|all| !all.is_empty())
    }

    /// Returns whether it lasts longer than this, in ms. A fault with a count ends by itself.
    pub(super) fn is_longer(&self, millis: u64) -> bool {
        count(&self.action).is_none() && self.lasts > millis
    }
}

/// The count of an action, if it has one.
fn count(action: &str) -> Option<&str> {
    let (_, count) = action.split_once("count = ")?;
    count.split([',', ' ']).next()
}

/// A number with its noun, as text.
pub(super) fn counted<T: fmt::Display + PartialEq + From<u8>>(count: T, what: &str) -> String {
    let plural = if count == T::from(1) { "" } else { "s" };
    format!("{count} {what}{plural}")
}

pub(super) fn duration(millis: u64) -> String {
    match millis % 1000 {
        0 => format!("{} s", millis / 1000),
        _ => format!("{millis} ms"),
    }
}

impl Kind {
    pub(super) fn fault(&self, form: usize, trigger: Trigger, lasts: u64) -> Fault {
        Fault {
            kind: self.info.id,
            device: self.device.clone(),
            action: self.forms[form].action.clone(),
            trigger,
            lasts,
        }
    }

    /// Keeps the forms and durations of which this holds.
    pub(super) fn retain(&mut self, holds: impl Fn(Fault) -> bool) {
        let before = self.clone();
        for (index, form) in self.forms.iter_mut().enumerate() {
            let fault = |lasts: &u64| before.fault(index, Trigger::At(0), *lasts);
            form.lasts.retain(|lasts| holds(fault(lasts)));
        }
        self.forms.retain(|form| !form.lasts.is_empty());
    }

    pub(super) fn is_of(&self, fault: &Fault) -> bool {
        self.info.id == fault.kind && self.device == fault.device
    }
}

/// Every kind of fault and of operator action that the devices of a scenario may have. `sent` has the devices
/// and ids of the messages that the client sends without faults.
pub(super) fn kinds(scenario: &Scenario, only: &[String], sent: &[(usize, u8)]) -> Vec<Kind> {
    let mut kinds = Vec::new();
    for (index, plan) in scenario.rig.devices.iter().enumerate() {
        let links = plan.device.links.iter().skip(1);
        let links = links.map(|link| ("link", format!("link = \"{}\"", link.id)));
        let ids = sent.iter().filter(|(device, _)| *device == index);
        let ids = ids.map(|(_, id)| ("command", format!("command = {id}")));
        let targets: Vec<_> = links.chain(ids).collect();
        for info in effect::of(plan.device).flat_map(|effects| effects.kinds) {
            let is_asked = only.is_empty() || only.iter().any(|id| id == info.id);
            if is_asked && info.level.key() != "world" {
                kinds.push(Kind {
                    info,
                    device: plan.name.clone(),
                    forms: forms(info, &targets),
                });
            }
        }
    }
    kinds
}

/// The forms that a declaration lists for a search, and the usual one on each target.
fn forms(info: &EffectInfo, targets: &[(&str, String)]) -> Vec<Form> {
    let (id, key) = (info.id, info.level.key());
    let lasts = if info.lasts.is_empty() {
        LASTS
    } else {
        info.lasts
    };
    let usual = info.tries.first().copied().unwrap_or_default();
    let mut sets: Vec<String> = info.tries.iter().map(|set| (*set).to_owned()).collect();
    if sets.is_empty() {
        sets.push(String::new());
    }
    for (name, target) in targets {
        if info.parameters.iter().any(|one| one.name == *name) {
            sets.push(format!("{target}, {usual}"));
        }
    }
    let form = |set: String| Form {
        lasts: match count(&set) {
            Some(_) => vec![FOR_GOOD],
            None => lasts
                .iter()
                .map(|millis| if *millis == 0 { FOR_GOOD } else { *millis })
                .collect(),
        },
        action: match set.trim_end_matches([',', ' ']) {
            "" if info.is_fault() => format!("{key} = {{ kind = \"{id}\" }}"),
            "" => format!("{key} = \"{id}\""),
            set if info.is_fault() => format!("{key} = {{ kind = \"{id}\", {set} }}"),
            value => format!("{key} = {{ {id} = {value} }}"),
        },
    };
    sets.into_iter().map(form).collect()
}

/// The common part of all files of a search.
#[derive(Debug, Clone)]
pub(super) struct Frame {
    job: PathBuf,
    title: String,
    /// Further rules, as tables of a file.
    rules: Table,
}

impl Frame {
    pub(super) fn new(job: &Path, title: &str, rules: &Table) -> Self {
        Self {
            job: real(job),
            title: title.to_owned(),
            rules: rules.clone(),
        }
    }

    /// The same without further rules, and with each of them alone.
    pub(super) fn with_one_rule(&self) -> Vec<Self> {
        let others = self.rules.iter().filter(|(key, _)| *key == PARAMETERS);
        let others = Table::from_iter(others.map(|(key, value)| (key.clone(), value.clone())));
        let mut all = vec![others.clone()];
        for (key, rules) in &self.rules {
            for rule in rules.as_array().into_iter().flatten() {
                let mut one = others.clone();
                one.insert(key.clone(), vec![rule.clone()].into());
                all.push(one);
            }
        }
        let frame = |rules| Self {
            rules,
            ..self.clone()
        };
        all.into_iter().map(frame).collect()
    }

    /// The scenario file of a schedule, which is played and not kept.
    pub(super) fn document(&self, schedule: &[Fault]) -> String {
        self.file(
            schedule,
            "",
            (&self.title, "A schedule of a hunt."),
            &self.job,
        )
    }

    /// The scenario file of a finding for this folder, with comments, title and description for people.
    pub(super) fn finding(
        &self,
        schedule: &[Fault],
        head: &str,
        about: (&str, &str),
        folder: &Path,
    ) -> String {
        self.file(schedule, head, about, &relative(&self.job, &real(folder)))
    }

    fn file(&self, schedule: &[Fault], head: &str, about: (&str, &str), base: &Path) -> String {
        let base = quoted(&base.display().to_string());
        let (title, description) = (quoted(about.0), quoted(about.1));
        let mut text = format!(
            "{head}schema = 1\ntitle = {title}\ndescription = {description}\nbase = {base}\n\
             tags = [\"hunt\"]\nmission_may_fail = true\n"
        );
        for (index, fault) in schedule.iter().enumerate() {
            let (name, device) = (quoted(&step_name(index)), quoted(&fault.device));
            let (trigger, action) = (&fault.trigger, &fault.action);
            text += &format!("\n[[step]]\nname = {name}\ndevice = {device}\n{trigger}\n");
            if fault.lasts != FOR_GOOD {
                text += &format!("for = \"{}\"\n", duration(fault.lasts));
            }
            text += &format!("{action}\noptional = true\n");
        }
        if !self.rules.is_empty() {
            text += &format!("\n{}", self.rules);
        }
        text
    }
}

fn quoted(text: &str) -> String {
    Value::from(text).to_string()
}

/// Name of the step of a fault.
pub(super) fn step_name(index: usize) -> String {
    format!("hunted {}", index + 1)
}

/// The absolute path without links of what is there.
fn real(path: &Path) -> PathBuf {
    std::fs::canonicalize(path).unwrap_or_else(|_| path.to_owned())
}

/// A path as it is seen from a folder.
fn relative(path: &Path, folder: &Path) -> PathBuf {
    let pairs = path.components().zip(folder.components());
    let shared = pairs.take_while(|(one, other)| one == other).count();
    let up = folder
        .components()
        .skip(shared)
        .map(|_| Component::ParentDir);
    up.chain(path.components().skip(shared)).collect()
}

/// Adds the rules and responses of a file, and the parameters that they have.
///
/// # Errors
/// When it is not TOML, or has none.
pub(super) fn add_rules(rules: &mut Table, text: &str) -> anyhow::Result<()> {
    let table: Table = text.parse()?;
    if !RULES.iter().any(|key| table.contains_key(*key)) {
        bail!("it has no rule itself: no [[always]], [[never]] or [[response]]");
    }
    let is_rule = |key: &String| RULES.contains(&key.as_str()) || key == PARAMETERS;
    for (key, value) in table.into_iter().filter(|(key, _)| is_rule(key)) {
        match (rules.get_mut(&key), value) {
            (Some(Toml::Array(all)), Toml::Array(more)) => all.extend(more),
            (Some(Toml::Table(all)), Toml::Table(more)) => all.extend(more),
            (_, value) => drop(rules.insert(key, value)),
        }
    }
    Ok(())
}
