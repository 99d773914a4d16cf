//! Printing to standard output.

use std::io::{ErrorKind, Write as _};

use anyhow::anyhow;

use crate::exit::{Exit, Failure};

/// Prints a line; nobody reading any more is no failure.
pub(crate) fn print(text: &str) -> Result<Exit, Failure> {
    match writeln!(anstream::stdout(), "{text}") {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::system(anyhow!(error).context("cannot print")))
        }
        _ => Ok(Exit::Clean),
    }
}
