//! Search for the settings with which the model reproduces a recording.
//!
//! One mechanism serves all: each setting is changed, the recording is played again without noise, and the
//! change is compared with the residual between recording and model. The residual of plays of the model
//! itself is what chance explains.

use std::collections::{BTreeMap, BTreeSet};
use std::io::IsTerminal as _;
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, OnceLock};

use indicatif::ProgressBar;
use rigsim_core::noise::Noise;
use rigsim_core::settings::SimSettings;
use rigsim_settings::Settings as _;

use super::knob::Knob;
use super::model::{Cell, Layout, cells, takes_part};
use super::recording::{Recording, Reply, Seen};

mod grow;
mod judge;
mod linear;
mod numbers;

/// Parts of the names of settings of the differences between vehicles of one make.
const OF_MAKE: [&str; 2] = [".tolerance.", "roller_spread"];
/// Plays with different seeds, from which the model's scatter is estimated.
const SEEDS: u64 = 6;
/// Further plays, which show the cost of a perfect model.
const FRESH: usize = 2;
/// Least cost that a change has to save.
const MARGIN: f64 = 40.0;
/// What a single play may save by luck, and half as much again.
const LUCK: f64 = 300.0;
/// Standard errors of a mean of plays that are no luck.
const SURE: f64 = 3.0;
/// Square of the least visible change, in standard deviations.
const TOUCHED: f64 = 25.0;
/// Changes of a number that are tried, in steps of 20 %: one step, and about a factor of three.
const STEPS: [f64; 4] = [1.0, -1.0, 5.5, -5.5];
/// Random change of each number in plays with different seeds, in steps.
const NEAR: f64 = 0.001;
/// Fraction of a setting's saving that may be left: a setting that stands in for another leaves more.
const SHARE: f64 = 0.05;
/// Share of a recording that has to take part before it contradicts what is documented.
pub(super) const ENOUGH: f64 = 0.5;

/// Replies, by recording and slot.
type Play = Arc<Vec<Seen>>;

/// Everything that the search needs.
pub(super) struct Search<'a> {
    pub(super) recordings: &'a [Recording],
    pub(super) base: SimSettings,
    pub(super) knobs: Vec<Knob>,
    /// All settings of the device.
    all: Vec<Knob>,
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
    /// By seeds that did not contribute to its scatter.
    fresh: Vec<Play>,
    /// Without noise, so that only the effect of a change shows.
    quiet: Play,
    pub(super) cells: Vec<Vec<Arc<Cell>>>,
    pub(super) layout: Arc<Layout>,
}

/// Costs of a model: of each slot as the mean of plays, and of each play.
pub(super) struct Costs {
    pub(super) each: Vec<f64>,
    plays: Vec<f64>,
}

/// A changed value of a setting, and its effect on the model without noise.
struct Trial {
    knob: usize,
    literal: String,
    /// By how much a number differs.
    step: Option<f64>,
    /// The model's replies without and with it.
    from: Play,
    to: Play,
    /// Set if it changes more than chance does.
    touches: bool,
}

/// A setting that the recording contradicts.
pub(super) struct Found {
    pub(super) knob: usize,
    pub(super) literal: String,
    /// A number, and the ends of its 99 % interval; `None` for an open end.
    pub(super) number: Option<(f64, [Option<f64>; 2])>,
    /// Share of what it does that a wider spread of times to reply explains.
    by_spread: f64,
    /// Settings that explain as much.
    pub(super) or: Vec<String>,
    /// The settings of each model with one of those instead of it.
    as_good: Vec<SimSettings>,
    /// Cost that it saves, with the others at their best values.
    saves: f64,
    /// Set for a number that saves little, and no more than luck with another change instead of one that was found.
    is_shaky: bool,
    /// Residual of all that it changes, beyond chance, and the most that chance leaves.
    left: [f64; 2],
    /// Recording and slot that show it best.
    pub(super) shown_by: (usize, usize),
}

/// What was found, and the trials of the model that has it.
type Judged = (Vec<Found>, Vec<Trial>);

/// Why a change that was found is not certain.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Doubt {
    /// Others explain as much.
    Others,
    /// Too much is left of what it changes.
    Left,
    /// It saves little, and no more than luck where another setting replaces one that was found.
    Shaky,
    /// The value before is within the interval.
    Before,
    OneEnd,
    /// The interval is wide.
    Rough,
}

/// Result of a search.
pub(super) struct Findings {
    pub(super) assumed: Model,
    pub(super) found: Vec<Found>,
    /// The model with all changes that were found.
    pub(super) model: Model,
    pub(super) verdicts: Vec<Verdict>,
    /// The model with unambiguous changes that improve the fit of the unused third.
    pub(super) written: SimSettings,
    /// Cost of that third before, with those changes, and of plays of the model that has them.
    pub(super) held_out: [f64; 3],
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

    /// The reply with the effect of other settings without noise.
    fn by(&self, settings: SimSettings, quiet: Play) -> Self {
        let mut cells = self.cells.clone();
        let replies = cells.iter_mut().zip(&**self.quiet).zip(&**quiet);
        for ((cells, from), to) in replies {
            for ((cell, from), to) in cells.iter_mut().zip(from).zip(to) {
                if from != to {
                    let shifted = cell.shifted(from.as_ref(), to.as_ref(), 1.0, &self.layout);
                    *cell = Arc::new(shifted);
                }
            }
        }
        Self {
            settings,
            cells,
            quiet,
            members: self.members.clone(),
            fresh: self.fresh.clone(),
            layout: Arc::clone(&self.layout),
        }
    }
}

impl<'a> Search<'a> {
    /// Prepares to search among the settings that begin so, and from these.
    pub(super) fn new(recordings: &'a [Recording], base: SimSettings, only: &[String]) -> Self {
        let id = recordings[0].device.id;
        Self {
            recordings,
            knobs: Knob::all(&base, id, only),
            all: Knob::all(&base, id, &[]),
            base,
            vehicle: recordings.iter().map(|one| one.seen.clone()).collect(),
            progress: match std::io::stderr().is_terminal() {
                true => ProgressBar::no_length().with_message("plays"),
                false => ProgressBar::hidden(),
            },
        }
    }

    /// Searches for the changes, and judges them.
    pub(super) fn run(&self) -> Result<Findings, String> {
        let assumed = self.model(&self.base, 1.0)?;
        let mut model = self.model(&self.grown()?, 1.0)?;
        let mut judged = self.prune(&mut model)?;
        if let Some(better) = self.again_from_certain(&model, &judged.0)? {
            (model, judged) = better;
        }
        let (mut found, trials) = judged;
        self.measure(&model, &mut found, &trials)?;
        let mut verdicts = self.verdicts(&model, &found, &trials);
        let mut written = self.base.clone();
        let is_contradicted = |one: &&Found| verdicts[one.knob] == Verdict::Contradicted;
        let decided = found.iter().filter(|one| self.doubt(one).is_none());
        let decided: Vec<&Found> = decided.filter(is_contradicted).collect();
        for one in &decided {
            let knob = &self.knobs[one.knob];
            let number = one.number.map(|(value, _)| knob.literal(&written, value));
            let literal = number.unwrap_or_else(|| one.literal.clone());
            written = knob.set(&written, &literal).unwrap_or(written);
        }
        let before = self.cost(&assumed, true);
        let fitted = self.model(&written, 1.0)?;
        let after = self.cost(&fitted, true);
        if after >= before {
            written = self.base.clone();
            for one in decided {
                verdicts[one.knob] = Verdict::NotDecided;
            }
        }
        self.progress.finish_and_clear();
        Ok(Findings {
            assumed,
            found,
            model,
            verdicts,
            written,
            held_out: [before + 0.0, after + 0.0, self.by_chance(&fitted, true)],
        })
    }

    /// Returns what stands against a change that was found.
    pub(super) fn doubt(&self, found: &Found) -> Option<Doubt> {
        let knob = &self.knobs[found.knob];
        let before = knob.number_in(&self.base);
        let [left, by_chance] = found.left;
        let ends = found.number.map(|(_, ends)| ends);
        let is_inside = |[low, high]: [Option<f64>; 2]| {
            low.is_none_or(|low| low < before) && high.is_none_or(|high| high > before)
        };
        if !found.or.is_empty() {
            return Some(Doubt::Others);
        }
        if left >= by_chance.max(SHARE * found.saves) {
            return Some(Doubt::Left);
        }
        if found.is_shaky {
            return Some(Doubt::Shaky);
        }
        match ends? {
            ends if is_inside(ends) => Some(Doubt::Before),
            [Some(low), Some(high)] if knob.is_close(low, high) => None,
            [Some(_), Some(_)] => Some(Doubt::Rough),
            _ => Some(Doubt::OneEnd),
        }
    }

    /// Cost of a model, and of its settings.
    fn price(&self, model: &Model, is_last: bool) -> Result<f64, String> {
        let cost = match is_last {
            true => self.costs(model)?.each.iter().sum(),
            false => self.cost(model, false),
        };
        Ok(cost + self.of_changes(&model.settings))
    }

    /// Cost of changes by their number.
    fn of_changes(&self, settings: &SimSettings) -> f64 {
        self.margin() * self.changed(settings).len() as f64
    }

    /// Settings that differ from those at first.
    fn changed(&self, settings: &SimSettings) -> Vec<usize> {
        let [now, base] = [settings, &self.base].map(literals);
        let differs = |at: &usize| {
            let knob = &self.knobs[*at];
            let (now, base) = (&now[&knob.key], &base[&knob.key]);
            now != base && (!knob.choices.is_empty() || knob.number_of(now) != knob.number_of(base))
        };
        (0..self.knobs.len()).filter(differs).collect()
    }

    /// Fraction of the recordings that takes part.
    pub(super) fn used(&self) -> f64 {
        let all = self.recordings.iter().flat_map(|one| &one.slots);
        let used = all.clone().filter(|slot| slot.counts).count();
        used as f64 / all.count() as f64
    }

    /// Plays settings with seeds, in threads. Replies equal to those in `like` take no further memory.
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

    /// The model with these settings, and its scatter times a factor.
    pub(super) fn model(&self, settings: &SimSettings, scale: f64) -> Result<Model, String> {
        let quiet = self.quiet(settings.clone());
        let near = (0..SEEDS + FRESH as u64).map(|seed| self.near(settings, seed));
        let near: Vec<SimSettings> = near.collect();
        let jobs: Vec<_> = std::iter::once((&quiet, 0))
            .chain(near.iter().zip(0..))
            .collect();
        let mut members = self.play(&jobs, None)?;
        let quiet = members.remove(0);
        let fresh = members.split_off(members.len() - FRESH);
        let replies = members
            .iter()
            .chain(&fresh)
            .flat_map(|seen| &**seen)
            .chain(&self.vehicle);
        let layout = Layout::of(replies.flatten().flatten());
        let recordings = self.recordings.iter().enumerate();
        let of_recording = |(at, recording)| {
            let plays: Vec<&Seen> = members.iter().map(|seen| &seen[at]).collect();
            let mut cells = cells(&plays, &quiet[at], recording, &layout);
            let all = cells.iter_mut().flat_map(|cell| &mut cell.sd);
            all.for_each(|sd| *sd *= scale);
            cells.into_iter().map(Arc::new).collect()
        };
        Ok(Model {
            cells: recordings.map(of_recording).collect(),
            settings: settings.clone(),
            members,
            fresh,
            quiet,
            layout: Arc::new(layout),
        })
    }

    /// Models with other settings that scatter as before, by one play each.
    fn moved(&self, model: &Model, all: Vec<SimSettings>) -> Result<Vec<Model>, String> {
        let quiet: Vec<SimSettings> = all.iter().map(|one| self.quiet(one.clone())).collect();
        let jobs: Vec<_> = quiet.iter().map(|settings| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let moved = all.into_iter().zip(played);
        Ok(moved.map(|(settings, to)| model.by(settings, to)).collect())
    }

    /// The settings without noise.
    fn quiet(&self, mut settings: SimSettings) -> SimSettings {
        // Which vehicle it is of its make is no noise.
        let of_make = |knob: &&Knob| OF_MAKE.iter().any(|part| knob.key.contains(part));
        let is_noise = |knob: &&Knob| knob.is_chance && !of_make(knob);
        for knob in self.all.iter().filter(is_noise) {
            settings = knob.set_number(&settings, 0.0).unwrap_or(settings);
        }
        settings
    }

    /// The settings with each number a little off, by less than it can ever be known. Tyres slip and stick at
    /// other times then, which is a scatter of the model, too. Times are limits that clients may keep exactly.
    fn near(&self, settings: &SimSettings, seed: u64) -> SimSettings {
        let mut noise = Noise::new(seed, "near");
        let mut near = settings.clone();
        // What tables and plots show is the model as it is.
        if seed == 0 {
            return near;
        }
        let is_time = |knob: &Knob| knob.unit().ends_with('s');
        let is_smooth = |knob: &&Knob| knob.is_ratio() && !knob.is_chance && !is_time(knob);
        let literals = literals(settings);
        for knob in self.all.iter().filter(is_smooth) {
            let number = knob.number_of(&literals[&knob.key]);
            let off = NEAR * (2.0 * noise.uniform() - 1.0);
            let moved = knob.set_number(&near, knob.beyond(number, off));
            near = moved.unwrap_or(near);
        }
        near
    }

    /// Cost that a change has to save; higher where a machine may have disturbed some replies.
    fn margin(&self) -> f64 {
        if self.is_real() { 2.0 * MARGIN } else { MARGIN }
    }

    fn is_real(&self) -> bool {
        self.recordings.iter().any(|recording| recording.is_real)
    }

    /// Each other value of each choice, each number a small and a large step up and down, and each time as often as the
    /// vehicle sends by itself. Settings without effect are left out.
    fn trials(&self, model: &Model, idle: &BTreeSet<usize>) -> Result<Vec<Trial>, String> {
        let mut planned = Vec::new();
        let periods: Vec<f64> = self
            .recordings
            .iter()
            .flat_map(Recording::periods)
            .collect();
        let knobs = self.knobs.iter().enumerate();
        for (knob, about) in knobs.filter(|(at, about)| !about.is_chance && !idle.contains(at)) {
            let choices = about.choices.iter().map(|one| (one.clone(), None));
            let steps = STEPS.iter().filter(|_| about.choices.is_empty());
            let now = about.literal_in(&model.settings);
            let number = about.number_of(&now);
            let numbers = steps.map(|step| (*step, about.beyond(number, *step)));
            let times = periods
                .iter()
                .filter_map(|period| about.number_of_time(*period));
            let times = times.map(|value| (about.steps_between(number, value), value));
            let numbers = numbers.chain(times);
            let numbers =
                numbers.map(|(step, value)| (about.literal(&model.settings, value), Some(step)));
            let values = choices.chain(numbers);
            for (literal, step) in values.filter(|(literal, _)| *literal != now) {
                if let Some(settings) = about.set(&model.settings, &literal) {
                    planned.push((knob, literal, step, self.quiet(settings)));
                }
            }
        }
        let jobs: Vec<_> = planned.iter().map(|(.., settings)| (settings, 0)).collect();
        let played = self.play(&jobs, Some(&model.quiet))?;
        let trial = |((knob, literal, step, _), to): ((usize, String, _, _), Play)| {
            let is_same = Arc::ptr_eq(&to, &model.quiet);
            let touches = || {
                let column = self.column(model, &model.quiet, &to);
                let differs = |(at, slot): (usize, usize)| {
                    let cell: &Cell = &model.cells[at][slot];
                    cell.contradictions(to[at][slot].as_ref(), &model.layout) > 0
                };
                let squares = column.iter().map(|change| change * change);
                squares.sum::<f64>() > TOUCHED || self.slots(false).any(differs)
            };
            Trial {
                knob,
                literal,
                step,
                from: Arc::clone(&model.quiet),
                touches: !is_same && touches(),
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

    /// Requests with replies that no setting explains: in form, in bits, or far beyond any scatter. If no single
    /// request has enough of them, those of the same name count together.
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

    /// Mean cost of plays of the model itself with other seeds.
    pub(super) fn by_chance(&self, model: &Model, held_out: bool) -> f64 {
        let cost = |seen: &Play, (at, slot): (usize, usize)| {
            let (cell, is_real) = (&model.cells[at][slot], self.recordings[at].is_real);
            cell.cost(seen[at][slot].as_ref(), &model.layout, is_real)
        };
        let costs = model.fresh.iter().map(|play| {
            let each = self.slots(held_out).map(|at| cost(play, at));
            each.sum::<f64>()
        });
        costs.sum::<f64>() / model.fresh.len() as f64
    }

    pub(super) fn cost(&self, model: &Model, held_out: bool) -> f64 {
        let costs = self.slots(held_out).map(|at| self.cost_at(model, at));
        costs.sum()
    }

    fn cost_at(&self, model: &Model, (at, slot): (usize, usize)) -> f64 {
        let seen = self.vehicle[at][slot].as_ref();
        model.cells[at][slot].cost(seen, &model.layout, self.recordings[at].is_real)
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

    /// The sum; in real time without the greatest, which the machine may have caused.
    fn total(&self, saved: impl Iterator<Item = f64>) -> f64 {
        let (sum, most) = saved.fold((0.0, 0.0_f64), |(sum, most), saved| {
            (sum + saved, most.max(saved))
        });
        if self.is_real() { sum - most } else { sum }
    }

    /// Costs of plays with each number a little off. That tyres slip and stick as those of the vehicle is luck,
    /// which saves up to 200 and ends a thousandth of a step further.
    pub(super) fn costs(&self, model: &Model) -> Result<Costs, String> {
        let near = (1..=SEEDS).map(|seed| self.near(&model.settings, seed));
        let near = self.moved(model, near.collect())?;
        let cost = |at| near.iter().map(|one| self.cost_at(one, at)).sum::<f64>();
        let each = self.slots(false).map(|at| cost(at) / SEEDS as f64);
        Ok(Costs {
            each: each.collect(),
            plays: near.iter().map(|one| self.cost(one, false)).collect(),
        })
    }

    /// Cost that one model saves compared with another, and the least that is no luck.
    fn gain(&self, before: &Costs, after: &Costs) -> (f64, f64) {
        let each = before.each.iter().zip(&after.each);
        let plays = before.plays.iter().zip(&after.plays);
        let saved: Vec<f64> = plays.map(|(before, after)| before - after).collect();
        let mean = saved.iter().sum::<f64>() / SEEDS as f64;
        let squares: f64 = saved.iter().map(|one| (one - mean).powi(2)).sum();
        let error = (squares / (SEEDS * (SEEDS - 1)) as f64).sqrt();
        let saves = self.total(each.map(|(before, after)| before - after));
        (saves, self.margin().max(SURE * error))
    }

    fn saved_at(&self, before: &Model, after: &Model, at: (usize, usize)) -> f64 {
        self.cost_at(before, at) - self.cost_at(after, at)
    }
}

/// Reads the bytes of recordings in the way in which the model explains them best: in the wrong order, they say nothing
/// of other settings.
pub(super) fn read_best(recordings: &mut [Recording], base: &SimSettings) -> Result<(), String> {
    let knobs = Knob::all(base, recordings[0].device.id, &[]);
    let values = knobs.iter().flat_map(|knob| {
        let values = knob.choices.iter();
        values.filter_map(|value| knob.set(base, value))
    });
    let differs = |settings: &SimSettings| {
        let mut all = recordings.iter();
        all.any(|one| one.seen_with(settings) != one.seen)
    };
    let others: Vec<SimSettings> = values.filter(differs).collect();
    if others.is_empty() {
        return Ok(());
    }
    let mut best = (f64::INFINITY, base);
    for settings in std::iter::once(base).chain(&others) {
        recordings
            .iter_mut()
            .for_each(|one| one.read_with(settings));
        let search = Search::new(recordings, settings.clone(), &[]);
        let cost = search.cost(&search.model(settings, 1.0)?, false);
        if cost < best.0 {
            best = (cost, settings);
        }
    }
    recordings.iter_mut().for_each(|one| one.read_with(best.1));
    Ok(())
}

/// The values of all settings, by key.
fn literals(settings: &SimSettings) -> BTreeMap<String, String> {
    let entries = settings.entries().into_iter();
    entries.map(|entry| (entry.key, entry.value)).collect()
}
