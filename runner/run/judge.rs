//! Conditions as the run goes on.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::Event;

use super::Run;
use super::margin::distance;
use super::outcome::{FailureKind, What};
use crate::condition::{Condition, ExpressionError};
use crate::scenario::{StepAction, Trigger};

/// Time after a fault of the line in which its traces may still come.
pub(super) const EXCUSED_AFTER: Duration = Duration::from_millis(200);

impl Run {
    /// Returns whether any condition is to be judged now and then.
    pub(super) fn is_watched(&self) -> bool {
        self.steps.iter().any(|state| state.watching)
            || self.steps_with_end().next().is_some()
            || self
                .expectations
                .is_watched(&self.plan, self.situation.rig.now())
    }

    /// Evaluates every condition that matters now.
    pub(super) fn judge(&mut self, now: SimTime) {
        self.judge_steps(now);
        self.judge_ends(now);
        self.judge_expected(now);
        let over = self.script.due(now);
        self.answers_over(over, now);
        let (plan, situation, agenda) = (&self.plan, &self.situation, &mut self.agenda);
        let failed = self.expectations.judge(plan, situation, agenda, now);
        for what in failed {
            self.add_failure(FailureKind::Rule, now, None, what);
        }
    }

    /// The steps that end as soon as a condition holds, and go on.
    fn steps_with_end(&self) -> impl Iterator<Item = usize> {
        let steps = self.plan.scenario.steps.iter().zip(&self.steps).enumerate();
        steps
            .filter(|(_, (step, state))| step.until.is_some() && state.may_end())
            .map(|(index, _)| index)
    }

    fn judge_ends(&mut self, now: SimTime) {
        for index in self.steps_with_end().collect::<Vec<_>>() {
            let scenario = std::sync::Arc::clone(&self.plan.scenario);
            let Some(until) = &scenario.steps[index].until else {
                continue;
            };
            match self.holds(until) {
                Ok(true) => self.end_step(index, now),
                Ok(false) => {}
                Err(why) => {
                    self.end_step(index, now);
                    self.fail_step(index, now, why.to_string());
                }
            }
        }
    }

    fn judge_steps(&mut self, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.plan.scenario);
        for (index, step) in scenario.steps.iter().enumerate() {
            let Trigger::When(condition) = &step.trigger else {
                continue;
            };
            if !self.steps[index].watching {
                continue;
            }
            match self.holds(condition) {
                Ok(true) => self.begin(index, now),
                Ok(false) => {
                    self.steps[index].update_nearness(condition, &self.situation, now);
                }
                Err(why) => {
                    self.steps[index].watching = false;
                    self.fail_step(index, now, why.to_string());
                }
            }
        }
    }

    fn judge_expected(&mut self, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.plan.scenario);
        let waiting = std::mem::take(&mut self.expectations.steps);
        for expected in waiting {
            let StepAction::Expect {
                that,
                within,
                message,
            } = &scenario.steps[expected.step].action
            else {
                continue;
            };
            let why = match self.holds(that) {
                Ok(true) => {
                    let distance = distance(that, true, &self.situation);
                    let slack = &mut self.steps[expected.step].slack;
                    match *within {
                        Some(within) => {
                            let left = expected.due.since(now);
                            slack.narrow_time(within.saturating_sub(left), within, now);
                        }
                        None => slack.narrow(distance, now),
                    }
                    None
                }
                Ok(false) if expected.due > now => {
                    self.steps[expected.step].update_nearness(that, &self.situation, now);
                    self.expectations.steps.push(expected);
                    continue;
                }
                Ok(false) => Some(self.not_held(expected.step, that, message.as_deref())),
                Err(why) => Some(why.to_string().into()),
            };
            if let Some(why) = why {
                self.steps[expected.step].slack.break_at(now);
                self.fail_step(expected.step, now, why);
            }
            self.time_over(expected.step, now);
        }
    }

    /// Returns whether a condition holds now.
    ///
    /// # Errors
    /// When it has no value, which only a number that is not one (as 0/0) can bring about.
    pub fn holds(&self, condition: &Condition) -> Result<bool, ExpressionError> {
        self.situation.holds(condition)
    }

    /// The values of the names in a condition now.
    #[must_use]
    pub fn explain(&self, condition: &Condition) -> String {
        condition.explain(&self.situation)
    }

    pub(super) fn not_held(
        &self,
        step: usize,
        condition: &Condition,
        message: Option<&str>,
    ) -> What {
        let (found, nearest) = (self.explain(condition), self.steps[step].nearest());
        let rule = format!("expected `{}`", condition.text);
        What::of(message, &rule, format!(", but {found}{nearest}"))
    }

    /// Returns whether what happened is not the client's fault.
    pub(super) fn is_excused(&mut self, event: &Event) -> bool {
        let attribution = event.kind.code().attribution;
        let disturbed = self
            .excuses
            .disturbed_until
            .get(event.device)
            .is_some_and(|until| event.at <= *until + attribution.looks_back());
        disturbed && attribution.spares_disturbed() || self.excuses.excuses(event)
    }
}
