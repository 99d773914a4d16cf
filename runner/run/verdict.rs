//! Failures, and the verdict at the end of a run.

use std::sync::Arc;
use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::event::code;
use rigsim_settings::show_duration;

use super::Run;
use super::context::in_effect;
use super::outcome::{DeviceReport, Failure, FailureKind, FaultRecord, Margin, Outcome, What};
use super::record::Record;
use super::steps::FaultCounts;
use crate::scenario::{Step, StepAction, Trigger};

/// Most failures that are reported; further ones are counted.
const MOST_FAILURES: usize = 50;

impl Run {
    pub(super) fn fail_step(&mut self, index: usize, at: SimTime, what: impl Into<What>) {
        self.fail_step_by(FailureKind::Rule, index, at, what.into());
    }

    fn fail_step_by(&mut self, kind: FailureKind, index: usize, at: SimTime, what: What) {
        let step = Some(self.plan.scenario.steps[index].name.clone());
        let state = &mut self.steps[index];
        state.failure.get_or_insert_with(|| what.to_string());
        self.add_failure(kind, at, step, what);
    }

    /// Judges steps that did not come about. Returns those for which a real client need not give
    /// occasion. A step of the mission is a failure, and so is any step of a file that disturbs nothing:
    /// there is nothing in it but what the client is to do.
    fn judge_missed(&mut self, missed: Vec<(usize, String)>, now: SimTime) -> Vec<String> {
        let scenario = Arc::clone(&self.plan.scenario);
        let disturbs = |step: &Step| matches!(step.action, StepAction::Effect(_));
        let may_lack = self.plan.options.live && scenario.steps.iter().any(disturbs);
        let mut not_applicable = Vec::new();
        for (index, what) in missed {
            let step = &scenario.steps[index];
            if may_lack && !step.mission {
                not_applicable.push(format!("\"{}\": {what}", step.name));
            } else {
                self.fail_step_by(FailureKind::Consequence, index, now, what.into());
            }
        }
        not_applicable.extend(self.devices_without_client());
        not_applicable
    }

    pub(super) fn add_failure(
        &mut self,
        kind: FailureKind,
        at: SimTime,
        step: Option<String>,
        What { rule, found }: What,
    ) {
        let what = format!("{rule}{found}");
        self.record(|| Record::Failure {
            t: at.as_nanos(),
            step: step.clone(),
            what: what.clone(),
        });
        if let Some(outcome) = &mut self.outcome {
            outcome.fail(what);
        } else if self.failures.list.len() < MOST_FAILURES {
            let context = self.failures.context(&self.plan.scenario, &self.steps);
            self.failures.list.push(Failure {
                kind,
                at,
                step,
                what,
                rule,
                context,
            });
        } else {
            self.failures.more += 1;
        }
    }

    /// The run is over: what did not come, and what came of it all.
    pub(super) fn finish(&mut self) {
        let now = self.situation.rig.now();
        let scenario = Arc::clone(&self.plan.scenario);
        self.failures.last_in_effect = Some(in_effect(&scenario, &self.steps));
        self.fail_what_waits(now);
        let mut missed = Vec::new();
        let faults = self.close_faults(&mut missed);
        self.find_what_never_began(now, &mut missed);
        let not_applicable = self.judge_missed(missed, now);
        self.judge_reports(now);
        self.failures.list.sort_by_key(|failure| failure.kind);
        let passed = self.failures.list.is_empty() && not_applicable.is_empty();
        let devices = scenario.rig.devices.iter().zip(&self.situation.counters);
        let outcome = Outcome {
            passed,
            title: scenario.title.clone(),
            seed: self.plan.options.seed,
            ended_at: now,
            failures: std::mem::take(&mut self.failures.list),
            more_failures: self.failures.more,
            faults,
            devices: devices
                .enumerate()
                .map(|(device, (plan, counters))| DeviceReport {
                    name: plan.name.clone(),
                    report: counters.report.clone(),
                    distance_m: self.situation.rig.distance_m(device),
                })
                .collect(),
            margins: self.margins(),
            not_judged: self.expectations.not_judged(&self.plan, now),
            not_applicable,
            last: self.failures.context(&scenario, &self.steps),
        };
        if let Some(recorder) = &mut self.recorder {
            let why_skipped = match outcome.is_skipped() {
                true => &outcome.not_applicable[..],
                false => &[],
            };
            recorder.end(now, outcome.passed, why_skipped);
        }
        self.outcome = Some(outcome);
    }

    /// The margins of everything that was judged.
    fn margins(&self) -> Vec<Margin> {
        let others = self.expectations.margins(&self.plan.scenario);
        let steps = self.plan.scenario.steps.iter().zip(&self.steps);
        let expected = steps.filter_map(|(step, state)| match &step.action {
            StepAction::Expect { that, .. } => state
                .slack
                .margin(format!("\"{}\": expected `{}`", step.name, that.text)),
            _ => None,
        });
        others.chain(expected).collect()
    }

    /// What is repeated without end is cut off somewhere; anything else had to come in time.
    fn fail_what_waits(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.plan.scenario);
        let endless = |step: usize| scenario.steps[step].is_endless();
        for expected in std::mem::take(&mut self.expectations.steps) {
            if endless(expected.step) {
                continue;
            }
            let StepAction::Expect { that, message, .. } = &scenario.steps[expected.step].action
            else {
                continue;
            };
            let why = self.not_held(expected.step, that, message.as_deref());
            let why = format!("the run ended before its time was up: {why}");
            self.fail_step_by(FailureKind::Consequence, expected.step, now, why.into());
        }
        let unanswered = self.script.unanswered().into_iter();
        for (step, why) in unanswered.filter(|(step, _)| !endless(*step)) {
            let why = format!("the run ended before its time was up: {why}");
            self.fail_step_by(FailureKind::Consequence, step, now, why.into());
        }
    }

    fn close_faults(&mut self, missed: &mut Vec<(usize, String)>) -> Vec<FaultRecord> {
        let scenario = Arc::clone(&self.plan.scenario);
        let mut records = Vec::new();
        for (index, step) in scenario.steps.iter().enumerate() {
            let Some(fault) = step.fault() else {
                continue;
            };
            let Some(begun) = self.steps[index].begun else {
                continue;
            };
            // One that is over by itself takes its number along.
            self.end_all(index);
            let FaultCounts { armed, hit, hits } = self.steps[index].counts;
            let info = fault.info();
            let (id, counts) = (info.id, info.counts);
            if armed > 0 && hit == 0 && !step.optional {
                let why = format!(
                    "the fault {id} was there from {begun} s on and never hit anything; a hit is: \
                     {counts} `optional = true` allows that"
                );
                missed.push((index, why));
            }
            records.push(FaultRecord {
                step: step.name.clone(),
                from: begun,
                id,
                armed,
                hit,
                hits,
            });
        }
        records
    }

    fn find_what_never_began(&self, now: SimTime, missed: &mut Vec<(usize, String)>) {
        let scenario = Arc::clone(&self.plan.scenario);
        for (index, step) in scenario.steps.iter().enumerate() {
            let begun = self.steps[index].begun.is_some();
            if begun || step.optional || !self.plan.is_played(step) {
                continue;
            }
            let why = match &step.trigger {
                Trigger::At(_) => {
                    let at = self.steps[index].planned.unwrap_or(now);
                    format!("it was to begin at {at} s, the run ended before")
                }
                Trigger::When(condition) => {
                    let nearest = self.steps[index].nearest();
                    format!("it never began: `{}` never held{nearest}", condition.text)
                }
                Trigger::After(other) => {
                    let name = &scenario.steps[*other].name;
                    format!("it never began: \"{name}\" was not done before the end")
                }
            };
            let delay = match step.delay.max {
                Duration::ZERO => String::new(),
                delay => format!(", or not {} before the end", show_duration(delay)),
            };
            missed.push((index, why + &delay));
        }
    }

    /// Vehicles of several for the client that it has left alone: it may know one only.
    fn devices_without_client(&self) -> Vec<String> {
        let plans = self.plan.scenario.rig.devices.iter();
        let devices = plans.zip(&self.situation.counters).enumerate();
        let live = devices.filter(|(index, _)| !self.plan.has_script(*index));
        let (opened, left): (Vec<_>, Vec<_>) = live.partition(|(_, (_, counters))| {
            let events = &counters.report.events;
            events.contains_key(code::CLIENT_ATTACHED.name)
        });
        if opened.is_empty() || self.plan.scenario.is_endless() {
            return Vec::new();
        }
        let left = left.into_iter().map(|(_, (plan, _))| &plan.name);
        left.map(|name| format!("the client never opened a port of \"{name}\""))
            .collect()
    }

    fn judge_reports(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.plan.scenario);
        let Some(demand) = &scenario.demand else {
            return;
        };
        if !self.plan.counts(demand.only) {
            return;
        }
        for (index, plan) in scenario.rig.devices.iter().enumerate() {
            let found: Vec<What> = self.situation.counters[index]
                .report
                .client_errors()
                .filter(|(code, _)| match &demand.allowed {
                    Some(allowed) => !allowed.iter().any(|kind| kind == code),
                    None => demand.forbidden.iter().any(|kind| kind == code),
                })
                .map(|(code, tally)| What {
                    rule: format!("client report of {}: {code}", plan.name),
                    found: format!(
                        " × {}, first at {} s: {}",
                        tally.client_errors, tally.first_at, tally.first
                    ),
                })
                .collect();
            for what in found {
                self.add_failure(FailureKind::Rule, now, None, what);
            }
        }
    }
}
