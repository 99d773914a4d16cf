//! Opening of ports of every kind.

use std::path::Path;

use crate::error::{PortError, PortErrorKind};
use crate::net_port::{ListenAddress, NetPort};
use crate::pair::PtySetup;
use crate::port::Port;
use crate::pty_port::PtyPort;
use crate::serial_port::SerialPort;

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
pub fn open_port(place: impl AsRef<Path>, setup: PtySetup) -> Result<Box<dyn Port>, PortError> {
    let place = place.as_ref();
    Ok(match place.to_str().and_then(ListenAddress::parse) {
        None => Box::new(PtyPort::open_at(place, setup)?),
        Some(Ok(address)) => Box::new(NetPort::open(&address, setup.baud)?),
        Some(Err(why)) => {
            return Err(PortError::new("serve", place, PortErrorKind::BadUrl(why)));
        }
    })
}

/// Opens a pseudo-terminal without a link; [`Port::path`] says where it is.
///
/// # Errors
///
/// When the system refuses.
pub fn open_unlinked_port(setup: PtySetup) -> Result<Box<dyn Port>, PortError> {
    Ok(Box::new(PtyPort::open_unlinked(setup)?))
}

/// Opens the real serial port at `path`, exclusively, with `baud`, 8 data bits, no parity, 1 stop bit
/// and no flow control.
///
/// # Errors
///
/// When it does not exist, is held by another program, may not be opened by this user or does not do
/// the baud rate.
pub fn open_serial_port(path: impl AsRef<Path>, baud: u32) -> Result<Box<dyn Port>, PortError> {
    Ok(Box::new(SerialPort::open(path.as_ref(), baud)?))
}
