//! The `sim` command with the devices that ship.

use std::process::ExitCode;

fn main() -> ExitCode {
    sim_cli::main(sim_core::SHIPPED)
}
