//! The file in which a client that `sim run` starts publishes numbers.

use std::ffi::OsString;
use std::fs::File;
use std::io::{self, Read as _};
use std::path::Path;

use rigsim_runner::run::MOST_LINE;
use rigsim_runner::{Run, RunError};
use rigsim_settings::SimTime;

/// Most bytes that are read of it in a run.
const MOST: u64 = 1 << 26;
/// Most bytes that are read at a time.
const AT_ONCE: u64 = 1 << 16;

/// A file to which a client appends lines, and how far they are read. An ordinary file takes a write
/// at once, in every kind of time.
pub(crate) struct Published {
    file: io::Take<File>,
    /// Beginning of a line that has not come to its end.
    line: Vec<u8>,
}

impl Published {
    /// An empty one in this folder, of which the client learns from its environment.
    pub(crate) fn create(
        folder: &Path,
        environment: &mut Vec<(String, OsString)>,
    ) -> io::Result<Self> {
        let path = folder.join("publish");
        let mut options = File::options();
        let file = options.create(true).truncate(true).read(true).write(true);
        let file = file.open(&path)?.take(MOST);
        environment.push(("SIM_PUBLISH".to_owned(), path.into()));
        Ok(Self {
            file,
            line: Vec::new(),
        })
    }

    /// Publishes what was written since the last time, dated `at`.
    pub(crate) fn take(&mut self, run: &mut Run, at: SimTime) -> Result<(), RunError> {
        let mut bytes = Vec::new();
        // A file that cannot be read says nothing.
        let _ = (&mut self.file).take(AT_ONCE).read_to_end(&mut bytes);
        for byte in bytes {
            if byte == b'\n' {
                let line = std::mem::take(&mut self.line);
                // A line that is not used is an event of the run.
                let _ = run.publish(at, &String::from_utf8_lossy(&line))?;
            } else if self.line.len() <= MOST_LINE {
                self.line.push(byte);
            }
        }
        Ok(())
    }
}
