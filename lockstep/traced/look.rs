//! Looking at waits: whether what they are for is there, or their time is over.

use rustix::event::PollFlags;

use crate::traced::arch::Registers;
use crate::traced::clock::nanoseconds;
use crate::traced::sys::Tid;
use crate::traced::syscall::{Halt, counted};
use crate::traced::terminal::room;
use crate::traced::tracer::Tracer;
use crate::traced::tree::State;
use crate::traced::wait::{Resume, Wait};

/// Result of a look at a wait.
enum Look {
    /// It goes on.
    Waits,
    /// The call is made as it is.
    Make,
    Answer(i64),
    /// The call is made again, since it is at its end.
    Again,
    Resume(Resume),
}

impl Tracer<'_> {
    /// Looks at everybody who waits; whether anybody can go on.
    pub(crate) fn look_at_waits(&mut self) -> Result<bool, Halt> {
        let mut any = false;
        // Those that have not been looked at since something has happened.
        for tid in self.tree.all(|one| {
            one.hold()
                .is_some_and(|hold| hold.looked_at < self.schedule.happened)
        }) {
            any |= self.look_at(tid)?;
        }
        Ok(any)
    }

    fn look_at(&mut self, tid: Tid) -> Result<bool, Halt> {
        let happened = self.schedule.happened;
        let Some(hold) = self.tree.hold_of(tid) else {
            return Ok(false);
        };
        hold.looked_at = happened;
        let mut registers = hold.registers;
        let (asked, ends) = (hold.deadline, hold.ends());
        // Taken out for the look, and put back if it goes on.
        let mut wait = std::mem::replace(&mut hold.wait, Wait::Forever);
        let is_over = ends.is_some_and(|at| at <= self.now);
        let deadline = self.new_deadline(&mut wait, asked);
        let look = match self.look(tid, &mut wait, (deadline, is_over)) {
            Ok(Look::Waits) if is_over && deadline == asked => self.late(tid, &wait),
            look => look,
        };
        let look = match look {
            Err(Halt::Make) => Look::Answer(-i64::from(libc::EFAULT)),
            look => look?,
        };
        let next = match look {
            Look::Waits => {
                if let Some(hold) = self.tree.hold_of(tid) {
                    (hold.wait, hold.deadline) = (wait, deadline);
                }
                return Ok(false);
            }
            Look::Make => Resume::Go(0),
            Look::Answer(result) => {
                registers.answer(tid, result)?;
                Resume::Go(0)
            }
            Look::Again => {
                let thread = self.tree.thread(tid)?;
                thread.retries = true;
                thread.again_until = deadline;
                registers.make_again();
                registers.set(tid)?;
                Resume::Go(0)
            }
            Look::Resume(resume) => resume,
        };
        self.tree.set_state(tid, State::Ready(next));
        Ok(true)
    }

    /// Returns whether what is waited for is there.
    fn look(
        &mut self,
        tid: Tid,
        wait: &mut Wait,
        (deadline, is_late): (Option<u64>, bool),
    ) -> Result<Look, Halt> {
        let make_if = |is_there| if is_there { Look::Make } else { Look::Waits };
        Ok(match wait {
            Wait::Poll { set, result, .. } => {
                let found = self.readiness(tid, set);
                if found.iter().all(PollFlags::is_empty) {
                    return Ok(Look::Waits);
                }
                let answer = self.answer_poll(tid, set, &found, result, deadline)?;
                answer.map_or(Look::Make, Look::Answer)
            }
            Wait::Descriptor {
                fd,
                flags,
                room,
                has_more,
                ..
            } => match self.descriptor(self.tree.process_of(tid), *fd) {
                Some(_) if self.has_signal(tid, *fd) => Look::Make,
                Some(descriptor) if flags.contains(PollFlags::OUT) => {
                    make_if(descriptor.has_room(*room))
                }
                Some(descriptor) if !descriptor.is_ready(*flags) => Look::Waits,
                Some(_) if *has_more => Look::Resume(Resume::Call { crept: true }),
                _ => Look::Make,
            },
            Wait::PortRead {
                port,
                device,
                rule,
                into,
                ..
            } => match self.ports.get(*port) {
                Some(found) if found.is_device(*device) => {
                    if !found.can_be_read(*rule, room(into)) {
                        return Ok(Look::Waits);
                    }
                    Look::Answer(self.receive(tid, *port, into)?)
                }
                // The system says that it is gone.
                _ => Look::Make,
            },
            Wait::PortWrite {
                port,
                device,
                bytes,
                sent,
                count,
            } => {
                if !self
                    .ports
                    .get(*port)
                    .is_some_and(|port| port.is_device(*device))
                {
                    return Ok(Look::Answer(-i64::from(libc::EIO)));
                }
                *sent += self.send(*port, bytes.get(*sent..).unwrap_or_default())?;
                if *sent < bytes.len() {
                    Look::Waits
                } else {
                    Look::Answer(counted(*count))
                }
            }
            // Each time something has happened; but not when it is too late.
            Wait::Again { .. } if is_late => Look::Waits,
            Wait::Child | Wait::Again { .. } => Look::Again,
            Wait::Signal { .. }
            | Wait::Sleep { .. }
            | Wait::BackOff(_)
            | Wait::Futex { .. }
            | Wait::Vfork { .. }
            | Wait::Forever => Look::Waits,
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
    fn late(&mut self, tid: Tid, wait: &Wait) -> Result<Look, Halt> {
        Ok(match wait {
            Wait::BackOff(resume) => Look::Resume(*resume),
            Wait::Sleep { .. } => Look::Answer(0),
            Wait::Poll { set, result, .. } => {
                let nothing = vec![PollFlags::empty(); set.len()];
                let answer = self.answer_poll(tid, set, &nothing, result, None)?;
                Look::Answer(answer.unwrap_or(0))
            }
            Wait::Descriptor { late, .. } => Look::Answer(*late),
            Wait::Again { late } => {
                // At its end; what it returned is replaced.
                let mut registers = Registers::of(tid)?;
                registers.set_result(*late);
                registers.set(tid)?;
                Look::Make
            }
            Wait::PortRead { port, into, .. } => match self.ports[*port].unread() {
                0 => Look::Answer(0),
                _ => Look::Answer(self.receive(tid, *port, into)?),
            },
            Wait::Futex { .. } => Look::Answer(-i64::from(libc::ETIMEDOUT)),
            Wait::Signal { .. } => Look::Answer(-i64::from(libc::EAGAIN)),
            Wait::PortWrite { .. } | Wait::Child | Wait::Vfork { .. } | Wait::Forever => {
                Look::Waits
            }
        })
    }
}
