//! Syscalls that wait for one of several descriptors. All but those on an epoll are answered, since the
//! kernel has none of the bytes of a port.

use rustix::event::PollFlags;

use crate::traced::arch::{Registers, Syscall};
use crate::traced::clock::{parts, parts_micros, span_micros};
use crate::traced::memory::Memory;
use crate::traced::proc::table_size;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, counted, int};
use crate::traced::tracer::Tracer;
use crate::traced::wait::{Awaited, PollResult, Wait};

/// Most descriptors in one syscall; beyond that the system decides.
const MOST: usize = 1 << 16;

/// What `select` polls for the members of its three sets, and what of that makes one a member of the
/// result.
const SETS: [PollFlags; 3] = [
    PollFlags::IN.union(PollFlags::HUP).union(PollFlags::ERR),
    PollFlags::OUT.union(PollFlags::ERR),
    PollFlags::PRI,
];

/// The deadline of a poll, and the signals that are blocked meanwhile in the place of others.
type Times = (Option<u64>, Option<u64>);

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
        let times = match call {
            Syscall::Poll => (millis(a[2]), None),
            Syscall::Ppoll => (self.deadline_at(tid, a[2], None)?, word(a[3])?),
            Syscall::Select if a[4] == 0 => (None, None),
            Syscall::Select => {
                let time = span_micros(memory.read_pair(a[4])?).ok_or(Halt::Make)?;
                (Some(now.saturating_add(time)), None)
            }
            // The set of signals lies behind another address.
            Syscall::Pselect => (
                self.deadline_at(tid, a[4], None)?,
                word(word(a[5])?.unwrap_or(0))?,
            ),
            Syscall::EpollPwait2 => (self.deadline_at(tid, a[3], None)?, word(a[4])?),
            Syscall::EpollPwait => (millis(a[3]), word(a[4])?),
            _ => (millis(a[3]), None),
        };
        match call {
            Syscall::Poll | Syscall::Ppoll => self.poll(entry, times),
            Syscall::Select | Syscall::Pselect => {
                self.select(entry, call == Syscall::Select, times)
            }
            _ => {
                let set = vec![(int(a[0]), PollFlags::IN)];
                self.poll_set(entry, set, PollResult::Kernel, times)
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

    fn select(&mut self, entry: Entry, micros: bool, times: Times) -> Result<Handling, Halt> {
        let [count, read, write, except, time, _] = entry.a;
        let sets = [read, write, except];
        let mut count = usize::try_from(int(count)).map_err(|_| Halt::Make)?;
        if count > libc::FD_SETSIZE {
            // The system looks no further than the table of descriptors goes, nor may the sets.
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
        let result = PollResult::Sets {
            sets,
            bytes,
            time,
            micros,
        };
        self.poll_set(entry, set, result, times)
    }

    fn poll_set(
        &mut self,
        entry: Entry,
        set: Vec<(i32, PollFlags)>,
        result: PollResult,
        (deadline, mask): Times,
    ) -> Result<Handling, Halt> {
        self.pass_polled(entry.tid, &set)?;
        for port in &mut *self.ports {
            port.top_up()?;
        }
        let only_queries = deadline.is_some_and(|deadline| deadline <= self.now);
        let backs_off = only_queries.then(|| self.query(entry));
        let awaited = |one| self.awaited(entry.process, one);
        let set: Vec<Awaited> = set.into_iter().map(awaited).collect();
        if self.is_asked(&result, mask) {
            return Ok(match (self.ask_epoll(entry.tid)?, backs_off) {
                (Some(found), _) => Handling::Answer(found),
                (None, Some(None)) => Handling::Answer(0),
                (None, Some(Some(backs_off))) => backs_off,
                (None, None) => Handling::Block(Wait::Poll { set, result, mask }, deadline),
            });
        }
        let found = self.found(entry.tid, &set, &result);
        // A poll that does not wait, and is not one of too many, is answered with what there is.
        if matches!(backs_off, Some(None)) || !found.iter().all(PollFlags::is_empty) {
            let answer = self.answer_poll(entry.tid, &set, &found, &result, deadline)?;
            return Ok(answer.map_or(Handling::Make, Handling::Answer));
        }
        if let Some(Some(backs_off)) = backs_off {
            return Ok(backs_off);
        }
        Ok(Handling::Block(Wait::Poll { set, result, mask }, deadline))
    }

    /// Returns whether a poll is of an epoll that may have a `signalfd`, whichever its number is now.
    pub(crate) fn is_asked(&self, result: &PollResult, mask: Option<u64>) -> bool {
        let is_kernel = matches!(result, PollResult::Kernel);
        self.descriptors.has_signalfd && is_kernel && mask.is_none()
    }

    /// Makes a thread that waits for an epoll ask it without waiting: the kernel finds the signals of the
    /// thread that asks. Returns the count of events, if there are any, or an error.
    pub(crate) fn ask_epoll(&mut self, tid: Tid) -> Result<Option<i64>, Halt> {
        let [fd, events, most, ..] = Registers::of(tid)?.arguments();
        let arguments = [fd, events, most, 0, 0, 0];
        let found = self.inject(tid, libc::SYS_epoll_wait, arguments)?;
        Ok((found != 0).then_some(found))
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

    /// Writes what a poll has found; what it returns, or `None` if that is the kernel's.
    pub(crate) fn answer_poll(
        &self,
        tid: Tid,
        set: &[Awaited],
        found: &[PollFlags],
        result: &PollResult,
        deadline: Option<u64>,
    ) -> Result<Option<i64>, Halt> {
        let memory = Memory(tid);
        match result {
            PollResult::Kernel | PollResult::Call { .. } => Ok(None),
            PollResult::Revents { address, entries } => {
                let mut entries = entries.clone();
                for (entry, found) in entries.chunks_exact_mut(8).zip(found) {
                    entry[6..].copy_from_slice(&found.bits().to_ne_bytes());
                }
                memory.write(*address, &entries)?;
                let ready = found.iter().filter(|found| !found.is_empty());
                Ok(Some(counted(ready.count())))
            }
            PollResult::Sets {
                sets,
                bytes,
                time,
                micros,
            } => {
                if found.contains(&PollFlags::NVAL) {
                    return Ok(Some(-i64::from(libc::EBADF)));
                }
                let (mut written, mut count) = (Vec::new(), 0);
                let (mut places, kinds): (Vec<_>, Vec<_>) = places(*sets, *bytes).unzip();
                for kind in kinds {
                    let from = written.len();
                    written.resize(from + bytes, 0);
                    for (one, found) in set.iter().zip(found) {
                        if one.flags == kind && found.intersects(kind) {
                            let fd = usize::try_from(one.fd).unwrap_or_default();
                            written[from + fd / 8] |= 1 << (fd % 8);
                            count += 1;
                        }
                    }
                }
                if *time != 0 {
                    let left = deadline.unwrap_or_default().saturating_sub(self.now);
                    let (seconds, part) = (if *micros { parts_micros } else { parts })(left);
                    written.extend([seconds, part].map(i64::to_ne_bytes).as_flattened());
                    places.push((*time, 16));
                }
                if memory.write_all(&places, &written).is_err() && *time != 0 {
                    // A time that cannot be written is no error.
                    places.pop();
                    written.truncate(written.len() - 16);
                }
                memory.write_all(&places, &written)?;
                Ok(Some(count))
            }
        }
    }
}

/// The sets of `select` that there are: where each is, how long, and what it is polled for.
fn places(sets: [u64; 3], bytes: usize) -> impl Iterator<Item = ((u64, u64), PollFlags)> {
    let sets = sets.into_iter().zip(SETS);
    let given = sets.filter(|(address, _)| *address != 0);
    given.map(move |(address, kind)| ((address, bytes as u64), kind))
}
