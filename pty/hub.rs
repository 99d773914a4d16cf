//! Shared parts of a waiter and its ports: an epoll instance for what happens at a port, an inotify
//! instance for the one thing that epoll does not tell, that a client opens a node.
//!
//! Reports only say where to look. A hung-up master is readable for ever, so that descriptors are
//! watched for changes (edges), and each report has its port looked at until nothing is left there.
//! Who is attached follows from that look alone ([`Pair::is_hung_up`](crate::pair::Pair)). The
//! reports are also counted, for what a look cannot show: that one client has left and another has
//! come in between. The count may be wrong, see [`Departures`].

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

/// Something is there to be read, or has happened.
pub(crate) const IN: epoll::EventFlags = epoll::EventFlags::IN.union(epoll::EventFlags::PRI);
/// Or there is room to write again.
pub(crate) const BOTH: epoll::EventFlags = IN.union(epoll::EventFlags::OUT);

/// Reports taken at once, at most; what is left then is reported again.
const MOST_REPORTS: usize = 1 << 15;

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
    /// Tokens of ports to be looked at.
    ready: Vec<usize>,
}

/// Reports of a node.
#[derive(Debug, Default)]
struct Node {
    token: usize,
    openers: u32,
    /// The count has come to nothing since our last visits.
    departed: bool,
    /// A client has closed it, or has opened it during our last visits.
    left: bool,
    /// Another may have opened it unreported: during our last visits, or together with one that has opened
    /// it since the last one closed it.
    unsure: bool,
    /// Reports of openings and of closings since a visit of our own began.
    opened: u32,
    closed: u32,
}

/// Departures from a node, as far as counting shows. Reports of the same kind that come together are
/// reported as one, so that the count may be wrong either way.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Departures {
    #[default]
    None,
    /// A client has closed it, and others seem to be there still.
    OneOfSeveral,
    /// The last one has closed it, which is reported before the port is hung up. An opening of our own
    /// would hide that of the next now.
    Last,
    /// The last one has closed it, and another may be there, unreported.
    Unclear,
    /// The last one has closed it, and another has opened it since, which is reported before it can write
    /// anything.
    Replaced,
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

    /// Takes the tokens of ports to be looked at.
    pub(crate) fn take_ready(&self, into: &mut Vec<usize>) {
        into.append(&mut self.lock().ready);
    }

    pub(crate) fn has_ready(&self) -> bool {
        !self.lock().ready.is_empty()
    }

    /// Takes note of everything that inotify has to report.
    pub(crate) fn drain(&self) -> Result<(), PortErrorKind> {
        let mut buf = [MaybeUninit::<u8>::uninit(); 4096];
        let mut state = self.lock();
        let mut reader = inotify::Reader::new(&self.inotify, &mut buf);
        for _ in 0..MOST_REPORTS {
            match reader.next() {
                Ok(event) => state.record_event(event.wd(), event.events()),
                Err(Errno::AGAIN) => return Ok(()),
                Err(Errno::INTR) => {}
                Err(errno) => return Err(PortErrorKind::call("read")(errno)),
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
    fn departures(&self) -> Departures {
        match (self.departed, self.openers) {
            (false, _) if self.left => Departures::OneOfSeveral,
            (false, _) => Departures::None,
            (true, 0) if self.unsure => Departures::Unclear,
            (true, 0) => Departures::Last,
            (true, _) => Departures::Replaced,
        }
    }
}

impl State {
    fn record_event(&mut self, wd: i32, events: ReadFlags) {
        if events.contains(ReadFlags::QUEUE_OVERFLOW) {
            // Who came and went is lost: every port is looked at.
            self.ready.extend(self.nodes.values().map(|n| n.token));
            return;
        }
        let Some(node) = self.nodes.get_mut(&wd) else {
            return;
        };
        if events.contains(ReadFlags::OPEN) {
            node.openers += 1;
            node.opened += 1;
            node.unsure |= node.departed;
        }
        if events.intersects(ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE) {
            node.closed += 1;
            node.openers = node.openers.saturating_sub(1);
            node.departed |= node.openers == 0;
            node.left = true;
        }
        self.ready.push(node.token);
    }
}

/// A port's place in a waiter. Dropping it gives the place up.
#[derive(Debug)]
pub struct Registration {
    hub: Arc<Hub>,
    token: usize,
    wd: Option<i32>,
}

impl Registration {
    pub(crate) fn new(hub: Arc<Hub>, token: usize) -> Self {
        Self {
            hub,
            token,
            wd: None,
        }
    }

    /// Makes the waiter report `what` happens at `fd`, and nothing else of it, until that is closed or
    /// [`forget`](Self::forget) is called.
    pub(crate) fn watch(
        &self,
        fd: impl AsFd,
        what: epoll::EventFlags,
    ) -> Result<(), PortErrorKind> {
        // A usize has no more than 64 bits here.
        let data = epoll::EventData::new_u64(self.token as u64);
        let flags = what | epoll::EventFlags::ET;
        let mut watched = epoll::add(&self.hub.epoll, &fd, data, flags);
        if watched == Err(Errno::EXIST) {
            watched = epoll::modify(&self.hub.epoll, &fd, data, flags);
        }
        watched.map_err(PortErrorKind::call("epoll_ctl"))
    }

    pub(crate) fn forget(&self, fd: impl AsFd) {
        // It may be gone already.
        let _ = epoll::delete(&self.hub.epoll, fd);
    }

    /// Makes the waiter report who opens and closes `node`, and no other from now on.
    pub(crate) fn watch_node(&mut self, node: &Path) -> Result<(), PortErrorKind> {
        self.unwatch_node();
        let flags = WatchFlags::OPEN | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE;
        // No thread may take note of a report before its node is known.
        let mut state = self.hub.lock();
        let wd =
            inotify::add_watch(&self.hub.inotify, node, flags).map_err(|errno| match errno {
                Errno::NOSPC => PortErrorKind::WatchLimit,
                errno => PortErrorKind::call("inotify_add_watch")(errno),
            })?;
        let node = Node {
            token: self.token,
            ..Node::default()
        };
        state.nodes.insert(wd, node);
        self.wd = Some(wd);
        Ok(())
    }

    /// Makes the waiter report the port once, whatever the system says.
    pub(crate) fn mark_ready(&self) {
        self.hub.lock().ready.push(self.token);
    }

    /// The port has been looked at: is it to be looked at again, or is nothing left there? Departures are
    /// yet to be dealt with.
    pub(crate) fn mark_polled(&self, idle: bool) {
        let pending = self.departures() != Departures::None;
        let mut state = self.hub.lock();
        if idle && !pending {
            state.ready.retain(|token| *token != self.token);
        } else {
            state.ready.push(self.token);
        }
    }

    /// Takes note of everything that inotify has to report by now.
    pub(crate) fn drain(&self) -> Result<(), PortErrorKind> {
        self.hub.drain()
    }

    /// Departures since our last visits, as far as counting shows.
    pub(crate) fn departures(&self) -> Departures {
        self.with_node(|node| node.departures())
    }

    /// The last one has not left after all: a client is there whose opening was reported together with
    /// another's.
    pub(crate) fn correct_last(&self) {
        self.with_node(|node| (node.openers, node.departed, node.left) = (1, false, true));
    }

    /// We ourselves are about to open and close the node. Returns whether a client has departed.
    pub(crate) fn begin_visits(
        &self,
        is_hung_up: impl FnOnce() -> Result<bool, PortErrorKind>,
    ) -> Result<bool, PortErrorKind> {
        self.drain()?;
        // A client that comes from here on is yet to be reported.
        let hung_up = is_hung_up()?;
        Ok(self.with_node(|node| {
            (node.opened, node.closed) = (0, 0);
            if hung_up {
                node.openers = 0;
            }
            node.departed
        }))
    }

    /// We have done so `visits` times; others may have come or left meanwhile. Who had `departed` before
    /// is not done with. A client that is there may not be reported yet, so that the count is
    /// corrected where no client is, and never upwards.
    pub(crate) fn end_visits(
        &self,
        visits: u32,
        hung_up: bool,
        departed: bool,
    ) -> Result<(), PortErrorKind> {
        self.drain()?;
        self.with_node(|node| {
            node.departed = node.closed != visits || departed;
            node.unsure = node.departed;
            node.left = node.opened != visits;
            if hung_up {
                node.openers = 0;
            }
        });
        Ok(())
    }

    /// A client had the node open before it was watched.
    pub(crate) fn add_opener(&self) {
        self.with_node(|node| node.openers = node.openers.max(1));
    }

    fn with_node<T: Default>(&self, act: impl FnOnce(&mut Node) -> T) -> T {
        let mut state = self.hub.lock();
        let node = self.wd.and_then(|wd| state.nodes.get_mut(&wd));
        node.map(act).unwrap_or_default()
    }

    fn unwatch_node(&mut self) {
        if let Some(wd) = self.wd.take() {
            self.hub.lock().nodes.remove(&wd);
            // The watch is already gone if the node is.
            let _ = inotify::remove_watch(&self.hub.inotify, wd);
        }
    }
}

impl Drop for Registration {
    fn drop(&mut self) {
        self.unwatch_node();
        // Epoll forgets a descriptor when its port closes it.
        let token = self.token;
        self.hub.lock().ready.retain(|ready| *ready != token);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Who seems to have left after reports of openings, `o`, and closings, `c`.
    #[test]
    fn departures_follow_from_the_reports() {
        for (reports, expected) in [
            ("", Departures::None),
            ("oo", Departures::None),
            ("ooc", Departures::OneOfSeveral),
            // Two that opened together may be reported as one.
            ("oc", Departures::Last),
            ("oco", Departures::Replaced),
            // The second opening may be that of two as well.
            ("ococ", Departures::Unclear),
            ("oocc", Departures::Last),
        ] {
            let mut state = State::default();
            state.nodes.insert(1, Node::default());
            for report in reports.chars() {
                let events = match report {
                    'o' => ReadFlags::OPEN,
                    _ => ReadFlags::CLOSE_WRITE,
                };
                state.record_event(1, events);
            }
            assert_eq!(state.nodes[&1].departures(), expected, "{reports}");
        }
    }
}
