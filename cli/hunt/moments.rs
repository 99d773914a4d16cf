//! Moments of a run without faults, each with the most robust trigger that reproduces it.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::names::Unit;
use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::run::Probe;
use rigsim_runner::trace::Observer;

use super::space::Trigger;

/// Most moments of a job.
pub(super) const MOST: usize = 12;
/// Number of times that the time between two changes is halved.
const HALVINGS: usize = 3;
/// Tolerance of a trigger, ms.
const CLOSE: u64 = 30;
/// Time between two samples.
const EVERY: Duration = Duration::from_millis(20);
/// Ranks of triggers.
const STATE: usize = 0;
const COUNT: usize = 1;
const DISTANCE: usize = 2;
/// Most samples.
const MOST_SAMPLES: usize = 100_000;

/// A moment of a job.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    /// Time in the run without faults, ms.
    pub(super) at: u64,
    /// The most robust trigger that reproduces it.
    pub(super) trigger: Trigger,
}

/// States of the devices over time.
pub(super) struct Samples {
    probes: Vec<Probe>,
    /// Device and id of the message that a probe counts.
    messages: Vec<Option<(usize, u8)>>,
    ranks: Vec<usize>,
    next: SimTime,
    /// In milliseconds.
    times: Vec<u64>,
    values: Vec<Vec<f64>>,
    /// Largest value of each name.
    most: Vec<f64>,
}

/// How robust a name is as a trigger, lower is better; and the message that it counts.
fn rank(run: &Run, probe: &Probe) -> Option<(usize, Option<(usize, u8)>)> {
    let name = probe.name.split_once('.').map_or("", |(_, name)| name);
    let index = probe.device?;
    let plan = run.scenario().rig.devices.get(index)?;
    let counted = plan
        .device
        .all_messages()
        .find(|message| message.count == name);
    match name {
        "truth.touching" | "client.attached" => None,
        "truth.distance_m" => Some((DISTANCE, None)),
        "count.client_attached" => Some((COUNT, None)),
        _ if probe.unit == Unit::Flag && !name.starts_with("reported.") => Some((STATE, None)),
        // Counts that no act of the client causes would shift.
        _ => counted.map(|message| (COUNT, Some((index, message.id)))),
    }
}

impl Samples {
    pub(super) fn new(run: &Run) -> Self {
        let probes = run.probes().into_iter();
        let useful = probes.filter_map(|probe| Some((rank(run, &probe)?, probe)));
        let (ranks, probes): (Vec<_>, Vec<Probe>) = useful.unzip();
        let (ranks, messages) = ranks.into_iter().unzip();
        Self {
            most: vec![1.0; probes.len()],
            probes,
            ranks,
            messages,
            next: SimTime::ZERO,
            times: Vec::new(),
            values: Vec::new(),
        }
    }

    /// Devices and ids of the messages that were sent.
    pub(super) fn sent(&self) -> Vec<(usize, u8)> {
        let last = self.values.last().into_iter().flatten();
        let sent = self
            .messages
            .iter()
            .zip(last)
            .filter(|(_, count)| **count > 0.0);
        sent.filter_map(|(message, _)| *message).collect()
    }

    fn sample(&mut self, run: &Run) {
        let values = self.probes.iter().map(|probe| probe.number(run));
        // An unknown value (NaN) becomes zero, which equals itself.
        let zero = |value: f64| if value.is_nan() { 0.0 } else { value };
        let values: Vec<f64> = values.map(zero).collect();
        if self.times.len() < MOST_SAMPLES && self.values.last() != Some(&values) {
            for (most, value) in self.most.iter_mut().zip(&values) {
                *most = most.max(*value);
            }
            self.times
                .push((run.rig().now().as_nanos() + 500_000) / 1_000_000);
            self.values.push(values);
        }
    }

    /// The moments until a time in ms, in order: a fault does nothing to a client that has ended.
    pub(super) fn moments(&self, until: u64) -> Vec<Moment> {
        let mut indices: Vec<usize> = Vec::new();
        for (column, rank) in self.ranks.iter().enumerate() {
            let value = |row: usize| self.values[row][column];
            let changes = (1..self.values.len()).filter(|row| value(*row) != value(*row - 1));
            let changes: Vec<usize> = changes.collect();
            if *rank == STATE {
                indices.extend(&changes);
            } else {
                indices.extend(changes.first());
                indices.extend(changes.last());
            }
        }
        indices.sort_unstable();
        indices.dedup();
        for _ in 0..HALVINGS {
            let between = indices.windows(2).map(|pair| pair[0].midpoint(pair[1]));
            let between: Vec<usize> = between.collect();
            indices.extend(between);
            indices.sort_unstable();
            indices.dedup();
        }
        indices.retain(|row| self.times[*row] <= until);
        let mut chosen: Vec<usize> = Vec::new();
        // Those with the greatest difference of state first.
        while chosen.len() < MOST {
            let apart = |row: &usize| {
                let all = chosen.iter().map(|other| self.distance(*row, *other));
                all.fold(f64::INFINITY, f64::min)
            };
            let best = indices
                .iter()
                .copied()
                .max_by(|one, other| apart(one).total_cmp(&apart(other)).then(other.cmp(one)));
            match best.filter(|row| apart(row) > 0.0) {
                Some(row) => chosen.push(row),
                None => break,
            }
        }
        chosen.sort_unstable();
        let mut moments: Vec<Moment> = chosen.into_iter().map(|row| self.moment(row)).collect();
        moments.dedup_by(|one, other| one.trigger == other.trigger);
        if moments.is_empty() {
            let trigger = Trigger::At(0);
            moments.push(Moment { at: 0, trigger });
        }
        moments
    }

    /// Difference between the states of two rows.
    fn distance(&self, one: usize, other: usize) -> f64 {
        let pairs = self.values[one].iter().zip(&self.values[other]);
        let columns = pairs.zip(&self.most);
        let columns = columns.map(|((one, other), most)| (one - other).abs() / most);
        let whole = self.times.last().copied().unwrap_or_default().max(1);
        let time = self.times[one].abs_diff(self.times[other]);
        match time > CLOSE {
            true => columns.sum::<f64>() + share(time, whole),
            false => 0.0,
        }
    }

    fn moment(&self, row: usize) -> Moment {
        let at = self.times[row];
        let conditions = self
            .probes
            .iter()
            .enumerate()
            .filter_map(|(column, probe)| {
                let (rank, name) = (self.ranks[column], &probe.name);
                let value = self.values[row][column];
                let least = (value * 100.0).floor() / 100.0;
                let (has_changed, condition) = match rank {
                    STATE => {
                        let not = if value == 0.0 { "!" } else { "" };
                        (value != self.values[0][column], format!("{not}{name}"))
                    }
                    _ => (value > 0.05, format!("{name} >= {least}")),
                };
                let holds = |values: &Vec<f64>| match rank {
                    STATE => values[column] == value,
                    _ => values[column] >= least,
                };
                let first = self.values.iter().position(holds)?;
                let is_close = self.times[first].abs_diff(at) < CLOSE;
                (has_changed && is_close).then_some((rank, condition))
            });
        let best = conditions.min_by_key(|(rank, _)| *rank);
        let trigger = best.map_or(Trigger::At(at), |(_, condition)| Trigger::When(condition));
        Moment { at, trigger }
    }
}

#[expect(clippy::cast_precision_loss, reason = "no run takes 2^53 ms")]
fn share(part: u64, whole: u64) -> f64 {
    part as f64 / whole as f64
}

impl Observer for Samples {
    fn event(&mut self, run: &Run, _event: &Event) {
        self.sample(run);
    }

    fn next_sample(&self) -> SimTime {
        self.next
    }

    fn sample(&mut self, run: &Run) {
        self.sample(run);
        self.next = run.rig().now() + EVERY;
    }
}
