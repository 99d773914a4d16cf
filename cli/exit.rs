//! Exit codes and their meaning; the one place that says so.

use std::process::ExitCode;

/// End of a run.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Exit {
    /// Stopped by the user, or finished.
    Clean = 0,
    /// A scenario or the client failed.
    Failed = 1,
    /// A flag, a file or a setting is wrong.
    Usage = 2,
    /// The simulator or the system failed.
    System = 3,
}

impl Exit {
    /// For `--help`.
    pub(crate) const HELP: &'static str = "\
Exit codes:
  0  clean: stopped with Ctrl-C, SIGTERM or SIGHUP; all scenarios passed or were skipped
  1  a scenario or the client failed, or a replayed trace differs
  2  usage or configuration: a flag, a file or a setting is wrong, or nothing is selected
  3  simulator or system: a port could not be created or served, the simulator failed, a client
     ended before it opened a port, Ctrl-C aborted scenarios, or the machine was too busy for a
     verdict";
}

impl From<Exit> for ExitCode {
    fn from(exit: Exit) -> Self {
        Self::from(exit as u8)
    }
}

/// An error that ends the run, and with which exit code.
#[derive(Debug)]
pub(crate) struct Failure {
    pub(crate) exit: Exit,
    pub(crate) error: anyhow::Error,
}

impl Failure {
    pub(crate) fn usage(error: impl Into<anyhow::Error>) -> Self {
        Self {
            exit: Exit::Usage,
            error: error.into(),
        }
    }

    pub(crate) fn system(error: impl Into<anyhow::Error>) -> Self {
        Self {
            exit: Exit::System,
            error: error.into(),
        }
    }
}

/// Returns an error of usage with these words.
macro_rules! refuse {
    ($($words:tt)*) => {
        return Err($crate::exit::Failure::usage(anyhow::anyhow!($($words)*)))
    };
}
pub(crate) use refuse;
