//! Any setting with any value that its schema names: its words, the ends of its range, its default.

use std::sync::LazyLock;

use rigsim_core::settings::SimSettings;
use rigsim_settings::{Entry, Settings as _, load_toml};

use crate::schema;

/// A choice of a setting and its value; any numbers are one.
#[derive(Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
pub struct SettingChoice {
    which: u16,
    value: u8,
}

impl SettingChoice {
    /// The key, and its value as a TOML literal.
    #[must_use]
    pub fn pair(&self) -> (&'static str, &'static str) {
        let (key, values) = &VALUES[usize::from(self.which) % VALUES.len()];
        (key, &values[usize::from(self.value) % values.len()])
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

/// The settings with these choices.
#[must_use]
pub fn settings(choices: &[SettingChoice]) -> SimSettings {
    let mut settings = SimSettings::new(rigsim_core::SHIPPED);
    for choice in choices {
        let (key, value) = choice.pair();
        if let Err(errors) = load_toml(&line(key, value), "choice", &mut settings) {
            panic!("{}", errors[0]);
        }
    }
    settings
}

/// Every setting.
#[must_use]
pub fn entries() -> Vec<Entry> {
    SimSettings::new(rigsim_core::SHIPPED).entries()
}

/// A line of a settings file.
#[must_use]
pub fn line(key: &str, literal: &str) -> String {
    format!("{key} = {literal}\n")
}

/// The ends of a setting's range as TOML literals; those of a list have the same value at each place.
#[must_use]
pub fn ends(entry: &Entry) -> Vec<String> {
    let count = entry
        .default
        .starts_with('[')
        .then(|| entry.default.split(", ").count());
    let whole = |end: &String| match count {
        Some(count) => format!("[{}]", vec![end.as_str(); count].join(", ")),
        None => end.clone(),
    };
    entry.allowed.range.iter().flatten().map(whole).collect()
}

/// The default of a setting and the values that its schema names, as TOML literals.
#[must_use]
pub fn values(entry: &Entry) -> Vec<String> {
    let schema = entry.allowed.schema.as_value();
    let named = schema::values(schema, schema).into_iter();
    let others = ends(entry)
        .into_iter()
        .chain(named.map(|value| value.to_string()));
    std::iter::once(entry.default.clone())
        .chain(others)
        .collect()
}

/// Every setting with its values.
static VALUES: LazyLock<Vec<(String, Vec<String>)>> = LazyLock::new(|| {
    let entries = entries().into_iter();
    entries
        .map(|entry| (entry.key.clone(), values(&entry)))
        .collect()
});

#[cfg(test)]
mod tests;
