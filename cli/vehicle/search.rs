//! Search for the settings by which the model does what a recording has.
//!
//! One mechanism serves all: every setting is changed, the recording is played again by the same chance,
//! and what changes is compared with what is left between recording and model. What the same search finds
//! in plays of the model itself, by other chance, is what chance explains.

use std::collections::BTreeMap;
use std::num::NonZero;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;

use super::knob::{Knob, KnobKind};
use super::model::{Cell, Layout, cells, significant, takes_part, weight};
use super::recording::{Recording, Reply, Seen};
use crate::config;

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
/// Quantile of Student's t for 99 % and 5 degrees of freedom.
const T99: f64 = 4.03;
/// Likeness of two changes from which on they are not distinguished.
pub(super) const ALIKE: f64 = 0.95;

/// Plays by settings and seed, so that none is played twice.
pub(super) type Memo = Mutex<BTreeMap<(String, u64), Arc<Vec<Seen>>>>;

/// Everything that the search needs.
pub(super) struct Search<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) base: SimSettings,
    pub(super) knobs: Vec<Knob>,
    pub(super) progress: ProgressBar,
    pub(super) memo: Arc<Memo>,
}

/// The model with some settings.
pub(super) struct Model {
    pub(super) settings: SimSettings,
    /// By seed, then by recording.
    members: Vec<Arc<Vec<Seen>>>,
    pub(super) cells: Vec<Vec<Cell>>,
    pub(super) layout: Layout,
}

/// A changed value of a setting, and what the model does by it with the first seed.
pub(super) struct Trial {
    pub(super) knob: usize,
    pub(super) literal: String,
    /// By how much a number differs.
    step: Option<f64>,
    seen: Arc<Vec<Seen>>,
    /// What the model does without, by the same chance.
    without: usize,
    /// Set if it changes anything.
    changes: bool,
    /// Set if that is more than chance.
    pub(super) touches: bool,
}

/// A setting that the recording contradicts.
pub(super) struct Found {
    pub(super) knob: usize,
    pub(super) literal: String,
    /// A number, and half of its interval of 99 %.
    pub(super) number: Option<(f64, f64)>,
    /// Cost that it saves.
    pub(super) saves: f64,
    /// Settings that explain the recording as well.
    pub(super) or: Vec<String>,
    /// Recording and slot that show it best.
    pub(super) shown_by: (usize, usize),
}

/// Result of a search.
pub(super) struct Findings {
    pub(super) assumed: Model,
    pub(super) found: Vec<Found>,
    pub(super) model: Model,
    pub(super) verdicts: Vec<Verdict>,
}

/// What a recording says of a setting.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Verdict {
    Supported,
    Contradicted,
    NotDecided,
    NotTouched,
}

impl Model {
    /// The reply of the first play.
    pub(super) fn reply(&self, recording: usize, slot: usize) -> Option<&Reply> {
        self.members[0][recording][slot].as_ref()
    }
}

impl Search<'_> {
    /// Searches until nothing is left that one more setting explains.
    pub(super) fn run(&self) -> Result<Findings, String> {
        let assumed = self.model(&self.base)?;
        let mut bases = vec![self.first(&assumed)];
        let mut trials = self.trials(&assumed, &bases)?;
        let mut model = self.model(&self.base)?;
        let mut found: Vec<Found> = Vec::new();
        let mut refused = Vec::new();
        let mut fresh = true;
        while found.len() < MOST_FOUND && refused.len() < MOST_REFUSED {
            let best = self.best(&model, &trials, &bases, &refused, &found);
            if best.is_empty() {
                if fresh {
                    break;
                }
                // Changes may do something else now.
                bases.push(self.first(&model));
                trials = self.trials(&model, &bases)?;
                fresh = true;
                continue;
            };
            // What a step of a number promises is not what the number does at its best.
            let before = self.cost(&model, false);
            let mut next: Option<(f64, usize, Model)> = None;
            for (at, promised, part) in best {
                let trial = &trials[at];
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
                    _ => refused.push((trial.knob, trial.literal.clone())),
                }
            }
            let Some((saved, knob, next)) = next else {
                continue;
            };
            found.retain(|one| one.knob != knob);
            found.push(Found {
                knob,
                literal: String::new(),
                number: None,
                saves: saved,
                or: Vec::new(),
                shown_by: self.shows(&model, &next),
            });
            model = self.polish(next, &self.numbers(&found))?;
            fresh = false;
        }
        self.prune(&mut model, &mut found, &trials, &bases)?;
        self.measure(&model, &mut found)?;
        let verdicts = self.verdicts(&model, &found, &trials, &bases);
        Ok(Findings {
            assumed,
            found,
            model,
            verdicts,
        })
    }

    /// Plays settings with seeds, in threads.
    fn play(&self, jobs: &[(&SimSettings, u64)]) -> Result<Vec<Arc<Vec<Seen>>>, String> {
        let keys = jobs
            .iter()
            .map(|(settings, seed)| (config::changed(settings).join("\n"), *seed));
        let keys: Vec<(String, u64)> = keys.collect();
        let memo = || self.memo.lock().unwrap_or_else(PoisonError::into_inner);
        let next = AtomicUsize::new(0);
        let failure = Mutex::new(None);
        let work = || {
            while let at = next.fetch_add(1, Ordering::Relaxed)
                && let Some((settings, seed)) = jobs.get(at)
            {
                if memo().contains_key(&keys[at]) {
                    continue;
                }
                let played = self
                    .recordings
                    .iter()
                    .map(|recording| recording.play(settings, *seed));
                self.progress.inc(1);
                match played.collect::<Result<Vec<Seen>, _>>() {
                    Ok(seen) => drop(memo().insert(keys[at].clone(), Arc::new(seen))),
                    Err(why) => *failure.lock().unwrap_or_else(PoisonError::into_inner) = Some(why),
                }
            }
        };
        let work = &work;
        let threads = std::thread::available_parallelism().map_or(1, NonZero::get);
        std::thread::scope(|scope| {
            for _ in 1..threads.min(jobs.len()) {
                scope.spawn(work);
            }
            work();
        });
        if let Some(why) = failure.into_inner().unwrap_or_else(PoisonError::into_inner) {
            return Err(why);
        }
        let memo = memo();
        Ok(keys
            .iter()
            .filter_map(|key| memo.get(key).cloned())
            .collect())
    }

    fn model(&self, settings: &SimSettings) -> Result<Model, String> {
        let jobs: Vec<_> = (0..SEEDS).map(|seed| (settings, seed)).collect();
        let members = self.play(&jobs)?;
        let vehicle = self.recordings.iter().map(|recording| &recording.seen);
        let replies = members.iter().flat_map(|seen| &**seen).chain(vehicle);
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

    /// What the model does with the first seed.
    fn first(&self, model: &Model) -> Arc<Vec<Seen>> {
        Arc::clone(&model.members[0])
    }

    /// Each other value of each choice, and each number with a step up and down.
    fn trials(&self, model: &Model, bases: &[Arc<Vec<Seen>>]) -> Result<Vec<Trial>, String> {
        let mut planned = Vec::new();
        for (at, knob) in self.knobs.iter().enumerate() {
            let now = knob.literal_in(&model.settings);
            let values: Vec<(String, Option<f64>)> = match &knob.kind {
                KnobKind::Choice(all) => all.iter().map(|one| (one.clone(), None)).collect(),
                KnobKind::Number { step, .. } => {
                    let value = knob.number_in(&model.settings);
                    let steps = [*step, -step];
                    let literal = |step| knob.literal(&model.settings, value + step);
                    steps.map(|step| (literal(step), Some(step))).into()
                }
            };
            for (literal, step) in values.into_iter().filter(|(literal, _)| *literal != now) {
                if let Some(settings) = knob.set(&model.settings, &literal) {
                    planned.push((at, literal, step, settings));
                }
            }
        }
        let jobs: Vec<_> = planned.iter().map(|(.., settings)| (settings, 0)).collect();
        let played = self.play(&jobs)?;
        let base = &bases[bases.len() - 1];
        let touches = self.touched(model, base, &jobs, &played)?;
        type Planned = (usize, String, Option<f64>, SimSettings);
        let trial =
            |(((knob, literal, step, _), seen), touches): ((Planned, Arc<Vec<Seen>>), bool)| {
                Trial {
                    changes: *base != seen,
                    touches,
                    without: bases.len() - 1,
                    knob,
                    literal,
                    step,
                    seen,
                }
            };
        Ok(planned
            .into_iter()
            .zip(played)
            .zip(touches)
            .map(trial)
            .collect())
    }

    /// Returns of each change whether it does more than chance.
    fn touched(
        &self,
        model: &Model,
        base: &[Seen],
        jobs: &[(&SimSettings, u64)],
        played: &[Arc<Vec<Seen>>],
    ) -> Result<Vec<bool>, String> {
        let column = |seen: &Arc<Vec<Seen>>| self.column(model, base, seen);
        let columns: Vec<Vec<f64>> = played.iter().map(column).collect();
        let mut touches: Vec<bool> = played
            .iter()
            .map(|seen| self.differs(model, base, seen))
            .collect();
        let doubtful = (0..jobs.len())
            .filter(|at| !touches[*at] && product(&columns[*at], &columns[*at]) > TOUCHED);
        let doubtful: Vec<usize> = doubtful.collect();
        // By another chance a real change is the same.
        let again: Vec<_> = doubtful.iter().map(|at| (jobs[*at].0, 1)).collect();
        let other = &model.members[1];
        for (at, seen) in doubtful.iter().zip(self.play(&again)?) {
            let count = columns[*at].iter().filter(|change| **change != 0.0).count() as f64;
            let same = product(&columns[*at], &self.column(model, other, &seen));
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

    /// Commands of which a reply is there or is not, or has another form, and no setting explains it.
    pub(super) fn unexplained(&self, model: &Model) -> Vec<String> {
        let mut counts: BTreeMap<&str, (usize, usize, u64)> = Default::default();
        for (at, slot) in self.slots(false).chain(self.slots(true)) {
            let (asked, seen) = (&self.recordings[at].slots[slot], self.vehicle(at, slot));
            let entry = counts.entry(&asked.text).or_insert((0, 0, asked.at));
            entry.0 += 1;
            if model.cells[at][slot].differs(seen) {
                entry.1 += 1;
                entry.2 = asked.at;
            }
        }
        let some = counts
            .into_iter()
            .filter(|(_, (all, wrong, _))| *wrong > 2 + all / 20);
        let words = |(text, (all, wrong, at)): (&str, (usize, usize, u64))| {
            let at = rigsim_core::SimTime::from_nanos(at);
            format!("{text}: {wrong} of {all} have another answer than the model, last at {at} s")
        };
        some.map(words).collect()
    }

    fn vehicle(&self, at: usize, slot: usize) -> Option<&Reply> {
        self.recordings[at].seen[slot].as_ref()
    }

    pub(super) fn cost(&self, model: &Model, held_out: bool) -> f64 {
        let costs = self.slots(held_out).map(|(at, slot)| {
            let seen = self.vehicle(at, slot);
            model.cells[at][slot].cost(seen, &model.layout, self.recordings[at].is_real)
        });
        costs.sum()
    }

    /// The trials that save most beyond chance, each of another setting: their places, what they save, and
    /// which part of their change.
    fn best(
        &self,
        model: &Model,
        trials: &[Trial],
        bases: &[Arc<Vec<Seen>>],
        refused: &[(usize, String)],
        found: &[Found],
    ) -> Vec<(usize, f64, f64)> {
        let mut best: Vec<(usize, f64, f64)> = Vec::new();
        for (at, trial) in trials.iter().enumerate() {
            let is_refused = refused
                .iter()
                .any(|(knob, literal)| *knob == trial.knob && *literal == trial.literal);
            let known = found.iter().any(|one| one.knob == trial.knob);
            if is_refused || !trial.changes || known && trial.step.is_some() {
                continue;
            }
            let base = &bases[trial.without];
            let (saves, part) = self.saves(model, trial, base, &|at, slot| self.vehicle(at, slot));
            if saves < self.margin() {
                continue;
            }
            let by_chance = (0..usize::try_from(SEEDS).unwrap_or(1)).map(|seed| {
                let member = |at: usize, slot: usize| model.members[seed][at][slot].as_ref();
                self.saves(model, trial, base, &member).0
            });
            let by_chance = by_chance.fold(0.0, f64::max);
            if saves > self.margin() + BEYOND_CHANCE * by_chance {
                best.push((at, saves, part));
            }
        }
        best.sort_by(|one, other| other.1.total_cmp(&one.1));
        let mut knobs = Vec::new();
        best.retain(|(at, ..)| {
            !knobs.contains(&trials[*at].knob) && {
                knobs.push(trials[*at].knob);
                true
            }
        });
        let most = best.first().map_or(0.0, |best| best.1);
        best.retain(|(_, saves, _)| *saves > NEAR_BEST * most);
        best.truncate(AT_A_TIME);
        best
    }

    /// Cost that a trial saves for these replies, and the part of its change that saves most.
    fn saves<'r>(
        &self,
        model: &Model,
        trial: &Trial,
        base: &[Seen],
        seen: &dyn Fn(usize, usize) -> Option<&'r Reply>,
    ) -> (f64, f64) {
        let saved = |part| self.saved(model, trial, base, part, seen);
        let whole = (saved(1.0), 1.0);
        if trial.step.is_none() {
            return whole;
        }
        let column = self.column(model, base, &trial.seen);
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

    /// Cost that a part of a trial's change saves for these replies.
    fn saved<'r>(
        &self,
        model: &Model,
        trial: &Trial,
        base: &[Seen],
        part: f64,
        seen: &dyn Fn(usize, usize) -> Option<&'r Reply>,
    ) -> f64 {
        let each = self.slots(false).map(|(at, slot)| {
            let (from, to) = (base[at][slot].as_ref(), trial.seen[at][slot].as_ref());
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
            let cost = |cell: &Cell| cell.cost(seen(at, slot), &model.layout, is_real);
            cost(cell) - cost(&changed)
        });
        each.sum()
    }

    /// What changes from one play to another, in standard deviations: a column of the Jacobian.
    fn column(&self, model: &Model, from: &[Seen], to: &[Seen]) -> Vec<f64> {
        let mut column = Vec::new();
        for (at, slot) in self.slots(false) {
            let cell = &model.cells[at][slot];
            let (from, to) = (from[at][slot].as_ref(), to[at][slot].as_ref());
            self.values(
                model,
                cell,
                |channel| {
                    let (from, to) = (from?, to?);
                    let same = Some(from.form) == cell.form && from.form == to.form;
                    same.then(|| to.values[channel] - from.values[channel])
                },
                &mut column,
            );
        }
        column
    }

    /// What is left between replies and model, in standard deviations, and the weights.
    fn rest<'r>(
        &self,
        model: &Model,
        seen: &dyn Fn(usize, usize) -> Option<&'r Reply>,
    ) -> (Vec<f64>, Vec<f64>) {
        let mut rest = Vec::new();
        for (at, slot) in self.slots(false) {
            let cell = &model.cells[at][slot];
            let (reply, is_real) = (seen(at, slot), self.recordings[at].is_real);
            self.values(
                model,
                cell,
                |channel| {
                    let reply = reply.filter(|reply| Some(reply.form) == cell.form)?;
                    let rest = reply.values[channel] - cell.mean[channel];
                    Some(significant(rest, channel, is_real).copysign(rest))
                },
                &mut rest,
            );
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
        let wide: Vec<f64> = (-8..=10)
            .map(|at| value + f64::from(at) * step / 2.0)
            .collect();
        let first = value + part * step;
        let Some((near, _)) = self.ladder(model, knob, &[wide, vec![first]].concat())? else {
            return Ok(None);
        };
        let fine: Vec<f64> = (-6..=6)
            .map(|at| near + f64::from(at) * step.abs() / 12.0)
            .collect();
        let best = self
            .ladder(model, knob, &fine)?
            .map_or(near, |(best, _)| best);
        let settings = knob.set(&model.settings, &knob.literal(&model.settings, best));
        settings.map(|settings| self.model(&settings)).transpose()
    }

    /// The middle of those values of a number that fit best, and half of how far they reach.
    fn ladder(
        &self,
        model: &Model,
        knob: &Knob,
        values: &[f64],
    ) -> Result<Option<(f64, f64)>, String> {
        let allowed = values.iter().filter_map(|value| {
            let settings = knob.set(&model.settings, &knob.literal(&model.settings, *value))?;
            Some((*value, settings))
        });
        let allowed: Vec<(f64, SimSettings)> = allowed.collect();
        let jobs: Vec<_> = allowed.iter().map(|(_, settings)| (settings, 0)).collect();
        let first = self.first(model);
        let played = self.play(&jobs)?;
        let costs: Vec<(f64, f64)> = allowed
            .iter()
            .zip(&played)
            .map(|((value, _), seen)| {
                let each = self.slots(false).map(|(at, slot)| {
                    let (from, to) = (first[at][slot].as_ref(), seen[at][slot].as_ref());
                    let cell = model.cells[at][slot].shifted(from, to, 1.0, &model.layout);
                    cell.cost(
                        self.vehicle(at, slot),
                        &model.layout,
                        self.recordings[at].is_real,
                    )
                });
                (*value, each.sum())
            })
            .collect();
        let least = costs
            .iter()
            .map(|(_, cost)| *cost)
            .fold(f64::INFINITY, f64::min);
        let good = costs.iter().filter(|(_, cost)| *cost <= least + 4.0);
        let good: Vec<f64> = good.map(|(value, _)| *value).collect();
        let (low, high) = (
            good.iter().copied().fold(f64::INFINITY, f64::min),
            good.iter().copied().fold(f64::NEG_INFINITY, f64::max),
        );
        Ok((!good.is_empty()).then_some(((low + high) / 2.0, (high - low) / 2.0)))
    }

    /// Columns of the numbers that were found: what a small change of each does.
    fn jacobian(
        &self,
        model: &Model,
        numbers: &[usize],
    ) -> Result<(DMatrix<f64>, Vec<f64>), String> {
        let mut changed = Vec::new();
        for at in numbers {
            let (knob, step) = (&self.knobs[*at], self.knobs[*at].step() / 4.0);
            let value = knob.number_in(&model.settings);
            let with = |step: f64| {
                let literal = knob.literal(&model.settings, value + step);
                Some((knob.set(&model.settings, &literal)?, step))
            };
            let fallback = || (model.settings.clone(), step);
            changed.push(with(step).or_else(|| with(-step)).unwrap_or_else(fallback));
        }
        let jobs: Vec<_> = changed.iter().map(|(settings, _)| (settings, 0)).collect();
        let played = self.play(&jobs)?;
        let first = self.first(model);
        let columns: Vec<Vec<f64>> = played
            .iter()
            .map(|seen| self.column(model, &first, seen))
            .collect();
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
            let (rest, weights) = self.rest(&model, &|at, slot| self.vehicle(at, slot));
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
        let is_number = |at: &usize| matches!(self.knobs[*at].kind, KnobKind::Number { .. });
        numbers.filter(is_number).collect()
    }

    /// Slot at which one model fits better than another by most.
    fn shows(&self, before: &Model, after: &Model) -> (usize, usize) {
        let saved = |(at, slot): (usize, usize)| {
            let is_real = self.recordings[at].is_real;
            let seen = self.vehicle(at, slot);
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
        bases: &[Arc<Vec<Seen>>],
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
            found[at].saves = saves;
            found[at].or = self.as_good(&without, found[at].knob, saves, trials, bases);
            at += 1;
        }
        Ok(())
    }

    /// Other settings that explain what one explains.
    fn as_good(
        &self,
        without: &Model,
        knob: usize,
        saves: f64,
        trials: &[Trial],
        bases: &[Arc<Vec<Seen>>],
    ) -> Vec<String> {
        let column = |trial: &Trial| self.column(without, &bases[trial.without], &trial.seen);
        let own = trials
            .iter()
            .find(|trial| trial.knob == knob && trial.step.is_some());
        let own = own.map(column);
        let mut names = Vec::new();
        for trial in trials
            .iter()
            .filter(|trial| trial.knob != knob && trial.touches)
        {
            let seen = |at, slot| self.vehicle(at, slot);
            let others = self.saves(without, trial, &bases[trial.without], &seen).0;
            let alike = others > self.margin()
                && own
                    .as_ref()
                    .is_some_and(|own| likeness(own, &column(trial)) > ALIKE);
            if alike || others > (saves - self.margin()).max(0.75 * saves) {
                names.push(self.knobs[trial.knob].name());
            }
        }
        names.dedup();
        names
    }

    /// Notes the values that were found, and their intervals.
    fn measure(&self, model: &Model, found: &mut [Found]) -> Result<(), String> {
        let numbers = self.numbers(found);
        let (matrix, steps) = self.jacobian(model, &numbers)?;
        let chance = (0..usize::try_from(SEEDS).unwrap_or(1)).filter_map(|seed| {
            let member = |at: usize, slot: usize| model.members[seed][at][slot].as_ref();
            let (rest, weights) = self.rest(model, &member);
            Self::solve(&matrix, &rest, &weights)
        });
        let chance: Vec<DVector<f64>> = chance.collect();
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
            let mut half = T99 * sd.max(least) * steps[at].abs();
            let value = knob.number_in(&model.settings);
            if matrix.column(at).amax() < 1.0 {
                // It shows only in what is there or is not, between two values.
                let fine = (-12..=12).map(|at| value + f64::from(at) * knob.step() / 8.0);
                half = self
                    .ladder(model, knob, &fine.collect::<Vec<_>>())?
                    .map_or(half, |(_, half)| half);
                half += knob.step() / 8.0;
            }
            one.number = Some((value, half));
        }
        Ok(())
    }

    fn verdicts(
        &self,
        model: &Model,
        found: &[Found],
        trials: &[Trial],
        bases: &[Arc<Vec<Seen>>],
    ) -> Vec<Verdict> {
        let verdict = |at: usize| {
            let knob = &self.knobs[at];
            if let Some(one) = found.iter().find(|one| one.knob == at) {
                return if one.or.is_empty() {
                    Verdict::Contradicted
                } else {
                    Verdict::NotDecided
                };
            }
            let own = || trials.iter().filter(|trial| trial.knob == at);
            if !own().any(|trial| trial.touches) {
                return Verdict::NotTouched;
            }
            let seen = |at, slot| self.vehicle(at, slot);
            let excluded = |trial: &Trial| {
                self.saved(model, trial, &bases[trial.without], 1.0, &seen) < -self.margin()
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
