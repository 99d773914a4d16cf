//! Numbers: the effect of small changes, their best values, and the values that fit as well.

use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;

use super::super::knob::Knob;
use super::super::model::{Cell, significant, weight};
use super::super::recording::{Reply, Seen};
use super::{Model, Play, Search};

/// Most steps in which numbers are improved.
const MOST_STEPS: usize = 20;
/// Steps after which it is judged whether a goal can be reached, and the multiple of what the last step saved and
/// of what the next may save by first order that is not enough for it.
const FIRST_STEPS: usize = 2;
const HOPED: f64 = 3.0;
/// Damping above which a step is too short to be of use.
const MOST_DAMPING: f64 = 300.0;
/// Dampings that are tried in each step, and the cost that a step has to save, by the mean of plays.
const DAMPINGS: [f64; 4] = [0.0, 0.1, 1.0, 10.0];
const LEAST_SAVED: f64 = 4.0;
/// Least effect of a change from which a slope is taken, in standard deviations.
const WIDTH: f64 = 400.0;
/// Least change from which a slope is taken, in steps. Tyres slip and stick at other times after any change, however
/// small, which hides what two changes do together if they nearly cancel one another.
const LEAST_WIDTH: f64 = 0.2;
/// The first such change, and a small one.
pub(super) const FIRST_WIDTH: f64 = 0.6;
pub(super) const SMALL_WIDTH: f64 = 0.25;
/// A change, in steps, that does nothing if a number acts in jumps.
const TINY: f64 = 0.02;
/// Weight that holds a number without effect, as if it were known to about two steps.
const HELD: f64 = 0.25;
/// Cost above the least, within which the values of a number are as good: 99 % of a chi-square with one degree
/// of freedom.
const AS_GOOD: f64 = 6.63;

impl Search<'_> {
    /// Difference of two plays, in standard deviations: a column of the Jacobian.
    pub(super) fn column(&self, model: &Model, from: &[Seen], to: &[Seen]) -> Vec<f64> {
        self.values(model, |(at, slot), cell, channel| {
            let [from, to] = [from, to].map(|play| play[at][slot].as_ref());
            let has_form = |one: &&Reply| Some(one.form) == cell.form;
            let (from, to) = (from.filter(has_form)?, to.filter(has_form)?);
            Some(to.values[channel] - from.values[channel])
        })
    }

    /// Residuals between replies and model, in standard deviations, and the weights.
    pub(super) fn rest(&self, model: &Model, seen: &[Seen]) -> (Vec<f64>, Vec<f64>) {
        let rest = self.values(model, |(at, slot), cell, channel| {
            let reply = seen[at][slot].as_ref();
            let reply = reply.filter(|reply| Some(reply.form) == cell.form)?;
            let rest = reply.values[channel] - cell.mean[channel];
            Some(significant(rest, channel, self.recordings[at].is_real).copysign(rest))
        });
        let weights = rest.iter().map(|rest| weight(*rest)).collect();
        (rest, weights)
    }

    /// A value for each numeric channel of each slot, in standard deviations.
    pub(super) fn values(
        &self,
        model: &Model,
        value: impl Fn((usize, usize), &Cell, usize) -> Option<f64>,
    ) -> Vec<f64> {
        let mut all = Vec::new();
        for (at, slot) in self.slots(false) {
            let cell = &model.cells[at][slot];
            for (channel, info) in model.layout.of_form(cell.form).iter().enumerate() {
                if !info.is_choice && channel < cell.mean.len() {
                    let value = value((at, slot), cell, channel).unwrap_or(0.0);
                    all.push(value / cell.sd[channel]);
                }
            }
        }
        all
    }

    /// Of values this many steps away, those that are allowed, in ascending order, and what each saves.
    pub(super) fn ladder(
        &self,
        model: &Model,
        knob: &Knob,
        steps: impl Iterator<Item = f64>,
    ) -> Result<Vec<(f64, f64)>, String> {
        let value = knob.number_in(&model.settings);
        let allowed = steps.filter_map(|steps| {
            let settings = knob.set_number(&model.settings, knob.beyond(value, steps))?;
            Some((knob.number_in(&settings), self.quiet(settings)))
        });
        let mut allowed: Vec<(f64, SimSettings)> = allowed.collect();
        allowed.sort_by(|one, other| one.0.total_cmp(&other.0));
        let jobs: Vec<_> = allowed.iter().map(|(_, settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let saved = |to: &Play| self.saved(model, [&model.quiet, to], 1.0);
        let values = allowed.iter().map(|(value, _)| *value);
        Ok(values.zip(played.iter().map(saved)).collect())
    }

    /// Ends of the interval that fits as well as the present value of a number; `None` for an open end.
    pub(super) fn ends(&self, model: &Model, knob: &Knob) -> Result<[Option<f64>; 2], String> {
        let far = (1..=12).map(|power| 1.5 * 1.5_f64.powi(power));
        let far = far.flat_map(|steps| [-steps, steps]);
        let near = (-12..=12).map(|part| f64::from(part) / 8.0);
        let [base, now] = [&self.base, &model.settings].map(|one| knob.number_in(one));
        let assumed = std::iter::once(knob.steps_between(now, base));
        let ladder = self.ladder(model, knob, near.chain(far).chain(assumed))?;
        // What fits ends somewhere before the first value that does not.
        let ends = as_good(&ladder).map(|[low, high]| [low.checked_sub(1), Some(high + 1)]);
        let end = |at: Option<usize>| Some(ladder.get(at?)?.0);
        Ok(ends.unwrap_or_default().map(end))
    }

    /// Returns whether a number acts in jumps: a tiny change does nothing.
    pub(super) fn jumps(&self, model: &Model, knob: &Knob) -> Result<bool, String> {
        if knob.is_whole() {
            return Ok(false);
        }
        let tiny = [-TINY, TINY].iter();
        let tiny = tiny.filter_map(|steps| knob.moved(&model.settings, *steps));
        let tiny = self.moved(model, tiny.collect())?;
        let does_nothing = |next: &Model| {
            let column = self.column(model, &model.quiet, &next.quiet);
            column.iter().all(|change| *change == 0.0)
        };
        Ok(tiny.iter().any(does_nothing))
    }

    /// Moves a number to the middle of the values that fit best, wherever they are.
    pub(super) fn bisect(&self, mut model: Model, at: usize) -> Result<Model, String> {
        let knob = &self.knobs[at];
        for scale in [2.0, 12.0] {
            let steps = (-10..=10).map(|part| f64::from(part) / scale);
            let ladder = self.ladder(&model, knob, steps)?;
            let Some([low, high]) = as_good(&ladder).map(|ends| ends.map(|at| ladder[at].0)) else {
                break;
            };
            let value = knob.number_in(&model.settings);
            let middle = knob.steps_between(value, low) + knob.steps_between(value, high);
            let settings = knob.moved(&model.settings, middle / 2.0);
            let next = self.moved(&model, settings.into_iter().collect())?;
            let is_better = |next: &Model| self.cost(next, false) <= self.cost(&model, false);
            model = next.into_iter().find(is_better).unwrap_or(model);
        }
        Ok(model)
    }

    /// Effect of a step of each number, from changes to both sides that are wide enough to show; updates the widths.
    pub(super) fn slopes(
        &self,
        model: &Model,
        numbers: &[usize],
        widths: &mut [f64],
    ) -> Result<DMatrix<f64>, String> {
        let mut changed = Vec::new();
        for (at, width) in numbers.iter().zip(&*widths) {
            let knob = &self.knobs[*at];
            let value = knob.number_in(&model.settings);
            let with = |steps: f64| {
                let settings = knob.set_number(&model.settings, knob.beyond(value, steps))?;
                let steps = knob.steps_between(value, knob.number_in(&settings));
                (steps != 0.0).then(|| (self.quiet(settings), steps))
            };
            for width in [*width, -*width] {
                // A whole number may need a whole step.
                let change = with(width).or_else(|| with(width.signum()));
                changed.push(change.unwrap_or_else(|| (self.quiet(model.settings.clone()), 0.0)));
            }
        }
        let jobs: Vec<_> = changed.iter().map(|(settings, _)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let weights = self.rest(model, &self.vehicle).1;
        let mut columns = Vec::new();
        let pairs = played.chunks(2).zip(changed.chunks(2));
        for ((seen, change), width) in pairs.zip(widths) {
            let mut column = self.column(model, &seen[1], &seen[0]);
            let steps = match change[0].1 - change[1].1 {
                0.0 => 1.0,
                steps => steps,
            };
            column.iter_mut().for_each(|change| *change /= steps);
            let squares = column
                .iter()
                .zip(&weights)
                .map(|(slope, w)| slope * slope * w);
            *width = (WIDTH / squares.sum::<f64>().sqrt()).clamp(LEAST_WIDTH, 1.0);
            columns.extend(column);
        }
        let rows = weights.len();
        Ok(DMatrix::from_vec(rows, numbers.len(), columns))
    }

    /// The normal matrix; numbers without effect are held where they are.
    pub(super) fn normal(matrix: &DMatrix<f64>, weights: &[f64], damping: f64) -> DMatrix<f64> {
        let mut weighted = matrix.clone();
        for (mut row, weight) in weighted.row_iter_mut().zip(weights) {
            row *= *weight;
        }
        let mut normal = matrix.tr_mul(&weighted);
        for at in 0..normal.nrows() {
            normal[(at, at)] += damping * normal[(at, at)] + HELD;
        }
        normal
    }

    /// Improves all numbers together, by the method of Levenberg and Marquardt. Ends early where the cost will not
    /// come down to `goal`.
    pub(super) fn polish(
        &self,
        mut model: Model,
        numbers: &[usize],
        goal: f64,
    ) -> Result<Model, String> {
        let mut damping = 1e-3;
        // Whether these come from slopes.
        let (mut widths, mut are_known) = (vec![0.5; numbers.len()], false);
        let mut before = self.cost(&model, false);
        let mut saved = 0.0;
        for step in 0..if numbers.is_empty() { 0 } else { MOST_STEPS } {
            let slopes = self.slopes(&model, numbers, &mut widths)?;
            let (rest, weights) = self.rest(&model, &self.vehicle);
            let rest = DVector::from_vec(rest);
            let pull = rest.component_mul(&DVector::from_column_slice(&weights));
            let right = slopes.tr_mul(&pull);
            if step >= FIRST_STEPS && before - goal > HOPED * saved {
                let normal = Self::normal(&slopes, &weights, 0.0).cholesky();
                let may_save = normal.map_or(1.0, |normal| right.dot(&normal.solve(&right)));
                // As a share, since far off the cost grows slowly.
                if before - goal > HOPED * before * may_save / pull.dot(&rest) {
                    break;
                }
            }
            saved = 0.0;
            while saved <= 0.0 && damping < MOST_DAMPING {
                let dampings = [damping, 30.0 * damping];
                let all = self
                    .damped(&model, numbers, &slopes, &weights, &dampings)?
                    .into_iter();
                let all = all.map(|next| (self.cost(&next, false), next));
                let best = all.min_by(|one, other| one.0.total_cmp(&other.0));
                let Some((cost, next)) = best.filter(|best| best.0 < before) else {
                    damping *= 900.0;
                    continue;
                };
                saved = before - cost;
                (model, before, damping) = (next, cost, damping / 10.0);
            }
            if saved < 2.0 {
                if are_known {
                    break;
                }
                (are_known, damping) = (true, 1e-3);
            }
        }
        Ok(model)
    }

    /// Improves all numbers together as `polish` does, by the mean cost of plays with each number a little off. One
    /// play may be good by luck.
    pub(super) fn settle(&self, mut model: Model, numbers: &[usize]) -> Result<Model, String> {
        if numbers.is_empty() {
            return Ok(model);
        }
        let cost = |model: &Model| Ok::<f64, String>(self.costs(model)?.each.iter().sum());
        let mut before = cost(&model)?;
        for _ in 0..MOST_STEPS / 2 {
            let slopes = self.slopes(&model, numbers, &mut vec![FIRST_WIDTH; numbers.len()])?;
            let weights = self.rest(&model, &self.vehicle).1;
            let all = self
                .damped(&model, numbers, &slopes, &weights, &DAMPINGS)?
                .into_iter();
            let all = all.map(|next| Ok((cost(&next)?, next)));
            let all: Vec<(f64, Model)> = all.collect::<Result<_, String>>()?;
            let best = all
                .into_iter()
                .min_by(|one, other| one.0.total_cmp(&other.0));
            match best.filter(|(after, _)| *after < before - LEAST_SAVED) {
                Some((after, next)) => (before, model) = (after, next),
                None => break,
            }
        }
        Ok(model)
    }

    /// The models of steps to the best values by first order, with each damping.
    fn damped(
        &self,
        model: &Model,
        numbers: &[usize],
        slopes: &DMatrix<f64>,
        weights: &[f64],
        dampings: &[f64],
    ) -> Result<Vec<Model>, String> {
        let rest = DVector::from_vec(self.rest(model, &self.vehicle).0);
        let right = slopes.tr_mul(&rest.component_mul(&DVector::from_column_slice(weights)));
        let tried = dampings.iter().filter_map(|damping| {
            let normal = Self::normal(slopes, weights, *damping).cholesky()?;
            Some(self.shifted(&model.settings, numbers, normal.solve(&right).as_slice()))
        });
        self.moved(model, tried.collect())
    }

    /// The settings with numbers moved by this many steps.
    pub(super) fn shifted(
        &self,
        settings: &SimSettings,
        numbers: &[usize],
        steps: &[f64],
    ) -> SimSettings {
        let mut settings = settings.clone();
        for (at, steps) in numbers.iter().zip(steps) {
            let knob = &self.knobs[*at];
            let most = if knob.is_ratio() { 2.0 } else { f64::INFINITY };
            let moved = knob.moved(&settings, steps.clamp(-most, most));
            settings = moved.unwrap_or(settings);
        }
        settings
    }

    /// The numbers among changed settings.
    pub(super) fn numbers(&self, settings: &SimSettings) -> Vec<usize> {
        let mut changed = self.changed(settings);
        changed.retain(|at| self.knobs[*at].choices.is_empty());
        changed
    }
}

/// Places of the first and the last value around the best that save as much.
fn as_good(ladder: &[(f64, f64)]) -> Option<[usize; 2]> {
    let saved = ladder.iter().map(|(_, saved)| *saved);
    let most = saved.clone().fold(f64::NEG_INFINITY, f64::max);
    let best = saved.clone().position(|saved| saved == most)?;
    let good = |at: &usize| ladder[*at].1 >= most - AS_GOOD;
    let low = (0..=best).rev().take_while(good).last()?;
    let high = (best..ladder.len()).take_while(good).last()?;
    Some([low, high])
}
