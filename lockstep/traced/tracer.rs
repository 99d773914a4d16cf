//! The tracer of a run: what it knows, and its steps.

use std::cell::Cell;
use std::collections::BTreeSet;
use std::fs::File;
use std::rc::Rc;
use std::time::Duration;

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};

use crate::port::Port;
use crate::traced::clock::Clocks;
use crate::traced::descriptor::Status;
use crate::traced::limits::Limits;
use crate::traced::one_processor::Lists;
use crate::traced::passage::Passage;
use crate::traced::processor::Processor;
use crate::traced::spawn::{self, Starting};
use crate::traced::sys::counter::Counter;
use crate::traced::sys::{Ticks, Tid};
use crate::traced::syscall::Halt;
use crate::traced::timers::Timers;
use crate::traced::tree::Tree;
use crate::{End, Ending, Error, Options, Program, Reason, World};

pub(crate) struct Tracer<'a> {
    pub(crate) options: &'a Options<'a>,
    pub(crate) ports: &'a mut [Port],
    pub(crate) world: &'a mut dyn World,
    pub(crate) tree: Tree,
    pub(crate) descriptors: Descriptors,
    pub(crate) now: u64,
    pub(crate) clocks: Clocks,
    pub(crate) timers: Timers,
    pub(crate) random: Option<Pcg64>,
    pub(crate) schedule: Schedule,
    pub(crate) report: Ending,
    pub(crate) reason: Option<Reason>,
    pub(crate) limits: Limits,
    pub(crate) processor: Processor,
}

/// What descriptors of programs lead to, beside those that each process has.
pub(crate) struct Descriptors {
    /// Sockets that have sent to other machines, by device and inode.
    pub(crate) outside_sockets: BTreeSet<(u64, u64)>,
    /// A port may have been opened or closed since that was last found out.
    pub(crate) ports_used: Cell<bool>,
    /// How programs pass descriptors, where the system refuses to duplicate them.
    pub(crate) passage: Option<Rc<Passage>>,
    pub(crate) has_signalfd: bool,
    /// File of the program's output, by device and inode.
    pub(crate) output: Option<(u64, u64)>,
    pub(crate) lists: Lists,
}

/// Which thread runs, and what has happened that waits may be for.
#[derive(Default)]
pub(crate) struct Schedule {
    pub(crate) current: Option<Tid>,
    /// Chooses which thread runs next, if it is chosen at random.
    pub(crate) choices: Option<Pcg64>,
    /// Number of times that threads have yielded.
    pub(crate) turns: u64,
    /// Simulated time if each syscall of any thread cost time.
    pub(crate) paid: u64,
    /// Waits that have begun.
    pub(crate) waits: u64,
    /// Counts up whenever something has happened that a wait may be for.
    pub(crate) happened: u64,
    /// The same for what parents wait for: the ends and stops of processes, and some more.
    pub(crate) children: u64,
    /// Count of what had happened when time last went on.
    pub(crate) advanced: u64,
    /// A signal may have been sent to a thread that waits.
    pub(crate) signalled: bool,
    /// Ticks in a row at which the thread that runs has slept in the kernel.
    pub(crate) sleepy: u32,
    /// Processor time of the thread that runs, at the first tick since it was resumed.
    pub(crate) computing: Option<Duration>,
    /// Thread that has been interrupted because it computes for long.
    pub(crate) interrupted: Option<Tid>,
}

/// Runs a program to its end; no process that it has started is left then, nor if this thread ends
/// before. Other children of this thread that end meanwhile are reaped. Other threads start programs
/// meanwhile by [`spawn`](crate::spawn).
///
/// # Errors
/// When it cannot be traced or started, holds something that cannot be run, or the world fails.
pub fn run(
    program: Program<'_>,
    options: &Options<'_>,
    ports: &mut [Port],
    world: &mut dyn World,
) -> Result<Ending, Error> {
    let ticks = Ticks::start().map_err(|error| Error::System {
        what: "cannot make a timer",
        error,
    })?;
    let mut starting = spawn::start(&program, options.seed.is_some())?;
    let mut tracer = Tracer::new(options, ports, world, &starting, &program.output)?;
    let counter = Counter::of_tracer();
    let outcome = tracer.go_to_the_end();
    tracer.kill_all();
    drop((ticks, counter));
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
        output: &File,
    ) -> Result<Self, Error> {
        let passage = Passage::if_needed().map_err(|error| Error::System {
            what: "cannot make a socket for the program's descriptors",
            error,
        })?;
        // Separate streams, apart from those of the simulation.
        let stream = |seed: u64, name: &[u8; 16]| {
            let mut bytes = [0; 32];
            bytes[..8].copy_from_slice(&seed.to_le_bytes());
            bytes[8..24].copy_from_slice(name);
            Pcg64::from_seed(bytes)
        };
        let random = options.seed.map(|seed| stream(seed, b"client's numbers"));
        let choices = options
            .schedule
            .map(|seed| stream(seed, b"client's threads"));
        Ok(Self {
            options,
            ports,
            world,
            tree: Tree::new(starting.pid),
            descriptors: Descriptors {
                outside_sockets: BTreeSet::new(),
                ports_used: Cell::new(true),
                passage,
                has_signalfd: false,
                output: Status::of(output, "").map(|status| status.inode),
                lists: Lists::new(),
            },
            now: 0,
            clocks: Clocks::new(options.date),
            timers: Timers::default(),
            random,
            schedule: Schedule {
                current: Some(starting.pid),
                happened: 1,
                choices,
                ..Schedule::default()
            },
            report: Ending {
                end: End::Killed(libc::SIGKILL),
                reason: Reason::Itself,
                outside: BTreeSet::new(),
                refused: BTreeSet::new(),
                missing: BTreeSet::new(),
                left: BTreeSet::new(),
                written: 0,
                at: 0,
                calls: 0,
                random_addresses: false,
            },
            reason: None,
            limits: Limits::new(),
            processor: Processor::new(),
        })
    }

    fn ending(self) -> Ending {
        Ending {
            reason: self.reason.unwrap_or(Reason::Itself),
            at: self.now,
            ..self.report
        }
    }

    /// Runs all threads to their ends.
    fn go_to_the_end(&mut self) -> Result<(), Error> {
        self.wait_for_current()?;
        loop {
            match self.step() {
                Ok(true) => {}
                Ok(false) => return Ok(()),
                Err(Halt::Gone) => {
                    self.find_dying();
                    self.wait_for_current()?;
                }
                // A wrong address that no syscall can report.
                Err(Halt::Make | Halt::Again) => {}
                Err(Halt::Failed(error)) => return Err(error),
            }
        }
    }

    /// Resumes a thread, or advances time; `false` when no thread is left.
    fn step(&mut self) -> Result<bool, Halt> {
        if self.schedule.signalled {
            self.schedule.signalled = false;
            self.interrupt_waits()?;
        }
        if let Some(tid) = self.next() {
            if self.schedule.current != Some(tid) {
                self.schedule.current = Some(tid);
                self.schedule.sleepy = 0;
            }
            self.resume(tid)?;
            return Ok(true);
        }
        self.schedule.current = None;
        if self.tree.threads.is_empty() {
            self.close_ports()?;
            return Ok(false);
        }
        if self.is_over_time() {
            return Ok(false);
        }
        self.descriptors.ports_used.set(true);
        self.poll_ports()?;
        for port in &mut *self.ports {
            port.top_up()?;
            self.schedule.signalled |= std::mem::take(&mut port.has_signalled);
        }
        self.send_echoes()?;
        if self.schedule.signalled || self.poll_waits()? {
            return Ok(true);
        }
        self.let_time_pass()
    }

    /// Random bytes; `None` if they are to be the system's.
    pub(crate) fn random(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.random.as_mut()?.fill_bytes(bytes);
        Some(())
    }
}
