//! The model's replies, their scatter by chance, and how well a recording fits them.

use std::collections::BTreeMap;

use super::recording::{Channel, Recording, Reply, Seen, Slot, channels, middle};

/// Cost of a bit that differs, and of each value of a reply that only one side has.
pub(super) const DIFFERENT: f64 = 36.0;
/// Deviation above which the cost grows more slowly, in standard deviations.
const HUBER: f64 = 3.0;
/// Deviation that chance does not explain, in standard deviations.
const FAR: f64 = 30.0;
/// Differences of the reply time that a computer and its adapter explain, ms.
pub(super) const ADAPTER: f64 = 2.0;

/// The model's replies to a slot, from several plays that differ by chance.
#[derive(Debug, Clone)]
pub(super) struct Cell {
    /// Whether there is a reply; `None` if that is random.
    pub(super) answers: Option<bool>,
    pub(super) form: Option<(&'static str, Option<u8>, usize)>,
    pub(super) mean: Vec<f64>,
    /// Standard deviations; infinite for a random bit.
    pub(super) sd: Vec<f64>,
    /// Variance of the mean. Without noise the mean differs: noise is limited, and pulses are whole.
    off: Vec<f64>,
}

/// Channels of the replies of a recording, by form.
#[derive(Clone)]
pub(super) struct Layout(BTreeMap<(&'static str, Option<u8>, usize), Vec<Channel>>);

impl Layout {
    pub(super) fn of<'a>(replies: impl Iterator<Item = &'a Reply>) -> Self {
        let mut all = BTreeMap::new();
        for reply in replies {
            all.entry(reply.form)
                .or_insert_with(|| channels(reply.info));
        }
        Self(all)
    }

    pub(super) fn of_form(&self, form: Option<(&'static str, Option<u8>, usize)>) -> &[Channel] {
        form.and_then(|form| self.0.get(&form))
            .map_or(&[], Vec::as_slice)
    }

    pub(super) fn channels(&self, reply: &Reply) -> &[Channel] {
        self.of_form(Some(reply.form))
    }
}

/// What all slots have by these plays, and by one without noise.
pub(super) fn cells(
    plays: &[&Seen],
    quiet: &Seen,
    recording: &Recording,
    layout: &Layout,
) -> Vec<Cell> {
    let slots = recording.slots.iter().enumerate();
    let mut cells: Vec<Cell> = slots.map(|(at, _)| cell(plays, at, layout)).collect();
    for (cell, quiet) in cells.iter_mut().zip(quiet) {
        let Some(quiet) = quiet.as_ref().filter(|quiet| Some(quiet.form) == cell.form) else {
            continue;
        };
        cell.off = vec![0.0; cell.mean.len()];
        for (channel, value) in quiet.values.iter().enumerate().skip(1) {
            let off = (cell.mean[channel] - value).powi(2);
            let by_chance = cell.sd[channel].powi(2) / plays.len() as f64;
            cell.off[channel] = (off - by_chance).max(0.0);
            cell.mean[channel] = *value;
        }
    }
    // Of a channel as a whole.
    let mut spreads: BTreeMap<_, Vec<f64>> = BTreeMap::new();
    for cell in &cells {
        for (channel, sd) in cell.sd.iter().enumerate() {
            spreads.entry((cell.form, channel)).or_default().push(*sd);
        }
    }
    let usual: BTreeMap<_, f64> = spreads.iter().map(|(of, all)| (of, usual(all))).collect();
    let jitter = jitter(recording, &cells);
    let plain: Vec<(u64, Vec<f64>)> = cells
        .iter()
        .zip(&recording.slots)
        .map(|(cell, slot)| (slot.at, cell.mean.clone()))
        .collect();
    let mut last: BTreeMap<_, usize> = BTreeMap::new();
    for at in 0..cells.len() {
        let before = last.insert(cells[at].form, at);
        for channel in 0..cells[at].sd.len() {
            let info = layout.of_form(cells[at].form).get(channel);
            if info.is_none_or(|info| info.is_choice) {
                // In real time it may change slightly earlier or later than in the model.
                if let Some(before) = before.filter(|_| recording.is_real)
                    && plain[before].1[channel] != plain[at].1[channel]
                {
                    cells[before].sd[channel] = f64::INFINITY;
                    cells[at].sd[channel] = f64::INFINITY;
                }
                continue;
            }
            // Rate of change: it shows a command that comes a little later or earlier.
            let slope = before.map_or(0.0, |before| {
                let span = (plain[at].0 - plain[before].0) as f64 / 1e6;
                (plain[at].1[channel] - plain[before].1[channel]).abs() / span.max(1.0)
            });
            // With so few plays, one reply scatters about as much as all.
            let usual = usual[&(cells[at].form, channel)];
            let sd = cells[at].sd[channel];
            let sd = if sd > 2.0 * usual { sd } else { usual };
            let off = cells[at].off.get(channel).copied().unwrap_or(0.0);
            // The mean is a whole number on the wire, or that of the plays.
            let is_rounded = channel > 0 && info.is_some_and(|info| !info.is_hex);
            let round = f64::from(is_rounded) / 12.0;
            let late = recording.slots[at].late;
            let jitter = match channel {
                0 => jitter,
                _ => (jitter + late) * slope,
            };
            cells[at].sd[channel] = (sd * sd + off + round + jitter * jitter + 1e-6).sqrt();
        }
    }
    // A simulated vehicle is as noisy as the model.
    if recording.is_real {
        add_noise(&mut cells, recording);
    }
    cells
}

/// The standard deviation that most replies have where they scatter, from those of a few plays each.
fn usual(all: &[f64]) -> f64 {
    let scatter: Vec<f64> = all.iter().copied().filter(|sd| *sd > 0.0).collect();
    middle(&scatter).0 / 0.93
}

/// Widens the scatter of a channel if the recording scatters more than the model: the vehicle has more noise.
/// It is measured without the model, by the distance of a reply from the middle of its neighbours.
fn add_noise(cells: &mut [Cell], recording: &Recording) {
    // With their standard deviations, which differ from reply to reply.
    let mut values: BTreeMap<_, Vec<[f64; 2]>> = BTreeMap::new();
    for (cell, seen) in cells.iter().zip(&recording.seen) {
        let seen = seen.as_ref().filter(|seen| Some(seen.form) == cell.form);
        let values_of = seen.iter().flat_map(|seen| &seen.values).zip(&cell.sd);
        for (channel, (value, sd)) in values_of.enumerate() {
            let of_channel = values.entry((cell.form, channel)).or_default();
            of_channel.push([*value, *sd]);
        }
    }
    let factor = |values: Vec<[f64; 2]>| {
        let bends = values.windows(3).map(|all| {
            let [before, at, after] = [all[0], all[1], all[2]];
            let bend = before[0] - 2.0 * at[0] + after[0];
            bend.abs() / (before[1].powi(2) + 4.0 * at[1].powi(2) + after[1].powi(2)).sqrt()
        });
        // The median of a normal distribution.
        (middle(&bends.collect::<Vec<_>>()).0 / 0.6745).max(1.0)
    };
    let factors: BTreeMap<_, f64> = values
        .into_iter()
        .map(|(of, values)| (of, factor(values)))
        .collect();
    for cell in cells {
        for (channel, sd) in cell.sd.iter_mut().enumerate() {
            let factor = factors.get(&(cell.form, channel)).copied().unwrap_or(1.0);
            *sd *= if factor.is_finite() { factor } else { 1.0 };
        }
    }
}

/// How much more the recording's reply times scatter than the model's, ms.
fn jitter(recording: &Recording, cells: &[Cell]) -> f64 {
    if !recording.is_real {
        return 0.0;
    }
    let replies = recording.seen.iter().zip(cells);
    let waits =
        replies.filter_map(|(reply, cell)| Some(reply.as_ref()?.values[0] - cell.mean.first()?));
    1.0 + 1.5 * middle(&waits.collect::<Vec<_>>()).1
}

fn cell(plays: &[&Seen], at: usize, layout: &Layout) -> Cell {
    let replies: Vec<&Reply> = plays.iter().filter_map(|play| play[at].as_ref()).collect();
    let answers = match replies.len() {
        0 => Some(false),
        count if count == plays.len() => Some(true),
        _ => None,
    };
    let Some(first) = replies.first() else {
        return Cell::new(None);
    };
    let same: Vec<&&Reply> = replies
        .iter()
        .filter(|reply| reply.form == first.form)
        .collect();
    let count = same.len() as f64;
    let mut cell = Cell::new(Some(first));
    cell.answers = answers.filter(|_| same.len() == replies.len());
    for (channel, info) in layout.channels(first).iter().enumerate() {
        let values = || {
            same.iter()
                .filter_map(|reply| reply.values.get(channel).copied())
        };
        let mean = values().sum::<f64>() / count;
        let squares: f64 = values().map(|value| (value - mean).powi(2)).sum();
        if info.is_choice {
            cell.sd[channel] = if squares > 0.0 { f64::INFINITY } else { 0.0 };
        } else {
            (cell.mean[channel], cell.sd[channel]) =
                (mean, (squares / (count - 1.0).max(1.0)).sqrt());
        }
    }
    cell
}

impl Cell {
    fn new(reply: Option<&Reply>) -> Self {
        let mean = reply.map(|reply| reply.values.clone()).unwrap_or_default();
        Self {
            answers: Some(reply.is_some()),
            form: reply.map(|reply| reply.form),
            sd: mean.iter().map(|value| 1.0 + 0.01 * value.abs()).collect(),
            off: Vec::new(),
            mean,
        }
    }

    /// The cell with `part` of the change between two plays with the same seed.
    pub(super) fn shifted(
        &self,
        from: Option<&Reply>,
        to: Option<&Reply>,
        part: f64,
        layout: &Layout,
    ) -> Self {
        match (from, to) {
            (Some(from), Some(to)) if from.form == to.form && Some(to.form) == self.form => {
                let mut cell = self.clone();
                for (channel, info) in layout.channels(to).iter().enumerate() {
                    let (Some(from), Some(to)) = (from.values.get(channel), to.values.get(channel))
                    else {
                        continue;
                    };
                    if !info.is_choice {
                        cell.mean[channel] += part * (to - from);
                    } else if from != to && part.abs() > 0.5 {
                        (cell.mean[channel], cell.sd[channel]) = (*to, 0.0);
                    }
                }
                cell
            }
            (None, None) => self.clone(),
            _ if part.abs() <= 0.5 => self.clone(),
            (_, Some(to)) if self.form == Some(to.form) => Self {
                answers: Some(true),
                ..self.clone()
            },
            (_, to) => Self::new(to),
        }
    }

    /// Signs, at most three, that the model would not send a reply: only one side has it, or its form, its
    /// bits or its values differ.
    pub(super) fn contradictions(&self, seen: Option<&Reply>, layout: &Layout) -> usize {
        let same = seen.filter(|seen| Some(seen.form) == self.form);
        match (self.answers, same) {
            (None, _) => 0,
            (Some(true), Some(seen)) => {
                let channels = layout.channels(seen).iter().enumerate().skip(1);
                let differs = |(at, info): &(usize, &Channel)| {
                    let far = if info.is_choice { 0.0 } else { FAR };
                    (seen.values[*at] - self.mean[*at]).abs() > far * self.sd[*at]
                };
                // No value is far from a random bit.
                channels
                    .filter(|(at, _)| self.sd[*at].is_finite())
                    .filter(differs)
                    .take(3)
                    .count()
            }
            (Some(answers), _) => usize::from(answers || seen.is_some()),
        }
    }

    /// Cost of a reply. Far off, the cost grows slowly, but it grows: a change that halves a large deviation
    /// still shows.
    pub(super) fn cost(&self, seen: Option<&Reply>, layout: &Layout, is_real: bool) -> f64 {
        let numbers =
            seen.filter(|seen| Some(seen.form) == self.form && self.answers != Some(false));
        let channels = numbers.map_or(&[][..], |seen| layout.channels(seen));
        let each = channels.iter().enumerate().filter_map(|(channel, info)| {
            let rest = seen?.values.get(channel)? - self.mean.get(channel)?;
            let z = significant(rest, channel, is_real) / self.sd[channel];
            (!info.is_choice).then(|| cost(z))
        });
        self.cost_of_form(seen, layout) + each.sum::<f64>()
    }

    /// The part of its cost that comes from bits and from what only one side has.
    pub(super) fn cost_of_form(&self, seen: Option<&Reply>, layout: &Layout) -> f64 {
        let absent = |values: &[f64]| DIFFERENT * (1.0 + values.len() as f64);
        match (seen, self.answers) {
            (None, Some(false) | None) => 0.0,
            (None, _) => absent(&self.mean),
            (Some(seen), Some(false)) => absent(&seen.values),
            (Some(seen), answers) if Some(seen.form) != self.form => {
                answers.map_or(0.0, |_| absent(&seen.values))
            }
            (Some(seen), _) => {
                let channels = layout.channels(seen).iter().zip(&self.sd);
                let values = seen.values.iter().zip(&self.mean);
                let differ = channels.zip(values).filter(|((info, sd), (seen, mean))| {
                    info.is_choice && **sd == 0.0 && seen != mean
                });
                DIFFERENT * differ.count() as f64
            }
        }
    }
}

/// Cost of a deviation, which is in standard deviations.
pub(super) fn cost(z: f64) -> f64 {
    match z.abs() {
        z if z <= HUBER => z * z,
        z => HUBER * HUBER * (1.0 + 2.0 * (z / HUBER).ln()),
    }
}

/// The part of a difference that the machine does not explain.
pub(super) fn significant(rest: f64, channel: usize, is_real: bool) -> f64 {
    match (channel, is_real) {
        (0, true) => (rest.abs() - ADAPTER).max(0.0),
        _ => rest.abs(),
    }
}

/// Weight of a deviation, which is in standard deviations.
pub(super) fn weight(z: f64) -> f64 {
    (HUBER / z.abs().max(HUBER)).powi(2)
}

/// Returns whether a slot takes part.
pub(super) fn takes_part(slot: &Slot, held_out: bool) -> bool {
    slot.counts && slot.held_out == held_out
}
