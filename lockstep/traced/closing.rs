//! Descriptors that programs close while another thread waits for them.

use std::ops::RangeInclusive;

use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, Handling, int, low};
use crate::traced::tracer::Tracer;
use crate::traced::tree::Thread;
use crate::traced::wait::Wait;

impl Tracer<'_> {
    /// Descriptors of a process are about to be closed, or to lead elsewhere.
    pub(crate) fn close(
        &mut self,
        entry: Entry,
        fds: RangeInclusive<i32>,
    ) -> Result<Handling, Halt> {
        self.keep_awaited(entry, &fds)?;
        if let Some(process) = self.tree.processes.get(&entry.process) {
            let mut files = process.files.borrow_mut();
            files.retain(|fd, _| !fds.contains(fd));
        }
        self.descriptors.ports_used.set(true);
        Ok(Handling::Make)
    }

    pub(crate) fn close_range(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let [first, last] =
            [entry.a[0], entry.a[1]].map(|fd| i32::try_from(low(fd)).unwrap_or(i32::MAX));
        self.close(entry, first..=last)
    }

    /// A file stays open while a thread waits in a read or write of it. If another thread closes its descriptor,
    /// it gets a hidden one.
    ///
    /// # Errors
    /// [`Halt::Again`] if there was such a thread.
    fn keep_awaited(&mut self, entry: Entry, fds: &RangeInclusive<i32>) -> Result<(), Halt> {
        /// Programs rarely have so many.
        const LEAST: u64 = 512;
        let awaited = |(tid, thread): (&Tid, &Thread)| {
            let may_be = thread.process == entry.process && thread.kept.is_none();
            let block = thread.block().filter(|_| may_be)?;
            let whole = (block.registers.number(), block.registers.arguments());
            // A copy may wait for either of two.
            let places: &[usize] = match whole.0 {
                libc::SYS_splice => &[0, 2],
                libc::SYS_tee | libc::SYS_sendfile => &[0, 1],
                _ => &[0],
            };
            let is_closed = |place: &&usize| fds.contains(&int(whole.1[**place]));
            let place = *places.iter().find(is_closed)?;
            match &block.wait {
                Wait::Transfer(rest) => Some((*tid, place, rest.clone())),
                _ => None,
            }
        };
        let Some((tid, place, mut rest)) = self.tree.threads.iter().find_map(awaited) else {
            return Ok(());
        };
        let command = u64::from(libc::F_DUPFD_CLOEXEC.unsigned_abs());
        let duplicate = [rest.whole.1[place], command, LEAST, 0, 0, 0];
        let kept = self.inject(entry.tid, libc::SYS_fcntl, duplicate)?;
        let Ok(kept) = u64::try_from(kept) else {
            return Ok(());
        };
        (rest.whole.1[place], rest.of_part.1[place]) = (kept, kept);
        self.tree.thread(tid)?.kept = Some(kept);
        if let Some(block) = self.tree.block_of(tid) {
            block.wait = Wait::Transfer(rest);
        }
        Err(Halt::Again)
    }

    /// The syscall that needed a hidden descriptor is over.
    pub(crate) fn close_kept(&mut self, tid: Tid) -> Result<(), Halt> {
        if let Some(kept) = self.tree.thread(tid)?.kept.take() {
            self.inject(tid, libc::SYS_close, [kept, 0, 0, 0, 0, 0])?;
        }
        Ok(())
    }
}
