//! Content of a report about a run, gathered while its recording is played again.

use std::cell::Cell;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use rigsim_core::SimTime;
use rigsim_core::device::names::Unit;
use rigsim_core::event::{Event, code};
use rigsim_physics::Pose;
use rigsim_physics::world::{Feature, FeatureKind};
use rigsim_runner::run::Probe;
use rigsim_runner::trace::{Observer, Record};
use rigsim_runner::{DevicePlan, Run};

use crate::log::Words;

/// The times that plots show, s.
#[derive(Debug, Clone, Copy)]
pub(super) struct Window {
    pub(super) from: f64,
    pub(super) to: f64,
}

/// Shortest time between two looks.
const SHORTEST: Duration = Duration::from_millis(5);
/// Time before and after a failure for which traffic is shown.
const AROUND: [Duration; 2] = [Duration::from_millis(1500), Duration::from_millis(500)];
/// Most lines of traffic that are shown; the last ones before a failure count most.
const MOST_LINES: usize = 200;
/// Most faults whose times are shown.
const MOST_SPANS: usize = 200;
/// Most times of hits that are shown of a fault.
const MOST_HITS: usize = 100;
/// Most features of the world that are shown.
const MOST_FEATURES: usize = 2000;

/// In place of a unit, that of numbers which the client publishes.
pub(super) const PUBLISHED: &str = "published by the client";

/// Parts of a run that are wanted.
#[derive(Debug, Clone, Copy)]
pub(super) struct Wanted<'a> {
    /// Time that it took.
    pub(super) ended_at: SimTime,
    /// Time at which it failed first, if it did.
    pub(super) failed_at: Option<SimTime>,
    /// Number of looks at all of it.
    pub(super) looks: u32,
    /// The times around the failure, which are looked at as often again.
    pub(super) focus: Option<Window>,
    /// Set if values are wanted, and not only paths.
    pub(super) values: bool,
    /// Time after which it is given up.
    pub(super) patience: Option<Instant>,
    /// Becomes true when the program is to end.
    pub(super) stop: &'a AtomicBool,
}

impl Wanted<'_> {
    /// Returns whether it is given up.
    pub(super) fn is_over(&self) -> bool {
        let late = |until| Instant::now() > until;
        self.stop.load(Ordering::Relaxed) || self.patience.is_some_and(late)
    }
}

/// Events and values of a run, as far as they are shown.
pub(super) struct Frames<'a> {
    wanted: Wanted<'a>,
    every: Duration,
    next: SimTime,
    words: Words,
    /// Times of the looks.
    pub(super) times: Vec<f64>,
    pub(super) paths: Vec<Path>,
    pub(super) series: Vec<Series>,
    pub(super) spans: Vec<Span>,
    /// Things that stood and lay there at the end.
    pub(super) features: Vec<Feature>,
    /// Things that stood there only for a time.
    pub(super) passing: Vec<Feature>,
    changes: Option<u64>,
    /// Traffic and events around the failure.
    lines: Vec<(SimTime, String)>,
    pub(super) more_lines: usize,
    /// It ends before the run does.
    pub(super) is_cut: Cell<bool>,
}

/// The path of a vehicle.
pub(super) struct Path {
    pub(super) name: String,
    /// Length and width, m.
    pub(super) size: [f64; 2],
    /// At each time.
    pub(super) poses: Vec<Pose>,
}

/// The values of a name.
pub(super) struct Series {
    pub(super) probe: Probe,
    pub(super) unit: &'static str,
    pub(super) values: Vec<f64>,
}

/// The time for which a fault was there.
pub(super) struct Span {
    pub(super) device: usize,
    /// As the step that injected it is called.
    pub(super) name: String,
    pub(super) fault: &'static str,
    pub(super) from: f64,
    pub(super) to: Option<f64>,
    pub(super) hits: Vec<f64>,
}

impl<'a> Frames<'a> {
    pub(super) fn new(run: &Run, wanted: Wanted<'a>) -> Self {
        let world = run.rig().world();
        let devices = &run.scenario().rig.devices;
        let path = |(plan, (_, size)): (&DevicePlan, (_, [f64; 2]))| Path {
            name: plan.name.clone(),
            size,
            poses: Vec::new(),
        };
        let series = |probe: Probe| match probe.unit {
            Unit::Number(unit) if is_shown(unit) => Some(Series {
                probe,
                unit,
                values: Vec::new(),
            }),
            _ => None,
        };
        let probes = if wanted.values {
            run.probes()
        } else {
            Vec::new()
        };
        Self {
            wanted,
            every: (wanted.ended_at.since(SimTime::ZERO) / wanted.looks).max(SHORTEST),
            next: SimTime::ZERO,
            words: Words::new(&run.scenario().rig),
            times: Vec::new(),
            paths: devices.iter().zip(world.bodies()).map(path).collect(),
            series: probes.into_iter().filter_map(series).collect(),
            spans: Vec::new(),
            features: Vec::new(),
            passing: Vec::new(),
            changes: None,
            lines: Vec::new(),
            more_lines: 0,
            is_cut: Cell::new(false),
        }
    }

    /// The next time to look.
    fn after(&self, now: SimTime) -> SimTime {
        let next = now + self.every;
        let Some(Window { from, to }) = self.wanted.focus else {
            return next;
        };
        let fine = Duration::from_secs_f64((to - from) / f64::from(self.wanted.looks));
        let [from, to] = [from, to].map(|time| SimTime::ZERO + Duration::from_secs_f64(time));
        match now < from {
            true => next.min(from),
            false if now < to => next.min(now + fine.max(SHORTEST)),
            false => next,
        }
    }

    /// Time at which it ended, s.
    pub(super) fn length(&self) -> f64 {
        self.wanted.ended_at.as_secs_f64()
    }

    /// Time at which it failed first, s.
    pub(super) fn failed_at(&self) -> Option<f64> {
        self.wanted.failed_at.map(SimTime::as_secs_f64)
    }

    /// The look that is nearest to a time.
    pub(super) fn look_at(&self, time: f64) -> usize {
        let next = self.times.partition_point(|t| *t < time);
        next.min(self.times.len().saturating_sub(1))
    }

    /// The traffic and the events around the failure, in their order.
    pub(super) fn lines(&self) -> Vec<&str> {
        // The recording, which is ahead, has the steps.
        let mut lines: Vec<&(SimTime, String)> = self.lines.iter().collect();
        lines.sort_by_key(|(at, _)| *at);
        lines.into_iter().map(|(_, line)| line.as_str()).collect()
    }

    fn is_near_failure(&self, at: SimTime) -> bool {
        let failed_at = self.wanted.failed_at.filter(|_| self.wanted.values);
        failed_at.is_some_and(|failed| failed <= at + AROUND[0] && at <= failed + AROUND[1])
    }

    fn push_line(&mut self, at: SimTime, line: String) {
        if self.lines.len() < MOST_LINES {
            self.lines.push((at, line));
        } else {
            self.more_lines += 1;
        }
    }

    fn track_features(&mut self, run: &Run) {
        let world = run.rig().world();
        if self.changes.replace(world.changes()) == Some(world.changes()) {
            return;
        }
        let now: Vec<Feature> = world.features().take(MOST_FEATURES).collect();
        let is_obstacle = |one: &Feature| one.kind == FeatureKind::Obstacle;
        for feature in std::mem::replace(&mut self.features, now) {
            let gone = is_obstacle(&feature) && !self.passing.contains(&feature);
            if gone && self.passing.len() < MOST_FEATURES {
                self.passing.push(feature);
            }
        }
        let there = &self.features;
        self.passing.retain(|one| !there.contains(one));
    }

    /// Begins a series for each number that the client has not published before.
    fn begin_series(&mut self, run: &Run) {
        let looks = self.times.len().saturating_sub(1);
        for probe in run.published().filter(|_| self.wanted.values) {
            let is_known = |series: &Series| series.probe.name == probe.name;
            if !self.series.iter().any(is_known) {
                self.series.push(Series {
                    probe,
                    unit: PUBLISHED,
                    values: vec![f64::NAN; looks],
                });
            }
        }
    }

    fn update_span(&mut self, event: &Event, name: &str, fault: &'static str) {
        let at = event.at.as_secs_f64();
        let open = |span: &&mut Span| {
            span.to.is_none() && span.name == name && span.device == event.device
        };
        match event.kind.code() {
            code::FAULT_ARMED if self.spans.len() < MOST_SPANS => self.spans.push(Span {
                device: event.device,
                name: name.to_owned(),
                fault,
                from: at,
                to: None,
                hits: Vec::new(),
            }),
            code::FAULT_TRIGGERED => {
                let span = self.spans.iter_mut().rfind(open);
                if let Some(span) = span.filter(|span| span.hits.len() < MOST_HITS) {
                    span.hits.push(at);
                }
            }
            code::FAULT_CLEARED => {
                if let Some(span) = self.spans.iter_mut().rfind(open) {
                    span.to = Some(at);
                }
            }
            _ => {}
        }
    }
}

/// Returns whether it makes a plot: ages and counts tell nothing that others do not.
fn is_shown(unit: &str) -> bool {
    !unit.is_empty() && unit != "s"
}

impl Observer for Frames<'_> {
    fn record(&mut self, record: &Record) {
        if let Record::Step { t, step, what } = record {
            let at = SimTime::from_nanos(*t);
            if self.is_near_failure(at) {
                self.push_line(at, format!("{at:>12} == step \"{step}\" {what}"));
            }
        }
    }

    fn has_enough(&self) -> bool {
        self.is_cut.set(self.is_cut.get() || self.wanted.is_over());
        self.is_cut.get()
    }

    fn event(&mut self, _: &Run, event: &Event) {
        if let Some((name, fault)) = event.kind.fault() {
            self.update_span(event, name, fault);
        }
        if self.is_near_failure(event.at) {
            self.push_line(event.at, self.words.plain(event));
        }
    }

    fn next_sample(&self) -> SimTime {
        self.next
    }

    fn sample(&mut self, run: &Run) {
        self.next = self.after(self.next);
        self.track_features(run);
        self.times.push(run.rig().now().as_secs_f64());
        for (device, path) in self.paths.iter_mut().enumerate() {
            let motion = run.rig().motion(device);
            path.poses.extend(motion.map(|motion| motion.pose));
        }
        self.begin_series(run);
        for series in &mut self.series {
            series.values.push(series.probe.number(run));
        }
    }
}
