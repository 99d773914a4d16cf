//! Reading what may be a pipe to which no program writes.

use std::fs::{File, OpenOptions};
use std::io::{self, Read};
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::Path;
use std::time::{Duration, Instant};

use rustix::event::{PollFd, PollFlags, Timespec};

/// Longest silence of the program that writes to a pipe that is read as a file.
const PATIENCE: Duration = Duration::from_secs(5);

/// A file, or a pipe or terminal whose silence ends in an error.
pub(crate) struct PatientFile {
    file: File,
    is_regular: bool,
}

impl PatientFile {
    /// Opens what is at `path`, and does not wait.
    pub(crate) fn open(path: &Path) -> io::Result<Self> {
        // A named pipe is opened only when a program writes to it, unless one asks for no waiting.
        let nonblocking = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();
        let mut options = OpenOptions::new();
        let file = options.read(true).custom_flags(nonblocking).open(path)?;
        let is_regular = file.metadata()?.is_file();
        Ok(Self { file, is_regular })
    }

    /// Waits until there is something to read, or the end.
    fn wait(&self) -> io::Result<()> {
        let until = Instant::now() + PATIENCE;
        let left = || Timespec::try_from(until.saturating_duration_since(Instant::now())).ok();
        let mut poll = [PollFd::new(&self.file, PollFlags::IN)];
        let ready = rustix::io::retry_on_intr(|| rustix::event::poll(&mut poll, left().as_ref()))?;
        if ready == 0 {
            let why = "nothing more was written to it for some seconds";
            return Err(io::Error::new(io::ErrorKind::TimedOut, why));
        }
        Ok(())
    }
}

impl Read for PatientFile {
    fn read(&mut self, buf: &mut [u8]) -> io::Result<usize> {
        loop {
            if !self.is_regular {
                self.wait()?;
            }
            match self.file.read(buf) {
                // Another process may have read it.
                Err(error) if error.kind() == io::ErrorKind::WouldBlock => {}
                outcome => return outcome,
            }
        }
    }
}
