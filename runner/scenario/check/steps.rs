//! What a step says.

use std::ops::Range;

use rigsim_settings::or_allowed;
use toml::Spanned;

use super::{Checker, usual_device};
use crate::condition::{Condition, Saved, check_name};
use crate::forgiving::{self, LeftOut};
use crate::scenario::actions;
use crate::scenario::compose::{ACTIONS, TRIGGERS};
use crate::scenario::document::{StepText, TimeText};
use crate::scenario::host::HostReader;
use crate::scenario::{Only, Step, StepAction, Times, Trigger};
use crate::sources::{element, table};

/// Times between repetitions, their number, and how long each lasts.
type Timing = (Option<Times>, Option<u32>, Option<Times>);

impl Checker<'_> {
    /// What a step without a name is called. Faults draw their chances by name, so a fault that is
    /// added must not change what others are called: they are counted by kind.
    fn name_for(&mut self, index: usize, action: &StepAction) -> String {
        let id = match action {
            StepAction::Effect(effect) if effect.info().is_fault() => effect.info().id,
            _ => return format!("step {}", index + 1),
        };
        let count = self.unnamed_faults.entry(id).or_insert(0);
        *count += 1;
        match *count {
            1 => id.to_owned(),
            count => format!("{id} {count}"),
        }
    }

    pub(super) fn step(&mut self, index: usize, spanned: &Spanned<StepText>) -> Option<Step> {
        let text = spanned.get_ref();
        let at = spanned.span();
        let device = self.device(text, at.clone());
        let action = self.action(index, text, at.clone(), device);
        let trigger = self.trigger(text, at.clone());
        let (every, count, lasts) = self.timing(text, at, action.as_ref());
        let until = text.until.as_ref().map(|until| self.condition(until));
        let delay = text.delay.as_ref().and_then(|delay| self.times(delay));
        if let Some(probability) = &text.probability
            && !(0.0..=1.0).contains(probability.get_ref())
        {
            let why = "out of range; allowed: 0 to 1";
            self.problems.add(probability.span(), why);
        }
        let action = action?;
        let name = match &text.name {
            Some(name) => name.get_ref().clone(),
            None => self.name_for(index, &action),
        };
        Some(Step {
            name,
            trigger: trigger?,
            delay: delay.unwrap_or_default(),
            every,
            count,
            lasts,
            until: until.flatten(),
            remember: Vec::new(),
            probability: text.probability.as_ref().map(|p| *p.get_ref()),
            optional: text.optional,
            only: text.only,
            mission: text.mission,
            device: device?,
            action,
        })
    }

    fn device(&mut self, text: &StepText, at: Range<usize>) -> Option<usize> {
        let Some(name) = &text.device else {
            // What is about no device in particular is said to be the first one's.
            let matters = text.host.is_some() || text.fault.is_some() || text.operator.is_some();
            let usual = usual_device(self.scripted);
            if matters && usual.is_none() && !self.left_out.lacks(at.start, &["device"]) {
                let why = "`device` has to say which of several devices is meant";
                self.problems.add(at, why);
            }
            return usual.or((!matters).then_some(0));
        };
        let found = self
            .devices
            .iter()
            .position(|(known, _)| known == name.get_ref());
        let found = found.ok_or_else(|| {
            let known: Vec<&str> = self.devices.iter().map(|(name, _)| *name).collect();
            let allowed = or_allowed(name.get_ref(), &known);
            format!("no device is named \"{}\"; {allowed}", name.get_ref())
        });
        self.problems.take(name.span(), found)
    }

    fn trigger(&mut self, text: &StepText, at: Range<usize>) -> Option<Trigger> {
        let mut triggers = Vec::new();
        if let Some(time) = &text.at {
            triggers.push(self.start(time).map(Trigger::At));
        }
        if let Some(condition) = &text.when {
            triggers.push(self.condition(condition).map(Trigger::When));
        }
        if let Some(name) = &text.after {
            triggers.push(self.step_named(name).map(Trigger::After));
        }
        if triggers.len() != 1 && !self.left_out.lacks(at.start, &TRIGGERS) {
            let why = "exactly one of `at`, `when` and `after` says when the step begins";
            self.problems.add(at, why);
        } else if let (Some(_), Some(delay)) = (&text.at, &text.delay) {
            let why = "`delay` goes with `when` and `after`";
            self.problems.add(delay.span(), why);
        }
        triggers.pop().flatten()
    }

    fn start(&mut self, time: &Spanned<TimeText>) -> Option<Times> {
        let times = match time.get_ref() {
            TimeText::Share(share) => {
                let at = self.nominal_duration.mul_f64(*share);
                Times { min: at, max: at }
            }
            _ => self.times(time)?,
        };
        if times.max > self.limit {
            self.problems.add(time.span(), "later than the run lasts");
        }
        Some(times)
    }

    fn action(
        &mut self,
        index: usize,
        text: &StepText,
        at: Range<usize>,
        device: Option<usize>,
    ) -> Option<StepAction> {
        // A step that is added is a separate text.
        let as_written = element(&self.tables, "step", index);
        let as_written = as_written.unwrap_or(&self.tables).clone();
        let plan = device.map(|device| (device, &self.rig.devices[device]));
        let mut actions = Vec::new();
        if let Some(host) = &text.host {
            let send = table(&as_written, "host").and_then(|host| host.get("send"));
            let read = plan.and_then(|plan| {
                let reader = HostReader {
                    plan,
                    is_cut: self.left_out.is_cut(at.start, "host"),
                    problems: &mut self.problems,
                };
                reader.read(host.get_ref(), host.span(), send)
            });
            actions.push(read.map(StepAction::Host));
            let has_script = device.is_none_or(|device| self.scripted.get(device) == Some(&true));
            if text.only == Some(Only::Live) && !has_script {
                let why = "a real client takes the place of the script, so this never happens; \
                           `client = \"script\"` of a device keeps the script for it";
                self.problems.add(host.span(), why);
            }
        }
        let effects = [
            ("fault", &text.fault),
            ("operator", &text.operator),
            ("world", &text.world),
        ];
        for (key, text) in effects {
            let (Some(text), Some(value)) = (text, as_written.get(key)) else {
                continue;
            };
            let checked = plan.and_then(|(_, plan)| {
                let (value, left_out) = (&mut value.clone(), &mut LeftOut::default());
                let read = forgiving::read(value, left_out, &mut self.problems, &|value| {
                    actions::read(key, value, plan)
                });
                // Without what was left out it may be another effect.
                read.filter(|_| left_out.is_empty())
            });
            actions.push(checked.map(|checked| {
                let effect = checked.effect();
                let place = self.problems.origin(text.span().start);
                let needed = effect.needs().into_iter();
                let needed = needed.map(|name| (name.to_owned(), place.to_string()));
                self.obstacles.extend(needed);
                let brought = effect.brings().into_iter().map(str::to_owned);
                self.brought.extend(brought);
                StepAction::Effect(checked)
            }));
        }
        if let Some(expect) = &text.expect {
            let that = self.condition(&expect.that);
            actions.push(that.map(|that| StepAction::Expect {
                that,
                within: expect.within.map(|within| within.0),
                message: expect.message.clone(),
            }));
        }
        if actions.is_empty() && (text.name.is_some() || !text.remember.is_empty()) {
            return Some(StepAction::Nothing);
        }
        if actions.len() != 1 && !self.left_out.lacks(at.start, &ACTIONS) {
            let why = "exactly one of `host`, `fault`, `operator`, `world` and `expect` says what \
                       the step does";
            self.problems.add(at, why);
        }
        actions.pop().flatten()
    }

    /// How often, and how long each time lasts.
    fn timing(&mut self, text: &StepText, at: Range<usize>, action: Option<&StepAction>) -> Timing {
        let every = text.every.as_ref().and_then(|every| self.times(every));
        let no_time = every.is_some_and(|every| every.min.is_zero());
        if let (true, Some(text)) = (no_time, &text.every) {
            self.problems.add(text.span(), "some time has to pass");
        }
        let is_repeated = text.every.is_some() || self.left_out.lacks(at.start, &["every"]);
        if let Some(count) = &text.count
            && (!is_repeated || *count.get_ref() == 0)
        {
            let why = "is at least 1 and needs `every`";
            self.problems.add(count.span(), why);
        }
        let lasts = text.lasts.as_ref().and_then(|lasts| self.times(lasts));
        let ends = text.lasts.as_ref().map(Spanned::span);
        if let (Some(ends), Some(action)) =
            (ends.or(text.until.as_ref().map(Spanned::span)), action)
        {
            let can_end = match action {
                StepAction::Host(_) | StepAction::Expect { .. } => {
                    let with_count = text.lasts.is_some() && text.count.is_some();
                    if !is_repeated || with_count {
                        let why =
                            "says how long this is repeated: it needs `every`, and no `count`";
                        self.problems.add(ends.clone(), why);
                    }
                    true
                }
                StepAction::Nothing => false,
                StepAction::Effect(effect) => effect.effect().can_end(),
            };
            if !can_end {
                let why = "this cannot be undone after a time";
                self.problems.add(ends, why);
            }
        }
        let count = text.count.as_ref().map(|count| *count.get_ref());
        (every, count, lasts)
    }

    /// What a step remembers, which those behind it may remember something of.
    pub(super) fn remembered(&mut self, text: &StepText) -> Vec<(usize, Condition)> {
        let mut remembered = Vec::new();
        for (name, value) in &text.remember {
            let read = Condition::parse_typed(value.get_ref(), &self.scope());
            let saved_name = name.get_ref();
            let Some((value, is_flag)) = self.problems.take(value.span(), read) else {
                self.not_saved.push(saved_name.clone());
                continue;
            };
            let known = self
                .saved
                .iter()
                .position(|saved| saved.name == *saved_name);
            let index = known.unwrap_or(self.saved.len());
            let checked = self.problems.take(name.span(), check_name(saved_name));
            if checked.is_none() {
                // It has been reported.
            } else if known.is_none() {
                let name = saved_name.clone();
                self.saved.push(Saved { name, is_flag });
            } else if self.saved[index].is_flag != is_flag {
                let why = "another step remembers something of another kind by this name";
                self.problems.add(name.span(), why);
            }
            remembered.push((index, value));
        }
        remembered
    }
}
