//! Plots over time.

use maud::{Markup, html};

use super::frames::{Frames, PUBLISHED, Series, Window};
use crate::visible;

/// Size of a plot, in its own units, and the part of it within the axes: left, top, right, bottom.
const SIZE: [f64; 2] = [480.0, 230.0];
const AREA: [f64; 4] = [58.0, 8.0, 468.0, 204.0];
/// Most lines in a plot; those of a unit that has more are in several.
const MOST_LINES: usize = 6;
/// Most plots of a case.
const MOST_PLOTS: usize = 40;
/// Lines nearer to one another than this part of the axis are one, with both names.
const SAME: f64 = 0.004;
/// The least that an axis spans, as a part of its values: noise is not shown as a storm.
const LEAST: f64 = 2e-3;

/// Names of where a vehicle is.
const PLACE: [&str; 3] = ["truth.x_m", "truth.y_m", "truth.heading_deg"];

/// Units and what is measured in them, in the order of the plots.
const UNITS: [(&str, &str); 15] = [
    ("m/s", "speed"),
    ("0.1 %", "commands and set-points"),
    ("r/min", "measured speed"),
    ("1/10 r/min", "commanded and measured speed"),
    ("rad/s", "speed of wheels"),
    ("deg", "angle"),
    ("deg/s", "yaw rate"),
    ("A", "current"),
    ("V", "voltage"),
    ("%", "charge"),
    ("A·h", "charge drawn"),
    ("m", "distance"),
    ("mm", "distance"),
    ("N·m", "torque"),
    ("degC", "temperature"),
];

/// Place in the order of plots, caption, and unit of one name.
fn kind(series: &Series) -> (usize, &'static str, &'static str) {
    let name = &series.probe.name;
    let place = match name.as_str() {
        // What a client believes of its place stands beside the truth.
        "client.x" | "client.x_m" => Some(0),
        "client.y" | "client.y_m" => Some(1),
        "client.heading" | "client.heading_deg" => Some(2),
        _ => PLACE.iter().position(|end| name.ends_with(end)),
    };
    match place {
        Some(0 | 1) => (0, "position", "m"),
        Some(_) => (1, "heading", "deg"),
        None if series.unit == PUBLISHED => (3 + UNITS.len(), "", PUBLISHED),
        None => {
            let known = UNITS.iter().position(|(unit, _)| *unit == series.unit);
            let what = known.map_or("", |index| UNITS[index].1);
            (2 + known.unwrap_or(UNITS.len()), what, series.unit)
        }
    }
}

impl Window {
    /// The values within it.
    fn part(self, frames: &Frames) -> std::ops::Range<usize> {
        let first = frames.times.partition_point(|t| *t < self.from);
        let last = frames.times.partition_point(|t| *t <= self.to);
        first..last
    }
}

/// A plot for each kind of value in which something changes.
pub(super) fn plots(frames: &Frames, window: Window) -> Markup {
    let part = window.part(frames);
    let mut shown: Vec<&Series> = frames.series.iter().collect();
    shown.retain(|one| changes(&one.values[part.clone()]));
    shown.sort_by_key(|one| kind(one));
    let figures = shown.chunk_by(|one, other| kind(one) == kind(other));
    let figures = figures.flat_map(|of_kind| {
        let lines = Line::all(frames, of_kind, window);
        let some = lines
            .chunks(MOST_LINES)
            .map(|some| figure(frames, some, kind(of_kind[0]), window));
        some.collect::<Vec<_>>()
    });
    html! { div.plots { @for figure in figures.take(MOST_PLOTS) { (figure) } } }
}

/// Returns whether it shows anything.
fn changes(values: &[f64]) -> bool {
    let mut finite = values.iter().filter(|value| value.is_finite());
    let first = finite.next();
    first.is_some_and(|first| finite.any(|value| (value - first).abs() > 1e-9))
}

/// Values that are one line, with the names of all that have them.
struct Line<'a> {
    names: Vec<&'a str>,
    times: &'a [f64],
    values: &'a [f64],
}

impl<'a> Line<'a> {
    fn all(frames: &'a Frames, series: &[&'a Series], window: Window) -> Vec<Self> {
        let part = window.part(frames);
        let values = |one: &&'a Series| &one.values[part.clone()];
        let axis = Axis::of(series.iter().map(values));
        let near = SAME * (axis.high - axis.low);
        let mut lines: Vec<Self> = Vec::new();
        for one in series {
            let (name, values) = (short(frames, &one.probe.name), values(one));
            let same = lines.iter_mut().find(|line| {
                let mut both = line.values.iter().zip(values);
                both.all(|(a, b)| (a - b).abs() <= near || a.is_nan() && b.is_nan())
            });
            match same {
                Some(line) => line.names.push(name),
                None => lines.push(Self {
                    names: vec![name],
                    times: &frames.times[part.clone()],
                    values,
                }),
            }
        }
        lines
    }

    /// Its unbroken parts as points of the picture. An angle that goes on beyond half a turn breaks off.
    fn points(&self, axis: &Axis, time: &Axis, unit: &str) -> Vec<String> {
        let leap = if unit == "deg" { 180.0 } else { f64::INFINITY };
        let points: Vec<(f64, f64)> = self
            .times
            .iter()
            .copied()
            .zip(self.values.iter().copied())
            .collect();
        let parts = points.split(|(_, value)| !value.is_finite());
        let parts =
            parts.flat_map(|part| part.chunk_by(|one, next| (one.1 - next.1).abs() <= leap));
        let parts = parts.filter(|part| part.len() > 1);
        parts
            .map(|part| {
                let part = part.iter().map(|(t, value)| {
                    let x = AREA[0] + time.share(*t) * (AREA[2] - AREA[0]);
                    [x, AREA[3] - axis.share(*value) * (AREA[3] - AREA[1])]
                });
                let words = plain(&part.collect::<Vec<_>>());
                let words = words.iter().map(|[x, y]| format!("{x:.1},{y:.1}"));
                words.collect::<Vec<_>>().join(" ")
            })
            .collect()
    }
}

/// Without the points in the middle of a level.
fn plain(points: &[[f64; 2]]) -> Vec<[f64; 2]> {
    let level = |one: &[f64; 2], other: &[f64; 2]| (one[1] - other[1]).abs() < 0.05;
    let is_needed = |index: &usize| {
        let around = index
            .checked_sub(1)
            .and_then(|before| Some([points.get(before)?, points.get(index + 1)?]));
        around.is_none_or(|around| !around.iter().all(|one| level(one, &points[*index])))
    };
    (0..points.len())
        .filter(is_needed)
        .map(|index| points[index])
        .collect()
}

/// Without the device where there is one.
fn short<'a>(frames: &Frames, name: &'a str) -> &'a str {
    match name.split_once('.') {
        Some((device, name)) if frames.paths.len() == 1 && device != "client" => name,
        _ => name,
    }
}

/// What an axis spans, and the round values at which it has labels.
struct Axis {
    low: f64,
    high: f64,
    step: f64,
}

impl Axis {
    fn new(low: f64, high: f64, labels: f64) -> Self {
        let wide = (high - low) / labels;
        let power = 10_f64.powf(wide.log10().floor());
        let steps = [1.0, 2.0, 5.0, 10.0].map(|digit| digit * power);
        let step = steps.into_iter().find(|step| *step >= wide * 0.999);
        Self {
            low,
            high,
            step: step.unwrap_or(wide),
        }
    }

    /// Spans all values, with a little room.
    fn of<'v>(all: impl Iterator<Item = &'v [f64]>) -> Self {
        let finite = all.flatten().copied().filter(|value| value.is_finite());
        let (low, high) = finite.fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), value| {
            (low.min(value), high.max(value))
        });
        let least = (low.abs().max(high.abs()) * LEAST).max(1e-6);
        let room = ((high - low) * 0.05).max((least - (high - low)) / 2.0);
        Self::new(low - room, high + room, 4.0)
    }

    fn share(&self, value: f64) -> f64 {
        (value - self.low) / (self.high - self.low)
    }

    /// Values and their words, which have as many digits as the step between them.
    fn labels(&self) -> Vec<(f64, String)> {
        let mut units = std::iter::successors(Some(1.0), |unit| Some(unit / 10.0)).take(9);
        let digits = units.position(|unit| self.step >= unit * 0.999);
        let digits = digits.unwrap_or(9);
        let first = (self.low / self.step).ceil();
        let labels = (0..20).map(|index| (first + f64::from(index)) * self.step);
        let labels = labels.take_while(|value| *value <= self.high);
        // Zero has no sign.
        labels
            .map(|value| (value, format!("{:.digits$}", value + 0.0)))
            .collect()
    }
}

fn figure(
    frames: &Frames,
    lines: &[Line<'_>],
    (_, what, unit): (usize, &str, &str),
    window: Window,
) -> Markup {
    let axis = Axis::of(lines.iter().map(|line| line.values));
    let time = Axis::new(window.from, window.to.max(window.from + 1e-3), 6.0);
    let [left, top, right, bottom] = AREA;
    let x = |t: f64| left + time.share(t).clamp(0.0, 1.0) * (right - left);
    let y = |value: f64| bottom - axis.share(value) * (bottom - top);
    let shown = |t: f64| (window.from..=window.to).contains(&t);
    let short = |number: f64| format!("{number:.1}");
    html! {
        figure {
            figcaption { (what) @if !what.is_empty() { ", " } (unit) }
            svg.plot viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1])) xmlns="http://www.w3.org/2000/svg"
                role="img" aria-label=(format!("{what} over time")) {
                @for span in &frames.spans {
                    @let [from, to] = [span.from, span.to.unwrap_or(f64::INFINITY)];
                    @if from <= window.to && to >= window.from {
                        rect.fault x=(short(x(from))) y=(top) width=(short((x(to) - x(from)).max(1.0)))
                            height=(bottom - top) { title { (visible::line(&span.name)) } }
                    }
                    @for hit in span.hits.iter().filter(|hit| shown(**hit)) {
                        path.hit d=(format!("M{} {bottom}v-12", short(x(*hit)))) {}
                    }
                }
                @for (value, label) in axis.labels() {
                    path.grid d=(format!("M{left} {}H{right}", short(y(value)))) {}
                    text x=(left - 5.0) y=(short(y(value) + 4.0)) text-anchor="end" { (label) }
                }
                @for (t, label) in time.labels() {
                    path.axis d=(format!("M{} {bottom}v4", short(x(t)))) {}
                    text x=(short(x(t))) y=(bottom + 18.0) text-anchor="middle" { (label) " s" }
                }
                path.axis d=(format!("M{left} {top}V{bottom}H{right}")) {}
                // The first is the widest, so that what runs along it stays in sight.
                @for (index, line) in lines.iter().enumerate() {
                    @let width = 1.6 + 1.1 * (lines.len() - 1 - index) as f64;
                    @for points in line.points(&axis, &time, unit) {
                        polyline class=(format!("curve curve{index}")) stroke-width=(short(width)) points=(points) {}
                    }
                }
                @if let Some(at) = frames.failed_at().filter(|at| shown(*at)) {
                    path.failure d=(format!("M{} {top}V{bottom}", short(x(at)))) {}
                }
            }
            p.legend {
                @for (index, line) in lines.iter().enumerate() {
                    span.key { span class=(format!("line line{index}")) {} (line.names.join(" = ")) }
                }
            }
        }
    }
}
