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
        let (tid, call, a) = (entry.tid, entry.call, entry.a);
        let mut tried = entry.registers;
        let mut restore = None;
        let mut deadline = None;
        let mut would_wait: &'static [i32] = &[libc::EAGAIN];
        // Where the flag is by which it does not wait.
        let flag = match call {
            Syscall::Flock => Some((1, libc::LOCK_NB)),
            Syscall::Msgsnd => Some((3, libc::IPC_NOWAIT)),
            Syscall::Msgrcv => Some((4, libc::IPC_NOWAIT)),
            _ => None,
        };
        if let Some((index, flag)) = flag {
            let flag = u64::from(flag.unsigned_abs());
            if a[index] & flag != 0 {
                return Ok(Handling::Make);
            }
            tried.set_argument(index, a[index] | flag);
        }
        match call {
            Syscall::Flock | Syscall::Msgsnd => {}
            Syscall::Msgrcv => would_wait = &[libc::ENOMSG],
            Syscall::Fcntl => {
                // The commands that do not wait come before those that do.
                tried.set_argument(1, a[1] - 1);
                would_wait = &[libc::EAGAIN, libc::EACCES];
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
                // One of them that must not wait is enough. IPC_NOWAIT is 0o4000.
                if bytes.chunks_exact(LENGTH).any(|one| one[5] & 0x08 != 0) {
                    return Ok(Handling::Make);
                }
                restore = Some((a[1], bytes.clone()));
                for one in bytes.chunks_exact_mut(LENGTH) {
                    one[5] |= 0x08;
                }
                Memory(tid).write(a[1], &bytes)?;
                if call == Syscall::Semtimedop && a[3] != 0 {
                    deadline = span(Memory(tid).read_pair(a[3])?)
                        .map(|time| self.now.saturating_add(time));
                }
            }
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
