//! Syscalls that are made without waiting, and again when something has happened: children, locks, queues.

use crate::traced::arch::{Registers, Syscall};
use crate::traced::clock::span;
use crate::traced::memory::Memory;
use crate::traced::syscall::{Entry, Halt, Handling};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{AtEnd, Retried};

impl Tracer<'_> {
    /// A wait for a child is made without waiting, and again when something has happened.
    pub(crate) fn child_call(&mut self, entry: Entry) -> Handling {
        let index = if entry.call == Syscall::Wait4 { 2 } else { 3 };
        let options = entry.a[index];
        let at_once = u64::from(libc::WNOHANG.unsigned_abs());
        if options & at_once != 0 {
            return self.query(entry).unwrap_or(Handling::Make);
        }
        let mut tried = entry.registers;
        tried.set_argument(index, options | at_once);
        Handling::ToEnd(tried, AtEnd::Child(entry.registers))
    }

    /// Locks and queues, likewise.
    pub(crate) fn lock_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let (tid, call, registers, a) = (entry.tid, entry.call, entry.registers, entry.a);
        let no_wait = u64::from(libc::IPC_NOWAIT.unsigned_abs());
        let mut tried = registers;
        let mut restore = None;
        let mut deadline = None;
        let mut would_wait: &'static [i32] = &[libc::EAGAIN];
        match call {
            Syscall::Flock => tried.set_argument(1, a[1] | u64::from(libc::LOCK_NB.unsigned_abs())),
            Syscall::Fcntl => {
                // The commands that do not wait come before those that do.
                tried.set_argument(1, a[1] - 1);
                would_wait = &[libc::EAGAIN, libc::EACCES];
            }
            Syscall::Msgsnd => tried.set_argument(3, a[3] | no_wait),
            Syscall::Msgrcv => {
                tried.set_argument(4, a[4] | no_wait);
                would_wait = &[libc::ENOMSG];
            }
            _ => {
                /// The length of a `sembuf`: number, operation, flags of two bytes each.
                const LENGTH: usize = 6;
                let count = usize::try_from(a[2]).unwrap_or(usize::MAX);
                if count > 500 {
                    return Ok(Handling::Make);
                }
                let mut bytes = vec![0; LENGTH * count];
                Memory(tid).read(a[1], &mut bytes)?;
                let before = bytes.clone();
                for one in bytes.chunks_exact_mut(LENGTH) {
                    // IPC_NOWAIT is 0o4000.
                    if let Some(high) = one.get_mut(5) {
                        *high |= 0x08;
                    }
                }
                Memory(tid).write(a[1], &bytes)?;
                restore = Some((a[1], before));
                if call == Syscall::Semtimedop && a[3] != 0 {
                    deadline = span(Memory(tid).read_pair(a[3])?)
                        .map(|time| self.now.saturating_add(time));
                }
            }
        }
        let asked_not_to_wait = match call {
            Syscall::Flock => a[1] & u64::from(libc::LOCK_NB.unsigned_abs()) != 0,
            Syscall::Msgsnd => a[3] & no_wait != 0,
            Syscall::Msgrcv => a[4] & no_wait != 0,
            // One of them that must not wait is enough.
            Syscall::Semop | Syscall::Semtimedop => restore
                .as_ref()
                .is_some_and(|(_, before)| before.chunks(6).any(|one| one[5] & 0x08 != 0)),
            _ => false,
        };
        if asked_not_to_wait {
            would_wait = &[];
        }
        let end = Retried {
            would_wait,
            restore,
            deadline,
            late: -i64::from(libc::EAGAIN),
        };
        self.try_call(entry, tried, end)
    }

    /// Makes a syscall with these registers, by which it does not wait, and again when something has happened.
    pub(crate) fn try_call(
        &mut self,
        entry: Entry,
        tried: Registers,
        mut end: Retried,
    ) -> Result<Handling, Halt> {
        // A wait that has begun before goes on to its own deadline.
        let before = self.tree.thread(entry.tid)?.again_until.take();
        end.deadline = before.or(end.deadline);
        Ok(Handling::ToEnd(tried, AtEnd::Again(entry.registers, end)))
    }
}
