//! A port of a device, which a pulled cable closes for a while.

use std::path::{Path, PathBuf};

use rigsim_core::rig::PortId;
use rigsim_pty::{Counters, Port, PortError, PtySetup, Waiter, open_port};

/// A port and whose it is.
pub struct Served {
    /// Device and link.
    pub id: PortId,
    /// Path at which a client opens it.
    pub path: PathBuf,
    /// `None` while the cable is pulled.
    pub port: Option<Box<dyn Port>>,
    /// Setup by which it can be made again; a cable in a real serial port stays in.
    setup: Option<PtySetup>,
    /// Totals of the times before the cable was pulled.
    before: Counters,
    /// Set while what is there waits for room on its line, or for its turn.
    pub paused: bool,
}

impl Served {
    /// Serves on a pseudo-terminal at `path`, or on the network if that is a URL
    /// (`tcp://HOST:PORT`, `rfc2217://HOST:PORT`).
    ///
    /// # Errors
    /// When the port cannot be made.
    pub fn at(id: PortId, path: &Path, setup: PtySetup) -> Result<Self, PortError> {
        Ok(Self {
            setup: Some(setup),
            ..Self::new(id, open_port(path, setup)?)
        })
    }

    /// Serves on a port that stays.
    pub fn new(id: PortId, port: Box<dyn Port>) -> Self {
        Self {
            id,
            path: port.path().to_owned(),
            port: Some(port),
            setup: None,
            before: Counters::default(),
            paused: false,
        }
    }

    /// Closes the port, as when its cable is pulled; says whether a client had it open.
    pub fn hang_up(&mut self) -> bool {
        let Some(port) = self.port.take_if(|_| self.setup.is_some()) else {
            return false;
        };
        self.before = sum(self.before, port.counters());
        self.paused = false;
        port.is_attached()
    }

    /// Makes the port again.
    pub fn reopen(&mut self, waiter: &mut Waiter, token: usize) -> Result<(), PortError> {
        if let (None, Some(setup)) = (&self.port, self.setup) {
            let mut port = open_port(&self.path, setup)?;
            waiter.add(token, &mut port)?;
            self.port = Some(port);
        }
        Ok(())
    }

    /// Returns whether a client has it open.
    pub fn is_attached(&self) -> bool {
        self.port.as_ref().is_some_and(|port| port.is_attached())
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
