//! A scenario played two times, which must be the same.

use std::fs;
use std::path::Path;
use std::sync::atomic::AtomicBool;

use anyhow::Context as _;

use crate::exit::Failure;

use super::case::{Case, CaseResult, Verdict};
use super::{folder, lockstep, tell};

/// Beginning of the failure of two runs that are not the same.
pub(crate) const DIFFERS: &str = "the second run differs";
/// Compared files: the ends of the files' names, and what is in them.
const COMPARED: [(&str, &str); 2] = [("trace.jsonl", "trace"), ("client.log", "client's output")];

/// Plays it two times; a difference fails it. The files that stay are those of the second.
pub(crate) fn play(case: &Case<'_>, stop: &AtomicBool) -> Result<CaseResult, Failure> {
    let scratch = folder::scratch().map_err(Failure::system)?;
    let asked = case;
    let mut case = asked.clone();
    if case.output.is_none() {
        case.output = Some(scratch.path());
    }
    let first = lockstep::play(&case, stop)?;
    if first.played.is_none() {
        return Ok(first);
    }
    let before = COMPARED.map(|(end, _)| contents(&case, end));
    let mut second = lockstep::play(&case, stop)?;
    let Some(played) = &mut second.played else {
        return Ok(second);
    };
    if let (Some(from), Some(to)) = (case.recording(), asked.recording())
        && from != to
    {
        let copied = fs::copy(&from, &to).context("cannot keep the trace");
        copied.map_err(Failure::system)?;
    }
    for ((end, what), before) in COMPARED.into_iter().zip(before) {
        let (before, after) = (before?, contents(&case, end)?);
        if let Some(difference) = difference(what, &before, &after) {
            played.outcome.fail(difference);
            second.verdict = Verdict::Failed;
            break;
        }
    }
    Ok(second)
}

fn contents(case: &Case<'_>, end: &str) -> Result<Vec<u8>, Failure> {
    let path = case.file(end).unwrap_or_default();
    read(&path).map_err(Failure::system)
}

fn read(path: &Path) -> anyhow::Result<Vec<u8>> {
    fs::read(path).with_context(|| format!("cannot read {}", path.display()))
}

/// The first line that differs, for people.
fn difference(what: &str, first: &[u8], second: &[u8]) -> Option<String> {
    if first == second {
        return None;
    }
    let (first, second) = (
        String::from_utf8_lossy(first),
        String::from_utf8_lossy(second),
    );
    let (mut first, mut second) = (first.lines(), second.lines());
    let mut number = 1;
    loop {
        match (first.next(), second.next()) {
            // Only what ends a line differs, or what is not text.
            (None, None) => return Some(format!("{DIFFERS}: bytes of the {what}")),
            (one, other) if one == other => number += 1,
            (one, other) => {
                let shown =
                    |line: Option<&str>| line.map_or("(its end)".to_owned(), tell::shortened);
                return Some(format!(
                    "{DIFFERS} first in line {number} of the {what}: {}; the first has {}",
                    shown(other),
                    shown(one)
                ));
            }
        }
    }
}
