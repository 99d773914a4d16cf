//! Programs that have just been loaded: whether they can be run, and what they are given.

use crate::Error;
use crate::traced::arch::{self, Registers, Vdso};
use crate::traced::descriptor::Files;
use crate::traced::memory::Memory;
use crate::traced::proc::number;
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::Halt;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{OwnClocks, State, Thread};
use crate::traced::wait::Resume;

impl Tracer<'_> {
    /// A process has called exec.
    pub(crate) fn executed(&mut self, tid: Tid) -> Result<(), Halt> {
        let former = sys::event_message(tid)?;
        let number = self.tree.threads.get(&former).map(|thread| thread.number);
        self.tree
            .threads
            .retain(|other, thread| *other == tid || thread.process != tid);
        let thread = self.tree.thread(tid)?;
        let number = number.unwrap_or(thread.number);
        *thread = Thread::new(number, tid, State::Ready(Resume::Go(0)));
        if self.schedule.current == Some(former) {
            self.schedule.current = Some(tid);
        }
        let memory = self.tree.new_memory();
        let process = self.tree.process(tid)?;
        process.memory = memory;
        process.clocks = None;
        process.on_fault = None;
        // Those that are closed with it, and another table if it was shared.
        process.files = Files::default();
        self.timers.forget_posix(tid);
        self.release_parent(tid);
        self.check_program(tid)?;
        if self.options.seed.is_some() && !has_fixed_addresses(tid) {
            self.report.random_addresses = true;
        }
        self.schedule.happened += 1;
        let stack = Registers::of(tid)?.stack();
        let mut bytes = [0; 16];
        let random = self.random(&mut bytes).map(|()| bytes);
        let vdso = arch::prepare_image(Memory(tid), stack, random)?;
        self.tree.process(tid)?.gate = vdso.as_ref().map(|vdso| vdso.gate);
        if let Some(vdso) = vdso {
            let (number, arguments) = Vdso::page_call();
            let result = self.inject(tid, number, arguments)?;
            let page = vdso.replace(tid, result)?;
            self.tree.process(tid)?.clocks = page.map(|page| OwnClocks { page, shown: None });
        }
        Ok(())
    }

    /// Refuses programs that cannot be run so.
    fn check_program(&mut self, pid: Tid) -> Result<(), Halt> {
        use std::os::unix::fs::MetadataExt as _;
        let path = std::fs::read_link(format!("/proc/{pid}/exe")).unwrap_or_default();
        let refuse = |why: &str| {
            let text = format!("{} {why}", path.display());
            Err(Halt::Failed(Error::Refused(text)))
        };
        if !Registers::of(pid)?.is_native() {
            return refuse("is a 32-bit program, which cannot be run in simulated time");
        }
        let Ok(file) = std::fs::metadata(format!("/proc/{pid}/exe")) else {
            return Ok(());
        };
        let user = rustix::process::geteuid().as_raw();
        if file.mode() & libc::S_ISUID != 0 && file.uid() != user {
            return refuse(
                "is to run as another user (set-user-id), which a program in simulated time cannot",
            );
        }
        Ok(())
    }
}

/// Returns whether the system loads a process's programs at the same addresses each time.
fn has_fixed_addresses(pid: Tid) -> bool {
    let persona = std::fs::read_to_string(format!("/proc/{pid}/personality")).ok();
    let persona = persona.and_then(|text| number(text.trim()));
    persona.is_some_and(|bits| bits & u64::from(libc::ADDR_NO_RANDOMIZE.unsigned_abs()) != 0)
}
