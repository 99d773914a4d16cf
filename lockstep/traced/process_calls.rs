//! Syscalls about other processes: signals and ends.

use crate::traced::arch::Syscall;
use crate::traced::memory::Memory;
use crate::traced::proc::kernel_state;
use crate::traced::sys;
use crate::traced::syscall::{Entry, Halt, Handling, int};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::Wait;

impl Tracer<'_> {
    pub(crate) fn signal_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let a = entry.a;
        let memory = Memory(entry.tid);
        let (set, mask, deadline) = match entry.call {
            Syscall::Pause => (None, None, None),
            Syscall::Sigsuspend => (None, Some(memory.read_u64(a[0])?), None),
            _ => {
                let deadline = self.deadline_at(entry.tid, a[2], None)?;
                (Some(memory.read_u64(a[0])?), None, deadline)
            }
        };
        if deadline.is_some_and(|deadline| deadline <= self.now) {
            return Ok(self.query(entry).unwrap_or(Handling::Make));
        }
        // One may wait already.
        self.schedule.signalled = true;
        Ok(Handling::Block(Wait::Signal { set, mask }, deadline))
    }

    /// After a signal has been sent, those that wait are polled; a process that SIGKILL ends is waited for.
    pub(crate) fn kill_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let signal = match entry.call {
            Syscall::Tgkill => entry.a[2],
            _ => entry.a[1],
        };
        let result = self.make(entry, entry.a)?;
        self.schedule.signalled = true;
        if int(signal) == libc::SIGKILL {
            self.find_dying();
        }
        Ok(Handling::Answer(result))
    }

    /// Marks the processes that were sent SIGKILL. They are gone before any other resumes. Their threads have
    /// left their stops.
    pub(crate) fn find_dying(&mut self) {
        for thread in &self.tree.threads {
            let (tid, Thread { process, state, .. }) = thread;
            let is_stopped = || matches!(kernel_state(*process, *tid), Some('t' | 'T'));
            if !matches!(state, State::Running | State::InKernel)
                && !is_stopped()
                && let Some(process) = self.tree.processes.get_mut(process)
            {
                process.dying = true;
            }
        }
    }

    pub(crate) fn exit_group(&mut self, entry: Entry) -> Handling {
        self.is_dying(entry.process);
        Handling::Make
    }

    pub(crate) fn exit(&mut self, entry: Entry) -> Handling {
        let Entry { tid, process, .. } = entry;
        let threads = self.tree.threads.values();
        if threads.filter(|thread| thread.process == process).count() == 1 {
            self.is_dying(process);
        } else if tid == process {
            // The end of the first thread of a process is reported only when the others have ended as well.
            self.tree.threads.remove(&tid);
            if sys::resume(tid, 0).is_ok() {
                while !matches!(kernel_state(process, tid), Some('Z' | 'X') | None) {
                    std::thread::yield_now();
                }
            }
            self.wake_changed_futexes();
        }
        Handling::Make
    }
}
