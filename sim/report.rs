//! Counts of what happened in a run: the summary, and the client report.

use std::collections::BTreeMap;

use rigsim_settings::SimTime;

use crate::event::{Event, Role};

/// Events of one kind.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Tally {
    /// Number of events.
    pub count: u64,
    /// Time of the first.
    pub first_at: SimTime,
    /// The first in words.
    pub first: String,
    /// The bytes of the first, if it was about bytes.
    pub bytes: Option<Vec<u8>>,
    /// Bytes that were lost in all of them.
    pub lost_bytes: u64,
    /// Number of them that were the client's doing: forbidden by the protocol, or risky.
    pub client_errors: u64,
    /// Set if they are of [damage](Role::Damage).
    pub is_damage: bool,
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
    /// Clients that have a port open now.
    pub(crate) attached: u64,
}

impl Report {
    /// Counts an event.
    pub fn add_event(&mut self, event: &Event) {
        let kind = &event.kind;
        match kind.code().role {
            Role::Request => return self.requests += 1,
            Role::Reply => return self.replies += 1,
            Role::Attached => self.attached += 1,
            Role::Detached => self.attached = self.attached.saturating_sub(1),
            _ => {}
        }
        let tally = self
            .events
            .entry(kind.code().name)
            .or_insert_with(|| Tally {
                count: 0,
                first_at: event.at,
                first: kind.to_string(),
                bytes: kind.bytes().map(<[u8]>::to_vec),
                lost_bytes: 0,
                client_errors: 0,
                is_damage: kind.code().role == Role::Damage,
            });
        tally.count += 1;
        tally.lost_bytes = tally.lost_bytes.saturating_add(kind.lost_bytes);
        // A heartbeat that ends because the client has left is as it should be.
        let left = kind.code().role == Role::HeartbeatLost && self.attached == 0;
        tally.client_errors += u64::from(kind.is_client_error() && !left);
    }

    /// Lists what the client did that the protocol forbids or that is risky.
    pub fn client_errors(&self) -> impl Iterator<Item = (&'static str, &Tally)> {
        self.of(|tally| tally.client_errors > 0)
    }

    /// Lists what broke, or came close to it.
    pub fn damage(&self) -> impl Iterator<Item = (&'static str, &Tally)> {
        self.of(|tally| tally.is_damage)
    }

    fn of(&self, is: fn(&Tally) -> bool) -> impl Iterator<Item = (&'static str, &Tally)> {
        let events = self.events.iter().filter(move |(_, tally)| is(tally));
        events.map(|(code, tally)| (*code, tally))
    }
}
