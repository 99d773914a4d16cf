//! Simulated time.

use std::fmt;
use std::ops::{Add, AddAssign, Sub};
use std::time::Duration;

/// A point in simulated time: whole nanoseconds since the start of the run.
///
/// Spans of time are [`Duration`]s. Nothing in the pure crates ever reads a clock; their
/// caller passes the time in.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Default)]
pub struct SimTime(u64);

impl SimTime {
    /// The start of the run.
    pub const ZERO: Self = Self(0);
    /// Later than anything that happens (584 years).
    pub const MAX: Self = Self(u64::MAX);

    /// `nanos` nanoseconds after the start.
    #[must_use]
    pub const fn from_nanos(nanos: u64) -> Self {
        Self(nanos)
    }

    /// `micros` microseconds after the start.
    #[must_use]
    pub const fn from_micros(micros: u64) -> Self {
        Self(micros.saturating_mul(1_000))
    }

    /// `millis` milliseconds after the start.
    #[must_use]
    pub const fn from_millis(millis: u64) -> Self {
        Self(millis.saturating_mul(1_000_000))
    }

    /// `secs` seconds after the start.
    #[must_use]
    pub const fn from_secs(secs: u64) -> Self {
        Self(secs.saturating_mul(1_000_000_000))
    }

    /// Nanoseconds since the start.
    #[must_use]
    pub const fn as_nanos(self) -> u64 {
        self.0
    }

    /// Seconds since the start; exact to a nanosecond for the first 100 days.
    #[must_use]
    #[expect(clippy::cast_precision_loss, reason = "stated in the documentation")]
    pub fn as_secs_f64(self) -> f64 {
        self.0 as f64 / 1e9
    }

    /// The span from `earlier` to this; zero if `earlier` is later.
    #[must_use]
    pub const fn since(self, earlier: Self) -> Duration {
        Duration::from_nanos(self.0.saturating_sub(earlier.0))
    }

    /// The first whole multiple of `step` that is later than this; `step` is at least 1 ns.
    #[must_use]
    pub fn next_multiple(self, step: Duration) -> Self {
        let step = nanos(step).max(1);
        Self((self.0 / step).saturating_add(1).saturating_mul(step))
    }
}

/// A span in whole nanoseconds, saturating at 584 years.
fn nanos(span: Duration) -> u64 {
    u64::try_from(span.as_nanos()).unwrap_or(u64::MAX)
}

impl Add<Duration> for SimTime {
    type Output = Self;
    fn add(self, span: Duration) -> Self {
        Self(self.0.saturating_add(nanos(span)))
    }
}

impl AddAssign<Duration> for SimTime {
    fn add_assign(&mut self, span: Duration) {
        *self = *self + span;
    }
}

impl Sub<Duration> for SimTime {
    type Output = Self;
    fn sub(self, span: Duration) -> Self {
        Self(self.0.saturating_sub(nanos(span)))
    }
}

impl fmt::Display for SimTime {
    /// Seconds with six decimals, as `12.345678`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let text = format!(
            "{}.{:06}",
            self.0 / 1_000_000_000,
            self.0 / 1_000 % 1_000_000
        );
        f.pad_integral(true, "", &text)
    }
}

/// A span in the largest unit that shows it exactly: `250ms`, `3s`, `1h`.
#[must_use]
pub fn show_duration(span: Duration) -> String {
    const UNITS: [(u64, &str); 6] = [
        (3_600_000_000_000, "h"),
        (60_000_000_000, "min"),
        (1_000_000_000, "s"),
        (1_000_000, "ms"),
        (1_000, "us"),
        (1, "ns"),
    ];
    let total = nanos(span);
    if total == 0 {
        return "0s".to_owned();
    }
    UNITS
        .iter()
        .find(|(size, _)| total.is_multiple_of(*size))
        .map_or_else(
            || format!("{total}ns"),
            |(size, unit)| format!("{}{unit}", total / size),
        )
}

/// A span for readers, in seconds or milliseconds with three decimals at most: `52.346ms`, `1.5s`.
#[must_use]
pub fn show_rounded(span: Duration) -> String {
    let (number, unit) = match span.as_secs_f64() {
        seconds if seconds >= 1.0 => (seconds, "s"),
        seconds => (seconds * 1e3, "ms"),
    };
    let text = format!("{number:.3}");
    format!("{}{unit}", text.trim_end_matches('0').trim_end_matches('.'))
}
