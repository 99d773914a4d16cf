//! The time stamp counter of the tracer's thread.
//!
//! A client cannot read the counter. A switch between threads with and without that right takes the kernel longer
//! than the rest of a stop on a virtual machine. So the tracer, too, gives up the right while clients run. When it
//! reads the counter nevertheless, for example through the system's clocks, it gets the right back until it waits
//! for the next stop.

use std::cell::Cell;
use std::ptr;
use std::sync::OnceLock;

use rustix::process::{
    TimeStampCounterReadability as Readability, set_time_stamp_counter_readability,
    time_stamp_counter_readability,
};

#[derive(Clone, Copy, PartialEq)]
enum State {
    /// This thread traces nothing.
    Free,
    Readable,
    Hidden,
}

thread_local! {
    static STATE: Cell<State> = const { Cell::new(State::Free) };
}

/// The earlier handler of faults.
static BEFORE: OnceLock<libc::sigaction> = OnceLock::new();

/// A thread that traces, until this is dropped.
pub(crate) struct Counter;

impl Counter {
    pub(crate) fn of_tracer() -> Self {
        BEFORE.get_or_init(|| {
            // SAFETY: all fields of the structure may be zero, and the query only fills it.
            let mut before: libc::sigaction = unsafe { std::mem::zeroed() };
            // SAFETY: the same.
            unsafe { libc::sigaction(libc::SIGSEGV, ptr::null(), &raw mut before) };
            before
        });
        // SAFETY: the handler makes plain syscalls only and takes no lock and no memory; all fields of the
        // structure may be zero.
        unsafe {
            let mut action: libc::sigaction = std::mem::zeroed();
            action.sa_sigaction = faulted as extern "C" fn(i32) as usize;
            action.sa_flags = libc::SA_ONSTACK;
            libc::sigaction(libc::SIGSEGV, &raw const action, ptr::null_mut());
        }
        STATE.set(State::Readable);
        Self
    }
}

impl Drop for Counter {
    fn drop(&mut self) {
        STATE.set(State::Free);
        let _ = set_time_stamp_counter_readability(Readability::Readable);
    }
}

/// A thread that traces is about to wait.
pub(crate) fn hide() {
    // A refusal costs only time.
    if STATE.get() == State::Readable
        && set_time_stamp_counter_readability(Readability::RaiseSIGSEGV).is_ok()
    {
        STATE.set(State::Hidden);
    }
}

/// Makes the counter readable, or restores the earlier handler; then the instruction is repeated.
extern "C" fn faulted(_signal: i32) {
    if time_stamp_counter_readability() == Ok(Readability::RaiseSIGSEGV) {
        let _ = set_time_stamp_counter_readability(Readability::Readable);
        // A thread that this one has started has it from here, and traces nothing.
        if STATE.get() == State::Hidden {
            STATE.set(State::Readable);
        }
    } else if let Some(before) = BEFORE.get() {
        // SAFETY: the structure is as the system filled it, and only read.
        unsafe { libc::sigaction(libc::SIGSEGV, before, ptr::null_mut()) };
    }
}
