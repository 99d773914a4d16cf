//! Reading what is partly wrong, so that all that is wrong is told at once.

use serde::de::DeserializeOwned;
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use crate::problems::Problems;
use crate::tables;

/// Values put where something is missing that must be there, so that the rest can be looked at.
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
/// Most parts of a table or list of which each is tried to be what is wrong.
const MOST_PARTS: usize = 100;

/// A key that is read before all others of its table, so that without it nothing else is wrong.
const TAG: &str = "kind";

/// A step on the way to a value.
#[derive(Debug, Clone, PartialEq, Eq)]
enum Part {
    Key(String),
    /// The element of a list that begins at this byte.
    Element(usize),
}

/// Parts that could not be read and were left out.
#[derive(Debug, Default)]
pub(crate) struct LeftOut(Vec<Vec<Part>>);

impl LeftOut {
    /// Tells whether an element of a list, by where it begins, was read as it is.
    pub(crate) fn is_whole(&self, element: usize) -> bool {
        let element = Part::Element(element);
        !self.0.iter().any(|path| path.contains(&element))
    }

    /// Tells whether any of these keys of an element was left out.
    pub(crate) fn lacks(&self, element: usize, keys: &[&str]) -> bool {
        let mut ends = self.0.iter().map(|path| match path.as_slice() {
            [.., Part::Element(own), Part::Key(key)] => (*own, key.as_str()),
            _ => (usize::MAX, ""),
        });
        ends.any(|(own, key)| own == element && keys.contains(&key))
    }

    /// Tells whether something in the value of a key of an element was left out.
    pub(crate) fn is_cut(&self, element: usize, key: &str) -> bool {
        let parts = [Part::Element(element), Part::Key(key.to_owned())];
        let mut paths = self.0.iter();
        paths.any(|path| path.windows(2).any(|pair| pair == parts))
    }

    /// Tells whether a key in or below a table was left out.
    fn has(&self, table: &[Part], name: &str) -> bool {
        let is_named = |part: Option<&Part>| matches!(part, Some(Part::Key(key)) if key == name);
        let mut paths = self.0.iter();
        paths.any(|path| path.starts_with(table) && is_named(path.last()))
    }
}

/// Reads the table that a file is, and leaves out of it what cannot be read, which is told.
pub(crate) fn read_table<T: DeserializeOwned>(
    table: &mut DeTable<'_>,
    left_out: &mut LeftOut,
    problems: &mut Problems<'_>,
) -> Option<T> {
    let mut root = Spanned::new(0..0, DeValue::Table(std::mem::take(table)));
    let told = read(&mut root, left_out, problems, &tables::read);
    if let DeValue::Table(rest) = root.into_inner() {
        *table = rest;
    }
    told
}

/// Reads a value. What cannot be read of it is told and left out; `None` if too little is left.
pub(crate) fn read<T>(
    value: &mut Spanned<DeValue<'_>>,
    left_out: &mut LeftOut,
    problems: &mut Problems<'_>,
    read: &dyn Fn(&Spanned<DeValue<'_>>) -> Result<T, toml::de::Error>,
) -> Option<T> {
    for _ in 0..MOST_TRIES {
        let error = match read(value) {
            Ok(read) => return Some(read),
            Err(error) => error,
        };
        let own = error.span().filter(|span| *span != (0..0));
        let own = own.map(|span| span.start);
        let mut path = own.map_or_else(Vec::new, |at| path_to(value, at));
        let known = path.len();
        let message = error.message();
        let lacks = message.split_once("missing field `");
        let lacks = lacks.and_then(|(_, name)| name.split('`').next());
        // What lacks something is a table.
        let left_alone = |value: &Spanned<DeValue<'_>>| lacks.is_some() && !has_tables(value);
        follow(value, &mut path, &left_alone, &|value| {
            read(value)
                .err()
                .is_some_and(|error| error.message() == message)
        });
        let at = match own {
            Some(own) if path.len() == known => own,
            _ => place(value, &path, message.contains("unknown field")),
        };
        // What was told and left out is not told to be missing.
        if !lacks.is_some_and(|name| left_out.has(&path, name)) {
            problems.syntax(at, &error);
        }
        if let Some(name) = lacks.filter(|name| put_instead(value, &path, name)) {
            path.push(Part::Key(name.to_owned()));
            left_out.0.push(path);
            continue;
        }
        // What has nothing left says no more.
        while let Some((_, parent)) = path.split_last()
            && parts_of(value, parent).len() == 1
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

/// The way to what stands at a byte: a key, or an element of a list that is a table.
fn path_to(value: &Spanned<DeValue<'_>>, at: usize) -> Vec<Part> {
    let (part, inner) = match value.get_ref() {
        DeValue::Table(table) => {
            let mut keys = table.iter();
            let found = keys.find(|(key, value)| key.span().contains(&at) || has(value, at));
            let Some((key, inner)) = found else {
                return Vec::new();
            };
            (Part::Key(key.get_ref().to_string()), inner)
        }
        DeValue::Array(values) => {
            let mut tables = values.iter().filter(|value| value.get_ref().is_table());
            let Some(inner) = tables.find(|value| has(value, at)) else {
                return Vec::new();
            };
            (Part::Element(inner.span().start), inner)
        }
        _ => return Vec::new(),
    };
    let mut path = vec![part];
    path.extend(path_to(inner, at));
    path
}

/// Tells whether something is anywhere in a value. A table that is written in parts has no place
/// that has all of it.
fn has(value: &Spanned<DeValue<'_>>, at: usize) -> bool {
    let inside = match value.get_ref() {
        DeValue::Table(table) => {
            let mut keys = table.iter();
            keys.any(|(key, value)| key.span().contains(&at) || has(value, at))
        }
        DeValue::Array(values) => values.iter().any(|value| has(value, at)),
        _ => false,
    };
    inside || value.span().contains(&at)
}

/// Goes on to what brings an error about of which the reader says no more than in which table it is:
/// without that it is another one, or none. Does not go on to what is `left_alone`.
fn follow(
    value: &Spanned<DeValue<'_>>,
    path: &mut Vec<Part>,
    left_alone: &dyn Fn(&Spanned<DeValue<'_>>) -> bool,
    is_the_same: &dyn Fn(&Spanned<DeValue<'_>>) -> bool,
) {
    loop {
        let mut parts = parts_of(value, path);
        if parts.len() > MOST_PARTS {
            return;
        }
        parts.sort_by_key(|part| *part == Part::Key(TAG.to_owned()));
        let brings_it_about = |part: &Part| {
            let mut without = value.clone();
            let path = [path.as_slice(), std::slice::from_ref(part)].concat();
            let is_left_alone = find(&mut without, &path).is_none_or(|value| left_alone(value));
            remove(&mut without, &path);
            !is_left_alone && !is_the_same(&without)
        };
        match parts.into_iter().find(brings_it_about) {
            Some(part) => path.push(part),
            None => return,
        }
    }
}

/// Tells whether it is a table, or a list of some.
fn has_tables(value: &Spanned<DeValue<'_>>) -> bool {
    match value.get_ref() {
        DeValue::Table(_) => true,
        DeValue::Array(values) => values.iter().any(|value| value.get_ref().is_table()),
        _ => false,
    }
}

/// The keys of a table, or the tables of a list.
fn parts_of(value: &Spanned<DeValue<'_>>, path: &[Part]) -> Vec<Part> {
    let mut value = value.clone();
    match find(&mut value, path).map(|value| value.get_ref()) {
        Some(DeValue::Table(table)) => {
            let keys = table.keys().map(|key| key.get_ref().to_string());
            keys.map(Part::Key).collect()
        }
        Some(DeValue::Array(values)) => {
            let tables = values.iter().filter(|value| value.get_ref().is_table());
            tables
                .map(|table| Part::Element(table.span().start))
                .collect()
        }
        _ => Vec::new(),
    }
}

/// Finds what is at the end of a way.
fn find<'v, 't>(
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

/// Where the end of a way stands, or its key.
fn place(value: &Spanned<DeValue<'_>>, path: &[Part], is_key: bool) -> usize {
    let mut value = value.clone();
    if let Some((Part::Key(name), table)) = path.split_last()
        && is_key
        && let Some(table) = find(&mut value, table)
        && let Some(table) = table.get_ref().as_table()
        && let Some((key, _)) = table.get_key_value(name.as_str())
    {
        return key.span().start;
    }
    let start = value.span().start;
    find(&mut value, path).map_or(start, |value| value.span().start)
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
