//! A syscall at which a thread is stopped, and how it is handled.

use std::io;

use syscalls::Sysno;

use crate::traced::arch::{Registers, Syscall};
use crate::traced::sys::Tid;
use crate::traced::wait::Wait;
use crate::{Broken, Error};

/// A thread at a syscall-entry stop.
#[derive(Clone, Copy)]
pub(crate) struct Entry {
    pub(crate) tid: Tid,
    pub(crate) process: Tid,
    pub(crate) call: Syscall,
    pub(crate) registers: Registers,
    pub(crate) a: [u64; 6],
    /// It has backed off.
    pub(crate) backed_off: bool,
}

/// Ends the run early.
pub(crate) enum Halt {
    Failed(Error),
    /// The system has lost the thread at hand, which has been killed; its end will be reported.
    Gone,
    /// The kernel executes the syscall, for example one with a wrong address.
    Make,
    /// The tracer has injected other syscalls, so the thread's own syscall must be repeated.
    Again,
}

impl From<io::Error> for Halt {
    fn from(error: io::Error) -> Self {
        if error.raw_os_error() == Some(libc::ESRCH) {
            return Self::Gone;
        }
        if error.raw_os_error() == Some(libc::EFAULT) {
            return Self::Make;
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

/// Handling of a syscall.
pub(crate) enum Handling {
    Make,
    /// It is skipped, and returns this.
    Answer(i64),
    /// It blocks, at most until then.
    Block(Wait, Option<u64>),
}

pub(crate) fn call_name(number: i64) -> String {
    let call = usize::try_from(number).ok().and_then(Sysno::new);
    call.map_or_else(
        || format!("syscall {number}"),
        |call| call.name().to_owned(),
    )
}

pub(crate) fn low(number: u64) -> u32 {
    u32::try_from(number & 0xFFFF_FFFF).unwrap_or_default()
}

pub(crate) fn int(number: u64) -> i32 {
    low(number).cast_signed()
}

pub(crate) fn failure(errno: i32) -> Handling {
    Handling::Answer(-i64::from(errno))
}

/// The result of a syscall that returns a count.
pub(crate) fn counted(number: usize) -> i64 {
    i64::try_from(number).unwrap_or(i64::MAX)
}
