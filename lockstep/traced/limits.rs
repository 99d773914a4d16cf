//! Limits of a run: the time that it may take.

use std::time::{Duration, Instant};

use crate::traced::sys;

pub(crate) struct Limits {
    /// Simulated time at which those who were asked to end are killed.
    pub(crate) killed_at: Option<u64>,
    /// Since when a thread waits for the world outside, in real and in simulated time.
    pub(crate) paced: Option<(Instant, u64)>,
    /// Processor time of processes that have gone, and real time of waits for the world outside, less
    /// what this thread had used at the beginning.
    pub(crate) used: Duration,
    /// Processor time of this thread at the beginning.
    pub(crate) begun: Duration,
    pub(crate) checked: Duration,
    pub(crate) is_over: bool,
}

impl Limits {
    pub(crate) fn new() -> Self {
        Self {
            killed_at: None,
            paced: None,
            used: Duration::ZERO,
            begun: own_processor_time(),
            checked: sys::coarse_time(),
            is_over: false,
        }
    }
}

pub(crate) fn own_processor_time() -> Duration {
    sys::processor_time(libc::CLOCK_THREAD_CPUTIME_ID).unwrap_or_default()
}
