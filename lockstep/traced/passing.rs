//! Simulated time advances when no thread can run; no faster than real time while one waits for the
//! outside.

use std::time::{Duration, Instant};

use crate::port::Port;
use crate::traced::outside::{self, Outside};
use crate::traced::syscall::Halt;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::{Block, Wait};
use crate::{Reason, Step};

/// The longest step of time while a thread waits for the world outside.
const PACE: u64 = 10_000_000;

impl Tracer<'_> {
    /// No thread can run: advances time. Returns `false` when the run is over.
    pub(crate) fn let_time_pass(&mut self) -> Result<bool, Halt> {
        let blocks = self.tree.threads.values().filter_map(Thread::block);
        let deadline = blocks.filter_map(Block::ends).min();
        let mut until = [deadline, self.timers.next(), self.limits.killed_at]
            .into_iter()
            .flatten()
            .min();
        let outside = self.outside_waits();
        if !outside.is_empty() || self.is_any_in_kernel() {
            let most = until.unwrap_or(u64::MAX).min(self.now + PACE);
            match self.wait_outside(&outside, most)? {
                Some(to) => until = Some(to),
                None => return Ok(true),
            }
        } else if self.limits.paced.take().is_some() {
            // The awaited event may have come since the last poll.
            self.schedule.happened += 1;
            return Ok(true);
        }
        if self.limits.killed_at.is_some_and(|at| at <= self.now) {
            self.kill_all();
            return Ok(false);
        }
        let step = if self.limits.killed_at.is_some() {
            until.map_or(Step::Never, Step::To)
        } else {
            if self.world.wants_waits() {
                let waits = self.waits();
                self.world.waits(self.now, waits);
            }
            let ran = self.schedule.happened != self.schedule.advanced;
            self.world.advance(self.ports, self.now, until, ran)?
        };
        match step {
            Step::To(to) => {
                self.now = self.now.max(to);
                self.schedule.happened += 1;
                self.schedule.advanced = self.schedule.happened;
                self.ports.iter_mut().for_each(Port::make_room);
                self.fire_timers()?;
            }
            step => {
                let continues = step == Step::Over && (until.is_some() || self.may_continue());
                let reason = match continues {
                    true => Reason::Over,
                    false => Reason::Deadlock(self.waits_text()),
                };
                self.ask_to_end(reason);
            }
        }
        Ok(true)
    }

    /// Returns whether a thread waits for what the world, or a signal, might still bring.
    fn may_continue(&self) -> bool {
        let mut threads = self.tree.threads.values();
        threads.any(|thread| match thread.block().map(|block| &block.wait) {
            Some(Wait::Poll { set, .. }) => {
                let files = self.polled_files(thread.process, set);
                set.is_empty() || files.iter().any(|(file, _)| self.port_of(file).is_some())
            }
            Some(Wait::Futex { .. } | Wait::Again(_) | Wait::Transfer(_) | Wait::Vfork { .. }) => {
                false
            }
            _ => true,
        })
    }

    fn is_any_in_kernel(&self) -> bool {
        let mut threads = self.tree.threads.values();
        threads.any(|thread| matches!(thread.state, State::InKernel))
    }

    /// Waits for the outside, in real time no longer than simulated time may advance. Returns the time to which
    /// it may advance, or `None` if something has happened outside.
    fn wait_outside(&mut self, waits: &[Outside], most: u64) -> Result<Option<u64>, Halt> {
        for wait in waits {
            self.report.outside.insert(wait.name.clone());
        }
        let (begun, from) = *self.limits.paced.get_or_insert((Instant::now(), self.now));
        let span = Duration::from_nanos(most.saturating_sub(from));
        // A thread returns from the kernel without a notification.
        let slice = if self.is_any_in_kernel() {
            Duration::from_millis(1)
        } else {
            span
        };
        let mut counted = Instant::now();
        loop {
            self.limits.used += counted.elapsed();
            counted = Instant::now();
            let left = span.saturating_sub(begun.elapsed()).min(slice);
            let found = outside::wait(waits, left)?;
            let mut any = found;
            while self.take_stop(false)? {
                any = true;
            }
            if any {
                self.schedule.happened += 1;
                return Ok(None);
            }
            if begun.elapsed() >= span {
                return Ok(Some(most));
            }
            if self.is_over_time() {
                return Ok(Some(self.now));
            }
        }
    }
}
