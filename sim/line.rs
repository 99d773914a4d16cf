//! A serial line between a client and a device: its speed, and what goes wrong on it.

use std::collections::VecDeque;
use std::fmt;
use std::time::Duration;

use sim_settings::{SimTime, choices};

use crate::event::Level;
use crate::uart;

choices! {
    /// Whether bytes take time on the line.
    pub enum Wire {
        /// Each byte takes ten bits at the sender's baud rate, as on a cable.
        Paced = "paced",
        /// Bytes arrive the moment they are sent.
        Instant = "instant",
    }
}

/// Most bytes under way in one direction; the client's further bytes wait in its port's buffer,
/// the device's further replies are dropped whole.
pub const MOST_IN_FLIGHT: usize = 4096;

/// Relative difference of the speeds beyond which bytes arrive wrong.
const TOLERANCE: f64 = 0.035;

/// Something that happened on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum LineEvent {
    /// A client opened the port.
    Attached,
    /// The client closed the port or died.
    Detached,
    /// The client's speed is not the device's.
    BaudMismatch {
        /// Speed that the client has set.
        client: u32,
        /// Speed of the device.
        device: u32,
    },
    /// The client's speed is the device's again.
    BaudMatched {
        /// Speed of both.
        baud: u32,
    },
    /// The client does not read; bytes for it were lost.
    Overrun {
        /// How many.
        bytes: u64,
    },
    /// The line was too full for a reply of the device.
    ReplyDropped {
        /// Its length in bytes.
        bytes: usize,
    },
}

impl LineEvent {
    /// How much it matters.
    #[must_use]
    pub fn level(&self) -> Level {
        match self {
            Self::Attached | Self::Detached | Self::BaudMatched { .. } => Level::Notice,
            _ => Level::Warning,
        }
    }

    /// A short stable name, the same in logs, reports and documentation.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Attached => "client_attached",
            Self::Detached => "client_detached",
            Self::BaudMismatch { .. } => "baud_mismatch",
            Self::BaudMatched { .. } => "baud_matched",
            Self::Overrun { .. } => "overrun",
            Self::ReplyDropped { .. } => "line_full",
        }
    }

    /// Whether the client did something that it should not.
    #[must_use]
    pub fn is_client_fault(&self) -> bool {
        matches!(
            self,
            Self::BaudMismatch { .. } | Self::Overrun { .. } | Self::ReplyDropped { .. }
        )
    }
}

impl fmt::Display for LineEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Attached => f.write_str("client attached"),
            Self::Detached => f.write_str("client detached"),
            Self::BaudMismatch { client, device } => write!(
                f,
                "baud mismatch: the client has set {client} baud, the device runs at {device}; \
                 bytes are garbled both ways, open the port at {device} baud"
            ),
            Self::BaudMatched { baud } => write!(f, "baud mismatch ended: both run at {baud}"),
            Self::Overrun { bytes } => {
                write!(f, "{bytes} bytes lost: the client does not read its port")
            }
            Self::ReplyDropped { bytes } => write!(
                f,
                "a reply of {bytes} bytes dropped: requests come faster than the line carries replies"
            ),
        }
    }
}

/// Bytes under way in one direction, oldest first.
#[derive(Debug, Clone, Default)]
struct Direction {
    under_way: VecDeque<(SimTime, u8)>,
    /// When the sender's shift register is empty.
    free_at: SimTime,
}

impl Direction {
    fn send(&mut self, now: SimTime, bytes: &[u8], from_baud: u32, to_baud: u32, wire: Wire) {
        let start = self.free_at.max(now);
        let byte_time = match wire {
            Wire::Paced => uart::byte_time(from_baud),
            Wire::Instant => Duration::ZERO,
        };
        if matches(from_baud, to_baud) {
            let mut arrival = start;
            for &byte in bytes {
                arrival += byte_time;
                self.under_way.push_back((arrival, byte));
            }
            self.free_at = arrival;
        } else {
            let mut arrival = start;
            for received in uart::resample(bytes, from_baud, to_baud) {
                if wire == Wire::Paced {
                    arrival = start + received.after;
                }
                self.under_way.push_back((arrival, received.byte));
            }
            let count = u32::try_from(bytes.len()).unwrap_or(u32::MAX);
            // A slow receiver may still be at its last byte when the sender has finished.
            self.free_at = arrival.max(start + byte_time * count);
        }
    }

    fn take(&mut self, now: SimTime) -> Option<u8> {
        self.under_way
            .pop_front_if(|(arrival, _)| *arrival <= now)
            .map(|(_, byte)| byte)
    }

    fn next(&self) -> Option<SimTime> {
        self.under_way.front().map(|(arrival, _)| *arrival)
    }
}

fn matches(a: u32, b: u32) -> bool {
    (f64::from(a) - f64::from(b)).abs() <= TOLERANCE * f64::from(b)
}

/// A serial line with a client at one end and a device at the other.
///
/// Whoever drives it passes the time in, and it never goes back. Bytes are taken off it one by one
/// at their arrival times, so that a device sees each at the nanosecond at which its stop bit ends.
#[derive(Debug, Clone)]
pub struct SerialLine {
    device_baud: u32,
    client_baud: u32,
    wire: Wire,
    to_device: Direction,
    to_client: Direction,
    attached: bool,
    told_mismatch: bool,
    /// Replies to a former client's bytes, which go nowhere: those sent until then.
    mute_until: Option<SimTime>,
}

impl SerialLine {
    /// A line with no client.
    #[must_use]
    pub fn new(baud: u32, wire: Wire) -> Self {
        Self {
            device_baud: baud,
            client_baud: baud,
            wire,
            to_device: Direction::default(),
            to_client: Direction::default(),
            attached: false,
            told_mismatch: false,
            mute_until: None,
        }
    }

    /// A client opened the port.
    pub fn attach(&mut self) {
        self.attached = true;
        self.to_client.under_way.clear();
        self.mute_until = self.to_device.under_way.back().map(|(arrival, _)| *arrival);
    }

    /// The client is gone; what was on its way to it is lost.
    pub fn detach(&mut self) {
        self.attached = false;
        self.to_client.under_way.clear();
    }

    /// Whether a client has the port open.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached
    }

    /// How many bytes the client may send now.
    #[must_use]
    pub fn room(&self) -> usize {
        MOST_IN_FLIGHT.saturating_sub(self.to_device.under_way.len())
    }

    /// The client has set another speed.
    pub fn set_client_baud(&mut self, baud: u32) -> Option<LineEvent> {
        if baud == self.client_baud {
            return None;
        }
        self.client_baud = baud;
        // Every new speed is a new story, so a further mismatch is told again.
        let told = std::mem::take(&mut self.told_mismatch);
        (told && matches(baud, self.device_baud)).then_some(LineEvent::BaudMatched { baud })
    }

    /// The client sends.
    pub fn client_sends(&mut self, now: SimTime, bytes: &[u8]) -> Option<LineEvent> {
        self.to_device
            .send(now, bytes, self.client_baud, self.device_baud, self.wire);
        let mismatch = !matches(self.client_baud, self.device_baud);
        (mismatch && !std::mem::replace(&mut self.told_mismatch, true)).then_some(
            LineEvent::BaudMismatch {
                client: self.client_baud,
                device: self.device_baud,
            },
        )
    }

    /// The device sends; without a client the bytes go nowhere.
    pub fn device_sends(&mut self, now: SimTime, bytes: &[u8]) -> Option<LineEvent> {
        if !self.attached || self.mute_until.is_some_and(|until| now <= until) {
            return None;
        }
        self.mute_until = None;
        if self.to_client.under_way.len() + bytes.len() > MOST_IN_FLIGHT {
            return Some(LineEvent::ReplyDropped { bytes: bytes.len() });
        }
        self.to_client
            .send(now, bytes, self.device_baud, self.client_baud, self.wire);
        None
    }

    /// The next byte that has arrived at the device by `now`.
    pub fn take_for_device(&mut self, now: SimTime) -> Option<u8> {
        self.to_device.take(now)
    }

    /// Adds to `bytes` what has arrived at the client by `now`.
    pub fn take_for_client(&mut self, now: SimTime, bytes: &mut Vec<u8>) {
        while let Some(byte) = self.to_client.take(now) {
            bytes.push(byte);
        }
    }

    /// When the next byte arrives at the device.
    #[must_use]
    pub fn next_for_device(&self) -> Option<SimTime> {
        self.to_device.next()
    }

    /// When the next byte arrives at the client.
    #[must_use]
    pub fn next_for_client(&self) -> Option<SimTime> {
        self.to_client.next()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn arrivals(line: &mut SerialLine) -> Vec<(u64, u8)> {
        let mut found = Vec::new();
        while let Some(at) = line.next_for_device() {
            assert_eq!(line.take_for_device(at - Duration::from_nanos(1)), None);
            found.push((at.as_nanos(), line.take_for_device(at).unwrap()));
        }
        found
    }

    #[test]
    fn bytes_take_ten_bits_each_and_queue_behind_one_another() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.client_sends(SimTime::ZERO, &[1, 2]);
        line.client_sends(SimTime::from_micros(10), &[3]);
        assert_eq!(
            arrivals(&mut line),
            [(86_806, 1), (173_612, 2), (260_418, 3)]
        );
    }

    #[test]
    fn an_instant_wire_takes_no_time() {
        let mut line = SerialLine::new(115_200, Wire::Instant);
        line.client_sends(SimTime::from_millis(1), &[1, 2]);
        assert_eq!(arrivals(&mut line), [(1_000_000, 1), (1_000_000, 2)]);
    }

    #[test]
    fn a_baud_mismatch_is_told_once_for_each_speed_and_its_end_too() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.attach();
        let told = LineEvent::BaudMismatch {
            client: 9600,
            device: 115_200,
        };
        assert_eq!(line.set_client_baud(9600), None);
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), Some(told));
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), None);
        assert_eq!(line.set_client_baud(9600), None);
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), None);
        let matched = LineEvent::BaudMatched { baud: 115_200 };
        assert_eq!(line.set_client_baud(115_200), Some(matched));
        assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), None);
        assert_eq!(line.set_client_baud(19_200), None);
        assert!(line.client_sends(SimTime::ZERO, &[0xAA]).is_some());
        assert_eq!(line.set_client_baud(38_400), None);
        assert!(line.client_sends(SimTime::ZERO, &[0xAA]).is_some());
    }

    #[test]
    fn a_mismatch_garbles_both_ways() {
        let mut line = SerialLine::new(115_200, Wire::Instant);
        line.attach();
        line.set_client_baud(57_600);
        line.client_sends(SimTime::ZERO, &[0xAA, 0x55]);
        let mut at_device = Vec::new();
        while let Some(byte) = line.take_for_device(SimTime::ZERO) {
            at_device.push(byte);
        }
        assert!(!at_device.is_empty());
        assert_ne!(at_device, [0xAA, 0x55]);
        line.device_sends(SimTime::ZERO, &[0xAA, 0x55, 0x01]);
        let mut at_client = Vec::new();
        line.take_for_client(SimTime::ZERO, &mut at_client);
        assert_ne!(at_client, [0xAA, 0x55, 0x01]);
    }

    #[test]
    fn a_new_client_gets_nothing_of_the_old_ones() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.attach();
        line.device_sends(SimTime::ZERO, &[1, 2, 3]);
        line.client_sends(SimTime::ZERO, &[9, 9]);
        line.detach();
        line.attach();
        assert_eq!(line.next_for_client(), None);
        // A reply to the old client's bytes, which were still on their way.
        let last = SimTime::from_nanos(2 * 86_806);
        line.device_sends(last, &[4]);
        assert_eq!(line.next_for_client(), None);
        line.device_sends(last + Duration::from_nanos(1), &[5]);
        assert!(line.next_for_client().is_some());
    }

    #[test]
    fn a_full_line_drops_whole_replies() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.attach();
        let reply = [0; 82];
        let fits = MOST_IN_FLIGHT / reply.len();
        for _ in 0..fits {
            assert_eq!(line.device_sends(SimTime::ZERO, &reply), None);
        }
        let dropped = LineEvent::ReplyDropped { bytes: 82 };
        assert_eq!(line.device_sends(SimTime::ZERO, &reply), Some(dropped));
    }
}
