//! Futexes, on which all locks and conditions are built. None of their waits reaches the kernel.

use std::io;

use crate::traced::memory::Memory;
use crate::traced::proc::{mapping, number};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, failure, low};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::{Block, FutexKey, Resume, Retried, Wait};

const ALL_BITS: u32 = u32::MAX;

impl Tracer<'_> {
    pub(crate) fn futex(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let tid = entry.tid;
        let [address, operation, value, timeout, address2, value3] = entry.a;
        let operation = i32::try_from(low(operation)).unwrap_or(-1);
        let private = operation & libc::FUTEX_PRIVATE_FLAG != 0;
        let clock = match operation & libc::FUTEX_CLOCK_REALTIME {
            0 => libc::CLOCK_MONOTONIC,
            _ => libc::CLOCK_REALTIME,
        };
        let (value, value3) = (low(value), low(value3));
        if !address.is_multiple_of(4) {
            return Ok(Handling::Make);
        }
        let command = operation & !(libc::FUTEX_PRIVATE_FLAG | libc::FUTEX_CLOCK_REALTIME);
        let bits = match command {
            libc::FUTEX_WAIT_BITSET | libc::FUTEX_WAKE_BITSET => value3,
            _ => ALL_BITS,
        };
        match command {
            _ if bits == 0 => Ok(Handling::Make),
            libc::FUTEX_WAIT | libc::FUTEX_WAIT_BITSET => {
                if Memory(tid).read_u32(address)? != value {
                    return Ok(failure(libc::EAGAIN));
                }
                let clock = (command != libc::FUTEX_WAIT).then_some(clock);
                let deadline = self.deadline_at(tid, timeout, clock)?;
                let wait = Wait::Futex {
                    key: self.futex_key(tid, address, private),
                    address,
                    expected: value,
                    bits,
                };
                Ok(Handling::Block(wait, deadline))
            }
            libc::FUTEX_WAKE | libc::FUTEX_WAKE_BITSET => {
                let key = self.futex_key(tid, address, private);
                let woken = self.wake(key, value, bits)?;
                Ok(Handling::Answer(woken))
            }
            libc::FUTEX_REQUEUE | libc::FUTEX_CMP_REQUEUE => {
                if command == libc::FUTEX_CMP_REQUEUE && Memory(tid).read_u32(address)? != value3 {
                    return Ok(failure(libc::EAGAIN));
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
            // The older form always goes by the date.
            libc::FUTEX_LOCK_PI => self.lock_with_inheritance(entry, libc::CLOCK_REALTIME),
            libc::FUTEX_LOCK_PI2 => self.lock_with_inheritance(entry, clock),
            libc::FUTEX_WAIT_REQUEUE_PI | libc::FUTEX_CMP_REQUEUE_PI => {
                self.report.missing.insert("futex (REQUEUE_PI)".to_owned());
                Ok(failure(libc::ENOSYS))
            }
            _ => Ok(Handling::Make),
        }
    }

    /// A lock with priority inheritance: tried again whenever another thread has run.
    fn lock_with_inheritance(&mut self, entry: Entry, clock: i32) -> Result<Handling, Halt> {
        let deadline = self.deadline_at(entry.tid, entry.a[3], Some(clock))?;
        let private = entry.a[1] & u64::from(libc::FUTEX_PRIVATE_FLAG.unsigned_abs());
        let operation = private | u64::from(libc::FUTEX_TRYLOCK_PI.unsigned_abs());
        let mut arguments = entry.a;
        arguments[1] = operation;
        let retried = Retried {
            call: (libc::SYS_futex, arguments),
            memory: Vec::new(),
            would_wait: &[-libc::EAGAIN],
            found: None,
            seen: None,
            late: -libc::ETIMEDOUT,
        };
        self.retry(entry, retried, deadline)
    }

    /// Wakes up to this many waiters, the longest waiting first; returns how many.
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
        if let Some(block) = self.tree.block_of(tid) {
            block.registers.answer(tid, 0)?;
        }
        self.tree.set_state(tid, State::Ready(Resume::Go(0)));
        Ok(())
    }

    fn waiters(&self, wanted: FutexKey, with: u32) -> Vec<Tid> {
        let waits = |(tid, thread): (&Tid, &Thread)| match thread.block()? {
            Block {
                wait: Wait::Futex { key, bits, .. },
                since,
                ..
            } if *key == wanted && bits & with != 0 => Some((*since, *tid)),
            _ => None,
        };
        let mut waiters: Vec<(u64, Tid)> = self.tree.threads.iter().filter_map(waits).collect();
        waiters.sort_unstable();
        waiters.into_iter().map(|(_, tid)| tid).collect()
    }

    fn requeue(&mut self, from: FutexKey, to: FutexKey, there: u64, most: u32) -> i64 {
        let mut moved = 0;
        for tid in self.waiters(from, ALL_BITS) {
            if moved >= i64::from(most) {
                break;
            }
            // The value by which later changes at the new address are found.
            let word = Memory(tid).read_u32(there).unwrap_or_default();
            if let Some(block) = self.tree.block_of(tid)
                && let Wait::Futex { bits, .. } = block.wait
            {
                block.wait = Wait::Futex {
                    key: to,
                    address: there,
                    expected: word,
                    bits,
                };
                moved += 1;
            }
        }
        moved
    }

    /// A thread has ended: the system has changed its futexes, but wakes no thread, since none waits in the
    /// kernel. Spurious wake-ups are allowed.
    pub(crate) fn wake_changed_futexes(&mut self) {
        let changed = |(tid, thread): (&Tid, &Thread)| match thread.block()?.wait {
            Wait::Futex {
                address, expected, ..
            } => {
                let now = Memory(*tid).read_u32(address).ok()?;
                (now != expected).then_some(*tid)
            }
            _ => None,
        };
        let changed: Vec<Tid> = self.tree.threads.iter().filter_map(changed).collect();
        for tid in changed {
            // A thread that has gone meanwhile is reported otherwise.
            let _ = self.wake_one(tid);
        }
    }

    fn futex_key(&self, tid: Tid, address: u64, private: bool) -> FutexKey {
        let process = self.tree.process_of(tid);
        let process_here = self.tree.processes.get(&process);
        let own = FutexKey::Private(process_here.map_or(0, |one| one.memory), address);
        if private {
            return own;
        }
        shared_place(process, address).unwrap_or(own)
    }
}

/// The place in a file that an address leads to, if several memories can share it.
fn shared_place(process: Tid, address: u64) -> Option<FutexKey> {
    let (from, rest) = mapping(process, address)?;
    let mut words = rest.split_whitespace();
    let rights = words.next()?;
    let offset = number(words.next()?)?;
    let (major, minor) = words.next()?.split_once(':')?;
    let device = number(major)? << 32 | number(minor)?;
    let inode = words.next()?.parse().ok()?;
    let place = FutexKey::Shared(device, inode, address - from + offset);
    rights.ends_with('s').then_some(place)
}

/// Does to the second word what `FUTEX_WAKE_OP` does; says whether its waiters are to be woken as well.
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
