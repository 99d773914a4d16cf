//! A serial line between a client and a device: its speed, and what goes wrong on it.

mod direction;
mod event;

use std::time::Duration;

use sim_settings::{SimTime, choices};

use crate::uart;

pub use event::{LineEvent, OnLine};

use direction::{Direction, matches};

choices! {
    /// Whether bytes take time on the line.
    pub enum Wire {
        /// Each byte takes its ten bits, or eleven with two stop bits, at the sender's baud rate, as
        /// on a cable.
        Paced = "paced",
        /// Bytes arrive the moment they are sent.
        Instant = "instant",
    }
}

impl Wire {
    /// Time that a byte takes.
    fn byte_time(self, baud: u32, stop_bits: u8) -> Duration {
        match self {
            Self::Paced => uart::byte_time(baud, stop_bits),
            Self::Instant => Duration::ZERO,
        }
    }
}

/// Most bytes under way in one direction. Whoever asks for the room first keeps the client's
/// further bytes waiting in its port's buffer; without asking they are lost. The device's further
/// replies are dropped whole.
pub const MOST_IN_FLIGHT: usize = 4096;

/// How a client has set its end of the line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ClientLine {
    /// Bits per second.
    pub baud: u32,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
    /// Whether its port passes bytes on untouched, without echo, editing or translation.
    pub raw: bool,
}

impl ClientLine {
    /// As it should be for a device that runs at `baud` with one stop bit.
    #[must_use]
    pub fn at(baud: u32) -> Self {
        Self {
            baud,
            stop_bits: 1,
            raw: true,
        }
    }
}

/// A serial line with a client at one end and a device at the other.
///
/// Whoever drives it passes the time in, and it never goes back. Bytes are taken off it one by one
/// at their arrival times, so that a device sees each at the nanosecond at which its stop bit ends.
#[derive(Debug, Clone)]
pub struct SerialLine {
    device_baud: u32,
    device_stop_bits: u8,
    /// Speed at which the device's end runs by a fault.
    faulty_baud: Option<u32>,
    client: ClientLine,
    wire: Wire,
    to_device: Direction,
    to_client: Direction,
    attached: bool,
    told_mismatch: bool,
    told_not_raw: bool,
    told_stop_bits: bool,
    /// Replies to a former client's bytes, which go nowhere: those sent until then.
    mute_until: Option<SimTime>,
    /// When the last byte of a client that has left arrives, until that is taken note of.
    last_of_former: Option<SimTime>,
}

impl SerialLine {
    /// A line with no client, whose device has one stop bit.
    #[must_use]
    pub fn new(baud: u32, wire: Wire) -> Self {
        Self::with_stop_bits(baud, 1, wire)
    }

    /// The same with 1 or 2 stop bits.
    #[must_use]
    pub fn with_stop_bits(baud: u32, stop_bits: u8, wire: Wire) -> Self {
        Self {
            device_baud: baud,
            device_stop_bits: stop_bits,
            faulty_baud: None,
            client: ClientLine {
                stop_bits,
                ..ClientLine::at(baud)
            },
            wire,
            to_device: Direction::default(),
            to_client: Direction::default(),
            attached: false,
            told_mismatch: false,
            told_not_raw: false,
            told_stop_bits: false,
            mute_until: None,
            last_of_former: None,
        }
    }

    /// A client opened the port.
    pub fn attach(&mut self) {
        self.attached = true;
        self.told_not_raw = false;
        self.told_stop_bits = false;
        self.to_client = Direction::default();
        self.mute_until = self.last_under_way();
    }

    /// The client is gone; what was on its way to it is lost, and the line to the next one is free.
    /// What it has sent still arrives.
    pub fn detach(&mut self) {
        self.attached = false;
        self.to_client = Direction::default();
        self.last_of_former = Some(self.last_under_way().unwrap_or(SimTime::ZERO));
    }

    /// Whether the last byte of a client that has left has arrived by `now`; true once for each
    /// that has left. Replies to it that the device still holds back then are nobody's.
    pub fn take_former_done(&mut self, now: SimTime) -> bool {
        let done = self.last_of_former.is_some_and(|last| last <= now);
        if done {
            self.last_of_former = None;
        }
        done
    }

    fn last_under_way(&self) -> Option<SimTime> {
        self.to_device.under_way.back().map(|(arrival, _)| *arrival)
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

    /// The client has set its end of the line. What is wrong with that is told when bytes pass,
    /// since many a client opens its port first and sets it then.
    pub fn set_client_line(&mut self, line: ClientLine) -> Option<LineEvent> {
        let baud = line.baud;
        let old = std::mem::replace(&mut self.client, line);
        if baud == old.baud {
            return None;
        }
        // Every new speed is a new story, so a further mismatch is told again.
        let told = std::mem::take(&mut self.told_mismatch);
        (told && matches(baud, self.device_baud)).then_some(LineEvent::BaudMatched { baud })
    }

    /// The client sends; gives what is to be told of it.
    pub fn client_sends(&mut self, now: SimTime, bytes: &[u8]) -> Vec<LineEvent> {
        let (sent, lost) = bytes.split_at(bytes.len().min(self.room()));
        let client = (self.client.baud, self.client.stop_bits);
        self.to_device
            .send(now, sent, client, self.device_end(), self.wire);
        let mut events = Vec::new();
        let mut once = |wrong: bool, told: &mut bool, event| {
            if wrong && !std::mem::replace(told, true) {
                events.push(event);
            }
        };
        once(
            !matches(self.client.baud, self.device_baud),
            &mut self.told_mismatch,
            LineEvent::BaudMismatch {
                client: self.client.baud,
                device: self.device_baud,
            },
        );
        once(!self.client.raw, &mut self.told_not_raw, LineEvent::NotRaw);
        once(
            self.client.stop_bits != self.device_stop_bits,
            &mut self.told_stop_bits,
            LineEvent::StopBits {
                client: self.client.stop_bits,
                device: self.device_stop_bits,
            },
        );
        if !lost.is_empty() {
            events.push(LineEvent::SentTooMuch { bytes: lost.len() });
        }
        events
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
        let device = (self.device_end(), self.device_stop_bits);
        self.to_client
            .send(now, bytes, device, self.client.baud, self.wire);
        None
    }

    /// The device's end runs at a wrong speed by a fault, which is none of the client's making; or
    /// no longer does.
    pub fn set_faulty_baud(&mut self, baud: Option<u32>) {
        self.faulty_baud = baud;
    }

    /// Whether bytes arrive wrong because the speeds of both ends differ.
    #[must_use]
    pub fn is_garbled(&self) -> bool {
        !matches(self.client.baud, self.device_end())
    }

    fn device_end(&self) -> u32 {
        self.faulty_baud.unwrap_or(self.device_baud)
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
        let matched = LineEvent::BaudMatched { baud: 115_200 };
        let mut set = |baud| {
            let set = line.set_client_line(ClientLine::at(baud));
            (set, line.client_sends(SimTime::ZERO, &[0xAA]))
        };
        assert_eq!(set(9600), (None, vec![told]));
        assert_eq!(set(9600), (None, vec![]));
        assert_eq!(set(115_200), (Some(matched), vec![]));
        assert_eq!(set(19_200).1.len(), 1);
        assert_eq!(set(38_400).1.len(), 1);
    }

    #[test]
    fn a_port_that_echoes_or_sends_two_stop_bits_is_told_once_for_each_client() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        for _ in 0..2 {
            line.attach();
            let good = ClientLine::at(115_200);
            line.set_client_line(ClientLine { raw: false, ..good });
            let told = line.client_sends(SimTime::ZERO, &[0xAA]);
            assert_eq!(told, [LineEvent::NotRaw]);
            assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), []);
            line.set_client_line(ClientLine {
                stop_bits: 2,
                ..good
            });
            let told = line.client_sends(SimTime::ZERO, &[0xAA]);
            let two = LineEvent::StopBits {
                client: 2,
                device: 1,
            };
            assert_eq!(told, [two]);
            assert_eq!(line.client_sends(SimTime::ZERO, &[0xAA]), []);
            line.detach();
        }
    }

    #[test]
    fn with_two_stop_bits_a_byte_takes_eleven() {
        let mut line = SerialLine::with_stop_bits(10_000, 2, Wire::Paced);
        line.attach();
        assert_eq!(line.client_sends(SimTime::ZERO, &[1, 2]), []);
        assert_eq!(line.device_sends(SimTime::ZERO, &[3]), None);
        let arrives = SimTime::ZERO + Duration::from_micros(1100);
        let before = SimTime::from_nanos(arrives.as_nanos() - 1);
        assert_eq!(line.take_for_device(before), None);
        assert_eq!(line.take_for_device(arrives), Some(1));
        assert_eq!(line.next_for_client(), Some(arrives));
        // A client with one stop bit is told of it, and its bytes take ten.
        line.set_client_line(ClientLine::at(10_000));
        let told = line.client_sends(arrives + Duration::from_micros(1100), &[4]);
        assert_eq!(
            told,
            [LineEvent::StopBits {
                client: 1,
                device: 2
            }]
        );
        let after = arrives + Duration::from_micros(1100);
        assert_eq!(line.take_for_device(after), Some(2));
        assert_eq!(
            line.take_for_device(after + Duration::from_micros(1000)),
            Some(4)
        );
    }

    #[test]
    fn what_does_not_fit_is_lost_and_told() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        let told = line.client_sends(SimTime::ZERO, &[0; MOST_IN_FLIGHT + 3]);
        assert_eq!(told, [LineEvent::SentTooMuch { bytes: 3 }]);
        assert_eq!(line.room(), 0);
        assert_eq!(arrivals(&mut line).len(), MOST_IN_FLIGHT);
    }

    #[test]
    fn the_next_client_s_first_reply_does_not_wait_behind_the_last_one_s() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.attach();
        line.device_sends(SimTime::ZERO, &[0; 1000]);
        line.detach();
        line.attach();
        line.device_sends(SimTime::ZERO, &[1]);
        assert_eq!(line.next_for_client(), Some(SimTime::from_nanos(86_806)));
    }

    #[test]
    fn a_former_client_is_done_once_when_its_last_byte_has_arrived() {
        let mut line = SerialLine::new(115_200, Wire::Paced);
        line.attach();
        line.client_sends(SimTime::ZERO, &[9, 9]);
        assert!(!line.take_former_done(SimTime::MAX));
        line.detach();
        line.attach();
        line.client_sends(SimTime::ZERO, &[1]);
        assert!(!line.take_former_done(SimTime::from_nanos(2 * 86_806 - 1)));
        assert!(line.take_former_done(SimTime::from_nanos(2 * 86_806)));
        assert!(!line.take_former_done(SimTime::MAX));
    }

    #[test]
    fn a_mismatch_garbles_both_ways() {
        let mut line = SerialLine::new(115_200, Wire::Instant);
        line.attach();
        line.set_client_line(ClientLine::at(57_600));
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
    fn the_pieces_in_which_a_burst_is_handed_over_change_nothing() {
        let bytes: Vec<u8> = (0..=255).map(|byte: u8| byte.wrapping_mul(37)).collect();
        for baud in [4_800, 57_600, 110_000, 230_400, 921_600] {
            let whole = {
                let mut line = SerialLine::new(115_200, Wire::Paced);
                line.set_client_line(ClientLine::at(baud));
                line.client_sends(SimTime::ZERO, &bytes);
                arrivals(&mut line)
            };
            for piece in [1, 3, 17, 100] {
                let mut line = SerialLine::new(115_200, Wire::Paced);
                line.set_client_line(ClientLine::at(baud));
                let mut now = SimTime::ZERO;
                let mut found = Vec::new();
                for piece in bytes.chunks(piece) {
                    while let Some(at) = line.next_for_device().filter(|at| *at <= now) {
                        found.push((at.as_nanos(), line.take_for_device(at).unwrap()));
                    }
                    line.client_sends(now, piece);
                    // Just before the line would be idle.
                    let count = u32::try_from(piece.len()).unwrap();
                    now += uart::byte_time(baud, 1) * count - Duration::from_nanos(1);
                }
                found.extend(arrivals(&mut line));
                assert_eq!(found, whole, "{baud} baud in pieces of {piece}");
            }
        }
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
