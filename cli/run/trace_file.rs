//! Place of a trace.

use std::fs::File;
use std::io::{self, BufWriter, Write as _};
use std::path::PathBuf;

use anyhow::Context as _;
use sim_runner::Run;

use crate::exit::Failure;
use crate::visible;
use crate::whole_file;

/// A trace file; the first error is kept for the end.
pub(crate) struct TraceFile {
    path: PathBuf,
    out: BufWriter<File>,
    error: Option<io::Error>,
}

impl TraceFile {
    /// Replaces what is there.
    pub(crate) fn create(path: PathBuf) -> Result<Self, Failure> {
        let file = whole_file::create(&path)
            .with_context(|| format!("cannot write the trace {}", visible::name(&path)))
            .map_err(Failure::system)?;
        Ok(Self {
            path,
            out: BufWriter::with_capacity(1 << 16, file),
            error: None,
        })
    }

    /// Adds a line.
    fn line(&mut self, line: &str) {
        if self.error.is_none() {
            self.error = writeln!(self.out, "{line}").err();
        }
    }

    /// Adds what a run has to tell.
    pub(crate) fn take(&mut self, run: &mut Run) {
        while let Some(line) = run.poll_trace() {
            self.line(&line);
        }
    }

    /// Makes sure that all has been written.
    pub(crate) fn finish(mut self) -> Result<(), Failure> {
        let flushed = self.out.flush();
        let shown = visible::name(&self.path);
        self.error
            .map_or(flushed, Err)
            .with_context(|| format!("cannot write the trace {shown}; it is not complete"))
            .map_err(Failure::system)
    }
}
