//! The events of a rig, until they are taken.

use std::collections::VecDeque;

use rigsim_settings::SimTime;

use crate::event::{Event, EventKind};

/// Most events kept; the oldest go first, and are counted.
const MOST: usize = 1 << 16;

/// Events in the order in which they happened.
#[derive(Debug, Default)]
pub(super) struct Events {
    kept: VecDeque<Event>,
    lost: u64,
}

impl Events {
    /// Keeps it until it is taken.
    pub(super) fn keep(&mut self, at: SimTime, device: usize, kind: EventKind) {
        if self.kept.len() >= MOST {
            self.kept.pop_front();
            self.lost += 1;
        }
        self.kept.push_back(Event { at, device, kind });
    }

    /// Takes the next one.
    pub(super) fn take(&mut self) -> Option<Event> {
        self.kept.pop_front()
    }

    /// Returns whether there is none to take.
    pub(super) fn is_empty(&self) -> bool {
        self.kept.is_empty()
    }

    /// Number of events that were lost because they were not taken.
    pub(super) fn lost(&self) -> u64 {
        self.lost
    }
}
