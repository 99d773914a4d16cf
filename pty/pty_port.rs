//! A pseudo-terminal that clients open like a serial port.
//!
//! The client's end is never held open by us: that would hide the hang-up,
//! keep replies for the next client, and stop the settings from being put
//! back. Packet mode is not used either: one `tcgetattr` per burst of bytes
//! tells the client's speed without a control byte in front of every read.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::io::{Errno, retry_on_intr};

use crate::error::{PortError, PortErrorKind};
use crate::hub::{Departure, Registration};
use crate::line::LineSettings;
use crate::link::Link;
use crate::pair::{Access, Pair};
use crate::port::{Counters, Event, Written};
use crate::stash::Stash;

/// How long the system may take from reporting that a client closes to hanging up. It is some
/// microseconds, unless the client has to wait for a processor in between.
const LONGEST_CLOSING: Duration = Duration::from_millis(5);
/// From one look at who has come meanwhile to the next.
const SHORT_WAIT: Duration = Duration::from_micros(200);

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
    /// Set from when a client's leaving is noticed until it is reported,
    /// which is after the last of its bytes.
    leaving: Option<Leaving>,
    /// While somebody is leaving, its last bytes if it left any; else the
    /// first ones of the client that is there.
    stash: Stash,
    successor: bool,
    /// The client's settings when it last sent something.
    last_line: Option<LineSettings>,
    /// The same until the port is next read, for a caller who asks for them
    /// right away.
    fresh_line: Option<LineSettings>,
    counters: Counters,
}

/// A client that is gone, though not yet as far as the caller knows.
#[derive(Debug)]
struct Leaving {
    line: LineSettings,
    /// Whether the stash is its own.
    last_words: bool,
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
            leaving: None,
            stash: Stash::default(),
            successor: false,
            last_line: None,
            fresh_line: None,
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
    /// no client has. Until the port is next read they are those with which
    /// what was read last was sent.
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn client_line(&self) -> Result<LineSettings, PortError> {
        if let Some(leaving) = &self.leaving {
            return Ok(leaving.line);
        }
        if let Some(line) = self.fresh_line {
            return Ok(line);
        }
        self.line()
            .map_err(|kind| self.error("read the line settings of", kind))
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

    /// Stops and starts the waiter's calling the port ready; see
    /// [`Port::set_paused`](crate::Port::set_paused).
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn set_paused(&mut self, paused: bool) -> Result<(), PortError> {
        let outcome = self
            .registration
            .as_mut()
            .map_or(Ok(()), |r| r.set_paused(&self.pair, paused));
        outcome.map_err(|kind| self.error("watch", kind))
    }

    /// Sends what fits and drops the rest; see
    /// [`Port::write`](crate::Port::write).
    ///
    /// # Errors
    ///
    /// When the system refuses.
    pub fn write(&mut self, bytes: &[u8]) -> Result<Written, PortError> {
        self.look_before_writing()
            .map_err(|kind| self.error("write to", kind))?;
        if !self.attached || self.leaving.is_some() {
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
        self.fresh_line = None;
        if !self.attached {
            return self.arrival();
        }
        if self.leaving.is_some() {
            return self.last_words(buf);
        }
        if !self.stash.is_empty() || buf.is_empty() {
            if let Some(departure) = self.look()? {
                self.leave(departure)?;
                return self.last_words(buf);
            }
            return Ok(self.stashed(buf));
        }
        // Twice, since writing may be reported while the first read finds nothing.
        for _ in 0..2 {
            let writes = self.writes();
            match retry_on_intr(|| rustix::io::read(&self.pair, &mut *buf)) {
                Ok(n) if n > 0 => {
                    // Whose they are is known only now: a client that left before
                    // they were read has been reported to us by this time.
                    if let Some(departure) = self.look()? {
                        self.stash.push(&buf[..n]);
                        self.leave(departure)?;
                        return self.last_words(buf);
                    }
                    self.fresh_line = Some(self.line()?);
                    self.last_line = self.fresh_line;
                    self.counters.received(n);
                    self.mark_ready();
                    return Ok(Event::Data(n));
                }
                Err(Errno::AGAIN) => {
                    if let Some(registration) = &self.registration {
                        registration.all_read(writes);
                    }
                    // This and no hang-up, if the next one has the node open already.
                    if let Some(departure) = self.look()? {
                        self.leave(departure)?;
                        return self.last_words(buf);
                    }
                    if self.writes() == writes {
                        break;
                    }
                }
                Ok(_) | Err(Errno::IO) => {
                    self.vacate()?;
                    return Ok(self.detach());
                }
                Err(errno) => return Err(PortErrorKind::call("read")(errno)),
            }
        }
        if let Some(registration) = &self.registration {
            registration.unmark_ready();
        }
        Ok(Event::Idle)
    }

    fn writes(&self) -> u64 {
        self.registration.as_ref().map_or(0, Registration::writes)
    }

    /// Reports a client that has come.
    fn arrival(&mut self) -> Result<Event, PortErrorKind> {
        let closed = self.registration.as_ref().map(Registration::take_closed);
        // Somebody who came and left without a byte is reported too: it may
        // have left settings or a lock behind.
        if !self.successor && closed != Some(true) && !self.has_client()? {
            return Ok(Event::Idle);
        }
        self.attached = true;
        self.successor = false;
        self.last_line = None;
        self.counters.attached += 1;
        self.poll_input(true)?;
        if !self.stash.is_empty() {
            self.mark_ready();
        }
        Ok(Event::Attached)
    }

    /// Looks whether the last one who had the node open has closed it, be it
    /// that others have come since or not.
    fn look(&self) -> Result<Option<Departure>, PortErrorKind> {
        let Some(registration) = &self.registration else {
            return Ok(None);
        };
        registration.look()?;
        let departure = registration.take_departure();
        if departure.is_some() {
            registration.take_closed();
        }
        Ok(departure)
    }

    /// What is meant for one client must not go to the next, who may have come by now.
    fn look_before_writing(&mut self) -> Result<(), PortErrorKind> {
        if self.attached
            && self.leaving.is_none()
            && let Some(departure) = self.look()?
        {
            self.leave(departure)?;
            self.mark_ready();
        }
        Ok(())
    }

    /// Takes note that the client has left. What it sent comes out of the
    /// kernel now, before the next client's bytes are added to it.
    fn leave(&mut self, departure: Departure) -> Result<(), PortErrorKind> {
        let hung_up = self.pair.is_hung_up();
        let hung_up = hung_up.map_err(PortErrorKind::call("poll"))?;
        // The settings are the next one's as soon as it is there.
        let line = match self.last_line {
            Some(line) if !hung_up => line,
            _ => self.line()?,
        };
        // What a port echoes is not reported as written.
        let unread = departure.unread || !line.raw;
        if unread {
            self.stash
                .fill_from(&self.pair)
                .map_err(PortErrorKind::call("read"))?;
        }
        self.leaving = Some(Leaving {
            line,
            last_words: unread,
        });
        let foreign = !unread && !self.stash.is_empty();
        if foreign || (self.has_client()? && !self.hangs_up_now()?) {
            self.successor = true;
            self.flush_output()
        } else {
            self.vacate()
        }
    }

    /// Waits for a moment until the system hangs up what it has reported closed, which it does a little
    /// later; says whether it did, and nobody else is there.
    fn hangs_up_now(&self) -> Result<bool, PortErrorKind> {
        let Some(registration) = &self.registration else {
            return Ok(false);
        };
        let begun = Instant::now();
        loop {
            registration.look()?;
            if registration.has_openers() || self.pair.has_bytes().map_err(poll)? {
                return Ok(false);
            }
            if self.pair.is_hung_up().map_err(poll)? {
                return Ok(true);
            }
            if begun.elapsed() > LONGEST_CLOSING {
                // Somebody is there of whom there was no report: two openings in a row are one.
                registration.set_openers(1);
                return Ok(false);
            }
            self.pair.await_hang_up(SHORT_WAIT).map_err(poll)?;
        }
    }

    /// Takes back what was not read, while somebody may have the node open.
    fn flush_output(&mut self) -> Result<(), PortErrorKind> {
        let Some(registration) = &mut self.registration else {
            return self.pair.flush_output();
        };
        registration.begin_visit(self.pair.slave())?;
        let outcome = self.pair.flush_output();
        registration.end_visit(self.pair.slave())?;
        outcome
    }

    /// Reports what is left of a client that has left, and then its leaving.
    fn last_words(&mut self, buf: &mut [u8]) -> Result<Event, PortErrorKind> {
        let last_words = self.leaving.as_ref().is_some_and(|l| l.last_words);
        if last_words && !self.stash.is_empty() {
            return Ok(self.stashed(buf));
        }
        Ok(self.detach())
    }

    fn stashed(&mut self, buf: &mut [u8]) -> Event {
        let n = self.stash.take(buf);
        if n == 0 {
            return Event::Idle;
        }
        self.counters.received(n);
        self.mark_ready();
        Event::Data(n)
    }

    fn detach(&mut self) -> Event {
        self.attached = false;
        self.leaving = None;
        self.mark_ready();
        Event::Detached
    }

    /// Makes the port as it was before any client came.
    fn vacate(&mut self) -> Result<(), PortErrorKind> {
        // First of all, while the next client is least likely to be there.
        self.pair
            .reset()
            .map_err(PortErrorKind::call("tcsetattr"))?;
        self.poll_input(false)?;
        self.unlock()?;
        let has_client = self.has_client()?;
        if let Some(registration) = &self.registration {
            registration.set_openers(u32::from(has_client));
        }
        Ok(())
    }

    fn mark_ready(&self) {
        if let Some(registration) = &self.registration {
            registration.mark_ready();
        }
    }

    fn line(&self) -> Result<LineSettings, PortErrorKind> {
        LineSettings::of(&self.pair).map_err(PortErrorKind::call("tcgetattr"))
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
        if access == Access::Open {
            return Ok(());
        }
        if self.has_client()? {
            self.pair.flush_output()
        } else {
            self.recreate()
        }
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

fn poll(errno: Errno) -> PortErrorKind {
    PortErrorKind::call("poll")(errno)
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
