//! Search for the settings by which the model does what a recording has.
//!
//! One mechanism serves all: every setting is changed, the recording is played again without noise, and what
//! changes is compared with what is left between recording and model. What is left of plays of the model
//! itself is what chance explains.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use indicatif::ProgressBar;
use nalgebra::{DMatrix, DVector};
use rigsim_core::settings::SimSettings;
use rigsim_settings::Basis;

use super::knob::Knob;
use super::model::{Cell, DIFFERENT, Layout, cells, cost, significant, takes_part, weight};
use super::recording::{Recording, Reply, Seen};

/// Plays by different chance from which it is known how much the model scatters.
const SEEDS: u64 = 6;
/// Cost that a change has to save at least.
const MARGIN: f64 = 40.0;
/// Most settings that are found.
const MOST_FOUND: usize = 16;
/// Square of the least change that shows, in standard deviations.
const TOUCHED: f64 = 25.0;
/// Most changes that are tried although they do not keep what they promise.
const MOST_REFUSED: usize = 30;
/// Most times that settings are searched and all numbers improved, and most steps of an improvement.
const ROUNDS: usize = 5;
const MOST_STEPS: usize = 12;
/// What holds a number that does nothing, as if it was known to about two of its steps.
const HELD: f64 = 0.25;
/// Changes of a number that are tried, in its steps: by 20 %, to three times and to 0.3 times its value.
const STEPS: [f64; 4] = [1.0, -1.0, 10.0, -3.5];
/// Share of a recording that has to take part before it contradicts what is documented.
pub(super) const ENOUGH: f64 = 0.5;
/// Half of an interval of 99 %, in standard deviations, with what the plays of the model scatter.
const WIDE: f64 = 3.0;
/// Cost above the least, within which the values of a number are as good: 99 % of a chi-square with one degree
/// of freedom.
const AS_GOOD: f64 = 6.63;
/// Share of what a setting saves that another has to promise before it is tried instead, and how many are.
const AS_MUCH: f64 = 0.3;
const MOST_INSTEAD: usize = 4;
/// How many standard deviations of chance may be left of what a setting changes.
const LEFT: f64 = 4.0;

/// What was answered, by recording and slot.
type Play = Arc<Vec<Seen>>;

/// Everything that the search needs.
pub(super) struct Search<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) base: SimSettings,
    pub(super) knobs: Vec<Knob>,
    /// Settings without which replies are what they are by mean.
    noise: Vec<Knob>,
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
    /// Without noise, so that what a change does is seen and no chance.
    quiet: Play,
    pub(super) cells: Vec<Vec<Cell>>,
    pub(super) layout: Layout,
}

/// A changed value of a setting, and what the model does by it without noise.
struct Trial {
    knob: usize,
    literal: String,
    /// By how much a number differs.
    step: Option<f64>,
    /// What the model does without and with it.
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
    /// What is left of all that it changes beyond chance, and the most that may be.
    left: [f64; 2],
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
        let id = recordings[0].device.id;
        let mut noise = Knob::all(&base, id, &[]);
        noise.retain(|knob| knob.key.contains("noise"));
        Self {
            recordings,
            knobs: Knob::all(&base, id, only),
            noise,
            base,
            vehicle: recordings.iter().map(|one| one.seen.clone()).collect(),
            progress: match std::io::stderr().is_terminal() {
                true => ProgressBar::no_length().with_message("plays"),
                false => ProgressBar::hidden(),
            },
        }
    }

    /// Searches until nothing is left that one more setting explains, nor all numbers together.
    pub(super) fn run(&self) -> Result<Findings, String> {
        let assumed = self.model(&self.base)?;
        let (mut model, mut trials) = (assumed.clone(), Vec::new());
        for _ in 0..ROUNDS {
            drop(std::mem::take(&mut trials));
            trials = self.trials(&model)?;
            let next = self.join(self.grow(&model, &trials)?, &trials)?;
            if self.price(&next) > self.price(&model) - 1.0 {
                break;
            }
            model = next;
        }
        let mut found = self.prune(&mut model, &trials)?;
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
        let after = self.cost(&self.model(&written)?, true);
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

    /// Adds setting by setting what these trials promise.
    fn grow(&self, model: &Model, trials: &[Trial]) -> Result<Model, String> {
        let mut model = model.clone();
        let mut refused = BTreeSet::new();
        while refused.len() < MOST_REFUSED {
            let known = self.changed(&model.settings);
            let open = trials.iter().filter(|one| {
                let is_known = one.step.is_some() && known.contains(&one.knob);
                !is_known && !refused.contains(&(one.knob, one.literal.clone()))
            });
            let best = self.best(&model, open, self.margin());
            let Some(&(promised, part, trial)) = best.first().filter(|_| known.len() < MOST_FOUND)
            else {
                break;
            };
            // What a step of a number promises is not what the number does at its best.
            let tried = self.with(&model, trial, part)?;
            let least = self.margin().max(promised / 5.0);
            let Some(next) = tried.filter(|tried| self.gain(&model, tried) > least) else {
                refused.insert((trial.knob, trial.literal.clone()));
                continue;
            };
            let numbers = self.numbers(&next.settings);
            model = self.polish(next, &numbers)?;
        }
        Ok(model)
    }

    /// Frees all numbers that do something, and takes back one by one what the others explain as well.
    fn join(&self, model: Model, trials: &[Trial]) -> Result<Model, String> {
        let touching = trials
            .iter()
            .filter(|one| one.touches && one.step.is_some());
        let numbers = touching.map(|one| one.knob);
        let numbers: BTreeSet<usize> = numbers.chain(self.numbers(&model.settings)).collect();
        let numbers = Vec::from_iter(numbers);
        let joint = self.polish(model.clone(), &numbers)?;
        let (matrix, steps) = self.jacobian(&joint, &numbers)?;
        let weights = self.rest(&joint, &self.vehicle).1;
        let Some(mut covariance) = Self::normal(&matrix, &weights, 0.0).try_inverse() else {
            return Ok(model);
        };
        let away = numbers.iter().zip(&steps).map(|(at, step)| {
            let knob = &self.knobs[*at];
            (knob.number_in(&joint.settings) - knob.number_in(&self.base)) / step
        });
        let mut away = DVector::from_iterator(numbers.len(), away);
        let mut free: BTreeSet<usize> = (0..numbers.len()).collect();
        // What a reset costs if all others that are free follow.
        while let Some((cost, least)) = free
            .iter()
            .map(|at| (away[*at].powi(2) / covariance[(*at, *at)].max(1e-12), *at))
            .min_by(|one, other| one.0.total_cmp(&other.0))
            && (cost <= self.margin() || free.len() > MOST_FOUND)
        {
            free.remove(&least);
            let column = covariance.column(least) / covariance[(least, least)].max(1e-12);
            away -= &column * away[least];
            covariance -= &column * covariance.row(least).clone_owned();
        }
        let mut settings = joint.settings.clone();
        for (at, (number, step)) in numbers.iter().zip(&steps).enumerate() {
            let knob = &self.knobs[*number];
            let value = knob.number_in(&self.base) + away[at] * step;
            settings = knob.set_number(&settings, value).unwrap_or(settings);
        }
        let numbers: Vec<usize> = free.iter().map(|at| numbers[*at]).collect();
        let next = self.polish(self.moved(&joint, settings)?, &numbers)?;
        Ok(match self.price(&next) < self.price(&model) {
            true => next,
            false => model,
        })
    }

    /// Cost of a model, and of its settings.
    fn price(&self, model: &Model) -> f64 {
        self.cost(model, false) + self.margin() * self.changed(&model.settings).len() as f64
    }

    /// Settings that are another than at first.
    fn changed(&self, settings: &SimSettings) -> Vec<usize> {
        let differs = |at: &usize| {
            let knob = &self.knobs[*at];
            let value = |settings| match knob.choices.is_empty() {
                true => knob.number_in(settings).to_string(),
                false => knob.literal_in(settings),
            };
            value(settings) != value(&self.base)
        };
        (0..self.knobs.len()).filter(differs).collect()
    }

    /// Share of the recordings that takes part.
    pub(super) fn used(&self) -> f64 {
        let all = self.recordings.iter().flat_map(|one| &one.slots);
        let used = all.clone().filter(|slot| slot.counts).count();
        used as f64 / all.count() as f64
    }

    /// Plays settings with seeds, in threads. What is the same as `like` takes no further memory.
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

    /// The model with these settings.
    pub(super) fn model(&self, settings: &SimSettings) -> Result<Model, String> {
        let quiet = self.quiet(settings.clone());
        let seeds = (0..SEEDS).map(|seed| (settings, seed));
        let jobs: Vec<_> = std::iter::once((&quiet, 0)).chain(seeds).collect();
        let mut members = self.play(&jobs, None)?;
        let quiet = members.remove(0);
        let replies = members.iter().flat_map(|seen| &**seen).chain(&self.vehicle);
        let layout = Layout::of(replies.flatten().flatten());
        let recordings = self.recordings.iter().enumerate();
        let of_recording = |(at, recording)| {
            let plays: Vec<&Seen> = members.iter().map(|seen| &seen[at]).collect();
            cells(&plays, &quiet[at], recording, &layout)
        };
        Ok(Model {
            cells: recordings.map(of_recording).collect(),
            settings: settings.clone(),
            members,
            quiet,
            layout,
        })
    }

    /// The model with other settings that scatters as before, by one play.
    fn moved(&self, model: &Model, settings: SimSettings) -> Result<Model, String> {
        let quiet = self.quiet(settings.clone());
        let played = self.play(&[(&quiet, 0)], Some(&model.quiet))?;
        let to = played.into_iter().next().ok_or("nothing was played")?;
        let mut cells = model.cells.clone();
        let replies = cells.iter_mut().zip(&**model.quiet).zip(&**to);
        for ((cells, from), to) in replies {
            for ((cell, from), to) in cells.iter_mut().zip(from).zip(to) {
                *cell = cell.shifted(from.as_ref(), to.as_ref(), 1.0, &model.layout);
            }
        }
        Ok(Model {
            settings,
            cells,
            quiet: to,
            ..model.clone()
        })
    }

    /// The settings without noise.
    fn quiet(&self, mut settings: SimSettings) -> SimSettings {
        for knob in &self.noise {
            settings = knob.set_number(&settings, 0.0).unwrap_or(settings);
        }
        settings
    }

    /// Cost that a change has to save; more where a machine may have spoiled some replies.
    fn margin(&self) -> f64 {
        if self.is_real() { 2.0 * MARGIN } else { MARGIN }
    }

    fn is_real(&self) -> bool {
        self.recordings.iter().any(|recording| recording.is_real)
    }

    /// Each other value of each choice, and each number with a small and a large step up and down.
    fn trials(&self, model: &Model) -> Result<Vec<Trial>, String> {
        let mut planned = Vec::new();
        for (knob, about) in self.knobs.iter().enumerate() {
            let choices = about.choices.iter().map(|one| (one.clone(), None));
            let steps = STEPS.iter().filter(|_| about.choices.is_empty());
            let number = about.number_in(&model.settings);
            let numbers = steps.map(|part| {
                let step = part * about.step;
                (about.literal(&model.settings, number + step), Some(step))
            });
            let values = choices.chain(numbers);
            let now = about.literal_in(&model.settings);
            for (literal, step) in values.filter(|(literal, _)| *literal != now) {
                if let Some(settings) = about.set(&model.settings, &literal) {
                    planned.push((knob, literal, step, self.quiet(settings)));
                }
            }
        }
        let jobs: Vec<_> = planned.iter().map(|(.., settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let trial = |((knob, literal, step, _), to): ((usize, String, _, _), Play)| {
            let column = self.column(model, &model.quiet, &to);
            let differs = |(at, slot): (usize, usize)| {
                let cell: &Cell = &model.cells[at][slot];
                cell.contradictions(to[at][slot].as_ref(), &model.layout) > 0
            };
            let squares = column.iter().map(|change| change * change);
            Trial {
                knob,
                literal,
                step,
                from: Arc::clone(&model.quiet),
                touches: squares.sum::<f64>() > TOUCHED || self.slots(false).any(differs),
                to,
            }
        };
        Ok(planned.into_iter().zip(played).map(trial).collect())
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

    /// Requests with replies that no setting explains: in form, in bits, or far beyond any scatter. Where no
    /// single one has enough of them, all of a name together.
    pub(super) fn unexplained(&self, model: &Model) -> Vec<String> {
        let mut counts: BTreeMap<[&str; 2], (usize, usize, usize, u64)> = Default::default();
        for (at, slot) in self.slots(false).chain(self.slots(true)) {
            let (asked, seen) = (&self.recordings[at].slots[slot], &self.vehicle[at][slot]);
            let signs = model.cells[at][slot].contradictions(seen.as_ref(), &model.layout);
            for text in ["", &asked.text] {
                let count = counts.entry([&asked.name, text]).or_default();
                let (all, wrong, weight, last) = count;
                *all += 1;
                if signs > 0 {
                    *wrong += 1;
                    *weight += signs;
                    *last = asked.at;
                }
            }
        }
        counts.retain(|_, (all, _, weight, _)| *weight > 2 + *all / 20);
        let is_single = |name: &str| {
            counts
                .keys()
                .any(|[other, text]| *other == name && !text.is_empty())
        };
        let some = counts
            .iter()
            .filter(|([name, text], _)| !text.is_empty() || !is_single(name));
        let words =
            |([name, text], (all, wrong, _, at)): (&[&str; 2], &(usize, usize, usize, u64))| {
                let (text, at) = (
                    if text.is_empty() { name } else { text },
                    rigsim_core::SimTime::from_nanos(*at),
                );
                format!(
                    "{text}: {wrong} of {all} have another answer than the model, last at {at} s"
                )
            };
        some.map(words).collect()
    }

    pub(super) fn cost(&self, model: &Model, held_out: bool) -> f64 {
        let costs = self.slots(held_out).map(|at| self.cost_at(model, at));
        costs.sum()
    }

    fn cost_at(&self, model: &Model, (at, slot): (usize, usize)) -> f64 {
        let seen = self.vehicle[at][slot].as_ref();
        model.cells[at][slot].cost(seen, &model.layout, self.recordings[at].is_real)
    }

    /// Those of these trials that save so much, the best of all first: what each saves, and by which part of
    /// its change.
    fn best<'t>(
        &self,
        model: &Model,
        trials: impl Iterator<Item = &'t Trial>,
        least: f64,
    ) -> Vec<(f64, f64, &'t Trial)> {
        let saves = trials.map(|trial| (self.saves(model, trial), trial));
        let some = saves.filter(|((saves, _), _)| *saves > least);
        let mut best: Vec<_> = some
            .map(|((saves, part), trial)| (saves, part, trial))
            .collect();
        best.sort_by(|one, other| other.0.total_cmp(&one.0));
        best
    }

    /// Cost that a trial saves, and the part of its change that saves most.
    fn saves(&self, model: &Model, trial: &Trial) -> (f64, f64) {
        let saved = |part| self.saved(model, [&trial.from, &trial.to], part);
        if trial.step.is_none() {
            return (saved(1.0), 1.0);
        }
        let column = self.column(model, &trial.from, &trial.to);
        let (rest, weights) = self.rest(model, &self.vehicle);
        let sum = |other: &[f64]| -> f64 {
            let products = column.iter().zip(other).zip(&weights);
            products
                .map(|((one, other), weight)| one * other * weight)
                .sum()
        };
        let part = (sum(&rest) / sum(&column)).clamp(-4.0, 4.0);
        let parts = [1.0, if part.is_finite() { part } else { 1.0 }];
        let [whole, partly] = parts.map(|part| (saved(part), part));
        if partly.0 > whole.0 { partly } else { whole }
    }

    /// Cost that a part of the change from one play to another saves.
    fn saved(&self, model: &Model, [from, to]: [&[Seen]; 2], part: f64) -> f64 {
        let each = self.slots(false).map(|(at, slot)| {
            let [from, to, seen] = [from, to, &self.vehicle].map(|play| play[at][slot].as_ref());
            if from == to {
                return 0.0;
            }
            let (cell, is_real) = (&model.cells[at][slot], self.recordings[at].is_real);
            let changed = cell.shifted(from, to, part, &model.layout);
            let cost = |cell: &Cell| cell.cost(seen, &model.layout, is_real);
            cost(cell) - cost(&changed)
        });
        self.total(each)
    }

    /// The sum; of what a machine recorded without the greatest, which may be its fault.
    fn total(&self, saved: impl Iterator<Item = f64>) -> f64 {
        let (sum, most) = saved.fold((0.0, 0.0_f64), |(sum, most), saved| {
            (sum + saved, most.max(saved))
        });
        if self.is_real() { sum - most } else { sum }
    }

    /// Cost that one model saves beside another.
    fn gain(&self, before: &Model, after: &Model) -> f64 {
        self.total(self.slots(false).map(|at| self.saved_at(before, after, at)))
    }

    fn saved_at(&self, before: &Model, after: &Model, at: (usize, usize)) -> f64 {
        self.cost_at(before, at) - self.cost_at(after, at)
    }

    /// What changes from one play to another, in standard deviations: a column of the Jacobian.
    fn column(&self, model: &Model, from: &[Seen], to: &[Seen]) -> Vec<f64> {
        self.values(model, |(at, slot), cell, channel| {
            let [from, to] = [from, to].map(|play| play[at][slot].as_ref());
            let has_form = |one: &&Reply| Some(one.form) == cell.form;
            let (from, to) = (from.filter(has_form)?, to.filter(has_form)?);
            Some(to.values[channel] - from.values[channel])
        })
    }

    /// What is left between replies and model, in standard deviations, and the weights.
    fn rest(&self, model: &Model, seen: &[Seen]) -> (Vec<f64>, Vec<f64>) {
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
    fn values(
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

    /// The model with a trial, a number at its best; `None` if that is not allowed.
    fn with(&self, model: &Model, trial: &Trial, part: f64) -> Result<Option<Model>, String> {
        let knob = &self.knobs[trial.knob];
        let Some(step) = trial.step else {
            let settings = knob.set(&model.settings, &trial.literal);
            let moved = settings.map(|settings| self.moved(model, settings));
            return moved.transpose();
        };
        let value = knob.number_in(&model.settings);
        // Wide first, and the nearest of what is as good; then around that.
        let wide = (-8..=10).map(|at| f64::from(at) / 2.0).chain([part]);
        let wide = wide.map(|part| value + part * step);
        let Some([low, high]) = as_good(&self.ladder(model, knob, wide)?) else {
            return Ok(None);
        };
        let (near, step) = (value.clamp(low, high), step.abs().min(knob.step) / 12.0);
        let fine = (-6..=6).map(|at| near + f64::from(at) * step);
        let fine = as_good(&self.ladder(model, knob, fine)?);
        let best = fine.map_or(near, |[low, high]| (low + high) / 2.0);
        let settings = knob.set_number(&model.settings, best);
        let moved = settings.map(|settings| self.moved(model, settings));
        moved.transpose()
    }

    /// Of these values those that are allowed, from the least on, and what each saves.
    fn ladder(
        &self,
        model: &Model,
        knob: &Knob,
        values: impl Iterator<Item = f64>,
    ) -> Result<Vec<(f64, f64)>, String> {
        let allowed = values.filter_map(|value| {
            let settings = knob.set_number(&model.settings, value)?;
            Some((value, self.quiet(settings)))
        });
        let mut allowed: Vec<(f64, SimSettings)> = allowed.collect();
        allowed.sort_by(|one, other| one.0.total_cmp(&other.0));
        let jobs: Vec<_> = allowed.iter().map(|(_, settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let saved = |to: &Play| self.saved(model, [&model.quiet, to], 1.0);
        let values = allowed.iter().map(|(value, _)| *value);
        Ok(values.zip(played.iter().map(saved)).collect())
    }

    /// The ends of what fits as well as the present value of a number; `None` where all that is beyond does.
    fn ends(&self, model: &Model, knob: &Knob) -> Result<[Option<f64>; 2], String> {
        let value = knob.number_in(&model.settings);
        let far = (1..=12).map(|power| 12.0 * 1.5_f64.powi(power));
        let far = far.flat_map(|part| [-part, part]);
        let parts = (-12..=12).map(f64::from).chain(far);
        let ladder = parts.map(|part| value + part * knob.step / 8.0);
        let ladder = self.ladder(model, knob, ladder)?;
        let [low, high] = as_good(&ladder).unwrap_or([value; 2]);
        let [first, last] = [ladder.first(), ladder.last()].map(|end| end.map(|(end, _)| *end));
        let ends = [(low, first), (high, last)];
        Ok(ends.map(|(end, bound)| (Some(end) != bound).then_some(end)))
    }

    /// Columns of the numbers that were found: what a small change of each does.
    fn jacobian(
        &self,
        model: &Model,
        numbers: &[usize],
    ) -> Result<(DMatrix<f64>, Vec<f64>), String> {
        let mut changed = Vec::new();
        for at in numbers {
            // So far that it is more than a digit of the wire.
            let (knob, step) = (&self.knobs[*at], self.knobs[*at].step);
            let value = knob.number_in(&model.settings);
            let with = |step: f64| Some((knob.set_number(&model.settings, value + step)?, step));
            let (settings, step) = (with(step).or_else(|| with(-step)))
                .unwrap_or_else(|| (model.settings.clone(), step));
            changed.push((self.quiet(settings), step));
        }
        let jobs: Vec<_> = changed.iter().map(|(settings, _)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let columns = played.iter();
        let columns = columns.map(|seen| self.column(model, &model.quiet, seen));
        let columns: Vec<Vec<f64>> = columns.collect();
        let rows = columns.first().map_or(0, Vec::len);
        let matrix = DMatrix::from_iterator(rows, columns.len(), columns.into_iter().flatten());
        Ok((matrix, changed.iter().map(|(_, step)| *step).collect()))
    }

    /// The normal matrix; what does nothing is held where it is.
    fn normal(matrix: &DMatrix<f64>, weights: &[f64], damping: f64) -> DMatrix<f64> {
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

    /// Improves all numbers together, by the method of Levenberg and Marquardt.
    fn polish(&self, mut model: Model, numbers: &[usize]) -> Result<Model, String> {
        let mut damping = 1e-3;
        let mut slopes = None;
        for _ in 0..if numbers.is_empty() { 0 } else { MOST_STEPS } {
            let (matrix, steps) = match slopes.take() {
                Some(slopes) => slopes,
                None => self.jacobian(&model, numbers)?,
            };
            let (rest, weights) = self.rest(&model, &self.vehicle);
            let rest = rest
                .iter()
                .zip(&weights)
                .map(|(rest, weight)| rest * weight);
            let right = matrix.tr_mul(&DVector::from_iterator(weights.len(), rest));
            let Some(normal) = Self::normal(&matrix, &weights, damping).cholesky() else {
                break;
            };
            let change = normal.solve(&right);
            let mut settings = model.settings.clone();
            for ((at, step), change) in numbers.iter().zip(&steps).zip(change.iter()) {
                let knob = &self.knobs[*at];
                let value = knob.number_in(&settings) + step * change.clamp(-2.0, 2.0);
                settings = knob.set_number(&settings, value).unwrap_or(settings);
            }
            let next = self.moved(&model, settings)?;
            let before = self.cost(&model, false);
            let saved = before - self.cost(&next, false);
            if saved > 0.0 {
                (model, damping) = (next, damping / 10.0);
                if saved < 1.0 + before / 1000.0 {
                    break;
                }
            } else if damping > 1.0 {
                break;
            } else {
                (damping, slopes) = (damping * 30.0, Some((matrix, steps)));
            }
        }
        self.model(&model.settings)
    }

    fn numbers(&self, settings: &SimSettings) -> Vec<usize> {
        let mut changed = self.changed(settings);
        changed.retain(|at| self.knobs[*at].choices.is_empty());
        changed
    }

    /// Slot at which one model fits better than another by most.
    fn shows(&self, before: &Model, after: &Model) -> (usize, usize) {
        let saved = |at| self.saved_at(before, after, at);
        let slots = self.slots(false);
        slots
            .max_by(|one, other| saved(*one).total_cmp(&saved(*other)))
            .unwrap_or_default()
    }

    /// Takes back what the others explain as well, takes what explains more instead, and notes what explains
    /// as much: all with the numbers of the others at their best.
    fn prune(&self, model: &mut Model, trials: &[Trial]) -> Result<Vec<Found>, String> {
        let mut found: Vec<Found> = Vec::new();
        let mut swaps = MOST_FOUND;
        while let Some(taken_back) = (self.changed(&model.settings).into_iter())
            .find(|at| found.iter().all(|one| one.knob != *at))
        {
            let knob = &self.knobs[taken_back];
            let default = knob.default_in(&model.settings);
            let Some(settings) = knob.set(&model.settings, &default) else {
                break;
            };
            let others = self.numbers(&settings);
            let without = self.polish(self.moved(model, settings)?, &others)?;
            let saves = self.gain(&without, model);
            if saves < self.margin() {
                found.clear();
                *model = without;
                continue;
            }
            let mut or = Vec::new();
            let mut better: Option<Model> = None;
            let literal = knob.literal_in(&model.settings);
            let others = trials.iter().filter(|trial| {
                (trial.knob != taken_back || trial.step.is_none()) && trial.literal != literal
            });
            let mut instead = self.best(&without, others, AS_MUCH * saves);
            let mut knobs = BTreeSet::new();
            instead.retain(|(.., trial)| knobs.insert(trial.knob) || trial.knob == taken_back);
            for (_, part, trial) in instead.into_iter().take(MOST_INSTEAD) {
                let Some(tried) = self.with(&without, trial, part)? else {
                    continue;
                };
                let numbers = self.numbers(&tried.settings);
                let tried = self.polish(tried, &numbers)?;
                let more = self.gain(model, &tried);
                if more > self.margin() && swaps > 0 {
                    better = Some(tried);
                } else if self.gain(&tried, model) < self.margin() {
                    or.push(match trial.knob == taken_back {
                        true => format!("{}={}", knob.key, trial.literal),
                        false => self.knobs[trial.knob].name(),
                    });
                }
            }
            if let Some(better) = better {
                swaps -= 1;
                found.clear();
                *model = better;
                continue;
            }
            found.push(Found {
                knob: taken_back,
                literal,
                number: None,
                or,
                left: self.left(&without, model),
                shown_by: self.shows(&without, model),
            });
        }
        Ok(found)
    }

    /// Of all that the model does otherwise than another: the cost that is left beyond chance, and the most
    /// that chance leaves.
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
        let left = |seen: &[Seen]| -> (f64, f64) {
            let rest = self.rest(model, seen).0;
            let all = rest.iter().zip(&changes);
            let costs = all.map(|(rest, change)| (cost(*rest), f64::from(change.abs() > 0.5)));
            costs.fold((0.0, 0.0), |(sum, count), (cost, is)| {
                (sum + is * cost, count + is)
            })
        };
        let (of_vehicle, count) = left(&self.vehicle);
        let members = model.members.iter().map(|member| left(member).0);
        let by_chance = members.sum::<f64>() / model.members.len() as f64;
        let spread = by_chance * (2.0 / count.max(1.0)).sqrt();
        let wrong = DIFFERENT * wrong.saturating_sub(2) as f64;
        [of_vehicle - by_chance + wrong, LEFT * spread + 1.0]
    }

    /// Notes the values that were found, and their intervals.
    fn measure(&self, model: &Model, found: &mut [Found]) -> Result<(), String> {
        let numbers = self.numbers(&model.settings);
        let (matrix, steps) = self.jacobian(model, &numbers)?;
        let weights = self.rest(model, &self.vehicle).1;
        let covariance = Self::normal(&matrix, &weights, 0.0).try_inverse();
        for one in found {
            let knob = &self.knobs[one.knob];
            let Some(at) = numbers.iter().position(|number| *number == one.knob) else {
                continue;
            };
            let variance = covariance.as_ref().map_or(0.0, |all| all[(at, at)]);
            let value = knob.number_in(&model.settings);
            // It may show only in what is there or is not, or be lost in what the machine explains.
            let [low, high] = self.ends(model, knob)?;
            let is_open = low.is_none() || high.is_none();
            let [half, between] = if matrix.column(at).amax() < 4.0 || is_open {
                [0.0, knob.step / 8.0]
            } else {
                // What is left may be due to another change, and its effect as that of this one.
                let wide = WIDE + one.left[0].max(0.0).sqrt();
                [wide * variance.sqrt() * steps[at].abs(), 0.0]
            };
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
                let is_explained = one.or.is_empty() && one.left[0] < one.left[1];
                return match is_explained && is_outside && is_enough {
                    true => Verdict::Contradicted,
                    false => Verdict::NotDecided,
                };
            }
            let tried = || trials.iter().filter(|trial| trial.knob == at);
            if !tried().any(|trial| trial.touches) {
                return Verdict::NotTouched;
            }
            let excluded = |trial: &Trial| {
                let change = [&**trial.from, &trial.to];
                self.saved(model, change, 1.0) < -self.margin()
            };
            let doubted = found.iter().any(|one| one.or.contains(&knob.name()));
            match tried().all(excluded) && !doubted {
                true => Verdict::Supported,
                false => Verdict::NotDecided,
            }
        };
        (0..self.knobs.len()).map(verdict).collect()
    }
}

/// Of values and what each saves, the least and the greatest that save as much as the best.
fn as_good(ladder: &[(f64, f64)]) -> Option<[f64; 2]> {
    let saved = ladder.iter().map(|(_, saved)| *saved);
    let least = saved.fold(f64::NEG_INFINITY, f64::max) - AS_GOOD;
    let mut good = ladder.iter().filter(|(_, saved)| *saved >= least);
    let first = good.next()?.0;
    Some([first, good.next_back().map_or(first, |(last, _)| *last)])
}
