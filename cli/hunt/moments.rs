//! Moments of a run without faults, each with the most robust trigger that reproduces it.

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::device::names::Unit;
use rigsim_core::event::Event;
use rigsim_runner::Run;
use rigsim_runner::condition::Reading;
use rigsim_runner::run::Probe;
use rigsim_runner::trace::Onlooker;

/// Most moments of a job.
pub(super) const MOST: usize = 12;
/// How often the time between two changes is halved.
const HALVINGS: usize = 3;
/// A trigger may be off by so much, s.
const CLOSE: f64 = 0.03;
/// Time between two samples.
const EVERY: Duration = Duration::from_millis(20);
/// Most samples.
const MOST_SAMPLES: usize = 100_000;

/// A moment of a job.
#[derive(Debug, Clone)]
pub(super) struct Moment {
    /// Time of it without faults, s.
    pub(super) at: f64,
    /// Line of a step.
    pub(super) trigger: String,
}

/// States of the devices over time.
pub(super) struct Samples {
    probes: Vec<Probe>,
    next: SimTime,
    times: Vec<f64>,
    values: Vec<Vec<f64>>,
    /// Largest value of each name.
    most: Vec<f64>,
}

/// How robust a name is as a trigger; lower is better.
fn rank(probe: &Probe) -> Option<usize> {
    let name = probe.name.split_once('.').map_or("", |(_, name)| name);
    let is_flag = probe.unit == Unit::Flag;
    match name {
        "truth.touching" | "client.attached" => None,
        "truth.distance_m" => Some(2),
        _ if is_flag && !name.starts_with("reported.") => Some(0),
        _ if name.starts_with("count.") && !is_event_of_device(name) => Some(1),
        _ => None,
    }
}

/// Counts that are no act of a client.
fn is_event_of_device(name: &str) -> bool {
    ["count.requests", "count.replies", "count.actions"].contains(&name)
}

impl Samples {
    pub(super) fn new(run: &Run) -> Self {
        let devices = &run.scenario().rig.devices;
        let sent = |probe: &Probe| {
            let own = probe.device.and_then(|index| devices.get(index));
            let name = probe.name.split_once('.').map_or("", |(_, name)| name);
            name == "count.client_attached"
                || own.is_some_and(|plan| {
                    plan.device
                        .all_messages()
                        .any(|message| message.count == name)
                })
        };
        let useful = |probe: &Probe| match rank(probe) {
            Some(1) => sent(probe),
            rank => rank.is_some(),
        };
        let probes: Vec<Probe> = run.probes().into_iter().filter(useful).collect();
        Self {
            most: vec![1.0; probes.len()],
            probes,
            next: SimTime::ZERO,
            times: Vec::new(),
            values: Vec::new(),
        }
    }

    fn sample(&mut self, run: &Run) {
        let values = self.probes.iter().map(|probe| match probe.read(run) {
            Some(Reading::Number(number)) => number,
            Some(Reading::Flag(flag)) => f64::from(u8::from(flag)),
            None => 0.0,
        });
        let values: Vec<f64> = values.collect();
        if self.times.len() < MOST_SAMPLES && self.values.last() != Some(&values) {
            for (most, value) in self.most.iter_mut().zip(&values) {
                *most = most.max(*value);
            }
            self.times.push(run.rig().now().as_secs_f64());
            self.values.push(values);
        }
    }

    /// The moments, in the order of time.
    pub(super) fn moments(&self) -> Vec<Moment> {
        let mut indices: Vec<usize> = Vec::new();
        for (column, probe) in self.probes.iter().enumerate() {
            let value = |row: usize| self.values[row][column];
            let changes = (1..self.values.len()).filter(|row| value(*row) != value(*row - 1));
            let changes: Vec<usize> = changes.collect();
            if rank(probe) == Some(0) {
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
        let mut chosen: Vec<usize> = Vec::new();
        // The farthest apart in state first.
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
        moments
    }

    /// How different the states of two rows are.
    fn distance(&self, one: usize, other: usize) -> f64 {
        let pairs = self.values[one].iter().zip(&self.values[other]);
        let columns = pairs.zip(&self.most);
        let columns = columns.map(|((one, other), most)| (one - other).abs() / most);
        let whole = self.times.last().copied().unwrap_or(1.0).max(1.0);
        let time = (self.times[one] - self.times[other]).abs();
        match time > CLOSE {
            true => columns.sum::<f64>() + time / whole,
            false => 0.0,
        }
    }

    fn moment(&self, row: usize) -> Moment {
        let at = self.times[row];
        let mut best = (3, format!("at = \"{} ms\"", (at * 1e3).round()));
        for (column, probe) in self.probes.iter().enumerate() {
            let rank = rank(probe).unwrap_or(usize::MAX);
            let value = self.values[row][column];
            let begin = self.values[0][column];
            let (condition, holds): (String, Box<dyn Fn(f64) -> bool>) = match rank {
                0 if value != begin => {
                    let not = if value == 0.0 { "!" } else { "" };
                    (
                        format!("{not}{}", probe.name),
                        Box::new(move |found| found == value),
                    )
                }
                1 if value > 0.0 => (
                    format!("{} >= {value}", probe.name),
                    Box::new(move |found| found >= value),
                ),
                2 if value > 0.05 => {
                    let least = (value * 100.0).floor() / 100.0;
                    (
                        format!("{} >= {least}", probe.name),
                        Box::new(move |found| found >= least),
                    )
                }
                _ => continue,
            };
            let first = self.values.iter().position(|values| holds(values[column]));
            let is_close = first.is_some_and(|first| (self.times[first] - at).abs() < CLOSE);
            if rank < best.0 && is_close {
                best = (rank, format!("when = \"{condition}\""));
            }
        }
        Moment {
            at,
            trigger: best.1,
        }
    }
}

impl Onlooker for Samples {
    fn event(&mut self, run: &Run, _event: &Event) {
        self.sample(run);
    }

    fn next_look(&self) -> SimTime {
        self.next
    }

    fn look(&mut self, run: &Run) {
        self.sample(run);
        self.next = run.rig().now() + EVERY;
    }
}
