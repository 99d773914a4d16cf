//! Search for changes, over longer and longer beginnings of the recordings.
//!
//! A reply depends only on what came before it. So few settings act in a short beginning, and what was found
//! there holds in the rest.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::DVector;
use rigsim_core::settings::SimSettings;

use super::super::model::{Cell, cost};
use super::super::recording::Recording;
use super::numbers::FIRST_WIDTH;
use super::{Found, Judged, LUCK, Model, Search, Trial};

/// Number of beginnings of the recordings, searched one after the other.
const BEGINNINGS: usize = 8;
/// Factors that widen the deviations, one after the other: a value that is far off has no slope.
const SCALES: [f64; 2] = [10.0, 1.0];
/// Most sets of changes that are kept, and changes that are added to each.
const KEPT: usize = 2;
const ADDED: usize = 4;
/// Multiple of the mean of chance that is still chance.
const CHANCE: f64 = 1.1;
/// Most searches of the whole recordings from where one ended.
const MOST_AGAIN: usize = 3;
/// First-order saving above which the search does not try to take a change back while it grows. At its end it does not
/// let all other numbers take the place of such a change, since that takes long.
pub(super) const NEEDED: f64 = 1000.0;
/// Cost beyond that of a set which explains all, from which no search of another leads below it.
const DEAR: f64 = 1000.0;

/// Settings, by what was changed: choices with their values.
type Set = Vec<(usize, String)>;

/// Expected saving of a trial if the numbers adapt.
pub(super) struct Promise<'t> {
    saves: f64,
    /// Fraction of its change.
    part: f64,
    /// Steps of the numbers for the whole change.
    follow: Vec<f64>,
    /// Set if it improves bits, or which replies are there.
    is_form: bool,
    pub(super) trial: &'t Trial,
}

impl Promise<'_> {
    /// Steps of a number by first order; `None` for a choice.
    pub(super) fn steps(&self) -> Option<f64> {
        Some(self.part * self.trial.step?)
    }
}

impl Search<'_> {
    /// The settings with which the model reproduces the recordings.
    pub(super) fn grown(&self) -> Result<SimSettings, String> {
        let mut kept = vec![self.base.clone()];
        for part in 1..=BEGINNINGS {
            let recordings = self.recordings.iter();
            let recordings: Vec<Recording> = recordings
                .map(|one| one.beginning(part, BEGINNINGS))
                .collect();
            let beginning = Search {
                recordings: &recordings,
                vehicle: recordings.iter().map(|one| one.seen.clone()).collect(),
                base: self.base.clone(),
                knobs: self.knobs.clone(),
                all: self.all.clone(),
                progress: self.progress.clone(),
            };
            let is_explained = beginning.is_explained(&beginning.model(&kept[0], 1.0)?);
            if part < BEGINNINGS && is_explained {
                continue;
            }
            let mut idle = None;
            for scale in SCALES {
                let is_last = part == BEGINNINGS && scale == 1.0;
                kept = beginning.grow(kept, scale, is_last, &mut idle)?;
            }
        }
        self.again(kept)
    }

    /// The model that is found from the changes that are certain, and what was found in it, if it is clearly better.
    /// Instead of each change that is not certain, others were tried, but never instead of several at once.
    pub(super) fn again_from_certain(
        &self,
        model: &Model,
        found: &[Found],
    ) -> Result<Option<(Model, Judged)>, String> {
        // Their intervals, and so doubts about them, are not known yet.
        let doubted = found.iter().filter(|one| self.doubt(one).is_some());
        if doubted.clone().count() < 2 {
            return Ok(None);
        }
        let mut certain = model.settings.clone();
        for one in doubted {
            let knob = &self.knobs[one.knob];
            let taken_back = knob.set(&certain, &knob.default_in(&certain));
            certain = taken_back.unwrap_or(certain);
        }
        let mut next = self.model(&self.again(vec![certain])?, 1.0)?;
        if !self.is_clearly_better(model, &next)? {
            return Ok(None);
        }
        let judged = self.prune(&mut next)?;
        let is_still = self.is_clearly_better(model, &next)?;
        Ok(is_still.then_some((next, judged)))
    }

    /// Returns whether other settings cost less by more than luck, with the same scatter.
    fn is_clearly_better(&self, model: &Model, next: &Model) -> Result<bool, String> {
        let moved = self.moved(model, vec![next.settings.clone()])?.remove(0);
        let (saves, least) = self.gain(&self.costs(model)?, &self.costs(&moved)?);
        let [before, after] = [model, next].map(|one| self.of_changes(&one.settings));
        Ok(saves + before - after > least)
    }

    /// The best of these sets at its best values, searched again from there as long as chance does not explain
    /// what is left: a change may have been tried before another that it needs, or far from where its effect was seen.
    fn again(&self, mut kept: Vec<SimSettings>) -> Result<SimSettings, String> {
        let mut model = self.model(&kept[0], 1.0)?;
        for _ in 0..MOST_AGAIN {
            if self.is_explained(&model) {
                break;
            }
            for scale in SCALES {
                kept = self.grow(kept, scale, scale == 1.0, &mut None)?;
            }
            let next = self.model(&kept[0], 1.0)?;
            if self.price(&next, true)? >= self.price(&model, true)? {
                break;
            }
            model = next;
        }
        let numbers = self.numbers(&model.settings);
        for at in &numbers {
            model = self.bisect(model, *at)?;
        }
        Ok(self.polish(model, &numbers, f64::INFINITY)?.settings)
    }

    /// Adds changes and takes them back, from several sets of them on; returns the best sets.
    fn grow(
        &self,
        kept: Vec<SimSettings>,
        scale: f64,
        is_last: bool,
        idle: &mut Option<BTreeSet<usize>>,
    ) -> Result<Vec<SimSettings>, String> {
        let mut known: BTreeSet<Set> = BTreeSet::new();
        let mut all: Vec<(f64, bool, Model)> = Vec::new();
        for settings in kept {
            let mut model = self.model(&settings, scale)?;
            if !self.is_explained(&model) {
                model = self.polish(model, &self.numbers(&settings), f64::INFINITY)?;
            }
            if known.insert(self.set(&model.settings)) {
                all.push((self.price(&model, is_last)?, false, model));
            }
        }
        let mut trials = Vec::new();
        loop {
            all.sort_by(|one, other| one.0.total_cmp(&other.0));
            all.truncate(KEPT);
            let next = all.iter().find(|one| !one.1);
            let is_far = !is_last || next.is_some_and(|next| next.0 > all[0].0 + DEAR);
            // Chance is that of plays of this model, not of the one that it was moved from.
            let is_done = is_far && self.is_explained(&self.model(&all[0].2.settings, scale)?);
            let open = all.iter_mut().find(|one| !one.1);
            let Some((_, is_searched, model)) = open.filter(|_| !is_done) else {
                break;
            };
            *is_searched = true;
            let model = model.clone();
            let worst = all.get(KEPT - 1).map_or(f64::INFINITY, |one| one.0);
            if trials.is_empty() {
                trials = self.trials(&model, idle.as_ref().unwrap_or(&BTreeSet::new()))?;
                let acts = |one: &Trial| !Arc::ptr_eq(&one.from, &one.to);
                let acts = |at: &usize| trials.iter().any(|one| one.knob == *at && acts(one));
                idle.get_or_insert_with(|| {
                    let all = (0..self.knobs.len()).filter(|at| !acts(at));
                    all.collect()
                });
            }
            for next in self.neighbours(&model, scale, worst, &trials, &mut known)? {
                all.push((self.price(&next, is_last)?, false, next));
            }
        }
        Ok(all.into_iter().map(|(.., model)| model.settings).collect())
    }

    /// Returns whether chance explains the residual.
    fn is_explained(&self, model: &Model) -> bool {
        self.cost(model, false) < CHANCE * self.by_chance(model, false) + self.margin()
    }

    fn set(&self, settings: &SimSettings) -> Set {
        let value = |at: usize| match self.knobs[at].choices.is_empty() {
            true => (at, String::new()),
            false => (at, self.knobs[at].literal_in(settings)),
        };
        self.changed(settings).into_iter().map(value).collect()
    }

    /// Models of new sets with one change more or less, with their numbers at the best if that may cost less than
    /// the `worst` that is kept.
    fn neighbours(
        &self,
        model: &Model,
        scale: f64,
        worst: f64,
        trials: &[Trial],
        known: &mut BTreeSet<Set>,
    ) -> Result<Vec<Model>, String> {
        let polish = |next: Model| {
            let numbers = self.numbers(&next.settings);
            let goal = worst - self.of_changes(&next.settings) + LUCK;
            self.polish(next, &numbers, goal)
        };
        let mut all = Vec::new();
        let numbers = self.numbers(&model.settings);
        let promises = self.promises(model, &numbers, trials.iter(), self.margin() / 2.0)?;
        let mut knobs = BTreeSet::new();
        for promise in promises {
            let knob = promise.trial.knob;
            let is_number = promise.trial.step.is_some();
            if knobs.len() == ADDED || is_number && numbers.contains(&knob) || !knobs.insert(knob) {
                continue;
            }
            let Some(next) = self.with(model, &numbers, &promise)? else {
                continue;
            };
            if known.insert(self.set(&next.settings)) {
                all.push(polish(next)?);
            }
        }
        if scale > 1.0 {
            return Ok(all);
        }
        let linear = self.linear(model, numbers)?;
        for knob in self.changed(&model.settings) {
            if linear.need(knob) > NEEDED {
                continue;
            }
            let default = self.knobs[knob].default_in(&model.settings);
            let Some(settings) = self.knobs[knob].set(&model.settings, &default) else {
                continue;
            };
            if known.insert(self.set(&settings)) {
                for next in self.moved(model, vec![settings])? {
                    all.push(polish(next)?);
                }
            }
        }
        Ok(all)
    }

    /// The trials that save this much if the numbers adapt, the best first.
    pub(super) fn promises<'t>(
        &self,
        model: &Model,
        numbers: &[usize],
        trials: impl Iterator<Item = &'t Trial>,
        least: f64,
    ) -> Result<Vec<Promise<'t>>, String> {
        let slopes = self.slopes(model, numbers, &mut vec![FIRST_WIDTH; numbers.len()])?;
        let (rest, weights) = self.rest(model, &self.vehicle);
        let normal = Self::normal(&slopes, &weights, 0.0).cholesky();
        let before: f64 = rest.iter().map(|rest| cost(*rest)).sum();
        let promise = |trial: &'t Trial| {
            let mut column = DVector::from_vec(self.column(model, &trial.from, &trial.to));
            let weighted = |column: &DVector<f64>| {
                let products = column
                    .iter()
                    .zip(&weights)
                    .map(|(one, weight)| one * weight);
                DVector::from_iterator(weights.len(), products)
            };
            let solved = normal
                .as_ref()
                .map(|normal| normal.solve(&slopes.tr_mul(&weighted(&column))));
            let follow = solved.map_or(vec![0.0; numbers.len()], |solved| {
                (-solved).as_slice().to_vec()
            });
            column += &slopes * DVector::from_column_slice(&follow);
            let by_weight = weighted(&column);
            let of_rest: f64 = by_weight
                .iter()
                .zip(&rest)
                .map(|(one, rest)| one * rest)
                .sum();
            let part = (of_rest / by_weight.dot(&column)).clamp(-3.0, 3.0);
            let is_number = trial.step.is_some() && part.is_finite();
            let saves = |part: f64| {
                let after = rest.iter().zip(&column);
                before
                    - after
                        .map(|(rest, change)| cost(rest - part * change))
                        .sum::<f64>()
            };
            let of_form = self.saved_form(model, trial);
            let [whole, partly] = [1.0, if is_number { part } else { 1.0 }]
                .map(|part| (saves(part) + if part > 0.5 { of_form } else { 0.0 }, part));
            let (saves, part) = if partly.0 > whole.0 { partly } else { whole };
            Promise {
                saves,
                part,
                follow,
                is_form: of_form > saves / 2.0,
                trial,
            }
        };
        let trials = trials.filter(|trial| trial.touches);
        let mut all: Vec<Promise<'t>> = trials.map(promise).collect();
        all.retain(|promise| promise.saves > least);
        all.sort_by(|one, other| other.saves.total_cmp(&one.saves));
        Ok(all)
    }

    /// Saving of a trial by bits, and by which replies are there.
    fn saved_form(&self, model: &Model, trial: &Trial) -> f64 {
        let each = self.slots(false).map(|(at, slot)| {
            let [from, to, seen] =
                [&**trial.from, &trial.to, &self.vehicle].map(|play: &[_]| play[at][slot].as_ref());
            if from == to {
                return 0.0;
            }
            let (cell, is_real) = (&model.cells[at][slot], self.recordings[at].is_real);
            let changed = cell.shifted(from, to, 1.0, &model.layout);
            let is_same = changed.form == cell.form && changed.answers == cell.answers;
            let cost = |cell: &Cell| match is_same {
                true => cell.cost_of_form(seen, &model.layout),
                false => cell.cost(seen, &model.layout, is_real),
            };
            cost(cell) - cost(&changed)
        });
        each.sum()
    }

    /// The model with the changes of a trial; `None` if they are not allowed.
    fn with(
        &self,
        model: &Model,
        numbers: &[usize],
        promise: &Promise<'_>,
    ) -> Result<Option<Model>, String> {
        let Promise {
            part,
            follow,
            trial,
            ..
        } = promise;
        let knob = &self.knobs[trial.knob];
        let mut all = Vec::new();
        for part in [*part, part / 2.0] {
            let follow: Vec<f64> = follow.iter().map(|steps| steps * part).collect();
            let settings = match trial.step {
                Some(step) => knob.moved(&model.settings, step * part),
                None => knob.set(&model.settings, &trial.literal),
            };
            let Some(settings) = settings else { continue };
            all.push(self.shifted(&settings, numbers, &follow));
            all.push(settings);
        }
        if trial.step.is_some() {
            let far = [0.3, 0.6, 1.0, 1.5, 2.5, 5.0];
            let far = far.iter().flat_map(|steps| [-steps, *steps]);
            all.extend(far.filter_map(|steps| knob.moved(&model.settings, steps)));
        } else {
            all.truncate(2);
        }
        let all = self.moved(model, all)?.into_iter();
        let all = all.map(|next| (self.cost(&next, false), next));
        let best = all.min_by(|one, other| one.0.total_cmp(&other.0));
        let best = best.map(|(_, model)| model);
        match best {
            Some(best) if promise.is_form && trial.step.is_some() => {
                self.bisect(best, trial.knob).map(Some)
            }
            best => Ok(best),
        }
    }
}
