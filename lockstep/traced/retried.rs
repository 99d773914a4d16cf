//! Syscalls that are made without blocking, and retried after other events: children, locks, queues.

use std::time::Instant;

use crate::traced::arch::Syscall;
use crate::traced::memory::Memory;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling};
use crate::traced::tracer::Tracer;
use crate::traced::wait::{Retried, Wait};

/// The length of a `siginfo_t`.
const SIGNAL_INFO: usize = 128;

impl Tracer<'_> {
    pub(crate) fn retried_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let Entry { tid, call, a, .. } = entry;
        // The flag that prevents blocking, and the results that mean that it would block.
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
        let mut tried = Retried {
            call: (entry.registers.number(), a),
            memory: Vec::new(),
            would_wait,
            found: None,
            seen: None,
            late: -libc::EAGAIN,
        };
        let mut deadline = None;
        tried.call.1[index] |= flag;
        match call {
            Syscall::Waitid => {
                tried.found = Some(a[2]);
                if a[2] == 0 {
                    tried.memory = vec![0; SIGNAL_INFO];
                }
            }
            // The commands that do not wait come before those that do.
            Syscall::Fcntl => tried.call.1[1] -= 1,
            Syscall::Semop | Syscall::Semtimedop => {
                /// The length of a `sembuf`: number, operation, flags of two bytes each.
                const LENGTH: usize = 6;
                let count = usize::try_from(a[2]).unwrap_or(usize::MAX);
                if count > 500 {
                    return Ok(Handling::Make);
                }
                let mut bytes = vec![0; LENGTH * count];
                Memory(tid).read(a[1], &mut bytes)?;
                // One of them that must not block is enough. IPC_NOWAIT is 0o4000.
                if bytes.chunks_exact(LENGTH).any(|one| one[5] & 0x08 != 0) {
                    return Ok(Handling::Make);
                }
                for one in bytes.chunks_exact_mut(LENGTH) {
                    one[5] |= 0x08;
                }
                tried.memory = bytes;
                if call == Syscall::Semtimedop {
                    deadline = self.deadline_at(tid, a[3], None)?;
                }
            }
            _ => {}
        }
        self.retry(entry, tried, deadline)
    }

    /// Makes a thread's syscall without blocking, and retries it after other events.
    pub(crate) fn retry(
        &mut self,
        entry: Entry,
        mut retried: Retried,
        deadline: Option<u64>,
    ) -> Result<Handling, Halt> {
        let result = self.try_once(entry.tid, &mut retried)?;
        // The lock is tried once more: another program may release it before its holder is found.
        let paced = (Instant::now(), self.now);
        self.limits.paced = self.limits.paced.or(result.is_none().then_some(paced));
        Ok(result.map_or(
            Handling::Block(Wait::Again(retried), deadline),
            Handling::Answer,
        ))
    }

    /// Makes it once; returns the result, unless it would block.
    pub(crate) fn try_once(
        &mut self,
        tid: Tid,
        retried: &mut Retried,
    ) -> Result<Option<i64>, Halt> {
        let (number, a) = retried.call;
        let is_for_child = retried.would_wait == [0];
        let seen = retried.seen.replace(self.schedule.children);
        if is_for_child && seen == Some(self.schedule.children) {
            return Ok(None);
        }
        let (result, memory) = if retried.memory.is_empty() {
            (self.inject(tid, number, a)?, Vec::new())
        } else {
            let arguments = |place| match retried.found {
                Some(_) => [a[0], a[1], place, a[3], a[4], a[5]],
                None => [a[0], place, a[2], a[3], a[4], a[5]],
            };
            self.inject_with(tid, number, |_| retried.memory.clone(), arguments)?
        };
        let is_it = |one: &i32| result == i64::from(*one);
        let mut waits = retried.would_wait.iter().any(is_it);
        if waits && let Some(address) = retried.found {
            waits = match address {
                0 => memory.iter().all(|byte| *byte == 0),
                _ => Memory(tid).read_u32(address)? == 0,
            };
        }
        self.schedule.happened += u64::from(!waits);
        // Another thread may wait for the same child.
        self.schedule.children += u64::from(is_for_child && !waits);
        Ok((!waits).then_some(result))
    }
}
