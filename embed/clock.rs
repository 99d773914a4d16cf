//! Simulated time by the system's monotonic clock.

use std::time::{Duration, Instant};

use rigsim_core::SimTime;

/// Runs `speed` times as fast as real time, but for the times when it was set back, and while it is
/// not stopped.
#[derive(Debug)]
pub struct Clock {
    /// Simulated time at `start`.
    base: SimTime,
    start: Instant,
    speed: f64,
    /// Real time since `start` that did not count.
    lost: Duration,
    /// Simulated time that did not pass since it was stopped or set, and was not asked for yet.
    stood: Duration,
    /// It shows no later time than this, at which it stops.
    stop_at: Option<SimTime>,
    stopped: bool,
}

impl Clock {
    /// Simulated time begins now.
    #[must_use]
    pub fn start(speed: f64) -> Self {
        Self {
            base: SimTime::ZERO,
            start: Instant::now(),
            speed,
            lost: Duration::ZERO,
            stood: Duration::ZERO,
            stop_at: None,
            stopped: false,
        }
    }

    /// Simulated time begins only now.
    pub(crate) fn restart(&mut self) {
        self.set(SimTime::ZERO);
        self.stood = Duration::ZERO;
    }

    /// Stops it at `now`, where the simulation is.
    pub fn stop(&mut self, now: SimTime) {
        self.set(now);
        self.stop_at = None;
        self.stopped = true;
    }

    /// Starts it again at `now`, where the simulation is: without end, or for `span` of simulated
    /// time.
    pub fn resume(&mut self, now: SimTime, span: Option<Duration>) {
        self.set(now);
        self.stop_at = span.map(|span| now + span);
        self.stopped = false;
    }

    /// Changes its speed, from `now` on, where the simulation is.
    pub fn set_speed(&mut self, now: SimTime, speed: f64) {
        self.set(now);
        self.speed = speed;
    }

    /// Simulated seconds for each second of real time.
    #[must_use]
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Returns whether it stands still until it is started again.
    #[must_use]
    pub fn is_stopped(&self) -> bool {
        self.stopped
    }

    /// Stops it when the simulation has come to where it is to stop.
    pub(crate) fn arrive(&mut self, now: SimTime) {
        if self.stop_at.is_some_and(|at| at <= now) {
            self.stop(now);
        }
    }

    /// Simulated time by now.
    #[must_use]
    pub fn now(&self) -> SimTime {
        if self.stopped {
            return self.base;
        }
        let now = self.unstopped();
        self.stop_at.map_or(now, |at| at.min(now))
    }

    /// Real time until `due`; `None` if that does not come by itself.
    pub(crate) fn until(&self, due: SimTime) -> Option<Duration> {
        let due = self.stop_at.map_or(due, |at| at.min(due));
        (!self.stopped).then(|| due.since(self.now()).div_f64(self.speed))
    }

    /// Real time since `past`.
    pub(crate) fn since(&self, past: SimTime) -> Duration {
        self.now().since(past).div_f64(self.speed)
    }

    /// Goes on from `to`, as if the real time since then had not passed. Returns the simulated time
    /// that would have passed.
    pub(crate) fn set_back(&mut self, to: SimTime) -> Duration {
        let lost = self.since(to);
        self.lost += lost;
        self.simulated(lost)
    }

    /// Returns the simulated time that did not pass while it was stopped, since the last call.
    pub(crate) fn take_stood(&mut self) -> Duration {
        if self.stopped {
            self.set(self.base);
        }
        std::mem::take(&mut self.stood)
    }

    /// Simulated time in so much real time.
    pub(crate) fn simulated(&self, real: Duration) -> Duration {
        real.mul_f64(self.speed)
    }

    /// The time that it would show if it were not stopped.
    fn unstopped(&self) -> SimTime {
        let real = self.start.elapsed().saturating_sub(self.lost);
        self.base + real.mul_f64(self.speed)
    }

    fn set(&mut self, now: SimTime) {
        self.stood = self.stood.saturating_add(self.unstopped().since(now));
        self.base = now;
        self.start = Instant::now();
        self.lost = Duration::ZERO;
    }
}

#[cfg(test)]
mod tests;
