//! Failures, and the verdict at the end of a run.

use std::sync::Arc;
use std::time::Duration;

use sim_core::SimTime;
use sim_settings::show_duration;

use super::Run;
use super::outcome::{DeviceReport, Failure, FaultRecord, Outcome};
use super::steps::FaultCounts;
use crate::scenario::{StepAction, Trigger};
use crate::trace::Record;

/// Most failures that are told; further ones are counted.
const MOST_FAILURES: usize = 50;

impl Run {
    pub(super) fn fail_step(&mut self, index: usize, at: SimTime, what: String) {
        let step = Some(self.scenario.steps[index].name.clone());
        let state = &mut self.steps[index];
        state.failure.get_or_insert_with(|| what.clone());
        self.note_failure(at, step, what);
    }

    pub(super) fn note_failure(&mut self, at: SimTime, step: Option<String>, what: String) {
        self.record(|| Record::Failure {
            t: at.as_nanos(),
            step: step.clone(),
            what: what.clone(),
        });
        if let Some(outcome) = &mut self.outcome {
            outcome.fail(what);
        } else if self.failures.len() < MOST_FAILURES {
            let context = self.context();
            self.failures.push(Failure {
                at,
                step,
                what,
                context,
            });
        } else {
            self.more_failures += 1;
        }
    }

    /// The run is over: what did not come, and what came of it all.
    pub(super) fn finish(&mut self) {
        let now = self.rig.now();
        self.last_in_effect = Some(self.in_effect());
        self.fail_what_waits(now);
        let faults = self.close_faults(now);
        self.fail_what_never_began(now);
        self.judge_reports(now);
        let passed = self.failures.is_empty();
        let outcome = Outcome {
            passed,
            title: self.scenario.title.clone(),
            seed: self.options.seed,
            ended_at: now,
            failures: std::mem::take(&mut self.failures),
            more_failures: self.more_failures,
            faults,
            devices: self
                .scenario
                .rig
                .devices
                .iter()
                .zip(&self.observed)
                .enumerate()
                .map(|(device, (plan, observed))| DeviceReport {
                    name: plan.name.clone(),
                    report: observed.report.clone(),
                    distance_m: self.rig.distance_m(device),
                })
                .collect(),
            not_judged: self.not_judged(),
            last: self.context(),
        };
        if let Some(recorder) = &mut self.recorder {
            recorder.end(now, outcome.passed);
        }
        self.outcome = Some(outcome);
    }

    /// What is repeated without end is cut off somewhere; anything else had to come in time.
    fn fail_what_waits(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.scenario);
        let endless = |step: usize| scenario.steps[step].is_endless();
        for expected in std::mem::take(&mut self.expected) {
            if endless(expected.step) {
                continue;
            }
            let StepAction::Expect { that, message, .. } = &scenario.steps[expected.step].action
            else {
                continue;
            };
            let why = self.not_held(expected.step, that, message.as_deref());
            let why = format!("the run ended before its time was up: {why}");
            self.fail_step(expected.step, now, why);
        }
        let unanswered = self.unanswered().into_iter();
        for (step, why) in unanswered.filter(|(step, _)| !endless(*step)) {
            let why = format!("the run ended before its time was up: {why}");
            self.fail_step(step, now, why);
        }
    }

    fn close_faults(&mut self, now: SimTime) -> Vec<FaultRecord> {
        let scenario = Arc::clone(&self.scenario);
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
            if armed > 0 && hit == 0 && !step.may_not_trigger {
                let why = format!(
                    "the fault {} was there from {begun} s on and never hit anything; \
                     if that is all right, say `may_not_trigger = true`",
                    fault.id()
                );
                self.fail_step(index, now, why);
            }
            records.push(FaultRecord {
                step: step.name.clone(),
                id: fault.id(),
                armed,
                hit,
                hits,
            });
        }
        records
    }

    fn fail_what_never_began(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.scenario);
        for (index, step) in scenario.steps.iter().enumerate() {
            let begun = self.steps[index].begun.is_some();
            if begun || step.may_not_trigger || !self.is_played(step) {
                continue;
            }
            let why = match &step.trigger {
                Trigger::At(_) => {
                    let at = self.steps[index].planned.unwrap_or(now);
                    format!("it was to begin at {at} s, the run ended before")
                }
                Trigger::When(condition) => {
                    let nearest = self.nearest(index);
                    format!("it never began: `{}` never held{nearest}", condition.text)
                }
                Trigger::After(other) => {
                    let name = &scenario.steps[*other].name;
                    format!("it never began: \"{name}\" was not done in time")
                }
            };
            let delay = match step.delay.max {
                Duration::ZERO => String::new(),
                delay => format!(", or not {} before the end", show_duration(delay)),
            };
            self.fail_step(index, now, why + &delay);
        }
    }

    fn judge_reports(&mut self, now: SimTime) {
        let scenario = Arc::clone(&self.scenario);
        let Some(demand) = &scenario.demand else {
            return;
        };
        if !self.counts(demand.only) {
            return;
        }
        for (index, plan) in scenario.rig.devices.iter().enumerate() {
            let found: Vec<String> = self.observed[index]
                .report
                .held_against_client()
                .filter(|(code, _)| match &demand.allowed {
                    Some(allowed) => !allowed.iter().any(|kind| kind == code),
                    None => demand.forbidden.iter().any(|kind| kind == code),
                })
                .map(|(code, tally)| {
                    format!(
                        "{code} × {}, first at {} s: {}",
                        tally.held_against_client, tally.first_at, tally.first
                    )
                })
                .collect();
            for what in found {
                let what = format!("client report of {}: {what}", plan.name);
                self.note_failure(now, None, what);
            }
        }
    }
}
