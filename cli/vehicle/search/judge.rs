//! Which changes are needed, which others explain as much, and the result for each setting.

use std::collections::BTreeSet;
use std::sync::Arc;

use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;
use rigsim_settings::Basis;

use super::super::knob::Knob;
use super::super::model::{ADAPTER, DIFFERENT, cost};
use super::super::recording::{LATE, Seen, middle};
use super::grow::NEEDED;
use super::linear::Linear;
use super::numbers::SMALL_WIDTH;
use super::{
    Costs, Doubt, ENOUGH, Found, Judged, LUCK, Model, Play, SHARE, Search, Trial, Verdict,
};

/// Most changes that are exchanged for others.
const MOST_SWAPS: usize = 8;
/// Half of a 99 % interval, in standard deviations, including the scatter of the model's plays.
const WIDE: f64 = 3.0;
/// Changes of another number that are tried instead of a setting, in steps, and how many settings are tried.
const INSTEAD: [f64; 6] = [-5.5, -2.0, -0.7, 0.7, 2.0, 5.5];
const MOST_INSTEAD: usize = 2;
/// How many of them are tried by two.
const MOST_PAIRED: usize = 6;
/// Most numbers that are named instead of one, unless they explain more. Many explain almost as much as anything.
const MOST_OTHERS: usize = 3;
/// End of the names of settings of a spread, and the share of a number that it may explain before it is named.
const SPREAD: &str = "reply_spread";
const MOST_BY_SPREAD: f64 = 0.25;
/// Word between two settings that explain together as much as one.
const WITH: &str = " with ";
/// Residual of what a setting changes that is allowed, in standard deviations of chance.
const LEFT: f64 = 4.0;
/// Greatest variance of a number that is determined by its slope, in steps squared.
const MOST_VARIANCE: f64 = 0.1;
/// Least effect of a step on a reply that is a slope, in standard deviations.
const STEEP: f64 = 4.0;
/// Parts of the recordings from which the scatter of numbers is estimated.
const PARTS: usize = 20;

/// A model without one of its changes.
struct Removal {
    knob: usize,
    /// The other numbers where they are.
    plain: Model,
    /// The other numbers at their best values.
    best: Model,
    /// Cost that the change saves.
    saves: f64,
    /// The least that is no luck.
    least: f64,
}

impl Search<'_> {
    /// Slot at which one model's advantage over another is greatest.
    fn shows(&self, before: &Model, after: &Model) -> (usize, usize) {
        let saved = |at| self.saved_at(before, after, at);
        let slots = self.slots(false);
        slots
            .max_by(|one, other| saved(*one).total_cmp(&saved(*other)))
            .unwrap_or_default()
    }

    /// Takes back changes that the others explain as well, exchanges those for which another explains more, and
    /// records those that explain as much. The numbers of the others are at their best each time. Also returns the
    /// trials of the model that is left.
    pub(super) fn prune(&self, model: &mut Model) -> Result<Judged, String> {
        let mut swaps = MOST_SWAPS;
        let (mut tried, mut trials) = (None, Vec::new());
        'model: loop {
            let (removals, costs) = self.take_back(model)?;
            if tried.as_ref() != Some(&model.settings) {
                trials = self.trials(model, &BTreeSet::new())?;
                tried = Some(model.settings.clone());
            }
            let linear = self.linear(model, self.acting(model, &trials))?;
            let cost = self.cost(model, false);
            let mut found: Vec<Found> = Vec::new();
            for removal in removals {
                let knob = &self.knobs[removal.knob];
                let literal = knob.literal_in(&model.settings);
                let (mut or, mut as_good) = (Vec::new(), Vec::new());
                let is_weak = knob.choices.is_empty() && linear.need(removal.knob) < NEEDED;
                if is_weak {
                    let (names, next) = self.numbers_instead(model, &costs, &removal, &trials)?;
                    let by_next = self.costs(&next)?;
                    let ((left, least), (saves, _)) =
                        (self.gain(&by_next, &costs), self.gain(&costs, &by_next));
                    let is_needless = names.is_empty() && left < least;
                    let is_better =
                        !names.is_empty() && swaps > 0 && saves > self.for_others(&names, least);
                    if is_needless || is_better {
                        swaps -= usize::from(is_better);
                        *model = self.model(&next.settings, 1.0)?;
                        continue 'model;
                    }
                    if saves > 0.0 || names.len() <= MOST_OTHERS && left < least {
                        or.push(names.join(WITH));
                        as_good.push(next.settings);
                    }
                }
                let mut others = self.instead(&removal, &literal, &trials)?;
                others.extend(self.two_instead(model, &linear, removal.knob)?);
                let mut better: Option<(f64, Model)> = None;
                for (names, tried) in others {
                    let numbers = self.numbers(&tried.settings);
                    let goal = cost + removal.least + self.margin() + LUCK;
                    let tried = self.polish(tried, &numbers, goal)?;
                    let by_tried = self.costs(&tried)?;
                    let (saves, least) = self.gain(&costs, &by_tried);
                    if saves > self.for_others(&names, least) && swaps > 0 {
                        if better.as_ref().is_none_or(|better| saves > better.0) {
                            better = Some((saves, tried));
                        }
                    } else if self.gain(&by_tried, &costs).0 < least {
                        or.push(names.join(WITH));
                        as_good.push(tried.settings);
                    }
                }
                if let Some((_, better)) = better {
                    swaps -= 1;
                    *model = self.model(&better.settings, 1.0)?;
                    continue 'model;
                }
                let by_spread = self.by_spread(model, &costs, &removal)?;
                if by_spread > MOST_BY_SPREAD {
                    let spreads = self.all.iter().filter(|knob| knob.key.ends_with(SPREAD));
                    or.extend(spreads.map(Knob::name));
                }
                let mut names = BTreeSet::new();
                or.retain(|one| names.insert(one.clone()));
                found.push(Found {
                    knob: removal.knob,
                    literal,
                    number: None,
                    by_spread,
                    or,
                    as_good,
                    saves: removal.saves,
                    is_shaky: is_weak && removal.saves < LUCK,
                    left: self.left(&removal.best, model),
                    shown_by: self.shows(&removal.best, model),
                });
            }
            for at in 0..found.len() {
                let one = &found[at];
                found[at].is_shaky = one.is_shaky
                    && one.or.is_empty()
                    && self.is_needless(model, &found, one.knob)?;
            }
            return Ok((found, trials));
        }
    }

    /// Cost that others have to save where they are taken instead of one: more than by luck, and as much as any change
    /// for each further one.
    fn for_others(&self, names: &[String], least: f64) -> f64 {
        least.max(self.margin() * names.len().saturating_sub(1) as f64)
    }

    /// Takes back the changes that save no more than luck, the least one first; returns the model without each of the
    /// others, and its costs.
    fn take_back(&self, model: &mut Model) -> Result<(Vec<Removal>, Costs), String> {
        loop {
            let costs = self.costs(model)?;
            let changed = self.changed(&model.settings).into_iter();
            let removals = changed.map(|knob| self.removal(model, &costs, knob));
            let removals = removals.collect::<Result<Vec<_>, _>>()?;
            let by_luck = removals.iter().filter(|one| one.saves < one.least);
            match by_luck.min_by(|one, other| one.saves.total_cmp(&other.saves)) {
                Some(least) => *model = self.model(&least.best.settings, 1.0)?,
                None => return Ok((removals, costs)),
            }
        }
    }

    /// A model, which has these costs, without a change.
    fn removal(&self, model: &Model, costs: &Costs, knob: usize) -> Result<Removal, String> {
        let about = &self.knobs[knob];
        let settings = about.set(&model.settings, &about.default_in(&model.settings));
        let settings = settings.ok_or_else(|| format!("{} cannot be taken back", about.key))?;
        let plain = self.moved(model, vec![settings])?.remove(0);
        let best = self.polish(plain.clone(), &self.numbers(&plain.settings), f64::INFINITY)?;
        let (saves, least) = self.gain(&self.costs(&best)?, costs);
        Ok(Removal {
            knob,
            plain,
            best,
            saves,
            least,
        })
    }

    /// Returns whether a change saves no more than luck in a model with another instead of one of the found.
    fn is_needless(&self, model: &Model, found: &[Found], knob: usize) -> Result<bool, String> {
        for settings in found.iter().flat_map(|one| &one.as_good) {
            let with = self.moved(model, vec![settings.clone()])?.remove(0);
            let removal = self.removal(&with, &self.costs(&with)?, knob)?;
            if removal.saves < removal.least {
                return Ok(true);
            }
        }
        Ok(false)
    }

    /// Models with another setting instead of the removed one, the best first, and with two; and their names. The
    /// other numbers stay where they are: without the removed one, their best values are far off.
    fn instead(
        &self,
        removal: &Removal,
        literal: &str,
        trials: &[Trial],
    ) -> Result<Vec<(Vec<String>, Model)>, String> {
        let (taken_back, without) = (removal.knob, &removal.plain);
        let changed = self.changed(&without.settings);
        // Numbers that by first order save anything alone.
        let promised = self.promises(without, &[], trials.iter(), self.margin() / 4.0)?;
        let touching = promised.iter().map(|one| one.trial.knob);
        // What was found may hide what a choice does.
        let choices = (0..self.knobs.len()).filter(|at| !self.knobs[*at].choices.is_empty());
        let mut others: BTreeSet<usize> = touching.chain(choices).collect();
        others.retain(|at| !changed.contains(at));
        let mut best: Vec<(f64, usize, Model)> = Vec::new();
        for at in others {
            let knob = &self.knobs[at];
            let promise = promised.iter().find(|one| one.trial.knob == at);
            let numbers = promise
                .and_then(|one| one.steps())
                .into_iter()
                .chain(INSTEAD);
            let numbers = numbers.filter(|_| knob.choices.is_empty() && at != taken_back);
            let mut all: Vec<SimSettings> = numbers
                .filter_map(|steps| knob.moved(&without.settings, steps))
                .collect();
            let now = knob.literal_in(&without.settings);
            let is_other = |one: &&String| **one != now && (at != taken_back || *one != literal);
            let choices = knob.choices.iter().filter(is_other);
            all.extend(choices.filter_map(|one| knob.set(&without.settings, one)));
            let tried = self.moved(without, all)?.into_iter();
            let tried = tried.map(|next| (self.cost(&next, false), at, next));
            best.extend(tried.min_by(|one, other| one.0.total_cmp(&other.0)));
        }
        let now = self.cost(without, false);
        best.retain(|(cost, ..)| *cost < now - self.margin() / 4.0);
        best.sort_by(|one, other| one.0.total_cmp(&other.0));
        best.truncate(MOST_PAIRED);
        // Between the steps that were tried, it may fit far better.
        for (cost, at, next) in &mut best {
            if self.knobs[*at].choices.is_empty() {
                *next = self.polish(next.clone(), &[*at], f64::INFINITY)?;
                *cost = self.cost(next, false);
            }
        }
        best.retain(|(cost, ..)| *cost < now - self.margin());
        best.sort_by(|one, other| one.0.total_cmp(&other.0));
        let value = |at: usize, model: &Model| self.knobs[at].literal_in(&model.settings);
        let name = |at: usize, model: &Model| match (at == taken_back, &self.knobs[at]) {
            (true, knob) => format!("{}={}", knob.key, value(at, model)),
            (false, knob) => knob.name(),
        };
        let (mut names, mut both) = (Vec::new(), Vec::new());
        for (place, (_, at, one)) in best.iter().enumerate() {
            for (_, with, other) in &best[..place] {
                if let Some(pair) = self.knobs[*with].set(&one.settings, &value(*with, other)) {
                    names.push(vec![name(*with, other), name(*at, one)]);
                    both.push(pair);
                }
            }
        }
        let both = names.into_iter().zip(self.moved(without, both)?);
        let both = both.map(|(names, next)| (self.cost(&next, false), names, next));
        let pair = both.min_by(|one, other| one.0.total_cmp(&other.0));
        let pair = pair.filter(|pair| pair.0 < best[0].0 - self.margin());
        best.truncate(MOST_INSTEAD);
        let single = best
            .into_iter()
            .map(|(_, at, one)| (vec![name(at, &one)], one));
        Ok(single
            .chain(pair.map(|(_, names, one)| (names, one)))
            .collect())
    }

    /// Two numbers that by first order save at least half of what one that was found saves, and the model with
    /// them instead.
    fn two_instead(
        &self,
        model: &Model,
        linear: &Linear,
        taken_back: usize,
    ) -> Result<Option<(Vec<String>, Model)>, String> {
        if !self.knobs[taken_back].choices.is_empty() {
            return Ok(None);
        }
        let mut own = linear.own();
        let whole = linear.saves(&own);
        own.retain(|at| linear.numbers[*at] != taken_back);
        let least = whole.midpoint(linear.saves(&own));
        let changed = self.changed(&model.settings);
        let others = 0..linear.numbers.len();
        let others = others.filter(|at| !changed.contains(&linear.numbers[*at]));
        let others: Vec<usize> = others.collect();
        let pairs = others.iter().flat_map(|one| {
            let behind = others.iter().filter(move |other| *other > one);
            behind.map(move |other| [*one, *other])
        });
        let sets = pairs.map(|pair| ([&own[..], &pair].concat(), pair));
        let sets = sets.map(|(set, pair)| (linear.saves(&set), set, pair));
        let best = sets.max_by(|one, other| one.0.total_cmp(&other.0));
        let Some((_, set, pair)) = best.filter(|best| best.0 > least) else {
            return Ok(None);
        };
        let settings = self.with_linear(linear, &model.settings, &set);
        let Some(tried) = self.moved(model, vec![settings])?.into_iter().next() else {
            return Ok(None);
        };
        let names = pair.map(|at| self.knobs[linear.numbers[at]].name());
        Ok(Some((names.to_vec(), tried)))
    }

    /// The names of numbers that best explain what a removed one did, and the model with them. No names if those that
    /// were found do. Where many explain more than the model, which has these costs, only those that are needed.
    fn numbers_instead(
        &self,
        model: &Model,
        costs: &Costs,
        removal: &Removal,
        trials: &[Trial],
    ) -> Result<(Vec<String>, Model), String> {
        let settings = self.explained_by_others(&removal.plain, removal.knob, trials)?;
        let before = self.changed(&model.settings);
        let added = |settings: &SimSettings| {
            let mut added = self.changed(settings);
            added.retain(|at| !before.contains(at));
            added
        };
        // With the scatter of the model as it is, so that costs can be compared.
        let mut next = self.moved(model, vec![settings])?.remove(0);
        if added(&next.settings).len() > MOST_OTHERS
            && self.gain(costs, &self.costs(&next)?).0 > 0.0
        {
            let mut fewer = self.model(&next.settings, 1.0)?;
            self.take_back(&mut fewer)?;
            next = self.moved(model, vec![fewer.settings])?.remove(0);
        }
        let added = added(&next.settings).into_iter();
        let names = added.map(|at| self.knobs[at].name()).collect();
        Ok((names, next))
    }

    /// Share of what a removed number did that a wider spread of times to reply explains: replies are later on average
    /// with it, and scatter more.
    fn by_spread(&self, model: &Model, costs: &Costs, removal: &Removal) -> Result<f64, String> {
        // A pose, and a message without a request, have no time to reply.
        let times = |time: &dyn Fn(usize, usize) -> Option<[f64; 2]>| {
            let all = self.slots(false).filter_map(|(at, slot)| time(at, slot));
            let all = all.filter(|[before, _]| *before > 0.0);
            middle(
                &all.map(|[before, after]| after - before)
                    .collect::<Vec<_>>(),
            )
        };
        let plain = &removal.plain;
        let later = times(&|at, slot| {
            let [before, after] = [plain, model].map(|one| one.cells[at][slot].mean.first());
            Some([*before?, *after?])
        });
        let later = later.0;
        if later == 0.0 {
            return Ok(0.0);
        }
        let mut all_later = plain.clone();
        for cell in all_later.cells.iter_mut().flatten() {
            if let Some(time) = Arc::make_mut(cell).mean.first_mut()
                && *time > 0.0
            {
                *time += later;
            }
        }
        let (left, least) = self.gain(&self.costs(&all_later)?, costs);
        if left >= least.max(SHARE * removal.saves) {
            return Ok(0.0);
        }
        // The mean of a few plays scatters, too; a play without noise does not.
        let scatter = |seen: &[Seen]| {
            let scatter = times(&|at, slot| {
                let [before, after] = [&*model.quiet, seen].map(|play| play[at][slot].as_ref());
                Some([before?, after?].map(|reply| reply.values[0]))
            });
            scatter.1
        };
        let plays = model.members.iter().chain(&model.fresh);
        let of_model = plays.clone().map(|play| scatter(play)).sum::<f64>();
        let wider = scatter(&self.vehicle) - of_model / plays.count() as f64;
        // The mean of an even spread is twice its median deviation.
        Ok(2.0 * wider / later)
    }

    /// Residual cost beyond chance of all replies that differ from another model's, and the most that chance
    /// leaves.
    fn left(&self, other: &Model, model: &Model) -> [f64; 2] {
        let changes = self.values(model, |(at, slot), cell, channel| {
            let before = &other.cells[at][slot];
            (before.form == cell.form).then(|| cell.mean[channel] - before.mean[channel])
        });
        let touched = |at: &(usize, usize)| self.saved_at(other, model, *at) != 0.0;
        let signs = self.slots(false).filter(touched).map(|(at, slot)| {
            let seen = self.vehicle[at][slot].as_ref();
            model.cells[at][slot].contradictions(seen, &model.layout)
        });
        let wrong: usize = signs.sum();
        let left = |seen: &[Seen]| -> [f64; 3] {
            let rest = self.rest(model, seen).0;
            let all = rest.iter().zip(&changes);
            let costs = all.filter(|(_, change)| change.abs() > 0.5);
            let costs = costs.map(|(rest, _)| cost(*rest));
            costs.fold([0.0; 3], |[sum, most, count], cost| {
                [sum + cost, most.max(cost), count + 1.0]
            })
        };
        let [mut of_vehicle, most, count] = left(&self.vehicle);
        let fresh = model.fresh.iter().map(|play| left(play)[0]);
        let mut by_chance = fresh.sum::<f64>() / model.fresh.len() as f64;
        if self.is_real() {
            // Plays lack the machine's share, by which the standard deviations were widened.
            by_chance = by_chance.max(count);
            of_vehicle -= most;
        }
        let spread = by_chance * (2.0 / count.max(1.0)).sqrt();
        let wrong = DIFFERENT * wrong.saturating_sub(2) as f64;
        [of_vehicle - by_chance + wrong, LEFT * spread + 1.0]
    }

    /// Records the values that were found, and their intervals.
    pub(super) fn measure(
        &self,
        model: &Model,
        found: &mut [Found],
        trials: &[Trial],
    ) -> Result<(), String> {
        let numbers = self.numbers(&model.settings);
        if numbers.is_empty() {
            return Ok(());
        }
        let linear = self.linear(model, self.acting(model, trials))?;
        let slopes = self.slopes(model, &numbers, &mut vec![SMALL_WIDTH; numbers.len()])?;
        let (rest, weights) = self.rest(model, &self.vehicle);
        let covariance = Self::normal(&slopes, &weights, 0.0).try_inverse();
        // The residual of each part of the recordings pulls the numbers elsewhere: that is their scatter.
        let weights = DVector::from_vec(weights);
        let left = DVector::from_vec(rest).component_mul(&weights);
        let part = left.len().div_ceil(PARTS).max(1);
        let pull = |from: usize| {
            let count = part.min(left.len() - from);
            slopes.rows(from, count).tr_mul(&left.rows(from, count))
        };
        let pulls: Vec<_> = (0..left.len()).step_by(part).map(pull).collect();
        // So do plays of the model with each number a little off. All may pull one way, where the values are so good
        // only because tyres slip and stick as those of the vehicle.
        let plays = model.members.iter().skip(1).chain(&model.fresh);
        let pull_of_play = |seen: &Play| {
            let (rest, weights) = self.rest(model, seen);
            slopes.tr_mul(&DVector::from_vec(rest).component_mul(&DVector::from_vec(weights)))
        };
        let plays: Vec<_> = plays.map(pull_of_play).collect();
        let [by_part, by_play] = [pulls, plays].map(|pulls| {
            let pulls = DMatrix::from_fn(numbers.len(), pulls.len(), |row, at| pulls[at][row]);
            covariance.as_ref().map_or(0.0 * &pulls, |all| all * pulls)
        });
        // How far the numbers move if the machine delays replies so much.
        let moves_by = |delay: &dyn Fn(f64) -> f64| {
            let delays = self.values(model, |(at, slot), cell, channel| {
                let reply = self.vehicle[at][slot].as_ref();
                let is_time = channel == 0 && self.recordings[at].is_real;
                let reply = reply.filter(|reply| is_time && Some(reply.form) == cell.form)?;
                Some(delay(reply.values[0] - cell.mean[0]))
            });
            let pull = DVector::from_vec(delays).component_mul(&weights);
            let pull = slopes.tr_mul(&pull);
            covariance.as_ref().map_or(0.0 * &pull, |all| all * &pull)
        };
        let centred = moves_by(&|rest| rest.clamp(-ADAPTER, ADAPTER));
        let by_machine = moves_by(&|_| ADAPTER);
        let mut all = Vec::new();
        for one in &*found {
            let knob = &self.knobs[one.knob];
            let Some(at) = numbers.iter().position(|number| *number == one.knob) else {
                all.push(None);
                continue;
            };
            let by_chance = covariance.as_ref().map_or(0.0, |all| all[(at, at)]);
            let by_part = by_part.row(at).norm_squared();
            let by_play = by_play.row(at).norm_squared() / by_play.ncols() as f64;
            let variance = by_chance.max(by_part).max(by_play);
            let value = knob.number_in(&model.settings);
            // What is left may be due to another change, and its effect as that of this one; chance hides some.
            let [left, by_chance] = one.left;
            let wide = WIDE + (left.max(0.0) + by_chance / 2.0).sqrt();
            let is_determined = variance <= MOST_VARIANCE;
            let [by_itself, by_others] = match is_determined {
                true => {
                    let by_others = linear.variance(one.knob).unwrap_or(0.0);
                    [wide * variance.sqrt(), WIDE * by_others.sqrt()]
                }
                false => [0.0; 2],
            };
            // Without a steep slope, it may show only in which replies are there, or be hidden by the machine's delays.
            let is_steep = slopes.column(at).amax() >= STEEP;
            let has_slope = is_determined && is_steep && !self.jumps(model, knob)?;
            let [centre, delay] = match has_slope {
                true => [centred[at], by_machine[at].abs()],
                false => [0.0; 2],
            };
            let (value, by_itself) = (knob.beyond(value, centre), by_itself + delay);
            let [low, high] = match has_slope {
                true => [Some(value); 2],
                false => self.ends(model, knob)?,
            };
            // What shows only in which replies are there has no mean, so that one late byte decides.
            let late = match has_slope || !self.is_real() {
                true => 0.0,
                false => knob.number_of_time(LATE as f64 / 1e9).unwrap_or(0.0),
            };
            let low = low.map(|low| low - late);
            let high = high.map(|high| high + late);
            // With another change instead of a found one, it has another value.
            let others = found.iter().filter(|other| other.knob != one.knob);
            let [least, most] = knob.moves(value, others.map(|other| &*other.as_good));
            let before = knob.number_in(&self.base);
            let with_spread = value + one.by_spread * (before - value);
            let [least_itself, most_itself] = [value.min(with_spread), value.max(with_spread)];
            let low = low.map(|low| low.min(knob.beyond(least_itself, -by_itself)));
            let high = high.map(|high| high.max(knob.beyond(most_itself, by_itself)));
            let low = low.map(|low| knob.beyond(low, least).min(knob.beyond(value, -by_others)));
            let high = high.map(|high| knob.beyond(high, most).max(knob.beyond(value, by_others)));
            all.push(Some((value, [low, high])));
        }
        for (one, number) in found.iter_mut().zip(all) {
            if let Some((value, _)) = number {
                one.literal = self.knobs[one.knob].literal(&model.settings, value);
            }
            one.number = number;
        }
        Ok(())
    }

    pub(super) fn verdicts(
        &self,
        model: &Model,
        found: &[Found],
        trials: &[Trial],
    ) -> Vec<Verdict> {
        let enough = self.used() >= ENOUGH;
        let verdict = |at: usize| {
            let knob = &self.knobs[at];
            if let Some(one) = found.iter().find(|one| one.knob == at) {
                let is_enough = enough || matches!(knob.basis, Basis::Assumed(_));
                let doubt = self.doubt(one);
                let differs = matches!(doubt, None | Some(Doubt::OneEnd | Doubt::Rough));
                return match differs && is_enough {
                    true => Verdict::Contradicted,
                    false => Verdict::NotDecided,
                };
            }
            let doubted = found
                .iter()
                .flat_map(|one| &one.or)
                .any(|or| or.split(WITH).any(|one| one == knob.name()));
            let tried = || trials.iter().filter(|trial| trial.knob == at);
            if !doubted && !tried().any(|trial| trial.touches) {
                return Verdict::NotTouched;
            }
            let excluded = |trial: &Trial| {
                let change = [&**trial.from, &trial.to];
                self.saved(model, change, 1.0) < -self.margin()
            };
            match tried().all(excluded) && !doubted {
                true => Verdict::Supported,
                false => Verdict::NotDecided,
            }
        };
        (0..self.knobs.len()).map(verdict).collect()
    }
}

#[cfg(test)]
mod tests;
