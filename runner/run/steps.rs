//! The file's steps as they happen.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::EffectHandle;
use rigsim_core::effect::Checked;
use rigsim_core::noise::Noise;
use rigsim_core::rig::Rig;

use super::agenda::Item;
use super::expectations::Expected;
use super::margin::Slack;
use super::record::Record;
use super::{MOST_ROUNDS, Run};
use crate::condition::{Condition, Situation};
use crate::scenario::{Scenario, Step, StepAction, Times, Trigger};

/// How often the nearness of a condition is measured.
const NEARNESS_EVERY: Duration = Duration::from_millis(20);
/// Nearest that something that is waited for has come to holding.
#[derive(Debug)]
pub(super) struct Nearest {
    by: f64,
    at: SimTime,
    measured: SimTime,
    found: String,
}

/// Progress of a step.
#[derive(Debug)]
pub(super) struct StepState {
    /// Set while its condition is still waited for.
    pub(super) watching: bool,
    /// Time at which it is to begin, if a time says so.
    pub(super) planned: Option<SimTime>,
    pub(super) begun: Option<SimTime>,
    /// Time since which its fault, or what else it did, goes on; or went on last.
    pub(super) since: Option<SimTime>,
    pub(super) done: Option<SimTime>,
    times: u32,
    /// Time at which its repetitions end, if they have such an end.
    ends: Option<SimTime>,
    /// A repetition waits until the last one's effect is over.
    put_off: bool,
    all_begun: bool,
    /// Number of its times that go on.
    pending: u32,
    /// Set if it is none of the file's.
    pub(super) added: bool,
    /// First thing that went wrong with it.
    pub(super) failure: Option<String>,
    chance: Noise,
    /// From which times are drawn.
    times_drawn: Noise,
    /// Nearest that what it waits for has come to holding so far.
    pub(super) nearest: Option<Nearest>,
    pub(super) slack: Slack,
    /// Faults that it has brought, or actions that can be undone, that go on.
    pub(super) effects: Vec<EffectHandle>,
    pub(super) counts: FaultCounts,
}

/// Number of times that a step has brought its fault.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct FaultCounts {
    pub(super) armed: u64,
    /// Number of these times at which it hit anything.
    pub(super) hit: u64,
    /// Number of hits, all times together.
    pub(super) hits: u64,
}

impl StepState {
    pub(super) fn all(scenario: &Scenario, seed: u64) -> Vec<Self> {
        let steps = scenario.steps.iter();
        steps.map(|step| Self::new(step, seed)).collect()
    }

    pub(super) fn new(step: &Step, seed: u64) -> Self {
        Self {
            watching: matches!(step.trigger, Trigger::When(_)),
            planned: None,
            begun: None,
            since: None,
            done: None,
            times: 0,
            ends: None,
            put_off: false,
            all_begun: false,
            pending: 0,
            added: false,
            failure: None,
            chance: Noise::new(seed, &format!("scenario.{}", step.name)),
            times_drawn: Noise::new(seed, &format!("scenario.{}.times", step.name)),
            nearest: None,
            slack: Slack::default(),
            effects: Vec::new(),
            counts: FaultCounts::default(),
        }
    }

    /// Returns whether nothing of it goes on or is still to come.
    pub(super) fn is_over(&self) -> bool {
        self.done.is_some() && self.effects.is_empty()
    }

    /// One of its times.
    pub(super) fn draw(&mut self, times: Times) -> Duration {
        times.draw(&mut self.times_drawn)
    }

    /// Returns whether its end by a condition is waited for.
    pub(super) fn may_end(&self) -> bool {
        self.begun.is_some() && self.done.is_none()
    }

    /// Number of times that its faults have hit something until now.
    pub(super) fn hits_so_far(&self, rig: &Rig) -> u64 {
        let effects = self.effects.iter();
        self.counts.hits + effects.map(|fault| rig.hits(*fault)).sum::<u64>()
    }
}

impl StepState {
    /// Takes note of how near what it waits for has come.
    pub(super) fn update_nearness(
        &mut self,
        condition: &Condition,
        situation: &Situation,
        now: SimTime,
    ) {
        if !condition.is_gradual() {
            return;
        }
        // Often enough to tell, and seldom enough to cost nothing.
        let before = self.nearest.as_mut();
        if before
            .as_ref()
            .is_some_and(|before| now < before.measured + NEARNESS_EVERY)
        {
            return;
        }
        // The distance from holding; larger is nearer.
        let by = condition.margin(situation).min(0.0);
        match before {
            Some(before) if before.by >= by => before.measured = now,
            _ => {
                self.nearest = Some(Nearest {
                    by,
                    at: now,
                    measured: now,
                    found: condition.explain(situation),
                });
            }
        }
    }

    /// The nearest that what it waits for has come, in words.
    pub(super) fn nearest(&self) -> String {
        let nearest = self.nearest.as_ref();
        nearest.map_or_else(String::new, |nearest| {
            format!("; it came nearest at {} s: {}", nearest.at, nearest.found)
        })
    }
}

impl Run {
    /// Plans what has a fixed time.
    pub(super) fn schedule(&mut self) {
        for (index, step) in self.plan.scenario.steps.iter().enumerate() {
            if let Trigger::At(times) = step.trigger {
                let at = SimTime::ZERO + self.steps[index].draw(times);
                self.steps[index].planned = Some(at);
                self.agenda.plan(at, Item::Occur(index));
            }
        }
        self.expectations
            .open_windows(&self.plan, &mut self.agenda, None, SimTime::ZERO);
        self.agenda.plan(SimTime::ZERO, Item::Judge);
    }

    /// A step's condition holds, or what it waits for is done.
    pub(super) fn begin(&mut self, index: usize, now: SimTime) {
        let state = &mut self.steps[index];
        state.watching = false;
        state.nearest = None;
        let at = now + state.draw(self.plan.scenario.steps[index].delay);
        self.agenda.plan(at, Item::Occur(index));
    }

    /// Does what is planned for now; says whether that was anything.
    pub(super) fn run_agenda(&mut self, now: SimTime) -> bool {
        let mut any = false;
        for _ in 0..MOST_ROUNDS {
            let Some(item) = self.agenda.take_due(now) else {
                break;
            };
            any = true;
            match item {
                Item::Judge => {}
                Item::Clear(index) => self.cut_short(index, now),
                Item::Occur(index) => self.occur(index, now),
                Item::End(index, effect) => self.effect_over(index, effect, now),
            }
        }
        any
    }

    fn effect_over(&mut self, index: usize, effect: Option<EffectHandle>, now: SimTime) {
        if let Some(effect) = effect {
            let state = &mut self.steps[index];
            if std::mem::take(&mut state.put_off) {
                self.agenda.plan(now, Item::Occur(index));
            }
            self.end_effect(index, effect);
        }
        self.time_over(index, now);
    }

    /// The condition at which a step ends has come to hold.
    pub(super) fn end_step(&mut self, index: usize, now: SimTime) {
        let state = &mut self.steps[index];
        state.all_begun = true;
        state.put_off = false;
        for effect in self.agenda.take_all_of(index) {
            self.effect_over(index, effect, now);
        }
        self.check_done(index, now);
    }

    fn occur(&mut self, index: usize, now: SimTime) {
        let scenario = std::sync::Arc::clone(&self.plan.scenario);
        let step = &scenario.steps[index];
        let state = &mut self.steps[index];
        let has_end = step.lasts.is_some() || step.until.is_some();
        if step.every.is_some() && has_end && !state.effects.is_empty() {
            state.put_off = true;
            return;
        }
        if state.begun.is_none() {
            state.begun = Some(now);
            self.record_step(now, step, "begun");
            let state = &mut self.steps[index];
            if let Some(lasts) = step.lasts.filter(|_| step.is_repeated_for()) {
                state.pending += 1;
                let end = now + state.draw(lasts);
                state.ends = Some(end);
                self.agenda.plan(end, Item::End(index, None));
            }
        }
        let state = &mut self.steps[index];
        state.times += 1;
        let next = step.every.map(|every| now + state.draw(every));
        let next = next.filter(|next| {
            step.count.is_none_or(|count| state.times < count)
                && state.ends.is_none_or(|end| *next < end)
        });
        match next {
            Some(next) => self.agenda.plan(next, Item::Occur(index)),
            None => state.all_begun = true,
        }
        // Drawn each time, so that what is left out does not shift what comes after.
        let drawn = step
            .probability
            .is_none_or(|probability| state.chance.uniform() < probability);
        if drawn && self.plan.counts(step.only) {
            self.remember(index, step, now);
            self.expectations
                .cause_responses(&self.plan, &mut self.agenda, index, now);
        }
        if drawn && self.plan.is_played(step) {
            // Held while it acts, so that an effect that ends at once does not end the step early.
            self.steps[index].pending += 1;
            self.act(index, step, now);
            self.steps[index].pending -= 1;
        }
        self.check_done(index, now);
    }

    fn remember(&mut self, index: usize, step: &Step, now: SimTime) {
        for (slot, value) in &step.remember {
            match value.value(&self.situation) {
                Ok(value) => {
                    self.situation
                        .saved
                        .resize(self.plan.scenario.saved.len(), None);
                    self.situation.saved[*slot] = Some(value);
                }
                Err(why) => self.fail_step(index, now, why.to_string()),
            }
        }
    }

    fn act(&mut self, index: usize, step: &Step, now: SimTime) {
        let effect = match &step.action {
            StepAction::Host(host) => {
                self.host_acts(index, host, now);
                None
            }
            StepAction::Effect(effect) => self.apply(index, step, effect, now),
            StepAction::Expect { within, .. } => {
                let due = now + within.unwrap_or_default();
                self.expectations.steps.push(Expected { step: index, due });
                self.agenda.plan(due, Item::Judge);
                self.steps[index].pending += 1;
                None
            }
            StepAction::Nothing => None,
        };
        let state = &mut self.steps[index];
        let until = step.until.as_ref().map(|_| SimTime::MAX);
        let ends = step.lasts.map(|lasts| now + state.draw(lasts)).or(until);
        let Some(effect) = effect else { return };
        if state.effects.is_empty() {
            state.since = Some(now);
        }
        if let Some(ends) = ends {
            state.pending += 1;
            self.agenda.plan(ends, Item::End(index, Some(effect)));
        } else if step.fault().is_none() {
            // Faults add up; what was done the last time goes on in what is done now.
            for last in state.effects.drain(..) {
                self.situation.rig.supersede(last);
            }
        }
        state.effects.push(effect);
    }

    fn apply(
        &mut self,
        index: usize,
        step: &Step,
        effect: &Checked,
        now: SimTime,
    ) -> Option<EffectHandle> {
        let is_fault = effect.info().is_fault();
        let number = self.steps[index].counts.armed + u64::from(is_fault);
        // Its random numbers come from its name, and are not to be the same each time.
        let name = match number {
            0 | 1 => step.name.clone(),
            number => format!("{} #{number}", step.name),
        };
        match self.situation.rig.apply(step.device, &name, effect) {
            Ok(handle) => {
                self.steps[index].counts.armed = number;
                if is_fault {
                    self.hang_up(step.device, now);
                }
                if effect.effect().disturbs_requests() {
                    self.excuses.disturbed_until[step.device] = SimTime::MAX;
                }
                handle
            }
            Err(why) if is_fault => {
                let why = format!("the fault {}: {why}", effect.info().id);
                self.fail_step(index, now, why);
                None
            }
            Err(why) => {
                self.fail_step(index, now, why.to_string());
                None
            }
        }
    }

    /// Ends a step before its time.
    fn cut_short(&mut self, index: usize, now: SimTime) {
        self.agenda.take_all_of(index);
        self.end_all(index);
        self.expectations
            .steps
            .retain(|expected| expected.step != index);
        let state = &mut self.steps[index];
        state.watching = false;
        state.put_off = false;
        state.all_begun = true;
        state.pending = 0;
        self.check_done(index, now);
    }

    /// Ends all that goes on of what a step did.
    pub(super) fn end_all(&mut self, index: usize) {
        for effect in self.steps[index].effects.clone() {
            self.end_effect(index, effect);
        }
    }

    /// Mends a fault or reverts an action, unless that has been done.
    fn end_effect(&mut self, index: usize, effect: EffectHandle) {
        let state = &mut self.steps[index];
        let Some(at) = state.effects.iter().position(|active| *active == effect) else {
            return;
        };
        state.effects.remove(at);
        let hits = self.situation.rig.hits(effect);
        state.counts.hits += hits;
        state.counts.hit += u64::from(hits > 0);
        self.situation.rig.clear(effect);
        let device = self.plan.scenario.steps[index].device;
        if !self.is_line_disturbed(device) && self.excuses.disturbed_until[device] == SimTime::MAX {
            let held_back = self.held_back(device);
            self.excuses.disturbed_until[device] =
                self.situation.rig.now() + super::judge::EXCUSED_AFTER + held_back;
        }
    }

    /// By how much bytes may be late at most that were sent while a fault was there.
    fn held_back(&self, device: usize) -> Duration {
        let faults = self.faults_of(device);
        let times = faults.map(|(fault, _)| fault.effect().holds_back());
        times.max().unwrap_or_default()
    }

    fn is_line_disturbed(&self, device: usize) -> bool {
        self.faults_of(device)
            .any(|(fault, state)| fault.effect().disturbs_requests() && !state.effects.is_empty())
    }

    /// The faults that steps bring on a device.
    fn faults_of(&self, device: usize) -> impl Iterator<Item = (&Checked, &StepState)> {
        let steps = self.plan.scenario.steps.iter().zip(&self.steps);
        let on_device = steps.filter(move |(step, _)| step.device == device);
        on_device.filter_map(|(step, state)| Some((step.fault()?, state)))
    }

    /// One of a step's times that went on is over.
    pub(super) fn time_over(&mut self, index: usize, now: SimTime) {
        let state = &mut self.steps[index];
        state.pending = state.pending.saturating_sub(1);
        self.check_done(index, now);
    }

    /// One more of a step's times goes on.
    pub(super) fn time_begun(&mut self, index: usize) {
        self.steps[index].pending += 1;
    }

    fn record_step(&mut self, now: SimTime, step: &Step, what: &'static str) {
        self.record(|| Record::Step {
            t: now.as_nanos(),
            step: step.name.clone(),
            what: what.into(),
        });
    }

    fn check_done(&mut self, index: usize, now: SimTime) {
        let state = &mut self.steps[index];
        if !state.all_begun || state.pending > 0 || state.done.is_some() {
            return;
        }
        state.done = Some(now);
        let scenario = std::sync::Arc::clone(&self.plan.scenario);
        self.record_step(now, &scenario.steps[index], "done");
        for (other, step) in scenario.steps.iter().enumerate() {
            if matches!(step.trigger, Trigger::After(waited) if waited == index) {
                self.begin(other, now);
            }
        }
        self.expectations
            .open_windows(&self.plan, &mut self.agenda, Some(index), now);
    }
}
