//! Reading of one motor's PG wire by the firmware: distance and speed of the wheel.
//!
//! The wire gives pulses without a direction. The firmware takes them for pulses of the direction
//! in which it last drove the motor, and after a reversal for those of the old one as long as the
//! wheel needs to come to a stand; where the wheel was dragged or coasted the other way, that is
//! wrong, as it is on the real board.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::SimTime;

/// Most pulse times kept to measure the speed.
const MOST_EDGES: usize = 256;

/// Over what time the speed is measured; assumed: ten pulses at full speed.
const WINDOW: Duration = Duration::from_millis(200);
/// Time without a pulse after which a wheel counts as standing: one pulse a second is 1 rpm.
const TIMEOUT: Duration = Duration::from_secs(1);

/// The time in which a wheel goes from full speed to a stand.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Stopping {
    /// Time for which it is driven the other way.
    pub reversed: Duration,
    /// Time for which it is held.
    pub held: Duration,
}

/// Speed that a wheel should have by what its motor was asked to do, in shares of its full speed.
#[derive(Debug, Clone, Copy)]
struct Expected {
    at: SimTime,
    share: f64,
    wanted: f64,
}

impl Expected {
    fn share(&self, now: SimTime, stopping: Stopping) -> f64 {
        let full = if self.wanted == 0.0 {
            stopping.held
        } else {
            stopping.reversed
        };
        if full.is_zero() {
            return self.wanted;
        }
        let most = now.since(self.at).as_secs_f64() / full.as_secs_f64();
        self.share + (self.wanted - self.share).clamp(-most, most)
    }
}

/// One motor's pulse counter.
#[derive(Debug, Clone)]
pub struct Encoder {
    stopping: Stopping,
    /// As the wire had it last.
    count: u32,
    /// The way in which the motor is or was last driven, and the way in which pulses counted last.
    backward: bool,
    counted_backward: bool,
    expected: Expected,
    /// Times at which pulses came, and the place of the wheel by then, in pulses from the first of
    /// these.
    edges: VecDeque<(SimTime, i64)>,
}

impl Encoder {
    /// A counter that starts where the wire is.
    #[must_use]
    pub fn new(stopping: Stopping, count: u32) -> Self {
        Self {
            stopping,
            count,
            backward: false,
            counted_backward: false,
            expected: Expected {
                at: SimTime::ZERO,
                share: 0.0,
                wanted: 0.0,
            },
            edges: VecDeque::new(),
        }
    }

    /// The motor is to turn with this share of its full speed from now on, negative backward.
    pub fn drive(&mut self, now: SimTime, share: f64) {
        if self.expected.wanted.to_bits() != share.to_bits() {
            self.expected = Expected {
                at: now,
                share: self.expected.share(now, self.stopping),
                wanted: share,
            };
        }
        if share != 0.0 {
            self.backward = share < 0.0;
        }
    }

    /// Returns whether the motor was last driven backward.
    #[must_use]
    pub fn is_backward(&self) -> bool {
        self.backward
    }

    /// Reads the wire; returns the pulses since the last reading, backward ones negative.
    pub fn read(&mut self, now: SimTime, count: u32) -> i64 {
        let came = count.wrapping_sub(self.count);
        self.count = count;
        if came == 0 {
            return 0;
        }
        let came = match self.turns_back(now) {
            true => -i64::from(came),
            false => i64::from(came),
        };
        self.add_edges(now, came);
        came
    }

    /// Distance that pulses that were read get on in the direction in which the motor is driven.
    #[must_use]
    pub fn progress(&self, pulses: i64) -> i64 {
        if self.backward { -pulses } else { pulses }
    }

    /// Pulses a second, backward negative. A wheel that is not `driven` stands as soon as its next
    /// pulse is overdue; a driven one may only have become slow.
    #[must_use]
    pub fn pulse_rate(&self, now: SimTime, driven: bool) -> f64 {
        let (Some(first), Some(last)) = (self.edges.front(), self.edges.back()) else {
            return 0.0;
        };
        let span = last.0.since(first.0).as_secs_f64();
        let silence = now.since(last.0);
        if span <= 0.0 || silence >= TIMEOUT {
            return 0.0;
        }
        #[expect(clippy::cast_precision_loss, reason = "far fewer pulses than 2^53")]
        let rate = (last.1 - first.1) as f64 / span;
        let silence = silence.as_secs_f64();
        if silence * rate.abs() <= 1.0 {
            rate
        } else if driven {
            rate.signum() / silence
        } else {
            0.0
        }
    }

    /// Returns whether the wheel should turn backward.
    fn turns_back(&mut self, now: SimTime) -> bool {
        let share = self.expected.share(now, self.stopping);
        let backward = if share == 0.0 {
            self.backward
        } else {
            share < 0.0
        };
        if backward != self.counted_backward {
            self.counted_backward = backward;
            self.edges.clear();
        }
        backward
    }

    fn add_edges(&mut self, now: SimTime, came: i64) {
        let last = self.edges.back().copied();
        if last.is_some_and(|(at, _)| now.since(at) >= TIMEOUT) {
            // From standstill; the time before tells nothing about the speed.
            self.edges.clear();
        }
        let total = self.edges.back().map_or(0, |(_, total)| *total) + came;
        match self.edges.back_mut() {
            Some((at, last)) if *at == now => *last = total,
            _ => self.edges.push_back((now, total)),
        }
        // The one edge before the window stays, so that its whole length is measured.
        let begin = now - WINDOW;
        while self.edges.len() > MOST_EDGES || self.edges.get(1).is_some_and(|(at, _)| *at <= begin)
        {
            self.edges.pop_front();
        }
    }
}

#[cfg(test)]
mod tests;
