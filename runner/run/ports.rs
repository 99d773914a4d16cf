//! The clients' ends of all lines.

use std::collections::BTreeMap;
use std::ops::Range;

use rigsim_core::line::ClientLine;
use rigsim_core::rig::PortId;

/// All ports, and what has arrived there.
pub(super) struct Ports {
    /// In their order.
    pub(super) ids: Vec<PortId>,
    /// What each client has set its end to.
    pub(super) lines: BTreeMap<PortId, ClientLine>,
    /// Bytes that were not read, by port.
    pub(super) unread: Vec<Vec<u8>>,
}

impl Ports {
    /// The ports of all devices, in the order of the devices.
    pub(super) fn new(ids: Vec<PortId>) -> Self {
        Self {
            lines: BTreeMap::new(),
            unread: vec![Vec::new(); ids.len()],
            ids,
        }
    }

    /// The ports of a device, as indices.
    pub(super) fn of(&self, device: usize) -> Range<usize> {
        let first = self.ids.partition_point(|port| port.device < device);
        first..self.ids.partition_point(|port| port.device <= device)
    }

    /// A port as an index.
    pub(super) fn at(&self, port: PortId) -> Option<usize> {
        self.ids.binary_search(&port).ok()
    }
}
