//! Futexes, on which all locks and conditions are built. None of their waits reaches the kernel.

use std::io;

use crate::traced::arch::Registers;
use crate::traced::memory::Memory;
use crate::traced::sys::Tid;
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::tree::{AtEnd, Resume, State};
use crate::traced::wait::{FutexKey, Wait};

const ALL_BITS: u32 = u32::MAX;

impl Tracer<'_> {
    /// The call `futex`.
    pub(crate) fn futex(&mut self, tid: Tid, registers: Registers) -> Result<Handling, Halt> {
        let [address, operation, value, timeout, address2, value3] = registers.arguments();
        let low = |number: u64| u32::try_from(number & 0xFFFF_FFFF).unwrap_or_default();
        let operation = i32::try_from(low(operation)).unwrap_or(-1);
        let private = operation & libc::FUTEX_PRIVATE_FLAG != 0;
        let by_date = operation & libc::FUTEX_CLOCK_REALTIME != 0;
        let (value, value3) = (low(value), low(value3));
        if !address.is_multiple_of(4) {
            return Ok(Handling::Make);
        }
        let command = operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME);
        match command {
            libc::FUTEX_WAIT | libc::FUTEX_WAIT_BITSET => {
                if Memory(tid).read_u32(address)? != value {
                    return Ok(Handling::Answer(-i64::from(libc::EAGAIN)));
                }
                let mut deadline = None;
                if timeout != 0 {
                    let Some(span) = crate::traced::clock::span(Memory(tid).read_pair(timeout)?)
                    else {
                        return Ok(Handling::Make);
                    };
                    deadline = if command == libc::FUTEX_WAIT {
                        Some(self.now.saturating_add(span))
                    } else if by_date {
                        self.clocks.when(libc::CLOCK_REALTIME, span, self.now)
                    } else {
                        self.clocks.when(libc::CLOCK_MONOTONIC, span, self.now)
                    };
                }
                let bits = match command {
                    libc::FUTEX_WAIT => ALL_BITS,
                    _ if value3 == 0 => return Ok(Handling::Make),
                    _ => value3,
                };
                let wait = Wait::Futex {
                    key: self.futex_key(tid, address, private),
                    address,
                    expected: value,
                    bits,
                };
                Ok(Handling::Hold(wait, deadline))
            }
            libc::FUTEX_WAKE | libc::FUTEX_WAKE_BITSET => {
                let bits = if command == libc::FUTEX_WAKE {
                    ALL_BITS
                } else {
                    value3
                };
                let key = self.futex_key(tid, address, private);
                let woken = self.wake(key, value, bits)?;
                Ok(Handling::Answer(woken))
            }
            libc::FUTEX_REQUEUE | libc::FUTEX_CMP_REQUEUE => {
                if command == libc::FUTEX_CMP_REQUEUE && Memory(tid).read_u32(address)? != value3 {
                    return Ok(Handling::Answer(-i64::from(libc::EAGAIN)));
                }
                let from = self.futex_key(tid, address, private);
                let to = self.futex_key(tid, address2, private);
                let woken = self.wake(from, value, ALL_BITS)?;
                let moved = self.requeue(from, to, address2, low(timeout));
                Ok(Handling::Answer(woken + moved))
            }
            libc::FUTEX_WAKE_OP => {
                let from = self.futex_key(tid, address, private);
                let to = self.futex_key(tid, address2, private);
                let others = wake_operation(Memory(tid), address2, value3)?;
                let mut woken = self.wake(from, value, ALL_BITS)?;
                if others {
                    woken += self.wake(to, low(timeout), ALL_BITS)?;
                }
                Ok(Handling::Answer(woken))
            }
            libc::FUTEX_LOCK_PI | libc::FUTEX_LOCK_PI2 => {
                self.lock_with_inheritance(tid, registers, command, (timeout, by_date))
            }
            libc::FUTEX_WAIT_REQUEUE_PI | libc::FUTEX_CMP_REQUEUE_PI => {
                Ok(Handling::Answer(-i64::from(libc::ENOSYS)))
            }
            _ => Ok(Handling::Make),
        }
    }

    /// A lock with priority inheritance: tried, and tried again whenever somebody else has run.
    fn lock_with_inheritance(
        &mut self,
        tid: Tid,
        registers: Registers,
        command: i32,
        (timeout, by_date): (u64, bool),
    ) -> Result<Handling, Halt> {
        let mut deadline = None;
        if timeout != 0 {
            let Some(span) = crate::traced::clock::span(Memory(tid).read_pair(timeout)?) else {
                return Ok(Handling::Make);
            };
            // The older form always goes by the date.
            let clock = if by_date || command == libc::FUTEX_LOCK_PI {
                libc::CLOCK_REALTIME
            } else {
                libc::CLOCK_MONOTONIC
            };
            deadline = self.clocks.when(clock, span, self.now);
        }
        if let Some(thread) = self.threads.get_mut(&tid) {
            deadline = thread.again_until.take().or(deadline);
        }
        let private = registers.arguments()[1] & u64::from(libc::FUTEX_PRIVATE_FLAG.unsigned_abs());
        let mut tried = registers;
        tried.set_argument(
            1,
            private | u64::from(libc::FUTEX_TRYLOCK_PI.unsigned_abs()),
        );
        let at_end = AtEnd::Again {
            before: registers,
            would_wait: &[libc::EAGAIN],
            restore: None,
            deadline,
            late: -i64::from(libc::ETIMEDOUT),
        };
        Ok(Handling::ToEnd(tried, at_end))
    }

    /// Wakes so many who wait there, those first that have waited longest; how many there were.
    fn wake(&mut self, key: FutexKey, most: u32, bits: u32) -> io::Result<i64> {
        let mut woken = 0;
        for tid in self.waiters(key, bits) {
            if woken >= i64::from(most) {
                break;
            }
            self.wake_one(tid)?;
            woken += 1;
        }
        Ok(woken)
    }

    fn wake_one(&mut self, tid: Tid) -> io::Result<()> {
        if let Some(hold) = self.threads.get(&tid).and_then(|thread| thread.hold()) {
            let mut registers = hold.registers;
            registers.answer(0);
            registers.set(tid)?;
        }
        self.set_state(tid, State::Ready(Resume::Go(0)));
        Ok(())
    }

    fn waiters(&self, wanted: FutexKey, with: u32) -> Vec<Tid> {
        let mut waiters: Vec<(u64, Tid)> = self
            .threads
            .iter()
            .filter_map(|(tid, thread)| match thread.hold() {
                Some(hold) => match hold.wait {
                    Wait::Futex { key, bits, .. } if key == wanted && bits & with != 0 => {
                        Some((hold.since, *tid))
                    }
                    _ => None,
                },
                None => None,
            })
            .collect();
        waiters.sort_unstable();
        waiters.into_iter().map(|(_, tid)| tid).collect()
    }

    fn requeue(&mut self, from: FutexKey, to: FutexKey, there: u64, most: u32) -> i64 {
        let mut moved = 0;
        for tid in self.waiters(from, ALL_BITS) {
            if moved >= i64::from(most) {
                break;
            }
            // What is there says nothing of how long to wait.
            let word = Memory(tid).read_u32(there).unwrap_or_default();
            if let Some(thread) = self.threads.get_mut(&tid)
                && let State::Held(hold) = &mut thread.state
                && let Wait::Futex {
                    key,
                    address,
                    expected,
                    ..
                } = &mut hold.wait
            {
                (*key, *address, *expected) = (to, there, word);
                moved += 1;
            }
        }
        moved
    }

    /// A thread has ended: the system itself has changed futexes that tell of it, and wakes nobody,
    /// since nobody waits in it. To wake somebody for nothing is allowed.
    pub(crate) fn wake_changed_futexes(&mut self) {
        let changed: Vec<Tid> = self
            .threads
            .iter()
            .filter(|(tid, thread)| match thread.hold().map(|hold| &hold.wait) {
                Some(Wait::Futex {
                    address, expected, ..
                }) => Memory(**tid)
                    .read_u32(*address)
                    .is_ok_and(|now| now != *expected),
                _ => false,
            })
            .map(|(tid, _)| *tid)
            .collect();
        for tid in changed {
            // Who has gone meanwhile is told of otherwise.
            let _ = self.wake_one(tid);
        }
    }

    fn futex_key(&self, tid: Tid, address: u64, private: bool) -> FutexKey {
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let memory = self.processes.get(&process).map_or(0, |one| one.memory);
        let own = FutexKey::Private(memory, address);
        if private {
            return own;
        }
        shared_place(process, address).unwrap_or(own)
    }
}

/// The place in a file that an address leads to, if several memories can share it.
fn shared_place(process: Tid, address: u64) -> Option<FutexKey> {
    let maps = std::fs::read_to_string(format!("/proc/{process}/maps")).ok()?;
    for line in maps.lines() {
        let mut words = line.split_whitespace();
        let (from, to) = words.next()?.split_once('-')?;
        let number = |text: &str| u64::from_str_radix(text, 16).ok();
        let (from, to) = (number(from)?, number(to)?);
        if !(from..to).contains(&address) {
            continue;
        }
        let rights = words.next()?;
        let offset = number(words.next()?)?;
        let (major, minor) = words.next()?.split_once(':')?;
        let device = number(major)? << 32 | number(minor)?;
        let inode = words.next()?.parse().ok()?;
        let place = FutexKey::Shared(device, inode, address - from + offset);
        return rights.ends_with('s').then_some(place);
    }
    None
}

/// What `FUTEX_WAKE_OP` does to the second word; whether its waiters are to be woken as well.
fn wake_operation(memory: Memory, address: u64, code: u32) -> io::Result<bool> {
    let operation = code >> 28 & 7;
    // Twelve bits with a sign each.
    let signed = |bits: u32| (bits << 20).cast_signed() >> 20;
    let mut operand = signed(code >> 12 & 0xFFF);
    let compared = signed(code & 0xFFF);
    if code >> 31 != 0 {
        operand = 1_i32.wrapping_shl(operand.unsigned_abs());
    }
    let old = memory.read_u32(address)?.cast_signed();
    let new = match operation {
        0 => operand,
        1 => old.wrapping_add(operand),
        2 => old | operand,
        3 => old & !operand,
        _ => old ^ operand,
    };
    memory.write(address, &new.to_ne_bytes())?;
    Ok(match code >> 24 & 0xF {
        0 => old == compared,
        1 => old != compared,
        2 => old < compared,
        3 => old <= compared,
        4 => old > compared,
        _ => old >= compared,
    })
}
