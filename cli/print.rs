//! Printing to standard output and standard error.

use std::any::Any;
use std::backtrace::{Backtrace, BacktraceStatus};
use std::io::{ErrorKind, Write as _};

use anyhow::anyhow;

use crate::exit::{Exit, Failure};
use crate::visible;

/// Prints a line, or several; the end of the reader is no failure.
pub(crate) fn print(text: &str) -> Result<Exit, Failure> {
    written(writeln!(anstream::stdout(), "{}", visible::lines(text)))
}

/// Exit code when something could not be printed; the end of the reader is no failure.
pub(crate) fn written(written: std::io::Result<()>) -> Result<Exit, Failure> {
    match written {
        Err(error) if error.kind() != ErrorKind::BrokenPipe => {
            Err(Failure::system(anyhow!(error).context("cannot print")))
        }
        _ => Ok(Exit::Clean),
    }
}

/// Prints a line to standard error; nothing is left to do if that is closed.
pub(crate) fn complain(text: &str) {
    let _ = writeln!(anstream::stderr(), "{}", visible::lines(text));
}

/// Words for a panic that was caught.
pub(crate) fn words_of_panic(panic: &(dyn Any + Send)) -> String {
    let owned = panic.downcast_ref::<String>().map(String::as_str);
    let why = owned.or_else(|| panic.downcast_ref::<&str>().copied());
    format!(
        "the simulator panicked: {}",
        why.unwrap_or("no reason given")
    )
}

/// Reports panics as everything else is reported.
pub(crate) fn tell_panics() {
    std::panic::set_hook(Box::new(|panic| {
        let thread = std::thread::current();
        let name = thread.name().unwrap_or("without a name");
        complain(&format!("in thread {name}: {panic}"));
        let backtrace = Backtrace::capture();
        if backtrace.status() == BacktraceStatus::Captured {
            complain(&backtrace.to_string());
        }
    }));
}
