//! Signals that interrupt waits.

use std::collections::BTreeSet;

use crate::traced::memory::Memory;
use crate::traced::poll_calls::write_left;
use crate::traced::proc::Signals;
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::{Entry, Halt, Handling, counted};
use crate::traced::tracer::Tracer;
use crate::traced::tree::State;
use crate::traced::wait::{Resume, Wait};

const FAULT: u64 = 1 << (libc::SIGSEGV - 1);

impl Tracer<'_> {
    /// A program sets or queries its action for SIGSEGV.
    pub(crate) fn fault_action(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let mut action = [0; 32];
        if entry.a[1] != 0 {
            Memory(entry.tid).read(entry.a[1], &mut action)?;
            self.tree.process(entry.process)?.on_fault = Some(action);
        }
        Ok(Handling::Make)
    }

    /// When an instruction faults while SIGSEGV is blocked or ignored, the kernel removes the handler and unblocks
    /// the signal. Reading the time stamp counter must have no such effect, so both are restored.
    pub(crate) fn restore_fault_action(&mut self, tid: Tid) -> Result<(), Halt> {
        let process = self.tree.process_of(tid);
        let action = self.tree.process(process)?.on_fault;
        let Some(action) = action.filter(|action| action[..8] != [0; 8]) else {
            return Ok(());
        };
        let Some(signals) = Signals::of(process, tid) else {
            return Ok(());
        };
        if (signals.caught | signals.ignored) & FAULT != 0 {
            return Ok(());
        }
        let signal = u64::from(libc::SIGSEGV.unsigned_abs());
        let arguments = |place| [signal, place, 0, 8, 0, 0];
        self.inject_with(tid, libc::SYS_rt_sigaction, |_| action.to_vec(), arguments)?;
        // SIG_IGN is 1; with a handler, the signal was blocked.
        if action[..8] != 1_u64.to_ne_bytes() {
            sys::set_blocked(tid, signals.blocked | FAULT)?;
        }
        Ok(())
    }

    /// Interrupts waits of threads that a signal has been sent to.
    pub(crate) fn interrupt_waits(&mut self) -> Result<(), Halt> {
        // A read that is made again must not find a sign of bytes that another thread has taken.
        for port in &mut *self.ports {
            port.top_up()?;
        }
        let mut served = BTreeSet::new();
        for tid in self.tree.all(|thread| thread.block().is_some()) {
            let Some(thread) = self.tree.threads.get(&tid) else {
                continue;
            };
            let Some(block) = thread.block() else {
                continue;
            };
            let process = thread.process;
            let Some(signals) = Signals::of(process, tid) else {
                continue;
            };
            let (set, mask) = match &block.wait {
                Wait::Signal { set, mask } => (*set, *mask),
                Wait::Poll { times, .. } => (None, times.mask),
                Wait::Vfork { .. } => continue,
                _ => (None, None),
            };
            let wanted = set.is_some_and(|set| signals.pending & set != 0);
            let interrupting = signals.interrupting(mask);
            // The first thread that takes a signal of the process gets it.
            if (wanted || interrupting != 0) && served.insert((process, interrupting)) {
                self.interrupt(tid)?;
            }
        }
        Ok(())
    }

    /// Ends a wait because of a signal, which comes when the thread goes on.
    pub(crate) fn interrupt(&mut self, tid: Tid) -> Result<(), Halt> {
        let now = self.now;
        let Some(thread) = self.tree.threads.get_mut(&tid) else {
            return Ok(());
        };
        let State::Blocked(block) =
            std::mem::replace(&mut thread.state, State::Ready(Resume::Go(0)))
        else {
            return Ok(());
        };
        let mut registers = block.registers;
        if let Wait::Poll { times, .. } = &block.wait {
            write_left(tid, *times, now);
        }
        match block.wait {
            Wait::Sleep { rest } => {
                let left = block.deadline.unwrap_or(now).saturating_sub(now);
                if let Some(address) = rest {
                    let (seconds, nanoseconds) = crate::traced::clock::parts(left);
                    // A wrong address is the program's.
                    let _ = Memory(tid).write_pair(address, seconds, nanoseconds);
                }
                registers.answer(tid, -i64::from(libc::EINTR))?;
            }
            Wait::Poll { times, .. } if times.mask.is_none() => {
                registers.answer(tid, -i64::from(libc::EINTR))?;
            }
            Wait::Transfer(rest) if rest.done > 0 => registers.answer(tid, counted(rest.done))?,
            Wait::PortWrite { sent, count, .. } if sent > 0 => {
                registers.answer(tid, counted(sent.min(count)))?;
            }
            Wait::PortRead { port, into, .. } if self.ports[port].unread() > 0 => {
                let received = self.receive(tid, port, &into)?;
                registers.answer(tid, received)?;
            }
            Wait::BackOff(resume) => thread.state = State::Ready(resume),
            Wait::Again(_) | Wait::Transfer(_) => {
                // At the syscall-exit stop; the system restarts the syscall or not, as for any signal.
                const ERESTARTSYS: i64 = 512;
                registers.set_result(-ERESTARTSYS);
                registers.set(tid)?;
            }
            // The system itself sees the signal at once, and does what it does.
            _ => {}
        }
        Ok(())
    }
}
