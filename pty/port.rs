//! Port as the caller sees it, of whichever kind it is.

use rigsim_settings::ClientLine;
use std::path::Path;

use crate::error::{PortError, PortErrorKind};
use crate::hub::Registration;
use crate::kind::{Counters, Event, Kind};
use crate::net_port::{ListenAddress, NetPort};
use crate::pair::PtySetup;
use crate::pty_port::PtyPort;
use crate::serial_port::SerialPort;

/// A place where a client talks to a device: a pseudo-terminal of this machine, a real serial port with
/// the client at the other end of the cable, or a port that clients reach over the network.
#[derive(Debug)]
pub struct Port(Box<dyn Kind>);

impl Port {
    /// Opens a port where `place` says: on the network if it is a URL ([`ListenAddress`]), else a
    /// pseudo-terminal that is set up so, published at that path as a symbolic link, which is removed on
    /// drop.
    ///
    /// The link appears whole and last. It replaces nothing but the very link that a simulator which was
    /// killed recorded in its lock file beside it (`.NAME.sim-lock`), wherever that points by now.
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
    pub fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        self.0.read(buf)
    }

    /// Sends without blocking, and says how many more bytes are then on their way to the client. What does
    /// not fit is dropped and counted; a pseudo-terminal keeps some of it, and drops the oldest. With no client
    /// attached all is dropped.
    ///
    /// # Errors
    ///
    /// When the system refuses, or a serial port was unplugged.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        self.0.write(bytes)
    }

    /// The line settings of the client that has the port open now, where they can be known: a client at the
    /// end of a real cable keeps them to itself.
    ///
    /// One system call of well under a microsecond, meant to be made for
    /// every burst of received bytes.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn client_line(&self) -> Result<Option<ClientLine>, PortError> {
        self.0.client_line()
    }

    /// Sets a real serial port as a client has set its end of a line that is passed on: speed, stop bits
    /// and flow control. A speed of 0 and ports of other kinds stay as they are.
    ///
    /// # Errors
    ///
    /// When the port was unplugged, or does not do the speed.
    pub fn set_line(&mut self, line: ClientLine) -> Result<(), PortError> {
        self.0.set_line(line)
    }

    /// How many bytes [`write`](Self::write) takes now without dropping any that it has kept. What it
    /// does not accept of them is not kept either.
    #[must_use]
    pub fn room(&self) -> usize {
        self.0.room()
    }

    /// Returns whether a client is attached, as far as events were reported. One that has come in another's
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

    /// Returns whether other machines can connect, too.
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
