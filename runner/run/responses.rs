//! Responses that have to come each time that something happens.

use std::sync::Arc;

use rigsim_core::SimTime;
use rigsim_settings::show_duration;

use super::Run;
use super::agenda::Item;
use super::judge::with_message;
use super::margin::Slack;
use super::outcome::FailureKind;
use crate::scenario::{Cause, Response};

/// How many responses to one cause are waited for at a time; further ones are not judged.
const MOST_PENDING: usize = 1000;

/// State of a response.
#[derive(Debug, Clone, Default)]
pub(super) struct ResponseState {
    /// Set while its cause holds.
    caused: bool,
    /// It was to come at least once.
    pub(super) was_due: bool,
    pub(super) slack: Slack,
    pending: Vec<Pending>,
}

/// A response that is waited for.
#[derive(Debug, Clone, Copy)]
struct Pending {
    since: SimTime,
    /// It has come, and has to stay.
    came: bool,
}

impl Run {
    /// Returns whether any condition is to be looked at for a response.
    pub(super) fn awaits_responses(&self) -> bool {
        let all = self
            .scenario
            .responses
            .iter()
            .zip(&self.expectations.responses);
        all.into_iter().any(|(response, state)| {
            let watched = matches!(response.to, Cause::Whenever(_))
                && self.is_judged(response.only, response.mission);
            watched || !state.pending.is_empty()
        })
    }

    /// A step happens, which may be what responses are to.
    pub(super) fn cause_responses(&mut self, step: usize, now: SimTime) {
        let scenario = Arc::clone(&self.scenario);
        for (index, response) in scenario.responses.iter().enumerate() {
            if matches!(response.to, Cause::Step(cause) if cause == step) {
                self.await_response(index, response, now);
            }
        }
    }

    fn await_response(&mut self, index: usize, response: &Response, now: SimTime) {
        let pending = self.expectations.responses[index].pending.len();
        if !self.is_judged(response.only, response.mission) || pending >= MOST_PENDING {
            return;
        }
        let (since, came) = (now, false);
        self.expectations.responses[index].was_due = true;
        self.expectations.responses[index]
            .pending
            .push(Pending { since, came });
        for end in [Some(response.within), response.until]
            .into_iter()
            .flatten()
        {
            self.agenda.plan(now + end, Item::Judge);
        }
    }

    pub(super) fn judge_responses(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.scenario);
        for (index, response) in scenario.responses.iter().enumerate() {
            if let Cause::Whenever(cause) = &response.to {
                let caused = self.holds(cause).unwrap_or(false);
                let before =
                    std::mem::replace(&mut self.expectations.responses[index].caused, caused);
                if caused && !before {
                    self.await_response(index, response, now);
                }
            }
            self.judge_response(index, response, now);
        }
    }

    fn judge_response(&mut self, index: usize, response: &Response, now: SimTime) {
        if self.expectations.responses[index].pending.is_empty() {
            return;
        }
        let holds = self.holds(&response.then).unwrap_or(false);
        let mut failed = Vec::new();
        let ResponseState { pending, slack, .. } = &mut self.expectations.responses[index];
        pending.retain_mut(|pending| {
            let over = |time| now >= pending.since + time;
            if !holds {
                let too_late = pending.came || over(response.within);
                if too_late {
                    slack.break_at(now);
                    failed.push(*pending);
                }
                return !too_late;
            }
            if !pending.came {
                slack.narrow_time(now.since(pending.since), response.within, now);
            }
            pending.came = true;
            response.until.is_some_and(|until| !over(until))
        });
        for pending in failed {
            let what = self.not_answered(response, pending);
            self.add_failure(FailureKind::Rule, now, None, what);
        }
    }

    /// Responses and rules that were to be judged and that nothing was asked of, in words.
    pub(super) fn not_judged(&self) -> Vec<String> {
        let now = self.rig.now();
        let rules = self.scenario.rules.iter().zip(&self.expectations.rules);
        let rules = rules.filter(|(rule, _)| self.is_judged(rule.only, rule.mission));
        let rules = rules.filter_map(|(rule, state)| {
            let why = state.not_judged(rule, now)?;
            let after = rule.after.map(|after| &self.scenario.steps[after]);
            let may_not = after.is_some_and(|step| step.optional);
            (!may_not).then(|| format!("{}: {why}", rule.words()))
        });
        let responses = self
            .scenario
            .responses
            .iter()
            .zip(&self.expectations.responses);
        let responses = responses.filter(|(response, state)| {
            !state.was_due && !response.optional && self.is_judged(response.only, response.mission)
        });
        let responses = responses.map(|(response, _)| match &response.to {
            Cause::Whenever(cause) => {
                format!("{}: `{}` never came", response.words(), cause.text)
            }
            Cause::Step(step) => {
                let step = &self.scenario.steps[*step].name;
                format!("{}: \"{step}\" never happened", response.words())
            }
        });
        rules.chain(responses).collect()
    }

    fn not_answered(&self, response: &Response, pending: Pending) -> String {
        let cause = match &response.to {
            Cause::Whenever(cause) => format!("`{}` began", cause.text),
            Cause::Step(step) => format!("\"{}\" happened", self.scenario.steps[*step].name),
        };
        let (then, since) = (&response.then.text, pending.since);
        let demand = match (pending.came, response.until) {
            (true, Some(until)) => {
                format!("`{then}` had to last for {} after", show_duration(until))
            }
            _ => format!(
                "expected `{then}` within {} after",
                show_duration(response.within)
            ),
        };
        let found = self.explain(&response.then);
        let text = format!("{demand} {cause} at {since} s, but {found}");
        with_message(response.message.as_deref(), &text)
    }
}

impl Response {
    pub(super) fn words(&self) -> String {
        format!("response `{}`", self.then.text)
    }
}
