//! The search: stages propose schedules, and one loop plays them.

use std::collections::{BTreeMap, BTreeSet};

use anyhow::{Error, anyhow};
use indicatif::ProgressBar;
use rigsim_core::SimTime;
use rigsim_core::device::Devices;
use rigsim_core::noise::Noise;
use rigsim_runner::RunOptions;
use serde::Serialize;

use crate::args::{HuntArgs, StageArg};
use crate::digest::digest;
use crate::exit::Failure;
use crate::print::{complain, progress};
use crate::recording;
use crate::run::client_output;
use crate::scenario_files::Loaded;

use super::moments::{Moment, Samples};
use super::player::{Broken, MOST_FAULTS, Player, Seen, records};
use super::space::{FOR_GOOD, Fault, Frame, Kind, Trigger, counted, kinds, step_name};

/// Most runs in a round. The choice of the next runs depends on complete rounds only.
const ROUND: u64 = 16;
/// The stages with their shares of the runs.
const STAGES: [(StageArg, u64); 3] = [
    (StageArg::Single, 40),
    (StageArg::Further, 30),
    (StageArg::Random, 15),
];
/// Most attempts to find a schedule that was not played before.
const MOST_REPEATS: usize = 20;
/// Time between two single faults of a run, ms.
const PAUSE: u64 = 500;
/// Weight of a choice that has led to nothing new; one that always does has weight 1.
const LEAST_WEIGHT: f64 = 0.5;

/// A schedule to be played.
#[derive(Default)]
pub(super) struct Planned {
    pub(super) schedule: Vec<Fault>,
    /// Kind, form and moment of each fault, if they are single ones.
    pub(super) cells: Vec<(usize, usize, usize)>,
    /// Set if the client had ended before it began, in a run with others.
    was_late: bool,
    /// Class of the reactions that it follows up, and kind of the last fault.
    follows: Option<(u64, usize)>,
}

/// A schedule, and the times at which the client reacted to it.
type First = (Vec<Fault>, Vec<u64>);

/// A schedule that was played.
pub(super) struct Tried {
    pub(super) planned: Planned,
    pub(super) seen: Seen,
    /// Each of its single faults by itself, if they broke a rule together.
    pub(super) alone: Vec<Seen>,
}

impl Tried {
    /// What is known of a fault of it, and whether that hit something.
    pub(super) fn of(&self, index: usize) -> (&Seen, bool) {
        let alone = self.alone.get(index);
        let (seen, index) = alone.map_or((&self.seen, index), |seen| (seen, 0));
        (seen, seen.hit.get(index) == Some(&true))
    }
}

/// Number of tries, and number of those that led to something new.
#[derive(Clone, Copy, Default)]
struct Arm {
    plays: f64,
    gains: f64,
}

impl Arm {
    fn weight(self) -> f64 {
        LEAST_WEIGHT + self.gains / self.plays.max(1.0)
    }

    /// The lowest is next, so that each is tried in proportion to its weight.
    fn turn(self) -> f64 {
        self.plays / self.weight()
    }
}

/// Single faults of a kind that are still to be tried, and the results of those before.
#[derive(Default)]
struct Column {
    left: Vec<Planned>,
    arm: Arm,
    /// Form, moment and duration of those that hit nothing.
    idle: Vec<(usize, usize, u64)>,
    /// Tries as a further fault.
    further: Arm,
}

/// Number of runs of a stage.
#[derive(Clone, Copy, Default, Serialize)]
pub(super) struct Count {
    pub(super) runs: u64,
    pub(super) without_hit: u64,
    pub(super) without_verdict: u64,
    /// Those in which the client broke a rule, and those in which it could not have kept it.
    pub(super) failed: u64,
    pub(super) unavoidable: u64,
}

/// What is known of a job and a client.
#[derive(Default)]
pub(super) struct State {
    pub(super) kinds: Vec<Kind>,
    pub(super) moments: Vec<Moment>,
    pub(super) spent: u64,
    pub(super) tried: Vec<Tried>,
    /// Without faults.
    pub(super) usual: Seen,
    /// Smallest margin of each rule that came nearer than without faults.
    nearest: BTreeMap<String, f64>,
    /// Digests of the schedules that were played, and of the client's messages.
    planned: BTreeSet<u64>,
    sent: BTreeSet<u64>,
    columns: Vec<Column>,
    /// Schedules to follow up, by the class of the reactions.
    firsts: BTreeMap<u64, (Vec<First>, Arm)>,
    pub(super) found: Vec<Found>,
    /// Kinds that broke each rule, as found and as reduced.
    pub(super) per_rule: BTreeMap<String, Vec<Vec<String>>>,
    /// By key: the rule in words, and how often.
    pub(super) unavoidable: BTreeMap<String, (String, u64)>,
    pub(super) counts: BTreeMap<StageArg, Count>,
}

/// A finding that was written, or a failure that is not repeatable.
#[derive(Debug, Serialize)]
pub(super) struct Found {
    pub(super) rule: String,
    /// Identifies the same failure of other runs.
    #[serde(skip)]
    pub(super) key: String,
    pub(super) failure: String,
    pub(super) faults: Vec<String>,
    pub(super) file: Option<String>,
    pub(super) run: u64,
    pub(super) shrink_runs: u64,
    pub(super) seeds: u64,
    /// For each fault, in ms: how much earlier and later it may begin.
    pub(super) window_ms: Vec<[u64; 2]>,
    /// Comments at the beginning of its file.
    #[serde(skip)]
    pub(super) head: String,
    #[serde(skip)]
    pub(super) schedule: Vec<Fault>,
}

impl State {
    /// The findings that are repeatable.
    pub(super) fn written(&self) -> impl Iterator<Item = &Found> {
        self.found.iter().filter(|found| found.file.is_some())
    }

    /// Why there is no verdict, if no run of the search has one.
    pub(super) fn unjudged(&self) -> Option<&str> {
        let mut errors = self.tried.iter().map(|tried| tried.seen.error.as_deref());
        let first = errors.next()??;
        errors.all(|error| error.is_some()).then_some(first)
    }
}

pub(super) struct Hunt<'a> {
    pub(super) devices: Devices,
    pub(super) args: &'a HuntArgs,
    pub(super) job: &'a Loaded,
    pub(super) frame: Frame,
    pub(super) player: Player<'a>,
    pub(super) reference: Option<Player<'a>>,
    pub(super) budget: u64,
    pub(super) noise: Noise,
    pub(super) bar: ProgressBar,
    pub(super) state: State,
}

impl Hunt<'_> {
    /// Plays the job twice without faults, finds its moments, and the faults that its devices can have.
    pub(super) fn begin(&mut self) -> Result<(), Failure> {
        let usage = |why| Err(Failure::usage(why));
        let name = self.job.name();
        let run = self.job.run(RunOptions::scripted(self.player.seed))?;
        let mut names = (0..MOST_FAULTS).map(step_name);
        if let Some(step) = names.find(|step| run.step_named(step).is_some()) {
            return usage(anyhow!(
                "{name} has a step \"{step}\", as the faults of a hunt are named, which would replace it; rename it"
            ));
        }
        let text = self.frame.document(&[]);
        self.player.check(&text, "the job with these rules")?;
        let first = without_faults(&mut self.player, self.job, &text, "", Failure::system)?;
        let again = self.player.play_again(&text)?;
        if first.trace != again.trace {
            let differs = self.player.difference(&text)?;
            let differs = differs.map_or_else(String::new, |differs| format!(": {differs}"));
            let twice = self.player.command(&text, &self.job.path)?;
            let twice = twice.replacen("run", "run --twice", 1);
            return usage(anyhow!(
                "the client did not do the same in two runs without faults, so no search is possible{differs}; \
                 `{twice}` plays it so"
            ));
        }
        if let Some(reference) = &mut self.reference {
            without_faults(reference, self.job, &text, "--reference: ", Failure::usage)?;
        }
        let (records, samples) = self.player.trace(&text, |case, _, _| {
            let path = case.recording().unwrap_or_default();
            let (samples, _) = recording::view(self.devices, &path, |run| Ok(Samples::new(run)))?;
            Ok((records(case), samples))
        })?;
        self.player.learn(&records);
        let mut all = kinds(&self.job.scenario, &self.args.faults, &samples.sent());
        for kind in &mut all {
            kind.retain(|fault| self.can_have(fault));
        }
        all.retain(|kind| !kind.forms.is_empty());
        if all.is_empty() {
            return usage(anyhow!(
                "{name} has none of these kinds of faults; `sim faults` lists them"
            ));
        }
        let rules = first.margins.len();
        let state = &mut self.state;
        state.sent.insert(first.sent);
        state.kinds = all;
        state.moments = samples.moments(first.ended);
        state.usual = first;
        let (kinds, moments) = (state.kinds.len(), state.moments.len());
        self.state.columns = (0..kinds).map(|kind| self.column(kind)).collect();
        complain(&format!(
            "{name}: {} of faults at {}, {} judged",
            counted(kinds, "kind"),
            counted(moments, "moment"),
            counted(rules, "rule"),
        ));
        if rules == 0 {
            complain(
                "  only the client's end is judged, and the job's client_report if it has one; --rules adds rules, \
                 of which those with `mission = true` do not count",
            );
        }
        Ok(())
    }

    /// Returns whether the devices of the job can have a fault. It asks running devices, which refuse some faults.
    fn can_have(&self, fault: Fault) -> bool {
        let options = RunOptions {
            live: true,
            ..RunOptions::scripted(self.player.seed)
        };
        let text = self.frame.document(&[fault]);
        let run = self
            .player
            .load(&text)
            .and_then(|loaded| loaded.run(options));
        run.is_ok_and(|mut run| {
            let begins = run.step(SimTime::from_nanos(1)).is_ok();
            let added = Some(step_name(0));
            begins
                && run
                    .end()
                    .failures
                    .iter()
                    .all(|failure| failure.step != added)
        })
    }

    /// The single faults of a kind, the next one last. Every moment comes once before any comes twice.
    fn column(&mut self, kind: usize) -> Column {
        let forms = self.state.kinds[kind].forms.iter().enumerate();
        let ways = forms.flat_map(|(form, of)| of.lasts.iter().map(move |lasts| (form, *lasts)));
        let mut ways: Vec<_> = ways.collect();
        let mut moments: Vec<_> = self.state.moments.iter().enumerate().collect();
        shuffle(&mut self.noise, &mut ways);
        shuffle(&mut self.noise, &mut moments);
        let mut left = Vec::new();
        for shift in 0..ways.len() {
            for (index, (at, moment)) in moments.iter().enumerate() {
                let (form, lasts) = ways[(index + shift) % ways.len()];
                let trigger = moment.trigger.clone();
                left.push(Planned {
                    schedule: vec![self.state.kinds[kind].fault(form, trigger, lasts)],
                    cells: vec![(kind, form, *at)],
                    ..Planned::default()
                });
            }
        }
        left.reverse();
        Column {
            left,
            ..Column::default()
        }
    }

    /// Number of reactions that may be followed up.
    pub(super) fn reactions(&self) -> usize {
        let members = self.state.firsts.values().flat_map(|(members, _)| members);
        members.map(|(_, reactions)| reactions.len()).sum()
    }

    /// Keeps other hunts out of the folder, and goes on with an aborted one.
    pub(super) fn keep_journal(&mut self) -> Result<(), Failure> {
        let text = self.frame.document(&[]);
        self.player.keep_journal(&text, &self.state.usual)
    }

    /// Plays rounds of the stages until the budget is spent or nothing is left.
    pub(super) fn search(&mut self) -> Result<(), Failure> {
        let form = "{bar:30} {pos}/{len} runs, {eta} left, {msg}";
        self.bar = progress(self.budget, form);
        let asked = &self.args.stages;
        let mut stages = STAGES.to_vec();
        stages.retain(|(stage, _)| asked.is_empty() || asked.contains(stage));
        while self.state.spent < self.budget && !self.is_enough() {
            // Each stage has a share of a small budget, too.
            let most = (self.budget / 8).clamp(1, ROUND);
            let most = most.min(self.budget - self.state.spent);
            // Every kind once before anything else; then each stage in proportion to its share.
            let columns = &self.state.columns;
            let is_first = columns.iter().any(|column| column.arm.plays == 0.0);
            let counts = &self.state.counts;
            let runs = |stage: &StageArg| counts.get(stage).map_or(0, |count| count.runs);
            stages.sort_by_key(|(stage, share)| {
                let waits = is_first && *stage != StageArg::Single;
                (waits, runs(stage) * 100 / share)
            });
            let mut round = Vec::new();
            let next = stages.iter().find(|(stage, _)| {
                round = self.propose(*stage, most);
                !round.is_empty()
            });
            let Some((stage, _)) = next else { break };
            self.round(*stage, round)?;
            let found = self.state.written().count();
            let all = self
                .state
                .nearest
                .iter()
                .filter(|(_, margin)| **margin > 0.0);
            let nearest = all.min_by(|(_, one), (_, other)| one.total_cmp(other));
            let nearest = nearest.map(|(rule, margin)| format!(", margin {margin:.3} of {rule}"));
            self.bar.set_position(self.state.spent);
            let nearest = nearest.unwrap_or_default();
            self.bar.set_message(format!("{found} found{nearest}"));
        }
        self.bar.finish_and_clear();
        Ok(())
    }

    /// Returns whether a finding ends the search.
    pub(super) fn is_enough(&self) -> bool {
        self.args.fail_fast && self.state.written().next().is_some()
    }

    /// The next schedules of a stage that were not played before.
    fn propose(&mut self, stage: StageArg, most: u64) -> Vec<Planned> {
        let mut round = Vec::new();
        let mut repeats = 0;
        while (round.len() as u64) < most && repeats < MOST_REPEATS {
            let next = match stage {
                StageArg::Single => self.single_faults(),
                StageArg::Further => self.further_fault(),
                StageArg::Random => Some(self.random_schedule()),
            };
            let Some(next) = next else { break };
            let text = self.frame.document(&next.schedule);
            if self.state.planned.insert(digest(text.as_bytes())) {
                round.push(next);
            } else {
                repeats += 1;
            }
        }
        round
    }

    /// Plays a round, updates the weights, and examines failures.
    fn round(&mut self, stage: StageArg, round: Vec<Planned>) -> Result<(), Failure> {
        let texts = round.iter().map(|one| self.frame.document(&one.schedule));
        let results = self.player.play(&texts.collect::<Vec<_>>())?;
        for (planned, seen) in round.into_iter().zip(results) {
            let state = &mut self.state;
            state.spent += 1;
            let run = state.spent;
            self.bar.set_position(run);
            let count = state.counts.entry(stage).or_default();
            count.runs += 1;
            count.without_hit += u64::from(!seen.hits());
            count.without_verdict += u64::from(seen.error.is_some());
            let (broken, schedule) = (seen.broken.clone(), planned.schedule.clone());
            let is_new = |key: &String| !schedule.chunks(1).all(|one| self.is_known(one, key));
            let has_alone = planned.cells.len() > 1 && broken.keys().any(is_new);
            let each = schedule.chunks(1).filter(|_| has_alone);
            let each = each.map(|one| self.frame.document(one));
            let alone = self.player.play(&each.collect::<Vec<_>>())?;
            self.learn(planned, seen, alone);
            let mut is_own = false;
            for (key, how) in &broken {
                // A fault that is known, or that excuses the client, would hide another that is played with it.
                let tried = self.state.tried.last();
                let each = schedule
                    .chunks(1)
                    .zip(tried.iter().flat_map(|tried| &tried.alone));
                let each = each.filter(|(_, seen)| seen.broken.contains_key(key));
                let mut guilty: Vec<&[Fault]> = each.map(|(fault, _)| fault).collect();
                if guilty.is_empty() {
                    guilty.push(&schedule);
                }
                for faults in guilty {
                    is_own |= self.look_into(run, faults, key, how)?;
                }
            }
            let count = self.state.counts.entry(stage).or_default();
            count.failed += u64::from(is_own);
            count.unavoidable += u64::from(!broken.is_empty() && !is_own);
        }
        Ok(())
    }

    fn learn(&mut self, planned: Planned, seen: Seen, alone: Vec<Seen>) {
        let state = &mut self.state;
        let is_new = state.sent.insert(seen.sent) && seen.hits();
        let is_nearer = seen.nearer(&state.usual).next().is_some();
        for (rule, margin) in seen.nearer(&state.usual) {
            let nearest = state.nearest.entry(rule.clone()).or_insert(margin);
            *nearest = nearest.min(margin);
        }
        let gain = f64::from(u8::from(is_new || is_nearer));
        for (index, cell) in planned.cells.iter().enumerate() {
            let fault = &planned.schedule[index];
            let column = &mut state.columns[cell.0];
            let begun = seen.begun.get(index).copied().flatten();
            if index > 0 && begun.is_none_or(|at| at >= seen.ended) {
                column.arm.plays -= 1.0;
                column.left.push(Planned {
                    schedule: vec![fault.clone()],
                    cells: vec![*cell],
                    was_late: true,
                    ..Planned::default()
                });
            } else if seen.hit.get(index) == Some(&true) {
                column.arm.gains += gain;
            } else if index == 0 {
                // The first fault may have removed the target of the second.
                column.idle.push((cell.1, cell.2, fault.lasts));
            }
        }
        if let Some((class, kind)) = planned.follows {
            state.columns[kind].further.gains += gain;
            state.firsts.entry(class).or_default().1.gains += gain;
        }
        let mut firsts = vec![(planned.schedule.clone(), seen.reactions.clone())];
        if !planned.cells.is_empty() {
            let all = planned.schedule.iter().zip(&seen.begun).enumerate();
            firsts = Vec::from_iter(all.map(|(index, (fault, begun))| {
                let until = seen.begun[index + 1].unwrap_or(u64::MAX);
                let during = begun.unwrap_or(u64::MAX)..until;
                let times = seen.reactions.iter().filter(|at| during.contains(at));
                (vec![fault.clone()], times.copied().collect())
            }));
        }
        let most = self.args.max_faults as usize;
        firsts.retain(|(first, times)| first.len() < most && !times.is_empty());
        if is_new && seen.broken.is_empty() && !firsts.is_empty() {
            let (members, _) = state.firsts.entry(seen.class).or_default();
            members.extend(firsts);
        }
        state.tried.push(Tried {
            planned,
            seen,
            alone,
        });
    }

    /// The next single faults: two that do not overlap, if possible. A failure is reduced to the one that causes
    /// it.
    fn single_faults(&mut self) -> Option<Planned> {
        let one = self.single_fault(None)?;
        let other = match self.args.max_faults {
            1 => None,
            _ => self.single_fault(Some(&one)),
        };
        let mut all: Vec<Planned> = [one].into_iter().chain(other).collect();
        all.sort_by_key(|one| self.time_of(one).0);
        Some(Planned {
            cells: all.iter().flat_map(|one| one.cells.clone()).collect(),
            schedule: all.into_iter().flat_map(|one| one.schedule).collect(),
            ..Planned::default()
        })
    }

    /// Start of a single fault, and the time from which others fit, if the client acts as without faults.
    fn time_of(&self, one: &Planned) -> (u64, u64) {
        let begins = self.state.moments[one.cells[0].2].at;
        let ends = begins.saturating_add(one.schedule[0].lasts);
        let from = if one.was_late { 0 } else { begins };
        (from, ends.saturating_add(PAUSE))
    }

    /// The next single fault of the kind whose turn it is, except those that cannot hit anything. Its kind differs
    /// from that of `other`, and the two do not overlap.
    fn single_fault(&mut self, other: Option<&Planned>) -> Option<Planned> {
        let taken = other.map(|other| (other.cells[0].0, self.time_of(other)));
        let mut best: Option<(f64, usize, usize)> = None;
        for (kind, column) in self.state.columns.iter().enumerate() {
            let turn = column.arm.turn();
            let is_later = best.is_some_and(|(least, ..)| least <= turn);
            if is_later || taken.is_some_and(|(of, _)| of == kind) {
                continue;
            }
            let can_come = |one: &Planned| {
                let ((_, form, moment), lasts) = (one.cells[0], one.schedule[0].lasts);
                let (from, until) = self.time_of(one);
                let covers = |(of, at, longer): &(usize, usize, u64)| {
                    let from_before = *at <= moment && *longer == FOR_GOOD;
                    *of == form && (from_before || *at == moment && *longer >= lasts)
                };
                let meets = taken.is_some_and(|(_, (begun, ended))| from < ended && begun < until);
                !meets && !column.idle.iter().any(covers)
            };
            if let Some(index) = column.left.iter().rposition(can_come) {
                best = Some((turn, kind, index));
            }
        }
        let (_, kind, index) = best?;
        let column = &mut self.state.columns[kind];
        column.arm.plays += 1.0;
        Some(column.left.remove(index))
    }

    /// A further fault while the client reacts to earlier ones, or between two of its actions.
    fn further_fault(&mut self) -> Option<Planned> {
        let state = &mut self.state;
        let turn = |(_, (_, arm)): &(&u64, &mut (Vec<_>, Arm))| arm.turn();
        let firsts = state
            .firsts
            .iter_mut()
            .filter(|(_, (members, _))| !members.is_empty());
        let next = firsts.min_by(|one, other| turn(one).total_cmp(&turn(other)))?;
        let (class, (members, arm)) = next;
        arm.plays += 1.0;
        let (first, times) = &members[below(&mut self.noise, members.len())];
        let reaction = below(&mut self.noise, times.len());
        let mut at = times[reaction];
        if self.noise.uniform() < 0.5 {
            at = at.midpoint(times.get(reaction + 1).copied().unwrap_or(at + 1000));
        }
        let mut best = (f64::INFINITY, 0);
        for (kind, column) in state.columns.iter().enumerate() {
            let chance = 0.5 + self.noise.uniform();
            let weight = column.arm.weight() + column.further.weight();
            let turn = column.further.plays * chance / weight;
            best = if turn < best.0 { (turn, kind) } else { best };
        }
        let kind = best.1;
        state.columns[kind].further.plays += 1.0;
        let mut schedule = first.clone();
        let follows = Some((*class, kind));
        schedule.push(any_of(&mut self.noise, &state.kinds[kind], at));
        Some(Planned {
            schedule,
            follows,
            ..Planned::default()
        })
    }

    /// Random faults at random times, from a random half of the kinds.
    fn random_schedule(&mut self) -> Planned {
        let (state, noise) = (&self.state, &mut self.noise);
        let mut half: Vec<&Kind> = state.kinds.iter().collect();
        shuffle(noise, &mut half);
        half.truncate(half.len().div_ceil(2));
        let count = 1 + below(noise, self.args.max_faults as usize);
        let schedule = (0..count).map(|_| {
            let kind = half[below(noise, half.len())];
            let at = noise.below(u32::try_from(state.usual.ended).unwrap_or(u32::MAX));
            any_of(noise, kind, at.into())
        });
        Planned {
            schedule: schedule.collect(),
            ..Planned::default()
        }
    }
}

/// Plays the job without faults, and refuses a client that fails even there.
fn without_faults(
    player: &mut Player<'_>,
    job: &Loaded,
    text: &str,
    who: &str,
    unplayed: fn(Error) -> Failure,
) -> Result<Seen, Failure> {
    let seen = player.play_again(text)?;
    let (refusal, why): (fn(Error) -> Failure, _) = match (&seen.error, seen.broken.values().next())
    {
        (Some(why), _) => (unplayed, why.clone()),
        (None, Some(Broken { failure, .. })) => {
            let why = "the client fails in the job as it is, which has to be fixed first";
            (Failure::usage, format!("{why}: {failure}"))
        }
        (None, None) => return Ok(seen),
    };
    let output = player.trace(text, |_, result, _| {
        let client = result
            .played
            .as_ref()
            .and_then(|played| played.client.as_ref());
        Ok(client.map(client_output).unwrap_or_default())
    });
    let (name, output) = (job.name(), output.unwrap_or_default());
    let command = player.command(text, &job.path)?;
    Err(refusal(anyhow!(
        "{name}: {who}{why}{output}\n  more about it: {command}"
    )))
}

fn any_of(noise: &mut Noise, kind: &Kind, at: u64) -> Fault {
    let form = below(noise, kind.forms.len());
    let lasts = &kind.forms[form].lasts;
    kind.fault(form, Trigger::At(at), lasts[below(noise, lasts.len())])
}

/// A whole number below `end`.
fn below(noise: &mut Noise, end: usize) -> usize {
    noise.below(u32::try_from(end).unwrap_or(u32::MAX).max(1)) as usize
}

fn shuffle<T>(noise: &mut Noise, all: &mut [T]) {
    for last in (1..all.len()).rev() {
        all.swap(last, below(noise, last + 1));
    }
}
