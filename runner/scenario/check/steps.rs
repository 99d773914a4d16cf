//! What a step says.

use std::ops::Range;
use std::time::Duration;

use toml::Spanned;

use super::{Checker, usual_device};
use crate::condition::{Condition, Saved};
use crate::scenario::actions::read_operator;
use crate::scenario::document::{StepText, TimeText};
use crate::scenario::{HostAction, Only, Step, StepAction, Times, Trigger, WorldAction};
use crate::suggest::or_allowed;
use crate::tables;

/// Times between repetitions, their number, and how long each lasts.
type Timing = (Option<Times>, Option<u32>, Option<Times>);

impl Checker<'_> {
    /// What a step without a name is called. Faults draw their chances by name, so a fault that is
    /// added must not change what others are called: they are counted by kind.
    fn name_for(&mut self, index: usize, action: &StepAction) -> String {
        let StepAction::Fault(fault) = action else {
            return format!("step {}", index + 1);
        };
        let count = self.unnamed_faults.entry(fault.id()).or_insert(0);
        *count += 1;
        match *count {
            1 => fault.id().to_owned(),
            count => format!("{} {count}", fault.id()),
        }
    }

    pub(super) fn step(&mut self, index: usize, spanned: &Spanned<StepText>) -> Option<Step> {
        let text = spanned.get_ref();
        let at = spanned.span();
        let device = self.device(text, at.clone());
        let action = device.and_then(|device| self.action(index, text, at.clone(), device));
        let trigger = self.trigger(text, at);
        let (action, trigger, device) = (action?, trigger?, device?);
        let (every, count, lasts) = self.timing(text, &action)?;
        let until = match &text.until {
            Some(until) => Some(self.condition(until)?),
            None => None,
        };
        if let Some(probability) = &text.probability
            && !(0.0..=1.0).contains(probability.get_ref())
        {
            let why = "out of range; allowed: 0 to 1";
            self.problems.add(probability.span(), why);
        }
        let name = match &text.name {
            Some(name) => name.get_ref().clone(),
            None => self.name_for(index, &action),
        };
        Some(Step {
            name,
            trigger,
            delay: match &text.delay {
                Some(delay) => self.times(delay)?,
                None => Times::default(),
            },
            every,
            overlap: text.overlap,
            count,
            lasts,
            until,
            remember: Vec::new(),
            probability: text.probability.as_ref().map(|p| *p.get_ref()),
            may_not_trigger: text.may_not_trigger,
            only: text.only,
            mission: text.mission,
            device,
            action,
        })
    }

    fn device(&mut self, text: &StepText, at: Range<usize>) -> Option<usize> {
        let Some(name) = &text.device else {
            // What is about no device in particular is said to be the first one's.
            let matters = text.host.is_some() || text.fault.is_some() || text.operator.is_some();
            let usual = usual_device(self.scripted);
            if matters && usual.is_none() {
                let why = "`device` has to say which of several devices is meant";
                self.problems.add(at, why);
                return None;
            }
            return Some(usual.unwrap_or(0));
        };
        let found = self
            .devices
            .iter()
            .position(|(own, _)| own == name.get_ref());
        let found = found.ok_or_else(|| {
            let own: Vec<&str> = self.devices.iter().map(|(own, _)| *own).collect();
            let allowed = or_allowed(name.get_ref(), &own);
            format!("no device is named \"{}\"; {allowed}", name.get_ref())
        });
        self.problems.take(name.span(), found)
    }

    fn trigger(&mut self, text: &StepText, at: Range<usize>) -> Option<Trigger> {
        match (&text.at, &text.when, &text.after) {
            (Some(time), None, None) if text.delay.is_none() => {
                let times = match time.get_ref() {
                    TimeText::Share(share) => {
                        let at = self.takes.mul_f64(*share);
                        Times { min: at, max: at }
                    }
                    _ => self.times(time)?,
                };
                if times.max > self.limit {
                    self.problems.add(time.span(), "later than the run lasts");
                }
                Some(Trigger::At(times))
            }
            (None, Some(condition), None) => self.condition(condition).map(Trigger::When),
            (None, None, Some(name)) => self.step_named(name).map(Trigger::After),
            (Some(_), None, None) => {
                self.problems
                    .add(at, "`delay` goes with `when` and `after`");
                None
            }
            _ => {
                let why = "exactly one of `at`, `when` and `after` says when the step begins";
                self.problems.add(at, why);
                None
            }
        }
    }

    fn action(
        &mut self,
        index: usize,
        text: &StepText,
        at: Range<usize>,
        device: usize,
    ) -> Option<StepAction> {
        let plan = &self.rig.devices[device];
        // A step that is added is a text of its own.
        let table = self.tables.of("step", index).unwrap_or(self.tables.root());
        let table = table.clone();
        let mut actions = Vec::new();
        if let Some(host) = &text.host {
            let (own, at) = (host.get_ref(), host.span());
            let link_at = at.clone();
            let send = tables::table(&table, "host").and_then(|host| host.get("send"));
            let read = HostAction::read(own, link_at, send, (device, plan), &mut self.problems);
            actions.push(read.map(StepAction::Host));
            if text.only == Some(Only::Live) && !self.scripted.get(device).copied().unwrap_or(false)
            {
                let why = "a real client takes the place of the script, so this never happens; \
                           `client = \"script\"` of a device keeps the script for it";
                self.problems.add(at, why);
            }
        }
        if let Some(fault) = &text.fault {
            let checked = plan.check_fault(fault.get_ref());
            let checked = self.problems.take(fault.span(), checked);
            actions.push(checked.map(|()| StepAction::Fault(fault.get_ref().clone())));
        }
        if let Some(name) = &text.clear {
            actions.push(self.step_named(name).map(StepAction::Clear));
        }
        if let (Some(operator), Some(value)) = (&text.operator, table.get("operator")) {
            let read = read_operator(value, plan.device);
            let read = self.problems.read(operator.span(), read);
            actions.push(read.map(StepAction::Operator));
        }
        if let (Some(world), Some(value)) = (&text.world, table.get("world")) {
            let read = WorldAction::read(value, plan.device);
            let read = self.problems.read(world.span(), read);
            if let Some(name) = read.as_ref().and_then(WorldAction::obstacle) {
                let place = self.problems.place(world.span());
                self.obstacles.push((name.to_owned(), place));
            }
            actions.push(read.map(StepAction::World));
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
        if actions.len() != 1 {
            let why = "exactly one of `host`, `fault`, `clear`, `operator`, `world` and `expect` \
                       says what the step does";
            self.problems.add(at, why);
            return None;
        }
        actions.pop().flatten()
    }

    /// How often, and how long each time lasts.
    fn timing(&mut self, text: &StepText, action: &StepAction) -> Option<Timing> {
        let every = match &text.every {
            Some(every) => Some(self.times(every)?),
            None => None,
        };
        if let (
            Some(Times {
                min: Duration::ZERO,
                ..
            }),
            Some(text),
        ) = (every, &text.every)
        {
            self.problems.add(text.span(), "some time has to pass");
            return None;
        }
        if let Some(count) = &text.count
            && (every.is_none() || *count.get_ref() == 0)
        {
            let why = "is at least 1 and needs `every`";
            self.problems.add(count.span(), why);
            return None;
        }
        let count = text.count.as_ref().map(|count| *count.get_ref());
        let lasts = match &text.lasts {
            Some(lasts) => Some((self.times(lasts)?, lasts.span())),
            None => None,
        };
        let until = text.until.as_ref().map(Spanned::span);
        let Some(end_at) = lasts.as_ref().map(|(_, at)| at.clone()).or(until) else {
            return Some((every, count, None));
        };
        let ends = match action {
            StepAction::Host(_) | StepAction::Expect { .. } => {
                let with_count = lasts.is_some() && count.is_some();
                if every.is_none() || with_count {
                    let why = "says how long this is repeated: it needs `every`, and no `count`";
                    self.problems.add(end_at, why);
                    return None;
                }
                true
            }
            StepAction::Fault(_) => true,
            StepAction::Clear(_) | StepAction::Nothing => false,
            StepAction::Operator(action) => action.can_end(),
            StepAction::World(action) => action.can_end(),
        };
        if !ends {
            let why = "this cannot be undone after a time";
            self.problems.add(end_at, why);
            return None;
        }
        Some((every, count, lasts.map(|(lasts, _)| lasts)))
    }

    /// What a step remembers, which those behind it may remember something of.
    pub(super) fn remembered(&mut self, text: &StepText) -> Vec<(usize, Condition)> {
        let mut remembered = Vec::new();
        for (name, value) in &text.remember {
            let read = Condition::parse_typed(value.get_ref(), &self.scope());
            let Some((value, is_flag)) = self.problems.take(value.span(), read) else {
                continue;
            };
            let own = name.get_ref();
            let known = self.saved.iter().position(|saved| saved.name == *own);
            let letter = |c: char| c.is_ascii_alphanumeric() || c == '_';
            let index = known.unwrap_or(self.saved.len());
            if !own.chars().all(letter) || own.starts_with(|c: char| c.is_ascii_digit()) {
                let why = "a name for conditions has letters, digits and _, and no digit first";
                self.problems.add(name.span(), why);
            } else if known.is_none() {
                let name = own.clone();
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
