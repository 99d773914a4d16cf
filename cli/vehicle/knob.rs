//! Settings as values that can be tried.

use rigsim_core::settings::SimSettings;
use rigsim_settings::{Basis, Entry, Problem, Settings as _, parse_assignment, parse_quantity};

/// First step of a time that is 0 by default, s.
const TIME_STEP: f64 = 0.01;
/// First step of other numbers, as a fraction of their value, or of their range if the value is 0.
const STEP: f64 = 0.2;

/// Greatest ratio of the ends of an interval by which a number is known well.
const CLOSE: f64 = 2.0;
/// Greatest width of an interval that has 0 in it or begins there, or of a temperature, in steps.
const CLOSE_STEPS: f64 = 0.5;

/// Parts of the names of settings that only set the amount of noise.
const CHANCE: [&str; 4] = [".noise", ".tolerance.", "spread", ".crosstalk"];
/// Settings of the calculation, which are not properties of a vehicle.
const OF_THE_MODEL: [&str; 2] = ["world.step", "world.tolerances"];
/// The usual baud rates, which are tried.
const SPEEDS: [u32; 6] = [9_600, 19_200, 38_400, 57_600, 115_200, 230_400];

/// A setting, or one number of a version.
#[derive(Debug, Clone)]
pub(super) struct Knob {
    pub(super) key: String,
    pub(super) basis: Basis,
    pub(super) default: String,
    /// The allowed literals; empty for a number.
    pub(super) choices: Vec<String>,
    /// First step of a number; 0 for a choice.
    pub(super) step: f64,
    /// The same as a fraction of its value, if it is changed by factors.
    ratio: Option<f64>,
    /// Set if it only sets the amount of noise.
    pub(super) is_chance: bool,
    form: Form,
}

/// Form of its literal.
#[derive(Debug, Clone)]
enum Form {
    Choice,
    /// A number with its unit; empty for none.
    One(String),
    Whole(String),
    /// A common factor of these numbers, which have this unit.
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
            let of_device = entry
                .key
                .strip_prefix(device)
                .is_some_and(|rest| rest.starts_with('.'));
            let around = entry.key.starts_with("world.") && !OF_THE_MODEL.contains(&&*entry.key);
            named && (of_device || around)
        });
        entries.iter().flat_map(Self::of).collect()
    }

    fn of(entry: &Entry) -> Vec<Self> {
        let schema = entry.allowed.schema.as_value();
        let words = schema["enum"].as_array();
        let words = words.map(|words| words.iter().map(ToString::to_string).collect());
        let flags = || vec!["true".to_owned(), "false".to_owned()];
        let choices = words.or_else(|| (schema["type"] == "boolean").then(flags));
        let is_speed = entry.value.ends_with(" baud\"");
        let speeds = || SPEEDS.map(|speed| format!("\"{speed} baud\"")).to_vec();
        let choices = choices.or_else(|| is_speed.then(speeds));
        let knob = |step, form| Self {
            key: entry.key.clone(),
            basis: entry.basis,
            default: entry.value.clone(),
            choices: Vec::new(),
            step,
            ratio: None,
            is_chance: CHANCE.iter().any(|part| entry.key.contains(part)),
            form,
        };
        if let Some(choices) = choices {
            let knob = knob(0.0, Form::Choice);
            return vec![Self { choices, ..knob }];
        }
        let text = entry.value.trim_matches('"');
        let parts = text.split('.').map(str::parse::<u8>);
        if parts.filter(Result::is_ok).count() == 4 {
            return (0..4).map(|at| knob(1.0, Form::Part(at))).collect();
        }
        let list = text.strip_prefix('[');
        if let Some(list) = list.and_then(|text| text.strip_suffix(']')) {
            let all: Option<Vec<_>> = list.split(',').map(quantity).collect();
            let (all, units): (Vec<_>, Vec<_>) = all.into_iter().flatten().unzip();
            let unit = units.first();
            let scaled = unit.map(|unit| Self {
                ratio: Some(0.02),
                ..knob(0.02, Form::Scaled(all, unit.clone()))
            });
            return scaled.into_iter().collect();
        }
        // Off is a separate choice, which is not tried.
        let Some((value, unit)) = quantity(text) else {
            return Vec::new();
        };
        let end = entry
            .allowed
            .range
            .as_ref()
            .and_then(|[_, end]| quantity(end));
        let is_time = parse_quantity(text, "s").is_ok();
        let step = match (value == 0.0, is_time) {
            (false, _) if unit == "degC" => 5.0,
            (false, _) => STEP * value.abs(),
            (true, true) => TIME_STEP,
            (true, false) => end.map_or(1.0, |(end, _)| end / 100.0),
        };
        let ratio = (value > 0.0 && unit != "degC").then_some(STEP);
        let form = match entry.allowed.whole {
            true => Form::Whole(unit),
            false => Form::One(unit),
        };
        vec![Self {
            ratio,
            ..knob(step, form)
        }]
    }

    /// The number as a literal, where the others of a version stand in `settings`.
    pub(super) fn literal(&self, settings: &SimSettings, number: f64) -> String {
        // Finer differences cannot be found.
        let number = format!("{number:.4e}").parse().unwrap_or(number);
        match &self.form {
            Form::Choice => self.default.clone(),
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
                let number = number.round().to_string();
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
        let same = entries.filter(|entry| entry.key == self.key);
        same.map(|entry| entry.value).next().unwrap_or_default()
    }

    /// The number as it stands in `settings`; 0 for a choice.
    pub(super) fn number_in(&self, settings: &SimSettings) -> f64 {
        self.number_of(&self.literal_in(settings))
    }

    /// Returns whether it is changed by factors.
    pub(super) fn is_ratio(&self) -> bool {
        self.ratio.is_some()
    }

    /// The number that is this many steps above another.
    pub(super) fn beyond(&self, number: f64, steps: f64) -> f64 {
        match self.ratio {
            Some(ratio) if number > 0.0 => number * (ratio * steps).exp(),
            _ => number + self.step * steps,
        }
    }

    /// How many steps a number is above another.
    pub(super) fn steps_between(&self, from: f64, to: f64) -> f64 {
        match self.ratio {
            Some(ratio) if from > 0.0 && to > 0.0 => (to / from).ln() / ratio,
            _ => (to - from) / self.step,
        }
    }

    /// Returns whether a number within these ends is known well.
    pub(super) fn is_close(&self, low: f64, high: f64) -> bool {
        match low * high > 0.0 && self.unit() != "degC" {
            true => (high / low).max(low / high) <= CLOSE,
            false => self.steps_between(low, high) <= CLOSE_STEPS,
        }
    }

    /// How far down and up its number has to move, in steps, to have its values in groups of settings. All groups may
    /// hold at once, so the greatest moves of each are added.
    pub(super) fn moves<'a>(
        &self,
        number: f64,
        groups: impl Iterator<Item = &'a [SimSettings]>,
    ) -> [f64; 2] {
        groups.fold([0.0; 2], |[least, most], group| {
            let numbers = group.iter().map(|one| self.number_in(one));
            let steps = numbers.map(|other| self.steps_between(number, other));
            let [low, high] = [f64::min, f64::max].map(|end| steps.clone().fold(0.0, end));
            [least + low, most + high]
        })
    }

    /// The settings with this number moved by this many steps, or as far as is allowed.
    pub(super) fn moved(&self, settings: &SimSettings, steps: f64) -> Option<SimSettings> {
        let number = self.number_in(settings);
        let parts = [1.0, 0.5, 0.25, 0.1].into_iter();
        let mut moved =
            parts.map(|part| self.set_number(settings, self.beyond(number, part * steps)));
        moved.find_map(|settings| settings)
    }

    /// The number that is this time; `None` for what is not a time.
    pub(super) fn number_of_time(&self, seconds: f64) -> Option<f64> {
        parse_quantity(&format!("{seconds} s"), &self.unit()).ok()
    }

    /// The number of a literal; 0 for a choice.
    pub(super) fn number_of(&self, literal: &str) -> f64 {
        let text = literal.trim_matches(['"', '[', ']']);
        let number = match &self.form {
            Form::Choice => None,
            Form::Part(at) => text.split('.').nth(*at).and_then(|part| part.parse().ok()),
            Form::Scaled(all, _) => {
                let last = text.rsplit(',').next().and_then(quantity);
                last.zip(all.last()).map(|(now, last)| now.0 / last)
            }
            // A time may be shown in another unit.
            Form::One(unit) if unit != "degC" => parse_quantity(text, unit).ok(),
            _ => quantity(text).map(|(number, _)| number),
        };
        number.unwrap_or(0.0)
    }

    /// Returns whether its number is a whole one.
    pub(super) fn is_whole(&self) -> bool {
        matches!(self.form, Form::Whole(_) | Form::Part(_))
    }

    /// The unit in which its number is.
    pub(super) fn unit(&self) -> String {
        match &self.form {
            Form::One(unit) | Form::Whole(unit) => unit.clone(),
            Form::Scaled(..) => "times all".to_owned(),
            Form::Choice | Form::Part(_) => String::new(),
        }
    }

    /// The value before anything was found, where the others of a version stand in `settings`.
    pub(super) fn default_in(&self, settings: &SimSettings) -> String {
        match self.form {
            Form::Part(_) => self.literal(settings, self.number_of(&self.default)),
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

    /// The settings with this number changed; `None` for what is not allowed.
    pub(super) fn set_number(&self, settings: &SimSettings, number: f64) -> Option<SimSettings> {
        self.set(settings, &self.literal(settings, number))
    }

    /// Its name, with the part of a version.
    pub(super) fn name(&self) -> String {
        match &self.form {
            Form::Part(at) => format!("{}[{at}]", self.key),
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
