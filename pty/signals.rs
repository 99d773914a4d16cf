//! The signals that ask a simulator to stop, turned into something to wait on, and one that would end it.

use std::io::{self, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use rustix::fd::{AsFd, BorrowedFd};
use signal_hook::SigId;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXCPU, SIGXFSZ};
use signal_hook::flag;
use signal_hook::low_level::{pipe, unregister};

/// Ctrl-C; what `kill` and service managers send; the terminal was closed; and the limit of processor
/// time has been reached, some seconds after which the system kills.
const ALL: [i32; 4] = [SIGINT, SIGTERM, SIGHUP, SIGXCPU];

/// Catches the signals for as long as it lives.
#[derive(Debug)]
pub(crate) struct Signals {
    pipe: UnixStream,
    handlers: Vec<SigId>,
}

impl Signals {
    pub(crate) fn catch() -> io::Result<Self> {
        let (pipe, sender) = UnixStream::pair()?;
        pipe.set_nonblocking(true)?;
        let mut signals = Self {
            pipe,
            handlers: Vec::new(),
        };
        for signal in caught() {
            let handler = pipe::register(signal, sender.try_clone()?)?;
            signals.handlers.push(handler);
        }
        Ok(signals)
    }

    /// Returns whether one has arrived since the last call.
    pub(crate) fn take(&mut self) -> bool {
        let mut sink = [0; 64];
        let mut any = false;
        while let Ok(count @ 1..) = self.pipe.read(&mut sink) {
            any = true;
            if count < sink.len() {
                break;
            }
        }
        any
    }
}

impl AsFd for Signals {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.pipe.as_fd()
    }
}

impl Drop for Signals {
    fn drop(&mut self) {
        for id in self.handlers.drain(..) {
            unregister(id);
        }
    }
}

/// Ends the process with an exit code at each of the signals, for as long as it lives: while nothing
/// has been begun that would have to be ended in order.
#[derive(Debug)]
pub struct ExitOnSignals(Vec<SigId>);

impl ExitOnSignals {
    /// Begins with it.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn with(code: i32) -> io::Result<Self> {
        let mut handlers = Self(Vec::new());
        for signal in caught() {
            let always = Arc::new(AtomicBool::new(true));
            let handler = flag::register_conditional_shutdown(signal, code, always)?;
            handlers.0.push(handler);
        }
        Ok(handlers)
    }
}

impl Drop for ExitOnSignals {
    fn drop(&mut self) {
        for id in self.0.drain(..) {
            unregister(id);
        }
    }
}

/// The signals that are caught.
fn caught() -> impl Iterator<Item = i32> {
    ALL.into_iter()
        .filter(|signal| *signal != SIGHUP || !hangup_is_ignored())
}

/// Returns whether the program was started with `SIGHUP` ignored, as `nohup` does:
/// then it is meant to outlive its terminal.
fn hangup_is_ignored() -> bool {
    std::fs::read_to_string("/proc/self/status").is_ok_and(|status| is_ignored(&status, SIGHUP))
}

fn is_ignored(status: &str, signal: i32) -> bool {
    status
        .lines()
        .find_map(|line| line.strip_prefix("SigIgn:"))
        .and_then(|mask| u64::from_str_radix(mask.trim(), 16).ok())
        .is_some_and(|mask| mask & (1 << (signal - 1)) != 0)
}

/// Makes a write beyond the limit of file sizes (`RLIMIT_FSIZE`) an error, as on a full disk, instead of
/// ending the program. Programs that it starts are ended as ever.
///
/// # Errors
/// When the system refuses.
pub fn survive_full_files() -> io::Result<()> {
    // A handler, and not to ignore it, since what is ignored stays so in programs that are started.
    flag::register(SIGXFSZ, Arc::new(AtomicBool::new(false))).map(drop)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_ignored_signal_is_found_in_the_mask() {
        let nohup = "Name:\tsim\nSigBlk:\t0000000000000006\nSigIgn:\t0000000000001001\n";
        assert!(is_ignored(nohup, SIGHUP));
        assert!(!is_ignored(nohup, SIGINT));
        assert!(!is_ignored("", SIGHUP));
    }
}
