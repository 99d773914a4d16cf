//! The CAN from the module to the vehicle's controller, on which the motor set-points go.
//!
//! As long as it works it takes no time. When it fails the module knows nothing of it and goes on
//! answering; the controller goes on with what it heard last, and stops the motors when it has
//! heard nothing for a while.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::SimTime;

use super::CAN_TIMEOUT;

/// Way in which it fails.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum CanFailure {
    /// The controller hears nothing.
    Cut,
    /// It hears everything so much later.
    Late(Duration),
}

/// Most set-points on their way; the oldest arrive at once where there are more.
const MOST_UNDER_WAY: usize = 4096;

/// Set-points that the vehicle's controller hears, right then left. By default it works.
#[derive(Debug, Clone, Default)]
pub struct Can {
    failure: Option<CanFailure>,
    /// Time at which the silence began.
    silent_since: Option<SimTime>,
    said: [i16; 2],
    heard: [i16; 2],
    under_way: VecDeque<(SimTime, [i16; 2])>,
}

impl Can {
    /// Fails in another way, or no more.
    pub fn fail(&mut self, now: SimTime, said: [i16; 2], failure: Option<CanFailure>) {
        if failure != self.failure {
            self.update(now, said);
            self.failure = failure;
            self.silent_since = None;
            self.under_way.clear();
            self.update(now, said);
        }
    }

    /// The module says this now.
    pub fn update(&mut self, now: SimTime, said: [i16; 2]) {
        let is_new = said != std::mem::replace(&mut self.said, said);
        match self.failure {
            None => self.heard = said,
            Some(CanFailure::Cut) => {
                let since = *self.silent_since.get_or_insert(now);
                if now >= since + CAN_TIMEOUT {
                    self.heard = [0; 2];
                }
            }
            Some(CanFailure::Late(delay)) => {
                if is_new {
                    self.under_way.push_back((now + delay, said));
                }
                while let Some((due, set_point)) = self.under_way.front().copied()
                    && (due <= now || self.under_way.len() > MOST_UNDER_WAY)
                {
                    self.heard = set_point;
                    self.under_way.pop_front();
                }
            }
        }
    }

    /// Time at which what the controller hears next changes by itself.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        match self.failure? {
            CanFailure::Cut => {
                let due = self.silent_since? + CAN_TIMEOUT;
                (self.heard != [0; 2]).then_some(due)
            }
            CanFailure::Late(_) => self.under_way.front().map(|(due, _)| *due),
        }
    }

    /// The set-point as the controller has it, when this is what the module says.
    #[must_use]
    pub fn heard(&self, said: [i16; 2]) -> [i16; 2] {
        self.failure.map_or(said, |_| self.heard)
    }
}

#[cfg(test)]
mod tests;
