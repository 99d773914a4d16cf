//! Flags of `sim run`.

use std::ffi::OsString;
use std::net::SocketAddr;
use std::path::PathBuf;
use std::time::Duration;

use clap::parser::ValueSource;
use clap::{ArgAction, ArgMatches, Args, ValueEnum, value_parser};
use rigsim_settings::Span;

use super::{MAX_STALL, SettingsArgs, Shard, shard, some_time, speed};
use crate::exit::Exit;
use crate::export::ExportFormat;

const EXAMPLES: &str = "\
Examples:
  sim run scenarios
      Play every scenario with the client scripted in its file.
  sim run --tag drive scenarios/r150 -- python3 my_client.py
      Play them with your client, which opens the port named by $SIM_R150_PORT. Time is simulated:
      20 seconds take a few tenths of a second.
  sim run --time real scenarios/r150 -- python3 my_client.py
      Do the same in real time: 20 seconds take 20 seconds.
  sim run scenarios/r150 -- sh -c 'my_client --port \"$SIM_R150_PORT\"'
      Start a client that takes the port as an argument.
  sim run --junit results.xml --output traces -j 4 scenarios/r150 -- ./client
      For CI: JUnit XML, traces and reports for `sim replay`, four at a time.
  sim run --report report.html scenarios
      Write a page with all verdicts, and pictures of each run.
  sim run --job my-job.toml scenarios/r150/faults -- ./client
      Play every fault within your own job.
  sim run --set r150.heartbeat_timeout=2s --param pwm=300,600 my.toml -- ./client
      Use the settings of your vehicle, and play one case for each value of a parameter.
  sim run --repeat 1000 --shard auto --results out scenarios -- python3 my_client.py
      Play the shard of this machine, and keep results in a folder for `sim merge`.
  sim run --repeat 20 --fail-fast --filter crc scenarios -- ./client
      Play twenty seeds of each scenario whose path contains `crc`, until one fails.";

/// Choice of what to play, and how.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", Exit::HELP))]
pub(crate) struct RunArgs {
    /// The flags that play a case again, as they were given.
    #[arg(skip)]
    pub(crate) again: Vec<OsString>,
    /// Scenario files, or folders of them.
    #[arg(required = true)]
    pub(crate) files: Vec<PathBuf>,
    /// The client to test, with its arguments. Its environment has the path of each port, in
    /// SIM_R150_PORT or SIM_MECANUM_PORT, the seed in SIM_SEED, and in SIM_PUBLISH the path of a file
    /// for numbers that it publishes.
    #[arg(last = true, value_name = "CLIENT")]
    pub(crate) client: Vec<OsString>,
    /// Number of scenarios to play at a time [default: one for each core, but 1 with a client in real time].
    #[arg(short, long, value_name = "N", value_parser = value_parser!(u32).range(1..=64))]
    pub(crate) jobs: Option<u32>,
    #[command(flatten)]
    pub(crate) given: GivenArgs,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
    /// Seed of all random numbers [default: the seed of the file, or a random one].
    #[arg(long, value_name = "N")]
    pub(crate) seed: Option<u64>,
    /// Play each scenario N times, each time with the next seed and another vehicle of the same make.
    #[arg(long, value_name = "N", default_value = "1", value_parser = value_parser!(u32).range(1..=1_000_000))]
    pub(crate) repeat: u32,
    /// Play only files whose path contains TEXT.
    #[arg(long, value_name = "TEXT")]
    pub(crate) filter: Option<String>,
    /// Play only scenarios with this tag in their file; may be repeated, and one of the tags is enough.
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
    /// Write a trace, a JSON report and the client's output of each scenario into this folder.
    #[arg(long, value_name = "DIR")]
    pub(crate) output: Option<PathBuf>,
    /// With --output: write the trace of each scenario that fails also in these formats, as in
    /// --export pcapng. With perfetto, traces also record what each thread of a client in lockstep
    /// waits for.
    #[arg(
        long,
        value_enum,
        value_name = "FORMATS",
        value_delimiter = ',',
        requires = "output"
    )]
    pub(crate) export: Vec<ExportFormat>,
    /// With --export: do that also for scenarios that pass.
    #[arg(long, requires = "export")]
    pub(crate) export_all: bool,
    /// Play only shard K of N. With `auto`, the variables of a CI server or a batch system choose it.
    #[arg(long, value_name = "K/N|auto", value_parser = shard)]
    pub(crate) shard: Option<Shard>,
    /// Add results to this folder, for `sim merge`. Cases that have a verdict there are not played
    /// again. Files without a seed begin with seed 1, as with --shard.
    #[arg(long, value_name = "DIR", conflicts_with = "fail_fast")]
    pub(crate) results: Option<PathBuf>,
    /// Meaning of the exit code.
    #[arg(long, value_enum, default_value_t = ExitArg::Verdict)]
    pub(crate) exit: ExitArg,
    /// The kind of time that the client sees.
    #[arg(long, value_enum, default_value_t = TimeArg::Lockstep)]
    pub(crate) time: TimeArg,
    /// With --time lockstep: the source of the client's random numbers.
    #[arg(long, value_enum, default_value_t = RandomArg::Seed)]
    pub(crate) random: RandomArg,
    /// With --time lockstep: which thread of the client runs when several can.
    #[arg(long, value_enum, default_value_t = ScheduleArg::First)]
    pub(crate) schedule: ScheduleArg,
    /// With --time lockstep: the date and time at which the client starts, in UTC.
    #[arg(long, value_name = "DATE", default_value = "2025-01-01 00:00:00", value_parser = date)]
    pub(crate) date: Duration,
    /// With --time lockstep: play each scenario twice and show the first difference.
    #[arg(long)]
    pub(crate) twice: bool,
    /// With --time real: simulated seconds for each second of real time, 0.01 to 100 [default: 1].
    #[arg(long, value_name = "X", value_parser = speed)]
    pub(crate) speed: Option<f64>,
    /// Time limit for each scenario, as in 90s or "2 min" [default: twice the file's `limit` and
    /// 30 s]. With --time lockstep it limits the processor time of client and simulator; after ten times as
    /// much real time there is an error and no verdict, as there is without a client. Otherwise it limits
    /// real time.
    #[arg(long, value_name = "TIME", value_parser = some_time)]
    pub(crate) timeout: Option<Span>,
    /// With --time real: how long a busy machine may stall the simulator in all. A scenario that fails
    /// after more than that is played once more. If that has the same result, it is an error of the
    /// machine and not a failure of the client.
    #[arg(long, value_name = "TIME", default_value = MAX_STALL, value_parser = some_time)]
    pub(crate) max_stall: Span,
    /// Let programs and a page observe and control each run, as `sim --control` does. Each scenario has
    /// its own URL, which the client finds in SIM_CONTROL.
    #[arg(long, value_name = "ADDRESS", value_parser = rigsim_control::listen, requires = "client")]
    pub(crate) control: Option<SocketAddr>,
    /// List the files with their titles and tags, and play nothing.
    #[arg(long)]
    pub(crate) list: bool,
    /// Print what would be played, with which seed and ports, and play nothing.
    #[arg(long)]
    pub(crate) dry_run: bool,
}

/// The flags that play a case again, with their values, as they were given.
pub(crate) fn again(matches: &ArgMatches) -> Vec<OsString> {
    let ids: &[&str] = match matches.get_one("time") {
        _ if !matches.contains_id("client") => &["timeout"],
        Some(TimeArg::Real) => &["time", "speed", "timeout", "max_stall", "control"],
        _ => &["date", "random", "schedule", "timeout", "control"],
    };
    let mut words = Vec::new();
    for id in ids.iter().chain(&["job", "world", "config", "set"]) {
        let is_given = matches.value_source(id) == Some(ValueSource::CommandLine);
        let values = matches.get_raw(id).filter(|_| is_given);
        for value in values.into_iter().flatten() {
            words.extend([format!("--{}", id.replace('_', "-")).into(), value.into()]);
        }
    }
    words
}

/// Additions to scenario files.
#[derive(Debug, Default, Args)]
pub(crate) struct GivenArgs {
    /// Play fault files within this job: a scenario file that says what your client does, and on which
    /// devices. It replaces the job that they name.
    #[arg(long, value_name = "FILE")]
    pub(crate) job: Option<PathBuf>,
    /// Set a parameter of the files, as in --param pwm=300; once for each. With several values, as in
    /// --param pwm=300,600, each is played, in each combination with those of other parameters.
    #[arg(long, value_name = "NAME=VALUE", action = ArgAction::Append)]
    pub(crate) param: Vec<String>,
    /// Use this world instead of those that the files name.
    #[arg(long, value_name = "FILE")]
    pub(crate) world: Option<PathBuf>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum TimeArg {
    /// Simulated time: it stops while the client computes, and jumps while it waits. Nothing is late, and
    /// the same seed gives the same bytes.
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
pub(crate) enum ExitArg {
    /// 0 if no case failed, 1 if one did.
    Verdict,
    /// 0 if all cases were played, even if some failed. Use it with engines that repeat a failed process.
    Complete,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum RandomArg {
    /// The run's seed.
    Seed,
    /// The system.
    Real,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(crate) enum ScheduleArg {
    /// The thread that started first, until it waits.
    First,
    /// At each syscall the seed chooses a thread. Use --repeat to try many orders and find races; --seed
    /// repeats one of them.
    Random,
}

/// A date, as the time since 1970.
fn date(text: &str) -> Result<Duration, String> {
    humantime::parse_rfc3339_weak(text)
        .ok()
        .and_then(|date| date.duration_since(std::time::UNIX_EPOCH).ok())
        .ok_or_else(|| "wanted: a date since 1970, as in \"2025-01-31 12:00:00\"".to_owned())
}
