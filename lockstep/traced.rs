//! The mechanism: who runs and who waits, and what becomes of each call.

#[path = "traced/x86_64.rs"]
mod arch;
mod call;
mod clock;
mod descriptor;
mod entry;
mod futex;
mod memory;
mod poll;
mod spawn;
mod sys;
mod terminal;
mod timer;
mod tracer;
mod tree;
mod wait;

pub(crate) use tracer::run;
