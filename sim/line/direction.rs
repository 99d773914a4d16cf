//! Bytes on their way from one end of a line to the other.

use std::collections::VecDeque;
use std::ops::Range;
use std::time::Duration;

use rigsim_settings::SimTime;

use super::{MOST_IN_FLIGHT, Wire};
use crate::uart::{self, Receiver};

/// Relative difference of the speeds beyond which bytes arrive wrong.
const TOLERANCE: f64 = 0.035;

/// Settings of both ends of a direction at the moment.
#[derive(Debug, Clone, Copy)]
pub(super) struct Ends {
    pub(super) from_baud: u32,
    pub(super) stop_bits: u8,
    pub(super) to_baud: u32,
    pub(super) wire: Wire,
}

impl Ends {
    /// Time that a byte takes.
    pub(super) fn byte_time(self) -> Duration {
        match self.wire {
            Wire::Paced | Wire::Bare => uart::byte_time(self.from_baud, self.stop_bits),
            Wire::Instant => Duration::ZERO,
        }
    }
}

/// Bytes that one end has handed over and the other has not taken yet.
///
/// The sender's shift register holds one byte at a time. A byte goes at the speeds that both ends
/// have while it is under way, so a change of them has to be passed to [`change`](Self::change).
#[derive(Debug, Clone, Default)]
pub(super) struct Direction {
    /// The first of them is in the shift register.
    waiting: VecDeque<Sent>,
    /// Time at which that one has gone.
    shifting: Option<SimTime>,
    /// Time at which it begins.
    begins: SimTime,
    /// Speeds that differed while that byte was under way, and have changed since.
    spoilt: Option<[u32; 2]>,
    /// Time at which the shift register was last empty.
    free_at: SimTime,
    /// The receiver that listens at another speed, and both speeds.
    garbled: Option<(Receiver, [u32; 2])>,
    arrived: VecDeque<(SimTime, Sent)>,
}

/// A byte, and whether it is the first of those that were handed over together.
#[derive(Debug, Clone, Copy)]
struct Sent {
    byte: u8,
    first: bool,
    /// Time from which it can go.
    from: SimTime,
}

impl Direction {
    /// Number of bytes that have been handed over and have not arrived.
    pub(super) fn waiting(&self) -> usize {
        self.waiting.len()
    }

    /// Number of bytes that it keeps.
    pub(super) fn kept(&self) -> usize {
        self.waiting.len() + self.arrived.len()
    }

    /// Hands bytes over, which can go from a time on.
    pub(super) fn send(&mut self, now: SimTime, from: SimTime, bytes: &[u8], ends: Ends) {
        self.catch_up(now, ends);
        let sent = |(place, &byte)| Sent {
            byte,
            first: place == 0,
            from,
        };
        self.waiting.extend(bytes.iter().enumerate().map(sent));
        self.shift(now, ends);
        self.catch_up(now, ends);
    }

    /// Brings everything to where it is at `now` with the ends as they have been until then.
    pub(super) fn catch_up(&mut self, now: SimTime, ends: Ends) {
        while let Some(gone) = self.shifting.filter(|gone| *gone <= now) {
            self.shifting = None;
            self.free_at = gone;
            let Some(sent) = self.waiting.pop_front() else {
                return;
            };
            self.shift(gone, ends);
            self.hear(sent, gone, ends);
        }
    }

    /// Both ends are no longer as they have been until `now`: what is left of the byte that is under
    /// way goes at the new speed, and a byte that met different speeds stays spoilt.
    pub(super) fn change(&mut self, now: SimTime, old: Ends, new: Ends) {
        self.catch_up(now, old);
        let Some(gone) = &mut self.shifting else {
            return;
        };
        if self.begins > now {
            self.shifting = None;
            return self.shift(now, new);
        }
        if old.from_baud != new.from_baud && old.from_baud > 0 && new.from_baud > 0 {
            let share = f64::from(old.from_baud) / f64::from(new.from_baud);
            *gone = now + gone.since(now).mul_f64(share);
        }
        if !matches(old.from_baud, old.to_baud) {
            self.spoilt = Some([old.from_baud, old.to_baud]);
        }
    }

    /// The first byte that waits goes into the shift register if that is empty.
    fn shift(&mut self, now: SimTime, ends: Ends) {
        if self.shifting.is_none()
            && let Some(first) = self.waiting.front()
        {
            self.begins = self.free_at.max(now).max(first.from);
            if self.begins > self.free_at {
                self.garbled = None;
            }
            self.shifting = Some(self.begins + ends.byte_time());
        }
    }

    /// The receiver has heard a byte. At another speed, what it makes of it depends on what follows
    /// without a pause, as on a cable, and not on the pieces in which bytes were handed over.
    fn hear(&mut self, sent: Sent, gone: SimTime, ends: Ends) {
        let spoilt = self.spoilt.take();
        let speeds = spoilt.unwrap_or([ends.from_baud, ends.to_baud]);
        if speeds.contains(&0) {
            // A port that has hung up neither sends nor hears.
            self.garbled = None;
            return;
        }
        if matches(speeds[0], speeds[1]) {
            self.garbled = None;
            self.arrived.push_back((gone, sent));
            return;
        }
        let kept = self.garbled.take();
        let kept = kept
            .filter(|(receiver, known)| *known == speeds && receiver.pending() < MOST_IN_FLIGHT);
        let (mut receiver, _) =
            kept.unwrap_or_else(|| (Receiver::new(speeds[0], speeds[1]), speeds));
        receiver.hear(&[sent.byte]);
        // Nothing is whole any more, so that each stands for itself.
        let whole = |byte| Sent {
            byte,
            first: true,
            ..sent
        };
        let heard = |byte| (gone, whole(byte));
        let settled = std::iter::from_fn(|| receiver.next_settled());
        self.arrived.extend(settled.map(heard));
        if self.shifting.is_some() && spoilt.is_none() {
            self.garbled = Some((receiver, speeds));
        } else {
            // Nothing follows at these speeds, so that the line is idle behind it.
            let last = receiver.if_idle();
            self.arrived.extend(last.into_iter().map(heard));
        }
    }

    /// Takes back all but so many of the bytes that have not begun their way.
    pub(super) fn discard_beyond(&mut self, kept: usize, now: SimTime) {
        let begun = usize::from(self.shifting.is_some() && self.begins <= now);
        self.waiting.truncate(begun + kept);
        self.shifting.take_if(|_| self.waiting.is_empty());
    }

    /// Loses the oldest of what was handed over together, until there is room for so many bytes more or
    /// nothing is left that is still whole: of which no byte is going out or was taken. Says how many
    /// bytes are lost.
    pub(super) fn make_room(&mut self, bytes: usize) -> usize {
        let before = self.kept();
        while self.kept() + bytes > MOST_IN_FLIGHT && self.lose_oldest() {}
        before - self.kept()
    }

    /// Says whether there was any.
    fn lose_oldest(&mut self) -> bool {
        let last_is_whole = self.waiting.front().is_none_or(|sent| sent.first);
        let arrived = self.arrived.iter().map(|(_, sent)| sent.first);
        if let Some(oldest) = whole(arrived, 0, last_is_whole) {
            self.arrived.drain(oldest);
            return true;
        }
        let begun = usize::from(self.shifting.is_some());
        let oldest = whole(self.waiting.iter().map(|sent| sent.first), begun, true);
        let found = oldest.map(|oldest| self.waiting.drain(oldest));
        found.is_some()
    }

    /// No client is there to take what has arrived.
    pub(super) fn lose_arrived(&mut self) {
        self.arrived.clear();
    }

    /// The next byte that has arrived by `now`, as far as [`catch_up`](Self::catch_up) has got, and when.
    pub(super) fn take(&mut self, now: SimTime) -> Option<(SimTime, u8)> {
        let first = self.arrived.pop_front_if(|(at, _)| *at <= now);
        first.map(|(at, sent)| (at, sent.byte))
    }

    /// Time at which something next arrives, or has arrived and was not taken.
    pub(super) fn next(&self) -> Option<SimTime> {
        let arrived = self.arrived.front().map(|(at, _)| *at);
        arrived.or(self.shifting)
    }
}

/// Where the first lies that is whole, in a queue of which it is known where something begins.
fn whole(
    firsts: impl Iterator<Item = bool>,
    from: usize,
    last_is_whole: bool,
) -> Option<Range<usize>> {
    let mut firsts = firsts.enumerate().skip(from);
    let (begin, _) = firsts.find(|(_, first)| *first)?;
    let mut end = begin + 1;
    for (place, first) in firsts {
        if first {
            return Some(begin..place);
        }
        end = place + 1;
    }
    last_is_whole.then_some(begin..end)
}

pub(super) fn matches(a: u32, b: u32) -> bool {
    (f64::from(a) - f64::from(b)).abs() <= TOLERANCE * f64::from(b)
}
