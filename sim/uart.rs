//! Reading of a UART of bytes that were sent at another speed than it listens at.
//!
//! A byte goes over the line as a start bit (low), eight data bits, least significant first, and a
//! stop bit (high). The receiver waits for a falling edge and looks at the line in the middle of
//! each of the ten bits, by its own clock. Where the clocks differ by more than about five per
//! cent in either direction it looks at the wrong bits, and where they differ much it finds more
//! or fewer bytes than were sent.

mod adapter;

use std::collections::VecDeque;
use std::time::Duration;

pub(crate) use adapter::Inbox;
pub use adapter::{Adapter, UART_FIFO};

/// Bits on the line for each byte: start, eight data, stop.
pub const BITS_PER_BYTE: u64 = 10;
const BITS: u128 = BITS_PER_BYTE as u128;

/// Time that one byte of eight bits takes at `baud` with so many stop bits, to the nearest
/// nanosecond.
#[must_use]
pub fn byte_time(baud: u32, stop_bits: u8) -> Duration {
    let baud = u64::from(baud.max(1));
    let bits = BITS_PER_BYTE - 1 + u64::from(stop_bits);
    Duration::from_nanos((bits * 1_000_000_000 + baud / 2) / baud)
}

/// A receiver that listens to a burst at another speed than the sender's.
///
/// It hands on bytes whose stop bit is wrong too, as common UARTs do, and then waits for the line
/// to go high.
#[derive(Debug, Clone)]
pub struct Receiver {
    /// Time is counted in units of 1/(from·to) seconds, so that a bit is a whole number at both
    /// speeds; half of the receiver's bit needs a factor of two.
    sent_bit: u128,
    read_bit: u128,
    /// Bytes that were sent, as far as they still matter, and the number of those before.
    sent: VecDeque<u8>,
    forgotten: u128,
    /// Place of the receiver, and the level of the line just before.
    time: u128,
    was_high: bool,
}

impl Receiver {
    /// At the beginning of a burst, after an idle line.
    #[must_use]
    pub fn new(from_baud: u32, to_baud: u32) -> Self {
        let (from, to) = (u128::from(from_baud.max(1)), u128::from(to_baud.max(1)));
        Self {
            sent_bit: 2 * to,
            read_bit: 2 * from,
            sent: VecDeque::new(),
            forgotten: 0,
            time: 0,
            was_high: true,
        }
    }

    /// These bytes follow those before without a pause.
    pub fn hear(&mut self, bytes: &[u8]) {
        self.sent.extend(bytes);
    }

    /// Number of bytes that it keeps because they still matter.
    #[must_use]
    pub fn pending(&self) -> usize {
        self.sent.len()
    }

    /// The next byte that is what it is, whatever follows.
    pub fn next_settled(&mut self) -> Option<u8> {
        let found = self.advance(false);
        while self.time >= (self.forgotten + 1) * BITS * self.sent_bit
            && self.sent.pop_front().is_some()
        {
            self.forgotten += 1;
        }
        found
    }

    /// All that is still to come if the line is idle from here on.
    #[must_use]
    pub fn if_idle(&self) -> Vec<u8> {
        let mut receiver = self.clone();
        std::iter::from_fn(|| receiver.advance(true)).collect()
    }

    /// Goes on to the end of the next byte; unless the line is `idle` behind what was sent, only if
    /// all that it has to look at is known.
    fn advance(&mut self, idle: bool) -> Option<u8> {
        let end = (self.forgotten + self.sent.len() as u128) * BITS * self.sent_bit;
        let known = |time: u128| idle || time < end;
        while self.time < end {
            let next_bit = (self.time / self.sent_bit + 1) * self.sent_bit;
            let high = self.level(self.time);
            if !self.was_high || high {
                // No falling edge here: go to the next bit of the sender.
                self.was_high = high;
                self.time = next_bit;
                continue;
            }
            let middle = |bit: u128| self.time + bit * self.read_bit + self.read_bit / 2;
            if !known(middle(0)) {
                return None;
            }
            if self.level(middle(0)) {
                // A glitch shorter than half a bit is not a start bit.
                self.was_high = true;
                self.time = next_bit;
                continue;
            }
            let stop = middle(9);
            if !known(stop) {
                return None;
            }
            let byte = (0..8).fold(0, |byte, bit| {
                byte | u8::from(self.level(middle(1 + bit))) << bit
            });
            self.was_high = self.level(stop);
            self.time = stop;
            return Some(byte);
        }
        None
    }

    /// Returns whether the line is high at a time that is not forgotten.
    fn level(&self, time: u128) -> bool {
        let index = time / self.sent_bit;
        let at = (index / BITS).checked_sub(self.forgotten);
        let byte = at.and_then(|at| self.sent.get(usize::try_from(at).ok()?));
        match (byte, index % BITS) {
            (None, _) | (Some(_), 9) => true,
            (Some(_), 0) => false,
            (Some(byte), bit) => byte >> (bit - 1) & 1 == 1,
        }
    }
}

#[cfg(test)]
mod tests;
