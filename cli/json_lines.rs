//! Reading lines of JSON that a process adds to a file, which may have been killed.

use std::io::{BufRead, Read as _};

use serde::de::DeserializeOwned;

/// Most bytes of a line.
const MOST_LINE: u64 = 64 << 20;

/// The lines of a file that may end within one.
pub(crate) struct Lines<R> {
    text: R,
    line: Vec<u8>,
    /// Number of bytes of what was read and is whole.
    pub(crate) whole: u64,
    /// It ends before or within a line, or within a member of a compressed file.
    pub(crate) is_torn: bool,
}

impl<R: BufRead> Lines<R> {
    pub(crate) fn new(text: R) -> Self {
        Self {
            text,
            line: Vec::new(),
            whole: 0,
            is_torn: false,
        }
    }

    /// The next line; `None` at the end.
    pub(crate) fn next<T: DeserializeOwned>(&mut self) -> serde_json::Result<Option<T>> {
        self.line.clear();
        let mut rest = (&mut self.text).take(MOST_LINE);
        let read = rest.read_until(b'\n', &mut self.line);
        if !self.line.ends_with(b"\n") {
            self.is_torn = self.whole == 0 || !matches!(read, Ok(0));
            return Ok(None);
        }
        let line = serde_json::from_slice(&self.line)?;
        self.whole += self.line.len() as u64;
        Ok(Some(line))
    }
}
