//! Listeners, and what each is to get next.

use std::time::{Duration, Instant};

use rigsim_control::{Listener, Message};
use rigsim_core::SimTime;
use rigsim_runner::run::Probe;
use rigsim_runner::run::StepReport;

/// The part of a step that may change: when it began and was done, how often it has hit, whether it lasts
/// and has failed.
pub(super) type Progress = (Option<SimTime>, Option<SimTime>, u64, bool, bool);

pub(super) fn progress(step: &StepReport<'_>) -> Progress {
    let failed = step.failure.is_some();
    (step.begun, step.done, step.hits, step.lasting, failed)
}

/// A listener, and what it is to get next.
pub(super) struct Listening {
    pub(super) listener: Listener,
    pub(super) probes: Vec<Probe>,
    pub(super) values_next: Option<Instant>,
    pub(super) picture_next: Option<Instant>,
    pub(super) gone: bool,
    /// Steps as they were reported.
    steps: Vec<Progress>,
    /// Number of failures that were reported.
    pub(super) failures: usize,
}

impl Listening {
    /// The steps are as they are now.
    pub(super) fn new(
        listener: Listener,
        probes: Vec<Probe>,
        (steps, failures): (Vec<Progress>, usize),
        now: Instant,
    ) -> Self {
        Self {
            values_next: listener.wants.values_every.map(|_| now),
            picture_next: listener.wants.picture_every.map(|_| now),
            listener,
            probes,
            gone: false,
            steps,
            failures,
        }
    }

    /// Takes note of how far a step is; says whether that is new. The steps come in their order.
    pub(super) fn takes(&mut self, index: usize, now: Progress) -> bool {
        match self.steps.get_mut(index) {
            Some(sent) => std::mem::replace(sent, now) != now,
            None => {
                self.steps.push(now);
                true
            }
        }
    }

    pub(super) fn send(&mut self, message: &Message) {
        self.gone |= !self.listener.send(message);
    }
}

/// The number of requests and replies that are sent: a client that asks without a pause on an instant wire
/// would keep every other busy. In simulated time, so that in lockstep the same is sent each time.
#[derive(Debug, Default)]
pub(super) struct Traffic {
    next: SimTime,
}

impl Traffic {
    /// Between two, on average.
    const EVERY: Duration = Duration::from_micros(500);
    /// By how much they may be ahead of that.
    const AHEAD: Duration = Duration::from_millis(50);

    pub(super) fn has_room(&mut self, at: SimTime) -> bool {
        let has_room = self.next <= at + Self::AHEAD;
        if has_room {
            self.next = self.next.max(at) + Self::EVERY;
        }
        has_room
    }
}

/// Returns whether something is due by now, which then is due again later; what was missed is left
/// out.
pub(super) fn is_due(next: &mut Option<Instant>, every: Duration, now: Instant) -> bool {
    match next {
        Some(at) if *at <= now => {
            *at = (*at + every).max(now);
            true
        }
        _ => false,
    }
}

#[cfg(test)]
mod tests;
