//! What a waiter and its ports share: an epoll instance for the bytes, an
//! inotify instance for clients that come and go.
//!
//! A hung-up master is readable for ever as far as epoll is concerned, so a
//! port is in the epoll set only while a client is attached; the rest of the
//! time inotify reports who opens its node. The same reports show what the
//! master alone cannot: that one client has left and another has come in
//! between two looks, and, since writing is reported in its order too, whether
//! the first had left anything unread.

use std::collections::BTreeMap;
use std::mem::MaybeUninit;
use std::path::Path;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use rustix::event::epoll;
use rustix::fd::{AsFd, OwnedFd};
use rustix::fs::inotify::{self, ReadFlags, WatchFlags};
use rustix::io::Errno;

use crate::error::PortErrorKind;

/// Epoll's name for the inotify instance.
pub(crate) const INOTIFY: u64 = u64::MAX;
/// Epoll's name for the signal pipe.
pub(crate) const SIGNALS: u64 = u64::MAX - 1;

/// Reads of the inotify queue per call. One read takes about 250 reports, so
/// this is more than the queue holds and only bounds the loop.
const MAX_READS: usize = 128;

/// A read that takes fewer reports than this had room left, and left none.
/// Reports on a watched file itself name no other and take 16 bytes each.
const FULL_READ: usize = 128;

/// The shared half of a waiter.
#[derive(Debug)]
pub(crate) struct Hub {
    epoll: OwnedFd,
    inotify: OwnedFd,
    state: Mutex<State>,
}

#[derive(Debug, Default)]
struct State {
    nodes: BTreeMap<i32, Node>,
    /// Tokens with news that no descriptor stands for.
    ready: Vec<usize>,
    /// Watches of nodes with new reports of writing, each once.
    written: Vec<i32>,
}

/// What is known about who has a watched node open.
#[derive(Debug)]
struct Node {
    token: usize,
    openers: u32,
    closed: bool,
    /// Reports of writing so far, and how many of them are about bytes that
    /// the port has read for certain.
    writes: u64,
    read_writes: u64,
    departed: Option<Departure>,
    /// Somebody came after that one, and has left as well.
    departed_next: Option<Departure>,
    /// Among those with new reports of writing.
    written: bool,
    paused: bool,
    /// The next opening is our own.
    visiting: bool,
}

/// The last one who had a node open has closed it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Departure {
    /// Whether it may have left bytes that the port had not read by then.
    pub(crate) unread: bool,
}

impl Hub {
    pub(crate) fn new() -> Result<Arc<Self>, PortErrorKind> {
        let epoll = epoll::create(epoll::CreateFlags::CLOEXEC)
            .map_err(PortErrorKind::call("epoll_create1"))?;
        let inotify = inotify::init(inotify::CreateFlags::CLOEXEC | inotify::CreateFlags::NONBLOCK)
            .map_err(|errno| match errno {
                // The user's limit on watches, unless no descriptor of any kind is to be had.
                Errno::MFILE if rustix::io::fcntl_dupfd_cloexec(&epoll, 0).is_ok() => {
                    PortErrorKind::WatchLimit
                }
                errno => PortErrorKind::call("inotify_init1")(errno),
            })?;
        let data = epoll::EventData::new_u64(INOTIFY);
        epoll::add(&epoll, &inotify, data, epoll::EventFlags::IN)
            .map_err(PortErrorKind::call("epoll_ctl"))?;
        Ok(Arc::new(Self {
            epoll,
            inotify,
            state: Mutex::default(),
        }))
    }

    pub(crate) fn epoll(&self) -> &OwnedFd {
        &self.epoll
    }

    /// Takes the tokens that have news without a readable descriptor.
    pub(crate) fn take_ready(&self, into: &mut Vec<usize>) {
        into.append(&mut self.lock().ready);
    }

    /// Makes news of those reports of writing of which not all bytes have been read yet.
    ///
    /// Bytes take a while from where they are written to where they are read. Whoever looks all the
    /// time waits for the bytes; whoever is about to sleep has to read them now, or would not know
    /// later that there are none.
    pub(crate) fn heed_writing(&self) {
        self.lock().take_written();
    }

    pub(crate) fn has_ready(&self) -> bool {
        !self.lock().ready.is_empty()
    }

    /// Takes note of everything that inotify has to report.
    pub(crate) fn drain(&self) -> Result<(), Errno> {
        let mut buf = [MaybeUninit::<u8>::uninit(); 4096];
        let mut state = self.lock();
        let mut reader = inotify::Reader::new(&self.inotify, &mut buf);
        for _ in 0..MAX_READS {
            // The reader calls the system once its buffer is used up.
            let mut reports = 0;
            loop {
                match reader.next() {
                    Ok(event) => state.note(event.wd(), event.events()),
                    Err(Errno::AGAIN) => return Ok(()),
                    Err(Errno::INTR) => {}
                    Err(errno) => return Err(errno),
                }
                reports += 1;
                if reader.is_buffer_empty() {
                    break;
                }
            }
            // So few are all that there were.
            if reports < FULL_READ {
                return Ok(());
            }
        }
        Ok(())
    }

    fn lock(&self) -> MutexGuard<'_, State> {
        // Each change to the state is whole in itself, so that a panic
        // elsewhere leaves nothing half done.
        self.state.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Node {
    /// Of those who come and leave between two looks, the bytes of the first
    /// are told apart only if there are none of it.
    fn depart(&mut self, unread: bool) {
        let place = match self.departed {
            Some(Departure { unread: false }) => &mut self.departed_next,
            _ => &mut self.departed,
        };
        let before = place.is_some_and(|departed| departed.unread);
        *place = Some(Departure {
            unread: before || unread,
        });
    }
}

impl State {
    fn note(&mut self, wd: i32, events: ReadFlags) {
        if events.contains(ReadFlags::QUEUE_OVERFLOW) {
            // Who came and went is lost: every port has a look for itself.
            for node in self.nodes.values_mut() {
                node.closed = true;
                node.writes += 1;
                self.ready.push(node.token);
            }
            return;
        }
        let Some(node) = self.nodes.get_mut(&wd) else {
            return;
        };
        if events.contains(ReadFlags::OPEN) {
            // Which of two is our own makes no difference to their number.
            if !std::mem::take(&mut node.visiting) {
                node.openers += 1;
            }
        }
        if events.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
            node.closed = true;
            node.openers = node.openers.saturating_sub(1);
            if node.openers == 0 {
                let unread = node.writes > node.read_writes;
                node.read_writes = node.writes;
                node.depart(unread);
            }
        }
        if events.contains(ReadFlags::MODIFY) {
            node.writes += 1;
            if !std::mem::replace(&mut node.written, true) {
                self.written.push(wd);
            }
        }
        if events != ReadFlags::MODIFY {
            self.ready.push(node.token);
        }
    }

    fn take_written(&mut self) {
        for wd in self.written.drain(..) {
            let Some(node) = self.nodes.get_mut(&wd) else {
                continue;
            };
            node.written = false;
            // Bytes are no news from a port whose caller has no room.
            if node.writes > node.read_writes && !node.paused {
                self.ready.push(node.token);
            }
        }
    }
}

/// A port's place in a waiter. Dropping it gives the place up.
#[derive(Debug)]
pub(crate) struct Registration {
    hub: Arc<Hub>,
    token: usize,
    wd: Option<i32>,
    wanted: bool,
    paused: bool,
    polling: bool,
}

impl Registration {
    pub(crate) fn new(hub: Arc<Hub>, token: usize) -> Self {
        Self {
            hub,
            token,
            wd: None,
            wanted: false,
            paused: false,
            polling: false,
        }
    }

    /// Has the waiter report the port once, whatever its descriptors say, or
    /// when it is no longer paused.
    pub(crate) fn mark_ready(&self) {
        if !self.paused {
            self.hub.lock().ready.push(self.token);
        }
    }

    /// Everything that there is to report has been.
    pub(crate) fn unmark_ready(&self) {
        self.hub.lock().ready.retain(|token| *token != self.token);
    }

    /// Takes note of everything that inotify has to report by now.
    pub(crate) fn look(&self) -> Result<(), PortErrorKind> {
        self.hub.drain().map_err(PortErrorKind::call("read"))
    }

    /// Starts or stops reporting that `fd` is readable. A descriptor that is
    /// about to be closed must be taken out first.
    pub(crate) fn poll_input(&mut self, fd: impl AsFd, wanted: bool) -> Result<(), PortErrorKind> {
        self.wanted = wanted;
        self.update(fd)
    }

    /// While paused, `fd` is not reported although it may be readable.
    pub(crate) fn set_paused(&mut self, fd: impl AsFd, paused: bool) -> Result<(), PortErrorKind> {
        if paused == self.paused {
            return Ok(());
        }
        self.paused = paused;
        self.with_node(|node| node.paused = paused);
        self.mark_ready();
        self.update(fd)
    }

    fn update(&mut self, fd: impl AsFd) -> Result<(), PortErrorKind> {
        let wanted = self.wanted && !self.paused;
        if wanted == self.polling {
            return Ok(());
        }
        if wanted {
            let data = epoll::EventData::new_u64(self.token as u64);
            epoll::add(&self.hub.epoll, fd, data, epoll::EventFlags::IN)
        } else {
            epoll::delete(&self.hub.epoll, fd)
        }
        .map_err(PortErrorKind::call("epoll_ctl"))?;
        self.polling = wanted;
        Ok(())
    }

    /// Starts watching who opens and closes `node`.
    pub(crate) fn watch(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.unwatch();
        let wd = self.add_watch(node, Self::everybody())?;
        let node = Node {
            token: self.token,
            openers: 0,
            closed: false,
            writes: 0,
            read_writes: 0,
            departed: None,
            departed_next: None,
            written: false,
            paused: self.paused,
            visiting: false,
        };
        self.hub.lock().nodes.insert(wd, node);
        self.wd = Some(wd);
        Ok(())
    }

    /// Stops reporting those who only read `node`, as we ourselves are about
    /// to, and forgets every visit so far.
    pub(crate) fn ignore_readers(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.add_watch(node, WatchFlags::CLOSE_WRITE)?;
        self.look()?;
        self.take_closed();
        self.take_departure();
        self.take_departure();
        Ok(())
    }

    /// We ourselves are about to open `node`, to read, for a moment, while
    /// others may have it open. No visit of theirs is forgotten.
    pub(crate) fn begin_visit(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.add_watch(node, Self::everybody() - WatchFlags::CLOSE_NOWRITE)?;
        self.look()?;
        self.with_node(|node| node.visiting = true);
        Ok(())
    }

    /// Our own visit is over, and counts for none. One who only reads and
    /// leaves in its course is missed, until the node is hung up.
    pub(crate) fn end_visit(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.look()?;
        self.with_node(|node| node.visiting = false);
        self.heed_readers(node)
    }

    /// Reports everybody again.
    pub(crate) fn heed_readers(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.add_watch(node, Self::everybody()).map(drop)
    }

    /// Corrects the number of those who have the node open. They may have
    /// written unnoticed.
    pub(crate) fn set_openers(&self, openers: u32) {
        self.with_node(|node| {
            node.openers = openers;
            node.writes += u64::from(openers);
        });
    }

    /// Whether somebody is reported to have the node open.
    pub(crate) fn has_openers(&self) -> bool {
        self.with_node(|node| node.openers > 0)
    }

    /// Whether somebody closed the node since the last call.
    pub(crate) fn take_closed(&self) -> bool {
        self.with_node(|node| std::mem::take(&mut node.closed))
    }

    /// Whether the node was closed by the last one who had it open, since the
    /// last call.
    pub(crate) fn take_departure(&self) -> Option<Departure> {
        self.with_node(|node| std::mem::replace(&mut node.departed, node.departed_next.take()))
    }

    /// How much writing has been reported; for [`Self::all_read`].
    pub(crate) fn writes(&self) -> u64 {
        self.with_node(|node| node.writes)
    }

    /// Nothing was left to read after so much writing had been reported.
    pub(crate) fn all_read(&self, writes: u64) {
        self.with_node(|node| node.read_writes = node.read_writes.max(writes));
    }

    fn with_node<T: Default>(&self, act: impl FnOnce(&mut Node) -> T) -> T {
        let mut state = self.hub.lock();
        let node = self.wd.and_then(|wd| state.nodes.get_mut(&wd));
        node.map(act).unwrap_or_default()
    }

    fn everybody() -> WatchFlags {
        WatchFlags::OPEN | WatchFlags::MODIFY | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE
    }

    fn add_watch(&self, node: &Path, flags: WatchFlags) -> Result<i32, PortErrorKind> {
        inotify::add_watch(&self.hub.inotify, node, flags).map_err(|errno| match errno {
            Errno::NOSPC => PortErrorKind::WatchLimit,
            errno => PortErrorKind::call("inotify_add_watch")(errno),
        })
    }

    fn unwatch(&mut self) {
        if let Some(wd) = self.wd.take() {
            self.hub.lock().nodes.remove(&wd);
            // The watch is already gone if the node is.
            let _ = inotify::remove_watch(&self.hub.inotify, wd);
        }
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        self.unwatch();
        // Epoll forgets a descriptor when its port closes it.
        self.hub.lock().ready.retain(|token| *token != self.token);
    }
}
