//! The processes and threads of a run, and what each of them is at.

use std::collections::{BTreeMap, BTreeSet};
use std::io;
use std::os::fd::OwnedFd;
use std::rc::Rc;
use std::time::Duration;

use rustix::process::{Pid, PidfdFlags};

use crate::traced::arch::Shared;
use crate::traced::descriptor::Files;
use crate::traced::sys::{self, Tid};
use crate::traced::wait::{Block, Resume};

pub(crate) struct Process {
    /// Memory that it has: a child of `vfork` has its parent's.
    pub(crate) memory: u64,
    /// Its handle, where the system gives one.
    pub(crate) handle: Option<OwnedFd>,
    pub(crate) files: Files,
    /// It is exiting, and no other runs until it has gone.
    pub(crate) dying: bool,
    pub(crate) clocks: Option<OwnClocks>,
    /// Processor time that it had used when that was last measured.
    pub(crate) used: Duration,
    /// An instruction `syscall` in its memory.
    pub(crate) gate: Option<u64>,
    /// Its action for SIGSEGV, as the kernel has it, if it has set one.
    pub(crate) on_fault: Option<[u8; 32]>,
}

impl Process {
    /// Measures its processor time, which is not possible after its end.
    pub(crate) fn measure(&mut self, pid: Tid) {
        self.used = sys::processor_time(sys::clock_of_process(pid)).unwrap_or(self.used);
    }
}

/// Clocks that a program reads in its own memory.
#[derive(Clone, Copy)]
pub(crate) struct OwnClocks {
    pub(crate) page: u64,
    /// Clocks that were last written there.
    pub(crate) shown: Option<Shown>,
}

/// Time that such clocks show, and number of times that they may be read without a syscall.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) real: u64,
    pub(crate) monotonic: u64,
    pub(crate) queries: u32,
}

pub(crate) struct Thread {
    /// Its place among all threads of the run, in the order in which they began.
    pub(crate) number: u64,
    pub(crate) process: Tid,
    pub(crate) state: State,
    /// Its place in the order of turns; a thread that yields goes last.
    pub(crate) turn: u64,
    /// Simulated time if each of its queries cost time.
    pub(crate) paid: u64,
    /// It has been interrupted because it computed for long.
    pub(crate) preempted: bool,
    /// Number of the descriptor that its syscall is for, since another thread has closed the one it names.
    pub(crate) kept: Option<u64>,
}

pub(crate) enum State {
    Running,
    /// It is stopped, and goes on when it is its turn.
    Ready(Resume),
    Blocked(Box<Block>),
    /// Job control has stopped it.
    Stopped,
    /// It has slept in the kernel for long, and waits for something outside of what is simulated.
    InKernel,
}

/// Signal of a POSIX timer whose time has come.
#[derive(Debug, Clone, Copy)]
pub(crate) struct TimerEvent {
    pub(crate) signal: Option<i32>,
    pub(crate) thread: Option<Tid>,
    /// Its own number, unless the program has given another.
    pub(crate) value: Option<u64>,
}

impl Thread {
    pub(crate) fn new(number: u64, process: Tid, state: State) -> Self {
        Self {
            number,
            process,
            state,
            turn: 0,
            paid: 0,
            preempted: false,
            kept: None,
        }
    }

    pub(crate) fn is_ready(&self) -> bool {
        matches!(self.state, State::Ready(_))
    }

    pub(crate) fn is_running(&self) -> bool {
        matches!(self.state, State::Running)
    }

    pub(crate) fn block(&self) -> Option<&Block> {
        match &self.state {
            State::Blocked(block) => Some(block),
            _ => None,
        }
    }
}

pub(crate) type Threads = BTreeMap<Tid, Thread>;

/// All processes and threads of a run.
pub(crate) struct Tree {
    /// The first process, whose end is that of the run.
    pub(crate) main: Tid,
    pub(crate) threads: Threads,
    pub(crate) processes: BTreeMap<Tid, Process>,
    /// Threads that have stopped for the first time before their parent has stopped for them.
    pub(crate) early: BTreeSet<Tid>,
    /// Processes that have ended and may be left for this program to reap.
    pub(crate) ended: Vec<Tid>,
    /// Threads and memories that have begun.
    threads_begun: u64,
    memories_begun: u64,
}

impl Tree {
    /// A process with one thread, which runs.
    pub(crate) fn new(main: Tid) -> Self {
        let mut tree = Self {
            main,
            threads: Threads::new(),
            processes: BTreeMap::new(),
            early: BTreeSet::new(),
            ended: Vec::new(),
            threads_begun: 0,
            memories_begun: 0,
        };
        tree.add_process(main, None, Shared::default());
        tree.add_thread(main, main, State::Running);
        tree
    }

    /// A thread, or the error that the system has for one that has gone.
    pub(crate) fn thread(&mut self, tid: Tid) -> io::Result<&mut Thread> {
        self.threads.get_mut(&tid).ok_or_else(gone)
    }

    pub(crate) fn process(&mut self, pid: Tid) -> io::Result<&mut Process> {
        self.processes.get_mut(&pid).ok_or_else(gone)
    }

    pub(crate) fn process_of(&self, tid: Tid) -> Tid {
        self.threads.get(&tid).map_or(tid, |thread| thread.process)
    }

    pub(crate) fn add_process(&mut self, pid: Tid, parent: Option<Tid>, shared: Shared) {
        let new_memory = self.new_memory();
        let parent = parent.and_then(|parent| self.processes.get(&parent));
        let memory = parent.filter(|_| shared.memory).map(|one| one.memory);
        let files = parent.filter(|_| shared.files).map(|one| &one.files);
        let process = Process {
            memory: memory.unwrap_or(new_memory),
            handle: Pid::from_raw(pid)
                .and_then(|pid| rustix::process::pidfd_open(pid, PidfdFlags::empty()).ok()),
            files: files.map(Rc::clone).unwrap_or_default(),
            dying: false,
            clocks: parent.and_then(|parent| parent.clocks),
            used: Duration::ZERO,
            gate: parent.and_then(|parent| parent.gate),
            on_fault: parent.and_then(|parent| parent.on_fault),
        };
        self.processes.insert(pid, process);
    }

    pub(crate) fn new_memory(&mut self) -> u64 {
        self.memories_begun += 1;
        self.memories_begun
    }

    pub(crate) fn add_thread(&mut self, tid: Tid, process: Tid, state: State) {
        self.threads_begun += 1;
        let thread = Thread::new(self.threads_begun, process, state);
        self.threads.insert(tid, thread);
    }

    pub(crate) fn set_state(&mut self, tid: Tid, state: State) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.state = state;
        }
    }

    /// The threads of which that holds, in the order in which they began.
    pub(crate) fn all(&self, so: impl Fn(&Thread) -> bool) -> Vec<Tid> {
        let all = self.threads.iter().filter(|(_, thread)| so(thread));
        let mut all: Vec<(u64, Tid)> = all.map(|(tid, one)| (one.number, *tid)).collect();
        all.sort_unstable();
        all.into_iter().map(|(_, tid)| tid).collect()
    }

    /// The wait of a thread.
    pub(crate) fn block_of(&mut self, tid: Tid) -> Option<&mut Block> {
        match &mut self.threads.get_mut(&tid)?.state {
            State::Blocked(block) => Some(block),
            _ => None,
        }
    }
}

fn gone() -> io::Error {
    io::Error::from_raw_os_error(libc::ESRCH)
}
