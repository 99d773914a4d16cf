//! Flags of `sim hunt`.

use std::ffi::OsString;
use std::path::PathBuf;

use clap::builder::NonEmptyStringValueParser;
use clap::{ArgAction, Args, ValueEnum, value_parser};
use serde::Serialize;

use super::SettingsArgs;

const EXAMPLES: &str = "\
Examples:
  sim hunt scenarios/r150/jobs/camera-drive.toml -- python3 my_client.py
      Search for the smallest faults that make the client break a rule of the job.
  sim hunt --rules my-rules.toml --output found my-job.toml -- ./client
      Judge by further rules, and write what is found into a folder.
  sim run found/*.toml -- ./client
      Play what was found again.
  sim hunt --seed 2 --output hunt-2 my-job.toml -- ./client
      Search elsewhere, as on a second machine. A hunt has no --shard: what it tries next depends on
      what it has found.

Exit codes:
  0  nothing found
  1  found: at least one file was written
  2  usage or configuration: a flag or a file is wrong, or the client is not repeatable
  3  simulator or system, or no run of the search has a verdict";

/// Part of a search.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, ValueEnum, Serialize)]
#[serde(rename_all = "lowercase")]
pub(crate) enum StageArg {
    /// Single faults: every kind once before any kind twice.
    Single,
    /// Further faults while the client reacts to those before.
    Further,
    /// Random schedules.
    Random,
}

/// Budget and space of a search.
#[derive(Debug, Args)]
#[command(after_help = EXAMPLES)]
pub(crate) struct HuntArgs {
    /// Job files: what the client has to do, without faults.
    #[arg(required = true, value_name = "JOB")]
    pub(crate) jobs: Vec<PathBuf>,
    /// The client to test, with its arguments, as for `sim run`.
    #[arg(last = true, required = true, value_name = "CLIENT")]
    pub(crate) client: Vec<OsString>,
    /// Judge also by the rules and responses of this scenario file; may be repeated.
    #[arg(long, value_name = "FILE", action = ArgAction::Append)]
    pub(crate) rules: Vec<PathBuf>,
    /// Number of runs of the search, for all jobs together.
    #[arg(long, value_name = "N", default_value = "2000", value_parser = value_parser!(u32).range(1..=1_000_000))]
    pub(crate) runs: u32,
    /// Further runs to make one finding smaller.
    #[arg(long, value_name = "N", default_value = "300", value_parser = value_parser!(u32).range(1..=100_000))]
    pub(crate) shrink_runs: u32,
    /// Maximum number of faults at once.
    #[arg(long, value_name = "N", default_value = "2", value_parser = value_parser!(u32).range(1..=4))]
    pub(crate) max_faults: u32,
    /// Try only these kinds of faults and actions.
    #[arg(long, value_name = "KINDS", value_delimiter = ',', value_parser = NonEmptyStringValueParser::new())]
    pub(crate) faults: Vec<String>,
    /// Play only these stages, as for a comparison with a random search [default: all].
    #[arg(long, value_name = "STAGES", value_enum, value_delimiter = ',')]
    pub(crate) stages: Vec<StageArg>,
    /// End the search with the first finding.
    #[arg(long)]
    pub(crate) fail_fast: bool,
    /// Seed of the runs and of the choices of the search.
    #[arg(long, value_name = "N", default_value = "1")]
    pub(crate) seed: u64,
    /// Number of runs at a time; the result does not depend on it [default: one for each core].
    #[arg(short = 'j', long = "jobs", value_name = "N", value_parser = value_parser!(u32).range(1..=64))]
    pub(crate) threads: Option<u32>,
    /// A client that you trust, as a command of the shell: a rule that it breaks, too, is not a bug of yours.
    /// It is played first, and has to pass the job without faults.
    #[arg(long, value_name = "COMMAND")]
    pub(crate) reference: Option<String>,
    /// Write findings, `hunt.json` and the journal into this folder. The same command resumes a hunt
    /// that was aborted.
    #[arg(long, value_name = "DIR", default_value = "hunt")]
    pub(crate) output: PathBuf,
    /// Write an HTML page with a map of what was tried.
    #[arg(long, value_name = "PATH")]
    pub(crate) report: Option<PathBuf>,
    #[command(flatten)]
    pub(crate) settings: SettingsArgs,
}
