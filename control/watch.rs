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

/// A connection.
#[derive(Debug)]
pub(crate) struct Watch {
    socket: TcpStream,
    state: AtomicU8,
    /// Messages of a stream that were told, and that were written.
    told: AtomicU64,
    written: AtomicU64,
    /// Its reader has not kept up, and is waited for no more until it has.
    is_slow: AtomicBool,
}

impl Watch {
    pub(crate) fn new(socket: TcpStream) -> Arc<Self> {
        Arc::new(Self {
            socket,
            state: AtomicU8::new(IDLE),
            told: AtomicU64::new(0),
            written: AtomicU64::new(0),
            is_slow: AtomicBool::new(false),
        })
    }

    /// Something is being read, done or written.
    pub(crate) fn is_busy(&self) {
        self.state.store(BUSY, Ordering::SeqCst);
    }

    /// Whatever comes next comes from the client.
    pub(crate) fn is_idle(&self) {
        self.state.store(IDLE, Ordering::SeqCst);
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
    pub(crate) fn told(&self) {
        self.told.fetch_add(1, Ordering::SeqCst);
    }

    /// So many messages are out.
    pub(crate) fn written(&self, count: u64) {
        self.written.fetch_add(count, Ordering::SeqCst);
    }

    fn is_quiet(&self, waited: Duration) -> bool {
        match self.state.load(Ordering::SeqCst) {
            IDLE => is_quiet(&self.socket),
            DEFERRED => true,
            STREAM => {
                let behind =
                    self.told.load(Ordering::SeqCst) != self.written.load(Ordering::SeqCst);
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
}

impl Watches {
    /// Waits for a further one; without a [`Watch`] there are too many.
    pub(crate) fn accept(
        &self,
        socket: &TcpListener,
    ) -> io::Result<(TcpStream, Option<Arc<Watch>>)> {
        self.accepting.store(false, Ordering::SeqCst);
        wait_readable(socket, None)?;
        self.accepting.store(true, Ordering::SeqCst);
        let (stream, _) = socket.accept()?;
        let mut all = self.lock();
        let watch = (all.len() < MOST_CONNECTIONS)
            .then(|| stream.try_clone().map(Watch::new))
            .transpose()?;
        all.extend(watch.clone());
        Ok((stream, watch))
    }

    /// One has ended.
    pub(crate) fn leave(&self, watch: &Arc<Watch>) {
        self.lock().retain(|other| !Arc::ptr_eq(other, watch));
    }

    /// Takes no more requests from any.
    pub(crate) fn end(&self) {
        for watch in self.lock().iter() {
            // Who has left needs no end.
            let _ = watch.socket.shutdown(Shutdown::Read);
        }
    }

    /// Tells whether none is left.
    pub(crate) fn are_gone(&self) -> bool {
        self.lock().is_empty()
    }

    /// Tells whether all wait for their clients, or for the simulation to go on, after so long a
    /// wait for that.
    pub(crate) fn are_quiet(&self, waited: Duration) -> bool {
        !self.accepting.load(Ordering::SeqCst)
            && self.lock().iter().all(|watch| watch.is_quiet(waited))
    }

    fn lock(&self) -> MutexGuard<'_, Vec<Arc<Watch>>> {
        self.all.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

/// Tells whether there is nothing to be read or accepted.
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
