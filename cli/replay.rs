//! The `replay` subcommand: a trace is played again.

use std::path::Path;

use sim_core::device::Devices;
use sim_runner::trace::ReplayError;

use crate::exit::{Exit, Failure};
use crate::print::print;
use crate::recording;

/// Plays the trace in simulated time and compares.
pub(crate) fn replay(devices: Devices, path: &Path) -> Result<Exit, Failure> {
    match recording::compare(devices, path)? {
        Ok(()) => print("the devices did the same to the last byte"),
        Err(error) => not_the_same(error),
    }
}

/// Says why a recording could not be repeated.
pub(crate) fn not_the_same(error: ReplayError) -> Result<Exit, Failure> {
    match error {
        ReplayError::Differs(_) => {
            print(&format!("FAILED: {error}"))?;
            Ok(Exit::Failed)
        }
        ReplayError::Malformed { .. } => Err(Failure::usage(error)),
        _ => Err(Failure::system(error)),
    }
}
