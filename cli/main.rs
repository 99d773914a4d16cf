//! The `sim` command with the devices that ship.

use std::process::ExitCode;

fn main() -> ExitCode {
    rigsim_cli::main(rigsim_core::SHIPPED)
}
