//! Any setting with any value that it takes.
//!
//! What a setting takes is found out by trying, as with faults: its words, the ends of its range and
//! something between, so a setting that is added is played from then on.

use std::sync::LazyLock;

use sim_core::settings::SimSettings;
use sim_settings::{Entry, Settings as _, load_toml};

/// A choice of a setting and its value; any numbers are one.
#[derive(Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub struct SettingChoice {
    which: u16,
    value: u8,
}

impl SettingChoice {
    /// A choice of these numbers.
    #[must_use]
    pub fn new(which: u16, value: u8) -> Self {
        Self { which, value }
    }

    /// The key, and its value as a TOML literal.
    #[must_use]
    pub fn pair(&self) -> (&'static str, &'static str) {
        let (entry, values) = &TAKEN[usize::from(self.which) % TAKEN.len()];
        let value = &values[usize::from(self.value) % values.len()];
        (&entry.key, value)
    }
}

impl std::fmt::Debug for SettingChoice {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { which, value } = self;
        let (key, literal) = self.pair();
        write!(
            f,
            "SettingChoice {{ which: {which}, value: {value} }} /* {key} = {literal} */"
        )
    }
}

/// The settings with these choices; one that does not go with those before it is left out.
#[must_use]
pub fn settings(choices: &[SettingChoice]) -> SimSettings {
    let mut settings = SimSettings::new(sim_core::SHIPPED);
    for choice in choices {
        let mut changed = settings.clone();
        let (key, value) = choice.pair();
        if let Err(errors) = load_toml(&line(key, value), "choice", &mut changed) {
            panic!("{}", errors[0]);
        }
        if changed.check().is_ok() {
            settings = changed;
        }
    }
    settings
}

/// Every setting.
#[must_use]
pub fn entries() -> Vec<Entry> {
    SimSettings::new(sim_core::SHIPPED).entries()
}

/// A line of a settings file.
#[must_use]
pub fn line(key: &str, literal: &str) -> String {
    format!("{key} = {literal}\n")
}

/// The ends of a setting's range.
#[must_use]
pub fn bounds(entry: &Entry) -> Option<[String; 2]> {
    let (_, range) = entry.allowed.split_once(" from ")?;
    let (low, high) = range.split_once(" to ")?;
    Some([low.to_owned(), high.to_owned()])
}

/// The ends of a setting's range as TOML literals, and for numbers something between.
#[must_use]
pub fn extremes(entry: &Entry) -> Vec<String> {
    let Some([low, high]) = bounds(entry) else {
        return Vec::new();
    };
    let ends = low.parse::<f64>().ok().zip(high.parse::<f64>().ok());
    let between = ends.map(|(low, high)| format!("{:.3}", low + (high - low) / 3.0));
    let whole = entry.allowed.contains("whole");
    let between = between.filter(|_| !whole);
    literals(entry, [low, high].into_iter().chain(between))
}

/// Values as TOML literals, in the form of the setting's own.
#[must_use]
pub fn literals(entry: &Entry, numbers: impl IntoIterator<Item = String>) -> Vec<String> {
    let items = entry.default.trim_start_matches('[').trim_end_matches(']');
    let items: Vec<&str> = items.split(", ").collect();
    let is_list = entry.default.starts_with('[');
    let unit = entry.allowed.split_once(" in ").map_or("", |(_, rest)| {
        rest.split_once(" from ").map_or(rest, |(unit, _)| unit)
    });
    let numbers = numbers.into_iter().map(|number| {
        // Bounds of times are shown with their unit.
        let has_unit = number.ends_with(|c: char| c.is_ascii_alphabetic());
        let unit = if entry.allowed.contains("a time") {
            "s"
        } else {
            unit
        };
        let is_number = number.parse::<f64>().is_ok();
        let item = match (is_number, has_unit && !is_number, unit) {
            (_, true, _) => format!("\"{number}\""),
            (_, _, "") => number,
            (_, _, unit) => format!("\"{number} {unit}\""),
        };
        if is_list {
            format!("[{}]", vec![item; items.len()].join(", "))
        } else {
            item
        }
    });
    numbers.collect()
}

/// Every setting with the values that are tried and taken, of which the default is one.
static TAKEN: LazyLock<Vec<(Entry, Vec<String>)>> = LazyLock::new(|| {
    let of = |entry: Entry| {
        let words = entry.allowed.split(", ").map(str::to_owned);
        let words = words.filter(|word| word.starts_with('"'));
        let others = ["true", "false", "\"1.2.3.4\""].map(str::to_owned);
        let tried = words.chain(others).chain(extremes(&entry));
        let taken = tried.filter(|literal| {
            let mut settings = SimSettings::new(sim_core::SHIPPED);
            load_toml(&line(&entry.key, literal), "choice", &mut settings).is_ok()
                && settings.check().is_ok()
        });
        let default = entry.default.clone();
        let taken: Vec<String> = std::iter::once(default).chain(taken).collect();
        (entry, taken)
    };
    entries().into_iter().map(of).collect()
});

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_setting_takes_something_beside_its_default() {
        let only: Vec<&str> = TAKEN
            .iter()
            .filter(|(entry, taken)| taken.iter().all(|value| *value == entry.default))
            .map(|(entry, _)| entry.key.as_str())
            .collect();
        assert_eq!(only, [] as [&str; 0]);
    }
}
