//! The end of a run: asked for, and made sure of.

use std::time::{Duration, Instant};

use crate::Reason;
use crate::traced::sys::{self, Tid, Whom};
use crate::traced::tracer::Tracer;

/// Simulated time in which programs that were asked to end may do so.
const GRACE: u64 = 2_000_000_000;

/// Real time in which killed programs must have gone.
const KILL_PATIENCE: Duration = Duration::from_secs(10);

impl Tracer<'_> {
    /// Tells whether the real time allowed is over, or somebody asks for the end; notes which.
    pub(crate) fn is_over_time(&mut self) -> bool {
        let stop = self.options.stop.load(std::sync::atomic::Ordering::Relaxed);
        let late = self
            .options
            .until
            .is_some_and(|until| Instant::now() >= until);
        if self.reason.is_none() {
            if stop {
                self.reason = Some(Reason::Stopped);
            } else if late {
                self.reason = Some(Reason::OutOfTime(self.doing()));
            }
        }
        stop || late
    }

    /// Asks everybody to end; whoever does not is killed after a while.
    pub(crate) fn ask_to_end(&mut self, reason: Reason) {
        self.reason.get_or_insert(reason);
        self.killed_at = Some(self.now + GRACE);
        for pid in self.processes.keys() {
            // Who has gone meanwhile need not be asked.
            let _ = sys::kill(*pid, libc::SIGTERM);
        }
        self.signalled = true;
    }

    /// Marks a process as on its way out.
    pub(crate) fn is_dying(&mut self, pid: Tid) {
        if let Some(process) = self.processes.get_mut(&pid) {
            process.dying = true;
        }
    }

    /// Kills everybody and waits until they have gone.
    pub(crate) fn kill_all(&mut self) {
        let begun = Instant::now();
        while !self.processes.is_empty() && begun.elapsed() < KILL_PATIENCE {
            for pid in self.processes.keys() {
                let _ = sys::kill(*pid, libc::SIGKILL);
            }
            match sys::wait(Whom::Anybody, true) {
                Ok(Some((tid, status))) if libc::WIFSTOPPED(status) => {
                    // A child that was being made, or somebody on the way out.
                    let _ = sys::kill(tid, libc::SIGKILL);
                    let _ = sys::go_on(tid, 0);
                }
                Ok(Some((tid, status))) => self.gone(tid, status),
                Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                    self.processes.clear();
                }
                _ => {}
            }
        }
        self.threads.clear();
        // Those whose parent has ended before them have become children of this program.
        for pid in std::mem::take(&mut self.ended) {
            sys::reap(pid);
        }
    }
}
