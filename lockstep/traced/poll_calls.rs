//! Calls that wait for one of several descriptors.

use rustix::event::PollFlags;

use crate::traced::arch::{Call, Registers};
use crate::traced::clock::{span, span_micros};
use crate::traced::entry::{Entry, int, low};
use crate::traced::memory::Memory;
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::tree::AtEnd;
use crate::traced::wait::{Late, Wait};

/// Most descriptors in one call; beyond that the system decides.
const MOST: usize = 4096;

/// The deadline of a poll, and the signals that are blocked meanwhile in the place of others.
type Times = (Option<u64>, Option<u64>);

impl Tracer<'_> {
    pub(crate) fn poll_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let Entry { call, a, .. } = entry;
        let memory = Memory(entry.tid);
        let now = self.now;
        let millis = |value: u64| {
            let millis = u64::try_from(int(value)).ok()?;
            Some(now.saturating_add(millis * 1_000_000))
        };
        // Where a time lies, or none for ever; the system refuses a wrong one.
        let at = |address: u64, read: fn((i64, i64)) -> Option<u64>| {
            if address == 0 {
                return Ok(Some(None));
            }
            let time = read(memory.read_pair(address)?);
            Ok::<_, Halt>(time.map(|time| Some(now.saturating_add(time))))
        };
        let mask = |address: u64| match address {
            0 => Ok(None),
            _ => memory.read_u64(address).map(Some),
        };
        match call {
            Call::Poll => self.poll(entry, (millis(a[2]), None)),
            Call::Ppoll => {
                let deadline = at(a[2], span)?.ok_or(Halt::Make)?;
                self.poll(entry, (deadline, mask(a[3])?))
            }
            Call::Select | Call::Pselect => {
                let is_select = call == Call::Select;
                let read = if is_select { span_micros } else { span };
                let deadline = at(a[4], read)?.ok_or(Halt::Make)?;
                // The set of signals lies behind another address.
                let mask = match (is_select, a[5]) {
                    (true, _) | (_, 0) => None,
                    (_, address) => mask(memory.read_u64(address)?)?,
                };
                self.select(entry, is_select, (deadline, mask))
            }
            _ => {
                let deadline = match call {
                    Call::EpollPwait2 => match at(a[3], span)? {
                        Some(deadline) => deadline,
                        None => return Ok(Handling::Make),
                    },
                    _ => millis(a[3]),
                };
                let mask = match call {
                    Call::EpollWait => None,
                    _ => mask(a[4])?,
                };
                let set = vec![(int(a[0]), PollFlags::IN)];
                self.poll_set(entry, set, Late::Nothing, (deadline, mask))
            }
        }
    }

    fn poll(&mut self, entry: Entry, times: Times) -> Result<Handling, Halt> {
        let [address, count, ..] = entry.a;
        let count = usize::try_from(count)
            .ok()
            .filter(|n| *n <= MOST)
            .ok_or(Halt::Make)?;
        let mut bytes = vec![0; 8 * count];
        Memory(entry.tid).read(address, &mut bytes)?;
        let set = bytes.chunks_exact(8).filter_map(|one| {
            let fd = i32::from_ne_bytes(one.get(..4)?.try_into().ok()?);
            let events = u16::from_ne_bytes(one.get(4..6)?.try_into().ok()?);
            (fd >= 0).then_some((fd, PollFlags::from_bits_retain(events)))
        });
        let late = Late::Revents { address, count };
        let set = set.collect();
        self.poll_set(entry, set, late, times)
    }

    fn select(&mut self, entry: Entry, micros: bool, times: Times) -> Result<Handling, Halt> {
        let [count, read, write, except, time, _] = entry.a;
        let sets = [read, write, except];
        let count = usize::try_from(low(count))
            .ok()
            .filter(|n| *n <= MOST)
            .ok_or(Halt::Make)?;
        let bytes = count.div_ceil(64) * 8;
        let kinds = [
            PollFlags::IN | PollFlags::HUP | PollFlags::ERR,
            PollFlags::OUT | PollFlags::ERR,
            PollFlags::PRI,
        ];
        let mut set = Vec::new();
        for (address, flags) in sets.into_iter().zip(kinds) {
            if address == 0 {
                continue;
            }
            let mut bits = vec![0; bytes];
            Memory(entry.tid).read(address, &mut bits)?;
            for fd in 0..count {
                if bits
                    .get(fd / 8)
                    .is_some_and(|byte| byte >> (fd % 8) & 1 != 0)
                {
                    set.push((i32::try_from(fd).unwrap_or(-1), flags));
                }
            }
        }
        let late = Late::Sets {
            sets,
            bytes,
            time,
            micros,
        };
        self.poll_set(entry, set, late, times)
    }

    fn poll_set(
        &mut self,
        entry: Entry,
        set: Vec<(i32, PollFlags)>,
        late: Late,
        (deadline, mask): Times,
    ) -> Result<Handling, Halt> {
        self.pass_polled(entry.tid, &set)?;
        let only_asks = deadline.is_some_and(|deadline| deadline <= self.now);
        let ask = only_asks.then(|| self.ask(entry));
        // A poll that does not wait, and is not one of too many, is answered by the system.
        if matches!(ask, Some(None)) {
            return Ok(Handling::Make);
        }
        if self.is_one_ready(entry.tid, &set) {
            return Ok(
                match self
                    .without_rest(entry.registers, late)
                    .filter(|_| !only_asks)
                {
                    Some(changed) => Handling::ToEnd(changed, AtEnd::Restore(entry.registers)),
                    None => Handling::Make,
                },
            );
        }
        if let Some(Some(creeps)) = ask {
            return Ok(creeps);
        }
        Ok(Handling::Hold(Wait::Poll { set, late, mask }, deadline))
    }

    /// The registers with which `select` is made that is ready, where the system would write the rest
    /// of its time by its own clock: without a time.
    pub(crate) fn without_rest(&self, mut registers: Registers, late: Late) -> Option<Registers> {
        let has_time = matches!(late, Late::Sets { time, .. } if time != 0);
        registers.set_argument(4, 0);
        (has_time && self.writes_rest).then_some(registers)
    }
}

/// Writes that nothing has happened.
pub(crate) fn write_nothing(memory: Memory, late: Late) -> std::io::Result<()> {
    match late {
        Late::Nothing => Ok(()),
        Late::Revents { address, count } => {
            let mut bytes = vec![0; 8 * count];
            memory.read(address, &mut bytes)?;
            for one in bytes.chunks_exact_mut(8) {
                if let Some(happened) = one.get_mut(6..) {
                    happened.fill(0);
                }
            }
            memory.write(address, &bytes)
        }
        Late::Sets {
            sets, bytes, time, ..
        } => {
            for address in sets.into_iter().filter(|address| *address != 0) {
                memory.write(address, &vec![0; bytes])?;
            }
            if time != 0 {
                memory.write_pair(time, 0, 0)?;
            }
            Ok(())
        }
    }
}
