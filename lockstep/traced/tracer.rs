//! The tracer of a run: what it knows, and its steps.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::time::Instant;

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

use crate::port::Port;
use crate::traced::arch::Registers;
use crate::traced::clock::Clocks;
use crate::traced::news::TICK;
use crate::traced::one_processor::Lists;
use crate::traced::processor::Processor;
use crate::traced::spawn::{self, Starting};
use crate::traced::sys::{Ticks, Tid};
use crate::traced::timer::Timers;
use crate::traced::tree::{AtEnd, Process, State, Threads};
use crate::traced::wait::Wait;
use crate::{Broken, End, Ending, Error, Options, Program, Reason, World};

/// The tracer of one run.
pub(crate) struct Tracer<'a> {
    pub(crate) options: &'a Options<'a>,
    pub(crate) ports: &'a mut [Port],
    pub(crate) world: &'a mut dyn World,
    pub(crate) threads: Threads,
    pub(crate) processes: BTreeMap<Tid, Process>,
    pub(crate) now: u64,
    pub(crate) clocks: Clocks,
    pub(crate) timers: Timers,
    pub(crate) random: Option<Pcg64>,
    pub(crate) main: Tid,
    pub(crate) end: Option<End>,
    pub(crate) reason: Option<Reason>,
    /// Time at which those who were asked to end are killed.
    pub(crate) killed_at: Option<u64>,
    pub(crate) current: Option<Tid>,
    /// Threads that have stopped for the first time before their parent has told of them.
    pub(crate) early: BTreeSet<Tid>,
    /// Processes that have ended and may be left for this program to reap.
    pub(crate) ended: Vec<Tid>,
    pub(crate) numbers: u64,
    pub(crate) memories: u64,
    pub(crate) turns: u64,
    pub(crate) waits: u64,
    /// Counts up whenever something has happened that a wait may be for.
    pub(crate) happened: u64,
    /// Count of what had happened when time last went on.
    pub(crate) advanced: u64,
    /// A signal may have been sent to somebody who waits.
    pub(crate) signalled: bool,
    pub(crate) outside: BTreeSet<String>,
    pub(crate) refused: BTreeSet<String>,
    pub(crate) sleepy: u32,
    pub(crate) processor: Processor,
    pub(crate) lists: Lists,
    pub(crate) calls: u64,
    /// Since when somebody waits for the world outside, in real and in simulated time.
    pub(crate) paced: Option<(Instant, u64)>,
}

/// Ends the run early.
pub(crate) enum Halt {
    /// With an error.
    Failed(Error),
    /// The system has lost the thread at hand, which has been killed; its end will be told.
    Gone,
    /// The program has given a wrong address, which the system itself tells it.
    Fault,
}

impl From<io::Error> for Halt {
    fn from(error: io::Error) -> Self {
        if error.raw_os_error() == Some(libc::ESRCH) {
            return Self::Gone;
        }
        if error.raw_os_error() == Some(libc::EFAULT) {
            return Self::Fault;
        }
        Self::Failed(Error::System {
            what: "cannot trace the program",
            error,
        })
    }
}

impl From<Broken> for Halt {
    fn from(error: Broken) -> Self {
        Self::Failed(Error::World(error))
    }
}

/// Handling of a call.
#[expect(
    clippy::large_enum_variant,
    reason = "it is looked at once, where it is made"
)]
pub(crate) enum Handling {
    /// It is made.
    Make,
    /// It is not made, and returns this.
    Answer(i64),
    /// It waits until then at most.
    Hold(Wait, Option<u64>),
    /// It is made, with these registers, and its end is looked at.
    ToEnd(Registers, AtEnd),
}

/// Runs a program to its end; nobody whom it has started is left then, nor if this thread ends
/// before. Other children of this thread that end meanwhile are reaped.
///
/// # Errors
/// When it cannot be traced or started, holds something that cannot be run, or the world fails.
pub fn run(
    program: Program<'_>,
    options: &Options<'_>,
    ports: &mut [Port],
    world: &mut dyn World,
) -> Result<Ending, Error> {
    let ticks = Ticks::start(TICK).map_err(|error| Error::System {
        what: "cannot make a timer",
        error,
    })?;
    let mut starting = spawn::start(&program, options.seed.is_some())?;
    let mut tracer = Tracer::new(options, ports, world, &starting)?;
    let outcome = tracer.go_to_the_end();
    tracer.kill_all();
    drop(ticks);
    if let Some(error) = starting.failure() {
        return Err(error);
    }
    outcome?;
    Ok(tracer.ending())
}

impl<'a> Tracer<'a> {
    pub(crate) fn new(
        options: &'a Options<'a>,
        ports: &'a mut [Port],
        world: &'a mut dyn World,
        starting: &Starting,
    ) -> Result<Self, Error> {
        let main = starting.pid;
        let random = options.seed.map(|seed| {
            let mut bytes = [0; 32];
            bytes[..8].copy_from_slice(&seed.to_le_bytes());
            // A stream of its own, apart from those of the simulation.
            bytes[8..24].copy_from_slice(b"client's numbers");
            Pcg64::from_seed(bytes)
        });
        let mut tracer = Self {
            options,
            ports,
            world,
            threads: Threads::new(),
            processes: BTreeMap::new(),
            now: 0,
            clocks: Clocks::new(options.date),
            timers: Timers::default(),
            random,
            main,
            end: None,
            reason: None,
            killed_at: None,
            current: Some(main),
            early: BTreeSet::new(),
            ended: Vec::new(),
            numbers: 0,
            memories: 0,
            turns: 0,
            waits: 0,
            happened: 1,
            advanced: 0,
            signalled: false,
            outside: BTreeSet::new(),
            refused: BTreeSet::new(),
            sleepy: 0,
            processor: Processor::new(),
            lists: Lists::new(),
            calls: 0,
            paced: None,
        };
        let made = tracer.add_process(main, None, None);
        made.map_err(|error| Error::System {
            what: "cannot watch the program",
            error,
        })?;
        tracer.add_thread(main, main, State::Running);
        Ok(tracer)
    }

    fn ending(self) -> Ending {
        Ending {
            end: self.end.unwrap_or(End::Killed(libc::SIGKILL)),
            reason: self.reason.unwrap_or(Reason::Itself),
            outside: self.outside,
            refused: self.refused,
            at: self.now,
            calls: self.calls,
        }
    }

    /// Lets everybody run, wait and end.
    fn go_to_the_end(&mut self) -> Result<(), Error> {
        self.wait_for_current()?;
        loop {
            match self.step() {
                Ok(true) => {}
                Ok(false) => return Ok(()),
                Err(Halt::Gone) => {
                    // Its end is told soon.
                    if let Some(thread) = self.current.and_then(|tid| self.threads.get_mut(&tid)) {
                        thread.state = State::Running;
                    }
                    self.wait_for_current()?;
                }
                // A wrong address where nobody can be told of it.
                Err(Halt::Fault) => {}
                Err(Halt::Failed(error)) => return Err(error),
            }
        }
    }

    /// Lets somebody go on, or time; `false` when nobody is left.
    fn step(&mut self) -> Result<bool, Halt> {
        if self.signalled {
            self.signalled = false;
            self.interrupt_waits()?;
        }
        if let Some(tid) = self.next() {
            if self.current != Some(tid) {
                self.current = Some(tid);
                self.sleepy = 0;
            }
            self.resume(tid)?;
            return Ok(true);
        }
        self.current = None;
        if self.threads.is_empty() {
            // What has been closed on the way out.
            self.look_at_ports()?;
            return Ok(false);
        }
        if self.is_over_time() {
            return Ok(false);
        }
        self.look_at_ports()?;
        for port in &mut *self.ports {
            port.top_up()?;
        }
        self.send_echoes()?;
        if !self.look_at_waits()? {
            return self.let_time_pass();
        }
        Ok(true)
    }

    /// Random bytes; `None` if they are to be the system's.
    pub(crate) fn random(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.random.as_mut()?.fill_bytes(bytes);
        Some(())
    }
}
