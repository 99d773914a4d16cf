//! Syscalls that a program makes for the tracer without noticing.

use rustix::event::PollFlags;

use crate::traced::arch::Registers;
use crate::traced::memory::Memory;
use crate::traced::proc::{members_of_epoll, name_of, path_of};
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::{Entry, Halt};
use crate::traced::tracer::Tracer;

impl Tracer<'_> {
    /// Makes a syscall by a stopped thread, and returns its result. Afterwards the thread has the
    /// registers that it had, and is at a syscall-exit stop.
    ///
    /// # Errors
    /// `ENOSYS` if no instruction for it is known, and `ESRCH` if the thread is killed.
    pub(crate) fn inject(
        &mut self,
        tid: Tid,
        number: i64,
        arguments: [u64; 6],
    ) -> Result<i64, Halt> {
        let process = self.tree.processes.get(&self.tree.process_of(tid));
        let Some(gate) = process.and_then(|process| process.gate) else {
            return Ok(-i64::from(libc::ENOSYS));
        };
        let before = Registers::of(tid)?;
        // A pending signal would be delivered first.
        let blocked = sys::set_blocked(tid, u64::MAX)?;
        let call = before.call(gate, number, arguments);
        call.set(tid)?;
        let mut has_begun = false;
        let result = loop {
            sys::resume_to_syscall_stop(tid)?;
            if !self.wait_for_stop(tid)? {
                continue;
            }
            let registers = Registers::of(tid)?;
            if has_begun {
                break registers.result();
            }
            has_begun = registers.number() == number;
            if !has_begun {
                // The syscall-exit stop of the thread's own syscall, which may have set its result.
                call.set(tid)?;
            }
        };
        before.set(tid)?;
        sys::set_blocked(tid, blocked)?;
        Ok(result)
    }

    /// Makes the syscall that a thread is at, with these arguments. It must not wait.
    pub(crate) fn make(&mut self, entry: Entry, arguments: [u64; 6]) -> Result<i64, Halt> {
        self.inject(entry.tid, entry.registers.number(), arguments)
    }

    /// The same as [`Self::inject`] with these bytes at a place in its memory, which is put back; also
    /// returns what they have become.
    pub(crate) fn inject_with(
        &mut self,
        tid: Tid,
        number: i64,
        bytes: impl Fn(u64) -> Vec<u8>,
        arguments: impl Fn(u64) -> [u64; 6],
    ) -> Result<(i64, Vec<u8>), Halt> {
        // There is memory in any case.
        let place = Registers::of(tid)?.stack() & !15;
        let mut bytes = bytes(place);
        let mut before = vec![0; bytes.len()];
        Memory(tid).read(place, &mut before)?;
        Memory(tid).write(place, &bytes)?;
        let result = self.inject(tid, number, arguments(place))?;
        Memory(tid).read(place, &mut bytes)?;
        Memory(tid).write(place, &before)?;
        Ok((result, bytes))
    }

    /// Returns whether it has stopped at a syscall-entry or a syscall-exit stop.
    fn wait_for_stop(&mut self, tid: Tid) -> Result<bool, Halt> {
        loop {
            match sys::wait(Some(tid), true) {
                Ok(Some((_, status))) if libc::WIFSTOPPED(status) => {
                    return Ok(status >> 8 == libc::SIGTRAP | 0x80);
                }
                Ok(Some((_, status))) => {
                    self.gone(tid, status);
                    return Err(Halt::Gone);
                }
                Ok(None) => {}
                Err(error) if error.kind() == std::io::ErrorKind::Interrupted => {
                    if self.is_over_time() {
                        self.kill_all();
                        return Err(Halt::Gone);
                    }
                }
                Err(error) => return Err(error.into()),
            }
        }
    }

    /// Passes those of these descriptors that are not known, by a thread that is at a syscall, where that
    /// is needed.
    ///
    /// # Errors
    /// [`Halt::Again`] if there were any.
    pub(crate) fn pass(
        &mut self,
        tid: Tid,
        fds: impl IntoIterator<Item = i32>,
    ) -> Result<(), Halt> {
        if self.descriptors.passage.is_none() {
            return Ok(());
        }
        let process = self.tree.process_of(tid);
        let mut any = false;
        for fd in fds {
            if self.is_known(process, fd) || path_of(process, fd).is_none() {
                continue;
            }
            any = true;
            let file = self.passed(tid, fd)?;
            if file.is_none() {
                let name = name_of(tid);
                let what = format!("descriptor {fd} of {name}, which cannot be polled");
                self.report.outside.insert(what);
            }
            self.keep(process, fd, file);
        }
        if any { Err(Halt::Again) } else { Ok(()) }
    }

    /// The same for descriptors that are polled, and those that are polled through them.
    pub(crate) fn pass_polled(&mut self, tid: Tid, set: &[(i32, PollFlags)]) -> Result<(), Halt> {
        if self.descriptors.passage.is_none() {
            return Ok(());
        }
        let process = self.tree.process_of(tid);
        let members = set
            .iter()
            .flat_map(|(fd, _)| members_of_epoll(process, *fd));
        let all: Vec<i32> = set
            .iter()
            .copied()
            .chain(members)
            .map(|(fd, _)| fd)
            .collect();
        self.pass(tid, all)
    }

    fn passed(&mut self, tid: Tid, fd: i32) -> Result<Option<std::os::fd::OwnedFd>, Halt> {
        let number = |value: i32| u64::from(value.unsigned_abs());
        let kind = number(libc::SOCK_DGRAM | libc::SOCK_CLOEXEC);
        let make = [number(libc::AF_UNIX), kind, 0, 0, 0, 0];
        let Some(passage) = self.descriptors.passage.clone() else {
            return Ok(None);
        };
        let Ok(socket) = u64::try_from(self.inject(tid, libc::SYS_socket, make)?) else {
            return Ok(None);
        };
        let send = |place| [socket, place, number(libc::MSG_DONTWAIT), 0, 0, 0];
        let (sent, _) =
            self.inject_with(tid, libc::SYS_sendmsg, |at| passage.message(at, fd), send)?;
        self.inject(tid, libc::SYS_close, [socket, 0, 0, 0, 0, 0])?;
        Ok((sent == 1).then(|| passage.receive()).flatten())
    }
}
