//! What happened before a failure.

use rigsim_core::event::{Event, Role};

use super::Run;
use super::outcome::Context;
use crate::scenario::StepAction;

impl Run {
    /// What has happened since the failure before, and what is so now.
    pub(super) fn context(&mut self) -> Context {
        let before: Vec<Event> = self.failures.recent.take().collect();
        let before = before.iter().map(|recent| self.words(recent)).collect();
        let (armed, in_effect) = match &self.failures.last_in_effect {
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
        for (step, state) in self.plan.scenario.steps.iter().zip(&self.steps) {
            let Some(since) = state.since else { continue };
            let said = |what: &str| format!("\"{}\" ({what}), from {since} s on", step.name);
            match &step.action {
                _ if state.effects.is_empty() => {}
                StepAction::Effect(effect) => {
                    let info = effect.info();
                    match info.is_fault() {
                        true => armed.push(said(info.id)),
                        false => others.push(said(&format!("{} {}", info.level.key(), info.id))),
                    }
                }
                StepAction::Host(_) | StepAction::Expect { .. } | StepAction::Nothing => {}
            }
        }
        (armed, others)
    }

    fn words(&self, event: &Event) -> String {
        let devices = &self.plan.scenario.rig.devices;
        let name = devices.get(event.device).map_or("?", |plan| &plan.name);
        let mark = match event.kind.role() {
            Role::Request => "->",
            Role::Reply => "<-",
            _ => " .",
        };
        format!("{:>12} {name} {mark} {}", event.at, event.kind)
    }
}
