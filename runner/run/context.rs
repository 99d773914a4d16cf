//! What happened before a failure.

use rigsim_core::event::{Event, Role};

use super::Failures;
use super::outcome::Context;
use super::steps::StepState;
use crate::scenario::{Scenario, StepAction};

impl Failures {
    /// What has happened since the failure before, and what is so now.
    pub(super) fn context(&mut self, scenario: &Scenario, steps: &[StepState]) -> Context {
        let recent = self.recent.take();
        let before = recent.map(|event| words(&event, scenario)).collect();
        let last = self.last_in_effect.clone();
        let (armed, in_effect) = last.unwrap_or_else(|| in_effect(scenario, steps));
        Context {
            before,
            armed,
            in_effect,
        }
    }
}

/// The faults that are armed, and what else steps have changed and not undone.
pub(super) fn in_effect(scenario: &Scenario, steps: &[StepState]) -> (Vec<String>, Vec<String>) {
    let mut armed = Vec::new();
    let mut others = Vec::new();
    for (step, state) in scenario.steps.iter().zip(steps) {
        let (Some(since), StepAction::Effect(effect)) = (state.since, &step.action) else {
            continue;
        };
        if state.effects.is_empty() {
            continue;
        }
        let info = effect.info();
        let (list, what) = match info.is_fault() {
            true => (&mut armed, info.id.to_owned()),
            false => (&mut others, format!("{} {}", info.level.key(), info.id)),
        };
        list.push(format!("\"{}\" ({what}), from {since} s on", step.name));
    }
    (armed, others)
}

fn words(event: &Event, scenario: &Scenario) -> String {
    let devices = &scenario.rig.devices;
    let name = devices.get(event.device).map_or("?", |plan| &plan.name);
    let mark = match event.kind.code().role {
        Role::Request => "->",
        Role::Reply => "<-",
        _ => " .",
    };
    format!("{:>12} {name} {mark} {}", event.at, event.kind)
}
