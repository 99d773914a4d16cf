//! The `trace` subcommand: what a recording tells.

mod compare;
mod print;
mod values;

use rigsim_core::SimTime;
use rigsim_runner::Run;

use anyhow::anyhow;

use rigsim_core::device::Devices;

use crate::args::TraceArgs;
use crate::exit::{Exit, Failure};
use crate::export;
use crate::recording::{self, Played, not_the_same};

/// Prints a recording, or where two of them part.
pub(crate) fn trace(devices: Devices, args: &TraceArgs) -> Result<Exit, Failure> {
    if let Some(other) = &args.other {
        return compare::compare(devices, args, [&args.trace, other]);
    }
    if let Some(to) = &args.to {
        return exit(export::export(devices, &args.trace, to, args.format)?);
    }
    let (written, played) = if args.csv.is_empty() {
        let (printer, played) =
            recording::view(devices, &args.trace, |run| print::Printer::new(args, run))?;
        (printer.finish(), played)
    } else {
        let (values, played) =
            recording::view(devices, &args.trace, |run| values::Values::new(args, run))?;
        (values.finish(), played)
    };
    crate::print::written(written)?;
    exit(played)
}

fn exit(played: Played) -> Result<Exit, Failure> {
    played.map_or_else(not_the_same, |()| Ok(Exit::Clean))
}

/// A part of a recording.
#[derive(Debug, Clone)]
pub(super) struct Part {
    from: SimTime,
    until: SimTime,
    /// Indices of devices; `None` for all.
    devices: Option<Vec<usize>>,
}

impl Part {
    fn new(args: &TraceArgs, run: &Run) -> Result<Self, Failure> {
        let rig = &run.scenario().rig;
        let index = |wanted: &String| {
            let mut devices = rig.devices.iter();
            devices
                .position(|plan| plan.name == *wanted)
                .ok_or_else(|| {
                    let names = rig.devices.iter().map(|plan| plan.name.as_str());
                    let names: Vec<&str> = names.collect();
                    Failure::usage(anyhow!(
                        "--device: nothing in the trace is called `{wanted}`; allowed: {}",
                        names.join(", ")
                    ))
                })
        };
        let devices: Result<Vec<usize>, Failure> = args.device.iter().map(index).collect();
        Ok(Self {
            from: SimTime::ZERO + args.from.map_or_else(Default::default, |from| from.0),
            until: args
                .until
                .map_or(SimTime::MAX, |until| SimTime::ZERO + until.0),
            devices: Some(devices?).filter(|devices| !devices.is_empty()),
        })
    }

    fn has(&self, at: SimTime, device: Option<usize>) -> bool {
        let wanted = |device: usize| {
            let devices = self.devices.as_ref();
            devices.is_none_or(|devices| devices.contains(&device))
        };
        self.from <= at && at <= self.until && device.is_none_or(wanted)
    }
}
