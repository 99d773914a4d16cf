//! Requests of the program that drives a run, beside the steps of its file.

use std::sync::Arc;

use rigsim_settings::{SimTime, Source};

use super::agenda::Item;
use super::record::Record;
use super::steps::StepState;
use super::{Failure, Run, RunError};
use crate::condition::{Condition, ExpressionError, Reading, Scope};
use crate::error::FileErrors;
use crate::scenario::{MOST_STEPS, StepAction, Trigger, read_step};

/// Name of steps that come from no file, as errors call it.
const FILE: &str = "step";

/// Progress of a step.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct StepReport<'a> {
    /// Its name.
    pub name: &'a str,
    /// Name of the device that it is about.
    pub device: &'a str,
    /// Key under which a file says what it does: `fault`, `operator`, `world`, `host`, `clear` or
    /// `expect`; empty if it does nothing.
    pub key: &'static str,
    /// The kind of its fault or action, its condition, or the step that it clears.
    pub what: &'a str,
    /// Set if it was added, and is none of the file's.
    pub added: bool,
    /// Time at which it began.
    pub begun: Option<SimTime>,
    /// Time at which it was done, with all its repetitions and what they last.
    pub done: Option<SimTime>,
    /// First thing that went wrong with it.
    pub failure: Option<&'a str>,
    /// Set if there is anything left to be ended or undone.
    pub lasting: bool,
    /// Number of times that its faults have hit something.
    pub hits: u64,
}

/// Reason for which a step cannot be added.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum StepError {
    /// The text is wrong.
    #[error(transparent)]
    Text(#[from] FileErrors),
    /// The run has come to its end.
    #[error("the run is over")]
    Over,
    /// There are too many.
    #[error("there are {MOST_STEPS} steps that are not over; clear some")]
    TooMany,
    /// The run cannot go on.
    #[error(transparent)]
    Run(#[from] RunError),
}

impl Run {
    /// The value of an expression over the names of `sim names` now, as `r150.truth.speed_mps`.
    ///
    /// # Errors
    /// When the expression makes no sense, or has no value.
    pub fn value(&self, expression: &str) -> Result<Reading, ExpressionError> {
        let (read, _) = self.in_scope(|scope| Condition::parse_typed(expression, scope))?;
        read.value(&self.situation)
    }

    /// A condition as scenario files have them, to be asked for often with [`Run::holds`].
    ///
    /// # Errors
    /// When the condition makes no sense.
    pub fn condition(&self, text: &str) -> Result<Condition, ExpressionError> {
        self.in_scope(|scope| Condition::parse(text, scope))
    }

    /// Reads something in which names stand, as they are in the scenario.
    pub(crate) fn in_scope<T>(&self, read: impl FnOnce(&Scope<'_>) -> T) -> T {
        let scope = Scope {
            devices: &self.plan.scenario.rig.kinds(),
            usual: self.plan.scenario.usual_device(),
            saved: &self.plan.scenario.saved,
            parameters: &self.plan.scenario.parameters,
        };
        read(&scope)
    }

    /// Adds a step, written as a `[[step]]` of scenario files: `fault = { kind = "cable-pulled" }`.
    /// Its `at` is counted from now, and if it does not say when, it begins before this returns, at
    /// its own instant. Gives its index, which is another's that is over when there are too
    /// many.
    ///
    /// A run does not fail because such a step never begins, or because its fault hits nothing.
    ///
    /// # Errors
    /// Says in words what is wrong with the text; or the run is over or cannot go on.
    pub fn add_step(&mut self, text: &str) -> Result<usize, StepError> {
        let source = Source { file: FILE, text };
        let (mut step, saved) = read_step(source, &self.plan.scenario)?;
        if saved.len() > MOST_STEPS {
            return Err(StepError::TooMany);
        }
        let at = self
            .go_before(self.situation.rig.now())?
            .ok_or(StepError::Over)?;
        step.optional = true;
        let index = self.place_for_step().ok_or(StepError::TooMany)?;
        self.record(|| Record::Add {
            t: at.as_nanos(),
            step: step.name.clone(),
            text: text.to_owned(),
        });
        let mut state = StepState::new(&step, self.plan.options.seed);
        state.added = true;
        let begin = match step.trigger {
            Trigger::At(times) => Some(at + state.draw(times)),
            Trigger::After(other) if self.steps[other].done.is_some() => {
                Some(at + state.draw(step.delay))
            }
            Trigger::When(_) | Trigger::After(_) => None,
        };
        let scenario = Arc::make_mut(&mut self.plan.scenario);
        scenario.saved = saved;
        if index < scenario.steps.len() {
            for action in std::mem::take(&mut self.steps[index].effects) {
                self.situation.rig.keep(action);
            }
            scenario.steps[index] = step;
            self.steps[index] = state;
        } else {
            scenario.steps.push(step);
            self.steps.push(state);
        }
        if let Some(begin) = begin {
            self.agenda.plan(begin, Item::Occur(index));
        }
        self.agenda.plan(at, Item::Judge);
        self.instant(at, |_| {})?;
        Ok(index)
    }

    /// Where a further step can stand: behind all others, or in the place of the one that was over
    /// first of those that were added and that no client waits for.
    fn place_for_step(&self) -> Option<usize> {
        if self.steps.len() < MOST_STEPS {
            return Some(self.steps.len());
        }
        let waited_for = |index: usize| {
            self.plan
                .scenario
                .steps
                .iter()
                .any(|step| match step.trigger {
                    Trigger::After(other) => other == index,
                    Trigger::At(_) | Trigger::When(_) => false,
                })
        };
        let steps = self.plan.scenario.steps.iter().zip(&self.steps).enumerate();
        let over = steps.filter_map(|(index, (step, state))| {
            // One that could still be undone is forgotten before a further one is refused.
            let breaks = step.fault().is_some() && !state.effects.is_empty();
            let done = state.done.filter(|_| state.added && !breaks)?;
            Some((done, index)).filter(|_| !waited_for(index))
        });
        over.min().map(|(_, index)| index)
    }

    /// Ends a step before its time: what it has brought is mended, and what it would still do is
    /// not done. Without effect on one that is over.
    ///
    /// # Errors
    /// When the run cannot go on.
    pub fn clear_step(&mut self, index: usize) -> Result<(), RunError> {
        if self.steps.get(index).is_none_or(StepState::is_over) {
            return Ok(());
        }
        let Some(at) = self.go_before(self.situation.rig.now())? else {
            return Ok(());
        };
        let step = self.plan.scenario.steps[index].name.clone();
        self.record(|| Record::Clear {
            t: at.as_nanos(),
            step,
        });
        self.agenda.plan(at, Item::Clear(index));
        self.instant(at, |_| {})
    }

    /// Writes down that time passes otherwise from now on, which changes nothing in the run.
    pub fn record_pace(&mut self, change: &str) {
        let t = self.situation.rig.now().as_nanos();
        if self.outcome.is_none() {
            self.record(|| Record::Pace {
                t,
                change: change.to_owned(),
            });
        }
    }

    /// Index of the step of this name.
    #[must_use]
    pub fn step_named(&self, name: &str) -> Option<usize> {
        let mut steps = self.plan.scenario.steps.iter();
        steps.position(|step| step.name == name)
    }

    /// Reports of all steps that are played in this run, in their order.
    pub fn steps(&self) -> impl Iterator<Item = StepReport<'_>> {
        let steps = self.plan.scenario.steps.iter().enumerate();
        let played = steps.filter(|(_, step)| self.plan.is_played(step));
        played.filter_map(|(index, _)| self.step_report(index))
    }

    /// Failures so far, in the order in which they were found; once it is over, those of its outcome.
    #[must_use]
    pub fn failures(&self) -> &[Failure] {
        let outcome = self.outcome.as_ref();
        outcome.map_or(&self.failures.list, |outcome| &outcome.failures)
    }

    /// Report of a step.
    #[must_use]
    pub fn step_report(&self, index: usize) -> Option<StepReport<'_>> {
        let (step, state) = (self.plan.scenario.steps.get(index)?, self.steps.get(index)?);
        let (key, what) = match &step.action {
            StepAction::Effect(effect) => (effect.info().level.key(), effect.info().id),
            StepAction::Expect { that, .. } => ("expect", that.text.as_str()),
            StepAction::Host(_) => ("host", ""),
            StepAction::Nothing => ("", ""),
        };
        Some(StepReport {
            name: &step.name,
            device: &self.plan.scenario.rig.devices[step.device].name,
            key,
            what,
            added: state.added,
            begun: state.begun,
            done: state.done,
            failure: state.failure.as_deref(),
            lasting: !state.is_over(),
            hits: state.hits_so_far(&self.situation.rig),
        })
    }
}
