//! Observations of a device: its events, as far as conditions ask for them.

use std::any::Any;
use std::collections::BTreeMap;

use sim_settings::SimTime;

use super::DeviceSpec;
use crate::event::{Event, EventKind, Role};
use crate::report::Report;

/// Takes note of a device's events, for the names of its own.
pub trait Observer: Any + Send + Sync {
    /// Something happened at `at`; says whether motion was asked for.
    fn note(&mut self, at: SimTime, event: &dyn EventKind) -> bool;
}

/// For a device that has no such names.
impl Observer for () {
    fn note(&mut self, _at: SimTime, _event: &dyn EventKind) -> bool {
        false
    }
}

/// Observations of one device since the start.
pub struct Observed {
    /// Counts of its events.
    pub report: Report,
    /// Events by their codes, also those that are held against nobody.
    counts: BTreeMap<&'static str, u64>,
    /// Number of its ports that are open.
    pub attached: u64,
    /// Time of the last valid request.
    pub last_request: Option<SimTime>,
    /// Time of the last request for motion, and the distance driven until then.
    pub last_motion: Option<(SimTime, f64)>,
    /// Number of requests for motion.
    pub motion_requests: u64,
    /// Notes of the device's own observer.
    pub own: Box<dyn Observer>,
}

impl Observed {
    /// Nothing yet, of a device of this kind.
    #[must_use]
    pub fn new(device: &DeviceSpec) -> Self {
        Self {
            report: Report::default(),
            counts: BTreeMap::new(),
            attached: 0,
            last_request: None,
            last_motion: None,
            motion_requests: 0,
            own: (device.observer)(),
        }
    }

    /// Takes note of an event of the device, which has driven so far; unless it is `excused`, it
    /// counts in the report.
    pub fn note(&mut self, event: &Event, distance_m: f64, excused: bool) {
        match event.kind.role() {
            Role::Attached => self.attached += 1,
            Role::Detached => self.attached = self.attached.saturating_sub(1),
            Role::Request => self.last_request = Some(event.at),
            Role::Reply | Role::HeartbeatLost | Role::Damage | Role::Other => {}
        }
        if self.own.note(event.at, &*event.kind) {
            self.last_motion = Some((event.at, distance_m));
            self.motion_requests += 1;
        }
        *self.counts.entry(event.kind.code().as_str()).or_default() += 1;
        if !excused {
            self.report.note(event);
        }
    }

    /// Counts the events of a code.
    #[must_use]
    pub fn count(&self, code: &str) -> u64 {
        self.counts.get(code).copied().unwrap_or(0)
    }
}
