//! One scenario from several files: what a file takes over from another one, and parameters.

use std::collections::BTreeMap;
use std::ops::Range;

use rigsim_settings::{Source, or_allowed};
use serde::{Deserialize, Serialize};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::condition::{Reading, check_name};
use crate::problems::{Problems, Put};

/// A file.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct NamedText {
    /// Its name, as errors call it.
    pub file: String,
    /// Content.
    pub text: String,
}

impl NamedText {
    /// The same, borrowed.
    #[must_use]
    pub fn source(&self) -> Source<'_> {
        let Self { file, text } = self;
        Source { file, text }
    }
}

impl From<Source<'_>> for NamedText {
    fn from(source: Source<'_>) -> Self {
        Self {
            file: source.file.to_owned(),
            text: source.text.to_owned(),
        }
    }
}

/// Everything that a scenario is read from, as traces have it in their headers.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ScenarioText {
    /// Name of the scenario file.
    pub file: String,
    /// Content, or the rig that was served.
    #[serde(rename = "scenario")]
    pub text: String,
    /// The files that it is based on.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub base: Vec<NamedText>,
    /// Parameters that were given, each with its value, which wins over that in the files.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameters: Vec<(String, String)>,
    /// Settings that win over those of the files, as `key=value`.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub set: Vec<String>,
}

impl ScenarioText {
    /// The file itself.
    #[must_use]
    pub fn source(&self) -> Source<'_> {
        let Self { file, text, .. } = self;
        Source { file, text }
    }
}

/// Lists whose elements have names, and change those of the same name in what a file is based on.
const NAMED: [&str; 5] = ["device", "step", "always", "never", "response"];

/// Most bytes that parameters may add to the files of a scenario.
const MOST_FILLED: usize = 1 << 20;

/// Keys of which one says when a step begins.
pub(super) const TRIGGERS: [&str; 3] = ["at", "when", "after"];
/// Keys of which one says what a step does.
pub(super) const ACTIONS: [&str; 5] = ["host", "fault", "operator", "world", "expect"];
/// Keys of a step of which one takes the place of another.
pub const EXCLUSIVE: [&[&str]; 2] = [&TRIGGERS, &ACTIONS];

/// Puts a file over the one that it is based on.
pub(super) fn put_over<'t>(base: DeTable<'t>, over: DeTable<'t>) -> DeTable<'t> {
    let mut all = base;
    for (key, value) in over {
        let name = key.get_ref().to_string();
        let before = all.remove(name.as_str());
        let value = match before {
            Some(before) if NAMED.contains(&name.as_str()) => by_name(before, value),
            Some(before) if ["settings", "parameters"].contains(&name.as_str()) => {
                deeply(before, value)
            }
            _ => value,
        };
        all.insert(key, value);
    }
    all
}

fn by_name<'t>(base: Spanned<DeValue<'t>>, over: Spanned<DeValue<'t>>) -> Spanned<DeValue<'t>> {
    let span = over.span();
    let (base, over) = match (base.into_inner(), over.into_inner()) {
        (DeValue::Array(base), DeValue::Array(over)) => (base, over),
        // What is not a list is reported when it is read.
        (_, over) => return Spanned::new(span, over),
    };
    let mut all: Vec<Spanned<DeValue<'t>>> = base.into_iter().collect();
    for value in over {
        let name = name_of(&value);
        let same = all
            .iter()
            .position(|base| name.is_some() && name_of(base) == name);
        match same {
            Some(index) => {
                let base = all.remove(index);
                all.insert(index, changed(base, value));
            }
            None => all.push(value),
        }
    }
    Spanned::new(span, DeValue::Array(all.into_iter().collect()))
}

/// The name of an element; a device without one is called by its kind.
fn name_of(value: &Spanned<DeValue<'_>>) -> Option<String> {
    let table = value.get_ref().as_table()?;
    let name = table.get("name").or_else(|| table.get("kind"))?;
    name.get_ref().as_str().map(str::to_owned)
}

/// An element with keys changed.
fn changed<'t>(base: Spanned<DeValue<'t>>, by: Spanned<DeValue<'t>>) -> Spanned<DeValue<'t>> {
    let span = by.span();
    let (mut base, by) = match (base.into_inner(), by.into_inner()) {
        (DeValue::Table(base), DeValue::Table(by)) => (base, by),
        (_, by) => return Spanned::new(span, by),
    };
    for keys in EXCLUSIVE {
        if keys.iter().any(|key| by.contains_key(*key)) {
            for key in keys {
                base.remove(*key);
            }
        }
    }
    for (key, value) in by {
        let before = base.remove(key.get_ref().as_ref());
        let value = match before {
            Some(before) if *key.get_ref() == "settings" => deeply(before, value),
            _ => value,
        };
        base.insert(key, value);
    }
    Spanned::new(span, DeValue::Table(base))
}

fn deeply<'t>(base: Spanned<DeValue<'t>>, over: Spanned<DeValue<'t>>) -> Spanned<DeValue<'t>> {
    let span = over.span();
    let (mut base, over) = match (base.into_inner(), over.into_inner()) {
        (DeValue::Table(base), DeValue::Table(over)) => (base, over),
        (_, over) => return Spanned::new(span, over),
    };
    for (key, value) in over {
        let value = match base.remove(key.get_ref().as_ref()) {
            Some(before) => deeply(before, value),
            None => value,
        };
        base.insert(key, value);
    }
    Spanned::new(span, DeValue::Table(base))
}

/// The parameters of a scenario by their names, and where their values come from.
#[derive(Debug, Default)]
pub(super) struct Parameters<'t>(BTreeMap<String, (DeValue<'t>, Put)>);

impl<'t> Parameters<'t> {
    /// Those of the tables, with the values that are given.
    pub(super) fn read(
        root: &DeTable<'t>,
        given: &'t [(String, String)],
        problems: &mut Problems<'_>,
    ) -> Self {
        let mut all = BTreeMap::new();
        let table = root
            .get("parameters")
            .and_then(|given| given.get_ref().as_table());
        for (name, value) in table.into_iter().flatten() {
            let _ = problems.take(name.span(), check_name(name.get_ref()));
            match value.get_ref() {
                DeValue::Array(_) | DeValue::Table(_) | DeValue::Datetime(_) => {
                    let why = "a parameter is a text, a number, true or false";
                    problems.add(value.span(), why);
                }
                given => {
                    let put = Put::At(value.span().start);
                    all.insert(name.get_ref().to_string(), (given.clone(), put));
                }
            }
        }
        for (name, text) in given {
            let flag = format!("--param {name}={text}");
            match all.get_mut(name) {
                Some(value) => *value = (plain(text), Put::Flag(flag)),
                None => {
                    let known: Vec<&str> = all.keys().map(String::as_str).collect();
                    let hint = or_allowed(name, &known);
                    let why = format!("no parameter is named `{name}`; {hint}");
                    problems.add_to_flag(flag, why);
                }
            }
        }
        Self(all)
    }

    /// Values that conditions have behind `param.`; texts are for values alone.
    pub(super) fn values(&self) -> BTreeMap<String, Reading> {
        let value = |value: &DeValue<'_>| match value {
            DeValue::Boolean(flag) => Some(Reading::Flag(*flag)),
            DeValue::Integer(_) | DeValue::Float(_) => {
                shown(value).parse().ok().map(Reading::Number)
            }
            _ => None,
        };
        let all = self.0.iter();
        all.filter_map(|(name, (given, _))| Some((name.clone(), value(given)?)))
            .collect()
    }

    /// Those that are texts, and where their values come from.
    pub(super) fn texts(&self) -> Vec<(String, Put)> {
        let texts = self.0.iter().filter(|(_, (given, _))| given.is_str());
        texts
            .map(|(name, (_, put))| (name.clone(), put.clone()))
            .collect()
    }

    /// Puts values in the place of `${name}` in all texts. Stops where they add more than
    /// [`MOST_FILLED`], which is an error of the file.
    pub(super) fn fill(&self, table: &mut DeTable<'t>, problems: &mut Problems<'_>) {
        let mut left = MOST_FILLED;
        if let Err(at) = self.fill_table(table, &mut left, problems) {
            let why = format!("parameters add more than {MOST_FILLED} bytes to the file");
            problems.add(at, &why);
        }
    }

    /// Fails with the place at which more than `left` bytes would be added.
    fn fill_table(
        &self,
        table: &mut DeTable<'t>,
        left: &mut usize,
        problems: &mut Problems<'_>,
    ) -> Result<(), Range<usize>> {
        for (_, value) in table.iter_mut() {
            self.fill_value(value, left, problems)?;
        }
        Ok(())
    }

    fn fill_value(
        &self,
        value: &mut Spanned<DeValue<'t>>,
        left: &mut usize,
        problems: &mut Problems<'_>,
    ) -> Result<(), Range<usize>> {
        let span = value.span();
        match value.get_mut() {
            DeValue::Table(table) => self.fill_table(table, left, problems)?,
            DeValue::Array(values) => {
                for value in values.iter_mut() {
                    self.fill_value(value, left, problems)?;
                }
            }
            DeValue::String(text) if text.contains("${") => match self.filled(text, left) {
                Ok(None) => return Err(span),
                Ok(Some((filled, put, is_whole))) => {
                    match is_whole {
                        true => problems.comes_from(span.start, put),
                        false => problems.comes_partly_from(span.start, put),
                    }
                    *value.get_mut() = filled;
                }
                Err(why) => problems.add(span, &why),
            },
            _ => {}
        }
        Ok(())
    }

    /// A text that is one parameter has its value, be it a number; others get texts put in. Says as well
    /// where the value, or the last of these texts, comes from, and which of both it is; `None` if more
    /// than `left` bytes would be put in.
    fn filled(
        &self,
        text: &str,
        left: &mut usize,
    ) -> Result<Option<(DeValue<'t>, Put, bool)>, String> {
        let mut filled = String::new();
        let mut rest = text;
        let mut from = None;
        while let Some((before, behind)) = rest.split_once("${") {
            let (name, after) = behind
                .split_once('}')
                .ok_or("`${` begins the name of a parameter, and `}` has to end it")?;
            let (value, put) = self.0.get(name).ok_or_else(|| {
                let known: Vec<&str> = self.0.keys().map(String::as_str).collect();
                let hint = or_allowed(name, &known);
                format!("no parameter is named `{name}`; {hint}")
            })?;
            let put_in = shown(value);
            let Some(rest_of_left) = left.checked_sub(put_in.len()) else {
                return Ok(None);
            };
            *left = rest_of_left;
            if before.is_empty() && after.is_empty() && filled.is_empty() {
                return Ok(Some((value.clone(), put.clone(), true)));
            }
            filled += before;
            filled += &put_in;
            from = Some(put);
            rest = after;
        }
        filled += rest;
        let from = from.cloned().ok_or("it names no parameter")?;
        Ok(Some((DeValue::String(filled.into()), from, false)))
    }
}

/// A value as a flag gives it: TOML, or else a text.
fn plain(text: &str) -> DeValue<'_> {
    match DeValue::parse(text).map(Spanned::into_inner) {
        Ok(value @ (DeValue::Integer(_) | DeValue::Float(_) | DeValue::Boolean(_))) => value,
        Ok(DeValue::String(text)) => DeValue::String(text),
        _ => DeValue::String(text.into()),
    }
}

fn shown(value: &DeValue<'_>) -> String {
    match value {
        DeValue::String(text) => text.to_string(),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or_else(|_| number.as_str().to_owned(), |number| number.to_string()),
        DeValue::Float(number) => number.as_str().to_owned(),
        DeValue::Boolean(flag) => flag.to_string(),
        DeValue::Datetime(_) | DeValue::Array(_) | DeValue::Table(_) => String::new(),
    }
}
