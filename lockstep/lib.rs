//! Runs unmodified programs in simulated time, which the caller drives.
//!
//! [`run`] starts a program and traces it with everything that it starts. Its clocks show simulated
//! time, its sleeps, timeouts and timers end in simulated time. While it computes, simulated time
//! stands still. When all threads wait, a [`World`] says what happens next and when. Time advances to
//! that or to the program's own next deadline. Nothing is preloaded, so static programs and any
//! language work.
//!
//! # How it works
//!
//! - A seccomp filter stops threads at the syscalls that matter: sleeps, waits, and those that may wait for
//!   others. All other syscalls run at full speed.
//! - Clocks are read in the program's own memory: the functions of its vDSO are replaced.
//! - One thread runs at a time, until it waits. The next is the oldest of those that can run. So the
//!   order of events is the same in each run, under any load of the machine.
//! - Waits that the tracer knows do not reach the kernel. A thread stays stopped until its event, which
//!   is polled on duplicates of its descriptors, or until its deadline.
//! - Random bytes come from the run's seed.
//!
//! The world implements all devices. The crate knows pseudo-terminals, as [`Port`]s. Their bytes bypass
//! the kernel, which would take real time to pass them on.
//!
//! It runs on x86-64; elsewhere [`run`] returns an error. All code for that architecture is in
//! `traced/x86_64.rs`.

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

/// A program and its environment.
#[derive(Debug)]
pub struct Program<'a> {
    /// Its name, looked up in `PATH`, and its arguments.
    pub words: &'a [OsString],
    /// Variables in addition to those of this program.
    pub environment: &'a [(String, OsString)],
    /// File for both of its output streams.
    pub output: File,
}

/// Options of a run.
#[derive(Debug)]
pub struct Options<'a> {
    /// Seed of random bytes; with `None` they stay random.
    pub seed: Option<u64>,
    /// Seed of the choice of the next thread at each syscall; with `None` the oldest runs until it waits.
    pub schedule: Option<u64>,
    /// Date at its start, since 1970.
    pub date: Duration,
    /// Limit of the processor time of it and this thread. Waits for the outside count in full.
    pub allowed: Option<Duration>,
    /// Real time at which it is ended in any case.
    pub until: Option<Instant>,
    /// Ends it once set.
    pub stop: &'a AtomicBool,
}

/// World at the other end of the ports.
///
/// Times are nanoseconds since the program began. Events of one port are reported in order. An error of any
/// method ends the run. A world may start threads, but no programs: those could not read the time stamp
/// counter.
pub trait World {
    /// A client opened a port that no other had open.
    fn opened(&mut self, port: usize, now: u64) -> Result<(), Broken>;

    /// The last client closed a port.
    fn closed(&mut self, port: usize, now: u64) -> Result<(), Broken>;

    /// A client sends; returns the number of bytes that there was room for. The others are sent again when
    /// time has advanced.
    fn sent(
        &mut self,
        port: usize,
        line: ClientLine,
        now: u64,
        bytes: &[u8],
    ) -> Result<usize, Broken>;

    /// A client has set the modem lines of a port, in the bits of [`modem`].
    fn modem_lines(&mut self, port: usize, now: u64, lines: u32) -> Result<(), Broken>;

    /// Returns whether it needs the waits of each thread, which take time to collect.
    fn wants_waits(&self) -> bool {
        false
    }

    /// All programs wait, and time advances from `now`.
    fn waits(&mut self, now: u64, waits: Vec<ThreadWait>) {
        let _ = (now, waits);
    }

    /// All programs wait; `ran` says whether any has run since the last call. Advances to the first event at a
    /// port, `until` at the latest, and executes it.
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
    /// Number of this wait; each wait of a thread has a new one.
    pub number: u64,
    /// What it waits for, as in `for bytes from /tmp/r150`.
    pub wait: String,
}

/// Reason for which a world cannot go on.
pub type Broken = Box<dyn std::error::Error + Send + Sync>;

/// Result of advancing a world.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Step {
    /// To this time.
    To(u64),
    /// It has ended; the programs are asked to end.
    Over,
    /// It has no further event, and no deadline was given.
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

/// Reason for the end of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Reason {
    /// The program ended.
    Itself,
    /// The world came to its end.
    Over,
    /// The processor time or the real time was used up.
    OutOfTime {
        /// It was the real time.
        real: bool,
        /// What it was doing.
        doing: String,
    },
    /// All threads waited in vain until the end of the world, if it had one; the waits as text.
    Deadlock(String),
    /// The caller asked for it.
    Stopped,
}

/// Outcome of a run.
#[derive(Debug, Clone)]
pub struct Ending {
    /// How the program ended; it always does.
    pub end: End,
    /// Why it ended.
    pub reason: Reason,
    /// Outside waits; the run is not repeatable if there are any.
    pub outside: BTreeSet<String>,
    /// Refused syscalls, which may explain a failure.
    pub refused: BTreeSet<String>,
    /// Names of syscalls that returned `ENOSYS`, as on a system that lacks them. Programs try some of them and
    /// fall back.
    pub missing: BTreeSet<String>,
    /// Names of processes that still ran when the program ended, and were killed.
    pub left: BTreeSet<String>,
    /// Number of bytes that it has written to its output.
    pub written: u64,
    /// Time at which it ended, in nanoseconds since it began.
    pub at: u64,
    /// Number of syscalls at which it was stopped.
    pub calls: u64,
    /// Set if the system refused fixed addresses for the program's memory.
    pub random_addresses: bool,
}

/// Reason for which a program could not be run.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum Error {
    /// The system refuses or lacks tracing.
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
        /// The syscall, or what was being done.
        what: &'static str,
        /// The system's error.
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
