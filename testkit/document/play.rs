//! Mutated documents are refused in words, or played: what is simulated is finite, the run ends with a
//! verdict in its time, the same again is the same, and so is its recording.

use std::sync::Arc;
use std::time::Duration;

use rigsim_core::settings::SimSettings;
use rigsim_runner::trace::{Record, Replay};
use rigsim_runner::{Run, RunError, RunOptions, Scenario};
use rigsim_settings::Source;

use super::corpus::Kind;
use crate::session::truth;
use crate::text;

/// Most simulated time of most runs; one in eight is played to its end.
const MOST_TIME: Duration = Duration::from_millis(2500);

/// Fate of a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Became {
    /// It was refused, or could not be played on, and said why.
    Refused,
    /// It was played.
    Played,
}

/// Plays a scenario, rig or world file, as the first byte says.
pub fn any(choices: &[u8]) {
    let (first, rest) = choices.split_first().unwrap_or((&0, &[]));
    match first % 8 {
        0 => text::world(&super::text(Kind::World, rest)),
        1 => text::rig(&super::text(Kind::Rig, rest)),
        2 => drop(scenario(&super::text(Kind::Scenario, rest), Duration::MAX)),
        _ => drop(scenario(&super::text(Kind::Scenario, rest), MOST_TIME)),
    }
}

/// Plays a scenario file, for no longer than this.
#[must_use]
pub fn scenario(text: &str, most: Duration) -> Became {
    let source = Source {
        file: "scenario.toml",
        text,
    };
    let scenario = match Scenario::parse(source, &SimSettings::new(rigsim_core::SHIPPED)) {
        Ok(scenario) => Arc::new(scenario),
        Err(error) => {
            text::is_reported(&error.to_string());
            return Became::Refused;
        }
    };
    let lines = match play(&scenario, most) {
        Ok(lines) => lines,
        Err(error) => {
            text::goes_on(&error);
            return Became::Refused;
        }
    };
    let again = play(&scenario, most).map_err(|error| error.to_string());
    assert_eq!(again.as_ref(), Ok(&lines), "another run of\n{text}");
    let same = Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str));
    assert_eq!(same, Ok(()), "the recording of\n{text}");
    Became::Played
}

/// Plays for so long, and returns the trace.
fn play(scenario: &Arc<Scenario>, most: Duration) -> Result<Vec<String>, RunError> {
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(Arc::clone(scenario), None, options)?;
    let mut lines = Vec::new();
    run.advance(rigsim_core::SimTime::ZERO + scenario.limit.min(most))?;
    let outcome = run.end().clone();
    lines.extend(std::iter::from_fn(|| run.poll_trace()));
    assert!(outcome.ended_at.since(rigsim_core::SimTime::ZERO) <= scenario.limit);
    assert_eq!(outcome.passed, outcome.failures.is_empty());
    for failure in &outcome.failures {
        // It may say what the file wants it to say.
        let length = failure.to_string().len();
        assert!(0 < length && length < 20_000 + scenario.text.len());
    }
    for device in 0..run.rig().devices() {
        let numbers = truth(run.rig(), device);
        assert!(
            numbers.iter().all(|number| number.is_finite()),
            "{numbers:?}"
        );
    }
    for line in &lines {
        // A number that is not finite could not be read back.
        let read: Result<Record, _> = serde_json::from_str(line);
        assert!(read.is_ok(), "{line}: {read:?}");
    }
    Ok(lines)
}
