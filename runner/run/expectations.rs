//! What is expected of the client: rules, responses, and what steps wait for.

use rigsim_core::SimTime;

use super::agenda::Agenda;
use super::outcome::{Margin, What};
use super::plan::Plan;
use super::responses::ResponseState;
use super::rules::RuleState;
use crate::condition::Situation;
use crate::scenario::{Cause, Scenario};

/// A condition that a step waits for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Expected {
    pub step: usize,
    pub due: SimTime,
}

/// What is expected of the client, and how far that has come.
pub(super) struct Expectations {
    rules: Vec<RuleState>,
    responses: Vec<ResponseState>,
    /// Steps that wait for what they expect.
    pub(super) steps: Vec<Expected>,
}

impl Expectations {
    pub(super) fn new(scenario: &Scenario) -> Self {
        Self {
            rules: vec![RuleState::default(); scenario.rules.len()],
            responses: vec![ResponseState::default(); scenario.responses.len()],
            steps: Vec::new(),
        }
    }

    /// The windows of rules that wait for the step `after` only begin to be counted from now.
    pub(super) fn open_windows(
        &mut self,
        plan: &Plan,
        agenda: &mut Agenda,
        after: Option<usize>,
        now: SimTime,
    ) {
        for (state, rule) in self.rules.iter_mut().zip(&plan.scenario.rules) {
            state.open(rule, plan, agenda, after, now);
        }
    }

    /// Returns whether any of it is to be judged now and then.
    pub(super) fn is_watched(&self, plan: &Plan, now: SimTime) -> bool {
        !self.steps.is_empty()
            || self.awaits_responses(plan)
            || self.rules.iter().any(|rule| rule.is_watched(now))
    }

    /// Judges rules and responses; returns what has failed, in words.
    pub(super) fn judge(
        &mut self,
        plan: &Plan,
        situation: &Situation,
        agenda: &mut Agenda,
        now: SimTime,
    ) -> Vec<What> {
        let mut failed = Vec::new();
        for (state, rule) in self.rules.iter_mut().zip(&plan.scenario.rules) {
            failed.extend(state.judge(rule, situation, agenda, now));
        }
        for (state, response) in self.responses.iter_mut().zip(&plan.scenario.responses) {
            if let Cause::Whenever(cause) = &response.to {
                let caused = situation.holds(cause).unwrap_or(false);
                let before = std::mem::replace(&mut state.caused, caused);
                if caused && !before {
                    state.begin(response, plan, agenda, now);
                }
            }
            let over = state.judge(response, situation, now);
            failed.extend(
                over.into_iter()
                    .map(|pending| response.not_answered(pending, &plan.scenario, situation)),
            );
        }
        failed
    }

    /// Responses and rules that were to be judged and that nothing was asked of, in words.
    pub(super) fn not_judged(&self, plan: &Plan, now: SimTime) -> Vec<String> {
        let scenario = &plan.scenario;
        let rules = scenario.rules.iter().zip(&self.rules);
        let rules = rules.filter(|(rule, _)| plan.is_judged(rule.only, rule.mission));
        let rules = rules.filter_map(|(rule, state)| {
            let why = state.not_judged(rule, now)?;
            let after = rule.after.map(|after| &scenario.steps[after]);
            let may_not = after.is_some_and(|step| step.optional);
            (!may_not).then(|| format!("{}: {why}", rule.words()))
        });
        let responses = scenario.responses.iter().zip(&self.responses);
        let responses = responses.filter(|(response, state)| {
            !state.was_due && !response.optional && plan.is_judged(response.only, response.mission)
        });
        let responses = responses.map(|(response, _)| response.never_came(scenario));
        rules.chain(responses).collect()
    }

    /// The margins of rules and responses that were judged.
    pub(super) fn margins(&self, scenario: &Scenario) -> impl Iterator<Item = Margin> {
        let rules = scenario.rules.iter().zip(&self.rules);
        let rules = rules.filter_map(|(rule, state)| state.slack.margin(rule.words()));
        let responses = scenario.responses.iter().zip(&self.responses);
        let responses =
            responses.filter_map(|(response, state)| state.slack.margin(response.words()));
        rules.chain(responses)
    }

    /// Returns whether any condition is to be judged for a response.
    fn awaits_responses(&self, plan: &Plan) -> bool {
        let mut all = plan.scenario.responses.iter().zip(&self.responses);
        all.any(|(response, state)| {
            let watched = matches!(response.to, Cause::Whenever(_))
                && plan.is_judged(response.only, response.mission);
            watched || !state.pending.is_empty()
        })
    }

    /// A step happens, which may be what responses are to.
    pub(super) fn cause_responses(
        &mut self,
        plan: &Plan,
        agenda: &mut Agenda,
        step: usize,
        now: SimTime,
    ) {
        for (state, response) in self.responses.iter_mut().zip(&plan.scenario.responses) {
            if matches!(response.to, Cause::Step(cause) if cause == step) {
                state.begin(response, plan, agenda, now);
            }
        }
    }
}
