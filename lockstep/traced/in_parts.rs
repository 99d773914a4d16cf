//! Transfers that would block in the kernel although a poll reports the file as ready: they are made part by
//! part without blocking.

use std::io;
use std::rc::Rc;

use rustix::event::PollFlags;

use crate::traced::arch::Syscall;
use crate::traced::descriptor::Descriptor;
use crate::traced::memory::{Memory, whole_length};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, counted};
use crate::traced::tracer::Tracer;
use crate::traced::wait::Rest;

/// The flag by which a splice is not to wait.
pub(crate) const NO_SPLICE_WAIT: u64 = libc::SPLICE_F_NONBLOCK as u64;

/// The length of a `mmsghdr`.
const MESSAGE: u64 = 64;

impl Rest {
    /// A transfer that is made at once when the file is ready.
    pub(crate) fn all(entry: Entry, of: &Rc<Descriptor>, flags: PollFlags) -> Self {
        let mut whole = (entry.registers.number(), entry.a);
        // Neither end of a copy waits in the kernel.
        let given = match entry.call {
            Syscall::Splice => Some(&mut whole.1[5]),
            Syscall::Tee | Syscall::Vmsplice => Some(&mut whole.1[3]),
            _ => None,
        };
        given.into_iter().for_each(|flags| *flags |= NO_SPLICE_WAIT);
        Self {
            of: Rc::clone(of),
            flags,
            whole,
            of_part: whole,
            parts: Vec::new(),
            done: 0,
            enough: Some(0),
        }
    }
}

impl Tracer<'_> {
    /// Returns a transfer that would block although a poll reports the file as ready, as one in parts; `None` for
    /// other transfers.
    pub(crate) fn in_parts(
        &self,
        entry: Entry,
        of: &Rc<Descriptor>,
        (flags, given): (PollFlags, u64),
    ) -> Result<Option<Rest>, Halt> {
        let Entry { tid, call, a, .. } = entry;
        let whole = (entry.registers.number(), a);
        let has = |flag: i32| given & u64::from(flag.unsigned_abs()) != 0;
        let part = |number, flags| (number, [a[0], 0, 0, flags, 0, 0]);
        // A sender of a part gets no SIGPIPE.
        let silent = given | u64::from(libc::MSG_NOSIGNAL.unsigned_abs());
        let of_part = match call {
            Syscall::Sendfile if of.status.kind.is_socket() => whole,
            Syscall::Write | Syscall::Writev | Syscall::Sendto | Syscall::Sendmsg => {
                match of.status.kind.is_socket() {
                    true => part(libc::SYS_sendto, silent),
                    false => part(libc::SYS_write, 0),
                }
            }
            Syscall::Recvfrom | Syscall::Recvmsg
                if has(libc::MSG_WAITALL) && !has(libc::MSG_PEEK) =>
            {
                part(libc::SYS_recvfrom, given)
            }
            Syscall::Sendmmsg | Syscall::Recvmmsg => whole,
            _ => return Ok(None),
        };
        let parts = parts(entry)?;
        let may_wait = match call {
            Syscall::Sendmmsg | Syscall::Recvmmsg => true,
            Syscall::Recvfrom | Syscall::Recvmsg => of.takes_parts(u64::MAX),
            // No poll reports the room at the receiver.
            Syscall::Sendto if a[4] != 0 && of.is_unix_datagram() => true,
            Syscall::Sendmsg if of.is_unix_datagram() => true,
            _ => of.takes_parts(whole_length(&parts)),
        };
        if !may_wait {
            return Ok(None);
        }
        let mut rest = Rest {
            of_part,
            parts,
            enough: None,
            ..Rest::all(entry, of, flags)
        };
        if call == Syscall::Recvmmsg {
            rest.enough = match has(libc::MSG_WAITFORONE) {
                true => Some(0),
                false => self.deadline_at(tid, a[4], None)?,
            };
            rest.whole.1[4] = 0;
            rest.of_part = rest.whole;
        }
        Ok(Some(rest))
    }

    /// Makes a client transfer as much of the rest as is possible now; returns the result of its syscall if that
    /// has ended.
    pub(crate) fn transfer(&mut self, tid: Tid, rest: &mut Rest) -> Result<Option<i64>, Halt> {
        let is_read = [libc::SYS_read, libc::SYS_readv].contains(&rest.whole.0);
        if is_read
            && rest.of.is_anonymous()
            && let Some(count) = self.read_timer(tid, &rest.of, &rest.parts)?
        {
            return Ok(Some(count));
        }
        let mut call = rest.whole;
        loop {
            if rest.done > 0 {
                let done = rest.done as u64;
                let Some((place, left)) = part_at(&rest.parts, done) else {
                    break;
                };
                call = rest.of_part;
                let to = &mut call.1;
                match call.0 {
                    libc::SYS_sendfile => to[3] = left,
                    libc::SYS_sendmmsg | libc::SYS_recvmmsg => {
                        (to[1], to[2]) = (to[1] + MESSAGE * done, left);
                    }
                    _ => (to[1], to[2]) = (place, left),
                }
            }
            let made = self.transfer_now(tid, &rest.of, call)?;
            match usize::try_from(made) {
                // A file or a stream is at its end.
                Ok(0) => break,
                Ok(more) => rest.done += more,
                Err(_) if made == -i64::from(libc::EAGAIN) => return Ok(None),
                Err(_) if rest.done == 0 => return Ok(Some(made)),
                // The next syscall says why; a signal may do so now.
                Err(_) => break,
            }
            if rest.enough.is_some_and(|from| from <= self.now) {
                break;
            }
        }
        Ok(Some(counted(rest.done)))
    }

    pub(crate) fn transfer_now(
        &mut self,
        tid: Tid,
        of: &Descriptor,
        (number, arguments): (i64, [u64; 6]),
    ) -> Result<i64, Halt> {
        of.without_waiting(|| self.inject(tid, number, arguments))
            .map_err(io::Error::from)?
    }
}

/// What is left of the part of memory in which the byte with this number is.
fn part_at(parts: &[(u64, u64)], mut at: u64) -> Option<(u64, u64)> {
    parts.iter().find_map(|(address, length)| {
        if at < *length {
            return Some((address + at, length - at));
        }
        at -= length;
        None
    })
}

/// The parts of memory that a read or write names; of a copy of a file, its length.
pub(crate) fn parts(Entry { tid, call, a, .. }: Entry) -> Result<Vec<(u64, u64)>, Halt> {
    let memory = Memory(tid);
    let (address, count) = match call {
        Syscall::Readv | Syscall::Preadv | Syscall::Writev => (a[1], a[2]),
        // Address and length of the array lie in a structure of four words.
        Syscall::Sendmsg | Syscall::Recvmsg => {
            let (address, count) = memory.read_pair(a[1].saturating_add(16))?;
            (address.cast_unsigned(), count.cast_unsigned())
        }
        Syscall::Sendfile => return Ok(vec![(0, a[3])]),
        _ => return Ok(vec![(a[1], a[2])]),
    };
    Ok(memory.read_parts(address, count)?)
}
