//! What becomes of each call at which a thread is stopped, and of those whose end is looked at.

use rustix::event::PollFlags;

use crate::traced::arch::{self, Registers};
use crate::traced::call::Call;
use crate::traced::clock::{parts, parts_micros, span, span_micros};
use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid};
use crate::traced::tracer::{Action, Halt, Tracer};
use crate::traced::tree::{AtEnd, OwnClocks, Resume, State, kernel_state};
use crate::traced::wait::{Late, Wait};

/// Most random bytes of one call; the program asks for the rest again.
const MOST_RANDOM: usize = 1 << 16;
/// Ticks of `times` in a second.
const TICKS_A_SECOND: u64 = 100;

fn low(number: u64) -> u32 {
    u32::try_from(number & 0xFFFF_FFFF).unwrap_or_default()
}

/// An argument that is an `int`.
pub(crate) fn int(number: u64) -> i32 {
    low(number).cast_signed()
}

fn failure(errno: i32) -> Action {
    Action::Answer(-i64::from(errno))
}

impl Tracer<'_> {
    /// Decides what becomes of a call.
    pub(crate) fn call(
        &mut self,
        tid: Tid,
        registers: Registers,
        crept: bool,
    ) -> Result<Action, Halt> {
        let Some(call) = arch::call(registers.number()) else {
            return Ok(Action::Make);
        };
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let a = registers.arguments();
        match call {
            Call::ClockGettime
            | Call::Gettimeofday
            | Call::Time
            | Call::Times
            | Call::ClockSettime
            | Call::Settimeofday => self.clock_call(tid, call, registers, crept),
            Call::Nanosleep | Call::ClockNanosleep => self.sleep(tid, call, a),
            Call::Poll
            | Call::Ppoll
            | Call::Select
            | Call::Pselect
            | Call::EpollWait
            | Call::EpollPwait
            | Call::EpollPwait2 => self.poll_call(tid, process, call, a, crept),
            Call::Futex => self.futex(tid, registers),
            Call::Pause | Call::Sigsuspend | Call::Sigtimedwait => self.signal_call(tid, call, a),
            Call::Wait4 | Call::Waitid => self.child_call(tid, call, registers, crept),
            Call::Flock
            | Call::Fcntl
            | Call::Semop
            | Call::Semtimedop
            | Call::Msgsnd
            | Call::Msgrcv => self.lock_call(tid, call, registers),
            Call::Read
            | Call::Readv
            | Call::Write
            | Call::Writev
            | Call::Recvfrom
            | Call::Recvmsg
            | Call::Recvmmsg
            | Call::Sendto
            | Call::Sendmsg
            | Call::Sendmmsg
            | Call::Accept
            | Call::Splice
            | Call::Sendfile
            | Call::MqTimedsend
            | Call::MqTimedreceive => self.transfer_call(tid, process, call, registers, crept),
            Call::Ioctl => self.request(tid, process, (int(a[0]), low(a[1]), a[2]), crept),
            Call::Alarm => Ok(self.alarm(process, a[0])),
            Call::Setitimer => self.interval_timer(tid, process, Some(a[1]), a[2]),
            Call::Getitimer => self.interval_timer(tid, process, None, a[1]),
            Call::TimerCreate => self.timer_create(tid, registers),
            Call::TimerSettime => self.posix_timer(tid, process, a[0], Some((a[1], a[2])), a[3]),
            Call::TimerGettime => self.posix_timer(tid, process, a[0], None, a[1]),
            Call::TimerDelete => Ok(self.timer_delete(process, a[0])),
            Call::TimerfdSettime => {
                self.timer_descriptor(tid, process, int(a[0]), Some((a[1], a[2])), a[3])
            }
            Call::TimerfdGettime => self.timer_descriptor(tid, process, int(a[0]), None, a[1]),
            Call::Getrandom => self.random_bytes(tid, a[0], a[1]),
            Call::Yield => Ok(self.ask(tid, crept).unwrap_or_else(|| {
                self.give_way(tid);
                Action::Answer(0)
            })),
            Call::Getaffinity => affinity(tid, a[1], a[2]),
            Call::Setaffinity => Ok(Action::Answer(0)),
            // Only after a stop by job control.
            Call::Restart => Ok(failure(libc::EINTR)),
            Call::Kill | Call::Tgkill | Call::PidfdSendSignal => {
                Ok(self.kill_call(process, call, registers))
            }
            Call::Exit => Ok(self.exit(tid, process)),
            Call::ExitGroup => {
                self.is_dying(process);
                Ok(Action::Make)
            }
            Call::Clone => {
                // The child is traced like all others.
                let mut registers = registers;
                registers.set_argument(0, a[0] & !0x0080_0000);
                registers.set(tid)?;
                Ok(Action::Make)
            }
            Call::Ptrace => {
                self.refused
                    .insert("a debugger: only one can trace a program, and that is sim".to_owned());
                Ok(failure(libc::EPERM))
            }
            Call::Refused => Ok(failure(libc::ENOSYS)),
        }
    }

    /// A call has come to its end that is looked at.
    pub(crate) fn end_of_call(&mut self, tid: Tid) -> Result<(), Halt> {
        self.set_state(tid, State::Ready(Resume::Go(0)));
        let Some(at_end) = self.threads.get_mut(&tid).and_then(|t| t.at_end.take()) else {
            return Ok(());
        };
        let registers = Registers::of(tid)?;
        let result = registers.result();
        let process = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        // As the program left them, but for what the call returns.
        let back = |mut before: Registers| {
            before.set_result(result);
            before.set(tid)
        };
        match at_end {
            AtEnd::Restore(before) => back(before)?,
            AtEnd::Child(before) => {
                let waits = match arch::call(before.number()) {
                    Some(Call::Wait4) => result == 0,
                    // It tells of nobody.
                    _ => {
                        let info = before.arguments()[2];
                        result == 0 && info != 0 && Memory(tid).read_u32(info)? == 0
                    }
                };
                back(before)?;
                if waits {
                    self.hold(tid, before, Wait::Child, None);
                } else {
                    self.has_changed(tid);
                }
            }
            AtEnd::Again {
                before,
                would_wait,
                restore,
                deadline,
                late,
            } => {
                if let Some((address, bytes)) = restore {
                    Memory(tid).write(address, &bytes)?;
                }
                back(before)?;
                if would_wait.iter().any(|errno| result == -i64::from(*errno)) {
                    self.hold(tid, before, Wait::Again { late }, deadline);
                } else {
                    self.has_changed(tid);
                }
            }
            AtEnd::Loaded(vdso) => {
                vdso.ask_for_page(registers).set(tid)?;
                self.look_at_end(tid, AtEnd::Asks(registers, vdso));
            }
            AtEnd::Asks(before, vdso) => self.look_at_end(tid, AtEnd::Asked(before, vdso)),
            AtEnd::Asked(before, vdso) => {
                // As they were when the program had been loaded.
                before.set(tid)?;
                let page = vdso.replace(tid, result)?;
                if let Some(process) = self.processes.get_mut(&process) {
                    process.clocks = page.map(|page| OwnClocks { page, shown: None });
                }
            }
            AtEnd::TimerCreate { address, event } => {
                self.timer_created(tid, registers, address, event)?;
            }
            AtEnd::Kill { target, signal } if result == 0 => {
                self.signalled = true;
                if signal == libc::SIGKILL {
                    self.expect_deaths(process, target);
                }
            }
            AtEnd::Kill { .. } => {}
        }
        Ok(())
    }

    fn look_at_end(&mut self, tid: Tid, at_end: AtEnd) {
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.at_end = Some(at_end);
        }
    }

    /// A call that had been made again has done something.
    fn has_changed(&mut self, tid: Tid) {
        self.happened += 1;
        if let Some(thread) = self.threads.get_mut(&tid) {
            thread.retries = false;
        }
    }

    /// Those whom SIGKILL has been sent to are gone before anybody goes on.
    fn expect_deaths(&mut self, sender: Tid, target: Tid) {
        let group = match target {
            1.. => return self.is_dying(target),
            0 => sys::group_of(sender),
            -1 => None,
            _ => Some(-target),
        };
        let all: Vec<Tid> = self.processes.keys().copied().collect();
        for pid in all {
            let hit = match group {
                Some(group) => sys::group_of(pid) == Some(group),
                None => pid != sender,
            };
            if hit {
                self.is_dying(pid);
            }
        }
    }

    fn kill_call(&mut self, process: Tid, call: Call, registers: Registers) -> Action {
        let a = registers.arguments();
        let (target, signal) = match call {
            Call::Kill => (int(a[0]), int(a[1])),
            Call::Tgkill => (int(a[0]), int(a[2])),
            _ => {
                let info = format!("/proc/{process}/fdinfo/{}", int(a[0]));
                let info = std::fs::read_to_string(info).unwrap_or_default();
                let pid = info.lines().find_map(|line| line.strip_prefix("Pid:"));
                let pid = pid.and_then(|pid| pid.trim().parse().ok());
                (pid.unwrap_or(0), int(a[1]))
            }
        };
        Action::ToEnd(registers, AtEnd::Kill { target, signal })
    }

    /// A thread ends itself.
    fn exit(&mut self, tid: Tid, process: Tid) -> Action {
        let threads = self.threads.values();
        if threads.filter(|thread| thread.process == process).count() == 1 {
            self.is_dying(process);
        } else if tid == process {
            // The first thread of a process is told of only when the others have ended as well.
            self.threads.remove(&tid);
            if sys::go_on(tid, 0).is_ok() {
                while !matches!(kernel_state(process, tid), Some('Z' | 'X') | None) {
                    std::thread::yield_now();
                }
            }
            self.wake_changed_futexes();
        }
        Action::Make
    }

    fn clock_call(
        &mut self,
        tid: Tid,
        call: Call,
        registers: Registers,
        crept: bool,
    ) -> Result<Action, Halt> {
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
                    return Ok(Action::Make);
                }
                let date = memory.read_pair(address)?;
                let date = match call {
                    Call::ClockSettime => span(date),
                    _ => span_micros(date),
                };
                let Some(to) = date else {
                    return Ok(Action::Make);
                };
                self.clocks.set_real(to, self.now);
                return Ok(Action::Answer(0));
            }
            _ => {}
        }
        if let Some(action) = self.ask(tid, crept) {
            return Ok(action);
        }
        match call {
            Call::ClockGettime => {
                let Some(shown) = self.clocks.show(int(a[0]), self.now) else {
                    return Ok(Action::Make);
                };
                let (seconds, nanoseconds) = parts(shown);
                memory.write_pair(a[1], seconds, nanoseconds)?;
                Ok(Action::Answer(0))
            }
            Call::Gettimeofday => {
                if a[0] != 0 {
                    let (seconds, micros) = parts_micros(self.clocks.real(self.now));
                    memory.write_pair(a[0], seconds, micros)?;
                }
                if a[1] != 0 {
                    memory.write(a[1], &[0; 8])?;
                }
                Ok(Action::Answer(0))
            }
            Call::Time => {
                let (seconds, _) = parts(self.clocks.real(self.now));
                if a[0] != 0 {
                    memory.write(a[0], &seconds.to_ne_bytes())?;
                }
                Ok(Action::Answer(seconds))
            }
            _ => {
                // Processor time is none of what is simulated, and would differ each time.
                if a[0] != 0 {
                    memory.write(a[0], &[0; 32])?;
                }
                let ticks = self.clocks.monotonic(self.now) / (1_000_000_000 / TICKS_A_SECOND);
                Ok(Action::Answer(i64::try_from(ticks).unwrap_or(i64::MAX)))
            }
        }
    }

    fn sleep(&mut self, tid: Tid, call: Call, a: [u64; 6]) -> Result<Action, Halt> {
        let (clock, absolute, time, rest) = match call {
            Call::Nanosleep => (libc::CLOCK_MONOTONIC, false, a[0], a[1]),
            _ => (int(a[0]), a[1] & 1 != 0, a[2], a[3]),
        };
        let Some(time) = span(Memory(tid).read_pair(time)?) else {
            return Ok(Action::Make);
        };
        let deadline = if absolute {
            self.clocks.when(clock, time, self.now)
        } else {
            let known = self.clocks.show(clock, self.now);
            known.map(|_| self.now.saturating_add(time))
        };
        // A clock of processor time, or none.
        if deadline.is_none() {
            return Ok(Action::Make);
        }
        let rest = (!absolute && rest != 0).then_some(rest);
        Ok(Action::Hold(Wait::Sleep { rest }, deadline))
    }

    fn poll_call(
        &mut self,
        tid: Tid,
        process: Tid,
        call: Call,
        a: [u64; 6],
        crept: bool,
    ) -> Result<Action, Halt> {
        let memory = Memory(tid);
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
            Call::Poll => {
                let times = (millis(a[2]), None);
                self.poll(tid, process, (a[0], a[1]), times, crept)
            }
            Call::Ppoll => {
                let Some(deadline) = at(a[2], span)? else {
                    return Ok(Action::Make);
                };
                let times = (deadline, mask(a[3])?);
                self.poll(tid, process, (a[0], a[1]), times, crept)
            }
            Call::Select | Call::Pselect => {
                let is_select = call == Call::Select;
                let read = if is_select { span_micros } else { span };
                let Some(deadline) = at(a[4], read)? else {
                    return Ok(Action::Make);
                };
                // The set of signals lies behind another address.
                let mask = match (is_select, a[5]) {
                    (true, _) | (_, 0) => None,
                    (_, address) => mask(memory.read_u64(address)?)?,
                };
                let sets = (u64::from(low(a[0])), [a[1], a[2], a[3]], a[4], is_select);
                self.select(tid, process, sets, (deadline, mask), crept)
            }
            _ => {
                let deadline = match call {
                    Call::EpollPwait2 => match at(a[3], span)? {
                        Some(deadline) => deadline,
                        None => return Ok(Action::Make),
                    },
                    _ => millis(a[3]),
                };
                let mask = match call {
                    Call::EpollWait => None,
                    _ => mask(a[4])?,
                };
                let set = vec![(int(a[0]), PollFlags::IN)];
                Ok(self.poll_set(tid, process, set, Late::Nothing, (deadline, mask), crept))
            }
        }
    }

    fn signal_call(&mut self, tid: Tid, call: Call, a: [u64; 6]) -> Result<Action, Halt> {
        let memory = Memory(tid);
        let (set, mask, deadline) = match call {
            Call::Pause => (None, None, None),
            Call::Sigsuspend => (None, Some(memory.read_u64(a[0])?), None),
            _ => {
                let deadline = match a[2] {
                    0 => None,
                    address => match span(memory.read_pair(address)?) {
                        Some(time) => Some(self.now.saturating_add(time)),
                        None => return Ok(Action::Make),
                    },
                };
                (Some(memory.read_u64(a[0])?), None, deadline)
            }
        };
        // One may wait already.
        self.signalled = true;
        Ok(Action::Hold(Wait::Signal { set, mask }, deadline))
    }

    /// A wait for a child is made without waiting, and again when something has happened.
    fn child_call(
        &mut self,
        tid: Tid,
        call: Call,
        registers: Registers,
        crept: bool,
    ) -> Result<Action, Halt> {
        let index = if call == Call::Wait4 { 2 } else { 3 };
        let options = registers.arguments()[index];
        let at_once = u64::from(libc::WNOHANG.unsigned_abs());
        if options & at_once != 0 {
            return Ok(self.ask(tid, crept).unwrap_or(Action::Make));
        }
        let mut tried = registers;
        tried.set_argument(index, options | at_once);
        Ok(Action::ToEnd(tried, AtEnd::Child(registers)))
    }

    /// Locks and queues, likewise.
    fn lock_call(&mut self, tid: Tid, call: Call, registers: Registers) -> Result<Action, Halt> {
        let a = registers.arguments();
        let no_wait = u64::from(libc::IPC_NOWAIT.unsigned_abs());
        let mut tried = registers;
        let mut restore = None;
        let mut deadline = None;
        let mut would_wait: &'static [i32] = &[libc::EAGAIN];
        match call {
            Call::Flock => tried.set_argument(1, a[1] | u64::from(libc::LOCK_NB.unsigned_abs())),
            Call::Fcntl => {
                // The commands that do not wait come before those that do.
                tried.set_argument(1, a[1] - 1);
                would_wait = &[libc::EAGAIN, libc::EACCES];
            }
            Call::Msgsnd => tried.set_argument(3, a[3] | no_wait),
            Call::Msgrcv => {
                tried.set_argument(4, a[4] | no_wait);
                would_wait = &[libc::ENOMSG];
            }
            _ => {
                /// The length of a `sembuf`: number, operation, flags of two bytes each.
                const LENGTH: usize = 6;
                let count = usize::try_from(a[2]).unwrap_or(usize::MAX);
                if count > 500 {
                    return Ok(Action::Make);
                }
                let mut bytes = vec![0; LENGTH * count];
                Memory(tid).read(a[1], &mut bytes)?;
                let before = bytes.clone();
                for one in bytes.chunks_exact_mut(LENGTH) {
                    // IPC_NOWAIT is 0o4000.
                    if let Some(high) = one.get_mut(5) {
                        *high |= 0x08;
                    }
                }
                Memory(tid).write(a[1], &bytes)?;
                restore = Some((a[1], before));
                if call == Call::Semtimedop && a[3] != 0 {
                    deadline = span(Memory(tid).read_pair(a[3])?)
                        .map(|time| self.now.saturating_add(time));
                }
            }
        }
        let asked_not_to_wait = match call {
            Call::Flock => a[1] & u64::from(libc::LOCK_NB.unsigned_abs()) != 0,
            Call::Msgsnd => a[3] & no_wait != 0,
            Call::Msgrcv => a[4] & no_wait != 0,
            // One of them that must not wait is enough.
            Call::Semop | Call::Semtimedop => restore
                .as_ref()
                .is_some_and(|(_, before)| before.chunks(6).any(|one| one[5] & 0x08 != 0)),
            _ => false,
        };
        if asked_not_to_wait {
            would_wait = &[];
        }
        // A wait that has begun before goes on to its own deadline.
        if let Some(thread) = self.threads.get_mut(&tid) {
            deadline = thread.again_until.take().or(deadline);
        }
        let at_end = AtEnd::Again {
            before: registers,
            would_wait,
            restore,
            deadline,
            late: -i64::from(libc::EAGAIN),
        };
        Ok(Action::ToEnd(tried, at_end))
    }

    fn random_bytes(&mut self, tid: Tid, into: u64, count: u64) -> Result<Action, Halt> {
        let count = usize::try_from(count)
            .unwrap_or(usize::MAX)
            .min(MOST_RANDOM);
        let mut bytes = vec![0; count];
        if self.random(&mut bytes).is_none() {
            return Ok(Action::Make);
        }
        Memory(tid).write(into, &bytes)?;
        Ok(Action::Answer(i64::try_from(count).unwrap_or(0)))
    }

    /// Reads, writes and the like.
    fn transfer_call(
        &mut self,
        tid: Tid,
        process: Tid,
        call: Call,
        registers: Registers,
        crept: bool,
    ) -> Result<Action, Halt> {
        let a = registers.arguments();
        // Before anything is done with a port, the world knows who has it open.
        self.look_at_ports()?;
        // The end that a port may be at.
        let fd = match call {
            Call::Splice => int(a[2]),
            _ => int(a[0]),
        };
        let Some(descriptor) = self.descriptor(process, fd) else {
            return Ok(Action::Make);
        };
        let port = self.port_of(&descriptor);
        let writes = matches!(
            call,
            Call::Write
                | Call::Writev
                | Call::Sendto
                | Call::Sendmsg
                | Call::Sendmmsg
                | Call::Splice
                | Call::Sendfile
                | Call::MqTimedsend
        );
        if let Some(index) = port {
            return match call {
                // Programs fall back to reading and writing.
                Call::Splice | Call::Sendfile => Ok(failure(libc::EINVAL)),
                Call::Write => self.write_port(tid, index, &descriptor, &[(a[1], a[2])], crept),
                Call::Writev => {
                    let parts = Memory(tid).read_parts(a[1], a[2])?;
                    self.write_port(tid, index, &descriptor, &parts, crept)
                }
                Call::Read => {
                    let count = usize::try_from(a[2]).unwrap_or(usize::MAX);
                    let asked = (count, Some(a[1]));
                    Ok(self.read_port(tid, index, &descriptor, asked, crept))
                }
                Call::Readv => {
                    let parts = Memory(tid).read_parts(a[1], a[2])?;
                    let count = parts
                        .iter()
                        .fold(0_u64, |sum, part| sum.saturating_add(part.1));
                    let asked = (usize::try_from(count).unwrap_or(usize::MAX), None);
                    Ok(self.read_port(tid, index, &descriptor, asked, crept))
                }
                _ => Ok(Action::Make),
            };
        }
        if call == Call::Read && descriptor.is_random() {
            return self.random_bytes(tid, a[1], a[2]);
        }
        if call == Call::Read
            && descriptor.is_anonymous()
            && a[2] >= 8
            && let Some(action) = self.read_timer(tid, &descriptor, a[1])?
        {
            return Ok(action);
        }
        let (flags, room) = if writes {
            let room = match call {
                Call::Write => usize::try_from(a[2]).unwrap_or(usize::MAX),
                _ => 1,
            };
            (PollFlags::OUT, room)
        } else {
            (PollFlags::IN, 0)
        };
        let message_flags = match call {
            Call::Recvfrom | Call::Sendto => a[3],
            Call::Recvmsg | Call::Sendmsg => a[2],
            Call::Recvmmsg | Call::Sendmmsg => a[3],
            _ => 0,
        };
        let at_once = message_flags & u64::from(libc::MSG_DONTWAIT.unsigned_abs()) != 0;
        // A message queue is a file, too.
        let is_queue = matches!(call, Call::MqTimedsend | Call::MqTimedreceive);
        let mut late = -i64::from(libc::EAGAIN);
        let mut deadline = None;
        if is_queue && a[4] != 0 {
            late = -i64::from(libc::ETIMEDOUT);
            let time = span(Memory(tid).read_pair(a[4])?);
            deadline = time.and_then(|t| self.clocks.when(libc::CLOCK_REALTIME, t, self.now));
        } else if descriptor.is_socket() {
            use rustix::net::sockopt::{Timeout, socket_timeout};
            let which = if writes { Timeout::Send } else { Timeout::Recv };
            let patience = socket_timeout(&descriptor.file, which).ok().flatten();
            deadline = patience.map(|patience| {
                self.now
                    .saturating_add(crate::traced::clock::nanoseconds(patience))
            });
        }
        if descriptor.never_waits() && !is_queue {
            return Ok(Action::Make);
        }
        // Perhaps a timer, which counts how often it has run out; or several messages.
        let has_more = descriptor.is_anonymous() || call == Call::Recvmmsg;
        let waits = (at_once, deadline, late, has_more);
        let action = self.may_wait(tid, fd, &descriptor, (flags, room), waits, crept);
        if call == Call::Recvmmsg && matches!(action, Action::Make) {
            // It would wait for the others of the messages that it has room for.
            let mut changed = registers;
            let first_only = u64::from(libc::MSG_WAITFORONE.unsigned_abs());
            changed.set_argument(3, a[3] | first_only);
            changed.set_argument(4, 0);
            return Ok(Action::ToEnd(changed, AtEnd::Restore(registers)));
        }
        Ok(action)
    }
}

/// One processor, whatever the machine has: programs start as many threads as they find processors.
fn affinity(tid: Tid, length: u64, into: u64) -> Result<Action, Halt> {
    if length < 8 {
        return Ok(Action::Make);
    }
    Memory(tid).write(into, &1_u64.to_ne_bytes())?;
    Ok(Action::Answer(8))
}
