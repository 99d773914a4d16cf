//! The processor of a run: the tracer and its program never run at the same time, and wake each other up at
//! each syscall. That takes several times as long across processors.

use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

use crate::traced::sys::Tid;
use crate::traced::tree::Threads;

/// Number of turns after which the system may choose another processor.
const TURNS: u32 = 1000;

/// Processor of the tracer and its program. A refusal of the system costs only time.
pub(crate) struct Processor {
    /// Processors on which this thread might run before; `None` if there is no choice.
    all: Option<CpuSet>,
    /// Processor that all of them share; `None` while they may be anywhere.
    shared: Option<usize>,
    turns: u32,
}

impl Processor {
    pub(crate) fn new() -> Self {
        let all = sched_getaffinity(None).ok();
        Self {
            all: all.filter(|all| all.count() > 1),
            shared: None,
            turns: 0,
        }
    }

    /// A thread is about to run: on the processor of the tracer. Now and then, the tracer moves to the processor
    /// that the system chooses.
    pub(crate) fn share(&mut self, threads: &Threads) {
        let Some(all) = &self.all else {
            return;
        };
        match self.turns {
            0 => {
                let _ = sched_setaffinity(None, all);
            }
            1 => {
                let here = sched_getcpu();
                let mut one = CpuSet::new();
                one.set(here);
                let _ = sched_setaffinity(None, &one);
                if self.shared != Some(here) {
                    self.shared = Some(here);
                    place(threads, &one);
                }
            }
            _ => {}
        }
        self.turns = (self.turns + 1) % TURNS;
    }

    /// A thread computes for long, and may use any processor.
    pub(crate) fn free(&mut self, threads: &Threads) {
        if self.shared.take().is_some()
            && let Some(all) = self.all
        {
            place(threads, &all);
            self.turns = 0;
        }
    }
}

impl Drop for Processor {
    fn drop(&mut self) {
        if let Some(all) = &self.all {
            let _ = sched_setaffinity(None, all);
        }
    }
}

fn place(threads: &Threads, on: &CpuSet) {
    let raw = |tid: &Tid| Pid::from_raw(*tid);
    for tid in threads.keys().filter_map(raw) {
        // The end of a thread is reported separately.
        let _ = sched_setaffinity(Some(tid), on);
    }
}
