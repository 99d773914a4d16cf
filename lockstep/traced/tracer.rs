//! The tracer: who runs, who waits, and when time goes on.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::time::{Duration, Instant};

use rand_pcg::Pcg64;
use rand_pcg::rand_core::{Rng as _, SeedableRng as _};
use rustix::process::{Pid, PidfdFlags};

use crate::port::Port;
use crate::traced::arch::{self, Registers};
use crate::traced::clock::Clocks;
use crate::traced::memory::Memory;
use crate::traced::spawn::{self, Starting};
use crate::traced::sys::{self, Ticks, Tid, Whom};
use crate::traced::timer::Timers;
use crate::traced::tree::{
    AtEnd, OwnClocks, Process, Resume, Shown, Signals, State, Thread, Threads, kernel_state,
    name_of, path_of,
};
use crate::traced::wait::{Hold, Wait};
use crate::{Broken, End, Ending, Error, Options, Program, Reason, Step, World};

/// How often a wait for a thread is interrupted to look at the real clock.
const TICK: Duration = Duration::from_millis(20);
/// Ticks in a row at which a thread sleeps in the kernel before it is taken to wait there.
const SLEEPY_TICKS: u32 = 2;
/// Simulated time in which programs that were asked to end may do so.
const GRACE: u64 = 2_000_000_000;
/// Real time in which killed programs must have gone.
const KILL_PATIENCE: Duration = Duration::from_secs(10);
/// The longest step of time while somebody waits for the world outside.
const PACE: u64 = 10_000_000;
/// What one ask costs a thread that does nothing but ask.
const CREEP: u64 = 20_000;
/// Asks in a row that cost nothing.
const FREE_ASKS: u32 = 1000;

/// The tracer of one run.
pub(crate) struct Tracer<'a> {
    options: &'a Options<'a>,
    pub(crate) ports: &'a mut [Port],
    pub(crate) world: &'a mut dyn World,
    pub(crate) threads: Threads,
    pub(crate) processes: BTreeMap<Tid, Process>,
    pub(crate) now: u64,
    pub(crate) clocks: Clocks,
    pub(crate) timers: Timers,
    random: Option<Pcg64>,
    main: Tid,
    end: Option<End>,
    reason: Option<Reason>,
    /// When those who were asked to end are killed.
    killed_at: Option<u64>,
    current: Option<Tid>,
    /// Threads that have stopped for the first time before their parent has told of them.
    early: BTreeSet<Tid>,
    /// Processes that have ended and may be left for this program to reap.
    ended: Vec<Tid>,
    numbers: u64,
    memories: u64,
    turns: u64,
    waits: u64,
    /// Counts up whenever something has happened that a wait may be for.
    pub(crate) happened: u64,
    /// A signal may have been sent to somebody who waits.
    pub(crate) signalled: bool,
    pub(crate) outside: BTreeSet<String>,
    pub(crate) refused: BTreeSet<String>,
    sleepy: u32,
    calls: u64,
    /// Since when somebody waits for the world outside, in real and in simulated time.
    paced: Option<(Instant, u64)>,
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

/// What becomes of a call.
#[expect(
    clippy::large_enum_variant,
    reason = "it is looked at once, where it is made"
)]
pub(crate) enum Action {
    /// It is made.
    Make,
    /// It is not made, and returns this.
    Answer(i64),
    /// It waits until then at most.
    Hold(Wait, Option<u64>),
    /// It is made, with these registers, and its end is looked at.
    ToEnd(Registers, AtEnd),
}

/// Runs a program to its end.
pub(crate) fn run(
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
    fn new(
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
            signalled: false,
            outside: BTreeSet::new(),
            refused: BTreeSet::new(),
            sleepy: 0,
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

    fn add_process(
        &mut self,
        pid: Tid,
        memory: Option<u64>,
        clocks: Option<OwnClocks>,
    ) -> io::Result<()> {
        let raw = Pid::from_raw(pid).ok_or(io::ErrorKind::InvalidInput)?;
        let handle = rustix::process::pidfd_open(raw, PidfdFlags::empty())?;
        let memory = memory.unwrap_or_else(|| self.new_memory());
        let process = Process {
            memory,
            handle,
            dying: false,
            clocks,
        };
        self.processes.insert(pid, process);
        Ok(())
    }

    fn new_memory(&mut self) -> u64 {
        self.memories += 1;
        self.memories
    }

    fn add_thread(&mut self, tid: Tid, process: Tid, state: State) {
        self.numbers += 1;
        let thread = Thread::new(self.numbers, process, state);
        self.threads.insert(tid, thread);
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

    /// Who is to go on: whoever ran last, or the first of those that can.
    fn next(&self) -> Option<Tid> {
        if let Some(tid) = self.current
            && self.threads.get(&tid).is_some_and(Thread::is_ready)
        {
            return Some(tid);
        }
        let ready = self.threads.iter().filter(|(_, thread)| thread.is_ready());
        let first = ready.min_by_key(|(_, thread)| (thread.turn, thread.number));
        first.map(|(tid, _)| *tid)
    }

    fn resume(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Ok(());
        };
        let State::Ready(resume) = thread.state else {
            return Ok(());
        };
        thread.state = State::Running;
        thread.turn = 0;
        if !thread.retries {
            self.happened += 1;
        }
        match resume {
            Resume::Go(signal) if thread.at_end.is_some() => {
                sys::go_on_to_end_of_call(tid, signal)?;
            }
            Resume::Go(signal) => {
                self.show_clocks(tid)?;
                sys::go_on(tid, signal)?;
            }
            Resume::Call { crept } => {
                self.calls += 1;
                let registers = Registers::of(tid)?;
                let action = match self.call(tid, registers, crept) {
                    Err(Halt::Fault) => Action::Make,
                    action => action?,
                };
                self.act(tid, registers, action)?;
            }
        }
        self.wait_for_current().map_err(Halt::Failed)
    }

    /// Does with a call what has been decided.
    fn act(&mut self, tid: Tid, mut registers: Registers, action: Action) -> Result<(), Halt> {
        match action {
            Action::Make => {
                self.show_clocks(tid)?;
                sys::go_on(tid, 0)?;
            }
            Action::Answer(result) => {
                registers.answer(result);
                registers.set(tid)?;
                self.set_state(tid, State::Ready(Resume::Go(0)));
            }
            Action::Hold(wait, deadline) => self.hold(tid, registers, wait, deadline),
            Action::ToEnd(changed, at_end) => {
                changed.set(tid)?;
                if let Some(thread) = self.threads.get_mut(&tid) {
                    thread.at_end = Some(at_end);
                }
                sys::go_on_to_end_of_call(tid, 0)?;
            }
        }
        Ok(())
    }

    /// Has the clocks in a program's own memory show what they should, before it goes on.
    fn show_clocks(&mut self, tid: Tid) -> Result<(), Halt> {
        let Some(thread) = self.threads.get(&tid) else {
            return Ok(());
        };
        let process = self.processes.get_mut(&thread.process);
        let Some(clocks) = process.and_then(|process| process.clocks.as_mut()) else {
            return Ok(());
        };
        let shown = Shown {
            real: self.clocks.real(self.now),
            monotonic: self.clocks.monotonic(self.now),
            // Who has asked much, and waited for nothing since, has to ask here.
            asks: if thread.asks < FREE_ASKS {
                FREE_ASKS
            } else {
                0
            },
        };
        if clocks.shown != Some(shown) {
            let times = (shown.real, shown.monotonic);
            arch::write_clocks(Memory(tid), clocks.page, shown.asks, times)?;
            clocks.shown = Some(shown);
        }
        Ok(())
    }

    pub(crate) fn hold(
        &mut self,
        tid: Tid,
        registers: Registers,
        wait: Wait,
        deadline: Option<u64>,
    ) {
        self.waits += 1;
        let hold = Hold {
            registers,
            wait,
            deadline,
            since: self.waits,
            looked_at: self.happened,
        };
        let creeps = matches!(hold.wait, Wait::Creep);
        if let Some(thread) = self.threads.get_mut(&tid) {
            if !creeps {
                thread.asks = 0;
            }
            thread.state = State::Held(Box::new(hold));
        }
    }

    pub(crate) fn set_state(&mut self, tid: Tid, state: State) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = state;
        }
    }

    /// A thread asks and waits for nothing; after many of these each takes a little time. `None` if
    /// it may be answered at once.
    pub(crate) fn ask(&mut self, tid: Tid, crept: bool) -> Option<Action> {
        let thread = self.threads.get_mut(&tid)?;
        thread.asks = thread.asks.saturating_add(1);
        if crept || thread.asks <= FREE_ASKS {
            return None;
        }
        Some(Action::Hold(Wait::Creep, Some(self.now + CREEP)))
    }

    /// A thread lets the others go first.
    pub(crate) fn give_way(&mut self, tid: Tid) {
        self.turns += 1;
        let turn = self.turns;
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.turn = turn;
        }
        self.current = None;
    }

    /// Random bytes; `None` if they are to be the system's.
    pub(crate) fn random(&mut self, bytes: &mut [u8]) -> Option<()> {
        self.random.as_mut()?.fill_bytes(bytes);
        Some(())
    }

    /// Waits until the thread that runs has stopped or gone, and with it whoever is about to go.
    fn wait_for_current(&mut self) -> Result<(), Error> {
        loop {
            let runs = self
                .current
                .and_then(|tid| self.threads.get(&tid))
                .is_some_and(Thread::is_running);
            let dying = self.processes.values().any(|process| process.dying);
            if !runs && !dying {
                return Ok(());
            }
            match self.take_news(true) {
                Ok(true) => self.sleepy = 0,
                Ok(false) => {
                    if self.tick() {
                        return Ok(());
                    }
                }
                Err(Halt::Gone | Halt::Fault) => {}
                Err(Halt::Failed(error)) => return Err(error),
            }
        }
    }

    /// Takes what one thread has to tell; `false` if none has, or after a tick.
    fn take_news(&mut self, block: bool) -> Result<bool, Halt> {
        match sys::wait(Whom::Anybody, block) {
            Ok(Some((tid, status))) => {
                self.news(tid, status)?;
                Ok(true)
            }
            Ok(None) => Ok(false),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                self.threads.clear();
                self.processes.clear();
                Ok(false)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Looks at the real clock; whether the wait for the thread that runs is over.
    fn tick(&mut self) -> bool {
        if self.is_over_time() {
            self.kill_all();
            return true;
        }
        let Some(tid) = self.current else {
            return false;
        };
        let Some(thread) = self.threads.get(&tid).filter(|t| t.is_running()) else {
            return false;
        };
        if kernel_state(thread.process, tid) != Some('S') {
            self.sleepy = 0;
            return false;
        }
        self.sleepy += 1;
        if self.sleepy < SLEEPY_TICKS {
            return false;
        }
        let what = self.what_kernel_waits_for(thread.process, tid);
        self.outside.insert(what);
        self.set_state(tid, State::Blocked);
        true
    }

    /// What a thread does that sleeps in a call that nobody looks at.
    fn what_kernel_waits_for(&self, process: Tid, tid: Tid) -> String {
        let call = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/syscall"));
        let call = call.unwrap_or_default();
        let mut words = call.split_whitespace();
        let number: i64 = words.next().and_then(|n| n.parse().ok()).unwrap_or(-1);
        let fd = words.next().and_then(|n| n.strip_prefix("0x"));
        let fd = fd.and_then(|n| i32::from_str_radix(n, 16).ok());
        let program = name_of(tid);
        match (number, fd) {
            (libc::SYS_openat, _) => format!("{program} opens a file that somebody else must open"),
            (libc::SYS_connect, Some(fd)) => match self.peer(process, fd) {
                Some(peer) => peer,
                None => format!("{program} connects to somebody outside"),
            },
            (_, Some(fd)) => match path_of(process, fd) {
                Some(path) => format!("{program} in call {number}, perhaps on {}", path.display()),
                None => format!("{program} in call {number}"),
            },
            _ => format!("{program} in call {number}"),
        }
    }

    /// Whether the real time allowed is over, or somebody asks for the end; notes which.
    fn is_over_time(&mut self) -> bool {
        let stop = self.options.stop.load(std::sync::atomic::Ordering::Relaxed);
        let late = self
            .options
            .until
            .is_some_and(|until| Instant::now() >= until);
        if self.reason.is_none() {
            if stop {
                self.reason = Some(Reason::Stopped);
            } else if late {
                self.reason = Some(Reason::OutOfTime(self.doing()));
            }
        }
        stop || late
    }

    /// What the programs are doing, for people.
    fn doing(&self) -> String {
        let running = self.current.and_then(|tid| {
            let thread = self.threads.get(&tid)?;
            thread.is_running().then_some((tid, thread.process))
        });
        let Some((tid, process)) = running else {
            return self.waits_text();
        };
        let name = name_of(tid);
        let place = place_of(process, tid);
        match place {
            Some(place) => format!("{name} was computing, in {place}"),
            None => format!("{name} was computing"),
        }
    }

    /// What everybody waits for, for people.
    fn waits_text(&self) -> String {
        let mut waits: Vec<String> = Vec::new();
        for (tid, thread) in &self.threads {
            let what = match &thread.state {
                State::Held(hold) => self.wait_text(thread.process, &hold.wait),
                State::Stopped => "for being continued".to_owned(),
                State::Blocked => "in the kernel".to_owned(),
                State::Running | State::Ready(_) => continue,
            };
            let text = format!("{} waited {what}", name_of(*tid));
            if !waits.contains(&text) {
                waits.push(text);
            }
        }
        waits.truncate(8);
        waits.join(", ")
    }

    fn wait_text(&self, process: Tid, wait: &Wait) -> String {
        let file = |fd: i32| {
            let path = path_of(process, fd);
            path.map_or(format!("descriptor {fd}"), |path| {
                let path = path.to_string_lossy().into_owned();
                match self.ports.iter().find(|port| port.leads_to(&path)) {
                    Some(port) => port.path().display().to_string(),
                    None => path,
                }
            })
        };
        match wait {
            Wait::Sleep { .. } | Wait::Creep => "for time to pass".to_owned(),
            Wait::Poll { set, .. } => {
                let files: Vec<String> = set.iter().map(|(fd, _)| file(*fd)).collect();
                format!("for {}", files.join(" or "))
            }
            Wait::Descriptor { fd, .. } => format!("for {}", file(*fd)),
            Wait::PortRead { port, .. } => match self.ports.get(*port) {
                Some(port) => format!("for bytes from {}", port.path().display()),
                None => "for bytes".to_owned(),
            },
            Wait::PortWrite { .. } => "for room on the line".to_owned(),
            Wait::Futex { .. } => "for another thread".to_owned(),
            Wait::Signal { .. } => "for a signal".to_owned(),
            Wait::Child | Wait::Vfork { .. } => "for a child".to_owned(),
            Wait::Again { .. } => "for a lock or a queue".to_owned(),
            Wait::Forever => "for a change of modem lines".to_owned(),
        }
    }

    /// What has become of a thread.
    fn news(&mut self, tid: Tid, status: i32) -> Result<(), Halt> {
        if libc::WIFEXITED(status) || libc::WIFSIGNALED(status) {
            self.gone(tid, status);
            return Ok(());
        }
        if !self.threads.contains_key(&tid) {
            self.early.insert(tid);
            return Ok(());
        }
        let signal = libc::WSTOPSIG(status);
        match status >> 16 {
            libc::PTRACE_EVENT_SECCOMP => {
                self.set_state(tid, State::Ready(Resume::Call { crept: false }));
            }
            libc::PTRACE_EVENT_EXEC => self.executed(tid)?,
            event @ (libc::PTRACE_EVENT_FORK
            | libc::PTRACE_EVENT_VFORK
            | libc::PTRACE_EVENT_CLONE) => self.cloned(tid, event)?,
            libc::PTRACE_EVENT_STOP if signal != libc::SIGTRAP => {
                self.set_state(tid, State::Stopped);
                sys::listen(tid)?;
            }
            0 if signal == libc::SIGTRAP | 0x80 => self.end_of_call(tid)?,
            0 => self.signal(tid, signal)?,
            _ => self.set_state(tid, State::Ready(Resume::Go(0))),
        }
        Ok(())
    }

    /// A signal is about to be delivered.
    fn signal(&mut self, tid: Tid, signal: i32) -> Result<(), Halt> {
        let mut give = signal;
        if signal == libc::SIGSEGV {
            let mut registers = Registers::of(tid)?;
            let ticks = self.clocks.monotonic(self.now);
            if registers.read_time_stamp(Memory(tid), ticks) {
                registers.set(tid)?;
                give = 0;
            }
        }
        self.set_state(tid, State::Ready(Resume::Go(give)));
        Ok(())
    }

    /// A thread has started another, or a process.
    fn cloned(&mut self, tid: Tid, event: i32) -> Result<(), Halt> {
        let child = sys::event_message(tid)?;
        let registers = Registers::of(tid)?;
        let parent = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let (is_thread, shares_memory) = arch::clones(&registers);
        if !self.early.remove(&child) {
            // It is about to stop for the first time.
            loop {
                match sys::wait(Whom::One(child), true) {
                    Ok(Some((_, status))) if libc::WIFSTOPPED(status) => break,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    // Killed before it began.
                    _ => {
                        self.set_state(tid, State::Ready(Resume::Go(0)));
                        return Ok(());
                    }
                }
            }
        }
        let ready = State::Ready(Resume::Go(0));
        if is_thread {
            self.add_thread(child, parent, ready);
        } else {
            let parent = self.processes.get(&parent);
            let memory = parent.map(|process| process.memory);
            let clocks = parent.and_then(|process| process.clocks);
            self.add_process(child, memory.filter(|_| shares_memory), clocks)?;
            self.add_thread(child, child, ready);
        }
        if event == libc::PTRACE_EVENT_VFORK {
            self.hold(tid, registers, Wait::Vfork { child }, None);
        } else {
            self.set_state(tid, State::Ready(Resume::Go(0)));
        }
        Ok(())
    }

    /// A process has another program.
    fn executed(&mut self, tid: Tid) -> Result<(), Halt> {
        let former = sys::event_message(tid)?;
        let number = self.threads.get(&former).map(|thread| thread.number);
        self.threads
            .retain(|other, thread| *other == tid || thread.process != tid);
        if let Some(thread) = self.threads.get_mut(&tid) {
            *thread = Thread::new(
                number.unwrap_or(thread.number),
                tid,
                State::Ready(Resume::Go(0)),
            );
        }
        if self.current == Some(former) {
            self.current = Some(tid);
        }
        let memory = self.new_memory();
        if let Some(process) = self.processes.get_mut(&tid) {
            process.memory = memory;
            process.clocks = None;
        }
        self.timers.forget_posix(tid);
        self.release_parent(tid);
        self.check_program(tid)?;
        self.happened += 1;
        let stack = Registers::of(tid)?.stack();
        let mut bytes = [0; 16];
        let random = self.random(&mut bytes).map(|()| bytes);
        let vdso = arch::prepare_image(Memory(tid), stack, random)?;
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.at_end = vdso.map(AtEnd::Loaded);
        }
        Ok(())
    }

    /// Refuses programs that cannot be run so.
    fn check_program(&mut self, pid: Tid) -> Result<(), Halt> {
        use std::os::unix::fs::MetadataExt as _;
        let path = std::fs::read_link(format!("/proc/{pid}/exe")).unwrap_or_default();
        let refuse = |why: &str| {
            Err(Halt::Failed(Error::Refused(format!(
                "{} {why}",
                path.display()
            ))))
        };
        if !Registers::of(pid)?.is_native() {
            return refuse("is a 32-bit program, which cannot be run in simulated time");
        }
        let Ok(file) = std::fs::metadata(format!("/proc/{pid}/exe")) else {
            return Ok(());
        };
        let user = rustix::process::geteuid().as_raw();
        if file.mode() & libc::S_ISUID != 0 && file.uid() != user {
            return refuse(
                "is to run as another user (set-user-id), which a program in simulated time cannot",
            );
        }
        Ok(())
    }

    /// A process has a memory of its own now, or has ended: whoever waits for that goes on.
    fn release_parent(&mut self, pid: Tid) {
        for thread in self.threads.values_mut() {
            if let Some(hold) = thread.hold()
                && matches!(hold.wait, Wait::Vfork { child } if child == pid)
            {
                thread.state = State::Ready(Resume::Go(0));
            }
        }
        self.wake_changed_futexes();
    }

    /// A thread has ended.
    fn gone(&mut self, tid: Tid, status: i32) {
        self.threads.remove(&tid);
        self.early.remove(&tid);
        self.happened += 1;
        if self.processes.remove(&tid).is_some() {
            self.threads.retain(|_, thread| thread.process != tid);
            self.timers.forget(tid);
            self.release_parent(tid);
            // Its parent is told.
            self.signalled = true;
            if tid == self.main {
                self.end = Some(if libc::WIFEXITED(status) {
                    End::Exited(libc::WEXITSTATUS(status))
                } else {
                    End::Killed(libc::WTERMSIG(status))
                });
                if self.killed_at.is_none() {
                    self.ask_to_end(Reason::Itself);
                }
            } else {
                self.ended.push(tid);
            }
        } else {
            self.wake_changed_futexes();
        }
    }

    /// Asks everybody to end; whoever does not is killed after a while.
    fn ask_to_end(&mut self, reason: Reason) {
        self.reason.get_or_insert(reason);
        self.killed_at = Some(self.now + GRACE);
        for pid in self.processes.keys() {
            // Who has gone meanwhile need not be asked.
            let _ = sys::kill(*pid, libc::SIGTERM);
        }
        self.signalled = true;
    }

    /// Kills everybody and waits until they have gone.
    fn kill_all(&mut self) {
        let begun = Instant::now();
        while !self.processes.is_empty() && begun.elapsed() < KILL_PATIENCE {
            for pid in self.processes.keys() {
                let _ = sys::kill(*pid, libc::SIGKILL);
            }
            match sys::wait(Whom::Anybody, true) {
                Ok(Some((tid, status))) if libc::WIFSTOPPED(status) => {
                    // A child that was being made, or somebody on the way out.
                    let _ = sys::kill(tid, libc::SIGKILL);
                    let _ = sys::go_on(tid, 0);
                }
                Ok(Some((tid, status))) => self.gone(tid, status),
                Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                    self.processes.clear();
                }
                _ => {}
            }
        }
        self.threads.clear();
        // Those whose parent has ended before them have become children of this program.
        for pid in std::mem::take(&mut self.ended) {
            sys::reap(pid);
        }
    }

    /// Interrupts waits of those to whom a signal has been sent.
    fn interrupt_waits(&mut self) -> Result<(), Halt> {
        let mut waiting: Vec<(u64, Tid)> = self
            .threads
            .iter()
            .filter(|(_, thread)| thread.hold().is_some())
            .map(|(tid, thread)| (thread.number, *tid))
            .collect();
        waiting.sort_unstable();
        let mut served = BTreeSet::new();
        for (_, tid) in waiting {
            let Some(thread) = self.threads.get(&tid) else {
                continue;
            };
            let Some(hold) = thread.hold() else {
                continue;
            };
            let process = thread.process;
            let Some(signals) = Signals::of(process, tid) else {
                continue;
            };
            let (set, mask) = match &hold.wait {
                Wait::Signal { set, mask } => (*set, *mask),
                Wait::Poll { mask, .. } => (None, *mask),
                Wait::Vfork { .. } => continue,
                _ => (None, None),
            };
            let wanted = set.is_some_and(|set| signals.pending & set != 0);
            let interrupting = signals.interrupting(mask);
            // What has been sent to the process is for the first who takes it.
            if (wanted || interrupting != 0) && served.insert((process, interrupting)) {
                self.interrupt(tid)?;
            }
        }
        Ok(())
    }

    /// Ends a wait because of a signal, which comes when the thread goes on.
    fn interrupt(&mut self, tid: Tid) -> Result<(), Halt> {
        let now = self.now;
        let Some(thread) = self.threads.get_mut(&tid) else {
            return Ok(());
        };
        let State::Held(hold) = std::mem::replace(&mut thread.state, State::Ready(Resume::Go(0)))
        else {
            return Ok(());
        };
        let mut registers = hold.registers;
        match hold.wait {
            Wait::Sleep { rest } => {
                let left = hold.deadline.unwrap_or(now).saturating_sub(now);
                if let Some(address) = rest {
                    let (seconds, nanoseconds) = crate::traced::clock::parts(left);
                    // A wrong address is the program's.
                    let _ = Memory(tid).write_pair(address, seconds, nanoseconds);
                }
                registers.answer(-i64::from(libc::EINTR));
                registers.set(tid)?;
            }
            Wait::Poll { mask: None, .. } => {
                registers.answer(-i64::from(libc::EINTR));
                registers.set(tid)?;
            }
            Wait::PortWrite { sent, .. } if sent > 0 => {
                registers.answer(i64::try_from(sent).unwrap_or(i64::MAX));
                registers.set(tid)?;
            }
            Wait::Creep => thread.state = State::Ready(Resume::Call { crept: true }),
            Wait::Child | Wait::Again { .. } => {
                // At the end of the call; the system makes it again or not, as the signal has it.
                const ERESTARTSYS: i64 = 512;
                registers.set_result(-ERESTARTSYS);
                registers.set(tid)?;
            }
            // The system itself sees the signal at once, and does what it does.
            _ => {}
        }
        Ok(())
    }

    /// Nobody can run: time goes on. `false` when the run is over.
    fn let_time_pass(&mut self) -> Result<bool, Halt> {
        let holds = self.threads.values().filter_map(Thread::hold);
        let deadline = holds.filter_map(|hold| hold.deadline).min();
        let mut until = [deadline, self.timers.next(), self.killed_at]
            .into_iter()
            .flatten()
            .min();
        let outside = self.outside_waits();
        if !outside.is_empty() || self.is_anybody_blocked() {
            let most = until.unwrap_or(u64::MAX).min(self.now + PACE);
            match self.wait_outside(&outside, most)? {
                Some(to) => until = Some(to),
                None => return Ok(true),
            }
        } else {
            self.paced = None;
        }
        if self.killed_at.is_some_and(|at| at <= self.now) {
            self.kill_all();
            return Ok(false);
        }
        let step = if self.killed_at.is_some() {
            until.map_or(Step::Never, Step::To)
        } else {
            self.world.advance(self.ports, self.now, until)?
        };
        match step {
            Step::To(to) => {
                self.now = self.now.max(to);
                self.happened += 1;
                self.fire_timers()?;
            }
            Step::Over => self.ask_to_end(Reason::Over),
            Step::Never => {
                let waits = self.waits_text();
                self.ask_to_end(Reason::Deadlock(waits));
            }
        }
        Ok(true)
    }

    fn is_anybody_blocked(&self) -> bool {
        let mut threads = self.threads.values();
        threads.any(|thread| matches!(thread.state, State::Blocked))
    }

    /// Waits for the world outside, no longer in real time than simulated time may go on; until when
    /// that may then go, or `None` if something has happened there.
    fn wait_outside(
        &mut self,
        waits: &[crate::traced::descriptor::Outside],
        most: u64,
    ) -> Result<Option<u64>, Halt> {
        for wait in waits {
            self.outside.insert(wait.name.clone());
        }
        let (begun, from) = *self.paced.get_or_insert((Instant::now(), self.now));
        let span = Duration::from_nanos(most.saturating_sub(from));
        // A thread in the kernel comes back without notice.
        let slice = if self.is_anybody_blocked() {
            Duration::from_millis(1)
        } else {
            span
        };
        loop {
            let left = span.saturating_sub(begun.elapsed()).min(slice);
            let found = crate::traced::descriptor::wait(waits, left)?;
            let mut news = found;
            while self.take_news(false)? {
                news = true;
            }
            if news {
                self.happened += 1;
                return Ok(None);
            }
            if begun.elapsed() >= span {
                return Ok(Some(most));
            }
            if self.is_over_time() {
                return Ok(Some(self.now));
            }
        }
    }

    /// The threads that wait and have not been looked at since something has happened, in order.
    pub(crate) fn unlooked(&self) -> Vec<Tid> {
        let happened = self.happened;
        let mut all: Vec<(u64, Tid)> = self
            .threads
            .iter()
            .filter(|(_, thread)| thread.hold().is_some_and(|hold| hold.looked_at < happened))
            .map(|(tid, thread)| (thread.number, *tid))
            .collect();
        all.sort_unstable();
        all.into_iter().map(|(_, tid)| tid).collect()
    }

    /// Marks a process as on its way out.
    pub(crate) fn is_dying(&mut self, pid: Tid) {
        if let Some(process) = self.processes.get_mut(&pid) {
            process.dying = true;
        }
    }
}

/// In which file a thread computes, which it does no more after that.
fn place_of(process: Tid, tid: Tid) -> Option<String> {
    sys::interrupt(tid).ok()?;
    sys::wait(Whom::One(tid), true).ok()?;
    let place = Registers::of(tid).ok()?.place();
    let maps = std::fs::read_to_string(format!("/proc/{process}/maps")).ok()?;
    let line = maps.lines().find(|line| {
        let ends = line
            .split_whitespace()
            .next()
            .and_then(|r| r.split_once('-'));
        ends.is_some_and(|(from, to)| {
            let number = |text| u64::from_str_radix(text, 16).unwrap_or(0);
            (number(from)..number(to)).contains(&place)
        })
    })?;
    line.split_whitespace().nth(5).map(str::to_owned)
}
