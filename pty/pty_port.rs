//! A pseudo-terminal that clients open like a serial port.
//!
//! The client's end is never held open by us for longer than a moment: that would hide the hang-up.
//! So what a client does is seen through the master alone, and who is there follows from whether
//! that is hung up.

use rigsim_settings::ClientLine;
use std::collections::VecDeque;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use rustix::io::Errno;

use crate::error::{PortError, PortErrorKind};
use crate::hub::{BOTH, Departures, IN, Registration};
use crate::line::from_termios;
use crate::pair::{Pair, PtySetup, Read};
use crate::paths::Link;
use crate::port::{Counters, Event, Port};

/// Reads that a single look takes, of which all but the last are words of what has happened.
const MOST_READS: usize = 8;
/// Most bytes kept for a client that does not read, beside some 20 kB in the kernel: as many as Linux keeps
/// of what a serial port has received.
const MOST_UNSENT: usize = 1 << 16;
/// Longest time from the report that the last client has closed the port until it is hung up. If
/// that takes longer, a client is still there.
const CLOSING: Duration = Duration::from_millis(20);

/// A pseudo-terminal, with or without a link to it at a path of the user's
/// choice.
#[derive(Debug)]
pub(crate) struct PtyPort {
    // Dropped first: the link goes before what it points to.
    link: Option<Link>,
    registration: Option<Registration>,
    pair: Pair,
    client: Client,
    /// Since when the last client seems to be closing the port.
    closing: Option<Instant>,
    /// Bytes that were read before that was known, to be handed out after it.
    held: Vec<u8>,
    /// Number of the bytes that wait to be read that were there at the last look: of a client that
    /// has left since, or takes back what it has written, these are to be thrown away, and no
    /// others.
    seen: usize,
    /// Bytes for which the kernel had no room.
    unsent: VecDeque<u8>,
    /// Set if the waiter is to report that there is room again.
    watches_room: bool,
    counters: Counters,
}

/// State of the port's clients, and what is to be reported of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Client {
    None,
    /// It is known that it is there.
    Attached,
    /// Another has come in its place without the port having been hung up at any look: that it has left is
    /// to be reported.
    Replaced,
    /// That the other is there is to be reported.
    New,
}

impl PtyPort {
    pub(crate) fn open_at(path: &Path, setup: PtySetup) -> Result<Self, PortError> {
        let open = || {
            let pair = Pair::open(setup)?;
            let link = Link::publish(path, pair.slave())?;
            Ok(Self::new(pair, Some(link)))
        };
        open().map_err(|kind| PortError::new("serve", path, kind))
    }

    pub(crate) fn open_unlinked(setup: PtySetup) -> Result<Self, PortError> {
        let pair = Pair::open(setup).map_err(|kind| PortError::new("open", "/dev/ptmx", kind))?;
        Ok(Self::new(pair, None))
    }

    fn new(pair: Pair, link: Option<Link>) -> Self {
        Self {
            link,
            registration: None,
            pair,
            client: Client::None,
            closing: None,
            held: Vec::new(),
            seen: 0,
            unsent: VecDeque::new(),
            watches_room: false,
            counters: Counters::default(),
        }
    }
}

impl Port for PtyPort {
    fn path(&self) -> &Path {
        self.link.as_ref().map_or(self.pair.slave(), Link::path)
    }

    fn is_attached(&self) -> bool {
        self.client != Client::None
    }

    fn counters(&self) -> Counters {
        self.counters
    }

    fn room(&self) -> usize {
        MOST_UNSENT.saturating_sub(self.unsent.len())
    }

    fn client_line(&self) -> Result<Option<ClientLine>, PortError> {
        let settings = self.pair.settings();
        let settings = settings.map_err(|kind| self.error("read the settings of", kind))?;
        Ok(Some(from_termios(&settings)))
    }

    fn read(&mut self, buf: &mut [u8]) -> Result<Event, PortError> {
        let event = self
            .next_event(buf)
            .and_then(|event| self.send_unsent().map(|()| event))
            .map_err(|kind| self.error("read from", kind))?;
        self.watch_room()?;
        if let Some(registration) = &self.registration {
            registration.mark_polled(event == Some(Event::Idle));
        }
        Ok(event.unwrap_or(Event::Idle))
    }

    /// Sends, or keeps for a client that does not read.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, PortError> {
        if !self.is_attached() {
            self.counters.dropped_detached_bytes += bytes.len() as u64;
            return Ok(0);
        }
        // What this answers may be from a client that came in another's place. What waits there is
        // the other's, and has to be taken back before.
        self.notice_handover()
            .map_err(|kind| self.error("write to", kind))?;
        let mut sent = 0;
        if self.unsent.is_empty() && !self.is_unclear() {
            sent = write_some(&self.pair, bytes)
                .map_err(|errno| self.error("write to", PortErrorKind::call("write")(errno)))?;
        }
        self.unsent.extend(&bytes[sent..]);
        // The last are an answer to a client that is there, the first perhaps to one that has left.
        let dropped = self.unsent.len().saturating_sub(MOST_UNSENT);
        self.unsent.drain(..dropped);
        self.watch_room()?;
        let accepted = bytes.len() - dropped;
        self.counters.sent(accepted, bytes);
        Ok(accepted)
    }

    fn register(&mut self, mut registration: Registration) -> Result<(), PortError> {
        let register = || {
            if let Some(old) = self.registration.take() {
                old.forget(&self.pair);
            }
            watch(&mut registration, &self.pair)?;
            self.watches_room = false;
            self.registration = Some(registration);
            Ok(())
        };
        register().map_err(|kind| self.error("watch", kind))
    }
}

impl PtyPort {
    /// `None` if the port has to be looked at again to know.
    fn next_event(&mut self, buf: &mut [u8]) -> Result<Option<Event>, PortErrorKind> {
        if matches!(self.client, Client::None | Client::New) {
            return self.arrival().map(Some);
        }
        // In this order: what is counted was there before any departure that is not noted yet.
        let unread = if buf.is_empty() {
            let unread = self.pair.unread()?;
            self.drain()?;
            unread
        } else {
            None
        };
        self.notice_handover()?;
        if self.client == Client::Replaced {
            return Ok(Some(self.hand_over()));
        }
        if self.is_unclear() {
            // What there is to read may be the next one's.
            return Ok(None);
        }
        if buf.is_empty() {
            // What is left of a client that is gone will not be sent.
            if self.pair.is_hung_up()? {
                return self.vacate().map(Some);
            }
            self.seen = unread.unwrap_or(self.seen);
            return Ok(Some(Event::Idle));
        }
        if !self.held.is_empty() {
            let count = self.held.len().min(buf.len());
            buf[..count].copy_from_slice(&self.held[..count]);
            self.held.drain(..count);
            return Ok(Some(Event::Data(count)));
        }
        for _ in 0..MOST_READS {
            match self.pair.read(buf)? {
                Read::Bytes(n) => {
                    let old = self.seen.min(n);
                    self.seen -= old;
                    self.counters.received(n);
                    // The client that wrote these has been reported by now. If it came in
                    // another's place, this is reported first, so that what is answered is not lost with
                    // what was on its way to the other. What was there before is the other's.
                    self.drain()?;
                    self.notice_handover()?;
                    if self.client == Client::Replaced {
                        self.held.extend_from_slice(&buf[old..n]);
                        return Ok(Some(self.hand_over()));
                    }
                    return Ok(Some(Event::Data(n)));
                }
                Read::Flushed { input, output } => {
                    if output {
                        self.discard_seen()?;
                    }
                    if input && !self.unsent.is_empty() {
                        // What waits behind the last 4095 bytes has outlived the flush.
                        self.unsent.clear();
                        self.visit(true, Pair::restore_for_next)?;
                        if self.is_unclear() {
                            return Ok(None);
                        }
                    }
                }
                Read::Other => {}
                Read::Nothing => {
                    self.seen = 0;
                    return Ok(Some(Event::Idle));
                }
                Read::HungUp => return self.vacate().map(Some),
            }
        }
        Ok(None)
    }

    /// Reports a client that has come.
    fn arrival(&mut self) -> Result<Event, PortErrorKind> {
        // A client that came and left without a byte is reported too: it may
        // have left settings or a lock behind.
        let none_left = self.departures() == Departures::None;
        if self.client == Client::None && none_left && !self.pair.has_client()? {
            return Ok(Event::Idle);
        }
        self.client = Client::Attached;
        self.counters.attached += 1;
        Ok(Event::Attached)
    }

    /// Takes note of clients having left, and others having come, between two looks.
    fn notice_handover(&mut self) -> Result<(), PortErrorKind> {
        let departures = self.departures();
        // A port that is hung up is found so when it is read.
        if departures == Departures::None || self.pair.is_hung_up()? {
            self.closing = None;
            return Ok(());
        }
        if let Departures::Last | Departures::Unclear = departures {
            let since = *self.closing.get_or_insert_with(Instant::now);
            if since.elapsed() < CLOSING {
                return Ok(());
            }
        }
        self.closing = None;
        match departures {
            Departures::None => {}
            Departures::OneOfSeveral => self.visit(true, Pair::resume)?,
            Departures::Last => {
                self.registration
                    .iter()
                    .for_each(Registration::correct_last);
                self.visit(true, Pair::resume)?;
            }
            Departures::Unclear | Departures::Replaced => {
                self.discard_seen()?;
                self.unsent.clear();
                self.visit(false, Pair::restore_for_next)?;
                // That a third has taken the place of one that was not reported is not reported.
                if self.client == Client::Attached {
                    self.client = Client::Replaced;
                }
            }
        }
        Ok(())
    }

    /// Whether it is yet to be seen who is there, so that nothing is to be read or sent.
    fn is_unclear(&self) -> bool {
        self.closing.is_some() && self.departures() == Departures::Unclear
    }

    /// Reports that the one has left; that the other is there is reported next.
    fn hand_over(&mut self) -> Event {
        self.client = Client::New;
        Event::Detached
    }

    /// Sends of what was kept as much as there is room for.
    fn send_unsent(&mut self) -> Result<(), PortErrorKind> {
        // It may have happened that the client does not want it any more.
        if self.unsent.is_empty() || self.is_unclear() || self.pair.has_happened()? {
            return Ok(());
        }
        let kept = self.unsent.make_contiguous();
        let sent = write_some(&self.pair, kept).map_err(PortErrorKind::call("write"))?;
        self.unsent.drain(..sent);
        Ok(())
    }

    /// Makes the waiter report room where something waits for it.
    fn watch_room(&mut self) -> Result<(), PortError> {
        let wanted = !self.unsent.is_empty();
        if let Some(registration) = &self.registration
            && wanted != self.watches_room
        {
            let what = if wanted { BOTH } else { IN };
            registration
                .watch(&self.pair, what)
                .map_err(|kind| self.error("watch", kind))?;
            self.watches_room = wanted;
        }
        Ok(())
    }

    fn discard_seen(&mut self) -> Result<(), PortErrorKind> {
        self.pair.discard(std::mem::take(&mut self.seen))
    }

    /// Makes the port as it was before any client came.
    fn vacate(&mut self) -> Result<Event, PortErrorKind> {
        self.closing = None;
        self.pair.discard_left_behind()?;
        self.held.clear();
        self.unsent.clear();
        self.seen = 0;
        let mut restored = false;
        self.visit(false, |pair| {
            let visits;
            (restored, visits) = pair.restore()?;
            Ok(visits)
        })?;
        if !restored {
            self.recreate()?;
        }
        self.client = Client::None;
        Ok(Event::Detached)
    }

    /// What the next client cannot use, for this process may not undo what was done to it, is
    /// replaced by another, to which the link is turned atomically.
    fn recreate(&mut self) -> Result<(), PortErrorKind> {
        let pair = Pair::open(self.pair.setup)?;
        self.watches_room = false;
        // Before a client can open it, so that none comes and leaves unseen.
        if let Some(registration) = &mut self.registration {
            watch(registration, &pair)?;
        }
        if let Some(link) = &mut self.link {
            link.turn_to(pair.slave())?;
            if !self.pair.is_hung_up()? {
                // A client could open the old one after all, and is served.
                link.turn_to(self.pair.slave())?;
                let registration = self.registration.as_mut();
                return registration.map_or(Ok(()), |registration| watch(registration, &self.pair));
            }
        }
        self.pair = pair;
        Ok(())
    }

    fn drain(&self) -> Result<(), PortErrorKind> {
        self.registration
            .as_ref()
            .map_or(Ok(()), Registration::drain)
    }

    fn departures(&self) -> Departures {
        let registration = self.registration.as_ref();
        registration.map_or(Departures::None, Registration::departures)
    }

    /// Opens the node here, as often as `open` says, which is counted; `keeps` says that
    /// the client that has departed is yet to be reported. While that is being found out, it is not opened.
    fn visit(
        &mut self,
        keeps: bool,
        open: impl FnOnce(&Pair) -> Result<u32, PortErrorKind>,
    ) -> Result<(), PortErrorKind> {
        let mut departed = false;
        if let Some(registration) = &self.registration {
            departed = registration.begin_visits(|| self.pair.is_hung_up())?;
            let is_open = matches!(self.departures(), Departures::Last | Departures::Unclear);
            if keeps && is_open {
                return Ok(());
            }
        }
        let visits = open(&self.pair)?;
        // A visit flushes, which the client did not ask for. What it takes back itself meanwhile is.
        if let Read::Flushed { output: true, .. } = self.pair.forget_happened()? {
            self.discard_seen()?;
        }
        let hung_up = self.pair.is_hung_up()?;
        if let Some(registration) = &self.registration {
            registration.end_visits(visits, hung_up, departed && keeps)?;
        }
        if self.departures() == Departures::Unclear {
            self.closing.get_or_insert_with(Instant::now);
        }
        Ok(())
    }

    fn error(&self, action: &'static str, kind: PortErrorKind) -> PortError {
        PortError::new(action, PathBuf::from(self.path()), kind)
    }
}

/// Makes the waiter report who comes, and what a client that is there does.
fn watch(registration: &mut Registration, pair: &Pair) -> Result<(), PortErrorKind> {
    registration.watch_node(pair.slave())?;
    registration.watch(pair, IN)?;
    if !pair.is_hung_up()? {
        registration.add_opener();
    }
    Ok(())
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
