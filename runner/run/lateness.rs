//! Excuses for a client while the machine was busy.

use std::time::Duration;

use sim_core::SimTime;
use sim_core::event::Event;

/// Whoever sends at a steady rate is back in its rhythm after two rounds at the R150's 20 Hz.
const RHYTHM: Duration = Duration::from_millis(100);

/// Until when what clients send may come in a burst, after the simulator was late at `now` by so
/// much simulated time.
pub(super) fn burst_end(now: SimTime, by: Duration) -> SimTime {
    now + by + RHYTHM
}

/// Times at which the simulator was held up, and what was excused for it.
#[derive(Debug, Default)]
pub(super) struct Lateness {
    excused_until: Option<SimTime>,
    excused: u64,
}

impl Lateness {
    /// The simulator was held up at `now` for so much simulated time. What the clients sent
    /// meanwhile arrives in one burst now, which takes less time than the sending did.
    pub(super) fn note(&mut self, now: SimTime, by: Duration) {
        self.excused_until = self.excused_until.max(Some(burst_end(now, by)));
    }

    /// Tells whether an event looks like the client's fault but may well be the machine's; counts
    /// those.
    pub(super) fn excuses(&mut self, event: &Event) -> bool {
        let excused = self.excused_until.is_some_and(|until| event.at <= until)
            && event.kind.blames_client()
            && event.kind.code().blame().spares_late();
        self.excused += u64::from(excused);
        excused
    }

    /// Number of events that were excused.
    pub(super) fn excused(&self) -> u64 {
        self.excused
    }
}
