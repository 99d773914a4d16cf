//! Search for the settings by which the model does what a recording has.
//!
//! One mechanism serves all: every setting is changed, the recording is played again by the same chance,
//! and what changes is compared with what is left between recording and model. What the same search finds
//! in plays of the model itself, by other chance, is what chance explains.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;
use rigsim_settings::Basis;

use super::knob::Knob;
use super::model::{Cell, Layout, cells, significant, takes_part, weight};
use super::recording::{Recording, Reply, Seen};

/// Plays by different chance from which it is known how much the model scatters.
const SEEDS: u64 = 6;
/// Cost that a change has to save at least.
const MARGIN: f64 = 40.0;
/// How many times more than by chance a change has to save.
const BEYOND_CHANCE: f64 = 3.0;
/// Most settings that are found.
const MOST_FOUND: usize = 16;
/// Square of the least change that shows, in standard deviations.
const TOUCHED: f64 = 25.0;
/// Most changes that are tried although they do not keep what they promise.
const MOST_REFUSED: usize = 30;
/// Changes that are tried at a time, and the least that one promises beside the best of them.
const AT_A_TIME: usize = 3;
const NEAR_BEST: f64 = 0.5;
/// Changes of a number that are tried, in its steps: by 20 %, to three times and to 0.3 times its value.
const STEPS: [f64; 4] = [1.0, -1.0, 10.0, -3.5];
/// Share of a recording that has to take part before it contradicts what is documented.
pub(super) const ENOUGH: f64 = 0.5;
/// Quantile of Student's t for 99 % and 5 degrees of freedom.
const T99: f64 = 4.03;
/// Cost above the least, within which the values of a number are as good: 99 % of a chi-square with one degree
/// of freedom.
const AS_GOOD: f64 = 6.63;
/// Likeness of two changes from which on they are not distinguished.
pub(super) const ALIKE: f64 = 0.95;

/// What was answered, by recording and slot.
type Play = Arc<Vec<Seen>>;

/// Everything that the search needs.
pub(super) struct Search<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) base: SimSettings,
    pub(super) knobs: Vec<Knob>,
    /// The vehicle's answers.
    vehicle: Vec<Seen>,
    progress: ProgressBar,
}

/// The model with some settings.
#[derive(Clone)]
pub(super) struct Model {
    pub(super) settings: SimSettings,
    /// By seed.
    members: Vec<Play>,
    pub(super) cells: Vec<Vec<Cell>>,
    pub(super) layout: Layout,
}

/// A changed value of a setting, and what the model does by it with the first seed.
struct Trial {
    knob: usize,
    literal: String,
    /// By how much a number differs.
    step: Option<f64>,
    /// What the model does without and with it, by the same chance.
    from: Play,
    to: Play,
    /// Set if it changes more than chance does.
    touches: bool,
}

/// A setting that the recording contradicts.
pub(super) struct Found {
    pub(super) knob: usize,
    pub(super) literal: String,
    /// A number, and the ends of its interval of 99 %; `None` where what is beyond fits as well.
    pub(super) number: Option<(f64, [Option<f64>; 2])>,
    /// Settings that explain the recording as well.
    pub(super) or: Vec<String>,
    /// Recording and slot that show it best.
    pub(super) shown_by: (usize, usize),
}

/// Result of a search.
pub(super) struct Findings {
    pub(super) assumed: Model,
    pub(super) found: Vec<Found>,
    /// The model with all that was found.
    pub(super) model: Model,
    pub(super) verdicts: Vec<Verdict>,
    /// With what is decided, and makes the third that was not used fit better.
    pub(super) written: SimSettings,
    /// Cost of that third before, and with what is decided.
    pub(super) held_out: [f64; 2],
}

/// What a recording says of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Supported,
    Contradicted,
    NotDecided,
    NotTouched,
}

impl Found {
    /// Returns whether it may be written: nothing else explains the recording, and a number has two ends.
    pub(super) fn is_decided(&self, verdicts: &[Verdict]) -> bool {
        let is_closed = |(_, ends): (f64, [Option<f64>; 2])| ends.iter().all(Option::is_some);
        verdicts[self.knob] == Verdict::Contradicted && self.number.is_none_or(is_closed)
    }
}

impl Model {
    /// The reply of the first play.
    pub(super) fn reply(&self, recording: usize, slot: usize) -> Option<&Reply> {
        self.members[0][recording][slot].as_ref()
    }
}

impl<'a> Search<'a> {
    /// Prepares to search among the settings that begin so, and from these.
    pub(super) fn new(recordings: &'a [Recording], base: SimSettings, only: &[String]) -> Self {
        Self {
            recordings,
            knobs: Knob::all(&base, recordings[0].device.id, only),
            base,
            vehicle: recordings.iter().map(|one| one.seen.clone()).collect(),
            progress: match std::io::stderr().is_terminal() {
                true => ProgressBar::no_length().with_message("plays"),
                false => ProgressBar::hidden(),
            },
        }
    }

    /// Searches until nothing is left that one more setting explains.
    pub(super) fn run(&self) -> Result<Findings, String> {
        let assumed = self.model(&self.base)?;
        let mut model = assumed.clone();
        let mut trials = self.trials(&model)?;
        let mut found: Vec<Found> = Vec::new();
        let mut refused = BTreeSet::new();
        let mut fresh = true;
        while found.len() < MOST_FOUND && refused.len() < MOST_REFUSED {
            let best = self.best(&model, &trials, &refused, &found);
            if best.is_empty() {
                if fresh {
                    break;
                }
                // Changes may do something else now.
                drop(std::mem::take(&mut trials));
                trials = self.trials(&model)?;
                fresh = true;
                continue;
            };
            // What a step of a number promises is not what the number does at its best.
            let before = self.cost(&model, false);
            let mut next: Option<(f64, usize, Model)> = None;
            for (promised, part, trial) in best {
                let tried = self.with(&model, trial, part)?;
                let saved = tried
                    .as_ref()
                    .map_or(0.0, |tried| before - self.cost(tried, false));
                match tried {
                    Some(tried) if saved > self.margin().max(promised / 5.0) => {
                        if next.as_ref().is_none_or(|next| saved > next.0) {
                            next = Some((saved, trial.knob, tried));
                        }
                    }
                    _ => drop(refused.insert((trial.knob, trial.literal.clone()))),
                }
            }
            let Some((_, knob, next)) = next else {
                continue;
            };
            found.retain(|one| one.knob != knob);
            found.push(Found {
                knob,
                literal: String::new(),
                number: None,
                or: Vec::new(),
                shown_by: self.shows(&model, &next),
            });
            model = self.polish(next, &self.numbers(&found))?;
            fresh = false;
        }
        self.prune(&mut model, &mut found, &trials)?;
        self.measure(&model, &mut found)?;
        let mut verdicts = self.verdicts(&model, &found, &trials);
        let mut written = self.base.clone();
        for one in found.iter().filter(|one| one.is_decided(&verdicts)) {
            let knob = &self.knobs[one.knob];
            let number = one.number.map(|(value, _)| knob.literal(&written, value));
            let literal = number.unwrap_or_else(|| one.literal.clone());
            written = knob.set(&written, &literal).unwrap_or(written);
        }
        let before = self.cost(&assumed, true);
        let after = match found.is_empty() {
            true => before,
            false => self.cost(&self.model(&written)?, true),
        };
        if after >= before {
            written = self.base.clone();
        }
        for one in found.iter().filter(|_| after > before) {
            verdicts[one.knob] = Verdict::NotDecided;
        }
        self.progress.finish_and_clear();
        Ok(Findings {
            assumed,
            found,
            model,
            verdicts,
            written,
            held_out: [before + 0.0, after + 0.0],
        })
    }

    /// Share of the recordings that takes part.
    pub(super) fn used(&self) -> f64 {
        let all = self.recordings.iter().flat_map(|one| &one.slots);
        let used = all.clone().filter(|slot| slot.counts).count();
        used as f64 / all.count() as f64
    }

    /// Plays settings with seeds, in threads. What is the same as `like` takes no memory of its own.
    fn play(&self, jobs: &[(&SimSettings, u64)], like: Option<&Play>) -> Result<Vec<Play>, String> {
        let next = AtomicUsize::new(0);
        let played: Vec<_> = jobs.iter().map(|_| OnceLock::new()).collect();
        let work = || {
            while let at = next.fetch_add(1, Ordering::Relaxed)
                && let Some((settings, seed)) = jobs.get(at)
            {
                let recordings = self.recordings.iter();
                let each = recordings.map(|recording| recording.play(settings, *seed));
                let seen = each.collect::<Result<Vec<Seen>, _>>();
                let same = |seen: &Vec<Seen>| like.filter(|like| ***like == *seen).cloned();
                played[at]
                    .get_or_init(|| seen.map(|seen| same(&seen).unwrap_or_else(|| seen.into())));
                self.progress.inc(1);
            }
        };
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        std::thread::scope(|scope| {
            for _ in 0..threads.min(jobs.len()) {
                scope.spawn(work);
            }
        });
        played
            .into_iter()
            .filter_map(OnceLock::into_inner)
            .collect()
    }

    fn model(&self, settings: &SimSettings) -> Result<Model, String> {
        let jobs: Vec<_> = (0..SEEDS).map(|seed| (settings, seed)).collect();
        let members = self.play(&jobs, None)?;
        let replies = members.iter().flat_map(|seen| &**seen).chain(&self.vehicle);
        let layout = Layout::of(replies.flatten().flatten());
        let recordings = self.recordings.iter().enumerate();
        let of_recording = |(at, recording)| {
            let plays: Vec<&Seen> = members.iter().map(|seen| &seen[at]).collect();
            cells(&plays, recording, &layout)
        };
        Ok(Model {
            cells: recordings.map(of_recording).collect(),
            settings: settings.clone(),
            members,
            layout,
        })
    }

    /// Cost that a change has to save; more where a machine may have spoiled some replies.
    fn margin(&self) -> f64 {
        match self.recordings.iter().any(|recording| recording.is_real) {
            true => 2.0 * MARGIN,
            false => MARGIN,
        }
    }

    /// Each other value of each choice, and each number with a small and a large step up and down.
    fn trials(&self, model: &Model) -> Result<Vec<Trial>, String> {
        let mut planned = Vec::new();
        for (knob, about) in self.knobs.iter().enumerate() {
            let choices = about.choices.iter().map(|one| (one.clone(), None));
            let mut values: Vec<(String, Option<f64>)> = choices.collect();
            if about.choices.is_empty() {
                let value = about.number_in(&model.settings);
                let literal = |step| about.literal(&model.settings, value + step);
                values.extend(
                    STEPS.map(|part| (literal(part * about.step), Some(part * about.step))),
                );
            }
            let now = about.literal_in(&model.settings);
            for (literal, step) in values.into_iter().filter(|(literal, _)| *literal != now) {
                if let Some(settings) = about.set(&model.settings, &literal) {
                    planned.push((knob, literal, step, settings));
                }
            }
        }
        let jobs: Vec<_> = planned.iter().map(|(.., settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.members[0]))?;
        let touches = self.touched(model, &jobs, &played)?;
        let trials = planned.iter().zip(played).zip(touches);
        let trial =
            |(((knob, literal, step, _), to), touches): ((&(_, String, _, _), _), _)| Trial {
                knob: *knob,
                literal: literal.clone(),
                step: *step,
                from: Arc::clone(&model.members[0]),
                to,
                touches,
            };
        Ok(trials.map(trial).collect())
    }

    /// Returns of each change whether it does more than chance.
    fn touched(
        &self,
        model: &Model,
        jobs: &[(&SimSettings, u64)],
        played: &[Play],
    ) -> Result<Vec<bool>, String> {
        let [first, second] = [&model.members[0], &model.members[1]];
        let columns = played.iter().map(|seen| self.column(model, first, seen));
        let columns: Vec<Vec<f64>> = columns.collect();
        let touches = played.iter().map(|seen| self.differs(model, first, seen));
        let mut touches: Vec<bool> = touches.collect();
        let doubtful = (0..jobs.len())
            .filter(|at| !touches[*at] && product(&columns[*at], &columns[*at]) > TOUCHED);
        let doubtful: Vec<usize> = doubtful.collect();
        // By another chance a real change is the same.
        let again: Vec<_> = doubtful.iter().map(|at| (jobs[*at].0, 1)).collect();
        for (at, seen) in doubtful.iter().zip(self.play(&again, Some(second))?) {
            let count = columns[*at].iter().filter(|change| **change != 0.0).count() as f64;
            let same = product(&columns[*at], &self.column(model, second, &seen));
            touches[*at] = same > TOUCHED + 4.0 * count.sqrt();
        }
        Ok(touches)
    }

    /// Calls with every slot that takes part: recording, slot.
    fn slots(&self, held_out: bool) -> impl Iterator<Item = (usize, usize)> {
        let recordings = self.recordings.iter().enumerate();
        recordings.flat_map(move |(at, recording)| {
            let slots = recording.slots.iter().enumerate();
            let some = slots.filter(move |(_, slot)| takes_part(slot, held_out));
            some.map(move |(slot, _)| (at, slot))
        })
    }

    /// Returns whether a bit, a word or a form is another, or a reply is not there.
    fn differs(&self, model: &Model, base: &[Seen], seen: &[Seen]) -> bool {
        self.slots(false).any(|(at, slot)| {
            let sd = &model.cells[at][slot].sd;
            match (&base[at][slot], &seen[at][slot]) {
                (Some(one), Some(other)) if one.form == other.form => {
                    let mut channels = model.layout.channels(one).iter().enumerate();
                    channels.any(|(at, info)| {
                        let is_sure = info.is_choice && sd.get(at).is_some_and(|sd| sd.is_finite());
                        is_sure && one.values[at] != other.values[at]
                    })
                }
                (one, other) => one.is_some() || other.is_some(),
            }
        })
    }

    /// Commands with replies that no setting explains: in form, in bits, or far beyond any scatter.
    pub(super) fn unexplained(&self, model: &Model) -> Vec<String> {
        let mut counts: BTreeMap<&str, (usize, usize, usize, u64)> = Default::default();
        for (at, slot) in self.slots(false).chain(self.slots(true)) {
            let (asked, seen) = (&self.recordings[at].slots[slot], &self.vehicle[at][slot]);
            let signs = model.cells[at][slot].contradictions(seen.as_ref(), &model.layout);
            let (all, wrong, weight, last) = counts.entry(&asked.text).or_default();
            *all += 1;
            if signs > 0 {
                *wrong += 1;
                *weight += signs;
                *last = asked.at;
            }
        }
        let some = counts
            .into_iter()
            .filter(|(_, (all, _, weight, _))| *weight > 2 + all / 20);
        let words = |(text, (all, wrong, _, at)): (&str, (usize, usize, usize, u64))| {
            let at = rigsim_core::SimTime::from_nanos(at);
            format!("{text}: {wrong} of {all} have another answer than the model, last at {at} s")
        };
        some.map(words).collect()
    }

    pub(super) fn cost(&self, model: &Model, held_out: bool) -> f64 {
        let costs = self.slots(held_out).map(|(at, slot)| {
            let seen = self.vehicle[at][slot].as_ref();
            model.cells[at][slot].cost(seen, &model.layout, self.recordings[at].is_real)
        });
        costs.sum()
    }

    /// The trials that save most beyond chance, each of another setting: what they save, by which part of
    /// their change.
    fn best<'t>(
        &self,
        model: &Model,
        trials: &'t [Trial],
        refused: &BTreeSet<(usize, String)>,
        found: &[Found],
    ) -> Vec<(f64, f64, &'t Trial)> {
        let mut best = Vec::new();
        for trial in trials {
            let known = found.iter().any(|one| one.knob == trial.knob);
            if known && trial.step.is_some()
                || refused.contains(&(trial.knob, trial.literal.clone()))
            {
                continue;
            }
            let (saves, part) = self.saves(model, trial, &self.vehicle);
            if saves < self.margin() {
                continue;
            }
            let by_chance = model.members.iter();
            let by_chance = by_chance.map(|member| self.saves(model, trial, member).0);
            if saves > self.margin() + BEYOND_CHANCE * by_chance.fold(0.0, f64::max) {
                best.push((saves, part, trial));
            }
        }
        best.sort_by(|one, other| other.0.total_cmp(&one.0));
        let least = best.first().map_or(0.0, |best| NEAR_BEST * best.0);
        let mut knobs = BTreeSet::new();
        best.retain(|(saves, _, trial)| *saves > least && knobs.insert(trial.knob));
        best.truncate(AT_A_TIME);
        best
    }

    /// Cost that a trial saves for these replies, and the part of its change that saves most.
    fn saves(&self, model: &Model, trial: &Trial, seen: &[Seen]) -> (f64, f64) {
        let saved = |part| self.saved(model, [&trial.from, &trial.to], part, seen);
        let whole = (saved(1.0), 1.0);
        if trial.step.is_none() {
            return whole;
        }
        let column = self.column(model, &trial.from, &trial.to);
        let rest = self.rest(model, seen);
        let (mut above, mut below) = (0.0, 0.0);
        for ((change, rest), weight) in column.iter().zip(&rest.0).zip(&rest.1) {
            above += change * rest * weight;
            below += change * change * weight;
        }
        let part = (above / below).clamp(-4.0, 4.0);
        if below == 0.0 || !part.is_finite() {
            return whole;
        }
        let partly = (saved(part), part);
        if partly.0 > whole.0 { partly } else { whole }
    }

    /// Cost that a part of the change from one play to another saves for these replies.
    fn saved(&self, model: &Model, [from, to]: [&[Seen]; 2], part: f64, seen: &[Seen]) -> f64 {
        let each = self.slots(false).map(|(at, slot)| {
            let [from, to, seen] = [from, to, seen].map(|play| play[at][slot].as_ref());
            let same = match (from, to) {
                (Some(from), Some(to)) => from.form == to.form && from.values == to.values,
                (None, None) => true,
                _ => false,
            };
            if same {
                return 0.0;
            }
            let (cell, is_real) = (&model.cells[at][slot], self.recordings[at].is_real);
            let changed = cell.shifted(from, to, part, &model.layout);
            let cost = |cell: &Cell| cell.cost(seen, &model.layout, is_real);
            cost(cell) - cost(&changed)
        });
        each.sum()
    }

    /// What changes from one play to another, in standard deviations: a column of the Jacobian.
    fn column(&self, model: &Model, from: &[Seen], to: &[Seen]) -> Vec<f64> {
        let mut column = Vec::new();
        for (at, slot) in self.slots(false) {
            let cell = &model.cells[at][slot];
            let both = from[at][slot].as_ref().zip(to[at][slot].as_ref());
            let both =
                both.filter(|(from, to)| [from, to].map(|one| Some(one.form)) == [cell.form; 2]);
            let value =
                |channel: usize| both.map(|(from, to)| to.values[channel] - from.values[channel]);
            self.values(model, cell, value, &mut column);
        }
        column
    }

    /// What is left between replies and model, in standard deviations, and the weights.
    fn rest(&self, model: &Model, seen: &[Seen]) -> (Vec<f64>, Vec<f64>) {
        let mut rest = Vec::new();
        for (at, slot) in self.slots(false) {
            let (cell, is_real) = (&model.cells[at][slot], self.recordings[at].is_real);
            let reply = seen[at][slot].as_ref();
            let reply = reply.filter(|reply| Some(reply.form) == cell.form);
            let value = |channel: usize| {
                let rest = reply?.values[channel] - cell.mean[channel];
                Some(significant(rest, channel, is_real).copysign(rest))
            };
            self.values(model, cell, value, &mut rest);
        }
        let weights = rest.iter().map(|rest| weight(*rest)).collect();
        (rest, weights)
    }

    /// Adds a value for each numeric channel of a cell, in standard deviations.
    fn values(
        &self,
        model: &Model,
        cell: &Cell,
        value: impl Fn(usize) -> Option<f64>,
        to: &mut Vec<f64>,
    ) {
        for (channel, info) in model.layout.of_form(cell.form).iter().enumerate() {
            if !info.is_choice && channel < cell.mean.len() {
                to.push(value(channel).unwrap_or(0.0) / cell.sd[channel]);
            }
        }
    }

    /// The model with a trial, a number at its best; `None` if that is not allowed.
    fn with(&self, model: &Model, trial: &Trial, part: f64) -> Result<Option<Model>, String> {
        let knob = &self.knobs[trial.knob];
        let Some(step) = trial.step else {
            let settings = knob.set(&model.settings, &trial.literal);
            return settings.map(|settings| self.model(&settings)).transpose();
        };
        let value = knob.number_in(&model.settings);
        // Wide first, then around the best.
        let mut values: Vec<f64> = (-8..=10)
            .map(|at| value + f64::from(at) * step / 2.0)
            .collect();
        values.push(value + part * step);
        let Some([_, _, mut best, ..]) = self.ladder(model, knob, &values)? else {
            return Ok(None);
        };
        let mut steps = vec![step.abs() / 12.0, knob.step / 12.0, knob.step / 72.0];
        steps.dedup();
        for step in steps {
            let fine = (-6..=6).map(|at| best + f64::from(at) * step);
            if let Some([_, low, _, high, _]) =
                self.ladder(model, knob, &fine.collect::<Vec<_>>())?
            {
                best = (low + high) / 2.0;
            }
        }
        let settings = knob.set(&model.settings, &knob.literal(&model.settings, best));
        settings.map(|settings| self.model(&settings)).transpose()
    }

    /// Of those of these values that are allowed: the least, the least that fits as well as the best, the
    /// best, which is the nearest to the present one of equals, the greatest that fits as well, the greatest.
    fn ladder(
        &self,
        model: &Model,
        knob: &Knob,
        values: &[f64],
    ) -> Result<Option<[f64; 5]>, String> {
        let allowed = values.iter().filter_map(|value| {
            let settings = knob.set(&model.settings, &knob.literal(&model.settings, *value))?;
            Some((*value, settings))
        });
        let allowed: Vec<(f64, SimSettings)> = allowed.collect();
        let jobs: Vec<_> = allowed.iter().map(|(_, settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.members[0]))?;
        let saved = |to: &Play| self.saved(model, [&model.members[0], to], 1.0, &self.vehicle);
        let saved: Vec<f64> = played.iter().map(saved).collect();
        let all = || {
            allowed
                .iter()
                .map(|(value, _)| *value)
                .zip(saved.iter().copied())
        };
        let now = knob.number_in(&model.settings);
        let away = |value: f64| (value - now).abs();
        let best = all().max_by(|one, other| {
            let nearer = away(other.0).total_cmp(&away(one.0));
            one.1.total_cmp(&other.1).then(nearer)
        });
        Ok(best.map(|(best, most)| {
            all().fold([best; 5], |[first, low, _, high, last], (value, saved)| {
                let good = if saved >= most - AS_GOOD { value } else { best };
                [
                    first.min(value),
                    low.min(good),
                    best,
                    high.max(good),
                    last.max(value),
                ]
            })
        }))
    }

    /// The ends of what fits as well as the present value of a number; `None` where all that is beyond does.
    fn ends(&self, model: &Model, knob: &Knob) -> Result<[Option<f64>; 2], String> {
        let value = knob.number_in(&model.settings);
        let at = |part: f64| value + part * knob.step / 8.0;
        let mut values: Vec<f64> = (-12..=12).map(|part| at(f64::from(part))).collect();
        let [_, low, _, high, _] = self.ladder(model, knob, &values)?.unwrap_or([value; 5]);
        let leaves = [low <= at(-12.0), high >= at(12.0)];
        if leaves == [false; 2] {
            return Ok([Some(low), Some(high)]);
        }
        let far = (1..=12).map(|power| 12.0 * 1.5_f64.powi(power));
        values.extend(far.flat_map(|part| [at(-part), at(part)]));
        let [first, low, _, high, last] = self.ladder(model, knob, &values)?.unwrap_or([value; 5]);
        let is_open = [leaves[0] && low <= first, leaves[1] && high >= last];
        Ok([(!is_open[0]).then_some(low), (!is_open[1]).then_some(high)])
    }

    /// Columns of the numbers that were found: what a small change of each does.
    fn jacobian(
        &self,
        model: &Model,
        numbers: &[usize],
    ) -> Result<(DMatrix<f64>, Vec<f64>), String> {
        let mut changed = Vec::new();
        for at in numbers {
            let (knob, step) = (&self.knobs[*at], self.knobs[*at].step / 4.0);
            let value = knob.number_in(&model.settings);
            let with = |step: f64| {
                let literal = knob.literal(&model.settings, value + step);
                Some((knob.set(&model.settings, &literal)?, step))
            };
            let fallback = || (model.settings.clone(), step);
            changed.push(with(step).or_else(|| with(-step)).unwrap_or_else(fallback));
        }
        let jobs: Vec<_> = changed.iter().map(|(settings, _)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.members[0]))?;
        let columns = played.iter();
        let columns = columns.map(|seen| self.column(model, &model.members[0], seen));
        let columns: Vec<Vec<f64>> = columns.collect();
        let rows = columns.first().map_or(0, Vec::len);
        let matrix = DMatrix::from_iterator(rows, columns.len(), columns.into_iter().flatten());
        Ok((matrix, changed.iter().map(|(_, step)| *step).collect()))
    }

    /// Solves for the changes of numbers, in steps, that leave least.
    fn solve(matrix: &DMatrix<f64>, rest: &[f64], weights: &[f64]) -> Option<DVector<f64>> {
        let roots: Vec<f64> = weights.iter().map(|weight| weight.sqrt()).collect();
        let mut weighted = matrix.clone();
        for (mut row, root) in weighted.row_iter_mut().zip(&roots) {
            row *= *root;
        }
        let rest = rest.iter().zip(&roots).map(|(rest, root)| rest * root);
        let rest = DVector::from_vec(rest.collect());
        if matrix.is_empty() {
            return None;
        }
        let normal = weighted.tr_mul(&weighted);
        let right = weighted.tr_mul(&rest);
        let largest = normal.amax();
        normal.svd(true, true).solve(&right, largest * 1e-9).ok()
    }

    /// Improves all numbers together.
    fn polish(&self, mut model: Model, numbers: &[usize]) -> Result<Model, String> {
        if numbers.is_empty() {
            return Ok(model);
        }
        for _ in 0..3 {
            let (matrix, steps) = self.jacobian(&model, numbers)?;
            let (rest, weights) = self.rest(&model, &self.vehicle);
            let Some(change) = Self::solve(&matrix, &rest, &weights) else {
                break;
            };
            let mut settings = model.settings.clone();
            for ((at, step), change) in numbers.iter().zip(&steps).zip(change.iter()) {
                let knob = &self.knobs[*at];
                let value = knob.number_in(&settings) + step * change.clamp(-4.0, 4.0);
                settings = knob
                    .set(&settings, &knob.literal(&settings, value))
                    .unwrap_or(settings);
            }
            let next = self.model(&settings)?;
            if self.cost(&next, false) > self.cost(&model, false) - 1.0 {
                break;
            }
            model = next;
        }
        Ok(model)
    }

    fn numbers(&self, found: &[Found]) -> Vec<usize> {
        let numbers = found.iter().map(|one| one.knob);
        let is_number = |at: &usize| self.knobs[*at].choices.is_empty();
        numbers.filter(is_number).collect()
    }

    /// Slot at which one model fits better than another by most.
    fn shows(&self, before: &Model, after: &Model) -> (usize, usize) {
        let saved = |(at, slot): (usize, usize)| {
            let is_real = self.recordings[at].is_real;
            let seen = self.vehicle[at][slot].as_ref();
            before.cells[at][slot].cost(seen, &before.layout, is_real)
                - after.cells[at][slot].cost(seen, &after.layout, is_real)
        };
        let slots = self.slots(false);
        slots
            .max_by(|one, other| saved(*one).total_cmp(&saved(*other)))
            .unwrap_or_default()
    }

    /// Takes back what the others explain as well, and notes what else explains what is left.
    fn prune(
        &self,
        model: &mut Model,
        found: &mut Vec<Found>,
        trials: &[Trial],
    ) -> Result<(), String> {
        let mut at = 0;
        while at < found.len() {
            let knob = &self.knobs[found[at].knob];
            let Some(settings) = knob.set(&model.settings, &knob.default_in(&model.settings))
            else {
                break;
            };
            let mut others = self.numbers(found);
            others.retain(|other| *other != found[at].knob);
            let without = self.polish(self.model(&settings)?, &others)?;
            let saves = self.cost(&without, false) - self.cost(model, false);
            if saves < self.margin() {
                found.remove(at);
                *model = without;
                at = 0;
                continue;
            }
            found[at].or = self.as_good(&without, found[at].knob, saves, trials);
            at += 1;
        }
        Ok(())
    }

    /// Other settings that explain what one explains.
    fn as_good(&self, without: &Model, knob: usize, saves: f64, trials: &[Trial]) -> Vec<String> {
        let column = |trial: &Trial| self.column(without, &trial.from, &trial.to);
        let mut own = trials.iter();
        let own = own.find(|trial| trial.knob == knob && trial.step.is_some());
        let own = own.map(column);
        let is_one = |trial: &&Trial| {
            let others = self.saves(without, trial, &self.vehicle).0;
            let is_alike = |own: &Vec<f64>| likeness(own, &column(trial)) > ALIKE;
            others > (saves - self.margin()).max(0.75 * saves)
                || others > self.margin() && own.as_ref().is_some_and(is_alike)
        };
        let others = trials.iter();
        let others = others.filter(|trial| trial.knob != knob && trial.touches);
        let names = others
            .filter(is_one)
            .map(|trial| self.knobs[trial.knob].name());
        let mut names: Vec<String> = names.collect();
        names.dedup();
        names
    }

    /// Notes the values that were found, and their intervals.
    fn measure(&self, model: &Model, found: &mut [Found]) -> Result<(), String> {
        let numbers = self.numbers(found);
        let (matrix, steps) = self.jacobian(model, &numbers)?;
        let chance = model.members.iter().filter_map(|member| {
            let (rest, weights) = self.rest(model, member);
            Self::solve(&matrix, &rest, &weights)
        });
        let chance: Vec<DVector<f64>> = chance.collect();
        // What no setting explains makes all numbers less certain.
        let (rest, weights) = self.rest(model, &self.vehicle);
        let left = rest
            .iter()
            .zip(&weights)
            .map(|(rest, weight)| weight * rest * rest);
        let misfit = (left.sum::<f64>() / rest.len().max(1) as f64)
            .sqrt()
            .max(1.0);
        let covariance = match matrix.is_empty() {
            true => None,
            false => matrix.tr_mul(&matrix).pseudo_inverse(1e-12).ok(),
        };
        for one in found {
            let knob = &self.knobs[one.knob];
            one.literal = knob.literal_in(&model.settings);
            let Some(at) = numbers.iter().position(|number| *number == one.knob) else {
                continue;
            };
            let squares = chance.iter().map(|change| change[at].powi(2)).sum::<f64>();
            let sd = (squares / (chance.len() as f64 - 1.0).max(1.0)).sqrt();
            let least = covariance
                .as_ref()
                .map_or(0.0, |all| all[(at, at)].max(0.0).sqrt());
            let half = T99 * misfit * sd.max(least) * steps[at].abs();
            let value = knob.number_in(&model.settings);
            // It may show only in what is there or is not, or be lost in what the machine explains.
            let ends = self.ends(model, knob)?;
            let is_flat = matrix.column(at).amax() < 1.0 || ends.contains(&None);
            let between = if is_flat { knob.step / 8.0 } else { 0.0 };
            let [low, high] = ends;
            let low = low.map(|low| (value - half).min(low) - between);
            let ends = [low, high.map(|high| (value + half).max(high) + between)];
            one.number = Some((value, ends));
        }
        Ok(())
    }

    fn verdicts(&self, model: &Model, found: &[Found], trials: &[Trial]) -> Vec<Verdict> {
        let enough = self.used() >= ENOUGH;
        let verdict = |at: usize| {
            let knob = &self.knobs[at];
            if let Some(one) = found.iter().find(|one| one.knob == at) {
                let before = knob.number_in(&self.base);
                let is_outside = one.number.is_none_or(|(_, [low, high])| {
                    low.is_some_and(|low| before < low) || high.is_some_and(|high| before > high)
                });
                let is_enough = enough || matches!(knob.basis, Basis::Assumed(_));
                return match one.or.is_empty() && is_outside && is_enough {
                    true => Verdict::Contradicted,
                    false => Verdict::NotDecided,
                };
            }
            let own = || trials.iter().filter(|trial| trial.knob == at);
            if !own().any(|trial| trial.touches) {
                return Verdict::NotTouched;
            }
            let excluded = |trial: &Trial| {
                let change = [&**trial.from, &trial.to];
                self.saved(model, change, 1.0, &self.vehicle) < -self.margin()
            };
            let doubted = found.iter().any(|one| one.or.contains(&knob.name()));
            match own().all(excluded) && !doubted {
                true => Verdict::Supported,
                false => Verdict::NotDecided,
            }
        };
        (0..self.knobs.len()).map(verdict).collect()
    }
}

fn product(one: &[f64], other: &[f64]) -> f64 {
    one.iter().zip(other).map(|(one, other)| one * other).sum()
}

/// How alike two directions are, without their signs.
fn likeness(one: &[f64], other: &[f64]) -> f64 {
    let lengths = product(one, one) * product(other, other);
    match lengths > 0.0 {
        true => product(one, other).abs() / lengths.sqrt(),
        false => 0.0,
    }
}
