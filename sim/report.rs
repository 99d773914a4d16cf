//! What happened in a run, counted: the summary, and the client report.

use std::collections::BTreeMap;

use sim_settings::SimTime;

use crate::event::{Event, Level};

/// Events of one kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tally {
    /// How many there were.
    pub count: u64,
    /// When the first was.
    pub first_at: SimTime,
    /// The first in words.
    pub first: String,
    /// The bytes of the first, if it was about bytes.
    pub bytes: Option<Vec<u8>>,
    /// Whether it is something that the client did and the protocol forbids, or that is risky.
    pub client_fault: bool,
}

/// Counts of one device.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Report {
    /// Requests understood.
    pub requests: u64,
    /// Replies sent.
    pub replies: u64,
    /// Everything else, by the event's code.
    pub events: BTreeMap<&'static str, Tally>,
}

impl Report {
    /// Counts an event.
    pub fn note(&mut self, event: &Event) {
        let kind = &event.kind;
        match kind.code() {
            "request" => self.requests += 1,
            "reply" => self.replies += 1,
            code => {
                let tally = self.events.entry(code).or_insert_with(|| Tally {
                    count: 0,
                    first_at: event.at,
                    first: kind.to_string(),
                    bytes: kind.bytes(),
                    client_fault: kind.is_client_fault(),
                });
                tally.count += 1;
            }
        }
        debug_assert!(kind.level() > Level::Traffic || self.requests + self.replies > 0);
    }

    /// What the client did that the protocol forbids or that is risky.
    pub fn client_faults(&self) -> impl Iterator<Item = (&'static str, &Tally)> {
        self.events
            .iter()
            .filter(|(_, tally)| tally.client_fault)
            .map(|(code, tally)| (*code, tally))
    }
}
