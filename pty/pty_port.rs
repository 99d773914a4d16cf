//! A pseudo-terminal that clients open like a serial port.
//!
//! The client's end is never held open by us: that would hide the hang-up,
//! keep replies for the next client, and stop the settings from being put
//! back. Packet mode is not used either: one `tcgetattr` per burst of bytes
//! tells the client's speed without a control byte in front of every read.

use std::path::{Path, PathBuf};

use rustix::io::{Errno, retry_on_intr};

use crate::error::{PortError, PortErrorKind};
use crate::hub::Registration;
use crate::line::LineSettings;
use crate::link::Link;
use crate::pair::{Access, Pair};
use crate::port::{Counters, Event, Written};

/// A pseudo-terminal, with or without a link to it at a path of the user's
/// choice.
#[derive(Debug)]
pub struct PtyPort {
    // Dropped first: the link goes before what it points to.
    link: Option<Link>,
    registration: Option<Registration>,
    pair: Pair,
    baud: u32,
    attached: bool,
    successor: bool,
    counters: Counters,
}

impl PtyPort {
    /// Opens a pseudo-terminal, raw at the device's own `baud`, and publishes
    /// it at `path` as a symbolic link, which is removed on drop.
    ///
    /// The link appears whole and last. It replaces nothing but a stale link
    /// of our own kind, which is, provided that no running simulator serves
    /// `path`,
    ///
    /// - the very link that a simulator which was killed recorded in its lock
    ///   file beside it (`.NAME.sim-lock`), wherever it points by now, or
    /// - a link to a node under `/dev/pts` that does not exist or is the one
    ///   just opened: nobody can use such a link.
    ///
    /// # Errors
    ///
    /// When anything else is at `path`, a running simulator serves it, its
    /// directory is missing or not writable, or the system refuses.
    pub fn open_at(path: impl AsRef<Path>, baud: u32) -> Result<Self, PortError> {
        let path = path.as_ref();
        let open = || {
            let pair = Pair::open(baud)?;
            let link = Link::publish(path, pair.slave())?;
            Ok(Self::new(pair, Some(link), baud))
        };
        open().map_err(|kind| PortError::new("serve", path, kind))
    }

    /// Opens a pseudo-terminal without a link; [`path`](Self::path) says
    /// where it is.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn open_unlinked(baud: u32) -> Result<Self, PortError> {
        let pair = Pair::open(baud).map_err(|kind| PortError::new("open", "/dev/ptmx", kind))?;
        Ok(Self::new(pair, None, baud))
    }

    fn new(pair: Pair, link: Option<Link>, baud: u32) -> Self {
        Self {
            link,
            registration: None,
            pair,
            baud,
            attached: false,
            successor: false,
            counters: Counters::default(),
        }
    }

    /// The path that clients open: the link if there is one, else the node.
    #[must_use]
    pub fn path(&self) -> &Path {
        self.link.as_ref().map_or(self.pair.slave(), Link::path)
    }

    /// The node under `/dev/pts`. It changes when a client left the old one
    /// locked and this process may not unlock it.
    #[must_use]
    pub fn slave_path(&self) -> &Path {
        self.pair.slave()
    }

    /// Whether a client is attached, as far as events were reported.
    #[must_use]
    pub fn is_attached(&self) -> bool {
        self.attached
    }

    /// Totals since the port was opened.
    #[must_use]
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// The line settings as the client has made them, or the device's own if
    /// no client has.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn client_line(&self) -> Result<LineSettings, PortError> {
        LineSettings::of(&self.pair).map_err(|errno| {
            self.error(
                "read the line settings of",
                PortErrorKind::call("tcgetattr")(errno),
            )
        })
    }

    /// Reports the next piece of news; see [`Port::read`](crate::Port::read).
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        self.next_event(buf)
            .map_err(|kind| self.error("read from", kind))
    }

    /// Sends what fits and drops the rest; see
    /// [`Port::write`](crate::Port::write).
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn write(&mut self, bytes: &[u8]) -> Result<Written, PortError> {
        if !self.attached {
            self.counters.dropped_detached_bytes += bytes.len() as u64;
            return Ok(Written {
                accepted: 0,
                dropped: bytes.len(),
            });
        }
        let accepted = write_some(&self.pair, bytes)
            .map_err(|errno| self.error("write to", PortErrorKind::call("write")(errno)))?;
        let written = Written {
            accepted,
            dropped: bytes.len() - accepted,
        };
        self.counters.written(written);
        Ok(written)
    }

    pub(crate) fn register(&mut self, mut registration: Registration) -> Result<(), PortError> {
        self.deregister()
            .map_err(|kind| self.error("watch", kind))?;
        let mut register = || {
            registration.watch(self.pair.slave())?;
            registration.poll_input(&self.pair, self.attached)
        };
        register().map_err(|kind| self.error("watch", kind))?;
        // A client from before the watch has left no trace in it. One that
        // came just now may be counted twice, which errs on the safe side: a
        // client is never taken for another.
        let hung_up = self.pair.is_hung_up();
        let hung_up =
            hung_up.map_err(|errno| self.error("watch", PortErrorKind::call("poll")(errno)))?;
        registration.set_openers(u32::from(!hung_up));
        self.registration = Some(registration);
        Ok(())
    }

    fn deregister(&mut self) -> Result<(), PortErrorKind> {
        self.registration
            .take()
            .map_or(Ok(()), |mut old| old.poll_input(&self.pair, false))
    }

    fn next_event(&mut self, buf: &mut [u8]) -> Result<Event, PortErrorKind> {
        let visits = self
            .registration
            .as_ref()
            .map(Registration::take_visits)
            .unwrap_or_default();
        if !self.attached {
            // Somebody who came and left without a byte is reported too: it
            // may have left settings or a lock behind.
            if visits.closed || self.successor || self.has_client()? {
                return self.attach();
            }
            return Ok(Event::Idle);
        }
        if visits.emptied
            && !self
                .pair
                .is_hung_up()
                .map_err(PortErrorKind::call("poll"))?
        {
            return self.change_hands();
        }
        if buf.is_empty() {
            return Ok(Event::Idle);
        }
        match retry_on_intr(|| rustix::io::read(&self.pair, &mut *buf)) {
            Ok(n) if n > 0 => {
                self.counters.received(n);
                Ok(Event::Data(n))
            }
            Err(Errno::AGAIN) => Ok(Event::Idle),
            Ok(_) | Err(Errno::IO) => self.detach(),
            Err(errno) => Err(PortErrorKind::call("read")(errno)),
        }
    }

    fn attach(&mut self) -> Result<Event, PortErrorKind> {
        self.attached = true;
        self.successor = false;
        self.counters.attached += 1;
        self.poll_input(true)?;
        Ok(Event::Attached)
    }

    fn detach(&mut self) -> Result<Event, PortErrorKind> {
        self.attached = false;
        // First of all, while the next client is least likely to be there.
        self.pair
            .reset()
            .map_err(PortErrorKind::call("tcsetattr"))?;
        self.poll_input(false)?;
        self.unlock()?;
        let has_client = self.has_client()?;
        if let Some(registration) = &self.registration {
            registration.set_openers(u32::from(has_client));
            if has_client {
                registration.mark_ready();
            }
        }
        Ok(Event::Detached)
    }

    /// One client has left and another has come unnoticed. The settings are
    /// the new one's by now, so only what was sent to the old one goes.
    fn change_hands(&mut self) -> Result<Event, PortErrorKind> {
        self.pair
            .flush_output()
            .map_err(PortErrorKind::call("tcsetattr"))?;
        self.attached = false;
        self.successor = true;
        if let Some(registration) = &self.registration {
            registration.mark_ready();
        }
        Ok(Event::Detached)
    }

    /// Sees to it that the next client may open the port, although the last
    /// one may have been killed with `TIOCEXCL` set.
    ///
    /// Root clears the flag. Anybody else cannot, and gets a new pair, to
    /// which the link is turned atomically; the locked one had no client to
    /// lose.
    fn unlock(&mut self) -> Result<(), PortErrorKind> {
        if let Some(registration) = &mut self.registration {
            registration.ignore_readers(self.pair.slave())?;
        }
        let access = self.pair.clear_exclusive()?;
        if let Some(registration) = &mut self.registration {
            registration.heed_readers(self.pair.slave())?;
        }
        // A client that locks the port while it is there is in its right.
        if access == Access::Locked && !self.has_client()? {
            self.recreate()?;
        }
        Ok(())
    }

    fn recreate(&mut self) -> Result<(), PortErrorKind> {
        let pair = Pair::open(self.baud)?;
        if let Some(registration) = &mut self.registration {
            registration.watch(pair.slave())?;
        }
        if let Some(link) = &mut self.link {
            link.turn_to(pair.slave())?;
        }
        self.pair = pair;
        Ok(())
    }

    fn has_client(&self) -> Result<bool, PortErrorKind> {
        self.pair.has_client().map_err(PortErrorKind::call("poll"))
    }

    fn poll_input(&mut self, wanted: bool) -> Result<(), PortErrorKind> {
        self.registration
            .as_mut()
            .map_or(Ok(()), |r| r.poll_input(&self.pair, wanted))
    }

    fn error(&self, action: &'static str, kind: PortErrorKind) -> PortError {
        PortError::new(action, PathBuf::from(self.path()), kind)
    }
}

/// Writes until everything is accepted or the buffer is full.
pub(crate) fn write_some(fd: impl rustix::fd::AsFd, bytes: &[u8]) -> Result<usize, Errno> {
    let mut accepted = 0;
    while accepted < bytes.len() {
        match rustix::io::write(&fd, &bytes[accepted..]) {
            Ok(0) | Err(Errno::AGAIN) => break,
            Ok(n) => accepted += n,
            Err(Errno::INTR) => {}
            Err(errno) => return Err(errno),
        }
    }
    Ok(accepted)
}
