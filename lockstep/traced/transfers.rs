//! Reads, writes and the like, of ports and of everything else; and random bytes.

use std::rc::Rc;

use rustix::event::PollFlags;
use rustix::fs::OFlags;
use rustix::net::sockopt::{Timeout, set_tcp_nodelay, socket_timeout};

use crate::traced::arch::Syscall;
use crate::traced::clock::nanoseconds;
use crate::traced::descriptor::Descriptor;
use crate::traced::in_parts::{NO_SPLICE_WAIT, parts};
use crate::traced::memory::{Memory, whole_length};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, counted, failure, int};
use crate::traced::tracer::Tracer;
use crate::traced::wait::{Rest, Wait};

/// Most random bytes of one syscall; the program asks for the rest again.
const MOST_RANDOM: usize = 1 << 16;

/// The flag by which a message is not to wait.
const NO_WAIT: u64 = libc::MSG_DONTWAIT.cast_unsigned() as u64;

impl Tracer<'_> {
    pub(crate) fn transfer_call(&mut self, mut entry: Entry) -> Result<Handling, Halt> {
        let a = entry.a;
        // Without an offset it is a read like others.
        entry.call = match (entry.call, a[3]) {
            (Syscall::Preadv2, u64::MAX) => Syscall::Readv,
            (Syscall::Preadv2, _) => Syscall::Preadv,
            (Syscall::Pwritev2, u64::MAX) => Syscall::Writev,
            // Ports have no offsets.
            (Syscall::Pwritev2, _) => return Ok(Handling::Make),
            (call, _) => call,
        };
        let (tid, process, call) = (entry.tid, entry.process, entry.call);
        // The descriptor that may be a port, the source of a copy, and the flags of a splice.
        let (fd, from, splice) = match call {
            Syscall::Splice => (int(a[2]), Some(int(a[0])), a[5]),
            Syscall::Tee => (int(a[1]), Some(int(a[0])), a[3]),
            Syscall::Sendfile => (int(a[0]), Some(int(a[1])), 0),
            _ => (int(a[0]), None, 0),
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
        self.record_destination(entry, &descriptor)?;
        let source = from.and_then(|from| self.descriptor(process, from));
        if let Some(action) = self.own_bytes(entry, &descriptor, source.as_deref())? {
            return Ok(action);
        }
        // A file that can block has no offsets: the syscall fails at once.
        if matches!(call, Syscall::Pread | Syscall::Preadv) {
            return Ok(Handling::Make);
        }
        if matches!(call, Syscall::Read | Syscall::Readv) && descriptor.is_anonymous() {
            let into = parts(entry)?;
            // These reads need at least 8 bytes, and fail at once.
            if whole_length(&into) < 8 {
                return Ok(Handling::Make);
            }
            if let Some(result) = self.read_timer(tid, &descriptor, &into)? {
                return Ok(Handling::Answer(result));
            }
        }
        if let Some(source) = source
            && !source.never_waits()
            && !source.is_ready(PollFlags::IN)
            && !source.is_nonblocking()
            && splice & NO_SPLICE_WAIT == 0
        {
            let rest = Rest::all(entry, &source, PollFlags::IN);
            return Ok(Handling::Block(Wait::Transfer(rest), None));
        }
        if descriptor.never_waits() && !is_queue(call) {
            let is_write = matches!(call, Syscall::Write | Syscall::Writev);
            if is_write && self.descriptors.output == Some(descriptor.status.inode) {
                self.report.written += whole_length(&parts(entry)?);
            }
            return Ok(Handling::Make);
        }
        self.may_wait(entry, &descriptor)
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
            Syscall::Read | Syscall::Readv if descriptor.is_for(OFlags::RDONLY) => {
                self.read_port(entry, index, descriptor, parts(entry)?)
            }
            Syscall::Write | Syscall::Writev if descriptor.is_for(OFlags::WRONLY) => {
                self.write_port(entry, index, descriptor, &parts(entry)?)
            }
            // Programs fall back to reading and writing.
            Syscall::Splice | Syscall::Sendfile => Ok(failure(libc::EINVAL)),
            _ => Ok(Handling::Make),
        }
    }

    /// Fills these parts of a program's memory with random bytes, up to the limit of one syscall.
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

    /// A read or write that may wait, of something that is not a port.
    fn may_wait(&mut self, entry: Entry, descriptor: &Rc<Descriptor>) -> Result<Handling, Halt> {
        let Entry { tid, call, a, .. } = entry;
        // The poll flags, the program's own flags, and the flag that prevents blocking.
        let (flags, given, no_wait) = match call {
            Syscall::Write | Syscall::Writev => (PollFlags::OUT, 0, 0),
            Syscall::Sendto | Syscall::Sendmmsg => (PollFlags::OUT, a[3], NO_WAIT),
            Syscall::Sendmsg => (PollFlags::OUT, a[2], NO_WAIT),
            Syscall::Recvfrom | Syscall::Recvmmsg => (PollFlags::IN, a[3], NO_WAIT),
            Syscall::Recvmsg => (PollFlags::IN, a[2], NO_WAIT),
            Syscall::Vmsplice if descriptor.is_for(OFlags::WRONLY) => {
                (PollFlags::OUT, a[3], NO_SPLICE_WAIT)
            }
            Syscall::Vmsplice => (PollFlags::IN, a[3], NO_SPLICE_WAIT),
            Syscall::Tee => (PollFlags::OUT, a[3], NO_SPLICE_WAIT),
            Syscall::Splice => (PollFlags::OUT, a[5], NO_SPLICE_WAIT),
            Syscall::Sendfile | Syscall::MqTimedsend => (PollFlags::OUT, 0, 0),
            _ => (PollFlags::IN, 0, 0),
        };
        if flags == PollFlags::OUT && descriptor.status.kind.is_socket() {
            // Otherwise the system delays small messages, by its own clock. Only TCP accepts this.
            let _ = set_tcp_nodelay(&descriptor.file, true);
        }
        let at_once = given & no_wait != 0 || descriptor.is_nonblocking();
        let is_ready = self.is_ready(tid, descriptor, flags);
        if at_once {
            let backs_off = if is_ready { None } else { self.query(entry) };
            return Ok(backs_off.unwrap_or(Handling::Make));
        }
        let rest = self.in_parts(entry, descriptor, (flags, given))?;
        // The program makes a copy again for the rest, as in real time.
        let is_copy = matches!(call, Syscall::Splice | Syscall::Sendfile);
        if is_ready && rest.is_none() && !is_copy {
            return Ok(Handling::Make);
        }
        let mut deadline = None;
        if is_queue(call) && a[4] != 0 {
            deadline = self.deadline_at(tid, a[4], Some(libc::CLOCK_REALTIME))?;
        } else if descriptor.status.kind.is_socket() {
            let which = match flags {
                PollFlags::OUT => Timeout::Send,
                _ => Timeout::Recv,
            };
            let patience = socket_timeout(&descriptor.file, which).ok().flatten();
            deadline = patience.map(|span| self.now.saturating_add(nanoseconds(span)));
        }
        let mut rest = match rest {
            Some(rest) => rest,
            None => Rest {
                parts: parts(entry)?,
                ..Rest::all(entry, descriptor, flags)
            },
        };
        let result = match is_ready {
            true => self.transfer(tid, &mut rest)?,
            false => None,
        };
        match result {
            Some(result) => Ok(Handling::Answer(result)),
            // The system has no memory for it now, although a poll reports room.
            None if is_ready && rest.done == 0 && descriptor.takes_parts(u64::MAX) => {
                Err(Halt::Again)
            }
            None => Ok(Handling::Block(Wait::Transfer(rest), deadline)),
        }
    }
}

/// A message queue is a file, too, and one that waits.
fn is_queue(call: Syscall) -> bool {
    matches!(call, Syscall::MqTimedsend | Syscall::MqTimedreceive)
}
