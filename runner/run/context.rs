//! What happened lastly, for whoever reads of a failure.

use sim_core::SimTime;
use sim_core::event::{Event, Role};

use super::outcome::Context;
use super::{MOST_RECENT, Run};
use crate::scenario::StepAction;

/// Something that happened.
#[derive(Debug)]
pub(super) enum Recent {
    Event(Event),
    /// A step changed something, which is no event of a device.
    Deed {
        at: SimTime,
        what: String,
    },
}

impl Run {
    /// Takes note of something for the next failure.
    pub(super) fn remember_recent(&mut self, recent: Recent) {
        if self.recent.len() >= MOST_RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(recent);
    }

    /// A step does something to a vehicle or its world, or that is over.
    pub(super) fn note_deed(&mut self, index: usize, is_over: bool) {
        let at = self.rig.now();
        let step = &self.scenario.steps[index];
        let what = match (&step.deed, is_over) {
            (None, _) => return,
            (Some(deed), false) => format!("step \"{}\": {deed}", step.name),
            (Some(deed), true) => format!("step \"{}\": {deed}, undone", step.name),
        };
        self.remember_recent(Recent::Deed { at, what });
    }

    /// What has happened since the failure before, and what is so now.
    pub(super) fn context(&mut self) -> Context {
        let before = std::mem::take(&mut self.recent);
        let before = before.iter().map(|recent| self.words(recent)).collect();
        let (armed, in_effect) = match &self.last_in_effect {
            Some(last) => last.clone(),
            None => self.in_effect(),
        };
        Context {
            before,
            armed,
            in_effect,
        }
    }

    /// The faults that are armed, and what else steps have changed and not undone.
    pub(super) fn in_effect(&self) -> (Vec<String>, Vec<String>) {
        let mut armed = Vec::new();
        let mut others = Vec::new();
        for (step, state) in self.scenario.steps.iter().zip(&self.steps) {
            let Some(since) = state.since else { continue };
            let said = |what: &str| format!("\"{}\" ({what}), from {since} s on", step.name);
            match (&step.action, &step.deed) {
                (StepAction::Fault(fault), _) if state.has_faults() => armed.push(said(fault.id())),
                (_, Some(deed)) if state.has_effects() => others.push(said(deed)),
                _ => {}
            }
        }
        (armed, others)
    }

    fn words(&self, recent: &Recent) -> String {
        let event = match recent {
            Recent::Event(event) => event,
            Recent::Deed { at, what } => return format!("{at:>12} == {what}"),
        };
        let devices = &self.scenario.rig.devices;
        let name = devices.get(event.device).map_or("?", |plan| &plan.name);
        let mark = match event.kind.role() {
            Role::Request => "->",
            Role::Reply => "<-",
            _ => " .",
        };
        format!("{:>12} {name} {mark} {}", event.at, event.kind)
    }
}
