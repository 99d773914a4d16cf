//! Numbers that a client publishes: what it believes, beside the truth.

use std::collections::BTreeMap;

use rigsim_core::SimTime;

use crate::condition::{CLIENT, Scope};

/// Most bytes of a published line.
pub const MOST_LINE: usize = 256;
/// Most names that are published in a run.
const MOST_NAMES: usize = 64;
/// Most lines that are read in a second of simulated time.
pub(super) const MOST_LINES: u32 = 1000;

/// Reason for which a published line is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PublishError(pub(super) &'static str);

const TOO_LONG: PublishError = PublishError("it has more than 256 bytes");
const UNREADABLE: PublishError =
    PublishError("wanted: numbers by name, as in `x=1.2 y=0.4` or {\"x\": 1.2, \"y\": 0.4}");
const BAD_NAME: PublishError = PublishError(
    "a name has up to 40 lower-case letters, digits and _, begins with a letter, and is unlike the \
     names that the device has behind `client.`",
);
const TOO_MANY_NAMES: PublishError = PublishError("at most 64 names can be published");
pub(super) const TOO_MANY_LINES: PublishError =
    PublishError("more than 1000 lines came within a second; the rest is not read");

/// Pace at which clients publish.
#[derive(Debug, Default)]
pub(super) struct Published {
    /// The second of simulated time in which the last line came, and the number of lines in it.
    second: u64,
    lines: u32,
}

impl Published {
    /// Counts a line that comes at `at`; returns how many came in its second.
    pub(super) fn count(&mut self, at: SimTime) -> u32 {
        let second = at.as_nanos() / 1_000_000_000;
        if self.second != second {
            (self.second, self.lines) = (second, 0);
        }
        self.lines = self.lines.saturating_add(1);
        self.lines
    }
}

/// The numbers of a line by their names in conditions, of which some are `known` already.
pub(super) fn read(
    line: &str,
    known: &BTreeMap<String, f64>,
    scope: &Scope<'_>,
) -> Result<Vec<(String, f64)>, PublishError> {
    if line.len() > MOST_LINE {
        return Err(TOO_LONG);
    }
    let values = numbers(line.trim()).filter(|values| !values.is_empty());
    let values: Vec<(String, f64)> = values
        .ok_or(UNREADABLE)?
        .into_iter()
        .map(|(name, value)| (format!("{CLIENT}{name}"), value))
        .collect();
    let mut new: Vec<&str> = values.iter().map(|(name, _)| name.as_str()).collect();
    new.retain(|name| !known.contains_key(*name));
    new.sort_unstable();
    new.dedup();
    if !new.iter().all(|name| scope.is_publishable(name)) {
        return Err(BAD_NAME);
    }
    if known.len() + new.len() > MOST_NAMES {
        return Err(TOO_MANY_NAMES);
    }
    Ok(values)
}

/// The names that conditions have for the numbers of a published line.
pub fn published(line: &str) -> impl Iterator<Item = String> {
    let numbers = numbers(line.trim()).into_iter().flatten();
    numbers.map(|(name, _)| format!("{CLIENT}{name}"))
}

/// The numbers of a line by their names; `None` if it is something else.
fn numbers(line: &str) -> Option<Vec<(String, f64)>> {
    if line.starts_with('{') {
        let values: BTreeMap<String, f64> = serde_json::from_str(line).ok()?;
        return Some(values.into_iter().collect());
    }
    let pair = |pair: &str| {
        let (name, number) = pair.split_once('=')?;
        let number: f64 = number.parse().ok()?;
        number.is_finite().then(|| (name.to_owned(), number))
    };
    line.split_whitespace().map(pair).collect()
}
