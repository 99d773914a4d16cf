//! Responses that have to come each time that something happens.

use rigsim_core::SimTime;
use rigsim_settings::show_duration;

use super::agenda::{Agenda, Item};
use super::margin::Slack;
use super::outcome::What;
use super::plan::Plan;
use crate::condition::Situation;
use crate::scenario::{Cause, Response, Scenario};

/// How many responses to one cause are waited for at a time; further ones are not judged.
const MOST_PENDING: usize = 1000;

/// State of a response.
#[derive(Debug, Clone, Default)]
pub(super) struct ResponseState {
    /// Set while its cause holds.
    pub(super) caused: bool,
    /// It was to come at least once.
    pub(super) was_due: bool,
    pub(super) slack: Slack,
    pub(super) pending: Vec<Pending>,
}

/// A response that is waited for.
#[derive(Debug, Clone, Copy)]
pub(super) struct Pending {
    since: SimTime,
    /// It has come, and has to stay.
    came: bool,
}

impl ResponseState {
    /// Waits for a response from now on.
    pub(super) fn begin(
        &mut self,
        response: &Response,
        plan: &Plan,
        agenda: &mut Agenda,
        now: SimTime,
    ) {
        if !plan.is_judged(response.only, response.mission) || self.pending.len() >= MOST_PENDING {
            return;
        }
        self.was_due = true;
        self.pending.push(Pending {
            since: now,
            came: false,
        });
        for end in [Some(response.within), response.until]
            .into_iter()
            .flatten()
        {
            agenda.plan(now + end, Item::Judge);
        }
    }

    /// Returns those that did not come in time, or did not last.
    pub(super) fn judge(
        &mut self,
        response: &Response,
        situation: &Situation,
        now: SimTime,
    ) -> Vec<Pending> {
        let mut failed = Vec::new();
        if self.pending.is_empty() {
            return failed;
        }
        let holds = situation.holds(&response.then).unwrap_or(false);
        let Self { pending, slack, .. } = self;
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
        failed
    }
}

impl Response {
    pub(super) fn never_came(&self, scenario: &Scenario) -> String {
        match &self.to {
            Cause::Whenever(cause) => format!("{}: `{}` never came", self.words(), cause.text),
            Cause::Step(step) => {
                let step = &scenario.steps[*step].name;
                format!("{}: \"{step}\" never happened", self.words())
            }
        }
    }

    pub(super) fn not_answered(
        &self,
        pending: Pending,
        scenario: &Scenario,
        situation: &Situation,
    ) -> What {
        let cause = match &self.to {
            Cause::Whenever(cause) => format!("`{}` began", cause.text),
            Cause::Step(step) => format!("\"{}\" happened", scenario.steps[*step].name),
        };
        let (then, since) = (&self.then.text, pending.since);
        let demand = match (pending.came, self.until) {
            (true, Some(until)) => {
                format!("`{then}` had to last for {} after", show_duration(until))
            }
            _ => format!(
                "expected `{then}` within {} after",
                show_duration(self.within)
            ),
        };
        let found = self.then.explain(situation);
        let found = format!(" at {since} s, but {found}");
        What::of(self.message.as_deref(), &format!("{demand} {cause}"), found)
    }

    pub(super) fn words(&self) -> String {
        format!("response `{}`", self.then.text)
    }
}
