//! A port in simulated time, as the simulation and all handles of it know it.

use std::collections::VecDeque;

use rigsim_core::line::ClientLine;
use rigsim_core::rig::PortId;
use rigsim_runner::{Run, RunError};
use serialport::FlowControl;

/// Most bytes kept for a client that does not read, as much as the kernel keeps for a
/// pseudo-terminal; further ones are lost, which the event `overrun` reports.
const MOST_UNREAD: usize = 20_480;

/// State that all handles of a port share.
pub(crate) struct PortState {
    pub(crate) id: PortId,
    /// As the device's end is set.
    pub(crate) device_line: ClientLine,
    pub(crate) line: ClientLine,
    pub(crate) flow_control: FlowControl,
    /// Handles that are open, and how often the port has been opened: those of an earlier time stay
    /// dead.
    pub(crate) handles: usize,
    pub(crate) opened: u64,
    /// The cable has been pulled since it was opened.
    pub(crate) hung_up: bool,
    pub(crate) unread: VecDeque<u8>,
}

impl PortState {
    pub(crate) fn new(id: PortId, run: &Run) -> Self {
        let link = run.scenario().rig.links().find(|link| link.id == id);
        let line = ClientLine::at(link.map_or(115_200, |link| link.baud));
        Self {
            id,
            device_line: line,
            line,
            flow_control: FlowControl::None,
            handles: 0,
            opened: 0,
            hung_up: false,
            unread: VecDeque::new(),
        }
    }

    /// Takes what has arrived, and notices that the cable is out.
    pub(crate) fn update(&mut self, run: &mut Run) -> Result<(), RunError> {
        let mut bytes = Vec::new();
        run.read(self.id, &mut bytes);
        if self.handles == 0 || self.hung_up {
            return Ok(());
        }
        let kept = bytes
            .len()
            .min(MOST_UNREAD.saturating_sub(self.unread.len()));
        self.unread.extend(&bytes[..kept]);
        if let Ok(lost @ 1..) = u64::try_from(bytes.len() - kept) {
            run.client_lost(self.id, lost);
            run.advance(run.rig().now())?;
        }
        if run.rig().cable_pulled(self.id) {
            self.hung_up = true;
            run.detach(self.id, run.rig().now())?;
        }
        Ok(())
    }
}
