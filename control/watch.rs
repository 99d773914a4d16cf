//! State of connections, as seen from outside of their threads.

use std::io;
use std::net::{Shutdown, TcpListener, TcpStream};
use std::os::fd::AsFd;
use std::sync::atomic::{AtomicBool, AtomicU8, AtomicU64, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};

/// Most connections at a time.
pub(crate) const MOST_CONNECTIONS: usize = 32;
/// Time to wait for the reader of a stream that does not keep up.
const STREAM_PATIENCE: Duration = Duration::from_millis(50);

const BUSY: u8 = 0;
const IDLE: u8 = 1;
const DEFERRED: u8 = 2;
const STREAM: u8 = 3;
const GONE: u8 = 4;

/// A connection.
#[derive(Debug)]
pub(crate) struct Watch {
    socket: TcpStream,
    state: AtomicU8,
    /// Messages of a stream that were queued, and that were written.
    queued: AtomicU64,
    written: AtomicU64,
    /// Messages that had no room, of which its reader does not know yet.
    pub(crate) lost: AtomicU64,
    /// Its reader has not kept up, and is waited for no more until it has.
    is_slow: AtomicBool,
    /// Of this socket.
    quiet: Quiet,
}

/// Silence of a socket, as its own thread finds it: of a client that asks without a pause it is seldom seen
/// from outside.
#[derive(Debug, Default)]
struct Quiet {
    /// Counts the waits for silence that have begun.
    round: Arc<AtomicU64>,
    last_in: AtomicU64,
}

impl Quiet {
    fn look_at(&self, socket: &impl AsFd) {
        // In this order: what is found now was not found in a round that begins later.
        let round = self.round.load(Ordering::SeqCst);
        if is_quiet(socket) {
            self.last_in.store(round, Ordering::SeqCst);
        }
    }

    fn was_there(&self) -> bool {
        self.last_in.load(Ordering::SeqCst) == self.round.load(Ordering::SeqCst)
    }
}

impl Watch {
    pub(crate) fn new(socket: TcpStream, round: Arc<AtomicU64>) -> Arc<Self> {
        Arc::new(Self {
            socket,
            state: AtomicU8::new(IDLE),
            queued: AtomicU64::new(0),
            written: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            is_slow: AtomicBool::new(false),
            quiet: Quiet {
                round,
                ..Quiet::default()
            },
        })
    }

    /// Something is being read, done or written.
    pub(crate) fn is_busy(&self) {
        self.state.store(BUSY, Ordering::SeqCst);
    }

    /// Whatever comes next comes from the client.
    pub(crate) fn is_idle(&self) {
        self.state.store(IDLE, Ordering::SeqCst);
        self.quiet.look_at(&self.socket);
    }

    /// Whatever comes next comes from the simulation, when it has gone on.
    pub(crate) fn is_deferred(&self) {
        self.state.store(DEFERRED, Ordering::SeqCst);
    }

    /// It is a stream from now on.
    pub(crate) fn is_stream(&self) {
        self.state.store(STREAM, Ordering::SeqCst);
    }

    /// A message is on its way.
    pub(crate) fn queued(&self) {
        self.queued.fetch_add(1, Ordering::SeqCst);
    }

    /// So many messages are out.
    pub(crate) fn written(&self, count: u64) {
        self.written.fetch_add(count, Ordering::SeqCst);
    }

    /// Returns whether it has waited for its client, or for the simulation to go on, at any time since
    /// the present round began, `waited` ago.
    pub(crate) fn has_been_quiet(&self, waited: Duration) -> bool {
        self.quiet.was_there() || self.is_quiet(waited)
    }

    fn is_quiet(&self, waited: Duration) -> bool {
        match self.state.load(Ordering::SeqCst) {
            IDLE => is_quiet(&self.socket),
            DEFERRED | GONE => true,
            STREAM => {
                let behind =
                    self.queued.load(Ordering::SeqCst) != self.written.load(Ordering::SeqCst);
                let slow =
                    behind && (waited > STREAM_PATIENCE || self.is_slow.load(Ordering::Relaxed));
                self.is_slow.store(slow, Ordering::Relaxed);
                slow || !behind
            }
            _ => false,
        }
    }
}

/// All connections.
#[derive(Debug, Default)]
pub(crate) struct Watches {
    all: Mutex<Vec<Arc<Watch>>>,
    /// One is about to be added.
    accepting: AtomicBool,
    /// Of the socket that they come to.
    quiet: Quiet,
}

impl Watches {
    /// Waits for a further one; without a [`Watch`] there are too many.
    pub(crate) fn accept(
        &self,
        socket: &TcpListener,
    ) -> io::Result<(TcpStream, Option<Arc<Watch>>)> {
        self.accepting.store(false, Ordering::SeqCst);
        self.quiet.look_at(socket);
        wait_readable(socket, None)?;
        self.accepting.store(true, Ordering::SeqCst);
        let (stream, _) = socket.accept()?;
        let mut all = self.lock();
        let watch = (all.len() < MOST_CONNECTIONS)
            .then(|| {
                let round = Arc::clone(&self.quiet.round);
                stream.try_clone().map(|socket| Watch::new(socket, round))
            })
            .transpose()?;
        all.extend(watch.clone());
        Ok((stream, watch))
    }

    /// One has ended.
    pub(crate) fn leave(&self, watch: &Arc<Watch>) {
        watch.state.store(GONE, Ordering::SeqCst);
        self.lock().retain(|other| !Arc::ptr_eq(other, watch));
    }

    /// Takes no more requests from any.
    pub(crate) fn end(&self) {
        for watch in self.lock().iter() {
            // A client that has left needs no end.
            let _ = watch.socket.shutdown(Shutdown::Read);
        }
    }

    /// Returns whether none is left.
    pub(crate) fn are_gone(&self) -> bool {
        self.lock().is_empty()
    }

    /// Begins to wait until all have been quiet.
    pub(crate) fn begin_round(&self) {
        self.quiet.round.fetch_add(1, Ordering::SeqCst);
    }

    /// Those that there are, once all are among them who had come when the round began.
    pub(crate) fn all_who_came(&self, socket: &TcpListener) -> Option<Vec<Arc<Watch>>> {
        // In this order: what is accepted in between is about to be added.
        let none_comes = is_quiet(socket) && !self.accepting.load(Ordering::SeqCst);
        (none_comes || self.quiet.was_there()).then(|| self.lock().clone())
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<Watch>>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Returns whether there is nothing to be read or accepted.
pub(crate) fn is_quiet(socket: &impl AsFd) -> bool {
    matches!(wait_readable(socket, Some(Duration::ZERO)), Ok(false))
}

/// Waits until there is something to be read or accepted; whether that is so.
pub(crate) fn wait_readable(socket: &impl AsFd, most: Option<Duration>) -> io::Result<bool> {
    let most = most.map(Timespec::try_from).transpose();
    let most = most.map_err(io::Error::other)?;
    let mut polls = [PollFd::new(socket, PollFlags::IN)];
    match poll(&mut polls, most.as_ref()) {
        Ok(count) => Ok(count > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}
