//! From what a file says to a scenario that makes sense.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::Range;
use std::time::Duration;

use sim_core::device::DeviceSpec;
use sim_core::settings::SimSettings;
use sim_settings::{Origin, Source, Span, parse_assignment, set};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::actions::read_operator;
use super::compose::{Parameters, Texts, put_over};
use super::document::{ClientText, DemandText, ResponseText, RuleText, StepText, TimeText};
use super::forgiving::{self, Read};
use super::problems::Problems;
use super::{
    Action, Cause, Demand, HostAction, MOST_STEPS, Only, Response, Rule, Scenario, Step, Times,
    Trigger, WorldAction,
};
use crate::condition::{Condition, Saved, Scope, Value, identifier};
use crate::report::client_report_codes;
use crate::rig_file::{RigFileError, RigPlan, RigText};
use crate::sources::{MOST_FILES, Sources};
use crate::suggest::{improve, nearest, or_allowed};
use crate::tables::{self, Tables};

pub(super) fn read(texts: Texts<'_>, base: &SimSettings) -> Result<Scenario, RigFileError> {
    let sources = Sources(texts.files);
    let mut problems = Problems::new(sources);
    let (root, parameters) = composed(sources, texts, &mut problems)?;
    let mut tables = Tables(root);
    let scripted = scripts(&mut tables.0, &mut problems);
    let Some(Read { document, broken }) = forgiving::read(&mut tables.0, &mut problems) else {
        return Err(problems.into_error());
    };
    let rig_text = RigText {
        schema: document.schema,
        world: document.world,
        seed: document.seed,
        _settings: document.settings,
        device: document.device,
    };
    if rig_text.device.is_empty() {
        let why = "a scenario has 1 to 1000 [[device]] tables; a fault file is played within a job, which \
                   has them: `--job FILE`, or `base` in the file";
        problems.add_lines([format!("{}: {why}", sources.place(0))]);
        return Err(problems.into_error());
    }
    let (rig, wrong) = RigPlan::check(sources, &tables, base, rig_text);
    problems.add_lines(wrong);
    let Some(mut rig) = rig else {
        return Err(problems.into_error());
    };
    problems.add_lines(set_all(texts.set, &mut rig));
    let (limit, takes) = (document.limit.get_ref().0, document.takes);
    if limit.is_zero() {
        problems.add(document.limit.span(), "a run takes some time");
    }
    if let Some(takes) = takes.as_ref().filter(|takes| takes.get_ref().0 > limit) {
        problems.add(takes.span(), "is more than `limit`");
    }
    let mut checker = Checker {
        rig: &rig,
        devices: rig
            .devices
            .iter()
            .map(|device| (device.name.as_str(), device.device))
            .collect(),
        scripted: &scripted,
        parameters: &parameters,
        tables,
        names: BTreeMap::new(),
        limit,
        takes: takes.map_or(limit, |takes| takes.get_ref().0),
        obstacles: Vec::new(),
        unnamed_faults: BTreeMap::new(),
        saved: Vec::new(),
        problems,
    };
    checker.check_device_names();
    checker.check_tags(&document.tags);
    checker.note_names(&document.step);
    let rules = document.always.len() + document.never.len() + document.response.len();
    if document.step.len() > MOST_STEPS || rules > MOST_STEPS {
        let why = format!("at most {MOST_STEPS} steps and {MOST_STEPS} conditions over time");
        checker.problems.add(0..0, &why);
        return Err(checker.problems.into_error());
    }
    // Of what could not be read whole, nothing else is said.
    let is_whole = |at: Range<usize>| !broken.contains(&at.start);
    let remembered: Vec<_> = document
        .step
        .iter()
        .map(|step| checker.remembered(step.get_ref()))
        .collect();
    let steps: Vec<Option<Step>> = document
        .step
        .iter()
        .zip(remembered)
        .enumerate()
        .map(|(index, (text, remember))| {
            let step = is_whole(text.span()).then(|| checker.step(index, text));
            let step = step.flatten()?;
            Some(Step { remember, ..step })
        })
        .collect();
    let mut rules = Vec::new();
    for (texts, must_hold) in [(&document.always, true), (&document.never, false)] {
        checker.check_rule_names(
            texts
                .iter()
                .filter_map(|text| text.get_ref().name.as_deref()),
        );
        for text in texts.iter().filter(|text| is_whole(text.span())) {
            rules.extend(checker.rule(text.get_ref(), must_hold));
        }
    }
    let responses = document.response.iter();
    checker.check_rule_names(
        responses
            .clone()
            .filter_map(|text| text.get_ref().name.as_deref()),
    );
    let responses = responses.filter(|text| is_whole(text.span()));
    let responses: Vec<_> = responses
        .filter_map(|text| checker.response(text.get_ref()))
        .collect();
    let demand = document
        .client_report
        .as_ref()
        .map(|text| checker.demand(text));
    if let Some(steps) = steps.iter().map(Option::as_ref).collect::<Option<Vec<_>>>() {
        checker.check_order(&steps, &document.step, &rules);
    }
    let (obstacles, saved) = (checker.obstacles, checker.saved);
    checker.problems.into_result()?;
    let owned = |source: &Source<'_>| (source.file.to_owned(), source.text.to_owned());
    let (file, text) = texts.files.first().map(owned).unwrap_or_default();
    Ok(Scenario {
        file,
        text,
        bases: texts.files.iter().skip(1).map(owned).collect(),
        given: texts.parameters.to_vec(),
        parameters,
        set: texts.set.to_vec(),
        scripted,
        mission_may_fail: document.mission_may_fail,
        title: document.title,
        description: document.description,
        good_client: document.good_client,
        tags: document.tags.into_iter().map(Spanned::into_inner).collect(),
        limit,
        wall_limit: document.wall_limit.map(|limit| limit.0),
        base: base.clone(),
        steps: steps.into_iter().flatten().collect(),
        rules: rules.into_iter().map(|(rule, _)| rule).collect(),
        responses,
        saved,
        demand,
        obstacles,
        rig,
    })
}

/// The tables of all files as one, with parameters filled in; and those that are no texts.
fn composed<'t>(
    sources: Sources<'t>,
    texts: Texts<'t>,
    problems: &mut Problems<'_>,
) -> Result<(DeTable<'t>, BTreeMap<String, Value>), RigFileError> {
    if texts.files.len() > MOST_FILES {
        let why = format!("at most {MOST_FILES} files are based on one another");
        return Err(RigFileError(vec![why]));
    }
    let tables = (0..texts.files.len())
        .rev()
        .map(|number| sources.tables(number));
    let mut root = DeTable::new();
    let mut wrong = Vec::new();
    for table in tables {
        match table {
            Ok(table) => root = put_over(root, table),
            Err(line) => wrong.push(line),
        }
    }
    if !wrong.is_empty() {
        return Err(RigFileError(wrong));
    }
    let parameters = Parameters::read(&root, texts.parameters, problems);
    parameters.fill(&mut root, problems);
    Ok((root, parameters.values()))
}

/// Takes out of the devices' tables whether each has the script for a client.
fn scripts(root: &mut DeTable<'_>, problems: &mut Problems<'_>) -> Vec<bool> {
    let Some(DeValue::Array(devices)) = root.get_mut("device").map(Spanned::get_mut) else {
        return Vec::new();
    };
    let mut scripted = Vec::new();
    for device in devices.iter_mut() {
        let client = match device.get_mut() {
            DeValue::Table(table) => table.remove("client"),
            _ => None,
        };
        let client = client.and_then(|client| problems.read(client.span(), tables::read(&client)));
        scripted.push(client == Some(ClientText::Script));
    }
    scripted
}

/// Puts settings over those of the file, for each device; and says what is wrong with them.
fn set_all(assignments: &[String], rig: &mut RigPlan) -> Vec<String> {
    let mut wrong = Vec::new();
    for text in assignments {
        let read = parse_assignment("--set", text);
        let result = read.and_then(|(key, value)| {
            let of_devices = rig.devices.iter_mut().map(|device| &mut device.settings);
            let mut all = of_devices.chain([&mut rig.settings]);
            let origin = || Origin::Flag(format!("--set {text}"));
            all.try_for_each(|settings| set(settings, &key, &value, origin()))
        });
        wrong.extend(result.err().map(|error| error.to_string()));
    }
    wrong
}

/// The device that is meant where none is named: the only one, or the only one for a real client.
pub(super) fn usual_device(scripted: &[bool]) -> Option<usize> {
    let mut live = scripted
        .iter()
        .enumerate()
        .filter(|(_, is_scripted)| !**is_scripted);
    match (scripted.len(), live.next(), live.next()) {
        (1, ..) => Some(0),
        (_, Some((index, _)), None) => Some(index),
        _ => None,
    }
}

/// A step that whoever drives a run of the scenario adds, and what is remembered with it; without a
/// time it begins at zero.
pub(super) fn read_step(
    source: Source<'_>,
    scenario: &Scenario,
) -> Result<(Step, Vec<Saved>), RigFileError> {
    let mut text: StepText = toml::from_str(source.text).map_err(|error| {
        let line = source.syntax(&error).to_string();
        RigFileError(vec![improve(&line)])
    })?;
    if text.at.is_none() && text.when.is_none() && text.after.is_none() {
        text.at = Some(Spanned::new(0..0, TimeText::Exactly(Span::default())));
    }
    let sources = Sources(&[source]);
    let table = sources.tables(0).map_err(|line| RigFileError(vec![line]))?;
    let devices = scenario.rig.devices.iter();
    let names = scenario.steps.iter().enumerate();
    let mut checker = Checker {
        rig: &scenario.rig,
        devices: devices.map(|d| (d.name.as_str(), d.device)).collect(),
        scripted: &scenario.scripted,
        parameters: &scenario.parameters,
        tables: Tables(table),
        names: names.map(|(at, step)| (step.name.clone(), at)).collect(),
        limit: scenario.limit,
        takes: scenario.limit,
        obstacles: Vec::new(),
        unnamed_faults: BTreeMap::new(),
        saved: scenario.saved.clone(),
        problems: Problems::new(sources),
    };
    let whole = 0..source.text.len();
    if let Some(name) = &text.name
        && checker.names.contains_key(name.get_ref())
    {
        let why = format!("a step is named \"{}\" already", name.get_ref());
        checker.problems.add(name.span(), &why);
    }
    let remember = checker.remembered(&text);
    let step = checker.step(scenario.steps.len(), &Spanned::new(whole, text));
    checker.problems.into_result()?;
    let mut step = step.ok_or_else(|| RigFileError(vec!["it is no step".to_owned()]))?;
    let own = step.name.clone();
    let taken = |name: &str| scenario.steps.iter().any(|step| step.name == name);
    let mut number = 1;
    while taken(&step.name) {
        number += 1;
        step.name = format!("{own} {number}");
    }
    Ok((Step { remember, ..step }, checker.saved))
}

struct Checker<'a> {
    rig: &'a RigPlan,
    devices: Vec<(&'a str, &'static DeviceSpec)>,
    /// Which devices have the script for a client in any case.
    scripted: &'a [bool],
    parameters: &'a BTreeMap<String, Value>,
    tables: Tables<'a>,
    /// Steps by their names.
    names: BTreeMap<String, usize>,
    limit: Duration,
    /// How long a good client takes.
    takes: Duration,
    /// Obstacles that have to be there, and where the file says so.
    obstacles: Vec<(String, String)>,
    /// How many faults of each kind have no name.
    unnamed_faults: BTreeMap<&'static str, usize>,
    /// What steps remember.
    saved: Vec<Saved>,
    problems: Problems<'a>,
}

impl Checker<'_> {
    /// Conditions call devices by their names, so these must not be mistaken for others.
    fn check_device_names(&mut self) {
        let mut seen = BTreeMap::new();
        for (name, _) in &self.devices {
            let own = identifier(name);
            let group = self
                .rig
                .settings
                .table()
                .iter()
                .flat_map(|device| device.all_names())
                .any(|info| info.name.split('.').next() == Some(own.as_str()));
            let why = if own.starts_with(|first: char| first.is_ascii_digit())
                || ["t", "saved", "param"].contains(&own.as_str())
                || group
            {
                Some(format!("in a scenario no device can be named \"{name}\""))
            } else {
                seen.insert(own, *name)
                    .map(|other| format!("conditions cannot tell \"{name}\" from \"{other}\""))
            };
            if let Some(why) = why {
                self.problems.add(0..0, &why);
            }
        }
    }

    fn check_tags(&mut self, tags: &[Spanned<String>]) {
        for tag in tags {
            let allowed = |c: char| c.is_ascii_lowercase() || c.is_ascii_digit() || c == '-';
            if tag.get_ref().is_empty() || !tag.get_ref().chars().all(allowed) {
                let why = "a tag is made of lower-case letters, digits and `-`";
                self.problems.add(tag.span(), why);
            }
        }
    }

    fn note_names(&mut self, steps: &[Spanned<StepText>]) {
        for (index, step) in steps.iter().enumerate() {
            if let Some(name) = &step.get_ref().name
                && self.names.insert(name.get_ref().clone(), index).is_some()
            {
                let why = format!("two steps are named \"{}\"", name.get_ref());
                self.problems.add(name.span(), &why);
            }
        }
    }

    fn condition(&mut self, text: &Spanned<String>) -> Option<Condition> {
        let condition = Condition::parse(text.get_ref(), &self.scope());
        self.problems.take(text.span(), condition)
    }

    fn scope(&self) -> Scope<'_> {
        Scope {
            devices: &self.devices,
            usual: usual_device(self.scripted),
            saved: &self.saved,
            parameters: self.parameters,
        }
    }

    /// Those that a file changes by name have to be told apart.
    fn check_rule_names<'n>(&mut self, names: impl Iterator<Item = &'n str>) {
        let mut seen = BTreeSet::new();
        for name in names.filter(|name| !seen.insert(*name)) {
            let why = format!("two rules of a kind are named \"{name}\"");
            self.problems.add(0..0, &why);
        }
    }

    /// What a step remembers, which those behind it may remember something of.
    fn remembered(&mut self, text: &StepText) -> Vec<(usize, Condition)> {
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

    fn times(&mut self, text: &Spanned<TimeText>) -> Option<Times> {
        let times = match *text.get_ref() {
            TimeText::Exactly(span) => Times {
                min: span.0,
                max: span.0,
            },
            TimeText::Between(range) => Times {
                min: range.min.0,
                max: range.max.0,
            },
            TimeText::Share(_) => {
                let why = "a share of what the job takes says `at`, and nothing else";
                self.problems.add(text.span(), why);
                return None;
            }
        };
        if times.min > times.max {
            self.problems.add(text.span(), "`min` is more than `max`");
            return None;
        }
        Some(times)
    }

    fn step_named(&mut self, name: &Spanned<String>) -> Option<usize> {
        let found = self.names.get(name.get_ref()).copied().ok_or_else(|| {
            let hint = nearest(name.get_ref(), self.names.keys())
                .map(|near| format!(", did you mean \"{near}\"?"))
                .unwrap_or_default();
            format!("no step is named \"{}\"{hint}", name.get_ref())
        });
        self.problems.take(name.span(), found)
    }

    /// What a step without a name is called. Faults draw their chances by name, so a fault that is
    /// added must not change what others are called: they are counted by kind.
    fn name_for(&mut self, index: usize, action: &Action) -> String {
        let Action::Fault(fault) = action else {
            return format!("step {}", index + 1);
        };
        let count = self.unnamed_faults.entry(fault.id()).or_insert(0);
        *count += 1;
        match *count {
            1 => fault.id().to_owned(),
            count => format!("{} {count}", fault.id()),
        }
    }

    fn step(&mut self, index: usize, spanned: &Spanned<StepText>) -> Option<Step> {
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
    ) -> Option<Action> {
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
            actions.push(read.map(Action::Host));
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
            actions.push(checked.map(|()| Action::Fault(fault.get_ref().clone())));
        }
        if let Some(name) = &text.clear {
            actions.push(self.step_named(name).map(Action::Clear));
        }
        if let (Some(operator), Some(value)) = (&text.operator, table.get("operator")) {
            let read = read_operator(value, plan.device);
            let read = self.problems.read(operator.span(), read);
            actions.push(read.map(Action::Operator));
        }
        if let (Some(world), Some(value)) = (&text.world, table.get("world")) {
            let read = WorldAction::read(value, plan.device);
            let read = self.problems.read(world.span(), read);
            if let Some(name) = read.as_ref().and_then(WorldAction::obstacle) {
                let place = self.problems.place(world.span());
                self.obstacles.push((name.to_owned(), place));
            }
            actions.push(read.map(Action::World));
        }
        if let Some(expect) = &text.expect {
            let that = self.condition(&expect.that);
            actions.push(that.map(|that| Action::Expect {
                that,
                within: expect.within.map(|within| within.0),
                message: expect.message.clone(),
            }));
        }
        if actions.is_empty() && (text.name.is_some() || !text.remember.is_empty()) {
            return Some(Action::Nothing);
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
    fn timing(&mut self, text: &StepText, action: &Action) -> Option<Timing> {
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
            Action::Host(_) | Action::Expect { .. } => {
                let with_count = lasts.is_some() && count.is_some();
                if every.is_none() || with_count {
                    let why = "says how long this is repeated: it needs `every`, and no `count`";
                    self.problems.add(end_at, why);
                    return None;
                }
                true
            }
            Action::Fault(_) => true,
            Action::Clear(_) | Action::Nothing => false,
            Action::Operator(action) => action.can_end(),
            Action::World(action) => action.can_end(),
        };
        if !ends {
            let why = "this cannot be undone after a time";
            self.problems.add(end_at, why);
            return None;
        }
        Some((every, count, lasts.map(|(lasts, _)| lasts)))
    }

    fn response(&mut self, text: &ResponseText) -> Option<Response> {
        let to = match (&text.whenever, &text.step) {
            (Some(whenever), None) => self.condition(whenever).map(Cause::Whenever),
            (None, Some(name)) => self.step_named(name).map(Cause::Step),
            _ => {
                let why = "exactly one of `whenever` and `step` says what this is a response to";
                self.problems.add(text.then.span(), why);
                None
            }
        };
        let then = self.condition(&text.then);
        let within = text.within.unwrap_or_default().0;
        if let Some(until) = text.until.as_ref().filter(|u| u.get_ref().0 < within) {
            self.problems.add(until.span(), "is before `within`");
        }
        Some(Response {
            to: to?,
            then: then?,
            within,
            until: text.until.as_ref().map(|until| until.get_ref().0),
            message: text.message.clone(),
            only: text.only,
            mission: text.mission,
        })
    }

    fn rule(&mut self, text: &RuleText, must_hold: bool) -> Option<(Rule, Option<Range<usize>>)> {
        let that = self.condition(&text.that);
        let after = match &text.after {
            Some(name) => Some(self.step_named(name)?),
            None => None,
        };
        let from = text.from.unwrap_or_default().0;
        let until = text.until.as_ref().map(|until| until.get_ref().0);
        if let Some(spanned) = &text.until
            && spanned.get_ref().0 < from
        {
            self.problems.add(spanned.span(), "is before `from`");
        }
        let rule = Rule {
            that: that?,
            must_hold,
            message: text.message.clone(),
            longer_than: text.longer_than.unwrap_or_default().0,
            from,
            until,
            after,
            only: text.only,
            mission: text.mission,
        };
        Some((rule, text.after.as_ref().map(Spanned::span)))
    }

    fn demand(&mut self, text: &Spanned<DemandText>) -> Demand {
        let DemandText::Kinds(kinds) = text.get_ref() else {
            return Demand {
                allowed: Some(Vec::new()),
                forbidden: Vec::new(),
                only: None,
            };
        };
        let known: Vec<&str> = client_report_codes(self.rig.settings.table()).collect();
        for kind in kinds.allowed.iter().chain(&kinds.forbidden).flatten() {
            if !known.contains(&kind.as_str()) {
                let allowed = or_allowed(kind, &known);
                let why = format!("the client report has no kind `{kind}`; {allowed}");
                self.problems.add(text.span(), &why);
            }
        }
        if kinds.allowed.is_some() == kinds.forbidden.is_some() {
            let why = "exactly one of `allowed` and `forbidden` says what may be in it";
            self.problems.add(text.span(), why);
        }
        Demand {
            allowed: kinds.allowed.clone(),
            forbidden: kinds.forbidden.clone().unwrap_or_default(),
            only: kinds.only,
        }
    }

    /// What steps and conditions wait for has to come.
    fn check_order(
        &mut self,
        steps: &[&Step],
        texts: &[Spanned<StepText>],
        rules: &[(Rule, Option<Range<usize>>)],
    ) {
        let mut waits = Vec::new();
        for (index, (step, text)) in steps.iter().zip(texts).enumerate() {
            let at = text.get_ref().after.as_ref().map(Spanned::span);
            if let (Trigger::After(other), Some(at)) = (&step.trigger, at) {
                waits.push((*other, at.clone()));
                if comes_back(steps, index) {
                    let why = "the steps wait for one another in a circle";
                    self.problems.add(at, why);
                }
            }
            if let (Action::Clear(other), Some(name)) = (&step.action, &text.get_ref().clear)
                && !matches!(steps[*other].action, Action::Fault(_))
            {
                let why = format!("\"{}\" is no fault", name.get_ref());
                self.problems.add(name.span(), &why);
            }
        }
        let of_rules = rules
            .iter()
            .filter_map(|(rule, at)| Some((rule.after?, at.clone()?)));
        waits.extend(of_rules);
        for (other, at) in waits {
            if steps[other].is_endless() {
                let name = &steps[other].name;
                let why = format!("\"{name}\" is repeated without end, so it is never done");
                self.problems.add(at, &why);
            }
        }
    }
}

/// Times between repetitions, their number, and how long each lasts.
type Timing = (Option<Times>, Option<u32>, Option<Times>);

/// Tells whether following what a step waits for leads back to it.
fn comes_back(steps: &[&Step], start: usize) -> bool {
    let mut at = start;
    for _ in 0..steps.len() {
        match steps[at].trigger {
            Trigger::After(other) if other == start => return true,
            Trigger::After(other) => at = other,
            _ => return false,
        }
    }
    false
}
