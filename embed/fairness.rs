//! What is not held against a client because the machine was busy.

use std::time::Duration;

use sim_core::SimTime;
use sim_core::event::Event;

/// Whoever sends at a steady rate is back in its rhythm after two rounds at the R150's 20 Hz.
const RHYTHM: Duration = Duration::from_millis(100);

/// What a client does in steady time can look like this when a busy machine delivers it at once.
const TIMING: [&str; 7] = [
    "watchdog_fired",
    "heartbeat_lost",
    "link_timeout",
    "queue_full",
    "line_full",
    "reply_dropped",
    "overrun",
];

/// Until when what clients send may come in a burst, after the simulator was late at `now` by so much
/// simulated time.
pub fn burst_end(now: SimTime, by: Duration) -> SimTime {
    now + by + RHYTHM
}

/// Knows when the simulator was late.
#[derive(Default)]
pub struct Fairness {
    excused_until: Option<SimTime>,
    excused: u64,
    held_up: HeldUp,
}

/// Real time for which simulated time stood still since the machine did not let the simulator run, or
/// was too slow for it. A client's own clock went on meanwhile.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct HeldUp {
    /// How often that was.
    pub times: u64,
    /// For how long in all.
    pub total: Duration,
    /// For how long at the longest.
    pub longest: Duration,
}

impl HeldUp {
    fn note(&mut self, by: Duration) {
        self.times += 1;
        self.total = self.total.saturating_add(by);
        self.longest = self.longest.max(by);
    }
}

impl Fairness {
    /// The simulator was late at `now` by so much simulated time. What the clients sent meanwhile
    /// arrives in one burst now, which takes less time than the sending did.
    pub fn late(&mut self, now: SimTime, by: Duration) {
        self.excused_until = self.excused_until.max(Some(burst_end(now, by)));
    }

    /// Simulated time stood still for so much real time.
    pub fn held_up_by(&mut self, by: Duration) {
        self.held_up.note(by);
    }

    /// For how long simulated time stood still so far.
    pub fn held_up(&self) -> HeldUp {
        self.held_up
    }

    /// Whether an event looks like the client's fault but may well be the machine's.
    pub fn would_excuse(&self, event: &Event) -> bool {
        event.kind.blames_client()
            && self.excused_until.is_some_and(|until| event.at <= until)
            && TIMING.contains(&event.kind.code().as_str())
    }

    /// The same, and counts it.
    pub fn excuses(&mut self, event: &Event) -> bool {
        let excused = self.would_excuse(event);
        self.excused += u64::from(excused);
        excused
    }

    /// How many events were excused.
    pub fn excused(&self) -> u64 {
        self.excused
    }
}
