//! Flags of `sim run`.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::{ArgAction, Args, ValueEnum, value_parser};
use sim_settings::Span;

use super::{MAX_HOLD_UP, SettingsArgs, some_time, speed};
use crate::exit::Exit;

const EXAMPLES: &str = "\
Examples:
  sim run scenarios
      Every scenario with the client that is scripted in its file.
  sim run --tag drive scenarios/r150 -- python3 my_client.py
      Your client instead. It opens the port that $SIM_R150_PORT names. Time is simulated, its own
      too: 20 seconds take a few tenths of one.
  sim run --time real scenarios/r150 -- python3 my_client.py
      The same in real time: 20 seconds take 20 seconds.
  sim run scenarios/r150 -- sh -c 'my_client --port \"$SIM_R150_PORT\"'
      A client that takes the port as an argument.
  sim run --junit results.xml --output traces -j 4 scenarios/r150 -- ./client
      For CI: JUnit XML, traces and reports for `sim replay`, four at a time.
  sim run --report report.html scenarios
      A page with all verdicts, and pictures of what happened.
  sim run --job my-job.toml scenarios/r150/faults -- ./client
      Every fault within a job of your own.
  sim run --set r150.heartbeat_timeout=2s --param pwm=300,600 my.toml -- ./client
      Your vehicle's settings, and each value of a parameter of the file as a case of its own.
  sim run --repeat 20 --fail-fast --filter crc scenarios -- ./client
      Twenty seeds of each scenario whose path contains `crc`, to the first that fails.";

/// Choice of what to play, and how.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", Exit::HELP))]
pub(crate) struct RunArgs {
    /// Scenario files, or folders of them.
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// The client to test, with its arguments. Its environment has the path of each port, in
    /// SIM_R150_PORT for the device `r150`, and the seed in SIM_SEED.
    #[arg(last = true, value_name = "CLIENT")]
    pub(crate) client: Vec<OsString>,
    /// Number of scenarios to play at a time [default: one for each core, but 1 with a client in real time].
    #[arg(short, long, value_name = "N", value_parser = value_parser!(u32).range(1..=64))]
    pub(crate) jobs: Option<u32>,
    #[command(flatten)]
    pub(crate) given: GivenArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Seed of everything random, instead of the file's or a random one.
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Play each scenario N times, each time with the next seed.
    #[arg(long, value_name = "N", default_value = "1", value_parser = value_parser!(u32).range(1..=100_000))]
    pub(crate) repeat: u32,
    /// Only files whose path contains TEXT.
    #[arg(long, value_name = "TEXT")]
    pub(crate) filter: Option<String>,
    /// Only scenarios with this tag in their file; may be repeated, and one of them is enough.
    #[arg(long, value_name = "TAG", action = ArgAction::Append)]
    pub(crate) tag: Vec<String>,
    /// Stop after the first scenario that fails.
    #[arg(long)]
    pub(crate) fail_fast: bool,
    /// Write the results as JUnit XML, which CI servers show.
    #[arg(long, value_name = "PATH")]
    pub(crate) junit: Option<PathBuf>,
    /// Write an HTML page with all verdicts, the world from above, and plots and traffic of what failed.
    #[arg(long, value_name = "PATH")]
    pub(crate) report: Option<PathBuf>,
    /// Write into this folder, for each scenario, a trace, a report as JSON, and the client's output.
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// The time that a client has.
    #[arg(long, value_enum, default_value_t = TimeArg::Lockstep)]
    pub(crate) time: TimeArg,
    /// With --time lockstep: where a client's random numbers come from.
    #[arg(long, value_enum, default_value_t = RandomArg::Seed)]
    pub(crate) random: RandomArg,
    /// With --time lockstep: the date at which a client begins, in UTC.
    #[arg(long, value_name = "DATE", default_value = "2025-01-01 00:00:00", value_parser = date)]
    pub(crate) date: Duration,
    /// With --time lockstep: play each scenario two times and show the first difference.
    #[arg(long)]
    pub(crate) twice: bool,
    /// With --time real: simulated seconds for each second of real time, 0.01 to 100 [default: 1].
    #[arg(long, value_name = "X", value_parser = speed)]
    pub(crate) speed: Option<f64>,
    /// Real time allowed for each, as in 90s or "2 min" [default: the file's `wall_limit`, else
    /// twice its `limit` and 30 s].
    #[arg(long, value_name = "TIME", value_parser = some_time)]
    pub(crate) timeout: Option<Span>,
    /// With --time real: how long a busy machine may hold the simulator up in all. A scenario that fails
    /// after more than that is played once more; if that goes the same way, it is an error of the machine
    /// and no failure of the client.
    #[arg(long, value_name = "TIME", default_value = MAX_HOLD_UP, value_parser = some_time)]
    pub(crate) max_hold_up: Span,
    /// Let programs and a page look on and change what happens, as `sim --control` does. Each scenario
    /// has an address of its own, which the client finds in SIM_CONTROL.
    #[arg(long, value_name = "ADDRESS", value_parser = sim_control::listen, requires = "client")]
    pub(crate) control: Option<SocketAddr>,
    /// List the files with their titles and tags, and play nothing.
    #[arg(long)]
    pub(crate) list: bool,
    /// Print what would be played, with which seed and ports, and play nothing.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// Additions to scenario files.
#[derive(Debug, Default, Args)]
pub(crate) struct GivenArgs {
    /// Play fault files within this job: a scenario file that says what your client is to do, on which
    /// devices. It takes the place of the job that they name.
    #[arg(long, value_name = "FILE")]
    pub(crate) job: Option<PathBuf>,
    /// Set a parameter of the files, as in --param pwm=300; once for each. With several values, as in
    /// --param pwm=300,600, each is played, in each combination with those of other parameters.
    #[arg(long, value_name = "NAME=VALUE", action = ArgAction::Append)]
    pub(crate) param: Vec<String>,
    /// Take this world instead of those that the files name.
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TimeArg {
    /// The simulator's: it stands still while the client computes and jumps while it waits. Nothing is
    /// ever late, and the same seed gives the same bytes.
    Lockstep,
    /// Real time, by the system's clocks.
    Real,
}

impl TimeArg {
    /// As it is written.
    pub(crate) fn word(self) -> &'static str {
        match self {
            Self::Lockstep => "lockstep",
            Self::Real => "real",
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RandomArg {
    /// The run's seed.
    Seed,
    /// The system.
    Real,
}

/// A date, as the time since 1970.
fn date(text: &str) -> Result<Duration, String> {
    humantime::parse_rfc3339_weak(text)
        .ok()
        .and_then(|date| date.duration_since(std::time::UNIX_EPOCH).ok())
        .ok_or_else(|| "wanted: a date since 1970, as in \"2025-01-31 12:00:00\"".to_owned())
}
