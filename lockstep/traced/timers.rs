//! Timers of a run, by simulated time.

use crate::traced::sys::Tid;
use crate::traced::tree::TimerEvent;

#[derive(Default)]
pub(crate) struct Timers {
    pub(crate) all: Vec<Timer>,
    pub(crate) marks: i64,
}

pub(crate) struct Timer {
    pub(crate) process: Tid,
    pub(crate) kind: Kind,
    pub(crate) next: Option<u64>,
    /// Interval after that; 0 for never again.
    pub(crate) interval: u64,
    /// How often it has run out since its descriptor was read, or since its signal was sent.
    pub(crate) count: u64,
}

#[derive(Clone, Copy)]
pub(crate) enum Kind {
    Alarm,
    Posix {
        id: i32,
        event: TimerEvent,
        clock: i32,
    },
    /// A timer descriptor: the mark by which its file is known again, and one of the descriptors.
    Descriptor {
        mark: i64,
        fd: i32,
    },
}

impl Timers {
    /// Time at which the first runs out.
    pub(crate) fn next(&self) -> Option<u64> {
        self.all.iter().filter_map(|timer| timer.next).min()
    }

    /// A process has another program, which ends its POSIX timers.
    pub(crate) fn forget_posix(&mut self, process: Tid) {
        self.all
            .retain(|timer| timer.process != process || !matches!(timer.kind, Kind::Posix { .. }));
    }

    /// A process has ended; others may hold its timer descriptors.
    pub(crate) fn forget(&mut self, process: Tid) {
        self.all.retain(|timer| {
            timer.process != process || matches!(timer.kind, Kind::Descriptor { .. })
        });
    }

    /// Adds one that is not set; returns its index.
    pub(crate) fn add(&mut self, process: Tid, kind: Kind) -> usize {
        self.all.push(Timer {
            process,
            kind,
            next: None,
            interval: 0,
            count: 0,
        });
        self.all.len() - 1
    }

    /// The alarm of a process, which each has.
    pub(crate) fn alarm_of(&mut self, process: Tid) -> &mut Timer {
        let is_it = |timer: &Timer| timer.process == process && matches!(timer.kind, Kind::Alarm);
        let at = self.all.iter().position(is_it);
        let at = at.unwrap_or_else(|| self.add(process, Kind::Alarm));
        &mut self.all[at]
    }

    pub(crate) fn find(&mut self, is: impl Fn(&Timer) -> bool) -> Option<&mut Timer> {
        self.all.iter_mut().find(|timer| is(timer))
    }
}

impl Timer {
    /// Time that is left of it, and its interval.
    pub(crate) fn setting(&self, now: u64) -> (u64, u64) {
        let left = self.next.map_or(0, |next| next.saturating_sub(now).max(1));
        (left, self.interval)
    }
}

pub(crate) fn has_mark(wanted: i64) -> impl Fn(&Timer) -> bool {
    move |timer| matches!(timer.kind, Kind::Descriptor { mark, .. } if mark == wanted)
}
