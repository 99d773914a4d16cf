//! What a kind of run plays of a scenario, and judges.

use std::sync::Arc;

use super::RunOptions;
use crate::scenario::{Only, Scenario, Step, StepAction};

/// The scenario, and the kind of run.
pub(super) struct Plan {
    pub(super) scenario: Arc<Scenario>,
    pub(super) options: RunOptions,
}

impl Plan {
    /// Returns whether a step is played.
    pub(super) fn is_played(&self, step: &Step) -> bool {
        let host = matches!(step.action, StepAction::Host(_));
        let replaced = host && !self.has_script(step.device);
        self.is_judged(step.only, step.mission) && !replaced
    }

    /// Returns whether the script is the client of a device.
    pub(super) fn has_script(&self, device: usize) -> bool {
        !self.options.live || self.scenario.is_scripted(device)
    }

    /// Returns whether a verdict counts.
    pub(super) fn is_judged(&self, only: Option<Only>, mission: bool) -> bool {
        self.counts(only) && !(mission && self.scenario.mission_may_fail)
    }

    /// Returns whether what is only for some kind of run is for this one.
    pub(super) fn counts(&self, only: Option<Only>) -> bool {
        match only {
            None => true,
            Some(Only::Live) => self.options.live,
            Some(Only::Scripted) => !self.options.live,
        }
    }
}
