//! Errors of an embedded simulation.

use std::io;
use std::path::PathBuf;

use rigsim_core::SimTime;
use rigsim_pty::PortError;
use rigsim_runner::FileErrors;
use rigsim_runner::RunError;
use rigsim_runner::condition::ExpressionError;
use rigsim_runner::run::StepError;

/// Reason for which something could not be done.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// Devices, settings, a scenario or a step make no sense; each line says where and why.
    #[error(transparent)]
    Text(#[from] FileErrors),
    /// An expression makes no sense, or has no value.
    #[error(transparent)]
    Expression(#[from] ExpressionError),
    /// A file cannot be read.
    #[error("cannot read {}: {source}", path.display())]
    File {
        /// The file.
        path: PathBuf,
        /// Reason.
        source: io::Error,
    },
    /// There is no such device, or it has no such link.
    #[error("there is no port `{wanted}`; there are: {known}")]
    NoSuchPort {
        /// Name that was asked for.
        wanted: String,
        /// Names that there are.
        known: String,
    },
    /// The device is of another type.
    #[error("{device} is not a `{wanted}`")]
    OtherDevice {
        /// Name of the device.
        device: String,
        /// The type that was asked for.
        wanted: &'static str,
    },
    /// The port is open already.
    #[error("the port of {port} is open already; a serial port has one client at a time")]
    PortInUse {
        /// Name of the device.
        port: String,
    },
    /// The cable of the port is out.
    #[error("the cable of {port} is pulled, so its port is gone")]
    CablePulled {
        /// Name of the device.
        port: String,
    },
    /// A condition did not come to hold.
    #[error("`{condition}` did not hold by {at} s: {found}")]
    NotHeld {
        /// The condition.
        condition: String,
        /// Time at which it was given up.
        at: SimTime,
        /// The values of its names then.
        found: String,
    },
    /// There can be no further step: the run is over, or too many others are not.
    #[error(transparent)]
    Step(StepError),
    /// The simulation cannot go on.
    #[error("the simulation cannot go on: {0}")]
    Run(#[from] RunError),
    /// A port cannot be opened, read, written or waited for.
    #[error(transparent)]
    Port(#[from] PortError),
    /// The thread that serves cannot be started.
    #[error("the thread that serves: {0}")]
    Thread(#[source] io::Error),
    /// The thread that serves has panicked.
    #[error("the thread that serves: it has panicked")]
    Panicked,
}

impl From<StepError> for Error {
    fn from(error: StepError) -> Self {
        match error {
            StepError::Text(error) => error.into(),
            StepError::Run(error) => error.into(),
            why => Self::Step(why),
        }
    }
}
