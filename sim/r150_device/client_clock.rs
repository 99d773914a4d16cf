//! The client's clock, which runs on while a busy machine or a pause stops simulated time.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::SimTime;

/// Bytes that can wait for the line outside of the simulator: what a pseudo-terminal holds.
const PORT_BYTES: u64 = 4096;
/// Most entries that are kept; the newest then stands for those that follow.
const MOST: usize = 512;

/// Times, by the client's clock, between which it has sent something; ns since the start.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) struct Sent {
    earliest: i128,
    latest: i128,
}

impl Sent {
    /// Returns whether `self` may have been sent `span` after `first`, or later.
    pub(super) fn may_be_after(self, first: Self, span: Duration) -> bool {
        self.latest - first.earliest >= nanos(span)
    }
}

/// By how much the client's clock is ahead of simulated time, and was when the client sent what
/// still waits.
#[derive(Debug, Clone, Default)]
pub(super) struct ClientClock {
    ahead: i128,
    /// Until when something may arrive that was sent when the clock was ahead by so little. Both
    /// increase.
    waiting: VecDeque<(SimTime, i128)>,
}

impl ClientClock {
    /// What waits at `now` may have been sent up to `by` before, and simulated time stood still for
    /// `stood`. What waits is on its way for as long as a line of `baud` needs for it.
    pub(super) fn late(&mut self, now: SimTime, by: Duration, stood: Duration, baud: u32) {
        self.ahead += nanos(stood);
        let least = self.ahead - nanos(by);
        let bits = Duration::from_secs(PORT_BYTES * 10);
        let until = now + bits / baud.max(1);
        while self.waiting.back().is_some_and(|(_, of)| *of >= least) {
            self.waiting.pop_back();
        }
        let is_full = self.waiting.len() >= MOST;
        match self.waiting.back_mut() {
            Some((last, _)) if is_full || *last >= until => *last = until.max(*last),
            _ => self.waiting.push_back((until, least)),
        }
    }

    /// Returns when the client may have sent what has arrived at `now`.
    pub(super) fn sent(&mut self, now: SimTime) -> Sent {
        while self.waiting.front().is_some_and(|(until, _)| *until < now) {
            self.waiting.pop_front();
        }
        let least = self.waiting.front().map_or(self.ahead, |(_, of)| *of);
        let now = i128::from(now.as_nanos());
        Sent {
            earliest: now + least,
            latest: now + self.ahead,
        }
    }
}

fn nanos(span: Duration) -> i128 {
    i128::try_from(span.as_nanos()).unwrap_or(i128::MAX)
}

#[cfg(test)]
mod tests;
