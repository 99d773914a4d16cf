//! The `replay` subcommand: a trace is played again.

use std::fs;
use std::io::{BufRead as _, BufReader};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use sim_scenarios::trace::{Replay, ReplayError};

use crate::exit::{Exit, Failure};
use crate::print::print;

/// Plays the trace in simulated time and compares.
pub(crate) fn replay(path: &Path) -> Result<Exit, Failure> {
    let shown = path.display();
    let file = fs::File::open(path)
        .with_context(|| format!("cannot read the trace {shown}"))
        .map_err(Failure::usage)?;
    let mut replay: Option<Replay> = None;
    for line in BufReader::new(file).lines() {
        let line = line
            .with_context(|| format!("cannot read the trace {shown}"))
            .map_err(Failure::system)?;
        let outcome = match &mut replay {
            None => Replay::begin(&line).map(|begun| replay = Some(begun)),
            Some(replay) => replay.line(&line),
        };
        if let Err(error) = outcome {
            return not_the_same(error);
        }
    }
    let Some(replay) = replay else {
        return Err(Failure::usage(anyhow!("the trace {shown} is empty")));
    };
    match replay.finish() {
        Ok(()) => print("the devices did the same to the last byte"),
        Err(error) => not_the_same(error),
    }
}

fn not_the_same(error: ReplayError) -> Result<Exit, Failure> {
    match error {
        ReplayError::Differs(_) => {
            print(&format!("FAILED: {error}"))?;
            Ok(Exit::Failed)
        }
        ReplayError::Malformed { .. } => Err(Failure::usage(error)),
        ReplayError::Run(_) => Err(Failure::system(error)),
    }
}
