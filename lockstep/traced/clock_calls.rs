//! Syscalls that read the time, set it, or sleep.

use crate::traced::arch::Syscall;
use crate::traced::clock::{parts, parts_micros, span};
use crate::traced::memory::Memory;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, failure, int};
use crate::traced::tracer::Tracer;
use crate::traced::wait::Wait;

/// The time of `timex` has nanoseconds.
const STA_NANO: u32 = libc::STA_NANO.cast_unsigned();

pub(crate) const TICKS_A_SECOND: u64 = 100;

impl Tracer<'_> {
    pub(crate) fn clock_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let a = entry.a;
        let memory = Memory(entry.tid);
        if let Some(action) = self.query(entry) {
            return Ok(action);
        }
        match entry.call {
            Syscall::ClockGettime => {
                let shown = self.clocks.show(int(a[0]), self.now).ok_or(Halt::Make)?;
                let (seconds, nanoseconds) = parts(shown);
                memory.write_pair(a[1], seconds, nanoseconds)?;
                Ok(Handling::Answer(0))
            }
            Syscall::Gettimeofday => {
                if a[0] != 0 {
                    let (seconds, micros) = parts_micros(self.clocks.real(self.now));
                    memory.write_pair(a[0], seconds, micros)?;
                }
                if a[1] != 0 {
                    memory.write(a[1], &[0; 8])?;
                }
                Ok(Handling::Answer(0))
            }
            Syscall::Time => {
                let (seconds, _) = parts(self.clocks.real(self.now));
                if a[0] != 0 {
                    memory.write(a[0], &seconds.to_ne_bytes())?;
                }
                Ok(Handling::Answer(seconds))
            }
            _ => {
                // Processor time is not simulated, and would differ in each run.
                if a[0] != 0 {
                    memory.write(a[0], &[0; 32])?;
                }
                let ticks = self.clocks.monotonic(self.now) / (1_000_000_000 / TICKS_A_SECOND);
                Ok(Handling::Answer(i64::try_from(ticks).unwrap_or(i64::MAX)))
            }
        }
    }

    /// End of a wait from the time at an address, if there is one: relative to now, or absolute by a clock.
    pub(crate) fn deadline_at(
        &self,
        tid: Tid,
        address: u64,
        clock: Option<i32>,
    ) -> Result<Option<u64>, Halt> {
        if address == 0 {
            return Ok(None);
        }
        let time = span(Memory(tid).read_pair(address)?).ok_or(Halt::Make)?;
        Ok(match clock {
            Some(clock) => self.clocks.when(clock, time, self.now),
            None => Some(self.now.saturating_add(time)),
        })
    }

    /// `adjtimex`: the clock may be read, and not be adjusted.
    pub(crate) fn adjust(&mut self, entry: Entry, address: u64) -> Result<Handling, Halt> {
        const STATUS: u64 = 40;
        const TIME: u64 = 72;
        let memory = Memory(entry.tid);
        if memory.read_u32(address)? != 0 {
            return Ok(failure(libc::EPERM));
        }
        let result = self.make(entry, entry.a)?;
        if result >= 0 {
            let is_nano = memory.read_u32(address + STATUS)? & STA_NANO != 0;
            let real = self.clocks.real(self.now);
            let (seconds, part) = (if is_nano { parts } else { parts_micros })(real);
            memory.write_pair(address + TIME, seconds, part)?;
        }
        Ok(Handling::Answer(result))
    }

    /// `sysinfo`: how long the system has run.
    pub(crate) fn uptime(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let result = self.make(entry, entry.a)?;
        if result >= 0 {
            let (uptime, _) = parts(self.clocks.monotonic(self.now));
            Memory(entry.tid).write(entry.a[0], &uptime.to_ne_bytes())?;
        }
        Ok(Handling::Answer(result))
    }

    pub(crate) fn sleep(&mut self, Entry { tid, call, a, .. }: Entry) -> Result<Handling, Halt> {
        let (clock, absolute, time, rest) = match call {
            Syscall::Nanosleep => (libc::CLOCK_MONOTONIC, false, a[0], a[1]),
            _ => (int(a[0]), a[1] & 1 != 0, a[2], a[3]),
        };
        let time = span(Memory(tid).read_pair(time)?).ok_or(Halt::Make)?;
        let deadline = if absolute {
            self.clocks.when(clock, time, self.now)
        } else {
            let known = self.clocks.show(clock, self.now);
            known.map(|_| self.now.saturating_add(time))
        };
        // A clock of processor time, or none.
        if deadline.is_none() {
            return Ok(Handling::Make);
        }
        let rest = (!absolute && rest != 0).then_some(rest);
        Ok(Handling::Block(Wait::Sleep { rest }, deadline))
    }
}
