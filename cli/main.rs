//! The `sim` command: flags, subcommands, exit codes, and the loop that ties simulated devices to
//! real ports in real time.

mod args;
mod config;
mod exit;
mod log;
mod plan;
mod ready_file;
mod serve;
mod start;
mod summary;

use std::io::Write as _;
use std::process::ExitCode;

use clap::Parser as _;

use args::{Cli, Command};

fn main() -> ExitCode {
    let cli = Cli::parse();
    let outcome = match &cli.command {
        Some(Command::Config(settings)) => config::print(settings),
        None => start::serve(&cli.serve),
    };
    match outcome {
        Ok(exit) => exit.into(),
        Err(failure) => {
            // Nothing is left to do if even standard error is closed.
            let _ = writeln!(anstream::stderr(), "error: {:#}", failure.error);
            failure.exit.into()
        }
    }
}
