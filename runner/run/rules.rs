//! Rules: conditions that hold always or never.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_settings::show_duration;

use super::agenda::{Agenda, Item};
use super::margin::Slack;
use super::outcome::What;
use super::plan::Plan;
use crate::condition::Situation;
use crate::scenario::Rule;

/// Progress of a condition over time.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct RuleState {
    from: Option<SimTime>,
    until: Option<SimTime>,
    /// Since when it has been broken.
    broken: Option<SimTime>,
    /// It is judged no more: it was violated, or does not count.
    closed: bool,
    /// It has been judged.
    judged: bool,
    pub(super) slack: Slack,
}

impl RuleState {
    /// Its window begins to be counted from now, if it waits for the step `after` only.
    pub(super) fn open(
        &mut self,
        rule: &Rule,
        plan: &Plan,
        agenda: &mut Agenda,
        after: Option<usize>,
        now: SimTime,
    ) {
        if rule.after != after || self.from.is_some() {
            return;
        }
        let from = now + rule.from;
        self.from = Some(from);
        self.closed = !plan.is_judged(rule.only, rule.mission);
        agenda.plan(from, Item::Judge);
        if let Some(until) = rule.until {
            self.until = Some(now + until);
            agenda.plan(now + until, Item::Judge);
        }
    }

    /// Returns whether it is to be judged now and then.
    pub(super) fn is_watched(&self, now: SimTime) -> bool {
        let goes_on = self.until.is_none_or(|until| now < until);
        !self.closed && self.from.is_some_and(|from| from <= now) && goes_on
    }

    /// Judges it now; returns how it is broken.
    pub(super) fn judge(
        &mut self,
        rule: &Rule,
        situation: &Situation,
        agenda: &mut Agenda,
        now: SimTime,
    ) -> Option<What> {
        let begun = self.from.is_some_and(|from| from <= now);
        if self.closed || !begun || self.until.is_some_and(|until| until < now) {
            return None;
        }
        let value = situation.evaluate(&rule.that);
        self.judged |= !matches!(value, Ok(None));
        let what = match value {
            Ok(None) => return None,
            Ok(Some(holds)) if holds == rule.must_hold => {
                if let Some(since) = self.broken.take() {
                    let used = now.since(since);
                    self.slack.narrow_time(used, rule.longer_than, now);
                }
                self.slack.measure(rule, situation, now);
                return None;
            }
            Ok(Some(_)) => {
                let since = *self.broken.get_or_insert(now);
                if now < since + rule.longer_than {
                    let used = now.since(since);
                    self.slack.narrow_time(used, rule.longer_than, now);
                    agenda.plan(since + rule.longer_than, Item::Judge);
                    return None;
                }
                let found = rule.that.explain(situation);
                let found = format!(", but {found}");
                What::of(rule.message.as_deref(), &rule.words(), found)
            }
            Err(why) => why.to_string().into(),
        };
        self.closed = true;
        self.slack.break_at(now);
        Some(what)
    }

    /// Why it was never judged until now, if it was not.
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
