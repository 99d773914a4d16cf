//! Printing to standard output.

use std::io::{ErrorKind, Write as _};

use anyhow::anyhow;

use crate::exit::{Exit, Failure};

/// Prints a line; nobody reading any more is no failure.
pub(crate) fn print(text: &str) -> Result<Exit, Failure> {
    written(writeln!(anstream::stdout(), "{text}"))
}

/// What becomes of it when something could not be printed; nobody reading any more is no failure.
pub(crate) fn written(written: std::io::Result<()>) -> Result<Exit, Failure> {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::system(anyhow!(error).context("cannot print")))
        }
        _ => Ok(Exit::Clean),
    }
}
