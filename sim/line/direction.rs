//! Bytes on their way from one end of a line to the other.

use std::collections::VecDeque;

use sim_settings::SimTime;

use super::{MOST_IN_FLIGHT, Wire};
use crate::uart::Receiver;

/// Relative difference of the speeds beyond which bytes arrive wrong.
const TOLERANCE: f64 = 0.035;

/// Bytes under way in one direction, oldest first.
#[derive(Debug, Clone, Default)]
pub(super) struct Direction {
    pub(super) under_way: VecDeque<(SimTime, u8)>,
    /// When the sender's shift register is empty.
    free_at: SimTime,
    /// The last burst, if it went at a wrong speed.
    garbled: Option<Burst>,
}

/// Bytes that follow one another at a speed that is not the receiver's.
#[derive(Debug, Clone)]
struct Burst {
    receiver: Receiver,
    /// Speeds of the sender and of the receiver.
    bauds: [u32; 2],
    begin: SimTime,
    /// When all of it has been sent.
    sent_at: SimTime,
    /// How many of the last bytes under way are what they are only if nothing follows.
    tentative: usize,
    /// When the first of them arrives.
    tentative_from: Option<SimTime>,
}

impl Burst {
    fn new(begin: SimTime, bauds: [u32; 2]) -> Self {
        let [from, to] = bauds;
        Self {
            receiver: Receiver::new(from, to),
            bauds,
            begin,
            sent_at: begin,
            tentative: 0,
            tentative_from: None,
        }
    }
}

impl Direction {
    /// `from` are the sender's speed and stop bits.
    pub(super) fn send(
        &mut self,
        now: SimTime,
        bytes: &[u8],
        from: (u32, u8),
        to_baud: u32,
        wire: Wire,
    ) {
        let (from_baud, stop_bits) = from;
        if !matches(from_baud, to_baud) {
            return self.send_garbled(now, bytes, [from_baud, to_baud], wire);
        }
        self.garbled = None;
        let byte_time = wire.byte_time(from_baud, stop_bits);
        let mut arrival = self.free_at.max(now);
        for &byte in bytes {
            arrival += byte_time;
            self.under_way.push_back((arrival, byte));
        }
        self.free_at = arrival;
    }

    /// Bytes at another speed than the receiver's. What it makes of them depends on where bytes
    /// follow one another without a pause, as on a cable: not on the pieces in which they were
    /// handed over.
    fn send_garbled(&mut self, now: SimTime, bytes: &[u8], bauds: [u32; 2], wire: Wire) {
        let goes_on = |burst: &Burst| {
            let tentative = burst.tentative_from.is_none_or(|arrival| arrival > now);
            let fits = burst.receiver.pending() < MOST_IN_FLIGHT;
            burst.bauds == bauds && wire == Wire::Paced && now <= burst.sent_at && tentative && fits
        };
        let mut burst = match self.garbled.take().filter(goes_on) {
            Some(burst) => {
                // The line was not idle after all.
                let kept = self.under_way.len().saturating_sub(burst.tentative);
                self.under_way.truncate(kept);
                burst
            }
            None => Burst::new(self.free_at.max(now), bauds),
        };
        burst.receiver.hear(bytes);
        // It is garbage with one stop bit or two.
        let byte_time = wire.byte_time(bauds[0], 1);
        let count = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
        burst.sent_at += byte_time * count;
        let begin = burst.begin;
        let arrives = |after| match wire {
            Wire::Paced => begin + after,
            Wire::Instant => begin,
        };
        while let Some(received) = burst.receiver.next_settled() {
            let arrival = arrives(received.after);
            self.under_way.push_back((arrival, received.byte));
        }
        let tentative = burst.receiver.if_idle();
        burst.tentative = tentative.len();
        burst.tentative_from = tentative.first().map(|first| arrives(first.after));
        let tentative = tentative.iter().map(|r| (arrives(r.after), r.byte));
        self.under_way.extend(tentative);
        // A slow receiver may still be at its last byte when the sender has finished.
        let last = self.under_way.back().map_or(begin, |(arrival, _)| *arrival);
        self.free_at = last.max(burst.sent_at);
        self.garbled = Some(burst);
    }

    pub(super) fn take(&mut self, now: SimTime) -> Option<u8> {
        self.under_way
            .pop_front_if(|(arrival, _)| *arrival <= now)
            .map(|(_, byte)| byte)
    }

    pub(super) fn next(&self) -> Option<SimTime> {
        self.under_way.front().map(|(arrival, _)| *arrival)
    }
}

pub(super) fn matches(a: u32, b: u32) -> bool {
    (f64::from(a) - f64::from(b)).abs() <= TOLERANCE * f64::from(b)
}
