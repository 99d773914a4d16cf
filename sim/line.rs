//! A serial line between a client and a device: its speed, and what goes wrong on it.

mod direction;
pub mod event;

use rigsim_settings::{SimTime, words};

pub use crate::uart::{Adapter, UART_FIFO};
pub use rigsim_settings::ClientLine;

use crate::event::{Code, EventKind, code};
use crate::uart::Inbox;
use direction::{Direction, Ends, matches};

words! {
    /// Pace of bytes on the line.
    pub enum Wire {
        /// Each byte takes its ten bits, or eleven with two stop bits, at the sender's baud rate,
        /// as on a cable.
        Paced = "paced",
        /// As on a cable without adapters at the clients' ends: each byte passes by itself.
        Bare = "bare",
        /// Bytes arrive the moment they are sent, without an adapter.
        Instant = "instant",
    }
}

/// Most bytes under way in one direction. A client that sends more without asking for the room
/// loses the rest. A further reply of the device takes the place of the oldest ones, which are
/// dropped whole: those may be for a client that has left, and the last is for one that is there.
pub const MOST_IN_FLIGHT: usize = 4096;

/// A serial line with a client at one end and a device at the other.
///
/// Its driver passes the time in, and it never goes back. Bytes are taken off it one by one
/// at their arrival times, so that a device sees each at the nanosecond at which its stop bit ends.
///
/// An adapter of the client's computer lies between the client and the line: what the client sends begins
/// its way when that passes it on, and what has arrived at that end can be read when it passes it on.
///
/// It is a cable: bytes that a client has handed over reach the device whichever client is there by then,
/// and what the device says reaches the client that has the port open when it arrives.
#[derive(Debug, Clone)]
pub struct SerialLine {
    device_baud: u32,
    /// Speed at which the device's end runs by a fault.
    faulty_baud: Option<u32>,
    client: ClientLine,
    wire: Wire,
    adapter: Adapter,
    /// The one that is there by a fault.
    faulty_adapter: Option<Adapter>,
    to_device: Direction,
    to_client: Direction,
    inbox: Inbox,
    attached: bool,
    /// Settings of this client that were reported.
    reported: Vec<Code>,
    /// A frame of the device has come to this client at another speed.
    heard_garbled: bool,
}

impl SerialLine {
    /// A line with no client, whose device has one stop bit.
    #[must_use]
    pub fn new(baud: u32, wire: Wire, adapter: Adapter) -> Self {
        Self {
            device_baud: baud,
            faulty_baud: None,
            client: ClientLine::at(baud),
            wire,
            adapter,
            faulty_adapter: None,
            to_device: Direction::default(),
            to_client: Direction::default(),
            inbox: Inbox::default(),
            attached: false,
            reported: Vec::new(),
            heard_garbled: false,
        }
    }

    /// A client opened the port. What arrives from now on is its.
    pub fn attach(&mut self, now: SimTime) {
        self.catch_up(now);
        self.attached = true;
        self.heard_garbled = false;
        self.reported
            .retain(|reported| *reported == code::BAUD_MISMATCH);
    }

    /// The client is gone. What its UART holds still goes out, the rest of what it has sent does
    /// not.
    pub fn detach(&mut self, now: SimTime) {
        self.catch_up(now);
        self.attached = false;
        self.lose_arrived();
        self.to_device.discard_beyond(UART_FIFO, now);
    }

    /// Returns whether a client has the port open.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached
    }

    /// Number of bytes that the client's adapter takes now.
    #[must_use]
    pub fn room(&self) -> usize {
        let most = match self.wire {
            Wire::Paced | Wire::Bare => 1 + self.adapter().buffer(),
            Wire::Instant => MOST_IN_FLIGHT,
        };
        most.saturating_sub(self.to_device.kept())
    }

    /// Number of bytes that the line keeps for a client whose driver has no buffer.
    #[must_use]
    pub fn space(&self) -> usize {
        MOST_IN_FLIGHT.saturating_sub(self.to_device.kept())
    }

    /// The client has set its end of the line. What is wrong with that is reported when bytes pass,
    /// since many a client opens its port first and sets it then; that it hangs up is reported at once.
    pub fn set_client_line(&mut self, now: SimTime, line: ClientLine) -> Option<EventKind> {
        if line == self.client {
            return None;
        }
        let baud = line.baud;
        let old = self.change(now, |this| std::mem::replace(&mut this.client, line));
        if baud == old.baud {
            return None;
        }
        // Every new speed is a new story, so a further mismatch is reported again.
        self.heard_garbled = false;
        let reported = self.reported.len();
        self.reported
            .retain(|reported| *reported != code::BAUD_MISMATCH);
        if baud == 0 {
            self.to_device.discard_beyond(0, now);
            return Some(event::hung_up());
        }
        let reported = self.reported.len() < reported;
        (reported && matches(baud, self.device_baud)).then(|| event::baud_matched(baud))
    }

    /// The client sends; returns what is to be reported of it.
    pub fn client_sends(&mut self, now: SimTime, bytes: &[u8]) -> Vec<EventKind> {
        if self.client.baud == 0 {
            return Vec::new();
        }
        let room = MOST_IN_FLIGHT.saturating_sub(self.to_device.waiting());
        let (sent, lost) = bytes.split_at(bytes.len().min(room));
        let from = self.adapter().passes(now);
        self.to_device.send(now, from, sent, self.to_device_ends());
        let (client, device) = (self.client, self.device_baud);
        let wrong = [
            (!matches(client.baud, device)).then(|| event::baud_mismatch(client.baud, device)),
            (!client.raw).then(event::not_raw),
            (client.stop_bits != 1).then(|| event::stop_bits(client.stop_bits)),
            client.parity.then(event::parity),
            client.rts_cts.then(event::flow_control),
        ];
        let mut events = Vec::new();
        for event in wrong.into_iter().flatten() {
            if !self.reported.contains(&event.code()) {
                self.reported.push(event.code());
                events.push(event);
            }
        }
        if !lost.is_empty() {
            events.push(event::sent_too_much(lost.len()));
        }
        events
    }

    /// The device sends a frame.
    pub fn device_sends(&mut self, now: SimTime, frame: &[u8]) -> Option<EventKind> {
        self.catch_up(now);
        let mut bytes = self.to_client.make_room(frame.len());
        if self.to_client.kept() + frame.len() > MOST_IN_FLIGHT {
            bytes += frame.len();
        } else {
            self.to_client.send(now, now, frame, self.to_client_ends());
        }
        let dropped = (bytes > 0 && self.attached).then(|| event::reply_dropped(bytes));
        dropped.or_else(|| self.mismatch_of_listener())
    }

    /// A client that only listens is at a wrong speed. The first frame says nothing of that: the client may
    /// just have opened its port, and set it afterwards.
    fn mismatch_of_listener(&mut self) -> Option<EventKind> {
        let (client, device) = (self.client.baud, self.device_baud);
        let is_wrong = self.attached && client != 0 && !matches(client, device);
        if !is_wrong || self.reported.contains(&code::BAUD_MISMATCH) {
            return None;
        }
        if !std::mem::replace(&mut self.heard_garbled, true) {
            return None;
        }
        self.reported.push(code::BAUD_MISMATCH);
        Some(event::baud_mismatch(client, device))
    }

    /// The device's end runs at a wrong speed by a fault, which is none of the client's making; or
    /// no longer does.
    pub fn set_faulty_baud(&mut self, now: SimTime, baud: Option<u32>) {
        self.change(now, |this| this.faulty_baud = baud);
    }

    /// Another adapter is there by a fault; or no longer is.
    pub fn set_faulty_adapter(&mut self, adapter: Option<Adapter>) {
        self.faulty_adapter = adapter;
    }

    fn adapter(&self) -> Adapter {
        match self.wire {
            Wire::Paced => self.faulty_adapter.unwrap_or(self.adapter),
            Wire::Bare | Wire::Instant => Adapter::Bytes,
        }
    }

    /// Changes an end of the line, and what is under way with it.
    fn change<T>(&mut self, now: SimTime, change: impl FnOnce(&mut Self) -> T) -> T {
        self.catch_up(now);
        let old = [self.to_device_ends(), self.to_client_ends()];
        let changed = change(self);
        let new = [self.to_device_ends(), self.to_client_ends()];
        self.to_device.change(now, old[0], new[0]);
        self.to_client.change(now, old[1], new[1]);
        changed
    }

    /// Returns whether bytes arrive wrong because the speeds of both ends differ.
    #[must_use]
    pub fn is_garbled(&self) -> bool {
        !matches(self.client.baud, self.device_end())
    }

    fn device_end(&self) -> u32 {
        self.faulty_baud.unwrap_or(self.device_baud)
    }

    fn to_device_ends(&self) -> Ends {
        Ends {
            from_baud: self.client.baud,
            stop_bits: self.client.stop_bits,
            to_baud: self.device_end(),
            wire: self.wire,
        }
    }

    fn to_client_ends(&self) -> Ends {
        Ends {
            from_baud: self.device_end(),
            stop_bits: 1,
            to_baud: self.client.baud,
            wire: self.wire,
        }
    }

    /// Brings both directions to where they are at `now`, before anything changes at an end.
    fn catch_up(&mut self, now: SimTime) {
        self.to_device.catch_up(now, self.to_device_ends());
        self.to_client.catch_up(now, self.to_client_ends());
        if !self.attached {
            self.lose_arrived();
        }
    }

    fn lose_arrived(&mut self) {
        self.to_client.lose_arrived();
        self.inbox.clear();
    }

    /// The next byte that has arrived at the device by `now`.
    pub fn take_for_device(&mut self, now: SimTime) -> Option<u8> {
        self.to_device.catch_up(now, self.to_device_ends());
        self.to_device.take(now).map(|(_, byte)| byte)
    }

    /// The next byte that has arrived at the client's adapter by `now`, and when.
    pub(crate) fn take_off_wire(&mut self, now: SimTime) -> Option<(SimTime, u8)> {
        self.catch_up(now);
        self.to_client.take(now)
    }

    /// A byte has come to the client's adapter.
    pub(crate) fn adapter_hears(&mut self, at: SimTime, byte: u8) {
        let byte_time = self.to_client_ends().byte_time();
        self.inbox.hear(self.adapter(), at, byte, byte_time);
    }

    /// Adds to `bytes` what the client can read at `now`.
    pub fn take_for_client(&mut self, now: SimTime, bytes: &mut Vec<u8>) {
        self.pass_to_adapter(now);
        self.inbox.take(now, bytes);
    }

    /// Passes what has arrived by `now` on to the client's adapter.
    pub(crate) fn pass_to_adapter(&mut self, now: SimTime) {
        while let Some((at, byte)) = self.take_off_wire(now) {
            self.adapter_hears(at, byte);
        }
    }

    /// Time at which the next byte arrives at the device; at another speed it may turn out to be
    /// none.
    #[must_use]
    pub fn next_for_device(&self) -> Option<SimTime> {
        self.to_device.next()
    }

    /// Time at which the next byte arrives at the adapter of a client that is there.
    #[must_use]
    pub fn next_off_wire(&self) -> Option<SimTime> {
        self.to_client.next().filter(|_| self.attached)
    }

    /// Time at which a client that is there may be able to read more.
    #[must_use]
    pub fn next_for_client(&self) -> Option<SimTime> {
        let wire = self.next_off_wire().map(|at| self.adapter().passes(at));
        self.inbox.due().into_iter().chain(wire).min()
    }
}

#[cfg(test)]
mod tests;
