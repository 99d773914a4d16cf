//! The `replay` subcommand: a trace is played again.

use std::fs;
use std::io::{BufRead as _, BufReader, ErrorKind, Read as _};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use sim_core::device::Devices;
use sim_runner::trace::{Replay, ReplayError};

use crate::exit::{Exit, Failure};
use crate::print::print;

/// Most bytes of a line of a trace; the first holds the scenario and its world.
const MOST_LINE: u64 = 16 << 20;

/// Plays the trace in simulated time and compares.
pub(crate) fn replay(devices: Devices, path: &Path) -> Result<Exit, Failure> {
    let shown = path.display();
    let file = fs::File::open(path)
        .with_context(|| format!("cannot read the trace {shown}"))
        .map_err(Failure::usage)?;
    let mut replay: Option<Replay> = None;
    let mut file = BufReader::new(file);
    let mut line = String::new();
    loop {
        line.clear();
        // What is no trace may be one line without an end.
        let read = file.by_ref().take(MOST_LINE + 1).read_line(&mut line);
        let read = read.map_err(|error| {
            let is_text = error.kind() != ErrorKind::InvalidData;
            let told = anyhow!(error).context(format!("cannot read the trace {shown}"));
            if is_text {
                Failure::system(told)
            } else {
                Failure::usage(told)
            }
        })?;
        if read == 0 {
            break;
        }
        if read as u64 > MOST_LINE {
            let why = anyhow!("{shown} is no trace: a line of it is too long");
            return Err(Failure::usage(why));
        }
        let line = line.trim_end_matches(['\r', '\n']);
        let outcome = match &mut replay {
            None => Replay::begin(devices, line).map(|begun| replay = Some(begun)),
            Some(replay) => replay.line(line),
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
