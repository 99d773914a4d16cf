//! The processes and threads of a run, and what each of them is at.

use std::collections::BTreeMap;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::Duration;

use crate::traced::arch::{Registers, Vdso};
use crate::traced::descriptor::Files;
use crate::traced::sys::{self, Tid};
use crate::traced::wait::Hold;

pub(crate) struct Process {
    /// Memory that it has: a child of `vfork` has its parent's.
    pub(crate) memory: u64,
    /// Its handle, where the system gives one.
    pub(crate) handle: Option<OwnedFd>,
    pub(crate) files: Files,
    /// It is on its way out, and no other runs until it has gone.
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
    /// Measures the processor time that it has used, which cannot be done when it has gone.
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

/// Time that such clocks show, and number of times that they may be read without a call.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shown {
    pub(crate) real: u64,
    pub(crate) monotonic: u64,
    pub(crate) asks: u32,
}

pub(crate) struct Thread {
    /// Its place among all threads of the run, in the order in which they began.
    pub(crate) number: u64,
    pub(crate) process: Tid,
    pub(crate) state: State,
    /// Turn: who gives way is behind the others.
    pub(crate) turn: u64,
    /// Calls in a row that only asked, and waited for nothing.
    pub(crate) asks: u32,
    /// It has been interrupted because it computed for long.
    pub(crate) preempted: bool,
    /// It makes a call again that may have to wait on; that alone changes nothing for others.
    pub(crate) retries: bool,
    /// The deadline of a wait that is a call made again.
    pub(crate) again_until: Option<u64>,
    /// Thing to look at when the call that it is in comes to its end.
    pub(crate) at_end: Option<AtEnd>,
}

pub(crate) enum State {
    Running,
    /// It is stopped, and goes on when it is its turn.
    Ready(Resume),
    Held(Box<Hold>),
    /// Job control has stopped it.
    Stopped,
    /// It waits in the kernel for something that is not known, outside of what is simulated.
    Blocked,
}

/// Way in which a thread goes on.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Resume {
    Go(i32),
    /// Its call is still to be looked at. `crept` says that it has paid for its asking.
    Call {
        crept: bool,
    },
    /// It is at an instruction that reads the time stamp counter.
    TimeStamp {
        length: u64,
    },
}

/// Thing to do at the end of a call.
pub(crate) enum AtEnd {
    /// A wait for a child, made without waiting; as its registers were.
    Child(Registers),
    /// Some other call, made without waiting, which says with one of these that it would have to;
    /// and memory to put back.
    Again {
        before: Registers,
        would_wait: &'static [i32],
        restore: Option<(u64, Vec<u8>)>,
        deadline: Option<u64>,
        late: i64,
    },
    /// An argument has been changed for the call alone; as its registers were.
    Restore(Registers),
    /// A new program has been loaded, whose clocks have to have a page.
    Loaded(Vdso),
    /// `sysinfo` has written how long the system has run.
    Uptime(u64),
    /// `adjtimex` has written the time.
    Adjusted(u64),
    TimerCreate {
        address: u64,
        event: TimerEvent,
    },
    /// A signal has been sent; a process that SIGKILL ends is waited for.
    Kill {
        signal: i32,
    },
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
            asks: 0,
            preempted: false,
            retries: false,
            again_until: None,
            at_end: None,
        }
    }

    pub(crate) fn is_ready(&self) -> bool {
        matches!(self.state, State::Ready(_))
    }

    pub(crate) fn is_running(&self) -> bool {
        matches!(self.state, State::Running)
    }

    pub(crate) fn hold(&self) -> Option<&Hold> {
        match &self.state {
            State::Held(hold) => Some(hold),
            _ => None,
        }
    }
}

pub(crate) type Threads = BTreeMap<Tid, Thread>;

pub(crate) fn name_of(tid: Tid) -> String {
    let name = std::fs::read_to_string(format!("/proc/{tid}/comm")).unwrap_or_default();
    name.trim_end().to_owned()
}

/// The number of a thread in the namespace that its process is in.
pub(crate) fn own_number_of(process: Tid, tid: Tid) -> Option<Tid> {
    let status = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/status")).ok()?;
    let numbers = status
        .lines()
        .find_map(|line| line.strip_prefix("NSpid:"))?;
    numbers.split_whitespace().last()?.parse().ok()
}

/// The letter that says what the kernel has a thread do.
pub(crate) fn kernel_state(process: Tid, tid: Tid) -> Option<char> {
    let stat = std::fs::read_to_string(format!("/proc/{process}/task/{tid}/stat")).ok()?;
    // The name before it is in parentheses, and may hold any character.
    stat.rsplit_once(')')?.1.trim_start().chars().next()
}

/// The part of a process's memory that holds an address: where it begins, and what the system says of
/// it (`proc_pid_maps(5)`) from its rights on.
pub(crate) fn mapping(process: Tid, address: u64) -> Option<(u64, String)> {
    let maps = std::fs::read_to_string(format!("/proc/{process}/maps")).ok()?;
    maps.lines().find_map(|line| {
        let (ends, rest) = line.split_once(' ')?;
        let (from, to) = ends.split_once('-')?;
        let (from, to) = (number(from)?, number(to)?);
        (from..to)
            .contains(&address)
            .then(|| (from, rest.to_owned()))
    })
}

/// A number as the system writes addresses.
pub(crate) fn number(text: &str) -> Option<u64> {
    u64::from_str_radix(text, 16).ok()
}

pub(crate) fn path_of(process: Tid, fd: i32) -> Option<PathBuf> {
    std::fs::read_link(format!("/proc/{process}/fd/{fd}")).ok()
}
