//! Documents of choices are refused in words, or played to their end: what is simulated is finite,
//! the run ends with a verdict in its time, the same again is the same, and so is its recording.

use std::sync::Arc;

use sim_core::settings::SimSettings;
use sim_runner::trace::{Record, Replay};
use sim_runner::{Run, RunError, RunOptions, Scenario};
use sim_settings::Source;

use crate::session::truth;
use crate::text;

/// Fate of a document.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Became {
    /// It was refused, or could not be played on, and said why.
    Refused,
    /// It was played.
    Played,
}

/// Writes a scenario, rig or world file, as the first byte says, and plays it.
pub fn any(choices: &[u8]) {
    let (first, rest) = choices.split_first().unwrap_or((&0, &[]));
    match first % 4 {
        0 => text::world(&super::world(rest)),
        1 => text::rig(&super::rig(rest)),
        _ => {
            let _ = scenario(rest);
        }
    }
}

/// Writes a scenario file and plays it.
#[must_use]
pub fn scenario(choices: &[u8]) -> Became {
    let text = super::scenario(choices);
    let source = Source {
        file: "scenario.toml",
        text: &text,
    };
    let scenario = match Scenario::parse(source, &SimSettings::new(sim_core::SHIPPED)) {
        Ok(scenario) => Arc::new(scenario),
        Err(error) => {
            text::is_told(&error.to_string());
            return Became::Refused;
        }
    };
    let lines = match play(&scenario) {
        Ok(lines) => lines,
        Err(error) => {
            text::goes_on(&error);
            return Became::Refused;
        }
    };
    let again = play(&scenario).map_err(|error| error.to_string());
    assert_eq!(again.as_ref(), Ok(&lines), "another run of\n{text}");
    let same = Replay::all(sim_core::SHIPPED, lines.iter().map(String::as_str));
    assert_eq!(same, Ok(()), "the recording of\n{text}");
    Became::Played
}

/// Plays to the end, and gives the trace.
fn play(scenario: &Arc<Scenario>) -> Result<Vec<String>, RunError> {
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(Arc::clone(scenario), None, options)?;
    let mut lines = Vec::new();
    let outcome = run.play(&mut |line| lines.push(line.to_owned()))?.clone();
    assert!(outcome.ended_at.since(sim_core::SimTime::ZERO) <= scenario.limit);
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
