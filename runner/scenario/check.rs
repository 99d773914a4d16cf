//! From what a file says to a scenario that makes sense.

mod rules;
mod steps;

use std::collections::BTreeMap;
use std::ops::Range;
use std::time::Duration;

use rigsim_core::device::DeviceSpec;
use rigsim_core::settings::SimSettings;
use rigsim_settings::{Origin, Source, Span, nearest, parse_assignment, read as read_value, set};
use toml::Spanned;
use toml::de::{DeTable, DeValue};

use super::compose::{NamedText, Parameters, ScenarioText, put_over};
use super::document::{ClientText, Document, StepText, TimeText};
use super::{MOST_STEPS, Rule, Scenario, Step, Times, Trigger};
use crate::condition::{Condition, Reading, Saved, Scope, identifier};
use crate::error::{FileError, FileErrors};
use crate::forgiving::{self, LeftOut};
use crate::problems::{Problems, Put};
use crate::rig_file::{RigPlan, RigText};
use crate::sources::{MOST_FILES, Sources};

/// Reads a scenario file with those that it is based on; its settings change those of `base`.
pub(crate) fn read(source: &ScenarioText, base: &SimSettings) -> Result<Scenario, FileErrors> {
    let bases = source.base.iter().map(NamedText::source);
    let files: Vec<Source<'_>> = std::iter::once(source.source()).chain(bases).collect();
    let sources = Sources(&files);
    let mut problems = Problems::new(sources);
    let (mut tables, parameters) = composed(sources, &source.parameters, &mut problems)?;
    let (parameters, text_parameters) = (parameters.values(), parameters.texts());
    let scripted = scripts(&mut tables, &mut problems);
    let mut left_out = LeftOut::default();
    let document = forgiving::read_table(&mut tables, &mut left_out, &mut problems);
    let Some(document) = document else {
        return Err(problems.into_error());
    };
    let document: Document = document;
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
        problems.add_to_file(why);
        return Err(problems.into_error());
    }
    let Some(mut rig) = RigPlan::check(&mut problems, &tables, base, rig_text) else {
        return Err(problems.into_error());
    };
    set_all(&source.set, &mut rig, &mut problems);
    let (limit, nominal_duration) = (document.limit.get_ref().0, document.nominal_duration);
    if limit.is_zero() {
        problems.add(document.limit.span(), "a run takes some time");
    }
    if let Some(nominal) = nominal_duration
        .as_ref()
        .filter(|nominal| nominal.get_ref().0 > limit)
    {
        problems.add(nominal.span(), "is more than `limit`");
    }
    let mut checker = Checker {
        rig: &rig,
        devices: rig.kinds(),
        scripted: &scripted,
        parameters: &parameters,
        text_parameters,
        tables,
        names: BTreeMap::new(),
        limit,
        nominal_duration: nominal_duration.map_or(limit, |nominal| nominal.get_ref().0),
        obstacles: Vec::new(),
        brought: Vec::new(),
        unnamed_faults: BTreeMap::new(),
        saved: Vec::new(),
        not_saved: Vec::new(),
        left_out,
        problems,
    };
    checker.check_device_names();
    checker.check_tags(&document.tags);
    checker.collect_names(&document.step);
    let rules = document.always.len() + document.never.len() + document.response.len();
    if document.step.len() > MOST_STEPS || rules > MOST_STEPS {
        let why = format!("at most {MOST_STEPS} steps and {MOST_STEPS} conditions over time");
        checker.problems.add_to_file(&why);
        return Err(checker.problems.into_error());
    }
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
            let step = checker.step(index, text)?;
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
        for text in texts {
            rules.extend(checker.rule(text.get_ref(), must_hold));
        }
    }
    let responses = document.response.iter();
    checker.check_rule_names(
        responses
            .clone()
            .filter_map(|text| text.get_ref().name.as_deref()),
    );
    let responses: Vec<_> = responses
        .filter_map(|text| checker.response(text))
        .collect();
    let demand = document
        .client_report
        .as_ref()
        .map(|text| checker.demand(text));
    checker.check_order(&steps, &document.step, &rules);
    let (obstacles, brought, saved) = (checker.obstacles, checker.brought, checker.saved);
    checker.problems.into_result()?;
    Ok(Scenario {
        source: source.clone(),
        parameters,
        scripted,
        mission_may_fail: document.mission_may_fail,
        title: document.title,
        description: document.description,
        good_client: document.good_client,
        tags: document.tags.into_iter().map(Spanned::into_inner).collect(),
        limit,
        base: base.clone(),
        steps: steps.into_iter().flatten().collect(),
        rules: rules.into_iter().map(|(rule, _)| rule).collect(),
        responses,
        saved,
        demand,
        obstacles,
        brought,
        rig,
    })
}

/// The tables of all files as one, with parameters filled in.
fn composed<'t>(
    sources: Sources<'t>,
    given: &'t [(String, String)],
    problems: &mut Problems<'_>,
) -> Result<(DeTable<'t>, Parameters<'t>), FileErrors> {
    let files = sources.0.len();
    if files > MOST_FILES {
        let why = format!("at most {MOST_FILES} files are based on one another");
        return Err(FileError::general(why).into());
    }
    let tables = (0..files).rev().map(|number| sources.tables(number));
    let mut root = DeTable::new();
    let mut wrong = Vec::new();
    for table in tables {
        match table {
            Ok(table) => root = put_over(root, table),
            Err(FileErrors(errors)) => wrong.extend(errors),
        }
    }
    if !wrong.is_empty() {
        return Err(FileErrors(wrong));
    }
    let parameters = Parameters::read(&root, given, problems);
    parameters.fill(&mut root, problems);
    Ok((root, parameters))
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
        let client = client.and_then(|client| problems.read(client.span(), read_value(&client)));
        scripted.push(client == Some(ClientText::Script));
    }
    scripted
}

/// Puts settings over those of the file, for each device; reports what is wrong with them.
fn set_all(assignments: &[String], rig: &mut RigPlan, problems: &mut Problems<'_>) {
    for text in assignments {
        let read = parse_assignment("--set", text);
        let result = read.and_then(|(key, value)| {
            let of_devices = rig.devices.iter_mut().map(|device| &mut device.settings);
            let mut all = of_devices.chain([&mut rig.settings]);
            let origin = || Origin::Flag(format!("--set {text}"));
            all.try_for_each(|settings| set(settings, &key, &value, origin()))
        });
        problems.add_settings(result.err().map(|error| (0, error)));
    }
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

/// Reads a step that is added to a run of the scenario, and what is remembered with it; without a
/// time it begins at zero.
pub(crate) fn read_step(
    source: Source<'_>,
    scenario: &Scenario,
) -> Result<(Step, Vec<Saved>), FileErrors> {
    let sources = Sources(&[source]);
    let mut problems = Problems::new(sources);
    let mut tables = sources.tables(0)?;
    let text = forgiving::read_table(&mut tables, &mut LeftOut::default(), &mut problems);
    let mut text: StepText = match text {
        Some(text) if problems.is_empty() => text,
        _ => return Err(problems.into_error()),
    };
    if text.at.is_none() && text.when.is_none() && text.after.is_none() {
        text.at = Some(Spanned::new(0..0, TimeText::Exactly(Span::default())));
    }
    let names = scenario.steps.iter().enumerate();
    let mut checker = Checker {
        rig: &scenario.rig,
        devices: scenario.rig.kinds(),
        scripted: &scenario.scripted,
        parameters: &scenario.parameters,
        text_parameters: Vec::new(),
        tables,
        names: names.map(|(at, step)| (step.name.clone(), at)).collect(),
        limit: scenario.limit,
        nominal_duration: scenario.limit,
        obstacles: Vec::new(),
        brought: Vec::new(),
        unnamed_faults: BTreeMap::new(),
        saved: scenario.saved.clone(),
        not_saved: Vec::new(),
        left_out: LeftOut::default(),
        problems,
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
    let mut step = step.ok_or_else(|| FileError::general("it is not a step".to_owned()))?;
    let step_name = step.name.clone();
    let taken = |name: &str| scenario.steps.iter().any(|step| step.name == name);
    let mut number = 1;
    while taken(&step.name) {
        number += 1;
        step.name = format!("{step_name} {number}");
    }
    Ok((Step { remember, ..step }, checker.saved))
}

struct Checker<'a> {
    rig: &'a RigPlan,
    devices: Vec<(&'a str, &'static DeviceSpec)>,
    /// Which devices have the script for a client in any case.
    scripted: &'a [bool],
    parameters: &'a BTreeMap<String, Reading>,
    /// Parameters that are texts, which no condition can speak of.
    text_parameters: Vec<(String, Put)>,
    tables: DeTable<'a>,
    /// Steps by their names.
    names: BTreeMap<String, usize>,
    limit: Duration,
    /// How long a good client takes.
    nominal_duration: Duration,
    /// Obstacles that have to be there, and where the file says so.
    obstacles: Vec<(String, String)>,
    /// Obstacles that steps bring.
    brought: Vec<String>,
    /// How many faults of each kind have no name.
    unnamed_faults: BTreeMap<&'static str, usize>,
    /// What steps remember.
    saved: Vec<Saved>,
    /// What they would remember if it made sense.
    not_saved: Vec<String>,
    left_out: LeftOut,
    problems: Problems<'a>,
}

impl Checker<'_> {
    /// Conditions call devices by their names, so these must not be mistaken for others.
    fn check_device_names(&mut self) {
        let mut seen = BTreeMap::new();
        for (name, _) in &self.devices {
            let identified = identifier(name);
            let group = self
                .rig
                .settings
                .table()
                .iter()
                .flat_map(|device| device.all_names())
                .any(|info| info.name.split('.').next() == Some(identified.as_str()));
            let why = if identified.starts_with(|first: char| first.is_ascii_digit())
                || ["t", "saved", "param"].contains(&identified.as_str())
                || group
            {
                Some(format!("in a scenario no device can be named \"{name}\""))
            } else {
                seen.insert(identified, *name)
                    .map(|other| format!("conditions cannot tell \"{name}\" from \"{other}\""))
            };
            if let Some(why) = why {
                self.problems.add_to_file(&why);
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

    fn collect_names(&mut self, steps: &[Spanned<StepText>]) {
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
        let speaks_of =
            |(name, _): &&(String, Put)| text.get_ref().contains(&format!("param.{name}"));
        if let (Err(_), Some((_, put))) = (&condition, self.text_parameters.iter().find(speaks_of))
        {
            self.problems.comes_from(text.span().start, put.clone());
        }
        let not_saved = |name: &String| text.get_ref().contains(&format!("saved.{name}"));
        if condition.is_err() && self.not_saved.iter().any(not_saved) {
            // That what it speaks of makes no sense has been reported.
            return None;
        }
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

    /// What steps and conditions wait for has to come.
    fn check_order(
        &mut self,
        steps: &[Option<Step>],
        texts: &[Spanned<StepText>],
        rules: &[(Rule, Option<Range<usize>>)],
    ) {
        let mut waits = Vec::new();
        for (index, (step, text)) in steps.iter().zip(texts).enumerate() {
            let Some(step) = step else { continue };
            let at = text.get_ref().after.as_ref().map(Spanned::span);
            if let (Trigger::After(other), Some(at)) = (&step.trigger, at) {
                waits.push((*other, at.clone()));
                if comes_back(steps, index) {
                    let why = "the steps wait for one another in a circle";
                    self.problems.add(at, why);
                }
            }
        }
        let of_rules = rules
            .iter()
            .filter_map(|(rule, at)| Some((rule.after?, at.clone()?)));
        waits.extend(of_rules);
        for (other, at) in waits {
            // What ends it may be what was left out.
            let is_whole = self.left_out.is_whole(texts[other].span().start);
            if let Some(step) = steps[other]
                .as_ref()
                .filter(|step| is_whole && step.is_endless())
            {
                let why = format!(
                    "\"{}\" is repeated without end, so it is never done",
                    step.name
                );
                self.problems.add(at, &why);
            }
        }
    }
}

/// Returns whether following what a step waits for leads back to it.
fn comes_back(steps: &[Option<Step>], start: usize) -> bool {
    let mut at = start;
    for _ in 0..steps.len() {
        match steps[at].as_ref().map(|step| &step.trigger) {
            Some(Trigger::After(other)) if *other == start => return true,
            Some(Trigger::After(other)) => at = *other,
            _ => return false,
        }
    }
    false
}
