//! Conditions as the run goes on.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::Event;
use rigsim_settings::show_duration;

use super::Run;
use super::agenda::Item;
use super::margin::Slack;
use super::outcome::FailureKind;
use crate::condition::{Condition, ExpressionError, Situation};
use crate::scenario::{Rule, StepAction, Trigger};

/// How often it is value at how near something has come.
const NEARNESS_EVERY: Duration = Duration::from_millis(20);
/// Time after a fault of the line in which its traces may still come.
pub(super) const EXCUSED_AFTER: Duration = Duration::from_millis(200);

/// A condition that a step waits for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    pub step: usize,
    pub due: SimTime,
}

/// Nearest that something that is waited for has come to holding.
#[derive(Debug)]
pub(super) struct Nearest {
    by: f64,
    at: SimTime,
    value: SimTime,
    found: String,
}

/// Progress of a condition over time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RuleState {
    from: Option<SimTime>,
    until: Option<SimTime>,
    /// Since when it has been broken.
    broken: Option<SimTime>,
    /// It is value at no more: it was violated, or does not count.
    closed: bool,
    /// It has been value at.
    judged: bool,
    pub(super) slack: Slack,
}

impl Run {
    /// The window of a rule begins to be counted from now, if it waits for the step `after` only.
    pub(super) fn open_window(&mut self, index: usize, after: Option<usize>, now: SimTime) {
        let rule = &self.scenario.rules[index];
        let counts = self.is_judged(rule.only, rule.mission);
        let state = &mut self.expectations.rules[index];
        if rule.after != after || state.from.is_some() {
            return;
        }
        let from = now + rule.from;
        state.from = Some(from);
        state.closed = !counts;
        self.agenda.plan(from, Item::Judge);
        if let Some(until) = rule.until {
            state.until = Some(now + until);
            self.agenda.plan(now + until, Item::Judge);
        }
    }

    /// Returns whether any condition is to be value at now and then.
    pub(super) fn is_watched(&self) -> bool {
        let now = self.rig.now();
        !self.expectations.steps.is_empty()
            || self.steps.iter().any(|state| state.watching)
            || self.awaits_responses()
            || self.steps_with_end().next().is_some()
            || self.expectations.rules.iter().any(|rule| {
                let goes_on = rule.until.is_none_or(|until| now < until);
                !rule.closed && rule.from.is_some_and(|from| from <= now) && goes_on
            })
    }

    /// Looks at every condition that matters now.
    pub(super) fn judge(&mut self, now: SimTime) {
        self.judge_steps(now);
        self.judge_ends(now);
        self.judge_expected(now);
        self.host_due(now);
        self.judge_rules(now);
        self.judge_responses(now);
    }

    /// The steps that end as soon as a condition holds, and go on.
    fn steps_with_end(&self) -> impl Iterator<Item = usize> {
        let steps = self.scenario.steps.iter().zip(&self.steps).enumerate();
        steps
            .filter(|(_, (step, state))| step.until.is_some() && state.may_end())
            .map(|(index, _)| index)
    }

    fn judge_ends(&mut self, now: SimTime) {
        for index in self.steps_with_end().collect::<Vec<_>>() {
            let scenario = std::sync::Arc::clone(&self.scenario);
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

    /// Takes note of how near what a step waits for has come.
    fn update_nearness(&mut self, index: usize, condition: &Condition, now: SimTime) {
        if !condition.is_gradual() {
            return;
        }
        // Often enough to tell, and seldom enough to cost nothing.
        let before = self.steps[index].nearest.as_ref();
        if before.is_some_and(|before| now < before.value + NEARNESS_EVERY) {
            return;
        }
        let by = condition.nearness(self.situation());
        if before.is_none_or(|before| before.by < by) {
            let found = self.explain(condition);
            self.steps[index].nearest = Some(Nearest {
                by,
                at: now,
                value: now,
                found,
            });
        } else if let Some(nearest) = &mut self.steps[index].nearest {
            nearest.value = now;
        }
    }

    /// The nearest that what a step waits for has come, in words.
    pub(super) fn nearest(&self, index: usize) -> String {
        let nearest = self.steps[index].nearest.as_ref();
        nearest.map_or_else(String::new, |nearest| {
            format!("; it came nearest at {} s: {}", nearest.at, nearest.found)
        })
    }

    fn judge_steps(&mut self, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.scenario);
        for (index, step) in scenario.steps.iter().enumerate() {
            let Trigger::When(condition) = &step.trigger else {
                continue;
            };
            if !self.steps[index].watching {
                continue;
            }
            match self.holds(condition) {
                Ok(true) => self.begin(index, now),
                Ok(false) => self.update_nearness(index, condition, now),
                Err(why) => {
                    self.steps[index].watching = false;
                    self.fail_step(index, now, why.to_string());
                }
            }
        }
    }

    fn judge_expected(&mut self, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.scenario);
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
                    let distance = self.distance(that, true);
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
                    self.update_nearness(expected.step, that, now);
                    self.expectations.steps.push(expected);
                    continue;
                }
                Ok(false) => Some(self.not_held(expected.step, that, message.as_deref())),
                Err(why) => Some(why.to_string()),
            };
            if let Some(why) = why {
                self.steps[expected.step].slack.break_at(now);
                self.fail_step(expected.step, now, why);
            }
            self.time_over(expected.step, now);
        }
    }

    fn judge_rules(&mut self, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.scenario);
        for (index, rule) in scenario.rules.iter().enumerate() {
            let state = self.expectations.rules[index];
            let begun = state.from.is_some_and(|from| from <= now);
            if state.closed || !begun || state.until.is_some_and(|until| until < now) {
                continue;
            }
            let value = self.evaluate(&rule.that);
            self.expectations.rules[index].judged |= !matches!(value, Ok(None));
            let what = match value {
                Ok(None) => continue,
                Ok(Some(holds)) if holds == rule.must_hold => {
                    let state = &mut self.expectations.rules[index];
                    if let Some(since) = state.broken.take() {
                        let used = now.since(since);
                        state.slack.narrow_time(used, rule.longer_than, now);
                    }
                    self.measure(index, rule, now);
                    continue;
                }
                Ok(Some(_)) => {
                    let state = &mut self.expectations.rules[index];
                    let since = *state.broken.get_or_insert(now);
                    if now < since + rule.longer_than {
                        let used = now.since(since);
                        state.slack.narrow_time(used, rule.longer_than, now);
                        self.agenda.plan(since + rule.longer_than, Item::Judge);
                        continue;
                    }
                    let found = self.explain(&rule.that);
                    let text = format!("{}, but {found}", rule.words());
                    with_message(rule.message.as_deref(), &text)
                }
                Err(why) => why.to_string(),
            };
            self.expectations.rules[index].closed = true;
            self.expectations.rules[index].slack.break_at(now);
            self.add_failure(FailureKind::Rule, now, None, what);
        }
    }

    /// Returns whether a condition holds, unless it speaks of what no step has remembered yet.
    pub(super) fn evaluate(&self, condition: &Condition) -> Result<Option<bool>, ExpressionError> {
        let situation = self.situation();
        if !condition.is_known(situation) {
            return Ok(None);
        }
        condition.holds(situation).map(Some)
    }

    pub(crate) fn situation(&self) -> Situation<'_> {
        Situation {
            rig: &self.rig,
            counters: &self.counters,
            saved: &self.saved,
            published: &self.published.values,
        }
    }

    /// Returns whether a condition holds now.
    ///
    /// # Errors
    /// When it has no value, which only a number that is not one (as 0/0) can bring about.
    pub fn holds(&self, condition: &Condition) -> Result<bool, ExpressionError> {
        Ok(self.evaluate(condition)?.unwrap_or(false))
    }

    /// The values of the names in a condition now.
    #[must_use]
    pub fn explain(&self, condition: &Condition) -> String {
        condition.explain(self.situation())
    }

    pub(super) fn not_held(
        &self,
        step: usize,
        condition: &Condition,
        message: Option<&str>,
    ) -> String {
        let (found, nearest) = (self.explain(condition), self.nearest(step));
        let text = format!("expected `{}`, but {found}{nearest}", condition.text);
        with_message(message, &text)
    }

    /// Returns whether what happened is not the client's fault.
    pub(super) fn is_excused(&mut self, event: &Event) -> bool {
        let attribution = event.kind.code().attribution();
        let disturbed = self
            .excuses
            .disturbed_until
            .get(event.device)
            .is_some_and(|until| event.at <= *until + attribution.looks_back());
        disturbed && attribution.spares_disturbed() || self.excuses.excuses(event)
    }
}

impl RuleState {
    /// Why it was never value at until now, if it was not.
    pub(super) fn not_judged(self, rule: &Rule, now: SimTime) -> Option<&'static str> {
        let waits = rule.after.is_some() && self.from.is_none();
        let early = self.from.is_some_and(|from| from > now);
        match self.judged {
            true => None,
            false if waits => Some("what it comes after was never done"),
            false if early => Some("the run ended before"),
            false => Some("one of its values was never remembered or published"),
        }
    }
}

impl Rule {
    pub(super) fn words(&self) -> String {
        let word = if self.must_hold { "always" } else { "never" };
        let longer = match self.longer_than {
            Duration::ZERO => String::new(),
            time => format!(" for longer than {}", show_duration(time)),
        };
        format!("{word} `{}`{longer}", self.that.text)
    }
}

pub(super) fn with_message(message: Option<&str>, text: &str) -> String {
    message.map_or_else(|| text.to_owned(), |message| format!("{message}: {text}"))
}
