//! Reads, writes and the like, of ports and of everything else; and random bytes.

use std::rc::Rc;

use rustix::event::PollFlags;
use rustix::net::sockopt::{Timeout, set_tcp_nodelay, socket_timeout};

use crate::traced::arch::Syscall;
use crate::traced::clock::{nanoseconds, span};
use crate::traced::descriptor::Descriptor;
use crate::traced::memory::{Memory, whole_length};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, counted, failure, int};
use crate::traced::tracer::Tracer;
use crate::traced::tree::AtEnd;
use crate::traced::wait::{PollResult, Wait};

/// Most random bytes of one syscall; the program asks for the rest again.
const MOST_RANDOM: usize = 1 << 16;

const NO_SIGNAL: u64 = libc::MSG_NOSIGNAL.cast_unsigned() as u64;

impl Tracer<'_> {
    pub(crate) fn transfer_call(&mut self, mut entry: Entry) -> Result<Handling, Halt> {
        let a = entry.a;
        // Without a place it is a read like others.
        entry.call = match (entry.call, a[3]) {
            (Syscall::Preadv2, u64::MAX) => Syscall::Readv,
            (Syscall::Preadv2, _) => Syscall::Preadv,
            (Syscall::Pwritev2, u64::MAX) => Syscall::Writev,
            // No port has places.
            (Syscall::Pwritev2, _) => return Ok(Handling::Make),
            (call, _) => call,
        };
        let (tid, process, call) = (entry.tid, entry.process, entry.call);
        // The end that a port may be at.
        let fd = match call {
            Syscall::Splice => int(a[2]),
            _ => int(a[0]),
        };
        let from = match call {
            Syscall::Splice => Some(int(a[0])),
            Syscall::Sendfile => Some(int(a[1])),
            _ => None,
        };
        self.pass(tid, from.into_iter().chain([fd]))?;
        let descriptor = self.descriptor(process, fd).ok_or(Halt::Make)?;
        // Before anything is done with a port, the world knows which clients have it open.
        self.poll_ports()?;
        if let Some(index) = self.port_of(&descriptor) {
            return match self.port_transfer(entry, index, &descriptor) {
                // The kernel has none of a port's bytes.
                Err(Halt::Make) => Ok(failure(libc::EFAULT)),
                handling => handling,
            };
        }
        self.note_destination(entry, &descriptor)?;
        let source = from.and_then(|from| self.descriptor(process, from));
        if let Some(action) = self.own_bytes(entry, &descriptor, source.as_deref())? {
            return Ok(action);
        }
        // Whatever waits has no places, and says so at once.
        if matches!(call, Syscall::Pread | Syscall::Preadv) {
            return Ok(Handling::Make);
        }
        if call == Syscall::Read
            && descriptor.is_anonymous()
            && a[2] >= 8
            && let Some(action) = self.read_timer(tid, &descriptor, a[1])?
        {
            return Ok(action);
        }
        if let (Some(fd), Some(source)) = (from, source)
            && !source.never_waits()
            && !source.is_ready(PollFlags::IN)
            && !source.is_nonblocking()
            && (call != Syscall::Splice || a[5] & u64::from(libc::SPLICE_F_NONBLOCK) == 0)
        {
            let result = PollResult::Call { late: 0 };
            let (set, mask) = (vec![(fd, PollFlags::IN)], None);
            return Ok(Handling::Block(Wait::Poll { set, result, mask }, None));
        }
        if descriptor.never_waits() && !is_queue(call) {
            return Ok(Handling::Make);
        }
        let action = self.may_wait(entry, fd, &descriptor)?;
        if call == Syscall::Recvmmsg && matches!(action, Handling::Make) {
            // It would wait for the others of the messages that it has room for.
            let mut changed = entry.registers;
            let first_only = u64::from(libc::MSG_WAITFORONE.unsigned_abs());
            changed.set_argument(3, a[3] | first_only);
            changed.set_argument(4, 0);
            return Ok(Handling::ToEnd(changed, AtEnd::Restore(entry.registers)));
        }
        Ok(action)
    }

    /// A read of what the tracer itself says: what is random, and how many processors there are.
    fn own_bytes(
        &mut self,
        entry: Entry,
        descriptor: &Descriptor,
        from: Option<&Descriptor>,
    ) -> Result<Option<Handling>, Halt> {
        let Entry { tid, call, a, .. } = entry;
        if from.is_some_and(|from| {
            from.is_random() || self.descriptors.lists.has(from) || self.port_of(from).is_some()
        }) {
            // Programs fall back to reading and writing.
            return Ok(Some(failure(libc::EINVAL)));
        }
        let place = match call {
            Syscall::Read | Syscall::Readv => None,
            Syscall::Pread | Syscall::Preadv => Some(a[3]),
            _ => return Ok(None),
        };
        let is_random = descriptor.is_random();
        if !is_random && !self.descriptors.lists.has(descriptor) {
            return Ok(None);
        }
        let parts = parts(entry)?;
        if is_random {
            return self.random_bytes(tid, &parts).map(Some);
        }
        self.descriptors.lists.read(tid, descriptor, &parts, place)
    }

    /// The same on a port.
    fn port_transfer(
        &mut self,
        entry: Entry,
        index: usize,
        descriptor: &Rc<Descriptor>,
    ) -> Result<Handling, Halt> {
        match entry.call {
            Syscall::Read | Syscall::Readv => {
                self.read_port(entry, index, descriptor, parts(entry)?)
            }
            Syscall::Write | Syscall::Writev => self.write(entry, descriptor, &parts(entry)?, None),
            // Programs fall back to reading and writing.
            Syscall::Splice | Syscall::Sendfile => Ok(failure(libc::EINVAL)),
            _ => Ok(Handling::Make),
        }
    }

    /// Fills these parts of a program's memory with what is random, as far as it goes at a time.
    pub(crate) fn random_bytes(
        &mut self,
        tid: Tid,
        parts: &[(u64, u64)],
    ) -> Result<Handling, Halt> {
        let length = usize::try_from(whole_length(parts)).unwrap_or(usize::MAX);
        let mut bytes = vec![0; length.min(MOST_RANDOM)];
        if self.random(&mut bytes).is_none() {
            return Ok(Handling::Make);
        }
        let written = Memory(tid).write_parts(parts, &bytes)?;
        Ok(Handling::Answer(counted(written)))
    }

    /// A read or write that may wait, of something that is no port.
    fn may_wait(
        &mut self,
        entry: Entry,
        fd: i32,
        descriptor: &Rc<Descriptor>,
    ) -> Result<Handling, Halt> {
        let Entry { tid, call, a, .. } = entry;
        let flags = match call {
            Syscall::Write
            | Syscall::Writev
            | Syscall::Sendto
            | Syscall::Sendmsg
            | Syscall::Sendmmsg
            | Syscall::Splice
            | Syscall::Sendfile
            | Syscall::MqTimedsend => PollFlags::OUT,
            Syscall::Vmsplice if descriptor.is_for_writing() => PollFlags::OUT,
            _ => PollFlags::IN,
        };
        if flags == PollFlags::OUT && descriptor.is_socket() {
            // Else the system keeps back small messages, by its own clock. What is not TCP refuses this.
            let _ = set_tcp_nodelay(&descriptor.file, true);
        }
        let message_flags = match call {
            Syscall::Recvfrom | Syscall::Sendto | Syscall::Recvmmsg | Syscall::Sendmmsg => a[3],
            Syscall::Recvmsg | Syscall::Sendmsg => a[2],
            _ => 0,
        };
        let at_once = message_flags & u64::from(libc::MSG_DONTWAIT.unsigned_abs()) != 0
            || matches!(call, Syscall::Tee | Syscall::Vmsplice)
                && a[3] & u64::from(libc::SPLICE_F_NONBLOCK) != 0;
        let at_once = at_once || descriptor.is_nonblocking();
        let is_ready =
            descriptor.is_ready(flags) || flags == PollFlags::IN && self.has_signal(tid, fd);
        let is_plain = match call {
            Syscall::Write | Syscall::Writev => true,
            Syscall::Sendto => a[4] == 0 && a[3] & !NO_SIGNAL == 0,
            _ => false,
        };
        let parts = (is_plain && !at_once).then(|| parts(entry)).transpose()?;
        let parts = parts.filter(|parts| descriptor.takes_pieces(whole_length(parts)));
        if is_ready && parts.is_none() {
            return Ok(Handling::Make);
        }
        if at_once {
            return Ok(self.query(entry).unwrap_or(Handling::Make));
        }
        let (mut late, mut deadline) = (-i64::from(libc::EAGAIN), None);
        if is_queue(call) && a[4] != 0 {
            late = -i64::from(libc::ETIMEDOUT);
            let time = span(Memory(tid).read_pair(a[4])?);
            deadline = time.and_then(|t| self.clocks.when(libc::CLOCK_REALTIME, t, self.now));
        } else if descriptor.is_socket() {
            let which = match flags {
                PollFlags::OUT => Timeout::Send,
                _ => Timeout::Recv,
            };
            let patience = socket_timeout(&descriptor.file, which).ok().flatten();
            deadline = patience.map(|span| self.now.saturating_add(nanoseconds(span)));
        }
        if let Some(parts) = parts {
            return self.write(entry, descriptor, &parts, deadline);
        }
        let result = PollResult::Call { late };
        let (set, mask) = (vec![(fd, flags)], None);
        Ok(Handling::Block(Wait::Poll { set, result, mask }, deadline))
    }
}

/// The parts of memory that a read or write names.
fn parts(Entry { tid, call, a, .. }: Entry) -> Result<Vec<(u64, u64)>, Halt> {
    match call {
        Syscall::Readv | Syscall::Preadv | Syscall::Writev => {
            Ok(Memory(tid).read_parts(a[1], a[2])?)
        }
        _ => Ok(vec![(a[1], a[2])]),
    }
}

/// A message queue is a file, too, and one that waits.
fn is_queue(call: Syscall) -> bool {
    matches!(call, Syscall::MqTimedsend | Syscall::MqTimedreceive)
}
