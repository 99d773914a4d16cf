//! Key of a TOML document at a place of its text.

use std::ops::Range;

use toml::de::{DeTable, DeValue};

/// The innermost key that stands at byte `at`, or whose value does, with the tables around it;
/// `None` if the text is not TOML or no key is there.
pub(crate) fn key_at(text: &str, at: usize) -> Option<String> {
    let table = DeTable::parse(text).ok()?;
    in_table(table.get_ref(), at)
}

fn in_table(table: &DeTable<'_>, at: usize) -> Option<String> {
    let holds = |span: Range<usize>| span.contains(&at);
    let mut outer = None;
    for (name, value) in table {
        let inner = match value.get_ref() {
            DeValue::Table(inner) => in_table(inner, at),
            DeValue::Array(values) => values.iter().find_map(|value| match value.get_ref() {
                DeValue::Table(inner) => in_table(inner, at),
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

#[cfg(test)]
mod tests;
