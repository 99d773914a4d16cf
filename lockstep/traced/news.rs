//! News of threads while one of them runs.

use std::io;
use std::time::Duration;

use rustix::process::{Pid, PidfdFlags};

use crate::traced::arch::{self, Registers};
use crate::traced::memory::Memory;
use crate::traced::sys::{self, Tid, Whom};
use crate::traced::tracer::{Halt, Tracer};
use crate::traced::tree::{OwnClocks, Process, Resume, State, Thread, kernel_state};
use crate::traced::wait::Wait;
use crate::{End, Error, Reason};

/// Interval at which a wait for a thread is interrupted to look at the real clock.
pub(crate) const TICK: Duration = Duration::from_millis(20);

/// Ticks in a row at which a thread sleeps in the kernel before it is taken to wait there.
const SLEEPY_TICKS: u32 = 2;

impl Tracer<'_> {
    /// Waits until the thread that runs has stopped or gone, and with it whoever is about to go.
    pub(crate) fn wait_for_current(&mut self) -> Result<(), Error> {
        loop {
            let runs = self
                .current
                .and_then(|tid| self.threads.get(&tid))
                .is_some_and(Thread::is_running);
            let dying = self.processes.values().any(|process| process.dying);
            if !runs && !dying {
                return Ok(());
            }
            match self.take_news(true) {
                Ok(true) => self.sleepy = 0,
                Ok(false) => {
                    if self.tick() {
                        return Ok(());
                    }
                }
                Err(Halt::Gone | Halt::Fault) => {}
                Err(Halt::Failed(error)) => return Err(error),
            }
        }
    }

    /// Takes what one thread has to tell; `false` if none has, or after a tick.
    pub(crate) fn take_news(&mut self, block: bool) -> Result<bool, Halt> {
        match sys::wait(Whom::Anybody, block) {
            Ok(Some((tid, status))) => {
                self.news(tid, status)?;
                Ok(true)
            }
            Ok(None) => Ok(false),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                self.threads.clear();
                self.processes.clear();
                Ok(false)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Looks at the real clock; whether the wait for the thread that runs is over.
    fn tick(&mut self) -> bool {
        if self.is_over_time() {
            self.kill_all();
            return true;
        }
        self.free_processor();
        let Some(tid) = self.current else {
            return false;
        };
        let Some(thread) = self.threads.get(&tid).filter(|t| t.is_running()) else {
            return false;
        };
        if kernel_state(thread.process, tid) != Some('S') {
            self.sleepy = 0;
            return false;
        }
        self.sleepy += 1;
        if self.sleepy < SLEEPY_TICKS {
            return false;
        }
        let what = self.what_kernel_waits_for(thread.process, tid);
        self.outside.insert(what);
        self.set_state(tid, State::Blocked);
        true
    }

    /// Takes note of what has become of a thread.
    fn news(&mut self, tid: Tid, status: i32) -> Result<(), Halt> {
        if libc::WIFEXITED(status) || libc::WIFSIGNALED(status) {
            self.gone(tid, status);
            return Ok(());
        }
        if !self.threads.contains_key(&tid) {
            self.early.insert(tid);
            return Ok(());
        }
        let signal = libc::WSTOPSIG(status);
        match status >> 16 {
            libc::PTRACE_EVENT_SECCOMP => {
                self.set_state(tid, State::Ready(Resume::Call { crept: false }));
            }
            libc::PTRACE_EVENT_EXEC => self.executed(tid)?,
            event @ (libc::PTRACE_EVENT_FORK
            | libc::PTRACE_EVENT_VFORK
            | libc::PTRACE_EVENT_CLONE) => self.cloned(tid, event)?,
            libc::PTRACE_EVENT_STOP if signal != libc::SIGTRAP => {
                self.set_state(tid, State::Stopped);
                sys::listen(tid)?;
            }
            0 if signal == libc::SIGTRAP | 0x80 => self.end_of_call(tid)?,
            0 => self.signal(tid, signal)?,
            _ => self.set_state(tid, State::Ready(Resume::Go(0))),
        }
        Ok(())
    }

    /// A signal is about to be delivered.
    fn signal(&mut self, tid: Tid, signal: i32) -> Result<(), Halt> {
        let mut give = signal;
        if signal == libc::SIGSEGV {
            let mut registers = Registers::of(tid)?;
            let ticks = self.clocks.monotonic(self.now);
            if registers.read_time_stamp(Memory(tid), ticks) {
                registers.set(tid)?;
                give = 0;
            }
        }
        self.set_state(tid, State::Ready(Resume::Go(give)));
        Ok(())
    }

    /// A thread has started another, or a process.
    fn cloned(&mut self, tid: Tid, event: i32) -> Result<(), Halt> {
        let child = sys::event_message(tid)?;
        let registers = Registers::of(tid)?;
        let parent = self.threads.get(&tid).map_or(tid, |thread| thread.process);
        let (is_thread, shares_memory) = arch::clones(&registers);
        if !self.early.remove(&child) {
            // It is about to stop for the first time.
            loop {
                match sys::wait(Whom::One(child), true) {
                    Ok(Some((_, status))) if libc::WIFSTOPPED(status) => break,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    // Killed before it began.
                    _ => {
                        self.set_state(tid, State::Ready(Resume::Go(0)));
                        return Ok(());
                    }
                }
            }
        }
        let ready = State::Ready(Resume::Go(0));
        if is_thread {
            self.add_thread(child, parent, ready);
        } else {
            let parent = self.processes.get(&parent);
            let memory = parent.map(|process| process.memory);
            let clocks = parent.and_then(|process| process.clocks);
            self.add_process(child, memory.filter(|_| shares_memory), clocks)?;
            self.add_thread(child, child, ready);
        }
        if event == libc::PTRACE_EVENT_VFORK {
            self.hold(tid, registers, Wait::Vfork { child }, None);
        } else {
            self.set_state(tid, State::Ready(Resume::Go(0)));
        }
        Ok(())
    }

    pub(crate) fn add_process(
        &mut self,
        pid: Tid,
        memory: Option<u64>,
        clocks: Option<OwnClocks>,
    ) -> io::Result<()> {
        let raw = Pid::from_raw(pid).ok_or(io::ErrorKind::InvalidInput)?;
        let handle = rustix::process::pidfd_open(raw, PidfdFlags::empty())?;
        let memory = memory.unwrap_or_else(|| self.new_memory());
        let process = Process {
            memory,
            handle,
            dying: false,
            clocks,
        };
        self.processes.insert(pid, process);
        Ok(())
    }

    pub(crate) fn new_memory(&mut self) -> u64 {
        self.memories += 1;
        self.memories
    }

    pub(crate) fn add_thread(&mut self, tid: Tid, process: Tid, state: State) {
        self.numbers += 1;
        let thread = Thread::new(self.numbers, process, state);
        self.threads.insert(tid, thread);
    }

    /// A process has a memory of its own now, or has ended: whoever waits for that goes on.
    pub(crate) fn release_parent(&mut self, pid: Tid) {
        for thread in self.threads.values_mut() {
            if let Some(hold) = thread.hold()
                && matches!(hold.wait, Wait::Vfork { child } if child == pid)
            {
                thread.state = State::Ready(Resume::Go(0));
            }
        }
        self.wake_changed_futexes();
    }

    /// A thread has ended.
    pub(crate) fn gone(&mut self, tid: Tid, status: i32) {
        self.threads.remove(&tid);
        self.early.remove(&tid);
        self.happened += 1;
        if self.processes.remove(&tid).is_some() {
            self.threads.retain(|_, thread| thread.process != tid);
            self.timers.forget(tid);
            self.release_parent(tid);
            // Its parent is told.
            self.signalled = true;
            if tid == self.main {
                self.end = Some(if libc::WIFEXITED(status) {
                    End::Exited(libc::WEXITSTATUS(status))
                } else {
                    End::Killed(libc::WTERMSIG(status))
                });
                if self.killed_at.is_none() {
                    self.ask_to_end(Reason::Itself);
                }
            } else {
                self.ended.push(tid);
            }
        } else {
            self.wake_changed_futexes();
        }
    }
}
