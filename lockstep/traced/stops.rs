//! Stops of threads while one of them runs.

use std::io;
use std::time::Duration;

use crate::traced::arch::{self, Registers};
use crate::traced::memory::Memory;
use crate::traced::outside::{connects_to, kernel_wait};
use crate::traced::proc::{kernel_state, name_of, opens_pipe};
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::Halt;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::{Resume, Wait};
use crate::{End, Error, Reason};

/// Processor time without a syscall after which a thread is interrupted.
const LONG: Duration = Duration::from_secs(1);

/// Number of successive ticks asleep in the kernel after which a thread counts as waiting there: for another
/// machine or the other end of a named pipe, and for anything else. The kernel's own work, such as a disk
/// read, takes less.
const SLEEPY_TICKS: [u32; 2] = [2, 50];

impl Tracer<'_> {
    /// Waits until the running thread has stopped or exited, and all others that are exiting have.
    pub(crate) fn wait_for_current(&mut self) -> Result<(), Error> {
        self.schedule.computing = None;
        self.schedule.interrupted = None;
        loop {
            let current = self.schedule.current;
            let current = current.and_then(|tid| self.tree.threads.get(&tid));
            let runs = current.is_some_and(Thread::is_running);
            let dying = self.tree.processes.values().any(|process| process.dying);
            if !runs && !dying {
                return Ok(());
            }
            match self.take_stop(true) {
                Ok(true) => self.schedule.sleepy = 0,
                Ok(false) => {
                    if self.tick() {
                        return Ok(());
                    }
                }
                Err(Halt::Gone | Halt::Make | Halt::Again) => {}
                Err(Halt::Failed(error)) => return Err(error),
            }
        }
    }

    /// Handles the stop or end of one thread; `false` if there is none, or after a tick.
    pub(crate) fn take_stop(&mut self, block: bool) -> Result<bool, Halt> {
        match sys::wait(None, block) {
            Ok(Some((tid, status))) => {
                self.stopped(tid, status)?;
                Ok(true)
            }
            Ok(None) => Ok(false),
            Err(error) if error.kind() == io::ErrorKind::Interrupted => Ok(false),
            Err(error) if error.raw_os_error() == Some(libc::ECHILD) => {
                self.tree.threads.clear();
                self.tree.processes.clear();
                Ok(false)
            }
            Err(error) => Err(error.into()),
        }
    }

    /// Reads the real clock; returns whether the wait for the thread that runs is over.
    fn tick(&mut self) -> bool {
        if self.is_over_time() {
            self.kill_all();
            return true;
        }
        self.processor.free(&self.tree.threads);
        let Some(tid) = self.schedule.current else {
            return false;
        };
        let Some(thread) = self.tree.threads.get(&tid).filter(|t| t.is_running()) else {
            return false;
        };
        if kernel_state(thread.process, tid) != Some('S') {
            self.schedule.sleepy = 0;
            self.bound_computing(tid);
            return false;
        }
        self.schedule.sleepy += 1;
        let process = thread.process;
        let [soon, any] = SLEEPY_TICKS.map(|ticks| self.schedule.sleepy >= ticks);
        let peer = soon.then(|| connects_to(process, tid)).flatten();
        let waits = any || soon && opens_pipe(process, tid);
        let Some(what) = peer.or_else(|| waits.then(|| kernel_wait(process, tid))) else {
            return false;
        };
        self.report.outside.insert(what);
        self.tree.set_state(tid, State::InKernel);
        true
    }

    /// Interrupts a thread that has computed for long since it was resumed.
    fn bound_computing(&mut self, tid: Tid) {
        // No other of its process runs.
        let process = sys::clock_of_process(self.tree.process_of(tid));
        let Some(used) = sys::processor_time(process) else {
            return;
        };
        let since = *self.schedule.computing.get_or_insert(used);
        let Some(thread) = self.tree.threads.get_mut(&tid) else {
            return;
        };
        if thread.preempted || used.saturating_sub(since) >= LONG {
            thread.preempted = true;
            self.schedule.interrupted = Some(tid);
            // The end of a thread is reported separately.
            let _ = sys::interrupt(tid);
        }
    }

    /// Records the new state of a thread.
    fn stopped(&mut self, tid: Tid, status: i32) -> Result<(), Halt> {
        if libc::WIFEXITED(status) || libc::WIFSIGNALED(status) {
            self.gone(tid, status);
            return Ok(());
        }
        if !self.tree.threads.contains_key(&tid) {
            self.tree.early.insert(tid);
            return Ok(());
        }
        let signal = libc::WSTOPSIG(status);
        self.schedule.children += u64::from(status >> 16 != libc::PTRACE_EVENT_SECCOMP);
        match status >> 16 {
            libc::PTRACE_EVENT_SECCOMP => {
                self.tree
                    .set_state(tid, State::Ready(Resume::Syscall { backed_off: false }));
            }
            libc::PTRACE_EVENT_EXEC => self.executed(tid)?,
            event @ (libc::PTRACE_EVENT_FORK
            | libc::PTRACE_EVENT_VFORK
            | libc::PTRACE_EVENT_CLONE) => self.cloned(tid, event)?,
            libc::PTRACE_EVENT_STOP if signal != libc::SIGTRAP => {
                self.tree.set_state(tid, State::Stopped);
                sys::listen(tid)?;
            }
            libc::PTRACE_EVENT_STOP if self.schedule.interrupted == Some(tid) => {
                self.schedule.interrupted = None;
                self.preempt(tid)?;
            }
            0 => self.signal(tid, signal)?,
            _ => self.tree.set_state(tid, State::Ready(Resume::Go(0))),
        }
        Ok(())
    }

    /// A signal is about to be delivered.
    fn signal(&mut self, tid: Tid, signal: i32) -> Result<(), Halt> {
        if signal == libc::SIGSEGV {
            let registers = Registers::of(tid)?;
            if let Some(length) = registers.time_stamp_length(Memory(tid)) {
                return self.time_stamp(tid, length);
            }
        }
        self.tree.set_state(tid, State::Ready(Resume::Go(signal)));
        Ok(())
    }

    /// A thread has started another, or a process.
    fn cloned(&mut self, tid: Tid, event: i32) -> Result<(), Halt> {
        let child = sys::event_message(tid)?;
        let registers = Registers::of(tid)?;
        let parent = self.tree.process_of(tid);
        let shared = arch::shared(&registers);
        if !self.tree.early.remove(&child) {
            // It is about to stop for the first time.
            loop {
                match sys::wait(Some(child), true) {
                    Ok(Some((_, status))) if libc::WIFSTOPPED(status) => break,
                    Err(error) if error.kind() == io::ErrorKind::Interrupted => {}
                    // Killed before it began.
                    _ => {
                        self.tree.set_state(tid, State::Ready(Resume::Go(0)));
                        return Ok(());
                    }
                }
            }
        }
        let ready = State::Ready(Resume::Go(0));
        if shared.process {
            self.tree.add_thread(child, parent, ready);
        } else {
            self.tree.add_process(child, Some(parent), shared);
            self.tree.add_thread(child, child, ready);
        }
        if event == libc::PTRACE_EVENT_VFORK {
            self.block(tid, registers, Wait::Vfork { child }, None);
        } else {
            self.tree.set_state(tid, State::Ready(Resume::Go(0)));
        }
        Ok(())
    }

    /// A process has its own memory now, or has ended: the thread that waits for that goes on.
    pub(crate) fn release_parent(&mut self, pid: Tid) {
        for thread in self.tree.threads.values_mut() {
            if let Some(block) = thread.block()
                && matches!(block.wait, Wait::Vfork { child } if child == pid)
            {
                thread.state = State::Ready(Resume::Go(0));
            }
        }
        self.wake_changed_futexes();
    }

    pub(crate) fn gone(&mut self, tid: Tid, status: i32) {
        self.tree.threads.remove(&tid);
        self.tree.early.remove(&tid);
        self.schedule.happened += 1;
        self.schedule.children += 1;
        if let Some(process) = self.tree.processes.remove(&tid) {
            self.limits.used += process.used;
            self.tree.threads.retain(|_, thread| thread.process != tid);
            self.timers.forget(tid);
            self.release_parent(tid);
            if libc::WIFSIGNALED(status) {
                // Others may have been killed with it.
                self.find_dying();
            }
            // Its parent gets a signal.
            self.schedule.signalled = true;
            if tid == self.tree.main {
                self.report.end = if libc::WIFEXITED(status) {
                    End::Exited(libc::WEXITSTATUS(status))
                } else {
                    End::Killed(libc::WTERMSIG(status))
                };
                if self.limits.killed_at.is_none() {
                    let others = self.tree.processes.keys().map(|pid| name_of(*pid));
                    self.report.left = others.collect();
                    self.ask_to_end(Reason::Itself);
                }
            } else {
                self.tree.ended.push(tid);
            }
        } else {
            self.wake_changed_futexes();
        }
    }
}
