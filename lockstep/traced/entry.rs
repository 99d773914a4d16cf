//! Handling of each syscall at which a thread is stopped, and of those for which there is no other file.

use crate::traced::arch::{self, Registers};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, call_name, failure, int};
use crate::traced::tracer::Tracer;

impl Tracer<'_> {
    /// Decides how a syscall is handled.
    pub(crate) fn call(
        &mut self,
        tid: Tid,
        registers: Registers,
        backed_off: bool,
    ) -> Result<Handling, Halt> {
        let (call, handle) = arch::call(registers.number()).ok_or(Halt::Make)?;
        let process = self.tree.process_of(tid);
        self.tree.process(process)?.gate = Some(registers.gate());
        let entry = Entry {
            tid,
            process,
            call,
            registers,
            a: registers.arguments(),
            backed_off,
        };
        handle(self, entry)
    }

    /// `fcntl`: waits for a lock, or sets flags.
    pub(crate) fn descriptor_control(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let [fd, command, flags, ..] = entry.a.map(int);
        match command {
            libc::F_SETFL if flags & libc::O_ASYNC == 0 => Ok(Handling::Make),
            libc::F_SETFL => self.polled_by_kernel(entry, fd),
            _ => self.retried_call(entry),
        }
    }

    pub(crate) fn signal_descriptor(&mut self) -> Result<Handling, Halt> {
        self.descriptors.has_signalfd = true;
        Ok(Handling::Make)
    }

    /// A child is traced like all others: its parent's flag that prevents it is removed.
    pub(crate) fn make_traced(&mut self, entry: Entry, untraced: u64) -> Result<Handling, Halt> {
        let mut registers = entry.registers;
        registers.set_argument(0, entry.a[0] & !untraced);
        registers.set(entry.tid)?;
        Ok(Handling::Make)
    }

    pub(crate) fn lack(&mut self, entry: Entry) -> Handling {
        let name = call_name(entry.registers.number());
        self.report.missing.insert(name);
        failure(libc::ENOSYS)
    }

    pub(crate) fn refuse_debugger(&mut self) -> Handling {
        let what = "a debugger: only one can trace a program, and that is sim";
        self.report.refused.insert(what.to_owned());
        failure(libc::EPERM)
    }
}
