//! HTTP and JSON for looking at a running simulation and for changing it; and the client of that.
//!
//! This crate knows nothing of devices. A [`Control`] listens on a socket, refuses requests without
//! the token, and passes each [`Request`] through a channel. The program that drives the simulation
//! takes requests between two steps and answers each. So a slow or hostile client costs the
//! simulation no more than its requests, of which there are at most a thousand a second.
//!
//! # Bounds
//!
//! | | |
//! |---|---|
//! | connections at a time | 32; a further one gets 503 and is closed |
//! | request | 16 KiB of head with 64 fields, 64 KiB of body |
//! | time for a request to arrive, once begun | 5 s; a connection may be idle for 60 s |
//! | time for a client to take an answer | 5 s, what a stream tells 15 s; then it is closed |
//! | requests | 1000 a second of all clients together; more of them wait |
//! | requests that wait for the simulation | 64 |
//! | messages of a stream that wait for its reader | 256; further ones are lost, and a message says how many |

pub mod client;
mod connection;
mod guard;
pub mod http;
pub mod json;
mod listener;
mod page;
mod watch;

use std::io::{self, Read as _, Write as _};
use std::net::{Ipv4Addr, SocketAddr, TcpListener, TcpStream};
use std::os::fd::{AsFd, BorrowedFd};
use std::os::unix::net::UnixStream;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, LazyLock};
use std::thread;
use std::time::{Duration, Instant};

use crossbeam_channel::{Receiver, Sender, bounded};
use serde_json::Value;

pub use listener::{Listener, Message, Wants};

use guard::{Guard, Pace};
use watch::{Watch, Watches};

/// Most requests that wait for the simulation.
const MOST_WAITING: usize = 64;
/// Longest wait for connections at the end, which end by themselves: within a second those of clients
/// that do not read.
const PARTING: Duration = Duration::from_secs(10);

/// Request of a client.
#[derive(Debug)]
pub enum Ask {
    /// Do this; with `wait`, answer when it is over.
    Add {
        /// A step in the form of a scenario file's.
        step: Value,
        /// Set if the answer waits until the step is over.
        wait: bool,
    },
    /// All steps, or the one of this name.
    Steps(Option<String>),
    /// Undo what was asked for, all or by name.
    Clear(Option<String>),
    /// The values of these names, or what names there are.
    Names(Vec<String>),
    /// Question for what there is.
    State,
    /// Let time pass otherwise.
    Time(Value),
    /// Take these numbers for what the client believes.
    Publish(Value),
    /// Tell this one what happens.
    Listen(Listener),
}

/// Reason for which something is not done.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Refusal {
    /// As in HTTP.
    pub status: u16,
    /// Reason, and what to do.
    pub why: String,
}

impl Refusal {
    /// A refusal with this status.
    pub fn new(status: u16, why: impl Into<String>) -> Self {
        Self {
            status,
            why: why.into(),
        }
    }
}

/// The forms of all that can be asked. It takes long to write down, so connections have it
/// themselves.
pub type Schema = Box<dyn Fn() -> Value + Send + Sync>;

/// Answer to a request.
pub type Reply = Result<Value, Refusal>;

/// A request that waits for its answer. Without one its client learns that the simulation has
/// ended.
#[derive(Debug)]
pub struct Request {
    /// Request.
    pub ask: Ask,
    /// The way to answer it.
    pub answer: Answer,
}

/// The way to answer a request, once.
#[derive(Debug)]
pub struct Answer {
    reply: Sender<Reply>,
    watch: Arc<Watch>,
}

impl Answer {
    /// Answers. Never waits.
    pub fn give(self, reply: Reply) {
        self.watch.is_busy();
        // The client may have gone.
        let _ = self.reply.try_send(reply);
    }

    /// Takes note that the answer comes when the simulation has gone on.
    #[must_use]
    pub fn later(self) -> Self {
        self.watch.is_deferred();
        self
    }
}

/// Reads an address and a port to listen on; port 0 is any that is free.
///
/// # Errors
/// When it is none, in words.
pub fn listen(text: &str) -> Result<SocketAddr, String> {
    let local = text
        .strip_prefix("localhost:")
        .and_then(|port| port.parse().ok())
        .map(|port| SocketAddr::from((Ipv4Addr::LOCALHOST, port)));
    local
        .or_else(|| text.parse().ok())
        .ok_or_else(|| {
            let text: String = text.chars().take(80).collect();
            format!(
                "\"{text}\" is not an address with a port; write it as 127.0.0.1:0, where 0 is any free port"
            )
        })
}

/// A socket on which a simulation is looked at and changed.
pub struct Control {
    requests: Receiver<Request>,
    wake: UnixStream,
    shared: Arc<Shared>,
}

/// The part that all connections share.
struct Shared {
    socket: TcpListener,
    guard: Guard,
    pace: Pace,
    schema: LazyLock<Value, Schema>,
    requests: Sender<Request>,
    /// A byte in here wakes the simulation.
    wake: UnixStream,
    connections: Watches,
    stop: AtomicBool,
}

impl Control {
    /// Listens, with a new token.
    ///
    /// # Errors
    /// When the address cannot be had.
    pub fn open(listen: SocketAddr, schema: Schema) -> io::Result<Self> {
        let socket = TcpListener::bind(listen)?;
        let address = socket.local_addr()?;
        let token = guard::new_token()?;
        let (requests, taken) = bounded(MOST_WAITING);
        let (wake, woken) = UnixStream::pair()?;
        wake.set_nonblocking(true)?;
        woken.set_nonblocking(true)?;
        let shared = Arc::new(Shared {
            socket,
            guard: Guard { address, token },
            pace: Pace::default(),
            schema: LazyLock::new(schema),
            requests,
            wake,
            connections: Watches::default(),
            stop: AtomicBool::new(false),
        });
        let accepting = Arc::clone(&shared);
        thread::Builder::new()
            .name("control".to_owned())
            .spawn(move || accept(&accepting))?;
        Ok(Self {
            requests: taken,
            wake: woken,
            shared,
        })
    }

    /// URL to open, with the token in it.
    #[must_use]
    pub fn url(&self) -> String {
        let Guard { address, token } = &self.shared.guard;
        format!("http://{address}/#token={token}")
    }

    /// Returns whether other machines can reach it.
    #[must_use]
    pub fn is_public(&self) -> bool {
        !self.shared.guard.address.ip().is_loopback()
    }

    /// The next request. Never waits.
    pub fn poll(&self) -> Option<Request> {
        self.requests.try_recv().ok()
    }

    /// Clears the readable state: the next request makes [`Control`] readable again. To be called
    /// before the requests are taken.
    pub fn quiet(&self) {
        let mut bytes = [0; MOST_WAITING];
        while matches!((&self.wake).read(&mut bytes), Ok(count) if count == bytes.len()) {}
    }

    /// Begins to wait for all clients whose requests or messages are on their way.
    ///
    /// For a simulation whose time goes on only while its client waits: all that the client has
    /// asked before is done then, and all messages have reached it. Later requests, which only
    /// other clients make, are not waited for.
    #[must_use]
    pub fn settling(&self) -> Settling {
        self.shared.connections.begin_round();
        Settling {
            shared: Arc::clone(&self.shared),
            begun: Instant::now(),
            left: None,
        }
    }
}

/// Wait for those who had asked when it began.
pub struct Settling {
    shared: Arc<Shared>,
    begun: Instant,
    /// Those of them that are still being heard or answered, once all of them are known.
    left: Option<Vec<Arc<Watch>>>,
}

impl Settling {
    /// Returns whether all of them have been answered; a client that waits for the simulation to
    /// go on ([`Answer::later`]) counts as answered.
    #[must_use]
    pub fn is_over(&mut self) -> bool {
        let shared = &self.shared;
        if self.left.is_none() {
            self.left = shared.connections.all_who_came(&shared.socket);
        }
        let waited = self.begun.elapsed();
        self.left.as_mut().is_some_and(|left| {
            left.retain(|watch| !watch.has_been_quiet(waited));
            left.is_empty()
        })
    }

    /// The next request, waited for so long, and no longer than until [`Self::is_over`].
    #[must_use]
    pub fn request(&mut self, control: &Control, within: Duration) -> Option<Request> {
        let begun = Instant::now();
        loop {
            let request = control.poll();
            if request.is_some() || self.is_over() || begun.elapsed() > within {
                return request;
            }
            thread::sleep(Duration::from_micros(50));
        }
    }
}

impl AsFd for Control {
    /// Can be read when there are requests.
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.wake.as_fd()
    }
}

impl Drop for Control {
    fn drop(&mut self) {
        self.shared.stop.store(true, Ordering::Relaxed);
        // Wakes the thread that accepts, which then stops.
        let _ = TcpStream::connect_timeout(&self.shared.guard.address, Duration::from_millis(200));
        // No further requests are read; answers still go out.
        self.shared.connections.end();
        // A program that ended now would take their last words along.
        let begun = Instant::now();
        while !self.shared.connections.are_gone() && begun.elapsed() < PARTING {
            // Clients without an answer learn that it is over.
            self.requests.try_iter().for_each(drop);
            thread::sleep(Duration::from_millis(1));
        }
    }
}

impl Shared {
    /// Passes a request on; returns the channel of its answer.
    fn ask(&self, ask: Ask, watch: &Arc<Watch>) -> Result<Receiver<Reply>, Refusal> {
        let (reply, answered) = bounded(1);
        let answer = Answer {
            reply,
            watch: Arc::clone(watch),
        };
        self.requests
            .send_timeout(Request { ask, answer }, Duration::from_secs(5))
            .map_err(|_| Refusal::new(503, "the simulation takes no requests"))?;
        // When it is full the simulation has been woken before.
        let _ = (&self.wake).write(&[0]);
        Ok(answered)
    }
}

fn accept(shared: &Arc<Shared>) {
    loop {
        let accepted = shared.connections.accept(&shared.socket);
        let accepted = accepted.map(|(stream, watch)| {
            let shared = Arc::clone(shared);
            (stream, watch.map(|watch| Counted { shared, watch }))
        });
        if shared.stop.load(Ordering::Relaxed) {
            return;
        }
        match accepted {
            Ok((stream, Some(counted))) => {
                let serve = move || connection::serve(stream, &counted.shared, &counted.watch);
                // A client whose thread cannot be started is hung up.
                let thread = thread::Builder::new().name("control-client".to_owned());
                let _ = thread.spawn(serve);
            }
            Ok((stream, None)) => connection::turn_away(&stream),
            // Out of descriptors, for instance; some may become free.
            Err(_) => thread::sleep(Duration::from_millis(50)),
        }
    }
}

/// A connection, which is one of all until this is dropped, however it ends.
struct Counted {
    shared: Arc<Shared>,
    watch: Arc<Watch>,
}

impl Drop for Counted {
    fn drop(&mut self) {
        self.shared.connections.leave(&self.watch);
    }
}

#[cfg(test)]
mod tests;
