//! Bytes that faults of the wire hold back, between the line and its reader.

use std::collections::VecDeque;

use rigsim_settings::SimTime;

/// Most bytes held in one direction; further ones are lost, as in a full adapter.
const MOST_HELD: usize = 16_384;

/// One direction of one link. Bytes never overtake one another.
#[derive(Debug, Default)]
pub(super) struct DelayLine {
    held: VecDeque<(SimTime, u8)>,
}

/// The time of a byte that is held until something releases it.
const HELD: SimTime = SimTime::MAX;

impl DelayLine {
    pub(super) fn push(&mut self, at: SimTime, byte: u8) {
        let last = self.held.back().map_or(SimTime::ZERO, |(at, _)| *at);
        if self.held.len() < MOST_HELD {
            self.held.push_back((at.max(last), byte));
        }
    }

    /// Number of bytes for which it has room.
    pub(super) fn room(&self) -> usize {
        MOST_HELD - self.held.len()
    }

    pub(super) fn take(&mut self, now: SimTime) -> Option<(SimTime, u8)> {
        self.held.pop_front_if(|(at, _)| *at <= now)
    }

    pub(super) fn next(&self) -> Option<SimTime> {
        self.held.front().map(|(at, _)| *at).filter(|at| *at < HELD)
    }

    pub(super) fn is_empty(&self) -> bool {
        self.held.is_empty()
    }

    /// Loses what has not arrived by `now`.
    pub(super) fn cut(&mut self, now: SimTime) {
        self.held.retain(|(at, _)| *at <= now);
    }

    /// Releases everything that was stalled.
    pub(super) fn release(&mut self, now: SimTime) {
        for (at, _) in self.held.iter_mut().filter(|(at, _)| *at == HELD) {
            *at = now;
        }
    }
}
