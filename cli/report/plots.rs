//! Plots over time.

use anyhow::anyhow;
use maud::{Markup, PreEscaped, html};
use plotters::prelude::*;

use super::film::{Film, Series};

/// Size of a plot, in units of its own.
const SIZE: (u32, u32) = (480, 230);
const FONT: (&str, u32) = ("sans-serif", 13);
/// Most lines in a plot; those of a unit that has more are in several.
const MOST_LINES: usize = 6;
/// Most plots of a case.
const MOST_PLOTS: usize = 40;

/// The colours of lines, which the style sheet changes on dark ground. They can be told apart by
/// people who see some colours alike (Okabe and Ito, "Color Universal Design", 2008), and are dark
/// enough.
const LINES: [RGBColor; MOST_LINES] = [
    RGBColor(0, 114, 178),
    RGBColor(213, 94, 0),
    RGBColor(0, 140, 105),
    RGBColor(184, 90, 150),
    RGBColor(160, 120, 0),
    RGBColor(90, 90, 90),
];
/// These are replaced by the style sheet altogether.
const INK: RGBColor = RGBColor(1, 1, 1);
const GRID: RGBColor = RGBColor(2, 2, 2);
const FAULT: RGBColor = RGBColor(230, 159, 0);
const FAILURE: RGBColor = RGBColor(200, 0, 0);

/// Units and what is measured in them, in the order of the plots.
const UNITS: [(&str, &str); 14] = [
    ("m/s", "speed"),
    ("0.1 %", "commands and set-points"),
    ("r/min", "measured speed"),
    ("1/10 r/min", "commanded and measured speed"),
    ("rad/s", "speed of wheels"),
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

/// A plot for each unit in which something changes.
pub(super) fn plots(film: &Film) -> anyhow::Result<Markup> {
    let changes: Vec<&Series> = film.series.iter().filter(|one| changes(one)).collect();
    let known = |unit: &str| UNITS.iter().position(|(known, _)| *known == unit);
    let mut units: Vec<&str> = changes.iter().map(|one| one.unit).collect();
    units.sort_by_key(|unit| (known(unit).unwrap_or(UNITS.len()), *unit));
    units.dedup();
    let mut drawn = Vec::new();
    for unit in units {
        let of_unit: Vec<&Series> = changes
            .iter()
            .copied()
            .filter(|one| one.unit == unit)
            .collect();
        let what = known(unit).map_or("", |index| UNITS[index].1);
        for some in of_unit.chunks(MOST_LINES).take(MOST_PLOTS - drawn.len()) {
            drawn.push(figure(film, what, unit, some)?);
        }
    }
    Ok(html! { div.plots { @for figure in drawn { (figure) } } })
}

/// Tells whether it shows anything.
fn changes(series: &Series) -> bool {
    let mut finite = series.values.iter().filter(|value| value.is_finite());
    let first = finite.next();
    first.is_some_and(|first| finite.any(|value| (value - first).abs() > 1e-9))
}

fn figure(film: &Film, what: &str, unit: &str, series: &[&Series]) -> anyhow::Result<Markup> {
    let mut svg = String::new();
    draw(film, series, &mut svg).map_err(|why| anyhow!("cannot draw a plot: {why}"))?;
    let short = |name: &str| match name.split_once('.') {
        Some((_, name)) if film.ways.len() == 1 => name.to_owned(),
        _ => name.to_owned(),
    };
    Ok(html! {
        figure {
            figcaption { (what) @if !what.is_empty() { ", " } (unit) }
            (PreEscaped(svg))
            p.legend {
                @for (index, one) in series.iter().enumerate() {
                    span.key { span class=(format!("line line{index}")) {} (short(&one.probe.name)) }
                }
            }
        }
    })
}

fn draw(
    film: &Film,
    series: &[&Series],
    svg: &mut String,
) -> Result<(), Box<dyn std::error::Error>> {
    let [low, high] = range(series);
    let end = film.length().max(1e-3);
    let root = SVGBackend::with_string(svg, SIZE).into_drawing_area();
    let mut chart = ChartBuilder::on(&root)
        .margin(4)
        .margin_right(14)
        .x_label_area_size(22)
        .y_label_area_size(60)
        .build_cartesian_2d(0.0..end, low..high)?;
    for span in &film.spans {
        let corners = [(span.from, low), (span.to.unwrap_or(end), high)];
        chart.draw_series([Rectangle::new(corners, FAULT.mix(0.22).filled())])?;
        let hit =
            |at: &f64| PathElement::new([(*at, low), (*at, low + (high - low) * 0.06)], FAULT);
        chart.draw_series(span.hits.iter().map(hit))?;
    }
    let text = FONT.into_font().color(&INK);
    chart
        .configure_mesh()
        .disable_x_mesh()
        .y_labels(5)
        .x_labels(6)
        .light_line_style(TRANSPARENT)
        .bold_line_style(GRID)
        .axis_style(INK)
        .label_style(text)
        .x_label_formatter(&|t| format!("{t} s"))
        .y_label_formatter(&|value| shown(*value, high - low))
        .draw()?;
    for (one, colour) in series.iter().zip(LINES) {
        for part in finite(&film.times, &one.values) {
            chart.draw_series(LineSeries::new(part, colour.stroke_width(2)))?;
        }
    }
    if let Some(at) = film.failed_at() {
        let line = PathElement::new([(at, low), (at, high)], FAILURE.stroke_width(2));
        chart.draw_series([line])?;
    }
    root.present()?;
    drop(chart);
    drop(root);
    Ok(())
}

/// The least and the most of all, with a little room.
fn range(series: &[&Series]) -> [f64; 2] {
    let values = series.iter().flat_map(|one| &one.values);
    let finite = values.copied().filter(|value| value.is_finite());
    let low = finite.clone().fold(f64::INFINITY, f64::min);
    let high = finite.fold(f64::NEG_INFINITY, f64::max);
    let room = ((high - low) * 0.05).max(1e-6);
    [low - room, high + room]
}

/// As many digits as tell labels apart.
fn shown(value: f64, range: f64) -> String {
    let digits = if range >= 20.0 {
        0
    } else if range >= 2.0 {
        1
    } else if range >= 0.2 {
        2
    } else {
        4
    };
    // Zero has no sign.
    let text = format!("{value:.digits$}");
    match text.parse() {
        Ok(0.0) => text.trim_start_matches('-').to_owned(),
        _ => text,
    }
}

/// The parts of a line between values that have no end.
fn finite(times: &[f64], values: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let points: Vec<(f64, f64)> = times.iter().copied().zip(values.iter().copied()).collect();
    let parts = points.split(|(_, value)| !value.is_finite());
    let parts = parts.filter(|part| part.len() > 1);
    parts.map(plain).collect()
}

/// Without the points in the middle of a level.
fn plain(points: &[(f64, f64)]) -> Vec<(f64, f64)> {
    let is_needed = |index: usize| {
        let at = |index: usize| points.get(index).map(|(_, value)| *value);
        let before = index.checked_sub(1).and_then(at);
        before != at(index) || at(index + 1) != at(index)
    };
    let needed = (0..points.len()).filter(|index| is_needed(*index));
    needed.map(|index| points[index]).collect()
}
