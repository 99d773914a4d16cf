//! The `schema` subcommand: JSON Schemas of the files that users write, for their editors.

use std::io::Write as _;

use anyhow::anyhow;
use clap::ValueEnum;
use sim_core::device::Devices;
use sim_physics::WorldMap;
use sim_runner::{RigPlan, Scenario};

use crate::exit::{Exit, Failure};

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FileKind {
    /// Files that `--world` reads.
    World,
    /// Files that `--rig` reads.
    Rig,
    /// Files that `sim run` reads.
    Scenario,
}

pub(crate) fn print(devices: Devices, kind: FileKind) -> Result<Exit, Failure> {
    let text = match kind {
        FileKind::World => WorldMap::json_schema(),
        FileKind::Rig => RigPlan::json_schema(devices),
        FileKind::Scenario => Scenario::json_schema(devices),
    };
    match anstream::stdout().write_all(text.as_bytes()) {
        // The reader may have seen enough, as `head` does.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => Err(Failure::system(
            anyhow!(error).context("cannot print the schema"),
        )),
        _ => Ok(Exit::Clean),
    }
}
