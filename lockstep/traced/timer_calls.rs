//! Syscalls on timers, and what is done when one runs out: alarms, POSIX timers, timer descriptors.

use std::io;
use std::os::fd::AsFd;
use std::rc::Rc;
use std::time::Duration;

use rustix::event::PollFlags;
use rustix::process::Signal;
use rustix::time::{Itimerspec, TimerfdTimerFlags, Timespec};

use crate::traced::clock::{parts, parts_micros, span, span_micros};
use crate::traced::descriptor::Descriptor;
use crate::traced::memory::Memory;
use crate::traced::proc::{descriptors_of, info_of, own_number_of};
use crate::traced::sys::{self, Tid};
use crate::traced::syscall::{Entry, Halt, Handling, failure, int, low};
use crate::traced::timers::{Kind, Timer, has_mark};
use crate::traced::tracer::Tracer;
use crate::traced::tree::{Thread, TimerEvent};

/// Most timers of a run; a program that makes more gets an error.
const MOST: usize = 4096;

/// A hundred years, of which the system's clocks can show three times as much.
const NEVER_S: i64 = 1 << 32;

impl Tracer<'_> {
    /// `alarm`: the seconds that were left.
    pub(crate) fn alarm(&mut self, entry: Entry) -> Handling {
        let now = self.now;
        let timer = self.timers.alarm_of(entry.process);
        let left = timer.setting(now).0.div_ceil(1_000_000_000);
        let seconds = u64::from(low(entry.a[0]));
        timer.next = (seconds > 0).then(|| now.saturating_add(seconds * 1_000_000_000));
        timer.interval = 0;
        Handling::Answer(i64::try_from(left).unwrap_or(i64::MAX))
    }

    /// `setitimer` and `getitimer` of real time.
    pub(crate) fn interval_timer(
        &mut self,
        entry: Entry,
        new: Option<u64>,
        old: u64,
    ) -> Result<Handling, Halt> {
        let setting = match new {
            // Without a value it is of zeros.
            Some(0) => Some((None, 0)),
            Some(new) => {
                let new = (libc::CLOCK_REALTIME, 0, new);
                Some(self.timer_setting(entry.tid, new, span_micros)?)
            }
            None => None,
        };
        let timer = self.timers.alarm_of(entry.process);
        let before = timer.setting(self.now);
        (timer.next, timer.interval) = setting.unwrap_or((timer.next, timer.interval));
        write_setting(entry.tid, old, before, parts_micros)?;
        Ok(Handling::Answer(0))
    }

    /// `timer_create`: made by the system, which never sets it.
    pub(crate) fn timer_create(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let [clock, event, address, ..] = entry.a;
        let memory = Memory(entry.tid);
        if self.clocks.show(int(clock), self.now).is_none() {
            return Ok(Handling::Make);
        }
        if self.timers.all.len() >= MOST {
            return Ok(failure(libc::EAGAIN));
        }
        let event = if event == 0 {
            TimerEvent {
                signal: Some(libc::SIGALRM),
                thread: None,
                value: None,
            }
        } else {
            let value = memory.read_u64(event)?;
            let signal = memory.read_u32(event + 8)?.cast_signed();
            let notify = memory.read_u32(event + 12)?.cast_signed();
            let thread = memory.read_u32(event + 16)?.cast_signed();
            TimerEvent {
                signal: (notify != libc::SIGEV_NONE).then_some(signal),
                thread: (notify == libc::SIGEV_THREAD_ID).then_some(thread),
                value: Some(value),
            }
        };
        let result = self.make(entry, entry.a)?;
        if result != 0 {
            return Ok(Handling::Answer(result));
        }
        let id = memory.read_u32(address)?.cast_signed();
        let process = entry.process;
        let named = event.thread.and_then(|named| {
            let mut threads = self.tree.threads.iter();
            let is_it = |(tid, thread): &(&Tid, &Thread)| {
                thread.process == process && own_number_of(process, **tid) == Some(named)
            };
            threads.find(is_it).map(|(tid, _)| *tid)
        });
        let event = TimerEvent {
            thread: named,
            ..event
        };
        let clock = int(clock);
        let kind = Kind::Posix { id, event, clock };
        self.timers.add(process, kind);
        Ok(Handling::Answer(result))
    }

    /// `timer_settime`, or `timer_gettime` without `new`.
    pub(crate) fn posix_timer(
        &mut self,
        entry: Entry,
        new: Option<(u64, u64)>,
        old: u64,
    ) -> Result<Handling, Halt> {
        let now = self.now;
        let timer = self.timers.find(is_posix(entry)).ok_or(Halt::Make)?;
        let before = timer.setting(now);
        if let (Some((flags, new)), Kind::Posix { clock, .. }) = (new, timer.kind) {
            let setting = self.timer_setting(entry.tid, (clock, flags, new), span)?;
            let timer = self.timers.find(is_posix(entry)).ok_or(Halt::Make)?;
            (timer.next, timer.interval) = setting;
        }
        write_setting(entry.tid, old, before, parts)?;
        self.fire_timers()?;
        Ok(Handling::Answer(0))
    }

    /// `timer_getoverrun`: how often it has run out beside the time for which its signal was sent.
    pub(crate) fn timer_overrun(&mut self, entry: Entry) -> Result<Handling, Halt> {
        let timer = self.timers.find(is_posix(entry)).ok_or(Halt::Make)?;
        Ok(Handling::Answer(
            i64::try_from(timer.count).unwrap_or(i64::MAX),
        ))
    }

    /// `timer_delete`; the system deletes its own.
    pub(crate) fn timer_delete(&mut self, entry: Entry) -> Handling {
        let is_it = is_posix(entry);
        self.timers.all.retain(|timer| !is_it(timer));
        Handling::Make
    }

    /// `timerfd_settime`, or `timerfd_gettime` without `new`.
    pub(crate) fn timer_descriptor(
        &mut self,
        entry: Entry,
        new: Option<(u64, u64)>,
        old: u64,
    ) -> Result<Handling, Halt> {
        let (tid, process, a) = (entry.tid, entry.process, entry.a);
        let now = self.now;
        let fd = int(a[0]);
        self.pass(tid, [fd])?;
        let descriptor = self.descriptor(process, fd).ok_or(Halt::Make)?;
        // Not a timer.
        let clock = info_of(process, fd, "clockid:").and_then(|clock| clock.parse().ok());
        let clock = clock.ok_or(Halt::Make)?;
        // TFD_TIMER_ABSTIME and TFD_TIMER_CANCEL_ON_SET; the system refuses others.
        if new.is_some_and(|(flags, _)| int(flags) & !3 != 0) {
            return Ok(Handling::Make);
        }
        let known = timer_mark(&descriptor.file);
        let known = known.filter(|mark| self.timers.find(has_mark(*mark)).is_some());
        let Some((flags, new)) = new else {
            let setting = known.and_then(|mark| self.timers.find(has_mark(mark)));
            let setting = setting.map_or((0, 0), |timer| timer.setting(now));
            write_setting(tid, old, setting, parts)?;
            return Ok(Handling::Answer(0));
        };
        let new = self.timer_setting(tid, (clock, flags, new), span)?;
        let mark = match known {
            Some(mark) => mark,
            None if self.timers.all.len() >= MOST => return Ok(failure(libc::ENOMEM)),
            None => {
                self.timers.marks += 1;
                let mark = self.timers.marks;
                let kind = Kind::Descriptor { mark, fd };
                self.timers.add(process, kind);
                self.timers.marks
            }
        };
        let mut setting = (0, 0);
        if let Some(timer) = self.timers.find(has_mark(mark)) {
            setting = timer.setting(now);
            (timer.next, timer.interval) = new;
            timer.kind = Kind::Descriptor { mark, fd };
            (timer.process, timer.count) = (process, 0);
        }
        mark_timer(&descriptor.file, mark, false)?;
        drop(descriptor);
        write_setting(tid, old, setting, parts)?;
        self.fire_timers()?;
        Ok(Handling::Answer(0))
    }

    /// A read of a timer descriptor that has run out more than once returns how often.
    pub(crate) fn read_timer(
        &mut self,
        tid: Tid,
        descriptor: &Descriptor,
        into: &[(u64, u64)],
    ) -> Result<Option<i64>, Halt> {
        let Some(mark) = timer_mark(&descriptor.file) else {
            return Ok(None);
        };
        let Some(found) = self.timers.find(has_mark(mark)) else {
            return Ok(None);
        };
        let count = std::mem::take(&mut found.count);
        if count == 0 {
            return Ok(None);
        }
        Memory(tid).write_parts(into, &count.to_ne_bytes())?;
        mark_timer(&descriptor.file, mark, false)?;
        Ok(Some(8))
    }

    /// Expiry and interval in a timer setting at this address.
    fn timer_setting(
        &self,
        tid: Tid,
        (clock, flags, new): (i32, u64, u64),
        read: fn((i64, i64)) -> Option<u64>,
    ) -> Result<(Option<u64>, u64), Halt> {
        let interval = read(Memory(tid).read_pair(new)?).ok_or(Halt::Make)?;
        let value = read(Memory(tid).read_pair(new + 16)?).ok_or(Halt::Make)?;
        let next = match value {
            0 => None,
            // TIMER_ABSTIME, which TFD_TIMER_ABSTIME is as well.
            _ if flags & 1 != 0 => self.clocks.when(clock, value, self.now),
            _ => Some(self.now.saturating_add(value)),
        };
        Ok((next, interval))
    }

    pub(crate) fn fire_timers(&mut self) -> Result<(), Halt> {
        let now = self.now;
        for index in 0..self.timers.all.len() {
            let Some(timer) = self.timers.all.get_mut(index) else {
                break;
            };
            let Some(next) = timer.next.filter(|next| *next <= now) else {
                continue;
            };
            let times = (now - next).checked_div(timer.interval).unwrap_or(0) + 1;
            timer.next = (timer.interval > 0)
                .then(|| next.saturating_add(timer.interval.saturating_mul(times)));
            timer.count += times;
            let (process, kind) = (timer.process, timer.kind);
            match kind {
                Kind::Alarm => {
                    sys::kill(process, Signal::ALARM);
                    self.schedule.signalled = true;
                }
                Kind::Posix { id, event, .. } => {
                    // Its signal is sent once, and counts what follows until it has been taken.
                    let is_it = |one: &Thread| one.process == process && one.block().is_some();
                    let stopped = event.thread.or(self.tree.all(is_it).first().copied());
                    let shared = event.thread.is_none();
                    let waits = stopped.is_some_and(|tid| sys::has_timer_signal(tid, id, shared));
                    if let Some(signal) = event.signal.filter(|_| !waits) {
                        if let Some(timer) = self.timers.all.get_mut(index) {
                            timer.count = times - 1;
                        }
                        let value = event.value.unwrap_or(u64::from(id.unsigned_abs()));
                        let _ = sys::queue_timer_signal(process, event.thread, signal, id, value);
                        self.schedule.signalled = true;
                    }
                }
                Kind::Descriptor { mark, fd } => self.fire_descriptor(process, mark, fd)?,
            }
            self.schedule.happened += 1;
        }
        Ok(())
    }

    fn fire_descriptor(&mut self, process: Tid, mark: i64, fd: i32) -> Result<(), Halt> {
        let is_it = |descriptor: &Rc<Descriptor>| {
            descriptor.is_anonymous() && timer_mark(&descriptor.file) == Some(mark)
        };
        let found = self.descriptor(process, fd).filter(is_it).or_else(|| {
            // It has another number, or another process has it.
            self.tree.processes.keys().find_map(|pid| {
                let mut all = descriptors_of(*pid);
                all.find_map(|fd| self.descriptor(*pid, fd).filter(is_it))
            })
        });
        let Some(descriptor) = found else {
            // Closed; no thread will ever read it.
            self.timers.all.retain(|timer| !has_mark(mark)(timer));
            return Ok(());
        };
        mark_timer(&descriptor.file, mark, true)?;
        // One nanosecond ends soon enough.
        for _ in 0..1000 {
            if descriptor.is_ready(PollFlags::IN) {
                return Ok(());
            }
            std::thread::sleep(Duration::from_micros(10));
        }
        Err(io::Error::other("a timer of the system does not run out").into())
    }
}

/// The POSIX timer of a process that a syscall is about.
fn is_posix(entry: Entry) -> impl Fn(&Timer) -> bool {
    let wanted = int(entry.a[0]);
    move |timer| {
        timer.process == entry.process
            && matches!(timer.kind, Kind::Posix { id, .. } if id == wanted)
    }
}

/// Writes what is left of a timer and its interval, if that is asked for.
fn write_setting(
    tid: Tid,
    old: u64,
    (left, interval): (u64, u64),
    parts: fn(u64) -> (i64, i64),
) -> io::Result<()> {
    if old == 0 {
        return Ok(());
    }
    let (seconds, part) = parts(interval);
    Memory(tid).write_pair(old, seconds, part)?;
    let (seconds, part) = parts(left);
    Memory(tid).write_pair(old + 16, seconds, part)
}

/// Sets a timer descriptor so that it becomes readable at once, or never if `ready` is not set. The
/// interval is the mark by which it is known again.
fn mark_timer(timer: impl AsFd, mark: i64, ready: bool) -> io::Result<()> {
    let times = Itimerspec {
        it_interval: Timespec {
            tv_sec: NEVER_S + mark,
            tv_nsec: 0,
        },
        it_value: Timespec {
            tv_sec: if ready { 0 } else { NEVER_S },
            tv_nsec: i64::from(ready),
        },
    };
    rustix::time::timerfd_settime(timer, TimerfdTimerFlags::empty(), &times)?;
    Ok(())
}

fn timer_mark(timer: impl AsFd) -> Option<i64> {
    let times = rustix::time::timerfd_gettime(timer).ok()?;
    let mark = times.it_interval.tv_sec.checked_sub(NEVER_S)?;
    Some(mark).filter(|mark| *mark >= 0)
}
