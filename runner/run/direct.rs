//! What whoever drives a run asks it, and has happen beside the steps of its file.

use std::sync::Arc;

use sim_settings::Source;

use super::agenda::Item;
use super::steps::StepState;
use super::{Run, RunError};
use crate::condition::{Condition, Scope, Value};
use crate::rig_file::RigFileError;
use crate::scenario::Trigger;

/// Name of steps that come from no file, as errors call it.
const FILE: &str = "step";

/// Why a step cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum StepError {
    /// The text is wrong.
    #[error(transparent)]
    Text(#[from] RigFileError),
    /// The run cannot go on.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl Run {
    /// The value of an expression over the names of `sim names` now, as `r150.truth.speed_mps`.
    ///
    /// # Errors
    /// In words, when the expression makes no sense.
    pub fn value(&self, expression: &str) -> Result<Value, String> {
        self.parse(expression, Condition::parse_value)?
            .value(self.situation())
    }

    /// A condition as scenario files have them, to be asked for often with [`Run::holds`].
    ///
    /// # Errors
    /// In words, when the condition makes no sense.
    pub fn condition(&self, text: &str) -> Result<Condition, String> {
        self.parse(text, Condition::parse)
    }

    fn parse(
        &self,
        text: &str,
        parse: fn(&str, &Scope<'_>) -> Result<Condition, String>,
    ) -> Result<Condition, String> {
        let devices = &self.scenario.rig.devices;
        let devices: Vec<_> = devices
            .iter()
            .map(|d| (d.name.as_str(), d.device))
            .collect();
        let scope = Scope {
            devices: &devices,
            usual: self.scenario.usual_device(),
            saved: &self.scenario.saved,
            parameters: &self.scenario.parameters,
        };
        parse(text, &scope)
    }

    /// Adds a step, written as a `[[step]]` of scenario files: `fault = { kind = "cable-pulled" }`. Its
    /// `at` is counted from now, and if it does not say when, it begins before this returns. Gives its
    /// index.
    ///
    /// A run does not fail because such a step never begins, or because its fault hits nothing. Traces
    /// do not have them, so a trace with one cannot be played again.
    ///
    /// # Errors
    /// Says in words what is wrong with the text; or the run cannot go on.
    pub fn add_step(&mut self, text: &str) -> Result<usize, StepError> {
        let (now, index) = (self.rig.now(), self.steps.len());
        let source = Source { file: FILE, text };
        let step = Arc::make_mut(&mut self.scenario).add_step(source)?;
        step.may_not_trigger = true;
        let mut state = StepState::new(step, self.options.seed);
        if let Trigger::At(times) = &step.trigger {
            let at = now + state.draw(*times);
            self.agenda.plan(at, Item::Occur(index));
        }
        self.steps.push(state);
        self.settle(now, true)?;
        Ok(index)
    }

    /// Mends the faults that a step has brought.
    ///
    /// # Errors
    /// When the run cannot go on.
    pub fn clear_step(&mut self, step: usize) -> Result<(), RunError> {
        if step < self.steps.len() {
            for number in self.active_faults(step) {
                self.clear_fault(step, number);
            }
        }
        self.advance(self.rig.now())
    }

    /// How often the faults of a step have hit something.
    #[must_use]
    pub fn step_hits(&self, step: usize) -> u64 {
        let state = self.steps.get(step);
        state.map_or(0, |state| state.hits_so_far(&self.rig))
    }
}
