//! The end of a run: requested, then enforced.

use std::time::{Duration, Instant};

use rustix::process::Signal;

use crate::Reason;
use crate::traced::limits::own_processor_time;
use crate::traced::sys::{self, TICK, Tid};
use crate::traced::tracer::Tracer;

/// Simulated time that programs have to end when asked to.
const GRACE: u64 = 2_000_000_000;

/// Real time that killed programs have to disappear.
const KILL_PATIENCE: Duration = Duration::from_secs(10);

impl Tracer<'_> {
    /// Returns whether the time allowed is over, or an end was asked for; notes which.
    pub(crate) fn is_over_time(&mut self) -> bool {
        if self.options.stop.load(std::sync::atomic::Ordering::Relaxed) {
            self.reason.get_or_insert(Reason::Stopped);
            return true;
        }
        // This is called often, and costs a syscall for each process.
        let now = sys::coarse_time();
        if !self.limits.is_over && now.saturating_sub(self.limits.checked) >= TICK {
            self.limits.checked = now;
            let until = self.options.until;
            let real = until.is_some_and(|until| Instant::now() >= until);
            let used = self.used_time();
            self.limits.is_over = real || self.options.allowed.is_some_and(|most| used >= most);
            if self.limits.is_over && self.reason.is_none() {
                let doing = self.doing();
                self.reason = Some(Reason::OutOfTime { real, doing });
            }
        }
        self.limits.is_over
    }

    /// Time that counts for the limit: of processors, and of waits for the world outside.
    fn used_time(&mut self) -> Duration {
        let own = own_processor_time().saturating_sub(self.limits.begun);
        let mut used = self.limits.used + own;
        for (pid, process) in &mut self.tree.processes {
            process.measure(*pid);
            used += process.used;
        }
        used
    }

    /// Asks all processes to end; those that do not are killed after a while.
    pub(crate) fn ask_to_end(&mut self, reason: Reason) {
        self.reason.get_or_insert(reason);
        self.limits.killed_at = Some(self.now + GRACE);
        for pid in self.tree.processes.keys() {
            sys::kill(*pid, Signal::TERM);
        }
        self.schedule.signalled = true;
        self.schedule.happened += 1;
    }

    pub(crate) fn is_dying(&mut self, pid: Tid) {
        if let Some(process) = self.tree.processes.get_mut(&pid) {
            process.dying = true;
            process.measure(pid);
        }
    }

    /// Kills all processes and waits until they have gone.
    pub(crate) fn kill_all(&mut self) {
        let begun = Instant::now();
        while !self.tree.processes.is_empty() && begun.elapsed() < KILL_PATIENCE {
            for pid in self.tree.processes.keys() {
                sys::kill(*pid, Signal::KILL);
            }
            match sys::wait(None, true) {
                Ok(Some((tid, status))) if libc::WIFSTOPPED(status) => {
                    // A child that was being made, or a thread that is exiting.
                    sys::kill(tid, Signal::KILL);
                    let _ = sys::resume(tid, 0);
                }
                Ok(Some((tid, status))) => self.gone(tid, status),
                Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                    self.tree.processes.clear();
                }
                _ => {}
            }
        }
        self.tree.threads.clear();
        // Orphans have become children of this program.
        for pid in std::mem::take(&mut self.tree.ended) {
            sys::reap(pid, false);
        }
    }
}
