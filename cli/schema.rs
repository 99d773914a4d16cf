//! The `schema` subcommand: JSON Schemas of the files that users write, for their editors.

use clap::ValueEnum;
use sim_core::device::Devices;
use sim_physics::WorldMap;
use sim_runner::{RigPlan, Scenario};

use crate::exit::{Exit, Failure};
use crate::print::print;

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum FileKind {
    /// Files that `--world` reads.
    World,
    /// Files that `--rig` reads.
    Rig,
    /// Files that `sim run` reads.
    Scenario,
}

pub(crate) fn list(devices: Devices, kind: FileKind) -> Result<Exit, Failure> {
    let text = match kind {
        FileKind::World => WorldMap::json_schema(),
        FileKind::Rig => RigPlan::json_schema(devices),
        FileKind::Scenario => Scenario::json_schema(devices),
    };
    print(text.trim_end())
}
