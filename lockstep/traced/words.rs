//! Words for what programs do and wait for.

use crate::ThreadWait;
use crate::traced::arch::Registers;
use crate::traced::descriptor::Descriptor;
use crate::traced::proc::{mapping, name_of, syscall_of};
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::call_name;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{State, Thread};
use crate::traced::wait::{Awaited, Resume, Wait};

impl Tracer<'_> {
    /// Returns what the programs are doing, as text.
    pub(crate) fn doing(&self) -> String {
        let running = self.schedule.current.and_then(|tid| {
            let thread = self.tree.threads.get(&tid)?;
            thread.is_running().then_some((tid, thread.process))
        });
        let Some((tid, process)) = running else {
            return self.waits_text();
        };
        match syscall_of(process, tid) {
            Some((call, _)) => format!("{} was in {}", name_of(tid), call_name(call)),
            None => computing(tid, interrupted_place(process, tid)),
        }
    }

    /// Returns what all threads wait for, as text.
    pub(crate) fn waits_text(&self) -> String {
        let mut waits: Vec<String> = Vec::new();
        for (tid, thread) in &self.tree.threads {
            let text = match self.thread_wait(thread) {
                Some((_, Some(what))) => format!("{} waited {what}", name_of(*tid)),
                Some((_, None)) => computing(*tid, place_of(thread.process, *tid)),
                None => continue,
            };
            if !waits.contains(&text) {
                waits.push(text);
            }
        }
        waits.truncate(8);
        waits.join(", ")
    }

    /// Returns what each thread waits for.
    pub(crate) fn waits(&self) -> Vec<ThreadWait> {
        let threads = self.tree.threads.iter();
        let waits = threads.filter_map(|(tid, thread)| {
            let (number, wait) = self.thread_wait(thread)?;
            Some(ThreadWait {
                thread: thread.number,
                name: name_of(*tid),
                number,
                wait: wait.unwrap_or_else(|| "computes".to_owned()),
            })
        });
        waits.collect()
    }

    /// Returns the number of a wait and what it is for; without, the thread computes for long.
    fn thread_wait(&self, thread: &Thread) -> Option<(u64, Option<String>)> {
        Some(match &thread.state {
            State::Blocked(block) if matches!(block.wait, Wait::BackOff(Resume::Go(_))) => {
                (block.since, None)
            }
            State::Blocked(block) => {
                let text = self.wait_text(&block.wait);
                (block.since, Some(text))
            }
            State::Stopped => (0, Some("for being continued".to_owned())),
            State::InKernel => (0, Some("in the kernel".to_owned())),
            State::Running | State::Ready(_) => return None,
        })
    }

    fn wait_text(&self, wait: &Wait) -> String {
        let name = |file: &Descriptor| {
            let path = file.path()?;
            Some(match self.ports.iter().find(|port| port.leads_to(&path)) {
                Some(port) => port.path().display().to_string(),
                // Numbers of pipes and sockets differ from run to run.
                None => match path.split_once(":[") {
                    Some((kind @ ("pipe" | "socket"), _)) => format!("a {kind}"),
                    _ => path,
                },
            })
        };
        let file = |one: &Awaited| {
            let name = one.file.as_deref().and_then(name);
            name.unwrap_or_else(|| format!("descriptor {}", one.fd))
        };
        match wait {
            Wait::Sleep { .. } | Wait::BackOff(_) => "for time to pass".to_owned(),
            Wait::Poll { set, .. } => {
                let files: Vec<String> = set.iter().map(file).collect();
                format!("for {}", files.join(" or "))
            }
            Wait::PortRead { port, .. } => match self.ports.get(*port) {
                Some(port) => format!("for bytes from {}", port.path().display()),
                None => "for bytes".to_owned(),
            },
            Wait::PortWrite { .. } => "for room on the line".to_owned(),
            Wait::Transfer(rest) => format!("for {}", name(&rest.of).unwrap_or_default()),
            Wait::Futex { .. } => "for another thread".to_owned(),
            Wait::Signal { .. } => "for a signal".to_owned(),
            Wait::Vfork { .. } => "for a child".to_owned(),
            Wait::Again(retried) => match retried.call.0 {
                libc::SYS_wait4 | libc::SYS_waitid => "for a child".to_owned(),
                _ => "for a lock or a queue".to_owned(),
            },
            Wait::Forever => "for a change of modem lines".to_owned(),
        }
    }
}

fn computing(tid: Tid, place: Option<String>) -> String {
    let place = place.map_or(String::new(), |place| format!(", in {place}"));
    format!("{} was computing{place}", name_of(tid))
}

/// Ticks in which a thread that is interrupted has stopped.
const MOST_TICKS: u32 = 100;

/// Interrupts a thread for good, and returns the file in which it computes.
fn interrupted_place(process: Tid, tid: Tid) -> Option<String> {
    sys::interrupt(tid).ok()?;
    // It stops when the system has time for it; the ticks interrupt the wait.
    let mut waits = (0..MOST_TICKS).map(|_| sys::wait(Some(tid), true));
    waits.find_map(Result::ok)??;
    place_of(process, tid)
}

/// The file in which a stopped thread computes.
fn place_of(process: Tid, tid: Tid) -> Option<String> {
    let place = Registers::of(tid).ok()?.place();
    let (_, rest) = mapping(process, place)?;
    rest.split_whitespace().nth(4).map(str::to_owned)
}
