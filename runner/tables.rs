//! The tables of a file with the places of their keys, for what each device reads by itself.

use rigsim_settings::Part;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

/// A file's tables.
pub(crate) struct Tables<'t>(pub DeTable<'t>);

impl<'t> Tables<'t> {
    /// The table with this name.
    pub(crate) fn table(&self, name: &str) -> Option<&DeTable<'t>> {
        table(&self.0, name)
    }

    /// A table of the list with this name.
    pub(crate) fn of(&self, list: &str, index: usize) -> Option<&DeTable<'t>> {
        let DeValue::Array(tables) = self.0.get(list)?.get_ref() else {
            return None;
        };
        match tables.get(index)?.get_ref() {
            DeValue::Table(table) => Some(table),
            _ => None,
        }
    }
}

/// The table with this name in another one.
pub(crate) fn table<'d, 't>(parent: &'d DeTable<'t>, name: &str) -> Option<&'d DeTable<'t>> {
    match parent.get(name)?.get_ref() {
        DeValue::Table(table) => Some(table),
        _ => None,
    }
}

/// Name of a word or a table with one key: `unlock`, or `press` of `{ press = "left" }`.
pub(crate) fn name_of<'d>(value: &'d Spanned<DeValue<'_>>) -> Option<&'d str> {
    match value.get_ref() {
        DeValue::String(word) => Some(word),
        DeValue::Table(table) if table.len() == 1 => {
            table.keys().next().map(|key| key.get_ref().as_ref())
        }
        _ => None,
    }
}

/// Finds what is at the end of a way.
pub(crate) fn find<'v, 't>(
    value: &'v mut Spanned<DeValue<'t>>,
    path: &[Part],
) -> Option<&'v mut Spanned<DeValue<'t>>> {
    let Some((part, rest)) = path.split_first() else {
        return Some(value);
    };
    let inner = match (part, value.get_mut()) {
        (Part::Key(key), DeValue::Table(table)) => table.get_mut(key.as_str())?,
        (Part::Element(start), DeValue::Array(values)) => {
            let mut values = values.iter_mut();
            values.find(|value| value.span().start == *start)?
        }
        _ => return None,
    };
    find(inner, rest)
}
