//! Unmodified programs in a time that the caller drives.
//!
//! [`run`] starts a program and traces it with everything that it starts. Its clocks show simulated
//! time, its sleeps, timeouts and timers end in simulated time. While it computes, simulated time
//! stands still; when all of it waits, a [`World`] says what happens next and when, and time goes
//! on to that or to the program's own next deadline. Nothing is preloaded, so that static programs
//! and any language will do.
//!
//! # How it works
//!
//! - A seccomp filter stops threads at the syscalls that matter: sleeps, waits, and whatever may wait for
//!   others. All other syscalls run at full speed.
//! - Clocks are read in the program's own memory: the functions of its vDSO are replaced.
//! - One thread runs at a time, until it waits; then the one that began first of those that can run.
//!   So the order of everything is the same on each run, whatever else the machine does.
//! - Waits that are known do not reach the kernel. A thread stays stopped until what it waits for is
//!   there, which is found out on duplicates of its descriptors, or until its deadline.
//! - What a program reads that is random comes from the run's seed.
//!
//! Everything about devices is the world's. The crate knows pseudo-terminals, as [`Port`]s, whose bytes it
//! keeps from the kernel's: passing them on takes time of the machine.
//!
//! It runs on x86-64; elsewhere [`run`] says that it does not. All that is of that architecture is
//! in `traced/x86_64.rs`.

mod copies;
mod port;
#[cfg(target_arch = "x86_64")]
mod traced;

use std::collections::BTreeSet;
use std::ffi::OsString;
use std::fs::File;
use std::io;
use std::sync::atomic::AtomicBool;
use std::time::{Duration, Instant};

pub use copies::spawn;
pub use port::{Port, modem};
pub use rigsim_settings::ClientLine;
#[cfg(target_arch = "x86_64")]
pub use traced::run;

/// A program and what it finds.
#[derive(Debug)]
pub struct Program<'a> {
    /// Its name, looked up in `PATH`, and its arguments.
    pub words: &'a [OsString],
    /// Variables beside those of this program.
    pub environment: &'a [(String, OsString)],
    /// File to which it writes both of its streams.
    pub output: File,
}

/// Options of a run.
#[derive(Debug)]
pub struct Options<'a> {
    /// Seed of what is random; `None` leaves it random.
    pub seed: Option<u64>,
    /// Seed by which the thread that runs next is chosen at each syscall; with `None` it is the one that
    /// began first, until it waits.
    pub schedule: Option<u64>,
    /// Its date when it begins, since 1970.
    pub date: Duration,
    /// Processor time that it and this thread may use. Waits for the world outside count in full.
    pub allowed: Option<Duration>,
    /// Time at which it is ended in any case, by the real clock.
    pub until: Option<Instant>,
    /// Ends it when it becomes true.
    pub stop: &'a AtomicBool,
}

/// World at the other end of the ports.
///
/// Times are nanoseconds since the program began. What happens to one port is reported in the order in
/// which it happens. All of it fails when the world has broken down; that ends the run. It may start threads,
/// and no programs: those would not be able to read the time stamp counter.
pub trait World {
    /// A client opened a port that no other had open.
    fn opened(&mut self, port: usize, now: u64) -> Result<(), Broken>;

    /// The last client closed a port.
    fn closed(&mut self, port: usize, now: u64) -> Result<(), Broken>;

    /// A client sends; says how many of the bytes there was room for. The others are sent again
    /// when time has gone on.
    fn sent(
        &mut self,
        port: usize,
        line: ClientLine,
        now: u64,
        bytes: &[u8],
    ) -> Result<usize, Broken>;

    /// A client has set the modem lines of a port, in the bits of [`modem`].
    fn modem_lines(&mut self, port: usize, now: u64, lines: u32) -> Result<(), Broken>;

    /// Returns whether it wants to know what each thread waits for, which takes time to find out.
    fn wants_waits(&self) -> bool {
        false
    }

    /// All programs wait, and time goes on from `now`.
    fn waits(&mut self, now: u64, waits: Vec<ThreadWait>) {
        let _ = (now, waits);
    }

    /// All programs wait; `ran` says whether any has run since this was last called. Goes on to the
    /// first time, `until` at the latest, at which something happens at a port, and does that.
    fn advance(
        &mut self,
        ports: &mut [Port],
        now: u64,
        until: Option<u64>,
        ran: bool,
    ) -> Result<Step, Broken>;
}

/// A thread that waits.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ThreadWait {
    /// Its place among all threads of the run, in the order in which they began.
    pub thread: u64,
    /// Its name, as the system knows it.
    pub name: String,
    /// Number of this wait, which differs from that of its last one.
    pub number: u64,
    /// What it waits for, as in `for bytes from /tmp/r150`.
    pub wait: String,
}

/// Reason for which a world cannot go on.
pub type Broken = Box<dyn std::error::Error + Send + Sync>;

/// Distance that a world has gone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// To this time.
    To(u64),
    /// To its end; the programs are asked to end.
    Over,
    /// Nothing will ever happen in it, and no deadline was given.
    Never,
}

/// End of a program.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum End {
    /// With this code.
    Exited(i32),
    /// By this signal.
    Killed(i32),
}

/// Reason for which a run came to its end.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reason {
    /// The program ended.
    Itself,
    /// The world came to its end.
    Over,
    /// The processor time allowed was used up, or the real time was over.
    OutOfTime {
        /// It was the real time.
        real: bool,
        /// What it was doing.
        doing: String,
    },
    /// Everything waited for nothing, and the world came to its end if it had one; for what.
    Deadlock(String),
    /// It was asked for.
    Stopped,
}

/// Outcome of a run.
#[derive(Debug, Clone)]
pub struct Ending {
    /// End of the program, which it comes to in any case.
    pub end: End,
    /// Reason of that.
    pub reason: Reason,
    /// Things outside of the run that were waited for; it is not repeatable if there are any.
    pub outside: BTreeSet<String>,
    /// Syscalls that were refused, and may explain a failure.
    pub refused: BTreeSet<String>,
    /// Names of syscalls that were answered with `ENOSYS`, as by a system that lacks them. Programs try
    /// some of them and do without.
    pub missing: BTreeSet<String>,
    /// Names of processes that still ran when the program ended, and were ended with it.
    pub left: BTreeSet<String>,
    /// Bytes that it has written to its output.
    pub written: u64,
    /// Time at which it ended, in nanoseconds since it began.
    pub at: u64,
    /// Syscalls at which it was stopped.
    pub calls: u64,
    /// The system refused to fix the addresses of the program's memory by the seed.
    pub random_addresses: bool,
}

/// Reason for which a program could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The system does not let programs be traced, or cannot.
    #[error("{0}")]
    Unsupported(String),
    /// The program could not be started.
    #[error("{0}")]
    NotStarted(io::Error),
    /// Something in it cannot be run in simulated time.
    #[error("{0}")]
    Refused(String),
    /// The world broke down.
    #[error(transparent)]
    World(Broken),
    /// The system failed.
    #[error("{what}: {error}")]
    System {
        /// Call that was being done.
        what: &'static str,
        /// Error of it.
        error: io::Error,
    },
}

/// Refuses.
///
/// # Errors
/// Always.
#[cfg(not(target_arch = "x86_64"))]
pub fn run(
    _program: Program<'_>,
    _options: &Options<'_>,
    _ports: &mut [Port],
    _world: &mut dyn World,
) -> Result<Ending, Error> {
    Err(Error::Unsupported(
        "a program can be run in simulated time on x86-64 only".to_owned(),
    ))
}
