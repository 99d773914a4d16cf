//! Flags of `sim merge`.

use std::path::PathBuf;

use clap::Args;

use crate::exit::Exit;

const EXAMPLES: &str = "\
Examples:
  sim run --repeat 1000 --shard auto --results out scenarios -- python3 my_client.py
      On each machine; the folder is shared, or is collected afterwards.
  sim merge out --junit all.xml --report all.html
      Afterwards, anywhere. A result that is missing is an error: exit code 3.
  sim merge out --partial --report so-far.html
      While shards are still playing.";

/// What to put together, and where to write it.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", Exit::HELP))]
pub(crate) struct MergeArgs {
    /// Folders of `sim run --results`.
    #[arg(required = true, value_name = "DIR")]
    pub(crate) folders: Vec<PathBuf>,
    /// Write JUnit XML, with a test case for each failure of a file that differs, and not for each seed.
    #[arg(long, value_name = "PATH")]
    pub(crate) junit: Option<PathBuf>,
    /// Write an HTML page: failures by how often they came, and the command that shows each again.
    #[arg(long, value_name = "PATH")]
    pub(crate) report: Option<PathBuf>,
    /// Write the same as JSON.
    #[arg(long, value_name = "PATH")]
    pub(crate) json: Option<PathBuf>,
    /// Write the files although results are missing; each says what is missing.
    #[arg(long)]
    pub(crate) partial: bool,
}
