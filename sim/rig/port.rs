//! The clients' side of a rig.

use sim_settings::SimTime;

use super::{Rig, RigError};
use crate::line::{LineEvent, SerialLine};

/// One serial port: a link of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct PortId {
    /// Index of the device.
    pub device: usize,
    /// Index of the link on the device.
    pub link: usize,
}

/// What clients do to a port. A port that does not exist is a client that nobody hears.
impl Rig {
    /// A client opened the port.
    pub fn attach(&mut self, port: PortId) {
        if let Some(line) = self.line_mut(port) {
            line.attach();
            self.line_event(port, Some(LineEvent::Attached));
        }
    }

    /// The client closed the port; what was on its way to it is lost, what it has sent still
    /// arrives.
    pub fn detach(&mut self, port: PortId) {
        if let Some(line) = self.line_mut(port) {
            line.detach();
            self.line_event(port, Some(LineEvent::Detached));
        }
    }

    /// The client has set another speed.
    pub fn set_client_baud(&mut self, port: PortId, baud: u32) {
        let event = self
            .line_mut(port)
            .and_then(|line| line.set_client_baud(baud));
        self.line_event(port, event);
    }

    /// How many bytes the client may send now without filling the line.
    #[must_use]
    pub fn room(&self, port: PortId) -> usize {
        self.line(port).map_or(0, SerialLine::room)
    }

    /// The client sends `bytes` at `now`, to which the rig advances first.
    ///
    /// # Errors
    /// As [`Rig::advance`].
    pub fn client_sends(
        &mut self,
        port: PortId,
        now: SimTime,
        bytes: &[u8],
    ) -> Result<(), RigError> {
        // Bytes come before deadlines of the same instant, so stop just short of it.
        if let Some(before) = now.as_nanos().checked_sub(1) {
            self.advance(SimTime::from_nanos(before))?;
        }
        let now = now.max(self.now);
        let event = self
            .line_mut(port)
            .and_then(|line| line.client_sends(now, bytes));
        self.reschedule(port.device);
        self.advance(now)?;
        self.line_event(port, event);
        Ok(())
    }

    /// Adds to `bytes` what has arrived at the client by the present time.
    pub fn client_reads(&mut self, port: PortId, bytes: &mut Vec<u8>) {
        let now = self.now;
        if let Some(line) = self.line_mut(port) {
            line.take_for_client(now, bytes);
        }
    }

    /// The client did not read, and `bytes` of what it should have got were lost.
    pub fn client_lost(&mut self, port: PortId, bytes: u64) {
        self.line_event(port, Some(LineEvent::Overrun { bytes }));
    }

    fn reschedule(&mut self, device: usize) {
        if let Some(slot) = self.slots.get_mut(device) {
            let arrivals = slot.lines.iter().filter_map(SerialLine::next_for_device);
            slot.next = arrivals
                .min()
                .map_or(slot.next, |arrival| arrival.min(slot.next));
        }
    }

    fn line(&self, port: PortId) -> Option<&SerialLine> {
        self.slots.get(port.device)?.lines.get(port.link)
    }

    fn line_mut(&mut self, port: PortId) -> Option<&mut SerialLine> {
        self.slots.get_mut(port.device)?.lines.get_mut(port.link)
    }
}
