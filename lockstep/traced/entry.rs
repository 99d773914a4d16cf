//! Handling of each syscall at which a thread is stopped.

use crate::traced::arch::{self, Group, Registers, Syscall};
use crate::traced::one_processor::{affinity, current};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, call_name, failure, int, low};
use crate::traced::tracer::Tracer;

impl Tracer<'_> {
    /// Decides how a syscall is handled.
    pub(crate) fn call(
        &mut self,
        tid: Tid,
        registers: Registers,
        backed_off: bool,
    ) -> Result<Handling, Halt> {
        let (group, call) = arch::call(registers.number()).ok_or(Halt::Make)?;
        let process = self.tree.process_of(tid);
        self.tree.process(process)?.gate = Some(registers.gate());
        let a = registers.arguments();
        let entry = Entry {
            tid,
            process,
            call,
            registers,
            a,
            backed_off,
        };
        match group {
            Group::Clock => self.clock_call(entry),
            Group::Sleep => self.sleep(entry),
            Group::Poll => self.poll_call(entry),
            Group::Signal => self.signal_call(entry),
            Group::Kill => self.kill_call(entry),
            Group::Retried if call == Syscall::Fcntl && int(a[1]) == libc::F_SETFL => {
                match int(a[2]) & libc::O_ASYNC {
                    0 => Ok(Handling::Make),
                    _ => self.polled_by_kernel(entry, int(a[0])),
                }
            }
            Group::Retried => self.retried_call(entry),
            Group::Transfer => self.transfer_call(entry),
            Group::Other => self.other_call(entry),
        }
    }

    fn other_call(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let Entry {
            tid, process, a, ..
        } = entry;
        let registers = entry.registers;
        match entry.call {
            Syscall::Adjtimex => self.adjust(entry, a[0]),
            Syscall::ClockAdjtime => self.adjust(entry, a[1]),
            Syscall::Sysinfo => self.uptime(entry),
            Syscall::EpollCtl => self.polled_by_kernel(entry, int(a[2])),
            Syscall::Futex => self.futex(entry),
            Syscall::Ioctl => self.request(entry),
            Syscall::Close => self.close(entry, int(a[0])..=int(a[0])),
            Syscall::Dup => self.close(entry, int(a[1])..=int(a[1])),
            Syscall::CloseRange => {
                let [first, last] =
                    [a[0], a[1]].map(|fd| i32::try_from(low(fd)).unwrap_or(i32::MAX));
                self.close(entry, first..=last)
            }
            Syscall::Alarm => Ok(self.alarm(process, a[0])),
            Syscall::Setitimer => self.interval_timer(entry, Some(a[1]), a[2]),
            Syscall::Getitimer => self.interval_timer(entry, None, a[1]),
            Syscall::TimerCreate => self.timer_create(entry),
            Syscall::TimerSettime => self.posix_timer(entry, Some((a[1], a[2])), a[3]),
            Syscall::TimerGettime => self.posix_timer(entry, None, a[1]),
            Syscall::TimerGetoverrun => self.timer_overrun(entry),
            Syscall::TimerDelete => Ok(self.timer_delete(entry)),
            Syscall::TimerfdSettime => self.timer_descriptor(entry, Some((a[1], a[2])), a[3]),
            Syscall::TimerfdGettime => self.timer_descriptor(entry, None, a[1]),
            Syscall::Getrandom => self.random_bytes(tid, &[(a[0], a[1])]),
            Syscall::Yield => Ok(self.query(entry).unwrap_or_else(|| {
                self.give_way(tid);
                Handling::Answer(0)
            })),
            Syscall::Getaffinity => affinity(tid, a[1], a[2]),
            Syscall::Getcpu => current(tid, a[0], a[1]),
            Syscall::Setaffinity => Ok(Handling::Answer(0)),
            // Only after a stop by job control.
            Syscall::Restart => Ok(failure(libc::EINTR)),
            Syscall::Sigaction => self.fault_action(entry),
            Syscall::Signalfd => {
                self.descriptors.has_signalfd = true;
                Ok(Handling::Make)
            }
            Syscall::Exit => Ok(self.exit(tid, process)),
            Syscall::ExitGroup => {
                self.is_dying(process);
                Ok(Handling::Make)
            }
            Syscall::Clone => {
                // The child is traced like all others.
                let mut registers = registers;
                registers.set_argument(0, a[0] & !0x0080_0000);
                registers.set(tid)?;
                Ok(Handling::Make)
            }
            Syscall::Missing => {
                self.report.missing.insert(call_name(registers.number()));
                Ok(failure(libc::ENOSYS))
            }
            Syscall::Ptrace => {
                self.report
                    .refused
                    .insert("a debugger: only one can trace a program, and that is sim".to_owned());
                Ok(failure(libc::EPERM))
            }
            // Those that have their own group.
            _ => Ok(Handling::Make),
        }
    }
}
