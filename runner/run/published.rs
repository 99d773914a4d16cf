//! Numbers that a client publishes: what it believes, beside the truth.

use std::collections::BTreeMap;

use rigsim_core::SimTime;
use rigsim_core::line::LineEvent;

use super::agenda::Item;
use super::record::Record;
use super::{NANOSECOND, Run, RunError};
use crate::condition::CLIENT;

/// Most bytes of a published line.
pub const MOST_LINE: usize = 256;
/// Most names that are published in a run.
const MOST_NAMES: usize = 64;
/// Most lines that are read in a second of simulated time.
const MOST_LINES: u32 = 1000;

/// Reason for which a published line is not used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, thiserror::Error)]
#[error("{0}")]
pub struct PublishError(&'static str);

const TOO_LONG: PublishError = PublishError("it has more than 256 bytes");
const UNREADABLE: PublishError =
    PublishError("wanted: numbers by name, as in `x=1.2 y=0.4` or {\"x\": 1.2, \"y\": 0.4}");
const BAD_NAME: PublishError = PublishError(
    "a name has up to 40 lower-case letters, digits and _, begins with a letter, and is unlike the \
     names that the device has behind `client.`",
);
const TOO_MANY_NAMES: PublishError = PublishError("at most 64 names can be published");
const TOO_MANY_LINES: PublishError =
    PublishError("more than 1000 lines came within a second; the rest is not read");

/// Pace at which clients publish.
#[derive(Debug, Default)]
pub(super) struct Published {
    /// The second of simulated time in which the last line came, and the number of lines in it.
    second: u64,
    lines: u32,
}

impl Run {
    /// The client publishes numbers: `x=1.2 y=0.4`, or an object as JSON. Conditions know them as
    /// `client.x` and `client.y` from then on. A line that is not used changes nothing and is the
    /// event `bad_publication`; of lines that are too many, only the first of each second.
    ///
    /// # Errors
    /// When the simulation cannot go on. Within that, says why the line is not used.
    pub fn publish(
        &mut self,
        now: SimTime,
        line: &str,
    ) -> Result<Result<(), PublishError>, RunError> {
        let second = now.max(self.situation.rig.now() + NANOSECOND).as_nanos() / 1_000_000_000;
        if self.published.second != second {
            (self.published.second, self.published.lines) = (second, 0);
        }
        if self.published.lines > MOST_LINES {
            return Ok(Err(TOO_MANY_LINES));
        }
        let Some(at) = self.go_before(now)? else {
            return Ok(Ok(()));
        };
        self.published.lines += 1;
        let values = match self.published.lines {
            ..=MOST_LINES => self.read_published(line),
            _ => Err(TOO_MANY_LINES),
        };
        self.record(|| Record::Publish {
            t: at.as_nanos(),
            line: line.chars().take(MOST_LINE + 1).collect(),
        });
        let port = self.ports.ids.first().copied();
        let used = values.map(|values| self.situation.published.extend(values));
        self.agenda.plan(at, Item::Judge);
        self.instant(at, |rig| {
            if let (Err(PublishError(why)), Some(port)) = (used, port) {
                rig.emit_line_event(port, LineEvent::BadPublication { why });
            }
        })?;
        Ok(used)
    }

    /// The numbers of a line, by their names in conditions.
    fn read_published(&self, line: &str) -> Result<Vec<(String, f64)>, PublishError> {
        if line.len() > MOST_LINE {
            return Err(TOO_LONG);
        }
        let values = numbers(line.trim()).filter(|values| !values.is_empty());
        let values: Vec<(String, f64)> = values
            .ok_or(UNREADABLE)?
            .into_iter()
            .map(|(name, value)| (format!("{CLIENT}{name}"), value))
            .collect();
        let known = &self.situation.published;
        let mut new: Vec<&str> = values.iter().map(|(name, _)| name.as_str()).collect();
        new.retain(|name| !known.contains_key(*name));
        new.sort_unstable();
        new.dedup();
        if !self.in_scope(|scope| new.iter().all(|name| scope.is_publishable(name))) {
            return Err(BAD_NAME);
        }
        if known.len() + new.len() > MOST_NAMES {
            return Err(TOO_MANY_NAMES);
        }
        Ok(values)
    }
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
