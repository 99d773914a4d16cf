//! Reading a document although parts of it are wrong, so that all that is wrong is told at once.

use std::collections::BTreeSet;

use serde::Deserialize as _;
use toml::Spanned;
use toml::de::{DeTable, DeValue, ValueDeserializer};

use super::document::Document;
use super::problems::{MOST_ERRORS, Problems};

/// What is put where something that must be there is not, so that the rest can be looked at.
const INSTEAD: [(&str, &str); 4] = [
    ("schema", "1"),
    ("title", "''"),
    ("good_client", "''"),
    ("limit", "'1 h'"),
];

/// A document, and where its elements begin of which something could not be read.
pub(super) struct Read {
    pub document: Document,
    pub broken: BTreeSet<usize>,
}

/// Reads a document. What cannot be read is told and left out; without what must be there it is
/// none.
pub(super) fn read(root: &mut DeTable<'_>, problems: &mut Problems<'_>) -> Option<Read> {
    let mut broken = BTreeSet::new();
    let mut told = BTreeSet::new();
    for _ in 0..=MOST_ERRORS {
        let whole = Spanned::new(0..0, DeValue::Table(root.clone()));
        let error = match Document::deserialize(ValueDeserializer::from(whole)) {
            Ok(document) => return Some(Read { document, broken }),
            Err(error) => error,
        };
        let lacks = error.message().split_once("missing field `");
        let lacks = lacks.and_then(|(_, name)| name.split('`').next());
        let instead = INSTEAD.iter().find(|(name, _)| lacks == Some(*name));
        if let Some((name, value)) = instead.filter(|(name, _)| !root.contains_key(*name)) {
            if !told.contains(*name) {
                problems.read::<()>(0..0, Err(error));
            }
            let value = DeValue::parse(value).ok()?;
            root.insert(Spanned::new(0..0, (*name).into()), value);
            continue;
        }
        let at = error.span().map_or(0, |span| span.start);
        problems.read::<()>(0..0, Err(error));
        let key = key_of(root, at)?;
        told.insert(key.clone());
        let inside = root
            .get_mut(key.as_str())
            .map(|value| leave_out(value, at, &mut broken));
        if inside != Some(true) {
            root.remove(key.as_str());
        }
    }
    None
}

/// The key of a table in whose value, or at which, something is.
fn key_of(table: &DeTable<'_>, at: usize) -> Option<String> {
    let found = table.iter().find(|(key, value)| {
        key.span().contains(&at) || value.span().contains(&at) || has(value, at)
    });
    found.map(|(key, _)| key.get_ref().to_string())
}

/// Tells whether something is anywhere in a value. A table that is written in parts has no place
/// that has all of it.
fn has(value: &Spanned<DeValue<'_>>, at: usize) -> bool {
    let inside = match value.get_ref() {
        DeValue::Table(table) => key_of(table, at).is_some(),
        DeValue::Array(values) => values.iter().any(|value| has(value, at)),
        _ => false,
    };
    inside || value.span().contains(&at)
}

/// Leaves out what is wrong of one element of a list.
fn leave_out(list: &mut Spanned<DeValue<'_>>, at: usize, broken: &mut BTreeSet<usize>) -> bool {
    let DeValue::Array(elements) = list.get_mut() else {
        return false;
    };
    let Some(index) = elements.iter().position(|element| has(element, at)) else {
        return false;
    };
    let begins = elements[index].span().start;
    let element = elements.get_mut(index).map(Spanned::get_mut);
    if let Some(DeValue::Table(table)) = element
        && let Some(key) = key_of(table, at)
    {
        table.remove(key.as_str());
        broken.insert(begins);
        return true;
    }
    let rest = elements.iter().enumerate();
    let rest = rest.filter(|(other, _)| *other != index);
    *elements = rest.map(|(_, element)| element.clone()).collect();
    true
}
