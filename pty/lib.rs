//! Pseudo-terminals and serial ports: the only crate with system calls.
//!
//! A simulated device is reached over a [`Port`]: a pseudo-terminal that an
//! unmodified client opens like a serial port, a real serial
//! port with the client at the other end of a cable, or one
//! that clients reach over the network. The
//! caller treats all the same: a [`Waiter`] says which ports have events, and
//! [`Port::read`] returns them one [`Event`] at a time.
//!
//! ```no_run
//! use rigsim_pty::{Event, PtySetup, Waiter, open_port};
//!
//! # fn main() -> Result<(), rigsim_pty::PortError> {
//! let mut port = open_port("/tmp/r150", PtySetup::raw(115_200))?;
//! let mut waiter = Waiter::new()?;
//! waiter.catch_signals()?;
//! waiter.add(0, &mut port)?;
//!
//! let mut buf = [0; 4096];
//! loop {
//!     let wake = waiter.wait(None)?;
//!     if wake.is_signalled() {
//!         return Ok(()); // Dropping the port removes the link.
//!     }
//!     for _token in wake.ready() {
//!         match port.read(&mut buf)? {
//!             Event::Data(n) => drop(port.write(&buf[..n])?),
//!             Event::Attached | Event::Detached | Event::Idle => {}
//!         }
//!     }
//! }
//! # }
//! ```
//!
//! # What the crate promises
//!
//! - No call blocks, except [`Waiter::wait`].
//! - A client that does not read never stalls the caller. The kernel keeps
//!   about 20 kB for it and a pseudo-terminal 64 KiB of what came last; the rest is
//!   dropped and counted, as a UART without flow control would lose it.
//! - It is as with a cable: bytes that a client has written are read in order, whichever client wrote them, and
//!   what is sent goes to the client that has the port open. What a client has written and was not read when
//!   it left is thrown away, and so is what it has not read itself; where another came before
//!   the first look, as far as it is certain whose it was. No byte of a client that is there is lost.
//! - What a client leaves behind at a terminal is undone: settings, locks, exclusive use, suspended
//!   output.
//! - No other program's file is replaced or removed; [`open_port`] says
//!   which link counts as our own.
//! - Waiting costs no processor time while no client sends.

mod error;
mod hub;
mod line;
mod net_decoder;
mod net_port;
mod open;
mod pair;
pub mod paths;
mod port;
mod pty_port;
mod serial_port;
mod signals;
mod waiter;

pub use error::{PortError, PortErrorKind};
pub use line::{Defaults, line_of};
pub use net_decoder::{NetDecoder, Protocol};
pub use net_port::ListenAddress;
pub use open::{open_port, open_serial_port, open_unlinked_port};
pub use pair::{PtySetup, open_terminal, restore_end};
pub use port::{Counters, Event, Port};
pub use rigsim_settings::ClientLine;
pub use signals::{ExitOnSignals, survive_full_files};
pub use waiter::{Waiter, Wake, sharpen_timers, want_descriptors};
