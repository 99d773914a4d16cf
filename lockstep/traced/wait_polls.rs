//! Polls of waits: whether their event has come, or their deadline.

use crate::traced::clock::nanoseconds;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Halt, counted};
use crate::traced::terminal::room;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::{Resume, Wait};

/// Result of a poll of a wait.
enum Polled {
    /// It goes on.
    Waits,
    Answer(i64),
    Resume(Resume),
}

impl Tracer<'_> {
    /// Polls all waits; returns whether any thread can resume.
    pub(crate) fn poll_waits(&mut self) -> Result<bool, Halt> {
        let (mut any, happened) = (false, self.schedule.happened);
        let polled_at = |one: &Thread| one.block().map(|block| block.polled_at);
        // Waits not polled since the last event, the longest ago first.
        let mut all = self
            .tree
            .all(|one| polled_at(one).is_some_and(|at| at < happened));
        all.sort_by_key(|tid| self.tree.threads.get(tid).and_then(polled_at));
        for tid in all {
            any |= self.poll_wait(tid)?;
        }
        // A write that waits for more room has filled what there was.
        Ok(any || happened < self.schedule.happened)
    }

    /// Polls a wait; returns whether its thread can resume.
    fn poll_wait(&mut self, tid: Tid) -> Result<bool, Halt> {
        let happened = self.schedule.happened;
        let Some(block) = self.tree.block_of(tid) else {
            return Ok(false);
        };
        block.polled_at = happened;
        let registers = block.registers;
        let (asked, ends) = (block.deadline, block.ends());
        // Removed for the poll, and put back if the wait continues.
        let mut wait = std::mem::replace(&mut block.wait, Wait::Forever);
        let is_over = ends.is_some_and(|at| at <= self.now);
        let deadline = self.new_deadline(&mut wait, asked);
        let polled = match self.polled(tid, &mut wait, is_over) {
            Ok(Polled::Waits) if is_over && deadline == asked => self.late(tid, &mut wait),
            polled => polled,
        };
        let next = match polled {
            Ok(Polled::Waits) => {
                if let Some(block) = self.tree.block_of(tid) {
                    (block.wait, block.deadline) = (wait, deadline);
                }
                return Ok(false);
            }
            Ok(Polled::Resume(resume)) => resume,
            Ok(Polled::Answer(result)) => {
                registers.answer(tid, result)?;
                Resume::Go(0)
            }
            Err(Halt::Make) => {
                registers.answer(tid, -i64::from(libc::EFAULT))?;
                Resume::Go(0)
            }
            Err(halt) => return Err(halt),
        };
        self.tree.set_state(tid, State::Ready(next));
        Ok(true)
    }

    /// Returns whether the awaited event has come.
    fn polled(&mut self, tid: Tid, wait: &mut Wait, is_late: bool) -> Result<Polled, Halt> {
        Ok(match wait {
            Wait::Poll { set, result, times } => {
                let answer = self.poll_now(tid, set, result, (*times, false))?;
                answer.map_or(Polled::Waits, Polled::Answer)
            }
            Wait::PortRead {
                port,
                device,
                rule,
                into,
                ..
            } => match self.ports.get(*port) {
                Some(found) if found.is_device(*device) => {
                    if !found.can_be_read(*rule, room(into)) {
                        return Ok(Polled::Waits);
                    }
                    Polled::Answer(self.receive(tid, *port, into)?)
                }
                // As a terminal does for pending reads; later reads find the end.
                _ => Polled::Answer(-i64::from(libc::EIO)),
            },
            Wait::PortWrite {
                port,
                device,
                bytes,
                sent,
                count,
            } => match self.ports.get(*port) {
                Some(found) if found.is_device(*device) => {
                    let rest = bytes.get(*sent..).unwrap_or_default();
                    let more = self.send_to_world(*port, rest)?;
                    *sent += more;
                    self.schedule.happened += u64::from(more > 0);
                    if *sent < bytes.len() {
                        Polled::Waits
                    } else {
                        Polled::Answer(counted(*count))
                    }
                }
                // The system says why.
                _ if *sent == 0 => Polled::Resume(Resume::Go(0)),
                _ => Polled::Answer(counted(*sent.min(count))),
            },
            Wait::Transfer(rest) if !self.is_ready(tid, &rest.of, rest.flags) => Polled::Waits,
            Wait::Transfer(rest) => {
                let before = rest.done;
                let answer = self.transfer(tid, rest)?;
                self.schedule.happened += u64::from(rest.done > before);
                answer.map_or(Polled::Waits, Polled::Answer)
            }
            // Retried after each event, but not after the deadline.
            Wait::Again(retried) if !is_late => {
                let result = self.try_once(tid, retried)?;
                result.map_or(Polled::Waits, Polled::Answer)
            }
            Wait::Again(_)
            | Wait::Signal { .. }
            | Wait::Sleep { .. }
            | Wait::BackOff(_)
            | Wait::Futex { .. }
            | Wait::Vfork { .. }
            | Wait::Forever => Polled::Waits,
        })
    }

    /// A read that has a time between bytes waits again after each.
    fn new_deadline(&self, wait: &mut Wait, deadline: Option<u64>) -> Option<u64> {
        if let Wait::PortRead {
            port, seen, rule, ..
        } = wait
            && let (Some(port), Some(patience)) = (self.ports.get(*port), rule.patience)
            && rule.least.is_some_and(|least| least > 0)
        {
            let unread = port.unread();
            if unread > *seen {
                *seen = unread;
                return Some(self.now.saturating_add(nanoseconds(patience)));
            }
        }
        deadline
    }

    /// The time of a wait is over.
    fn late(&mut self, tid: Tid, wait: &mut Wait) -> Result<Polled, Halt> {
        Ok(match wait {
            Wait::BackOff(resume) => Polled::Resume(*resume),
            Wait::Sleep { .. } => Polled::Answer(0),
            Wait::Poll { set, result, times } => {
                let answer = self.poll_now(tid, set, result, (*times, true))?;
                Polled::Answer(answer.unwrap_or(0))
            }
            Wait::Again(retried) => Polled::Answer(retried.late.into()),
            Wait::PortRead { port, into, .. } => match self.ports[*port].unread() {
                0 => Polled::Answer(0),
                _ => Polled::Answer(self.receive(tid, *port, into)?),
            },
            Wait::Futex { .. } => Polled::Answer(-i64::from(libc::ETIMEDOUT)),
            Wait::Signal { .. } => Polled::Answer(-i64::from(libc::EAGAIN)),
            Wait::Transfer(rest) if rest.done == 0 => Polled::Answer(match rest.whole.0 {
                libc::SYS_mq_timedsend | libc::SYS_mq_timedreceive => -i64::from(libc::ETIMEDOUT),
                _ => -i64::from(libc::EAGAIN),
            }),
            Wait::Transfer(rest) => Polled::Answer(counted(rest.done)),
            Wait::PortWrite { .. } | Wait::Vfork { .. } | Wait::Forever => Polled::Waits,
        })
    }
}
