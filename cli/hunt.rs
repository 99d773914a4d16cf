//! The `hunt` subcommand: searches for the smallest schedule of faults that makes a client break a rule.
//!
//! Every schedule is an ordinary scenario file based on the job, and is played as `sim run` plays it. Each
//! round is planned before it is played, so the result does not depend on how many are played at a time.

mod attribution;
mod moments;
mod player;
mod report;
mod shrink;
mod space;

use std::collections::{BTreeMap, BTreeSet};
use std::ffi::OsString;
use std::fs;
use std::io::IsTerminal as _;

use anyhow::{Context as _, anyhow};
use clap::{Args as _, FromArgMatches as _};
use rigsim_core::device::Devices;
use rigsim_core::effect::catalogue;
use rigsim_core::noise::Noise;
use rigsim_settings::nearest;
use serde::Serialize;

use crate::args::{GivenArgs, HuntArgs, RunArgs, TimeArg};
use crate::config;
use crate::exit::{Exit, Failure};
use crate::print::complain;
use crate::recording;
use crate::scenario_files::{Given, Loaded, find, load_all};
use crate::visible;

use moments::{Moment, Samples};
use player::{Player, Seen, digest, records};
use space::{DURATIONS, Fault, Frame, Kind, kinds, rules_of};

/// Runs of a round. What is played next depends on whole rounds only.
const ROUND: usize = 16;
/// Most files of one rule.
const MOST_OF_RULE: usize = 3;
/// Seeds with which a finding is played.
const SEEDS: u64 = 20;
/// Shares of the budget, in percent: single faults, refinement, second faults; the rest is random.
const SHARES: [u32; 3] = [40, 15, 30];
/// How a client's end with a code begins. It may give up so where a fault lasts longer than this.
const GAVE_UP: &str = "the client ended with exit code";
const GIVE_UP_MS: u64 = 300;
/// Most schedules that are refined, or to which second faults are added.
const MOST_FIRST: usize = 200;

/// The `hunt` subcommand.
pub(crate) fn hunt(devices: Devices, args: &HuntArgs) -> Result<Exit, Failure> {
    if args.time == TimeArg::Real {
        return Err(Failure::usage(anyhow!(
            "a hunt plays the same run again and again, which real time never is; leave --time real out"
        )));
    }
    let known: Vec<&str> = catalogue(devices).iter().map(|info| info.id).collect();
    if let Some(unknown) = args.faults.iter().find(|id| !known.contains(&id.as_str())) {
        let near = nearest(unknown, known);
        let hint = near.map_or_else(String::new, |near| format!(", did you mean {near}?"));
        return Err(Failure::usage(anyhow!(
            "--faults: there is no fault or action {unknown}{hint}; `sim faults` lists them"
        )));
    }
    fs::create_dir_all(&args.output)
        .with_context(|| format!("cannot make the folder {}", visible::name(&args.output)))
        .map_err(Failure::usage)?;
    let none = GivenArgs::default();
    let base = config::load_file(devices, &args.settings)?;
    let given = Given::new(base, &none, &args.settings.set)?;
    let jobs = load_all(&given, &find(&args.jobs, None)?)?;
    let mut rules = String::new();
    for path in &args.rules {
        let text = config::read(path, "file of rules")?;
        rules += &rules_of(&text)
            .with_context(|| visible::name(path))
            .map_err(Failure::usage)?;
    }
    let threads = args.threads.map_or_else(
        || std::thread::available_parallelism().map_or(1, usize::from),
        |threads| threads as usize,
    );
    let mut summary = report::Summary::new(args);
    for (number, job) in jobs.iter().enumerate() {
        let frame = Frame::new(&job.path, &job.scenario.title, &args.output, rules.clone());
        let mut all = kinds(&job.scenario, &args.faults);
        let identity = identity(args, job, &rules);
        let folder = match jobs.len() {
            1 => args.output.clone(),
            _ => args.output.join(format!("job-{}", number + 1)),
        };
        fs::create_dir_all(&folder).map_err(Failure::usage)?;
        let frame = match jobs.len() {
            1 => frame,
            _ => Frame::new(&job.path, &job.scenario.title, &folder, rules.clone()),
        };
        let player = Player::new(
            run_args(args, &args.client)?,
            &given,
            &folder,
            threads,
            identity,
        )?;
        // What this vehicle cannot have.
        for kind in &mut all {
            let fits = |value: &String| {
                let fault = Fault {
                    action: format!("{} = {value}", kind.key),
                    ..kind.fault(0, "at = \"1 s\"", Some(50))
                };
                player.load(&frame.document(&[fault], "", None)).is_some()
            };
            let values = kind
                .values
                .iter()
                .filter(|value| fits(value))
                .cloned()
                .collect();
            kind.values = values;
        }
        all.retain(|kind| !kind.values.is_empty());
        if all.is_empty() {
            return Err(Failure::usage(anyhow!(
                "{} has none of these kinds of faults; `sim faults` lists them",
                job.name()
            )));
        }
        let share = args.runs / u32::try_from(jobs.len()).unwrap_or(1).max(1);
        let mut hunt = Hunt {
            devices,
            args,
            given: &given,
            job,
            frame,
            kinds: all,
            moments: Vec::new(),
            player,
            folder,
            budget: u64::from(share.max(1)),
            spent: 0,
            tried: Vec::new(),
            sent: BTreeSet::new(),
            noise: Noise::new(args.seed, "hunt"),
            found: Vec::new(),
            per_rule: BTreeMap::new(),
            unavoidable: BTreeMap::new(),
            bar: bar(u64::from(share)),
            counts: Counts::default(),
        };
        hunt.search()?;
        hunt.bar.finish_and_clear();
        summary.add(&hunt)?;
    }
    summary.finish()
}

/// What a hunt depends on.
fn identity(args: &HuntArgs, job: &Loaded, rules: &str) -> u64 {
    let mut text = format!(
        "{} {} {} {:?} {:?} {rules}",
        env!("CARGO_PKG_VERSION"),
        args.seed,
        job.path.display(),
        args.client,
        args.settings.set,
    );
    let words = args.client.iter().map(std::path::PathBuf::from);
    for path in words
        .chain([job.path.clone()])
        .filter(|path| path.is_file())
    {
        text += &format!(" {:x}", digest(&fs::read(path).unwrap_or_default()));
    }
    digest(text.as_bytes())
}

/// The flags of `sim run` that play a file of a hunt.
fn run_args(args: &HuntArgs, client: &[OsString]) -> Result<RunArgs, Failure> {
    let mut words: Vec<OsString> = vec!["--seed".into(), args.seed.to_string().into()];
    for set in &args.settings.set {
        words.extend(["--set".into(), set.into()]);
    }
    if let Some(config) = &args.settings.config {
        words.extend(["--config".into(), config.into()]);
    }
    words.extend(["job".into(), "--".into()]);
    words.extend(client.iter().cloned());
    let command = RunArgs::augment_args(clap::Command::new("run").no_binary_name(true));
    let matches = command
        .try_get_matches_from(words)
        .map_err(Failure::usage)?;
    RunArgs::from_arg_matches(&matches).map_err(Failure::usage)
}

/// A bar on a terminal, and nothing elsewhere.
fn bar(runs: u64) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(runs);
    let form = "{bar:30} {pos}/{len} runs, {msg}, {eta} left";
    if let Ok(style) = indicatif::ProgressStyle::with_template(form) {
        bar.set_style(style);
    }
    bar
}

/// A schedule that was played.
struct Tried {
    schedule: Vec<Fault>,
    /// Kind and moment of a single fault, for the map.
    cell: Option<(usize, usize)>,
    seen: Seen,
    /// The client did something that it had not done before.
    is_new: bool,
}

/// How many runs were for what.
#[derive(Debug, Default, Serialize)]
struct Counts {
    single: u64,
    single_without_hit: u64,
    refined: u64,
    second: u64,
    reactions: u64,
    random: u64,
    random_failed: u64,
}

/// Which stage a round belongs to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Stage {
    Single,
    Refined,
    Second,
    Random,
}

/// A finding that was written, or could not be shown to be one.
#[derive(Debug, Serialize)]
struct Found {
    rule: String,
    failure: String,
    faults: Vec<String>,
    file: Option<String>,
    run: u64,
    shrink_runs: u32,
    seeds: u64,
    reference_fails: Option<bool>,
}

struct Hunt<'a> {
    devices: Devices,
    args: &'a HuntArgs,
    given: &'a Given<'a>,
    job: &'a Loaded,
    frame: Frame,
    kinds: Vec<Kind>,
    moments: Vec<Moment>,
    player: Player<'a>,
    folder: std::path::PathBuf,
    budget: u64,
    spent: u64,
    tried: Vec<Tried>,
    /// Digests of what the client sent in some run.
    sent: BTreeSet<u64>,
    noise: Noise,
    found: Vec<Found>,
    /// Kinds of the findings of each rule.
    per_rule: BTreeMap<String, Vec<Vec<String>>>,
    unavoidable: BTreeMap<String, u64>,
    bar: indicatif::ProgressBar,
    counts: Counts,
}

impl Hunt<'_> {
    fn search(&mut self) -> Result<(), Failure> {
        self.nominal()?;
        let until = |percent: u32| self.budget * u64::from(percent) / 100;
        let [single, refined, second] = SHARES;
        let ends = [single, single + refined, single + refined + second, 100].map(until);
        let stages = [Stage::Single, Stage::Refined, Stage::Second, Stage::Random];
        for (stage, end) in stages.into_iter().zip(ends) {
            let mut plan = self.plan(stage);
            while self.spent < end {
                let left = usize::try_from(end - self.spent).unwrap_or(ROUND);
                let round = plan.next(self, left.min(ROUND));
                if round.is_empty() {
                    break;
                }
                self.round(stage, round)?;
            }
        }
        Ok(())
    }

    /// Plays the job twice without faults, and finds its moments.
    fn nominal(&mut self) -> Result<(), Failure> {
        let text = self.frame.document(&[], "", None);
        let seed = self.player.seed();
        if let Err(failure) = load_nominal(&self.folder, &text, self.given) {
            return Err(Failure::usage(
                failure.error.context("the job with these rules"),
            ));
        }
        let one = [(text.clone(), seed)];
        let first = self
            .player
            .play_seeds(&one, true)?
            .remove(0)
            .unwrap_or_default();
        let again = self
            .player
            .play_seeds(&one, true)?
            .remove(0)
            .unwrap_or_default();
        if let Some(why) = first.error {
            return Err(Failure::system(anyhow!(why)));
        }
        if first.trace != again.trace {
            let command = "sim run --twice";
            return Err(Failure::usage(anyhow!(
                "the client did not do the same in two runs without faults, so no search is possible; \
                 `{command}` shows the first difference"
            )));
        }
        if let Some(failure) = first.broken.values().next() {
            return Err(Failure::usage(anyhow!(
                "the client fails without any fault, which has to be mended first: {failure}"
            )));
        }
        self.sent.insert(first.sent);
        self.player.learn(&text)?;
        let devices = self.devices;
        self.moments = self.player.trace(&text, |path, _| {
            let (samples, _) = recording::view(devices, path, |run| Ok(Samples::new(run)))?;
            Ok(samples.moments())
        })?;
        if self.moments.is_empty() {
            self.moments.push(Moment {
                at: 0.0,
                trigger: "at = \"0 s\"".to_owned(),
            });
        }
        complain(&format!(
            "{}: {} kinds of faults at {} moments",
            self.job.name(),
            self.kinds.len(),
            self.moments.len()
        ));
        Ok(())
    }

    /// Plays a round, and looks into what was found.
    fn round(&mut self, stage: Stage, round: Vec<Planned>) -> Result<(), Failure> {
        let texts = round
            .iter()
            .map(|one| self.frame.document(&one.schedule, "", None));
        let results = self.player.play(&texts.collect::<Vec<_>>())?;
        for (planned, seen) in round.into_iter().zip(results) {
            self.spent += 1;
            let seen = seen.unwrap_or_default();
            let is_new = self.sent.insert(seen.sent);
            let hit = seen.hit.iter().take(planned.schedule.len()).any(|hit| *hit);
            match stage {
                Stage::Single => {
                    self.counts.single += 1;
                    self.counts.single_without_hit += u64::from(!hit);
                }
                Stage::Refined => self.counts.refined += 1,
                Stage::Second => self.counts.second += 1,
                Stage::Random => {
                    self.counts.random += 1;
                    self.counts.random_failed += u64::from(!seen.broken.is_empty());
                }
            }
            let broken = seen.broken.clone();
            let run = self.spent;
            self.tried.push(Tried {
                schedule: planned.schedule.clone(),
                cell: planned.cell,
                seen,
                is_new: is_new && hit,
            });
            for (key, failure) in broken {
                self.look_into(run, &planned.schedule, &key, &failure)?;
            }
        }
        let nearest = self.tried.iter().filter_map(|tried| tried.seen.nearest());
        let nearest = nearest
            .map(|(_, margin)| margin)
            .fold(f64::INFINITY, f64::min);
        self.bar.set_position(self.spent);
        self.bar.set_message(format!(
            "{} found, nearest margin {nearest:.3}",
            self.found.len()
        ));
        Ok(())
    }

    /// Attributes a broken rule, makes the schedule smaller, and writes it.
    fn look_into(
        &mut self,
        run: u64,
        schedule: &[Fault],
        key: &str,
        failure: &str,
    ) -> Result<(), Failure> {
        let ids = |schedule: &[Fault]| {
            let mut ids: Vec<String> = schedule.iter().map(|fault| fault.kind.clone()).collect();
            ids.sort();
            ids
        };
        let known = self.per_rule.entry(key.to_owned()).or_default();
        let contains = |one: &Vec<String>| one.iter().all(|id| ids(schedule).contains(id));
        if known.len() >= MOST_OF_RULE || known.iter().any(contains) {
            return Ok(());
        }
        let lasts = |fault: &Fault| fault.lasts.is_none_or(|lasts| lasts > GIVE_UP_MS);
        if key.starts_with(GAVE_UP) && schedule.iter().any(lasts) {
            *self.unavoidable.entry(key.to_owned()).or_default() += 1;
            return Ok(());
        }
        let text = self.frame.document(schedule, "", None);
        let seed = self.player.seed();
        let is_client = ["the client", "it was still"]
            .iter()
            .any(|own| key.starts_with(own));
        let unavoidable = !is_client
            && self.player.trace(&text, |path, loaded| {
                attribution::is_unavoidable(loaded, &records(path), schedule.len(), seed, key)
            })?;
        if unavoidable {
            *self.unavoidable.entry(key.to_owned()).or_default() += 1;
            return Ok(());
        }
        let words: Vec<String> = schedule.iter().map(Fault::words).collect();
        complain(&format!(
            "found in run {run}: {failure}\n  {}",
            words.join("\n  ")
        ));
        let most = self.args.shrink_runs;
        let shrunk = shrink::shrink(
            &mut self.player,
            &self.frame,
            &self.kinds,
            schedule,
            key,
            most,
        )?;
        if let Some(known) = self.per_rule.get_mut(key) {
            known.push(ids(&shrunk.schedule));
        }
        let number = self.per_rule[key].len();
        let found = self.write(run, key, failure, &shrunk, number)?;
        self.found.push(found);
        Ok(())
    }

    fn write(
        &mut self,
        run: u64,
        key: &str,
        failure: &str,
        shrunk: &shrink::Shrunk,
        number: usize,
    ) -> Result<Found, Failure> {
        let words: Vec<String> = shrunk.schedule.iter().map(Fault::words).collect();
        let plain = self.frame.document(&shrunk.schedule, "", None);
        let seed = self.player.seed();
        let seeds: Vec<(String, u64)> = (0..SEEDS)
            .map(|more| (plain.clone(), seed.wrapping_add(more)))
            .collect();
        let results = self.player.play_seeds(&seeds, false)?;
        let breaks = |seen: &&Option<Seen>| {
            seen.as_ref()
                .is_some_and(|seen| seen.broken.contains_key(key))
        };
        let fails = results.iter().filter(breaks).count() as u64;
        let reference_fails = match &self.args.reference {
            Some(command) => Some(self.reference(command, &plain, key)?),
            None => None,
        };
        let cut = if shrunk.is_cut {
            "; the budget of --shrink-runs ended before"
        } else {
            ""
        };
        let reference = match reference_fails {
            Some(true) => "# The reference client fails, too.\n",
            Some(false) => "# The reference client passes.\n",
            None => "",
        };
        let head = format!(
            "# Found by sim hunt in run {run}, made smaller in {} runs{cut}.\n# Fails with {fails} of {SEEDS} \
             seeds from {seed} on.\n{reference}",
            shrunk.runs
        );
        let title = format!("{} breaks a rule", ids_in_words(&shrunk.schedule));
        let description = format!("{}. Then {key}.", words.join("; "));
        let text = self
            .frame
            .document(&shrunk.schedule, &head, Some((&title, &description)));
        let twice = [(text.clone(), seed), (text.clone(), seed)];
        let mut traces = Vec::new();
        for one in &twice {
            let seen = self
                .player
                .play_seeds(std::slice::from_ref(one), true)?
                .remove(0);
            traces.push(
                seen.filter(|seen| seen.broken.contains_key(key))
                    .map(|seen| seen.trace),
            );
        }
        let is_same = traces[0].is_some() && traces[0] == traces[1];
        let file = is_same.then(|| format!("{}-{number}.toml", report::slug(key)));
        if let Some(file) = &file {
            let path = self.folder.join(file);
            fs::write(&path, text)
                .with_context(|| format!("cannot write {}", visible::name(&path)))
                .map_err(Failure::usage)?;
            complain(&format!("  {}: {}", visible::name(&path), words.join("; ")));
        } else {
            complain("  it could not be played twice with the same result, and is not written");
        }
        Ok(Found {
            rule: key.to_owned(),
            failure: failure.to_owned(),
            faults: words,
            file,
            run,
            shrink_runs: shrunk.runs,
            seeds: fails,
            reference_fails,
        })
    }

    /// Returns whether the reference client breaks the rule as well.
    fn reference(&self, command: &str, text: &str, key: &str) -> Result<bool, Failure> {
        let words: Vec<OsString> = ["sh", "-c", command].map(OsString::from).into();
        let args = run_args(self.args, &words)?;
        let scratch = tempfile::tempdir().map_err(Failure::system)?;
        let mut player = Player::new(args, self.given, scratch.path(), 1, 0)?;
        // What it is based on is found from the folder of the hunt.
        player.see_from(&self.folder);
        let seen = player.play(&[text.to_owned()])?.remove(0);
        Ok(seen.is_some_and(|seen| seen.broken.contains_key(key)))
    }
}

fn load_nominal(
    folder: &std::path::Path,
    text: &str,
    given: &Given<'_>,
) -> Result<Loaded, Failure> {
    crate::scenario_files::load_text(&folder.join("hunt.toml"), text, given)
}

fn ids_in_words(schedule: &[Fault]) -> String {
    let ids: Vec<&str> = schedule.iter().map(|fault| fault.kind.as_str()).collect();
    ids.join(" and ")
}

/// A schedule that is to be played.
struct Planned {
    schedule: Vec<Fault>,
    cell: Option<(usize, usize)>,
}

/// What a stage plays next.
enum Plan {
    /// Schedules in this order.
    Fixed(std::vec::IntoIter<Planned>),
    /// Second faults at the moments of reaction.
    Second {
        trials: BTreeMap<usize, (f64, f64)>,
    },
    Random,
}

impl Plan {
    /// The next schedules, at most so many.
    fn next(&mut self, hunt: &mut Hunt<'_>, most: usize) -> Vec<Planned> {
        match self {
            Self::Fixed(all) => all.take(most).collect(),
            Self::Second { trials } => hunt.second_faults(trials, most),
            Self::Random => (0..most).map(|_| hunt.random_schedule()).collect(),
        }
    }
}

impl Hunt<'_> {
    fn plan(&mut self, stage: Stage) -> Plan {
        match stage {
            Stage::Single => Plan::Fixed(self.single_faults().into_iter()),
            Stage::Refined => Plan::Fixed(self.refinements().into_iter()),
            Stage::Second => Plan::Second {
                trials: BTreeMap::new(),
            },
            Stage::Random => Plan::Random,
        }
    }

    /// Every kind once before any kind twice.
    fn single_faults(&mut self) -> Vec<Planned> {
        let mut columns = Vec::new();
        for (index, kind) in self.kinds.iter().enumerate() {
            let mut all = Vec::new();
            for value in 0..kind.values.len() {
                for lasts in DURATIONS {
                    for (at, moment) in self.moments.iter().enumerate() {
                        all.push(Planned {
                            schedule: vec![kind.fault(value, &moment.trigger, lasts)],
                            cell: Some((index, at)),
                        });
                    }
                }
            }
            for last in (1..all.len()).rev() {
                let other = below(&mut self.noise, last + 1);
                all.swap(last, other);
            }
            columns.push(all);
        }
        let most = columns.iter().map(Vec::len).max().unwrap_or(0);
        let mut rows: Vec<Planned> = Vec::new();
        for _ in 0..most {
            rows.extend(columns.iter_mut().filter_map(Vec::pop));
        }
        rows
    }

    /// Schedules between those that came nearest to each rule and their neighbours.
    fn refinements(&mut self) -> Vec<Planned> {
        let mut nearest: BTreeMap<&str, Vec<(f64, usize)>> = BTreeMap::new();
        for (index, tried) in self.tried.iter().enumerate() {
            if !tried.seen.broken.is_empty() || !tried.is_new {
                continue;
            }
            for (rule, margin) in &tried.seen.margins {
                nearest.entry(rule).or_default().push((*margin, index));
            }
        }
        let mut columns = Vec::new();
        for all in nearest.into_values() {
            let mut all = all;
            all.sort_by(|one, other| one.0.total_cmp(&other.0).then(one.1.cmp(&other.1)));
            let firsts = all.into_iter().take(MOST_FIRST).map(|(_, index)| index);
            let more = firsts.flat_map(|index| self.neighbours(&self.tried[index]));
            let mut more: Vec<Planned> = more.collect();
            more.reverse();
            columns.push(more);
        }
        let mut rows = Vec::new();
        while columns
            .iter()
            .any(|column: &Vec<Planned>| !column.is_empty())
        {
            rows.extend(columns.iter_mut().filter_map(Vec::pop));
        }
        rows
    }

    /// The same fault half-way to the moments beside it, longer and shorter, and with other parameters.
    fn neighbours(&self, tried: &Tried) -> Vec<Planned> {
        let [fault] = &tried.schedule[..] else {
            return Vec::new();
        };
        let mut all = Vec::new();
        let mut add = |fault: Fault| {
            let (schedule, cell) = (vec![fault], None);
            all.push(Planned { schedule, cell });
        };
        if let Some(Some(begun)) = tried.seen.begun.first() {
            let before = self
                .moments
                .iter()
                .rev()
                .find(|moment| moment.at < begun - 0.05);
            let behind = self.moments.iter().find(|moment| moment.at > begun + 0.05);
            for moment in before.into_iter().chain(behind) {
                for share in [0.5, 0.25, 0.75] {
                    let at = begun + (moment.at - begun) * share;
                    let trigger = at_time(at);
                    add(Fault {
                        trigger,
                        ..fault.clone()
                    });
                }
            }
        }
        for lasts in [120, 700, 1200] {
            add(Fault {
                lasts: Some(lasts),
                ..fault.clone()
            });
        }
        all
    }

    /// Faults at the moments of reaction to a first one; kinds that led to something new are tried more.
    fn second_faults(
        &mut self,
        trials: &mut BTreeMap<usize, (f64, f64)>,
        most: usize,
    ) -> Vec<Planned> {
        if self.args.max_faults < 2 {
            return Vec::new();
        }
        // What was learnt from the rounds before.
        for tried in self.tried.iter().filter(|tried| tried.schedule.len() == 2) {
            let second = &tried.schedule[1];
            let kind = self.kinds.iter().position(|kind| kind.id == second.kind);
            let (plays, gains) = trials.entry(kind.unwrap_or(0)).or_insert((1.0, 1.0));
            *plays += 1.0;
            *gains += f64::from(u8::from(tried.is_new));
        }
        let mut firsts: Vec<usize> = (0..self.tried.len())
            .filter(|index| {
                let tried = &self.tried[*index];
                tried.is_new
                    && tried.schedule.len() == 1
                    && tried.seen.broken.is_empty()
                    && !tried.seen.reactions.is_empty()
            })
            .collect();
        firsts.truncate(MOST_FIRST);
        if firsts.is_empty() {
            return Vec::new();
        }
        let reactions = firsts
            .iter()
            .map(|index| self.tried[*index].seen.reactions.len() as u64);
        self.counts.reactions = reactions.sum();
        let mut all = Vec::new();
        for _ in 0..most {
            let first = firsts[below(&mut self.noise, firsts.len())];
            let mut best = (f64::NEG_INFINITY, 0);
            for kind in 0..self.kinds.len() {
                let (plays, gains) = trials.get(&kind).copied().unwrap_or((1.0, 1.0));
                let score = gains / plays + self.noise.uniform();
                if score > best.0 {
                    best = (score, kind);
                }
            }
            let times = self.tried[first].seen.reactions.clone();
            let at = times[below(&mut self.noise, times.len())];
            let kind = self.kinds[best.1].clone();
            let fault = self.any_of(&kind, &at_time(at));
            let mut schedule = self.tried[first].schedule.clone();
            schedule.push(fault);
            all.push(Planned {
                schedule,
                cell: None,
            });
        }
        all
    }

    /// Some faults of a random half of the kinds, at random times.
    fn random_schedule(&mut self) -> Planned {
        let end = self
            .tried
            .iter()
            .map(|tried| tried.seen.ended)
            .fold(1.0, f64::max);
        let all = self.kinds.len();
        let half: Vec<usize> = (0..all).filter(|_| self.noise.uniform() < 0.5).collect();
        let count = 1 + below(&mut self.noise, self.args.max_faults as usize);
        let schedule = (0..count).map(|_| {
            let pick = below(&mut self.noise, half.len().max(1));
            let kind = self.kinds[half.get(pick).copied().unwrap_or(0)].clone();
            let at = self.noise.uniform() * end;
            self.any_of(&kind, &at_time(at))
        });
        Planned {
            schedule: schedule.collect(),
            cell: None,
        }
    }

    fn any_of(&mut self, kind: &Kind, trigger: &str) -> Fault {
        let value = below(&mut self.noise, kind.values.len());
        let lasts = DURATIONS[below(&mut self.noise, DURATIONS.len())];
        kind.fault(value, trigger, lasts)
    }
}

/// A whole number below `end`.
fn below(noise: &mut Noise, end: usize) -> usize {
    noise.below(u32::try_from(end).unwrap_or(u32::MAX).max(1)) as usize
}

fn at_time(seconds: f64) -> String {
    format!("at = \"{} ms\"", (seconds * 1e3).round().max(0.0))
}
