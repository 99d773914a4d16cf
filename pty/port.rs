//! Port as the caller sees it, of whichever kind it is.

use std::path::Path;

use crate::error::{PortError, PortErrorKind};
use crate::hub::Registration;
use crate::line::LineSettings;
use crate::net_port::{ListenAddress, NetPort};
use crate::pair::PtySetup;
use crate::pty_port::PtyPort;
use crate::serial_port::SerialPort;

/// A place where a client talks to a device.
#[derive(Debug)]
pub enum Port {
    /// A pseudo-terminal on this machine.
    Pty(PtyPort),
    /// A real serial port with the client at the other end of the cable.
    Serial(SerialPort),
    /// A port that clients reach over the network.
    Net(Box<NetPort>),
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

/// Fate of the bytes given to [`Port::write`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[must_use]
pub struct Written {
    /// Bytes on their way to the client.
    pub accepted: usize,
    /// Bytes lost, because nobody is attached or the client does not read.
    pub dropped: usize,
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
    /// pseudo-terminal with a link at that path ([`PtyPort::open_at`]).
    ///
    /// # Errors
    ///
    /// When the URL lacks something, and as those do.
    pub fn open_at(place: &Path, setup: PtySetup) -> Result<Self, PortError> {
        match place.to_str().and_then(ListenAddress::parse) {
            None => PtyPort::open_at(place, setup).map(Self::from),
            Some(Ok(address)) => NetPort::open(&address, setup.baud).map(Self::from),
            Some(Err(why)) => Err(PortError::new("serve", place, PortErrorKind::BadUrl(why))),
        }
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
        match self {
            Self::Pty(port) => port.read(buf),
            Self::Serial(port) => port.read(buf),
            Self::Net(port) => port.read(buf),
        }
    }

    /// Sends without blocking. What does not fit is dropped and counted; a pseudo-terminal keeps some
    /// of it, and drops the oldest. With nobody attached all is dropped.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    pub fn write(&mut self, bytes: &[u8]) -> Result<Written, PortError> {
        match self {
            Self::Pty(port) => port.write(bytes),
            Self::Serial(port) => port.write(bytes),
            Self::Net(port) => Ok(port.write(bytes)),
        }
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
        match self {
            Self::Pty(port) => port.client_line().map(Some),
            Self::Serial(_) => Ok(None),
            Self::Net(port) => Ok(Some(port.client_line())),
        }
    }

    /// Tells whether a client is attached, as far as events were reported. One that has come in another's
    /// place is so from when that one is said to have left.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        match self {
            Self::Pty(port) => port.is_attached(),
            Self::Serial(port) => port.is_attached(),
            Self::Net(port) => port.is_attached(),
        }
    }

    /// The path or URL that a client opens, or the path of the serial device.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::Pty(port) => port.path(),
            Self::Serial(port) => port.path(),
            Self::Net(port) => port.path(),
        }
    }

    /// Totals since the port was opened.
    #[must_use]
    pub fn counters(&self) -> Counters {
        match self {
            Self::Pty(port) => port.counters(),
            Self::Serial(port) => port.counters(),
            Self::Net(port) => port.counters(),
        }
    }

    pub(crate) fn register(&mut self, registration: Registration) -> Result<(), PortError> {
        match self {
            Self::Pty(port) => port.register(registration),
            Self::Serial(port) => port.register(registration),
            Self::Net(port) => port.register(registration),
        }
    }
}

impl From<PtyPort> for Port {
    fn from(port: PtyPort) -> Self {
        Self::Pty(port)
    }
}

impl From<NetPort> for Port {
    fn from(port: NetPort) -> Self {
        Self::Net(Box::new(port))
    }
}

impl From<SerialPort> for Port {
    fn from(port: SerialPort) -> Self {
        Self::Serial(port)
    }
}

impl Counters {
    pub(crate) fn received(&mut self, bytes: usize) {
        self.received_bytes += bytes as u64;
    }

    pub(crate) fn written(&mut self, written: Written) {
        self.sent_bytes += written.accepted as u64;
        self.dropped_full_bytes += written.dropped as u64;
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
