//! Syscalls that are made without waiting, and again when something has happened: children, locks, queues.

use crate::traced::arch::{Registers, Syscall};
use crate::traced::clock::span;
use crate::traced::memory::Memory;
use crate::traced::syscall::{Entry, Halt, Handling};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{AtEnd, Retried};

impl Tracer<'_> {
    pub(crate) fn retried_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let Entry { tid, call, a, .. } = entry;
        // The flag by which it does not wait, and results by which it says that it would have to.
        let (index, flag, would_wait): (_, _, &'static [i32]) = match call {
            Syscall::Wait4 => (2, libc::WNOHANG, &[0]),
            Syscall::Waitid => (3, libc::WNOHANG, &[0]),
            Syscall::Flock => (1, libc::LOCK_NB, &[-libc::EAGAIN]),
            Syscall::Msgsnd => (3, libc::IPC_NOWAIT, &[-libc::EAGAIN]),
            Syscall::Msgrcv => (4, libc::IPC_NOWAIT, &[-libc::ENOMSG]),
            Syscall::Fcntl => (1, 0, &[-libc::EAGAIN, -libc::EACCES]),
            _ => (0, 0, &[-libc::EAGAIN]),
        };
        let flag = u64::from(flag.unsigned_abs());
        if a[index] & flag != 0 {
            return Ok(self.query(entry).unwrap_or(Handling::Make));
        }
        let mut tried = entry.registers;
        tried.set_argument(index, a[index] | flag);
        let mut end = Retried::new(would_wait, -libc::EAGAIN);
        match call {
            Syscall::Waitid => end.found = Some(a[2]),
            // The commands that do not wait come before those that do.
            Syscall::Fcntl => tried.set_argument(1, a[1] - 1),
            Syscall::Semop | Syscall::Semtimedop => {
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
                end.restore = Some((a[1], bytes.clone()));
                for one in bytes.chunks_exact_mut(LENGTH) {
                    one[5] |= 0x08;
                }
                Memory(tid).write(a[1], &bytes)?;
                if call == Syscall::Semtimedop && a[3] != 0 {
                    let time = span(Memory(tid).read_pair(a[3])?);
                    end.deadline = time.map(|time| self.now.saturating_add(time));
                }
            }
            _ => {}
        }
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
