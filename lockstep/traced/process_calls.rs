//! Calls about other processes: signals and ends.

use crate::traced::arch::Call;
use crate::traced::clock::span;
use crate::traced::descriptor::info_of;
use crate::traced::entry::{Entry, int};
use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid};
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::tree::{AtEnd, kernel_state};
use crate::traced::wait::Wait;

impl Tracer<'_> {
    pub(crate) fn signal_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let a = entry.a;
        let memory = Memory(entry.tid);
        let (set, mask, deadline) = match entry.call {
            Call::Pause => (None, None, None),
            Call::Sigsuspend => (None, Some(memory.read_u64(a[0])?), None),
            _ => {
                let deadline = match a[2] {
                    0 => None,
                    address => match span(memory.read_pair(address)?) {
                        Some(time) => Some(self.now.saturating_add(time)),
                        None => return Ok(Handling::Make),
                    },
                };
                (Some(memory.read_u64(a[0])?), None, deadline)
            }
        };
        // One may wait already.
        self.signalled = true;
        Ok(Handling::Hold(Wait::Signal { set, mask }, deadline))
    }

    pub(crate) fn kill_call(&mut self, entry: Entry) -> Handling {
        let a = entry.a;
        let (target, signal) = match entry.call {
            Call::Kill => (int(a[0]), int(a[1])),
            Call::Tgkill => (int(a[0]), int(a[2])),
            _ => {
                let pid = info_of(entry.process, int(a[0]), "Pid:");
                (pid.unwrap_or(0), int(a[1]))
            }
        };
        Handling::ToEnd(entry.registers, AtEnd::Kill { target, signal })
    }

    /// Those whom SIGKILL has been sent to are gone before anybody goes on.
    pub(crate) fn expect_deaths(&mut self, sender: Tid, target: Tid) {
        let group = match target {
            1.. => return self.is_dying(target),
            0 => sys::group_of(sender),
            -1 => None,
            _ => Some(-target),
        };
        let all: Vec<Tid> = self.processes.keys().copied().collect();
        for pid in all {
            let hit = match group {
                Some(group) => sys::group_of(pid) == Some(group),
                None => pid != sender,
            };
            if hit {
                self.is_dying(pid);
            }
        }
    }

    /// A thread ends itself.
    pub(crate) fn exit(&mut self, tid: Tid, process: Tid) -> Handling {
        let threads = self.threads.values();
        if threads.filter(|thread| thread.process == process).count() == 1 {
            self.is_dying(process);
        } else if tid == process {
            // The first thread of a process is told of only when the others have ended as well.
            self.threads.remove(&tid);
            if sys::go_on(tid, 0).is_ok() {
                while !matches!(kernel_state(process, tid), Some('Z' | 'X') | None) {
                    std::thread::yield_now();
                }
            }
            self.wake_changed_futexes();
        }
        Handling::Make
    }
}
