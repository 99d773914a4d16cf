//! The clients' side of a rig.

use std::time::Duration;

use rigsim_settings::SimTime;

use super::{Rig, RigError};
use crate::device::Way;
use crate::event::EventKind;
use crate::line::{ClientLine, SerialLine, event};

/// One serial port: a link of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PortId {
    /// Index of the device.
    pub device: usize,
    /// Index of the link on the device.
    pub link: usize,
}

/// Actions of clients to a port. A port that does not exist is a client that no device hears.
impl Rig {
    /// A client opened the port at `now`, to which the rig advances first.
    ///
    /// # Errors
    /// As [`Rig::advance`].
    pub fn attach(&mut self, port: PortId, now: SimTime) -> Result<(), RigError> {
        self.advance(now)?;
        if self.line(port).is_some_and(|line| !line.is_attached()) {
            // What has arrived meanwhile is gone.
            self.client_reads(port, &mut Vec::new());
        }
        if let Some(line) = self.line_mut(port) {
            line.attach(now);
            self.emit_line_event(port, event::attached());
        }
        Ok(())
    }

    /// The client closed the port at `now`, to which the rig advances first. What its UART holds
    /// still goes out.
    ///
    /// # Errors
    /// As [`Rig::advance`].
    pub fn detach(&mut self, port: PortId, now: SimTime) -> Result<(), RigError> {
        self.advance(now)?;
        if let Some(line) = self.line_mut(port) {
            line.detach(now);
            self.emit_line_event(port, event::detached());
            self.after_change(port.device);
        }
        Ok(())
    }

    /// The client has set its end of the line.
    pub fn set_client_line(&mut self, port: PortId, line: ClientLine) {
        let now = self.now;
        let event = self
            .line_mut(port)
            .and_then(|serial_line| serial_line.set_client_line(now, line));
        if let Some(event) = event {
            self.emit_line_event(port, event);
        }
        self.reschedule(port.device);
    }

    /// The simulator was late: what waits for the lines now may have been sent up to `by` of
    /// simulated time before, and simulated time stood still for `stood`.
    pub fn late(&mut self, by: Duration, stood: Duration) {
        for slot in &mut self.slots {
            slot.device.late(self.now, by, stood);
        }
    }

    /// Something happened on a port, perhaps what only its server knows.
    pub fn emit_line_event(&mut self, port: PortId, event: EventKind) {
        if self.line(port).is_some() {
            let PortId { device, link } = port;
            self.events.push(event.on(link).at(self.now, device));
        }
    }

    /// The same at every device.
    pub fn emit_at_all(&mut self, event: &EventKind) {
        for device in 0..self.slots.len() {
            self.emit_line_event(PortId { device, link: 0 }, event.clone());
        }
    }

    /// Returns whether the device may have something to say, or to hear, by `now`.
    #[must_use]
    pub fn is_due(&self, port: PortId, now: SimTime) -> bool {
        let arrival = self.next_for_client(port).unwrap_or(SimTime::MAX);
        self.deadlines.of(port.device).min(arrival) <= now
    }

    /// Time at which something next arrives at the client that has the port open.
    #[must_use]
    pub fn next_for_client(&self, port: PortId) -> Option<SimTime> {
        self.line(port).and_then(SerialLine::next_for_client)
    }

    /// Number of bytes that the line keeps for a client whose driver has no buffer.
    #[must_use]
    pub fn space(&self, port: PortId) -> usize {
        self.line(port).map_or(0, SerialLine::space)
    }

    /// Number of bytes that the client's adapter takes now.
    #[must_use]
    pub fn room(&self, port: PortId) -> usize {
        self.line(port).map_or(0, SerialLine::room)
    }

    /// The client sends `bytes` at the present time. Whatever else happens now is left to the next
    /// advance, so that bytes come before the deadlines of their instant; [`Rig::approach`] goes to
    /// just before one.
    pub fn client_puts(&mut self, port: PortId, bytes: &[u8]) {
        let now = self.now;
        let Some(line) = self.line_mut(port) else {
            return;
        };
        let events = line.client_sends(now, bytes);
        let garbled = line.is_garbled();
        if let Some(faults) = &mut self.slots[port.device].faults {
            faults.count_sent(port.link, Way::ToDevice, bytes.len(), garbled);
        }
        self.reschedule(port.device);
        for event in events {
            self.emit_line_event(port, event);
        }
    }

    /// Adds to `bytes` what has arrived at the client by the present time.
    pub fn client_reads(&mut self, port: PortId, bytes: &mut Vec<u8>) {
        let now = self.now;
        let Some(slot) = self.slots.get_mut(port.device) else {
            return;
        };
        let Some(line) = slot.lines.get_mut(port.link) else {
            return;
        };
        if let Some(faults) = &mut slot.faults {
            faults.pass_to_adapter(now, port.link, line);
        }
        line.take_for_client(now, bytes);
    }

    fn reschedule(&mut self, device: usize) {
        if let Some(slot) = self.slots.get(device) {
            let arrivals = slot.lines.iter().filter_map(SerialLine::next_for_device);
            let faults = slot.faults.as_ref();
            let next = arrivals.chain(faults.and_then(|faults| faults.next()));
            let of_device = self.deadlines.of(device);
            self.deadlines
                .set(device, next.fold(of_device, SimTime::min));
        }
    }

    fn line(&self, port: PortId) -> Option<&SerialLine> {
        self.slots.get(port.device)?.lines.get(port.link)
    }

    fn line_mut(&mut self, port: PortId) -> Option<&mut SerialLine> {
        self.slots.get_mut(port.device)?.lines.get_mut(port.link)
    }
}
