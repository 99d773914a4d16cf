//! The processor of a run: the tracer and its program never run at the same time and wake each
//! other up at each call, which takes several times as long from one processor to another.

use rustix::process::Pid;
use rustix::thread::{CpuSet, sched_getaffinity, sched_getcpu, sched_setaffinity};

use crate::traced::sys::Tid;
use crate::traced::tracer::Tracer;

/// After so many turns the system may choose another processor.
const TURNS: u32 = 1000;

/// Processor of the tracer and its program. What the system refuses here costs time alone.
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
}

impl Drop for Processor {
    fn drop(&mut self) {
        if let Some(all) = &self.all {
            let _ = sched_setaffinity(None, all);
        }
    }
}

impl Tracer<'_> {
    /// A thread is about to run: on the processor of the tracer. Now and then that is where the
    /// system wakes it up when it is free to choose.
    pub(crate) fn share_processor(&mut self) {
        let Some(all) = &self.processor.all else {
            return;
        };
        match self.processor.turns {
            0 => {
                let _ = sched_setaffinity(None, all);
            }
            1 => {
                let here = sched_getcpu();
                let mut one = CpuSet::new();
                one.set(here);
                let _ = sched_setaffinity(None, &one);
                if self.processor.shared != Some(here) {
                    self.processor.shared = Some(here);
                    self.place_threads(&one);
                }
            }
            _ => {}
        }
        self.processor.turns = (self.processor.turns + 1) % TURNS;
    }

    /// A thread computes for long, and may do so wherever there is time.
    pub(crate) fn free_processor(&mut self) {
        if self.processor.shared.take().is_some()
            && let Some(all) = self.processor.all
        {
            self.place_threads(&all);
            self.processor.turns = 0;
        }
    }

    fn place_threads(&self, processors: &CpuSet) {
        let raw = |tid: &Tid| Pid::from_raw(*tid);
        for tid in self.threads.keys().filter_map(raw) {
            // A thread that has gone meanwhile is reported otherwise.
            let _ = sched_setaffinity(Some(tid), processors);
        }
    }
}
