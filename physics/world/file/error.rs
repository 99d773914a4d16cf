//! What to tell a user whose world file was refused.

use std::ops::Range;

use sim_settings::Origin;
use toml::de::{DeTable, DeValue};

/// A world file that was refused.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{origin}: {}{why}", key.as_ref().map(|key| format!("`{key}`: ")).unwrap_or_default())]
pub struct WorldFileError {
    /// File, line and column.
    pub origin: Origin,
    /// The key with the tables around it; `None` where the file is not TOML at all.
    pub key: Option<String>,
    /// What is wrong, and what is allowed.
    pub why: String,
}

impl WorldFileError {
    pub(super) fn new(error: &toml::de::Error, text: &str, file: &str) -> Self {
        let at = error.span().map_or(0, |span| span.start);
        let before = text.get(..at).unwrap_or(text);
        let line_start = before.rfind('\n').map_or(0, |newline| newline + 1);
        let table = DeTable::parse(text).ok();
        Self {
            origin: Origin::File {
                file: file.to_owned(),
                line: before.matches('\n').count() + 1,
                column: before[line_start..].chars().count() + 1,
            },
            key: table.and_then(|table| key_at(table.get_ref(), at)),
            why: error.message().replace('\n', " "),
        }
    }
}

/// The innermost key that stands at a place of the text, or whose value does.
fn key_at(table: &DeTable<'_>, at: usize) -> Option<String> {
    let holds = |span: Range<usize>| span.contains(&at);
    let mut outer = None;
    for (name, value) in table {
        let inner = match value.get_ref() {
            DeValue::Table(inner) => key_at(inner, at),
            DeValue::Array(values) => values.iter().find_map(|value| match value.get_ref() {
                DeValue::Table(inner) => key_at(inner, at),
                _ => None,
            }),
            _ => None,
        };
        if let Some(inner) = inner {
            return Some(format!("{}.{inner}", name.get_ref()));
        }
        let in_element = match value.get_ref() {
            DeValue::Array(values) => values.iter().any(|value| holds(value.span())),
            _ => false,
        };
        if in_element || holds(name.span()) || holds(value.span()) {
            outer = Some(name.get_ref().to_string());
        }
    }
    outer
}
