//! Waits of a thread.

use std::rc::Rc;

use rustix::event::PollFlags;

use crate::port::ReadRule;
use crate::traced::arch::Registers;
use crate::traced::descriptor::Descriptor;

pub(crate) struct Block {
    /// Registers at the syscall-entry stop.
    pub(crate) registers: Registers,
    pub(crate) wait: Wait,
    /// Time that the program has asked for; see [`Block::ends`].
    pub(crate) deadline: Option<u64>,
    /// The order in which waits began.
    pub(crate) since: u64,
    /// Count of events at its last poll.
    pub(crate) polled_at: u64,
}

/// Delay of the end of a wait after its deadline, the kernel's default timer slack (`PR_SET_TIMERSLACK`).
/// Programs rely on it: `while (now <= end) wait(end - now)`.
pub(crate) const SLACK: u64 = 50_000;

impl Block {
    /// Its deadline.
    pub(crate) fn ends(&self) -> Option<u64> {
        let slack = if matches!(self.wait, Wait::BackOff(_)) {
            0
        } else {
            SLACK
        };
        self.deadline.map(|deadline| deadline.saturating_add(slack))
    }
}

/// How a thread resumes.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Resume {
    Go(i32),
    /// Its syscall is still to be handled. `backed_off` says that it has.
    Syscall {
        backed_off: bool,
    },
    /// It is at an instruction that reads the time stamp counter.
    TimeStamp {
        length: u64,
    },
}

/// Event that ends a wait, beside its deadline and signals.
pub(crate) enum Wait {
    /// Nothing else. The address for the remaining time if it is interrupted.
    Sleep {
        rest: Option<u64>,
    },
    /// A back-off: only time. How the thread resumes then.
    BackOff(Resume),
    /// One of these descriptors, with these poll flags.
    Poll {
        set: Vec<Awaited>,
        result: PollResult,
        times: Times,
    },
    PortRead {
        port: usize,
        device: u64,
        /// Bytes that have been there.
        seen: usize,
        rule: ReadRule,
        /// Places where they go.
        into: Vec<(u64, u64)>,
    },
    /// Room on the line for the rest of what is written.
    PortWrite {
        port: usize,
        device: u64,
        bytes: Vec<u8>,
        sent: usize,
        /// Value that the syscall returns when all have been sent.
        count: usize,
    },
    /// A read or write, or the rest of one, of what is not a port.
    Transfer(Rest),
    /// A futex: another thread wakes those that wait there.
    Futex {
        key: FutexKey,
        address: u64,
        expected: u32,
        bits: u32,
    },
    Signal {
        set: Option<u64>,
        mask: Option<u64>,
    },
    /// Any event of another thread; then the syscall is retried. The thread is at a syscall-exit stop.
    Again(Retried),
    /// The child of `vfork`, until it has its own memory.
    Vfork {
        child: i32,
    },
    Forever,
}

/// Times and signals of a poll.
#[derive(Clone, Copy, Default)]
pub(crate) struct Times {
    pub(crate) deadline: Option<u64>,
    /// Signals that are blocked meanwhile in the place of others.
    pub(crate) mask: Option<u64>,
    /// Address for the remaining time, if any, and whether it is in microseconds.
    pub(crate) left: (u64, bool),
}

/// A descriptor that is waited for. Its file stays the one at the beginning of the wait.
pub(crate) struct Awaited {
    pub(crate) fd: i32,
    pub(crate) flags: PollFlags,
    /// `None` if there is none, or one that cannot be known.
    pub(crate) file: Option<Rc<Descriptor>>,
}

/// A transfer, of which a part may have been made.
#[derive(Clone)]
pub(crate) struct Rest {
    pub(crate) of: Rc<Descriptor>,
    /// What a poll finds when there may be more.
    pub(crate) flags: PollFlags,
    /// Number and arguments of the syscall while nothing has been transferred.
    pub(crate) whole: (i64, [u64; 6]),
    /// The same of the one that transfers one part of what is left.
    pub(crate) of_part: (i64, [u64; 6]),
    /// Parts of memory, or how many messages or bytes of a file.
    pub(crate) parts: Vec<(u64, u64)>,
    pub(crate) done: usize,
    /// Time from which a part of it is enough.
    pub(crate) enough: Option<u64>,
}

/// A syscall that is made without blocking, and retried after other events.
pub(crate) struct Retried {
    /// Its number and arguments.
    pub(crate) call: (i64, [u64; 6]),
    /// Bytes for the second argument, or for the one that receives the result, in place of the program's.
    pub(crate) memory: Vec<u8>,
    /// Results that mean that it would block.
    pub(crate) would_wait: &'static [i32],
    /// Address of a word that is not 0 once it has found something; 0 if that is in `memory`.
    pub(crate) found: Option<u64>,
    /// Count of what had happened to processes when it was last made.
    pub(crate) seen: Option<u64>,
    /// Value that it returns at the deadline.
    pub(crate) late: i32,
}

/// Place of a poll's result.
pub(crate) enum PollResult {
    /// `revents` in these descriptions of descriptors, which lie there.
    Revents { address: u64, entries: Vec<u8> },
    /// Three sets of so many bytes.
    Sets { sets: [u64; 3], bytes: usize },
    /// So many events of an epoll at most, which go there.
    Events { address: u64, most: usize },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum FutexKey {
    /// An address in a memory.
    Private(u64, u64),
    /// A place in a file that several memories share: device, inode, offset.
    Shared(u64, u64, u64),
}
