//! Numbers by first order around a model: what each set of them saves.

use std::collections::BTreeSet;

use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;

use super::numbers::FIRST_WIDTH;
use super::{Model, Search, Trial};

/// What all numbers do around a model.
pub(super) struct Linear {
    pub(super) numbers: Vec<usize>,
    /// Steps of each from its first value.
    away: DVector<f64>,
    normal: DMatrix<f64>,
    /// `None` if they are not determined.
    covariance: Option<DMatrix<f64>>,
    right: DVector<f64>,
}

impl Linear {
    /// Places of the numbers that are changed in the model.
    pub(super) fn own(&self) -> Vec<usize> {
        let all = 0..self.numbers.len();
        all.filter(|at| self.away[*at] != 0.0).collect()
    }

    /// Variance of a number, in steps, if all others may differ, too; `None` if it is not determined.
    pub(super) fn variance(&self, number: usize) -> Option<f64> {
        let at = self.numbers.iter().position(|one| *one == number)?;
        Some(self.covariance.as_ref()?[(at, at)])
    }

    /// First-order saving of a number, if all others adapt when it is taken back; 0 if it is not determined.
    pub(super) fn need(&self, number: usize) -> f64 {
        let at = self.numbers.iter().position(|one| *one == number);
        let need = at.zip(self.variance(number));
        need.map_or(0.0, |(at, variance)| self.away[at].powi(2) / variance)
    }

    /// The numbers that are left when each that saves less than this is taken back, the least one first.
    fn needed(&self, least: f64) -> Vec<usize> {
        let mut set = Vec::from_iter(0..self.numbers.len());
        loop {
            let part = self.normal.select_rows(&set).select_columns(&set);
            let Some(inverse) = part.try_inverse() else {
                return set;
            };
            let steps = &inverse * self.right.select_rows(&set);
            let saves = |at: usize| steps[at].powi(2) / inverse[(at, at)];
            let all = (0..set.len()).map(|at| (saves(at), at));
            match all.min_by(|one, other| one.0.total_cmp(&other.0)) {
                Some((saves, at)) if saves < least => drop(set.remove(at)),
                _ => return set,
            }
        }
    }

    /// Steps of a set of numbers at its best, from their first values; empty if they are not determined.
    fn steps(&self, set: &[usize]) -> DVector<f64> {
        let part = self.normal.select_rows(set).select_columns(set).cholesky();
        part.map_or_else(DVector::default, |part| {
            part.solve(&self.right.select_rows(set))
        })
    }

    /// Cost that a set of numbers saves at its best.
    pub(super) fn saves(&self, set: &[usize]) -> f64 {
        let steps = self.steps(set);
        let each = steps.iter().zip(set);
        each.map(|(steps, at)| steps * self.right[*at]).sum()
    }
}

impl Search<'_> {
    /// Numbers that act, and those of the model.
    pub(super) fn acting(&self, model: &Model, trials: &[Trial]) -> Vec<usize> {
        let touching = trials
            .iter()
            .filter(|one| one.touches && one.step.is_some());
        let own = self.numbers(&model.settings);
        let numbers: BTreeSet<usize> = touching.map(|one| one.knob).chain(own).collect();
        Vec::from_iter(numbers)
    }

    /// What numbers do around a model.
    pub(super) fn linear(&self, model: &Model, numbers: Vec<usize>) -> Result<Linear, String> {
        let slopes = self.slopes(model, &numbers, &mut vec![FIRST_WIDTH; numbers.len()])?;
        let (rest, weights) = self.rest(model, &self.vehicle);
        let normal = Self::normal(&slopes, &weights, 0.0);
        let away = numbers.iter().map(|at| {
            let knob = &self.knobs[*at];
            let [base, now] = [&self.base, &model.settings].map(|one| knob.number_in(one));
            knob.steps_between(base, now)
        });
        let away = DVector::from_iterator(numbers.len(), away);
        let rest = DVector::from_vec(rest).component_mul(&DVector::from_vec(weights));
        let right = slopes.tr_mul(&rest) + &normal * &away;
        Ok(Linear {
            numbers,
            away,
            covariance: normal.clone().try_inverse(),
            normal,
            right,
        })
    }

    /// The settings without a number, in which few others explain what it did. All are settled first, since slopes
    /// hold only near the best.
    pub(super) fn explained_by_others(
        &self,
        plain: &Model,
        number: usize,
        trials: &[Trial],
    ) -> Result<SimSettings, String> {
        let mut numbers = self.acting(plain, trials);
        numbers.retain(|at| *at != number);
        let dense = self.settle(self.model(&plain.settings, 1.0)?, &numbers)?;
        let linear = self.linear(&dense, numbers)?;
        let settings = self.with_linear(&linear, &dense.settings, &linear.needed(self.margin()));
        let numbers = self.numbers(&settings);
        Ok(self.settle(self.model(&settings, 1.0)?, &numbers)?.settings)
    }

    /// The settings with the numbers of a set at their best, and the others at their first values.
    pub(super) fn with_linear(
        &self,
        linear: &Linear,
        settings: &SimSettings,
        set: &[usize],
    ) -> SimSettings {
        let steps = linear.steps(set);
        let mut settings = settings.clone();
        for (at, number) in linear.numbers.iter().enumerate() {
            let knob = &self.knobs[*number];
            let place = set.iter().position(|one| *one == at);
            let steps = place.and_then(|place| steps.get(place)).copied();
            let base = knob.set(&settings, &knob.default_in(&settings));
            let most = if knob.is_ratio() { 5.0 } else { f64::INFINITY };
            let steps = steps.unwrap_or_default().clamp(-most, most);
            let moved = base.and_then(|base| knob.moved(&base, steps));
            settings = moved.unwrap_or(settings);
        }
        settings
    }
}
