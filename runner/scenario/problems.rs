//! Collecting what is wrong with a file.

use std::ops::Range;

use sim_settings::{Source, shorten};

use crate::rig_file::RigFileError;
use crate::suggest::improve;

/// The most errors that one file reports.
pub(super) const MOST_ERRORS: usize = 20;

/// What is wrong so far.
pub(super) struct Problems<'t> {
    source: Source<'t>,
    lines: Vec<String>,
}

impl<'t> Problems<'t> {
    pub(super) fn new(source: Source<'t>) -> Self {
        Self {
            source,
            lines: Vec::new(),
        }
    }

    /// Something is wrong at a place of the file.
    pub(super) fn add(&mut self, at: Range<usize>, why: &str) {
        if self.lines.len() < MOST_ERRORS {
            let place = self.source.place(at.start);
            let key = self.source.key_at(at.start);
            let key = key.map(|key| format!("`{}`: ", shorten(key)));
            let why = shorten(why.to_owned());
            let line = format!("{place}: {}{why}", key.unwrap_or_default());
            self.lines.push(line);
        }
    }

    /// Where something is said, as errors begin.
    pub(super) fn place(&self, at: Range<usize>) -> String {
        self.source.place(at.start).to_string()
    }

    /// The value, or `None` and one problem more.
    pub(super) fn take<T>(&mut self, at: Range<usize>, result: Result<T, String>) -> Option<T> {
        result.map_err(|why| self.add(at, &why)).ok()
    }

    /// The value, or `None` and one problem more, at the place that the reader's error names or else
    /// here.
    pub(super) fn read<T>(
        &mut self,
        at: Range<usize>,
        result: Result<T, toml::de::Error>,
    ) -> Option<T> {
        result
            .map_err(|error| {
                let at = error.span().filter(|span| *span != (0..0)).unwrap_or(at);
                let why = improve(&error.message().replace('\n', " "));
                self.add(at, &why);
            })
            .ok()
    }

    pub(super) fn into_result(self) -> Result<(), RigFileError> {
        if self.lines.is_empty() {
            Ok(())
        } else {
            Err(RigFileError(self.lines))
        }
    }
}
