//! Limit of requests.

use std::sync::{Mutex, PoisonError};
use std::thread;
use std::time::{Duration, Instant};

/// Between two requests, on average.
const INTERVAL: Duration = Duration::from_millis(1);
/// By how much requests may be ahead of that.
const BURST: Duration = Duration::from_millis(50);

/// Holds requests back that are too many.
#[derive(Debug, Default)]
pub(crate) struct Pace(Mutex<Option<Instant>>);

impl Pace {
    /// Waits until it is this request's turn.
    pub(crate) fn wait(&self) {
        thread::sleep(self.turn(Instant::now()));
    }

    /// The time from `now` for which the next request has to wait.
    fn turn(&self, now: Instant) -> Duration {
        let mut next = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        let earliest = now.checked_sub(BURST).unwrap_or(now);
        let own = next.map_or(earliest, |next| next.max(earliest));
        *next = Some(own + INTERVAL);
        own.saturating_duration_since(now)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_thousand_a_second_after_a_burst() {
        let pace = Pace::default();
        let start = Instant::now();
        let free = (0..1000).filter(|_| pace.turn(start).is_zero()).count();
        assert_eq!(free, 51);
        let later = start + Duration::from_secs(10);
        assert!(pace.turn(later).is_zero());
        assert_eq!(pace.turn(start), Duration::from_millis(9951));
    }
}
