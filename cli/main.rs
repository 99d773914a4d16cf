//! The `sim` command: flags, subcommands, exit codes, and the loop that ties simulated devices to
//! real ports in real time.

mod args;
mod client;
mod config;
mod control;
mod exit;
mod lists;
mod log;
mod plan;
mod print;
mod ready_file;
mod recording;
mod replay;
mod run;
mod scenario_files;
mod schema;
mod start;
mod summary;
mod supervise;
mod trace;
mod visible;
mod whole_file;

use std::panic::{AssertUnwindSafe, catch_unwind};
use std::process::ExitCode;

use clap::Parser as _;

use args::{Cli, Command};
use exit::{Exit, Failure};

fn main() -> ExitCode {
    guarded(|| {
        let cli = Cli::parse();
        match &cli.command {
            Some(Command::Config(settings)) => config::print(settings),
            Some(Command::Run(args)) => run::run(args),
            Some(Command::Check { files }) => run::check(files),
            Some(Command::Replay { trace }) => replay::replay(trace),
            Some(Command::Trace(args)) => trace::trace(args),
            Some(Command::Supervise { client, folder }) => {
                supervise::supervise(client, folder.as_deref())
            }
            Some(Command::Faults { device, format }) => lists::faults(*device, *format),
            Some(Command::Names { device }) => lists::list_names(*device),
            Some(Command::Ctl(args)) => control::ctl::run(args),
            Some(Command::Schema { of }) => schema::print(*of),
            None => start::serve(&cli.serve),
        }
    })
    .into()
}

/// Runs `program` and says how it ended. A panic ends it as a failure of the simulator, which it
/// is; what was opened is closed on the way here, and the panic has been printed by its own hook.
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
mod tests {
    use super::*;
    use sim_pty::PtyPort;

    #[test]
    fn a_panic_is_a_failure_of_the_simulator_and_leaves_no_link() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r150");
        let exit = guarded(|| {
            let _port = PtyPort::open_at(&path, 115_200).unwrap();
            assert!(path.exists());
            panic!("as a test of what is done about it");
        });
        assert_eq!(exit, Exit::System);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 0);
        assert_eq!(guarded(|| Ok(Exit::Clean)), Exit::Clean);
    }
}
