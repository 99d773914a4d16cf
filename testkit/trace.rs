//! Traces: any text is replayed, or refused in words.

use rigsim_core::settings::SimSettings;
use rigsim_runner::Scenario;
use rigsim_runner::trace::{Record, Replay, ReplayError, Timed};

use crate::text::{MOST_DRIVEN, goes_on, is_reported};

/// Most simulated time of a replay, ns; what comes later is left out.
const MOST_TIME: u64 = 2_000_000_000;

/// Any text: a trace that is replayed for a while, or none.
pub fn play(text: &str) {
    let mut lines = text.lines();
    let header = lines.next().unwrap_or_default();
    if is_large(header) {
        return;
    }
    let mut replay = match Replay::begin(rigsim_core::SHIPPED, header) {
        Ok(replay) => replay,
        Err(error) => return reported(&error),
    };
    for line in lines {
        if serde_json::from_str::<Timed>(line).is_ok_and(|line| line.over() > MOST_TIME) {
            return;
        }
        if let Err(error) = replay.line(line) {
            return reported(&error);
        }
    }
    if let Err(error) = replay.finish() {
        reported(&error);
    }
}

/// Returns whether more vehicles are asked for than are driven here.
fn is_large(header: &str) -> bool {
    let Ok(Record::Header(header)) = serde_json::from_str(header) else {
        return false;
    };
    Scenario::parse(
        header.source.source(),
        &SimSettings::new(rigsim_core::SHIPPED),
    )
    .is_ok_and(|scenario| scenario.rig.devices.len() > MOST_DRIVEN)
}

fn reported(error: &ReplayError) {
    is_reported(&error.to_string());
    if let ReplayError::Run(error) = error {
        goes_on(error);
    }
}
