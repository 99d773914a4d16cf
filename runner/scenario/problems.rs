//! Collecting what is wrong with a file.

use std::ops::Range;

use crate::rig_file::RigFileError;
use crate::sources::Sources;

/// The most errors that one file reports.
pub(super) const MOST_ERRORS: usize = 20;

/// Problems found so far.
pub(super) struct Problems<'t> {
    sources: Sources<'t>,
    lines: Vec<String>,
}

impl<'t> Problems<'t> {
    pub(super) fn new(sources: Sources<'t>) -> Self {
        Self {
            sources,
            lines: Vec::new(),
        }
    }

    /// Something is wrong at a place of the file.
    pub(super) fn add(&mut self, at: Range<usize>, why: &str) {
        self.add_lines([self.sources.wrong(at.start, why)]);
    }

    /// Lines about what is wrong.
    pub(super) fn add_lines(&mut self, lines: impl IntoIterator<Item = String>) {
        let left = MOST_ERRORS.saturating_sub(self.lines.len());
        self.lines.extend(lines.into_iter().take(left));
    }

    /// Place at which something is said, as errors begin.
    pub(super) fn place(&self, at: Range<usize>) -> String {
        self.sources.place(at.start).to_string()
    }

    /// The value, or `None` and one problem more.
    pub(super) fn take<T>(&mut self, at: Range<usize>, result: Result<T, String>) -> Option<T> {
        result.map_err(|why| self.add(at, &why)).ok()
    }

    /// The value, or `None` and one problem more, at the place that the reader's error names or
    /// else here.
    pub(super) fn read<T>(
        &mut self,
        at: Range<usize>,
        result: Result<T, toml::de::Error>,
    ) -> Option<T> {
        result
            .map_err(|error| {
                let own = error.span().filter(|span| *span != (0..0));
                let start = own.map_or(at.start, |span| span.start);
                let place = format!("{}: ", self.sources.place(start));
                // What is wrong there with what stands for something else cannot be read, either.
                if start == 0 || !self.lines.iter().any(|line| line.starts_with(&place)) {
                    self.add_lines([self.sources.syntax(at.start, &error)]);
                }
            })
            .ok()
    }

    pub(super) fn into_error(self) -> RigFileError {
        RigFileError(self.lines)
    }

    pub(super) fn into_result(self) -> Result<(), RigFileError> {
        if self.lines.is_empty() {
            Ok(())
        } else {
            Err(RigFileError(self.lines))
        }
    }
}
