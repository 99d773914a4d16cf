//! Printing to standard output and standard error.

use std::any::Any;
use std::backtrace::{Backtrace, BacktraceStatus};
use std::collections::BTreeMap;
use std::io::{ErrorKind, IsTerminal as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use rigsim_pty::paths::Results;

use crate::exit::{Exit, Failure, refuse};
use crate::visible;

/// Prints a line, or several; the end of the reader is not a failure.
pub(crate) fn print(text: &str) -> Result<Exit, Failure> {
    written(writeln!(anstream::stdout(), "{}", visible::lines(text)))
}

/// Exit code when something could not be printed; the end of the reader is not a failure.
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

/// A bar of this form on a terminal, and nothing elsewhere.
pub(crate) fn progress(count: u64, form: &str) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() || count < 2 {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(count);
    if let Ok(style) = indicatif::ProgressStyle::with_template(form) {
        bar.set_style(style);
    }
    bar
}

/// The same above a bar that is not full yet.
pub(crate) fn complain_above(bar: &indicatif::ProgressBar, text: &str) {
    bar.suspend(|| complain(text));
}

/// Refuses flags that name the same file.
pub(crate) fn refuse_same_file<const N: usize>(
    flags: [(&str, &Option<PathBuf>); N],
) -> Result<(), Failure> {
    let mut named = BTreeMap::new();
    for (flag, path) in flags {
        let path = path
            .as_ref()
            .and_then(|path| std::path::absolute(path).ok());
        if let Some(other) = path.and_then(|path| named.insert(path, flag)) {
            refuse!("{other} and {flag} name the same file");
        }
    }
    Ok(())
}

/// A file of results that a flag names. It can be written, as was found out before anything was played.
pub(crate) struct OutputFile {
    path: PathBuf,
    to: Results,
}

impl OutputFile {
    /// The file at a path, in the place of an earlier one that has one of these marks.
    ///
    /// # Errors
    /// When it cannot be written, or something else is there.
    pub(crate) fn find(path: &Path, marks: &'static [&'static str]) -> Result<Self, Failure> {
        let to = Results::at(path, marks)
            .with_context(|| format!("cannot write {}", visible::name(path)))
            .map_err(Failure::usage)?;
        let path = path.to_owned();
        Ok(Self { path, to })
    }

    /// Removes an earlier file, which would be taken for this one if that is aborted, unless it is a stream.
    ///
    /// # Errors
    /// When it cannot be written, or something else is there by now.
    pub(crate) fn clear(&self) -> Result<(), Failure> {
        if self.to.is_stream() {
            return Ok(());
        }
        let emptied = self.write("");
        emptied.map_err(|failure| Failure::usage(failure.error))?;
        let removed = self.to.remove();
        removed
            .with_context(|| format!("cannot remove {}", visible::name(&self.path)))
            .map_err(Failure::usage)
    }

    /// Writes all of it.
    pub(crate) fn write(&self, text: &str) -> Result<(), Failure> {
        self.to
            .write(text.as_bytes())
            .with_context(|| format!("cannot write {}", visible::name(&self.path)))
            .map_err(Failure::system)
    }

    /// Returns whether it can be written only once.
    pub(crate) fn is_stream(&self) -> bool {
        self.to.is_stream()
    }
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
pub(crate) fn report_panics() {
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
