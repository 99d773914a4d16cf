//! Calls that ask for the time, or set it, or sleep.

use crate::traced::arch::Registers;
use crate::traced::call::Call;
use crate::traced::clock::{parts, parts_micros, span, span_micros};
use crate::traced::entry::int;
use crate::traced::memory::Memory;
use crate::traced::sys::Tid;
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::wait::Wait;

/// Ticks of `times` in a second.
pub(crate) const TICKS_A_SECOND: u64 = 100;

impl Tracer<'_> {
    pub(crate) fn clock_call(
        &mut self,
        tid: Tid,
        call: Call,
        registers: Registers,
        crept: bool,
    ) -> Result<Handling, Halt> {
        let a = registers.arguments();
        let memory = Memory(tid);
        match call {
            Call::ClockSettime | Call::Settimeofday => {
                let is_real = call == Call::Settimeofday || int(a[0]) == libc::CLOCK_REALTIME;
                let address = match call {
                    Call::ClockSettime => a[1],
                    _ => a[0],
                };
                if !is_real || address == 0 || !rustix::process::geteuid().is_root() {
                    return Ok(Handling::Make);
                }
                let date = memory.read_pair(address)?;
                let date = match call {
                    Call::ClockSettime => span(date),
                    _ => span_micros(date),
                };
                let Some(to) = date else {
                    return Ok(Handling::Make);
                };
                self.clocks.set_real(to, self.now);
                return Ok(Handling::Answer(0));
            }
            _ => {}
        }
        if let Some(action) = self.ask(tid, crept) {
            return Ok(action);
        }
        match call {
            Call::ClockGettime => {
                let Some(shown) = self.clocks.show(int(a[0]), self.now) else {
                    return Ok(Handling::Make);
                };
                let (seconds, nanoseconds) = parts(shown);
                memory.write_pair(a[1], seconds, nanoseconds)?;
                Ok(Handling::Answer(0))
            }
            Call::Gettimeofday => {
                if a[0] != 0 {
                    let (seconds, micros) = parts_micros(self.clocks.real(self.now));
                    memory.write_pair(a[0], seconds, micros)?;
                }
                if a[1] != 0 {
                    memory.write(a[1], &[0; 8])?;
                }
                Ok(Handling::Answer(0))
            }
            Call::Time => {
                let (seconds, _) = parts(self.clocks.real(self.now));
                if a[0] != 0 {
                    memory.write(a[0], &seconds.to_ne_bytes())?;
                }
                Ok(Handling::Answer(seconds))
            }
            _ => {
                // Processor time is none of what is simulated, and would differ each time.
                if a[0] != 0 {
                    memory.write(a[0], &[0; 32])?;
                }
                let ticks = self.clocks.monotonic(self.now) / (1_000_000_000 / TICKS_A_SECOND);
                Ok(Handling::Answer(i64::try_from(ticks).unwrap_or(i64::MAX)))
            }
        }
    }

    pub(crate) fn sleep(&mut self, tid: Tid, call: Call, a: [u64; 6]) -> Result<Handling, Halt> {
        let (clock, absolute, time, rest) = match call {
            Call::Nanosleep => (libc::CLOCK_MONOTONIC, false, a[0], a[1]),
            _ => (int(a[0]), a[1] & 1 != 0, a[2], a[3]),
        };
        let Some(time) = span(Memory(tid).read_pair(time)?) else {
            return Ok(Handling::Make);
        };
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
        Ok(Handling::Hold(Wait::Sleep { rest }, deadline))
    }
}
