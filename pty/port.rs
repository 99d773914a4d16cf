//! Port as the caller sees it, of whichever kind it is.

use std::fmt::Debug;
use std::path::Path;

use crate::error::{PortError, PortErrorKind};
use crate::hub::Registration;
use crate::line::LineSettings;
use crate::net_port::{ListenAddress, NetPort};
use crate::pair::PtySetup;
use crate::pty_port::PtyPort;
use crate::serial_port::SerialPort;

/// A place where a client talks to a device: a pseudo-terminal of this machine, a real serial port with
/// the client at the other end of the cable, or a port that clients reach over the network.
#[derive(Debug)]
pub struct Port(Box<dyn Kind>);

/// A port of one kind; see [`Port`].
pub(crate) trait Kind: Debug + Send + Sync {
    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError>;
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError>;
    fn client_line(&self) -> Result<Option<LineSettings>, PortError>;
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
}

/// One piece of news from a port.
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
    /// Bytes dropped because nobody was attached.
    pub dropped_detached_bytes: u64,
    /// Number of times that a client attached.
    pub attached: u64,
}

impl Port {
    /// Opens a port where `place` says: on the network if it is a URL ([`ListenAddress`]), else a
    /// pseudo-terminal that is set up so, published at that path as a symbolic link, which is removed on
    /// drop.
    ///
    /// The link appears whole and last. It replaces nothing but a stale link of our own kind, which is,
    /// provided that no running simulator serves the path,
    ///
    /// - the very link that a simulator which was killed recorded in its lock file beside it
    ///   (`.NAME.sim-lock`), wherever it points by now, or
    /// - a link to a node under `/dev/pts` that does not exist or is the one just opened: nobody can use
    ///   such a link.
    ///
    /// # Errors
    ///
    /// When the URL lacks something, or its address is taken or another machine's; when anything else is
    /// at the path, a running simulator serves it, or its directory is missing or not writable; or when
    /// the system refuses.
    pub fn open_at(place: impl AsRef<Path>, setup: PtySetup) -> Result<Self, PortError> {
        let place = place.as_ref();
        match place.to_str().and_then(ListenAddress::parse) {
            None => PtyPort::open_at(place, setup).map(Self::of),
            Some(Ok(address)) => NetPort::open(&address, setup.baud).map(Self::of),
            Some(Err(why)) => Err(PortError::new("serve", place, PortErrorKind::BadUrl(why))),
        }
    }

    /// Opens a pseudo-terminal without a link; [`path`](Self::path) says where it is.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn open_unlinked(setup: PtySetup) -> Result<Self, PortError> {
        PtyPort::open_unlinked(setup).map(Self::of)
    }

    /// Opens the real serial port at `path`, exclusively, with `baud`, 8 data bits, no parity, 1 or 2 stop
    /// bits and no flow control.
    ///
    /// # Errors
    ///
    /// When it does not exist, is held by another program, may not be opened by this user or does not do
    /// the baud rate.
    pub fn open_serial(
        path: impl AsRef<Path>,
        baud: u32,
        stop_bits: u32,
    ) -> Result<Self, PortError> {
        SerialPort::open(path.as_ref(), baud, stop_bits).map(Self::of)
    }

    fn of(port: impl Kind + 'static) -> Self {
        Self(Box::new(port))
    }

    /// Reports the next piece of news, without blocking. Received bytes are
    /// put at the start of `buf`.
    ///
    /// A port that a [`Waiter`](crate::Waiter) called ready must be read at
    /// least once. It need not be read until [`Event::Idle`]: the waiter
    /// calls it ready again while anything is left.
    ///
    /// A caller without room for bytes passes an empty buffer, which tells of clients that come and
    /// go, and gets [`Event::Idle`] whether there are bytes or not. It has to read again by itself
    /// once it has room.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    pub fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        self.0.read(buf)
    }

    /// Sends without blocking, and says how many more bytes are then on their way to the client. What does
    /// not fit is dropped and counted; a pseudo-terminal keeps some of it, and drops the oldest. With nobody
    /// attached all is dropped.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        self.0.write(bytes)
    }

    /// The line settings of whoever has the port open now, where they can be known: a client at the
    /// end of a real cable keeps them to itself.
    ///
    /// One system call of well under a microsecond, meant to be made for
    /// every burst of received bytes.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn client_line(&self) -> Result<Option<LineSettings>, PortError> {
        self.0.client_line()
    }

    /// Tells whether a client is attached, as far as events were reported. One that has come in another's
    /// place is so from when that one is said to have left.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.0.is_attached()
    }

    /// The path or URL that a client opens, or the path of the serial device.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// The node under `/dev/pts` to which the link of a pseudo-terminal leads. It changes when a client
    /// left the old one locked and this process may not unlock it.
    #[must_use]
    pub fn node(&self) -> &Path {
        self.0.node()
    }

    /// Tells whether other machines can connect, too.
    #[must_use]
    pub fn is_public(&self) -> bool {
        self.0.is_public()
    }

    /// Totals since the port was opened.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.0.counters()
    }

    pub(crate) fn register(&mut self, registration: Registration) -> Result<(), PortError> {
        self.0.register(registration)
    }
}

impl Counters {
    pub(crate) fn received(&mut self, bytes: usize) {
        self.received_bytes += bytes as u64;
    }

    /// So many of `bytes` were accepted while somebody was there.
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
        movable::<Port>();
        movable::<crate::Waiter>();
        movable::<PortError>();
    }
}
