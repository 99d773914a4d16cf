//! The clocks that programs see.

use std::time::Duration;

/// Time that monotonic clocks show at the beginning: programs take 0 for "never".
const MONOTONIC_START: u64 = 1_000_000_000_000;

const NANOSECONDS: u64 = 1_000_000_000;

#[derive(Debug)]
pub(crate) struct Clocks {
    /// Date that the real-time clock shows at the beginning.
    date: u64,
}

impl Clocks {
    pub(crate) fn new(date: Duration) -> Self {
        Self {
            date: nanoseconds(date),
        }
    }

    pub(crate) fn monotonic(&self, now: u64) -> u64 {
        MONOTONIC_START.saturating_add(now)
    }

    /// Nanoseconds since 1970.
    pub(crate) fn real(&self, now: u64) -> u64 {
        self.date.saturating_add(now)
    }

    /// Time of a clock; `None` if it does not show simulated time.
    pub(crate) fn show(&self, clock: i32, now: u64) -> Option<u64> {
        match clock {
            libc::CLOCK_REALTIME
            | libc::CLOCK_REALTIME_COARSE
            | libc::CLOCK_REALTIME_ALARM
            | libc::CLOCK_TAI => Some(self.real(now)),
            libc::CLOCK_MONOTONIC
            | libc::CLOCK_MONOTONIC_RAW
            | libc::CLOCK_MONOTONIC_COARSE
            | libc::CLOCK_BOOTTIME
            | libc::CLOCK_BOOTTIME_ALARM => Some(self.monotonic(now)),
            _ => None,
        }
    }

    /// Time at which a clock reaches that, or now if it has.
    pub(crate) fn when(&self, clock: i32, shown: u64, now: u64) -> Option<u64> {
        let shows = self.show(clock, now)?;
        Some(now.saturating_add(shown.saturating_sub(shows)))
    }
}

/// A duration in the system's form; `None` if it is invalid, which the system itself refuses.
pub(crate) fn span((seconds, nanoseconds): (i64, i64)) -> Option<u64> {
    let seconds = u64::try_from(seconds).ok()?;
    let part = u64::try_from(nanoseconds)
        .ok()
        .filter(|n| *n < NANOSECONDS)?;
    Some(seconds.saturating_mul(NANOSECONDS).saturating_add(part))
}

pub(crate) fn span_micros((seconds, microseconds): (i64, i64)) -> Option<u64> {
    // `select` takes more than a second of them.
    let seconds = u64::try_from(seconds).ok()?;
    let part = u64::try_from(microseconds).ok()?;
    let part = part.saturating_mul(1000);
    Some(seconds.saturating_mul(NANOSECONDS).saturating_add(part))
}

pub(crate) fn parts(time: u64) -> (i64, i64) {
    let part = |value: u64| i64::try_from(value).unwrap_or(i64::MAX);
    (part(time / NANOSECONDS), part(time % NANOSECONDS))
}

pub(crate) fn parts_micros(time: u64) -> (i64, i64) {
    let (seconds, nanoseconds) = parts(time);
    (seconds, nanoseconds / 1000)
}

/// Whole nanoseconds, up to 584 years.
pub(crate) fn nanoseconds(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}
