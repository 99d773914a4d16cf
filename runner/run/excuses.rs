//! Excuses for a client while its line was disturbed, or the machine busy.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::Event;

/// A client that sends at a steady rate is back in its rhythm after two rounds at the R150's 20 Hz.
const RHYTHM: Duration = Duration::from_millis(100);

/// Times up to which something is not the client's fault.
#[derive(Debug)]
pub(super) struct Excuses {
    /// What a disturbed line looks like, by device.
    pub(super) disturbed_until: Vec<SimTime>,
    /// What a stalled simulator looks like.
    late_until: Option<SimTime>,
    excused: u64,
}

impl Excuses {
    /// None yet, for so many devices.
    pub(super) fn new(devices: usize) -> Self {
        Self {
            disturbed_until: vec![SimTime::ZERO; devices],
            late_until: None,
            excused: 0,
        }
    }

    /// Simulated time stood still at `now` for so long. What the clients sent
    /// meanwhile arrives in one burst now, which takes less time than the sending did.
    pub(super) fn extend(&mut self, now: SimTime, by: Duration) {
        self.late_until = self.late_until.max(Some(now + by + RHYTHM));
    }

    /// Returns whether an event looks like the client's fault but may well be the machine's; counts
    /// those.
    pub(super) fn excuses(&mut self, event: &Event) -> bool {
        let excused = self.late_until.is_some_and(|until| event.at <= until)
            && event.kind.is_client_error()
            && event.kind.code().attribution.spares_late();
        self.excused += u64::from(excused);
        excused
    }

    /// Number of events that were excused.
    pub(super) fn excused(&self) -> u64 {
        self.excused
    }
}
