//! Settings as values that can be tried.

use rigsim_core::settings::SimSettings;
use rigsim_settings::{Basis, Entry, Problem, Settings as _, parse_assignment, parse_quantity};

/// First change of a time that is 0 by default, s.
const TIME_STEP: f64 = 0.01;
/// First change of other numbers, as a part of their value, or of their range if that is 0.
const STEP: f64 = 0.2;

/// A setting, or one number of a version.
#[derive(Debug, Clone)]
pub(super) struct Knob {
    pub(super) key: String,
    pub(super) basis: Basis,
    pub(super) default: String,
    pub(super) kind: KnobKind,
}

#[derive(Debug, Clone)]
pub(super) enum KnobKind {
    /// One of these literals.
    Choice(Vec<String>),
    /// A number, and how much it is first changed.
    Number { value: f64, step: f64, form: Form },
}

/// How numbers are written.
#[derive(Debug, Clone)]
pub(super) enum Form {
    /// With its unit; empty for none.
    One(String),
    Whole(String),
    /// A factor of all of these, which have this unit.
    Scaled(Vec<f64>, String),
    /// One part of a version.
    Part(usize),
}

impl Knob {
    /// All settings that a recording of this device may depend on.
    pub(super) fn all(settings: &SimSettings, device: &str, only: &[String]) -> Vec<Self> {
        let mut entries = settings.entries();
        entries.retain(|entry| {
            let named =
                only.is_empty() || only.iter().any(|key| entry.key.starts_with(key.as_str()));
            let own = entry
                .key
                .strip_prefix(device)
                .is_some_and(|rest| rest.starts_with('.'));
            named && (own || entry.key.starts_with("world."))
        });
        entries.iter().flat_map(Self::of).collect()
    }

    fn of(entry: &Entry) -> Vec<Self> {
        let schema = entry.schema.as_value();
        let words = schema["enum"].as_array();
        let words = words.map(|words| words.iter().map(ToString::to_string).collect());
        let flags = || vec!["true".to_owned(), "false".to_owned()];
        let choices = words.or_else(|| (schema["type"] == "boolean").then(flags));
        let knob = |kind| Self {
            key: entry.key.clone(),
            basis: entry.basis,
            default: entry.value.clone(),
            kind,
        };
        if let Some(choices) = choices {
            return vec![knob(KnobKind::Choice(choices))];
        }
        let text = entry.value.trim_matches('"');
        let parts: Vec<f64> = text
            .split('.')
            .filter_map(|part| part.parse().ok())
            .collect();
        if parts.len() == 4 {
            let number = |(at, value): (usize, &f64)| {
                let (value, step) = (*value, 1.0);
                let form = Form::Part(at);
                knob(KnobKind::Number { value, step, form })
            };
            return parts.iter().enumerate().map(number).collect();
        }
        let list = text
            .strip_prefix('[')
            .and_then(|text| text.strip_suffix(']'));
        if let Some(list) = list {
            let all: Option<Vec<_>> = list.split(',').map(quantity).collect();
            let all = all.filter(|all| !all.is_empty());
            let scaled = all.map(|all| {
                let form = Form::Scaled(all.iter().map(|one| one.0).collect(), all[0].1.clone());
                knob(KnobKind::Number {
                    value: 1.0,
                    step: 0.02,
                    form,
                })
            });
            return scaled.into_iter().collect();
        }
        // What is off is a choice of its own, which is not tried.
        let Some((value, unit)) = quantity(text) else {
            return Vec::new();
        };
        let end = entry.range.as_ref().and_then(|[_, end]| quantity(end));
        let is_time = entry.allowed.contains("a time");
        let step = match (value == 0.0, is_time) {
            (false, _) if unit == "degC" => 5.0,
            (false, _) => STEP * value.abs(),
            (true, true) => TIME_STEP,
            (true, false) => end.map_or(1.0, |(end, _)| end / 100.0),
        };
        let form = match entry.allowed.contains("a whole number") {
            true => Form::Whole(unit),
            false => Form::One(unit),
        };
        vec![knob(KnobKind::Number { value, step, form })]
    }

    /// The number as a literal, where the others of a version stand in `settings`.
    pub(super) fn literal(&self, settings: &SimSettings, number: f64) -> String {
        let KnobKind::Number { form, .. } = &self.kind else {
            return self.default.clone();
        };
        // What is finer is not found.
        let number = format!("{number:.4e}").parse().unwrap_or(number);
        match form {
            Form::One(unit) if unit.is_empty() => format!("{number:?}"),
            Form::One(unit) => format!("\"{number} {unit}\""),
            Form::Whole(unit) if unit.is_empty() => format!("{}", number.round()),
            Form::Whole(unit) => format!("\"{} {unit}\"", number.round()),
            Form::Scaled(all, unit) => {
                let all = all
                    .iter()
                    .map(|one| format!("\"{:.4} {unit}\"", one * number));
                format!("[{}]", all.collect::<Vec<_>>().join(", "))
            }
            Form::Part(at) => {
                let now = self.literal_in(settings);
                let mut parts: Vec<&str> = now.trim_matches('"').split('.').collect();
                let number = number.round().clamp(0.0, 255.0).to_string();
                if let Some(part) = parts.get_mut(*at) {
                    *part = &number;
                }
                format!("\"{}\"", parts.join("."))
            }
        }
    }

    /// The value as it stands in `settings`.
    pub(super) fn literal_in(&self, settings: &SimSettings) -> String {
        let entries = settings.entries().into_iter();
        let own = entries.filter(|entry| entry.key == self.key);
        own.map(|entry| entry.value).next().unwrap_or_default()
    }

    /// The number as it stands in `settings`; 0 for a choice.
    pub(super) fn number_in(&self, settings: &SimSettings) -> f64 {
        let KnobKind::Number { form, .. } = &self.kind else {
            return 0.0;
        };
        let text = self.literal_in(settings);
        let text = text.trim_matches(['"', '[', ']']);
        let number = match form {
            Form::Part(at) => text.split('.').nth(*at).and_then(|part| part.parse().ok()),
            Form::Scaled(all, _) => text
                .split(',')
                .next_back()
                .and_then(quantity)
                .zip(all.last())
                .map(|(now, last)| now.0 / last),
            // A time may be shown in another unit.
            Form::One(unit) if unit != "degC" => parse_quantity(text, unit).ok(),
            _ => quantity(text).map(|(number, _)| number),
        };
        number.unwrap_or(0.0)
    }

    /// The unit in which its number is.
    pub(super) fn unit(&self) -> String {
        match &self.kind {
            KnobKind::Number {
                form: Form::One(unit) | Form::Whole(unit),
                ..
            } => unit.clone(),
            KnobKind::Number {
                form: Form::Scaled(..),
                ..
            } => "times all".to_owned(),
            _ => String::new(),
        }
    }

    /// How much a number is first changed; 0 for a choice.
    pub(super) fn step(&self) -> f64 {
        match self.kind {
            KnobKind::Number { step, .. } => step,
            KnobKind::Choice(_) => 0.0,
        }
    }

    /// The value before anything was found, where the others of a version stand in `settings`.
    pub(super) fn default_in(&self, settings: &SimSettings) -> String {
        match self.kind {
            KnobKind::Number {
                value,
                form: Form::Part(_),
                ..
            } => self.literal(settings, value),
            _ => self.default.clone(),
        }
    }

    /// The settings with this one changed; `None` for what is not allowed.
    pub(super) fn set(&self, settings: &SimSettings, literal: &str) -> Option<SimSettings> {
        let (key, value) = parse_assignment("--set", &format!("{}={literal}", self.key)).ok()?;
        let mut changed = settings.clone();
        let set: Result<(), Problem> = changed.assign(&key, &value);
        set.ok().map(|()| changed)
    }

    /// Its name, with the part of a version.
    pub(super) fn name(&self) -> String {
        match &self.kind {
            KnobKind::Number {
                form: Form::Part(at),
                ..
            } => format!("{}[{at}]", self.key),
            _ => self.key.clone(),
        }
    }
}

/// A number and its unit.
fn quantity(text: &str) -> Option<(f64, String)> {
    let text = text.trim().trim_matches('"');
    let split = text.find(|c: char| !(c.is_ascii_digit() || "+-.".contains(c)));
    let (number, unit) = text.split_at(split.unwrap_or(text.len()));
    Some((number.parse().ok()?, unit.trim().to_owned()))
}
