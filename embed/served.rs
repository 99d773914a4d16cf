//! A port of a device, which a pulled cable closes for a while.

use std::path::{Path, PathBuf};

use sim_core::rig::PortId;
use sim_pty::{Counters, Port, PortError, PtyPort, PtySetup, Waiter};

/// A port and whose it is.
pub struct Served {
    /// Device and link.
    pub id: PortId,
    /// Where a client opens it.
    pub path: PathBuf,
    /// `None` while the cable is pulled.
    pub port: Option<Port>,
    /// A pseudo-terminal that can be made again; a cable in a real serial port stays in.
    baud: Option<u32>,
    /// Totals of the times before the cable was pulled.
    before: Counters,
    /// Its line is full, and it is not read.
    pub paused: bool,
}

impl Served {
    /// Serves on a pseudo-terminal at `path`.
    pub fn at(id: PortId, path: &Path, baud: u32) -> Result<Self, PortError> {
        let port = PtyPort::open_at(path, PtySetup::raw(baud))?;
        Ok(Self {
            baud: Some(baud),
            ..Self::new(id, port.into())
        })
    }

    /// Serves on a port that stays.
    pub fn new(id: PortId, port: Port) -> Self {
        Self {
            id,
            path: port.path().to_owned(),
            port: Some(port),
            baud: None,
            before: Counters::default(),
            paused: false,
        }
    }

    /// Closes the port, as when its cable is pulled; says whether a client had it open.
    pub fn hang_up(&mut self) -> bool {
        let Some(port) = self.port.take_if(|_| self.baud.is_some()) else {
            return false;
        };
        self.before = sum(self.before, port.counters());
        self.paused = false;
        port.is_attached()
    }

    /// Makes the port again.
    pub fn reopen(&mut self, waiter: &mut Waiter, token: usize) -> Result<(), PortError> {
        if let (None, Some(baud)) = (&self.port, self.baud) {
            let mut port = Port::from(PtyPort::open_at(&self.path, PtySetup::raw(baud))?);
            waiter.add(token, &mut port)?;
            self.port = Some(port);
        }
        Ok(())
    }

    /// Totals since the beginning.
    pub fn counters(&self) -> Counters {
        match &self.port {
            Some(port) => sum(self.before, port.counters()),
            None => self.before,
        }
    }
}

fn sum(a: Counters, b: Counters) -> Counters {
    Counters {
        received_bytes: a.received_bytes + b.received_bytes,
        sent_bytes: a.sent_bytes + b.sent_bytes,
        dropped_full_bytes: a.dropped_full_bytes + b.dropped_full_bytes,
        dropped_detached_bytes: a.dropped_detached_bytes + b.dropped_detached_bytes,
        attached: a.attached + b.attached,
    }
}
