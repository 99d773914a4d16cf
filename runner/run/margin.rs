//! Margins: how near the rules of a run came to being broken.

use std::time::Duration;

use rigsim_core::SimTime;

use super::Run;
use super::outcome::Margin;
use crate::condition::Condition;
use crate::scenario::{Rule, StepAction};

/// Shortest time between two measurements of a distance; far from the limit it is ten times as long.
const EVERY: Duration = Duration::from_millis(20);
/// Smallest margin of what was kept, and the step of all margins.
const SMALLEST: f64 = 1e-4;

/// The smallest slack so far.
#[derive(Debug, Clone, Copy)]
pub(super) struct Slack {
    share: f64,
    at: SimTime,
    /// The distance is not measured before.
    next: SimTime,
}

impl Default for Slack {
    fn default() -> Self {
        Self {
            share: f64::INFINITY,
            at: SimTime::ZERO,
            next: SimTime::ZERO,
        }
    }
}

impl Slack {
    pub(super) fn break_at(&mut self, now: SimTime) {
        (self.share, self.at) = (0.0, now);
    }

    /// What was kept had this slack; times are measured without rounding.
    pub(super) fn narrow(&mut self, share: f64, now: SimTime) {
        let share = ((share / SMALLEST).round() * SMALLEST).max(SMALLEST);
        if share < self.share {
            (self.share, self.at) = (share, now);
        }
    }

    /// So much of a time limit was used.
    pub(super) fn narrow_time(&mut self, used: Duration, limit: Duration, now: SimTime) {
        if !limit.is_zero() {
            self.narrow(1.0 - used.div_duration_f64(limit), now);
        }
    }

    fn margin(self, what: String) -> Option<Margin> {
        let (margin, at) = (self.share, self.at);
        margin.is_finite().then_some(Margin { what, margin, at })
    }
}

impl Run {
    /// Measures how far a rule that is kept is from being broken. Before the time of a `longer_than`
    /// begins, the whole of it is left.
    pub(super) fn measure(&mut self, index: usize, rule: &Rule, now: SimTime) {
        if now < self.expectations.rules[index].slack.next {
            return;
        }
        let distance = self.distance(&rule.that, rule.must_hold);
        let time_left = f64::from(u8::from(!rule.longer_than.is_zero()));
        let slack = &mut self.expectations.rules[index].slack;
        slack.narrow(distance + time_left, now);
        // On a grid, so that one instant more or less shifts nothing.
        let pause = EVERY.mul_f64(1.0 + (9.0 * distance.min(1.0)).floor());
        slack.next = (now + pause - EVERY).next_multiple(EVERY);
    }

    /// Distance of a condition from becoming false, or true if it must not hold.
    pub(super) fn distance(&self, condition: &Condition, must_hold: bool) -> f64 {
        let margin = condition.margin(self.situation());
        if must_hold { margin } else { -margin }.max(0.0)
    }

    /// The margins of everything that was judged.
    pub(super) fn margins(&self) -> Vec<Margin> {
        let rules = self.scenario.rules.iter().zip(&self.expectations.rules);
        let rules = rules.filter_map(|(rule, state)| state.slack.margin(rule.words()));
        let responses = self
            .scenario
            .responses
            .iter()
            .zip(&self.expectations.responses);
        let responses =
            responses.filter_map(|(response, state)| state.slack.margin(response.words()));
        let steps = self.scenario.steps.iter().zip(&self.steps);
        let expected = steps.filter_map(|(step, state)| match &step.action {
            StepAction::Expect { that, .. } => state
                .slack
                .margin(format!("\"{}\": expected `{}`", step.name, that.text)),
            _ => None,
        });
        rules.chain(responses).chain(expected).collect()
    }
}
