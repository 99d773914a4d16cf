//! Whole documents: the repository's scenario, rig and world files with something changed in them. They
//! are refused in words, or played: what is simulated is finite, the run ends with a verdict in its time,
//! the same again is the same, and so is its recording.
//!
//! A change drops, doubles or swaps parts, or puts something in the place of a value: what stands at
//! the same key in another document, an end of its range, a setting, a fault, a condition, or a value
//! that no reader expects. A key that is added to a schema has to stand in one of the documents, so
//! that it is changed, too; a test says so.

pub mod corpus;

use std::time::Duration;

use arbitrary::{Result, Unstructured};
use rigsim_runner::trace::Replay;
use toml::{Table, Value};

use crate::text;
use corpus::{Family, Kind, merge};

/// Most simulated time of most runs; one in eight is played to its end.
const MOST_TIME: Duration = Duration::from_millis(2500);

/// Plays a scenario, rig or world file, as the first byte says.
pub fn play(choices: &[u8]) {
    let (first, rest) = choices.split_first().unwrap_or((&0, &[]));
    match first % 8 {
        0 => text::world(&text(Kind::World, rest)),
        1 => text::rig(&text(Kind::Rig, rest)),
        2 => drop(scenario(&text(Kind::Scenario, rest), Duration::MAX)),
        _ => drop(scenario(&text(Kind::Scenario, rest), MOST_TIME)),
    }
}

/// Plays a scenario file, for no longer than this. Returns `true` if it was neither refused nor given up.
#[must_use]
pub fn scenario(text: &str, most: Duration) -> bool {
    let Some(scenario) = text::parse(text) else {
        return false;
    };
    let Some(lines) = text::play(&scenario, most) else {
        return false;
    };
    let again = text::play(&scenario, most);
    assert_eq!(again.as_ref(), Some(&lines), "another run of\n{text}");
    let same = Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str));
    assert_eq!(same, Ok(()), "the recording of\n{text}");
    true
}

/// The text of a document of this kind.
#[must_use]
pub fn text(kind: Kind, choices: &[u8]) -> String {
    let mut choices = Unstructured::new(choices);
    let document = mutant(Family::all(kind), &mut choices);
    let document = document.unwrap_or_else(|error| panic!("{error}"));
    toml::to_string(&document).unwrap_or_else(|error| panic!("{error}"))
}

fn mutant(families: &[Family], choices: &mut Unstructured<'_>) -> Result<Value> {
    let family = choices.choose(families)?;
    let mut document = Value::Table(choices.choose(&family.documents)?.clone());
    for _ in 0..choices.int_in_range(0..=5)? {
        // What is empty has nothing to be changed.
        let mut number = choices.int_in_range(0..=holders(&document).saturating_sub(1))?;
        match holder(&mut document, "", &mut number) {
            Some((Value::Table(table), key)) => change_table(table, key, family, choices)?,
            Some((Value::Array(list), key)) => change_list(list, key, family, choices)?,
            _ => {}
        }
    }
    Ok(document)
}

/// The number of tables and lists, the value itself included, in which something stands.
fn holders(value: &Value) -> usize {
    match value {
        Value::Table(table) if !table.is_empty() => 1 + table.values().map(holders).sum::<usize>(),
        Value::Array(list) if !list.is_empty() => 1 + list.iter().map(holders).sum::<usize>(),
        _ => 0,
    }
}

/// The one with this number, and the key at which it stands.
fn holder<'v>(
    value: &'v mut Value,
    key: &'v str,
    number: &mut usize,
) -> Option<(&'v mut Value, &'v str)> {
    if holders(value) == 0 {
        return None;
    }
    let Some(left) = number.checked_sub(1) else {
        return Some((value, key));
    };
    *number = left;
    match value {
        Value::Table(table) => table
            .iter_mut()
            .find_map(|(key, value)| holder(value, key, number)),
        Value::Array(list) => list.iter_mut().find_map(|value| holder(value, key, number)),
        _ => None,
    }
}

fn change_table(
    table: &mut Table,
    key: &str,
    family: &Family,
    choices: &mut Unstructured<'_>,
) -> Result<()> {
    let keys: Vec<String> = table.keys().cloned().collect();
    let inner = choices.choose(&keys)?;
    match choices.int_in_range(0..=15)? {
        0 => drop(table.remove(inner)),
        1 => drop(table.insert("what_is_this".to_owned(), odd(choices)?)),
        _ => {
            if let Some(value) = table.get_mut(inner) {
                change(value, &format!("{key}.{inner}"), family, choices)?;
            }
        }
    }
    Ok(())
}

fn change_list(
    list: &mut Vec<Value>,
    key: &str,
    family: &Family,
    choices: &mut Unstructured<'_>,
) -> Result<()> {
    let at = choices.choose_index(list.len())?;
    match choices.int_in_range(0..=7)? {
        0 => drop(list.remove(at)),
        1 => list.insert(at, list[at].clone()),
        2 => {
            let other = choices.choose_index(list.len())?;
            list.swap(at, other);
        }
        _ => change(&mut list[at], &format!("{key}[]"), family, choices)?,
    }
    Ok(())
}

/// Changes the value at a place.
fn change(
    value: &mut Value,
    place: &str,
    family: &Family,
    choices: &mut Unstructured<'_>,
) -> Result<()> {
    let way = choices.int_in_range(0..=15)?;
    let other = match family.values(place) {
        [] => return Ok(()),
        values => choices.choose(values)?.clone(),
    };
    match (way, &mut *value, other) {
        (0, ..) => *value = odd(choices)?,
        // Something of the other one is taken over.
        (1..6, Value::Table(own), Value::Table(other)) if !other.is_empty() => {
            let at = choices.choose_index(other.len())?;
            merge(own, other.into_iter().skip(at).take(1).collect());
        }
        (1..6, Value::String(own), Value::String(other)) if is_condition(place) => {
            let operator = choices.choose(&["&&", "||", "==", "<", "? true :", "+"])?;
            *own = format!("({own}) {operator} ({other})");
        }
        (_, value, other) => *value = other,
    }
    Ok(())
}

fn is_condition(place: &str) -> bool {
    let (_, key) = place.split_once('.').unwrap_or_default();
    ["when", "that", "then", "whenever"].contains(&key) || place == "step.until"
}

/// A value that no reader expects.
fn odd(choices: &mut Unstructured<'_>) -> Result<Value> {
    Ok(match choices.int_in_range(0..=15)? {
        0 => Value::from(""),
        1 => Value::from("x".repeat(100_000)),
        2 => Value::from(-1),
        3 => Value::from(i64::MAX),
        4 => Value::from(i64::MIN),
        5 => Value::from(f64::NAN),
        6 => Value::from(f64::INFINITY),
        7 => Value::from(1e308),
        8 => Value::from(true),
        9 => Value::Array(Vec::new()),
        10 => Value::Table(Table::new()),
        11 => Value::from("1e400 m"),
        12 => Value::from("-5 s"),
        13 => Value::from("\u{0}\u{1F600}"),
        14 => Value::Array(vec![Value::from(0); 1000]),
        _ => "1979-05-27".parse().map_or(Value::from(0), Value::Datetime),
    })
}
