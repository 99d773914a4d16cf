//! A client as the tests need it, and waiting on conditions instead of times.
#![allow(dead_code, reason = "each test binary uses its own part")]
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

pub mod unprivileged;

use std::os::fd::{AsFd, BorrowedFd, OwnedFd};
use std::path::Path;
use std::time::{Duration, Instant};

use rigsim_pty::{Event, Port, PtySetup, Waiter, open_unlinked_port};
use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fs::{Mode, OFlags};
use rustix::io::Errno;
use rustix::termios::{OptionalActions, Termios, tcgetattr, tcsetattr};

/// How long a test waits for what must happen before it calls it a failure.
/// Generous, since it is spent only on failure.
pub const PATIENCE: Duration = Duration::from_secs(120);

/// A program that has opened a port the way serial libraries do.
pub struct Client(OwnedFd);

impl Client {
    pub fn open(path: &Path) -> Self {
        Self::try_open(path).expect("the port can be opened")
    }

    pub fn try_open(path: &Path) -> Result<Self, Errno> {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        rustix::fs::open(path, flags, Mode::empty()).map(Self)
    }

    /// Sends all at once, as soon as the kernel has room: it makes that some time after another's bytes were
    /// thrown away.
    pub fn send(&self, bytes: &[u8]) {
        let start = Instant::now();
        loop {
            match rustix::io::write(&self.0, bytes) {
                Err(Errno::AGAIN) if start.elapsed() < PATIENCE => std::thread::yield_now(),
                sent => return assert_eq!(sent, Ok(bytes.len())),
            }
        }
    }

    /// Waits until there is something to read.
    pub fn wait(&self) {
        let mut fds = [PollFd::new(&self.0, PollFlags::IN)];
        let patience = Timespec::try_from(PATIENCE).unwrap();
        poll(&mut fds, Some(&patience)).unwrap();
    }

    /// Takes what is there to be read right now.
    pub fn try_receive(&self) -> Vec<u8> {
        let mut buf = [0; 65_536];
        match rustix::io::read(&self.0, &mut buf[..]) {
            Ok(n) => buf[..n].to_vec(),
            Err(Errno::AGAIN) => Vec::new(),
            Err(errno) => panic!("the client reads {errno}"),
        }
    }

    pub fn receive(&self, len: usize) -> Vec<u8> {
        let mut received = Vec::new();
        until("the client receives", || {
            received.extend(self.try_receive());
            received.len() >= len
        });
        received
    }

    pub fn termios(&self) -> Termios {
        tcgetattr(&self.0).expect("the client's end has settings")
    }

    pub fn set_termios(&self, change: impl FnOnce(&mut Termios)) {
        let mut termios = self.termios();
        change(&mut termios);
        tcsetattr(&self.0, OptionalActions::Now, &termios).expect("the settings are taken");
    }

    pub fn into_fd(self) -> OwnedFd {
        self.0
    }
}

impl AsFd for Client {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.0.as_fd()
    }
}

pub fn until(what: &str, mut done: impl FnMut() -> bool) {
    let start = Instant::now();
    while !done() {
        assert!(start.elapsed() < PATIENCE, "in vain waited until {what}");
        std::thread::sleep(Duration::from_millis(1));
    }
}

/// A port and a waiter that watches nothing else.
pub struct Bench {
    pub waiter: Waiter,
    pub port: Box<dyn Port>,
    /// With zero the port is polled without a sleep.
    pub longest_wait: Duration,
}

impl Bench {
    pub fn new(mut port: Box<dyn Port>) -> Self {
        let mut waiter = Waiter::new().unwrap();
        waiter.add(7, &mut port).unwrap();
        Self {
            waiter,
            port,
            longest_wait: PATIENCE,
        }
    }

    pub fn unlinked() -> Self {
        Self::new(open_unlinked_port(PtySetup::raw(115_200)).unwrap())
    }

    pub fn client(&self) -> Client {
        Client::open(self.port.path())
    }

    /// The next event other than idle, and the bytes that came with it. The
    /// port is read only when the waiter says so, and once each time.
    pub fn next(&mut self) -> (Event, Vec<u8>) {
        let start = Instant::now();
        let mut buf = [0; 4096];
        while start.elapsed() < PATIENCE {
            if self.waiter.wait(Some(self.longest_wait)).unwrap().ready() != [7] {
                continue;
            }
            match self.port.read(&mut buf).unwrap() {
                Event::Idle => {}
                Event::Data(n) => return (Event::Data(n), buf[..n].to_vec()),
                event => return (event, Vec::new()),
            }
        }
        panic!("in vain waited for an event");
    }

    pub fn expect(&mut self, event: Event) {
        assert_eq!(self.next().0, event);
    }

    /// Waits for so many bytes, with nothing but bytes in between.
    pub fn expect_bytes(&mut self, len: usize) -> Vec<u8> {
        let mut bytes = Vec::new();
        while bytes.len() < len {
            let (event, data) = self.next();
            assert!(
                matches!(event, Event::Data(_)),
                "{event:?} instead of bytes"
            );
            bytes.extend(data);
        }
        bytes
    }

    /// Nothing is left to report; the waiter sleeps the time it was given.
    pub fn expect_quiet(&mut self) {
        let mut buf = [0; 4096];
        // What led to the last event may well be reported once or twice more.
        let mut looks = 0;
        while self.waiter.wait(Some(Duration::ZERO)).unwrap().ready() == [7] {
            assert_eq!(self.port.read(&mut buf).unwrap(), Event::Idle);
            looks += 1;
            assert!(looks < 10, "the waiter spins");
        }
        assert_eq!(self.port.read(&mut buf).unwrap(), Event::Idle);
    }
}
