//! What the descriptors of programs lead to, and what a poll of them finds.

use std::os::fd::OwnedFd;
use std::rc::Rc;

use rustix::event::{PollFd, PollFlags};
use rustix::fs::{Mode, OFlags};
use rustix::process::PidfdGetfdFlags;

use crate::traced::descriptor::{Descriptor, EVER_READY, QUEUES, Status, is_any_ready};
use crate::traced::proc::{Signals, descriptors_of, number, path_of};
use crate::traced::sys::Tid;
use crate::traced::tracer::Tracer;
use crate::traced::wait::Awaited;

/// Most duplicates of descriptors in a run; beyond that all are made again.
const MOST_KEPT: usize = 64;

impl Tracer<'_> {
    /// Finds what a descriptor of a process leads to; `None` if there is none.
    pub(crate) fn descriptor(&self, process: Tid, fd: i32) -> Option<Rc<Descriptor>> {
        let owner = self.tree.processes.get(&process)?;
        if let Some(known) = owner.files.borrow().get(&fd) {
            return known.clone();
        }
        let file = self.duplicate(process, owner.handle.as_ref()?, fd)?;
        self.keep(process, fd, Some(file))
    }

    /// Returns whether a descriptor's file is known, or known to be unknowable.
    pub(crate) fn is_known(&self, process: Tid, fd: i32) -> bool {
        let owner = self.tree.processes.get(&process);
        self.descriptor(process, fd).is_some()
            || owner.is_none_or(|owner| owner.files.borrow().contains_key(&fd))
    }

    /// Keeps a duplicate of a descriptor until the process closes that.
    pub(crate) fn keep(
        &self,
        process: Tid,
        fd: i32,
        file: Option<OwnedFd>,
    ) -> Option<Rc<Descriptor>> {
        let tables = || self.tree.processes.values().map(|process| &process.files);
        // Passing descriptors is slow, and the system limits their number.
        let kept: usize = tables().map(|files| files.borrow().len()).sum();
        if kept >= MOST_KEPT && self.descriptors.passage.is_none() {
            let is_awaited = |one: &mut Option<Rc<Descriptor>>| {
                one.as_ref().is_some_and(|one| Rc::strong_count(one) > 1)
            };
            tables().for_each(|files| files.borrow_mut().retain(|_, one| is_awaited(one)));
        }
        let descriptor = file.and_then(Descriptor::new).map(Rc::new);
        if let Some(one) = descriptor
            .as_ref()
            .filter(|one| one.status.kind.is_char_device())
        {
            self.descriptors.ports_used.set(true);
            if let Some(index) = self.port_of(one).filter(|_| one.is_tty) {
                self.ports[index].by_tty.set(true);
            }
        }
        let files = &self.tree.processes.get(&process)?.files;
        files.borrow_mut().insert(fd, descriptor.clone());
        descriptor
    }

    /// Our own descriptor of what one of a process leads to. Programs may name any number.
    fn duplicate(&self, process: Tid, handle: &OwnedFd, fd: i32) -> Option<OwnedFd> {
        if fd < 0 {
            return None;
        }
        if self.descriptors.passage.is_none() {
            return rustix::process::pidfd_getfd(handle, fd, PidfdGetfdFlags::empty()).ok();
        }
        // A file that never waits need not be passed: its path is enough.
        let path = format!("/proc/{process}/fd/{fd}");
        let file = rustix::fs::open(path, OFlags::PATH | OFlags::CLOEXEC, Mode::empty()).ok()?;
        let is_queue = rustix::fs::fstatfs(&file).is_ok_and(|one| one.f_type == QUEUES);
        let one = Descriptor::new(file)?;
        (one.never_waits() && !is_queue && !self.descriptors.lists.has(&one)).then_some(one.file)
    }

    pub(crate) fn port_of(&self, descriptor: &Descriptor) -> Option<usize> {
        if !descriptor.status.kind.is_char_device() {
            return None;
        }
        let device = descriptor.status.device;
        self.ports.iter().position(|port| port.is_device(device))
    }

    /// A descriptor of a process, to be waited for.
    pub(crate) fn awaited(&self, process: Tid, (fd, flags): (i32, PollFlags)) -> Awaited {
        let file = self.descriptor(process, fd);
        Awaited { fd, flags, file }
    }

    /// Returns whether the number of a descriptor that is waited for still leads to it.
    pub(crate) fn leads_there(&self, process: Tid, awaited: &Awaited) -> bool {
        let now = self.descriptor(process, awaited.fd);
        now.as_ref().map(Rc::as_ptr) == awaited.file.as_ref().map(Rc::as_ptr)
    }

    /// The files that a process polls, and those that epolls among them poll. One epoll in another is one file.
    pub(crate) fn polled_files(
        &self,
        process: Tid,
        set: &[Awaited],
    ) -> Vec<(Rc<Descriptor>, PollFlags)> {
        let mut all = Vec::new();
        for Awaited { flags, file, .. } in set {
            all.extend(file.clone().map(|file| (file, *flags)));
            for (fd, flags) in file.as_ref().map_or(Vec::new(), |file| file.members()) {
                all.extend(self.descriptor(process, fd).map(|file| (file, flags)));
            }
        }
        all
    }

    /// What a poll of these descriptors of a thread finds of each.
    pub(crate) fn readiness(&self, tid: Tid, set: &[Awaited]) -> Vec<PollFlags> {
        let process = self.tree.process_of(tid);
        let mut found = vec![PollFlags::empty(); set.len()];
        let (mut polls, mut places) = (Vec::new(), Vec::new());
        for (at, Awaited { fd, flags, file }) in set.iter().enumerate() {
            // A poll from outside would clear an epoll's record of a signal.
            let has_signal = || file.as_ref().is_some_and(|file| self.has_signal(tid, file));
            if flags.contains(PollFlags::IN) && has_signal() {
                found[at] = PollFlags::IN;
                continue;
            }
            match file {
                Some(file) => match self.port_of(file) {
                    Some(port) => found[at] = self.ports[port].readiness() & *flags,
                    None => {
                        polls.push(PollFd::new(&file.file, *flags));
                        places.push(at);
                    }
                },
                None if *fd < 0 && flags.is_empty() => {}
                // One that cannot be passed; else there is none.
                None if path_of(process, *fd).is_some() => found[at] = EVER_READY & *flags,
                None => found[at] = PollFlags::NVAL,
            }
        }
        if is_any_ready(&mut polls) {
            for (at, poll) in places.into_iter().zip(&polls) {
                found[at] = match poll.revents() {
                    // A duplicate of what never waits may be a path alone.
                    PollFlags::NVAL => EVER_READY & set[at].flags,
                    revents => revents,
                };
            }
        }
        found
    }

    /// Returns whether a poll by a thread finds one of these of a descriptor, or an error.
    pub(crate) fn is_ready(&self, tid: Tid, file: &Descriptor, flags: PollFlags) -> bool {
        file.is_ready(flags) || flags == PollFlags::IN && self.has_signal(tid, file)
    }

    /// Returns whether a descriptor of a thread is a `signalfd`, or an epoll with one, that has a signal
    /// for it. The system would answer a poll of our duplicate for this program's own signals.
    pub(crate) fn has_signal(&self, tid: Tid, file: &Descriptor) -> bool {
        let process = self.tree.process_of(tid);
        if !self.descriptors.has_signalfd || !file.is_anonymous() {
            return false;
        }
        match file.info("sigmask:").and_then(|mask| number(&mask)) {
            Some(mask) => Signals::of(process, tid).is_some_and(|all| all.pending & mask != 0),
            None => file.members().into_iter().any(|(member, _)| {
                let member = self.descriptor(process, member);
                member.is_some_and(|member| self.has_signal(tid, &member))
            }),
        }
    }

    /// Returns whether a process of the run has a port open, in any way or through `/dev/tty`.
    pub(crate) fn holds_port(&self, index: usize, by_tty: bool) -> bool {
        let port = &self.ports[index];
        let leads_there = |pid, fd| {
            let status = Status::of_process(pid, fd)?;
            if status.is_tty() {
                return Some(port.is_device(self.descriptor(pid, fd)?.status.device));
            }
            Some(!by_tty && port.is_device(status.device))
        };
        let mut processes = self.tree.processes.keys();
        processes.any(|pid| descriptors_of(*pid).any(|fd| leads_there(*pid, fd) == Some(true)))
    }
}
