//! The clients' ends of all lines.

use std::collections::BTreeMap;
use std::ops::Range;

use rigsim_core::line::ClientLine;
use rigsim_core::rig::PortId;

/// All ports, and what has arrived there.
pub(super) struct Ports {
    pub(super) ids: Vec<PortId>,
    /// Index in `ids` of each device's first port, and behind them the number of ports.
    first: Vec<usize>,
    /// What each client has set its end to.
    pub(super) lines: BTreeMap<PortId, ClientLine>,
    /// Bytes that were not read, by port.
    pub(super) unread: Vec<Vec<u8>>,
}

impl Ports {
    /// The ports of so many devices, in the order of the devices.
    pub(super) fn new(ids: Vec<PortId>, devices: usize) -> Self {
        let first = |device| ids.partition_point(|port| port.device < device);
        Self {
            first: (0..=devices).map(first).collect(),
            lines: BTreeMap::new(),
            unread: vec![Vec::new(); ids.len()],
            ids,
        }
    }

    /// The ports of a device, as indices.
    pub(super) fn of(&self, device: usize) -> Range<usize> {
        let bound = |device| self.first.get(device).copied().unwrap_or_default();
        bound(device)..bound(device.saturating_add(1))
    }

    /// A port as an index.
    pub(super) fn at(&self, port: PortId) -> Option<usize> {
        self.of(port.device).nth(port.link)
    }
}
