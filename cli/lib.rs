//! The `sim` command line, for whatever devices a program hands in: flags, subcommands, exit codes.

mod args;
mod attendant;
mod client;
mod config;
mod control;
mod digest;
mod exit;
mod export;
mod hunt;
mod json_lines;
mod lists;
mod log;
mod mcp;
mod patient_file;
mod plan;
mod print;
mod published;
mod ready_file;
mod recording;
mod reference;
mod run;
mod scenario_files;
mod start;
mod summary;
mod supervise;
mod trace;
mod vehicle;
mod visible;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use rigsim_core::device::Devices;

use args::{Cli, Command};
use exit::{Exit, Failure};

/// The program `sim` with these devices.
///
/// ```no_run
/// # use std::process::ExitCode;
/// fn main() -> ExitCode {
///     rigsim_cli::main(rigsim_core::SHIPPED)
/// }
/// ```
#[must_use]
pub fn main(devices: Devices) -> ExitCode {
    print::report_panics();
    guarded(|| {
        rigsim_pty::survive_full_files().map_err(Failure::system)?;
        let cli = Cli::read(devices);
        match &cli.command {
            Some(Command::Config { device, settings }) => {
                config::list(devices, device.as_deref(), settings)
            }
            Some(Command::Run(args)) => run::run(devices, args),
            Some(Command::Check { files, given }) => run::check(devices, files, given),
            Some(Command::Merge(args)) => run::merge(args),
            Some(Command::Hunt(args)) => hunt::hunt(devices, args),
            Some(Command::Replay(args)) => start::replay(devices, args),
            Some(Command::Tap(args)) => vehicle::tap(devices, args),
            Some(Command::Compare(args)) => vehicle::compare(devices, args),
            Some(Command::Fit(args)) => vehicle::fit(devices, args),
            Some(Command::Mcp) => mcp::serve(devices),
            Some(Command::Trace(args)) => trace::trace(devices, args),
            Some(Command::Supervise { client }) => supervise::supervise(client),
            Some(Command::Faults { device }) => lists::faults(devices, device.as_deref()),
            Some(Command::Names { device }) => lists::list_names(devices, device),
            Some(Command::Ctl(args)) => control::ctl::run(args),
            Some(Command::Schema { of, format }) => lists::schema(devices, of, *format),
            None => start::serve(devices, &cli.serve),
        }
    })
    .into()
}

/// Runs `program` and says how it ended. A panic ends it as a failure of the simulator, which it
/// is; what was opened is closed on the way here, and the panic has been reported by its hook.
fn guarded(program: impl FnOnce() -> Result<Exit, Failure>) -> Exit {
    // Nothing that the program has touched is used any more afterwards.
    match catch_unwind(AssertUnwindSafe(program)) {
        Ok(Ok(exit)) => exit,
        Ok(Err(failure)) => {
            print::complain(&format!("error: {:#}", failure.error));
            failure.exit
        }
        Err(_) => Exit::System,
    }
}

#[cfg(test)]
mod tests;
