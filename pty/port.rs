//! Ports of every kind, as the caller sees them.

use std::fmt::Debug;
use std::path::Path;

use rigsim_settings::ClientLine;

use crate::error::PortError;
use crate::hub::Registration;

/// A place where a client talks to a device: a pseudo-terminal of this machine, a real serial port with
/// the client at the other end of the cable, or a port that clients reach over the network.
pub trait Port: Debug + Send + Sync {
    /// Returns the next event, without blocking. Received bytes are
    /// put at the start of `buf`.
    ///
    /// A port that a [`Waiter`](crate::Waiter) called ready must be read at
    /// least once. It need not be read until [`Event::Idle`]: the waiter
    /// calls it ready again while anything is left.
    ///
    /// A caller without room for bytes passes an empty buffer. It then learns which clients come and
    /// go, and gets [`Event::Idle`] whether there are bytes or not. It has to read again by itself
    /// once it has room.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError>;

    /// Sends without blocking, and says how many more bytes are then on their way to the client. What does
    /// not fit is dropped and counted; a pseudo-terminal keeps some of it, and drops the oldest. With no client
    /// attached all is dropped.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError>;

    /// The line settings of the client that has the port open now, where they can be known: a client at the
    /// end of a real cable keeps them to itself.
    ///
    /// One system call of well under a microsecond, meant to be made for
    /// every burst of received bytes.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    fn client_line(&self) -> Result<Option<ClientLine>, PortError>;

    /// Returns whether a client is attached, as far as events were reported. One that has come in another's
    /// place is so from when that one is said to have left.
    #[must_use]
    fn is_attached(&self) -> bool;

    /// The path or URL that a client opens, or the path of the serial device.
    #[must_use]
    fn path(&self) -> &Path;

    /// Totals since the port was opened.
    #[must_use]
    fn counters(&self) -> Counters;

    /// Reports its events to a waiter from now on.
    #[doc(hidden)]
    fn register(&mut self, registration: Registration) -> Result<(), PortError>;

    /// Returns whether other machines can connect, too.
    #[must_use]
    fn is_public(&self) -> bool {
        false
    }

    /// How many bytes [`write`](Self::write) takes now without dropping any that it has kept. What it
    /// does not accept of them is not kept either.
    #[must_use]
    fn room(&self) -> usize {
        usize::MAX
    }

    /// Sets a real serial port as a client has set its end of a line that is passed on: speed, stop bits
    /// and flow control. A speed of 0 and ports of other kinds stay as they are.
    ///
    /// # Errors
    ///
    /// When the port was unplugged, or does not do the speed.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ports_and_waiters_may_move_to_the_thread_that_serves_them() {
        fn movable<T: Send>() {}
        movable::<Box<dyn Port>>();
        movable::<crate::Waiter>();
        movable::<PortError>();
    }
}
