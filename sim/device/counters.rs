//! Observations of a device: its events, as far as conditions ask for them.

use std::collections::BTreeMap;

use rigsim_settings::SimTime;

use crate::event::Event;
use crate::message::Sender;
use crate::report::Report;

/// Observations of one device since the start.
#[derive(Default)]
pub struct Counters {
    /// Counts of its events.
    pub report: Report,
    /// Events by their codes, also those that are attributed to no party; messages by their `count`.
    counts: BTreeMap<&'static str, u64>,
    /// Time of the last request for motion, and the distance driven until then.
    pub last_motion: Option<(SimTime, f64)>,
    /// Number of requests for motion.
    pub motion_requests: u64,
    /// Values in the last messages that had them, by their names for conditions.
    fields: BTreeMap<&'static str, f64>,
    /// Times of the last messages, by the names of their ages.
    messages: BTreeMap<&'static str, SimTime>,
}

impl Counters {
    /// Takes note of an event of the device, which has driven so far; unless it is `excused`, it
    /// counts in the report.
    pub fn add_event(&mut self, event: &Event, distance_m: f64, excused: bool) {
        if let Some((message, payload)) = event.kind.message() {
            if message.motion {
                self.last_motion = Some((event.at, distance_m));
                self.motion_requests += 1;
            }
            for (field, numbers) in message.values(payload) {
                self.fields.extend(field.named_values(&numbers));
            }
            self.messages.insert(message.age, event.at);
            if message.sender == Sender::Client {
                *self.counts.entry(message.count).or_default() += 1;
            }
        }
        *self.counts.entry(event.kind.code().name).or_default() += 1;
        if !excused {
            self.report.add_event(event);
        }
    }

    /// Counts the events of a code.
    #[must_use]
    pub fn count(&self, code: &str) -> u64 {
        self.counts.get(code).copied().unwrap_or(0)
    }

    /// Returns a value in the last message that had it, in its unit; 0 before.
    #[must_use]
    pub fn field(&self, name: &str) -> f64 {
        self.fields.get(name).copied().unwrap_or(0.0)
    }

    /// Returns the time of the last message whose age has this name.
    #[must_use]
    pub fn last_message(&self, age: &str) -> Option<SimTime> {
        self.messages.get(age).copied()
    }
}
