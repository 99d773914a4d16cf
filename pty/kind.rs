//! What ports of every kind do, and what they report.

use std::fmt::Debug;
use std::path::Path;

use rigsim_settings::ClientLine;

use crate::error::PortError;
use crate::hub::Registration;

/// A port of one kind; see [`Port`](crate::Port).
pub(crate) trait Kind: Debug + Send + Sync {
    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError>;
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError>;
    fn client_line(&self) -> Result<Option<ClientLine>, PortError>;
    fn is_attached(&self) -> bool;
    fn path(&self) -> &Path;
    fn counters(&self) -> Counters;
    fn register(&mut self, registration: Registration) -> Result<(), PortError>;

    fn node(&self) -> &Path {
        self.path()
    }

    fn is_public(&self) -> bool {
        false
    }

    fn room(&self) -> usize {
        usize::MAX
    }

    fn set_line(&mut self, _line: ClientLine) -> Result<(), PortError> {
        Ok(())
    }
}

/// Something that has happened at a port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[must_use]
pub enum Event {
    /// A client has opened the port. A serial port reports this once, at the
    /// start, since a cable does not tell.
    Attached,
    /// So many bytes were received, never 0.
    Data(usize),
    /// The client is gone. What it had sent and was not read by then is thrown away, as far as it
    /// is certain that it was its own.
    Detached,
    /// There is nothing to report.
    Idle,
}

/// Totals of a port since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes received from clients.
    pub received_bytes: u64,
    /// Bytes accepted for sending. A client that leaves without reading them
    /// never gets them.
    pub sent_bytes: u64,
    /// Bytes dropped because the client did not read and the buffer was full.
    pub dropped_full_bytes: u64,
    /// Bytes dropped because no client was attached.
    pub dropped_detached_bytes: u64,
    /// Number of times that a client attached.
    pub attached: u64,
}

impl Counters {
    pub(crate) fn received(&mut self, bytes: usize) {
        self.received_bytes += bytes as u64;
    }

    /// So many of `bytes` were accepted while a client was there.
    pub(crate) fn sent(&mut self, accepted: usize, bytes: &[u8]) {
        self.sent_bytes += accepted as u64;
        self.dropped_full_bytes += (bytes.len() - accepted) as u64;
    }
}
