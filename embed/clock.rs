//! Simulated time by the system's monotonic clock.

use std::time::{Duration, Instant};

use sim_core::SimTime;

/// Runs `speed` times as fast as real time, but for the times when it was set back.
pub(crate) struct Clock {
    start: Instant,
    speed: f64,
    /// Real time that did not count.
    lost: Duration,
}

impl Clock {
    /// Simulated time begins now.
    pub(crate) fn start(speed: f64) -> Self {
        Self {
            start: Instant::now(),
            speed,
            lost: Duration::ZERO,
        }
    }

    /// Simulated time begins only now.
    pub(crate) fn restart(&mut self) {
        *self = Self::start(self.speed);
    }

    pub(crate) fn now(&self) -> SimTime {
        let real = self.start.elapsed().saturating_sub(self.lost);
        SimTime::ZERO + real.mul_f64(self.speed)
    }

    /// Real time until `due`.
    pub(crate) fn until(&self, due: SimTime) -> Duration {
        due.since(self.now()).div_f64(self.speed)
    }

    /// Real time since `past`.
    pub(crate) fn since(&self, past: SimTime) -> Duration {
        self.now().since(past).div_f64(self.speed)
    }

    /// Goes on from `to`, as if the real time since then had not passed.
    pub(crate) fn set_back(&mut self, to: SimTime) {
        self.lost += self.since(to);
    }

    /// Simulated time in so much real time.
    pub(crate) fn simulated(&self, real: Duration) -> Duration {
        real.mul_f64(self.speed)
    }
}
