//! Settings from TOML files and flags, and back to TOML.

use std::fmt::Write as _;

use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::error::{Origin, SettingsError, shorten};
use crate::key::key_at;
use crate::value::Value;
use crate::{Entry, Problem, Settings};

/// The most errors that one file reports.
const MOST_ERRORS: usize = 20;

/// A text and the name of the file that it comes from, so that errors can say where they are.
#[derive(Debug, Clone, Copy)]
pub struct Source<'t> {
    /// The file's name as the user gave it.
    pub file: &'t str,
    /// Content of the file.
    pub text: &'t str,
}

impl Source<'_> {
    /// Place of the byte at index `at`.
    #[must_use]
    pub fn place(&self, at: usize) -> Origin {
        let before = self.text.get(..at).unwrap_or(self.text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        Origin::File {
            file: self.file.to_owned(),
            line: before.matches('\n').count() + 1,
            column: before[line_start..].chars().count() + 1,
        }
    }

    /// The key at the byte at index `at`, or whose value is there, with the tables around it;
    /// `None` if the text is not TOML or no key is there.
    #[must_use]
    pub fn key_at(&self, at: usize) -> Option<String> {
        key_at(self.text, at)
    }

    /// The same error of the TOML parser, with its place.
    #[must_use]
    pub fn syntax(&self, error: &toml::de::Error) -> SettingsError {
        let at = error.span().map_or(0, |span| span.start);
        let why = shorten(error.message().replace('\n', " "));
        SettingsError::Syntax {
            origin: self.place(at),
            why,
        }
    }
}

/// Applies a TOML document to `settings`, whose keys are the document's dotted keys.
///
/// # Errors
/// Every refused key or value (20 at the most), each naming `file` and the line. What was not
/// refused has been applied, so use the settings only if there was no error.
pub fn load_toml(
    text: &str,
    file: &str,
    settings: &mut dyn Settings,
) -> Result<(), Vec<SettingsError>> {
    let source = Source { file, text };
    let table = DeTable::parse(text).map_err(|error| vec![source.syntax(&error)])?;
    let errors = apply_table(&|at| source.place(at), table.get_ref(), "", settings);
    match errors.is_empty() {
        true => Ok(()),
        false => Err(errors.into_iter().map(|(_, error)| error).collect()),
    }
}

/// Applies a table of a TOML document to `settings`; its keys are relative to `prefix`, and `place`
/// says where the byte with an index is. Returns what was refused, each with the byte where it stands.
pub fn apply_table(
    place: &dyn Fn(usize) -> Origin,
    table: &DeTable<'_>,
    prefix: &str,
    settings: &mut dyn Settings,
) -> Vec<(usize, SettingsError)> {
    let mut errors = Vec::new();
    walk(table, prefix, &mut |key, key_at, value| {
        if errors.len() >= MOST_ERRORS {
            return;
        }
        let plain = plain(value.get_ref());
        // A known group with nothing in it changes nothing, as a saved file may have been cut to.
        let empty = matches!(value.get_ref(), DeValue::Table(_));
        if let Err(problem) = settings.assign(key, &plain)
            && !(empty && problem == Problem::IsGroup)
        {
            let at = match problem {
                Problem::Invalid { .. } => value.span().start,
                Problem::UnknownKey | Problem::IsGroup => key_at,
            };
            errors.push((at, explain(settings, key, place(at), problem)));
        }
    });
    errors
}

/// Splits `KEY=VALUE` as a flag gives it; the value may be a TOML literal or a bare word.
///
/// # Errors
/// When there is no `=`.
pub fn parse_assignment(flag: &str, text: &str) -> Result<(String, Value), SettingsError> {
    let (key, value) = text
        .split_once('=')
        .ok_or_else(|| SettingsError::NotAnAssignment {
            origin: Origin::Flag(format!("{flag} {text}")),
        })?;
    let value = value.trim();
    let value = DeValue::parse(value).map_or_else(
        |_| Value::Text(value.to_owned()),
        |parsed| plain(parsed.get_ref()),
    );
    Ok((key.trim().to_owned(), value))
}

/// Sets one key.
///
/// # Errors
/// Names the key, the origin and the allowed values.
pub fn set(
    settings: &mut dyn Settings,
    key: &str,
    value: &Value,
    origin: Origin,
) -> Result<(), SettingsError> {
    settings
        .assign(key, value)
        .map_err(|problem| explain(settings, key, origin, problem))
}

/// The effective settings as a TOML document that [`load_toml`] takes back, each with its
/// meaning, its allowed values, and whether it is documented or assumed.
#[must_use]
pub fn show_toml(settings: &dyn Settings) -> String {
    // A group's own values may stand behind another group in it, but a table must be in one piece.
    let mut tables: Vec<(String, String)> = Vec::new();
    for entry in settings.entries() {
        let (table, name) = entry.key.rsplit_once('.').unwrap_or(("", &entry.key));
        let at = tables
            .iter()
            .position(|(known, _)| known == table)
            .unwrap_or_else(|| {
                tables.push((table.to_owned(), String::new()));
                tables.len() - 1
            });
        tables[at].1.push_str(&show_entry(&entry, name));
    }
    // The root's own values have no table to name, and must come first.
    tables.sort_by_key(|(table, _)| !table.is_empty());
    let part = |(table, text): (String, String)| match table.as_str() {
        "" => text,
        _ => format!("[{table}]\n{text}"),
    };
    let parts: Vec<String> = tables.into_iter().map(part).collect();
    parts.join("\n")
}

/// A setting under a name as TOML, with all that is known of it above, behind an empty line.
#[must_use]
pub fn show_entry(entry: &Entry, name: &str) -> String {
    let mut text = String::from("\n");
    // Writing to a string cannot fail.
    for line in entry.doc.trim().lines() {
        let _ = writeln!(text, "# {}", line.trim());
    }
    let _ = writeln!(text, "# {}: {}", entry.basis.as_str(), entry.basis.source());
    let _ = writeln!(text, "# allowed: {}", entry.allowed.words);
    if entry.value != entry.default {
        let _ = writeln!(text, "# default: {}", entry.default);
    }
    let _ = writeln!(text, "{name} = {}", entry.value);
    text
}

/// The JSON Schema of a table of these settings: each key with its meaning, its allowed values, its
/// default and whether it is documented or assumed, and no other key.
#[must_use]
pub fn schema_of(settings: &dyn Settings) -> schemars::Schema {
    let mut schema = group();
    for entry in settings.entries() {
        let mut property = entry.allowed.schema.to_value();
        let (doc, basis) = (entry.doc.replace('\n', " "), entry.basis);
        let doc = doc.split_whitespace().collect::<Vec<_>>().join(" ");
        let (allowed, basis, source) = (&entry.allowed.words, basis.as_str(), basis.source());
        property["description"] = format!("{doc} Allowed: {allowed}; {basis}: {source}").into();
        // What a setting shows as TOML is JSON too.
        if let Ok(default) = serde_json::from_str(&entry.default) {
            property["default"] = default;
        }
        let mut table = &mut schema;
        let (groups, name) = entry.key.rsplit_once('.').unwrap_or(("", &entry.key));
        for name in groups.split('.').filter(|name| !name.is_empty()) {
            let inner = &mut table["properties"][name];
            if inner.is_null() {
                *inner = group();
            }
            table = inner;
        }
        table["properties"][name] = property;
    }
    schemars::Schema::try_from(schema).unwrap_or_default()
}

fn group() -> serde_json::Value {
    serde_json::json!({"type": "object", "properties": {}, "additionalProperties": false})
}

/// Calls `leaf` with each value that is not a table with something in it, its dotted key, and
/// where the key stands.
fn walk<'t>(
    table: &'t DeTable<'_>,
    prefix: &str,
    leaf: &mut dyn FnMut(&str, usize, &'t Spanned<DeValue<'_>>),
) {
    for (name, value) in table {
        let key = crate::join(prefix, name.get_ref());
        match value.get_ref() {
            DeValue::Table(inner) if !inner.is_empty() => walk(inner, &key, leaf),
            _ => leaf(&key, name.span().start, value),
        }
    }
}

fn plain(value: &DeValue<'_>) -> Value {
    let other = |what: &'static str| Value::Other(what.into());
    match value {
        DeValue::String(text) => Value::Text(text.to_string()),
        DeValue::Integer(number) => i64::from_str_radix(number.as_str(), number.radix())
            .map_or_else(|_| other("a number too large"), Value::Integer),
        DeValue::Float(number) => number
            .as_str()
            .parse()
            .map_or_else(|_| other("a number too large"), Value::Float),
        DeValue::Boolean(flag) => Value::Bool(*flag),
        DeValue::Array(values) => Value::List(values.iter().map(|v| plain(v.get_ref())).collect()),
        DeValue::Datetime(_) => other("a date"),
        DeValue::Table(_) => other("a table"),
    }
}

fn explain(settings: &dyn Settings, key: &str, origin: Origin, problem: Problem) -> SettingsError {
    let key = shorten(key.to_owned());
    match problem {
        Problem::Invalid { why, allowed } => SettingsError::Invalid {
            origin,
            key,
            why: shorten(why),
            allowed,
        },
        Problem::IsGroup => {
            let within = |entry: &Entry| entry.key.starts_with(&format!("{key}."));
            let example = settings.entries().into_iter().find(within);
            SettingsError::IsGroup {
                origin,
                example: example.map_or_else(String::new, |entry| entry.key),
                key,
            }
        }
        Problem::UnknownKey => SettingsError::UnknownKey {
            origin,
            nearest: nearest(&key, settings.entries().into_iter().map(|entry| entry.key)),
            key,
        },
    }
}

/// Likeness from which on a word may have been meant: one wrong letter of three is a little more.
const LIKE_ENOUGH: f64 = 0.79;

/// The one of the `known` words that is most like `word`, if any is like it at all.
pub fn nearest<S: AsRef<str>>(word: &str, known: impl IntoIterator<Item = S>) -> Option<S> {
    let group = format!(".{word}");
    let likeness = |text: &str| {
        // A forgotten group in front is as common as a misspelling.
        if text.ends_with(&group) {
            1.0
        } else {
            strsim::jaro_winkler(text, word)
        }
    };
    let mut best: Option<(f64, S)> = None;
    for candidate in known {
        let likeness = likeness(candidate.as_ref());
        if likeness > LIKE_ENOUGH && best.as_ref().is_none_or(|(found, _)| likeness > *found) {
            best = Some((likeness, candidate));
        }
    }
    best.map(|(_, candidate)| candidate)
}
