//! Stalls of the machine.

use std::fs::File;
use std::os::unix::fs::FileExt;
use std::time::{Duration, Instant};

/// So many used-up budgets within a second mean that the machine is too slow.
const TOO_MANY_BUDGETS: u32 = 10;
/// For how long used-up budgets are counted together.
const COUNTED: Duration = Duration::from_secs(1);

/// Real time for which simulated time stood still since the machine did not let the simulator run,
/// or was too slow for it. A client's own clock went on meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Stalls {
    /// Number of times.
    pub times: u64,
    /// For how long in all.
    pub total: Duration,
    /// For how long at the longest.
    pub longest: Duration,
}

impl Stalls {
    pub(crate) fn add(&mut self, by: Duration) {
        self.times += 1;
        self.total = self.total.saturating_add(by);
        self.longest = self.longest.max(by);
    }
}

/// Notices when a machine is too slow for what is asked of it.
#[derive(Default)]
pub(crate) struct Slowness {
    /// Since when budgets are counted, and how many were used up.
    count: Option<(Instant, u32)>,
    /// Time at which there were last too many.
    slow_at: Option<Instant>,
}

impl Slowness {
    /// A budget was used up; says whether this is the first time that there are too many.
    pub(crate) fn count_overrun(&mut self) -> bool {
        let now = Instant::now();
        let (since, count) = self.count.unwrap_or((now, 0));
        let is_old = now - since > COUNTED;
        let (since, count) = if is_old { (now, 1) } else { (since, count + 1) };
        self.count = Some((since, count));
        count >= TOO_MANY_BUDGETS && self.slow_at.replace(now).is_none()
    }

    /// Returns whether it is too slow now.
    pub(crate) fn is_slow(&self) -> bool {
        self.slow_at.is_some_and(|at| at.elapsed() <= 2 * COUNTED)
    }
}

/// Time for which a thread was to run and others did, as Linux counts it. A thread that is woken by a client
/// cannot tell by the clock how long ago that was to be.
pub(crate) struct RunQueue(Option<File>);

impl RunQueue {
    /// Opens the count of the calling thread; without one no time is found.
    pub(crate) fn of_this_thread() -> Self {
        Self(File::open("/proc/thread-self/schedstat").ok())
    }

    /// Time so far. Source: the kernel's `Documentation/scheduler/sched-stats.rst`.
    pub(crate) fn waited(&self) -> Duration {
        let mut text = [0; 96];
        let read = self.0.as_ref().map(|file| file.read_at(&mut text, 0));
        let text = read.and_then(|read| std::str::from_utf8(text.get(..read.ok()?)?).ok());
        let nanoseconds = text.and_then(|text| text.split_whitespace().nth(1)?.parse().ok());
        Duration::from_nanos(nanoseconds.unwrap_or(0))
    }
}

#[cfg(test)]
mod tests;
