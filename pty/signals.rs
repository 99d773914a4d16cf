//! The signals that ask a simulator to stop, turned into something to wait on.

use std::fmt;
use std::io::{self, Read as _};
use std::os::unix::net::UnixStream;
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use rustix::fd::{AsFd, BorrowedFd};
use signal_hook::SigId;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM, SIGXCPU};
use signal_hook::low_level::{pipe, unregister};

/// A signal that asks the program to stop.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum TerminationSignal {
    /// `SIGINT`, Ctrl-C.
    Interrupt,
    /// `SIGTERM`, what `kill` and service managers send.
    Terminate,
    /// `SIGHUP`, the terminal was closed.
    Hangup,
    /// `SIGXCPU`, the limit of processor time has been reached; some seconds later the system
    /// kills.
    ProcessorTime,
}

impl TerminationSignal {
    const ALL: [Self; 4] = [
        Self::Interrupt,
        Self::Terminate,
        Self::Hangup,
        Self::ProcessorTime,
    ];

    fn number(self) -> i32 {
        match self {
            Self::Interrupt => SIGINT,
            Self::Terminate => SIGTERM,
            Self::Hangup => SIGHUP,
            Self::ProcessorTime => SIGXCPU,
        }
    }
}

impl fmt::Display for TerminationSignal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Interrupt => "SIGINT",
            Self::Terminate => "SIGTERM",
            Self::Hangup => "SIGHUP",
            Self::ProcessorTime => "SIGXCPU",
        })
    }
}

/// Catches the signals for as long as it lives.
#[derive(Debug)]
pub(crate) struct Signals {
    pipe: UnixStream,
    last: Arc<AtomicUsize>,
    handlers: Vec<SigId>,
}

impl Signals {
    pub(crate) fn catch() -> io::Result<Self> {
        let (pipe, sender) = UnixStream::pair()?;
        pipe.set_nonblocking(true)?;
        let mut signals = Self {
            pipe,
            last: Arc::new(AtomicUsize::new(0)),
            handlers: Vec::new(),
        };
        for (index, signal) in TerminationSignal::ALL.into_iter().enumerate() {
            if signal == TerminationSignal::Hangup && hangup_is_ignored() {
                continue;
            }
            // The number is stored before the pipe is written to, since
            // handlers run in the order of their registration.
            let store = Arc::clone(&signals.last);
            signals.handlers.push(signal_hook::flag::register_usize(
                signal.number(),
                store,
                index + 1,
            )?);
            signals
                .handlers
                .push(pipe::register(signal.number(), sender.try_clone()?)?);
        }
        Ok(signals)
    }

    /// The latest signal since the last call.
    pub(crate) fn take(&mut self) -> Option<TerminationSignal> {
        let mut sink = [0; 64];
        while matches!(self.pipe.read(&mut sink), Ok(n) if n == sink.len()) {}
        let index = self.last.swap(0, Ordering::SeqCst).checked_sub(1)?;
        TerminationSignal::ALL.get(index).copied()
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

/// Tells whether the program was started with `SIGHUP` ignored, as `nohup` does:
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
