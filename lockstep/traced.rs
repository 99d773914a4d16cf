//! The mechanism: which thread runs and which waits, and how each syscall is handled.

#[path = "traced/x86_64.rs"]
mod arch;
mod clock;
mod clock_calls;
mod closing;
mod descriptor;
mod descriptors;
mod ending;
mod entry;
mod futex;
mod in_parts;
mod inject;
mod limits;
mod loading;
mod memory;
mod one_processor;
mod outside;
mod passage;
mod passing;
mod poll_calls;
mod proc;
mod process_calls;
mod processor;
mod retried;
mod signals;
mod spawn;
mod stops;
mod sys;
mod syscall;
mod terminal;
mod timer_calls;
mod timers;
mod tracer;
mod transfers;
mod tree;
mod turns;
mod wait;
mod wait_polls;
mod words;

pub use tracer::run;
