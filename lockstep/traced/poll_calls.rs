//! Syscalls that wait for one of several descriptors. The tracer answers all of them, since the kernel does not
//! have the bytes of a port.

use rustix::event::PollFlags;

use crate::traced::arch::Syscall;
use crate::traced::clock::{parts, parts_micros, span_micros};
use crate::traced::memory::Memory;
use crate::traced::proc::{Signals, path_of, table_size};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, counted, failure, int};
use crate::traced::tracer::Tracer;
use crate::traced::wait::{Awaited, PollResult, Times, Wait};

/// Most descriptors in one syscall; beyond that the system decides.
const MOST: usize = 1 << 16;

/// Poll flags for the members of `select`'s three sets, and those that make one a member of the result.
const SETS: [PollFlags; 3] = [
    PollFlags::IN.union(PollFlags::HUP).union(PollFlags::ERR),
    PollFlags::OUT.union(PollFlags::ERR),
    PollFlags::PRI,
];

impl Tracer<'_> {
    pub(crate) fn poll_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let Entry { tid, call, a, .. } = entry;
        let memory = Memory(tid);
        let now = self.now;
        let millis = |value: u64| {
            let millis = u64::try_from(int(value)).ok()?;
            Some(now.saturating_add(millis * 1_000_000))
        };
        let word = |address: u64| match address {
            0 => Ok(None),
            _ => memory.read_u64(address).map(Some),
        };
        let (deadline, mask, left) = match call {
            Syscall::Poll => (millis(a[2]), None, (0, false)),
            Syscall::Ppoll => (
                self.deadline_at(tid, a[2], None)?,
                word(a[3])?,
                (a[2], false),
            ),
            Syscall::Select if a[4] == 0 => Default::default(),
            Syscall::Select => {
                let time = span_micros(memory.read_pair(a[4])?).ok_or(Halt::Make)?;
                (Some(now.saturating_add(time)), None, (a[4], true))
            }
            // The set of signals lies behind another address.
            Syscall::Pselect => (
                self.deadline_at(tid, a[4], None)?,
                word(word(a[5])?.unwrap_or(0))?,
                (a[4], false),
            ),
            Syscall::EpollPwait2 => (self.deadline_at(tid, a[3], None)?, word(a[4])?, (0, false)),
            Syscall::EpollPwait => (millis(a[3]), word(a[4])?, (0, false)),
            _ => (millis(a[3]), None, (0, false)),
        };
        let times = Times {
            deadline,
            mask,
            left,
        };
        match call {
            Syscall::Poll | Syscall::Ppoll => self.poll(entry, times),
            Syscall::Select | Syscall::Pselect => self.select(entry, times),
            _ => {
                // The system refuses this.
                let most = usize::try_from(int(a[2])).ok().filter(|most| *most > 0);
                let result = PollResult::Events {
                    address: a[1],
                    most: most.ok_or(Halt::Make)?.min(MOST),
                };
                self.poll_set(entry, vec![(int(a[0]), PollFlags::IN)], result, times)
            }
        }
    }

    fn poll(&mut self, entry: Entry, times: Times) -> Result<Handling, Halt> {
        let [address, count, ..] = entry.a;
        let count = usize::try_from(count)
            .ok()
            .filter(|n| *n <= MOST)
            .ok_or(Halt::Make)?;
        let mut entries = vec![0; 8 * count];
        Memory(entry.tid).read(address, &mut entries)?;
        let set = entries.chunks_exact(8).filter_map(|one| {
            let fd = i32::from_ne_bytes(one.get(..4)?.try_into().ok()?);
            let events = u16::from_ne_bytes(one.get(4..6)?.try_into().ok()?);
            // One below 0 is skipped.
            let events = if fd < 0 { 0 } else { events };
            Some((fd, PollFlags::from_bits_retain(events)))
        });
        let set = set.collect();
        let result = PollResult::Revents { address, entries };
        self.poll_set(entry, set, result, times)
    }

    fn select(&mut self, entry: Entry, times: Times) -> Result<Handling, Halt> {
        let [count, read, write, except, ..] = entry.a;
        let sets = [read, write, except];
        let mut count = usize::try_from(int(count)).map_err(|_| Halt::Make)?;
        if count > libc::FD_SETSIZE {
            // The system ignores numbers beyond its table of descriptors, and the sets may end there.
            count = count.min(table_size(entry.process).unwrap_or(count));
        }
        if count > MOST {
            return Err(Halt::Make);
        }
        let bytes = count.div_ceil(64) * 8;
        let mut bits = vec![0; 3 * bytes];
        let (places, kinds): (Vec<_>, Vec<_>) = places(sets, bytes).unzip();
        let bits = &mut bits[..places.len() * bytes];
        Memory(entry.tid).read_all(&places, bits)?;
        let mut set = Vec::new();
        for (bits, flags) in bits.chunks_exact(bytes.max(1)).zip(kinds) {
            let is_in = |fd: &usize| bits[fd / 8] >> (fd % 8) & 1 != 0;
            let members = (0..count).filter(is_in);
            set.extend(members.map(|fd| (i32::try_from(fd).unwrap_or(-1), flags)));
        }
        let result = PollResult::Sets { sets, bytes };
        self.poll_set(entry, set, result, times)
    }

    fn poll_set(
        &mut self,
        entry: Entry,
        set: Vec<(i32, PollFlags)>,
        result: PollResult,
        times: Times,
    ) -> Result<Handling, Halt> {
        let Entry { tid, process, .. } = entry;
        self.pass_polled(tid, &set)?;
        for port in &mut *self.ports {
            port.top_up()?;
        }
        let awaited = |one| self.awaited(process, one);
        let set: Vec<Awaited> = set.into_iter().map(awaited).collect();
        let is_poll = matches!(result, PollResult::Revents { .. });
        let is_none = |one: &Awaited| one.file.is_none() && path_of(process, one.fd).is_none();
        if !is_poll && set.iter().any(is_none) {
            return Ok(failure(libc::EBADF));
        }
        let only_queries = times.deadline.is_some_and(|deadline| deadline <= self.now);
        let backs_off = only_queries.then(|| self.query(entry));
        // A poll that does not wait is answered at once, unless there are too many.
        let is_signalled = self.is_signalled(tid, times.mask);
        let ends = matches!(backs_off, Some(None)) && !is_signalled;
        if let Some(answer) = self.poll_now(tid, &set, &result, (times, ends))? {
            return Ok(Handling::Answer(answer));
        }
        if let Some(Some(backs_off)) = backs_off {
            return Ok(backs_off);
        }
        self.schedule.signalled |= is_signalled;
        let wait = Wait::Poll { set, result, times };
        Ok(Handling::Block(wait, times.deadline))
    }

    /// Returns whether a signal ends a poll at once that has this mask.
    fn is_signalled(&self, tid: Tid, mask: Option<u64>) -> bool {
        let signals = mask.and_then(|_| Signals::of(self.tree.process_of(tid), tid));
        signals.is_some_and(|signals| signals.interrupting(mask) != 0)
    }

    /// Polls, and writes the result if there is one or the poll `ends`; returns the syscall's result then.
    pub(crate) fn poll_now(
        &mut self,
        tid: Tid,
        set: &[Awaited],
        result: &PollResult,
        (times, ends): (Times, bool),
    ) -> Result<Option<i64>, Halt> {
        let answer = match result {
            PollResult::Events { address, most } => {
                self.take_events(tid, set, (*address, *most))?
            }
            _ => {
                let mut found = self.found(tid, set, result);
                let process = self.tree.process_of(tid);
                let is_same = || set.iter().all(|one| self.leads_there(process, one));
                // A poll waits for the files that it began with, and reports those that the numbers lead to now.
                if (ends || found.iter().any(|one| !one.is_empty())) && !is_same() {
                    found = self.found_now(tid, set, result);
                }
                match found.iter().all(PollFlags::is_empty) {
                    true if !ends => 0,
                    _ => write_found(tid, set, &found, result)?,
                }
            }
        };
        if answer == 0 && !ends {
            return Ok(None);
        }
        write_left(tid, times, self.now);
        Ok(Some(answer))
    }

    /// Takes events of an epoll, and writes them there; returns their count, or an error.
    fn take_events(
        &mut self,
        tid: Tid,
        set: &[Awaited],
        (address, most): (u64, usize),
    ) -> Result<i64, Halt> {
        let Some(epoll) = set.first() else {
            return Ok(0);
        };
        // The kernel finds the signals of the thread that asks.
        let by_number = self.descriptors.has_signalfd || epoll.file.is_none();
        if by_number && self.leads_there(self.tree.process_of(tid), epoll) {
            let arguments = [
                epoll.fd.unsigned_abs().into(),
                address,
                most as u64,
                0,
                0,
                0,
            ];
            return self.inject(tid, libc::SYS_epoll_wait, arguments);
        }
        match epoll.file.as_ref().map(|file| file.take_events(most)) {
            Some(Ok((count, events))) => {
                Memory(tid).write(address, &events)?;
                Ok(counted(count))
            }
            Some(Err(error)) => Ok(-i64::from(error.raw_os_error())),
            None => Ok(0),
        }
    }

    /// Returns what a poll finds. A set of `select` has no place for a hang-up that it does not ask for.
    pub(crate) fn found(&self, tid: Tid, set: &[Awaited], result: &PollResult) -> Vec<PollFlags> {
        let mut found = self.readiness(tid, set);
        if matches!(result, PollResult::Sets { .. }) {
            for (found, one) in found.iter_mut().zip(set) {
                *found &= one.flags | PollFlags::NVAL;
            }
        }
        found
    }

    /// The same by what the numbers of these descriptors lead to now.
    pub(crate) fn found_now(
        &self,
        tid: Tid,
        set: &[Awaited],
        result: &PollResult,
    ) -> Vec<PollFlags> {
        let process = self.tree.process_of(tid);
        let now = |one: &Awaited| self.awaited(process, (one.fd, one.flags));
        self.found(tid, &set.iter().map(now).collect::<Vec<_>>(), result)
    }
}

/// Writes the time that is left of a poll. Failure to write it is not an error.
pub(crate) fn write_left(tid: Tid, times: Times, now: u64) {
    let (address, micros) = times.left;
    if address != 0 {
        let left = times.deadline.unwrap_or_default().saturating_sub(now);
        let (seconds, part) = (if micros { parts_micros } else { parts })(left);
        let _ = Memory(tid).write_pair(address, seconds, part);
    }
}

/// Writes the result of a poll; returns the syscall's result.
fn write_found(
    tid: Tid,
    set: &[Awaited],
    found: &[PollFlags],
    result: &PollResult,
) -> Result<i64, Halt> {
    let memory = Memory(tid);
    match result {
        PollResult::Events { .. } => Ok(0),
        PollResult::Revents { address, entries } => {
            let mut entries = entries.clone();
            for (entry, found) in entries.chunks_exact_mut(8).zip(found) {
                entry[6..].copy_from_slice(&found.bits().to_ne_bytes());
            }
            memory.write(*address, &entries)?;
            let ready = found.iter().filter(|found| !found.is_empty());
            Ok(counted(ready.count()))
        }
        PollResult::Sets { sets, bytes } => {
            let (mut written, mut count) = (Vec::new(), 0);
            let (places, kinds): (Vec<_>, Vec<_>) = places(*sets, *bytes).unzip();
            for kind in kinds {
                let from = written.len();
                written.resize(from + bytes, 0);
                for (one, found) in set.iter().zip(found) {
                    // A number that has been closed meanwhile is ready for everything.
                    if one.flags == kind && found.intersects(kind | PollFlags::NVAL) {
                        let fd = usize::try_from(one.fd).unwrap_or_default();
                        written[from + fd / 8] |= 1 << (fd % 8);
                        count += 1;
                    }
                }
            }
            memory.write_all(&places, &written)?;
            Ok(count)
        }
    }
}

/// The sets of `select` that there are: where each is, how long, and what it is polled for.
fn places(sets: [u64; 3], bytes: usize) -> impl Iterator<Item = ((u64, u64), PollFlags)> {
    let sets = sets.into_iter().zip(SETS);
    let given = sets.filter(|(address, _)| *address != 0);
    given.map(move |(address, kind)| ((address, bytes as u64), kind))
}
