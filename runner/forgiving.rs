//! Reads what is partly wrong, so that all that is wrong is reported at once.

use rigsim_settings::{Part, ReadError, Wrong, read as read_value};
use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::problems::Problems;

/// Values put where something is missing that must be there, so that the rest can be read.
const INSTEAD: [(&str, &str); 7] = [
    ("schema", "1"),
    ("title", "''"),
    ("good_client", "''"),
    ("limit", "'1 h'"),
    ("that", "'false'"),
    ("then", "'false'"),
    ("within", "'1 h'"),
];

/// Most parts that are left out before the rest is given up.
const MOST_TRIES: u32 = 50;

/// Parts that could not be read and were left out.
#[derive(Debug, Default)]
pub(crate) struct LeftOut(Vec<Vec<Part>>);

impl LeftOut {
    /// Returns whether nothing was left out.
    pub(crate) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Returns whether an element of a list, by where it begins, was read as it is.
    pub(crate) fn is_whole(&self, element: usize) -> bool {
        let element = Part::Element(element);
        !self.0.iter().any(|path| path.contains(&element))
    }

    /// Returns whether any of these keys of an element was left out.
    pub(crate) fn lacks(&self, element: usize, keys: &[&str]) -> bool {
        let mut ends = self.0.iter().map(|path| match path.as_slice() {
            [.., Part::Element(own), Part::Key(key)] => (*own, key.as_str()),
            _ => (usize::MAX, ""),
        });
        ends.any(|(own, key)| own == element && keys.contains(&key))
    }

    /// Returns whether something in the value of a key of an element was left out.
    pub(crate) fn is_cut(&self, element: usize, key: &str) -> bool {
        let parts = [Part::Element(element), Part::Key(key.to_owned())];
        let mut paths = self.0.iter();
        paths.any(|path| path.windows(2).any(|pair| pair == parts))
    }

    /// Returns whether a key in or below a table was left out.
    fn has(&self, table: &[Part], name: &str) -> bool {
        let is_named = |part: Option<&Part>| matches!(part, Some(Part::Key(key)) if key == name);
        let mut paths = self.0.iter();
        paths.any(|path| path.starts_with(table) && is_named(path.last()))
    }
}

/// Reads the table that a file is, and leaves out of it what cannot be read, which is reported.
pub(crate) fn read_table<T: DeserializeOwned>(
    table: &mut DeTable<'_>,
    left_out: &mut LeftOut,
    problems: &mut Problems<'_>,
) -> Option<T> {
    let mut root = Spanned::new(0..0, DeValue::Table(std::mem::take(table)));
    let document = read(&mut root, left_out, problems, &read_value);
    if let DeValue::Table(rest) = root.into_inner() {
        *table = rest;
    }
    document
}

/// Reads a value. What cannot be read of it is reported and left out; `None` if too little is left.
pub(crate) fn read<T>(
    value: &mut Spanned<DeValue<'_>>,
    left_out: &mut LeftOut,
    problems: &mut Problems<'_>,
    read: &dyn Fn(&Spanned<DeValue<'_>>) -> Result<T, ReadError>,
) -> Option<T> {
    for _ in 0..MOST_TRIES {
        let ReadError { mut path, at, why } = match read(value) {
            Ok(read) => return Some(read),
            Err(error) => error,
        };
        let missing = match &why {
            Wrong::MissingKey(key) => Some(key.clone()),
            _ => None,
        };
        // What was reported and left out is not reported to be missing.
        if !missing.as_ref().is_some_and(|key| left_out.has(&path, key)) {
            problems.wrong(at.unwrap_or_else(|| value.span()).start, why);
        }
        if let Some(key) = missing.filter(|key| put_instead(value, &path, key)) {
            path.push(Part::Key(key));
            left_out.0.push(path);
            continue;
        }
        // What has nothing left says no more.
        while let Some((_, parent)) = path.split_last()
            && find(value, parent).is_some_and(|parent| parts_of(parent) == 1)
        {
            path.pop();
        }
        let removed = remove(value, &path);
        left_out.0.push(path);
        if !removed {
            return None;
        }
    }
    None
}

/// The number of keys of a table, or of tables of a list.
fn parts_of(value: &Spanned<DeValue<'_>>) -> usize {
    match value.get_ref() {
        DeValue::Table(table) => table.len(),
        DeValue::Array(values) => {
            let tables = values.iter().filter(|value| value.get_ref().is_table());
            tables.count()
        }
        _ => 0,
    }
}

/// Takes the end of a way out of what it is in.
fn remove(value: &mut Spanned<DeValue<'_>>, path: &[Part]) -> bool {
    let Some((last, parent)) = path.split_last() else {
        return false;
    };
    let parent = find(value, parent).map(Spanned::get_mut);
    match (last, parent) {
        (Part::Key(key), Some(DeValue::Table(table))) => table.remove(key.as_str()).is_some(),
        (Part::Element(start), Some(DeValue::Array(values))) => {
            let rest = values.iter().filter(|value| value.span().start != *start);
            *values = rest.cloned().collect();
            true
        }
        _ => false,
    }
}

/// Puts something where a key of a table must be, if that is known.
fn put_instead(value: &mut Spanned<DeValue<'_>>, table: &[Part], name: &str) -> bool {
    let instead = INSTEAD.iter().find(|(known, _)| *known == name);
    let value = find(value, table).map(Spanned::get_mut);
    if let (Some((_, text)), Some(DeValue::Table(table))) = (instead, value)
        && !table.contains_key(name)
        && let Ok(text) = DeValue::parse(text)
    {
        let text: Spanned<DeValue<'_>> = text;
        table.insert(Spanned::new(0..0, name.to_owned().into()), text);
        return true;
    }
    false
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
