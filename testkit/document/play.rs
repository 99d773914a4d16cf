//! Mutated documents are refused in words, or played: what is simulated is finite, the run ends with a
//! verdict in its time, the same again is the same, and so is its recording.

use std::time::Duration;

use rigsim_runner::trace::Replay;

use super::corpus::Kind;
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
    let Some(scenario) = text::parse(text) else {
        return Became::Refused;
    };
    let Some(lines) = text::play(&scenario, most) else {
        return Became::Refused;
    };
    let again = text::play(&scenario, most);
    assert_eq!(again.as_ref(), Some(&lines), "another run of\n{text}");
    let same = Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str));
    assert_eq!(same, Ok(()), "the recording of\n{text}");
    Became::Played
}
