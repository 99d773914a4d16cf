//! The report of `sim compare --report`: the text, and a plot of each field.

use maud::{Markup, html};

use super::report::{FieldRow, Report};
use crate::run::report_page;

/// Size of a plot, in its own units.
const SIZE: [f64; 2] = [480.0, 160.0];
/// Longest gap between two values that a line bridges, s.
const GAP: f64 = 1.0;
/// A value of time, vehicle and model.
type Value = fn(&[f64; 3]) -> f64;
/// The series in drawing order, each with the number of its colour.
const LINES: [(&str, Value, usize); 3] = [
    (
        "difference, around zero",
        |[_, seen, model]| seen - model,
        2,
    ),
    ("model", |[_, _, model]| *model, 1),
    ("vehicle", |[_, seen, _]| *seen, 0),
];

pub(super) fn page(report: &Report) -> String {
    let body = html! {
        pre.wrapped { (report.text()) }
        p.legend {
            @for (name, _, colour) in LINES {
                span.key { span class=(format!("line line{colour}")) {} (name) }
            }
        }
        div.plots {
            @for row in report.fields.iter().filter(|row| row.range[0] < row.range[1] || row.rms > 0.0 && row.series.len() > 1) { (plot(row)) }
        }
    };
    report_page("A recording beside the model", &[], &body).into_string()
}

fn plot(row: &FieldRow) -> Markup {
    let ends = |lines: &[(&str, Value, usize)]| {
        let values = |at| lines.iter().map(move |(_, value, _)| value(at));
        let all = || row.series.iter().flat_map(values);
        [
            all().fold(f64::INFINITY, f64::min),
            all().fold(f64::NEG_INFINITY, f64::max),
        ]
    };
    let [low, high] = ends(&LINES[1..]);
    let most = ends(&LINES[..1])
        .map(f64::abs)
        .into_iter()
        .fold(1e-9, f64::max);
    let end = row.series.last().map_or(1.0, |[time, ..]| *time);
    let points = |values: &[[f64; 3]], value: Value, [low, high]: [f64; 2]| {
        let point = |at: &[f64; 3]| {
            let x = at[0] / end * SIZE[0];
            let y = (high - value(at)) / (high - low).max(1e-9) * SIZE[1];
            format!("{x:.1},{y:.1} ")
        };
        values.iter().map(point).collect::<String>()
    };
    let parts = || row.series.chunk_by(|one, next| next[0] - one[0] <= GAP);
    html! {
        figure {
            figcaption {
                (row.name) " " (row.unit) ", "
                (format!("{low:.3} to {high:.3}, 0 to {end:.0} s; difference up to {most:.4}, bias {:.4}, RMS {:.4}", row.bias, row.rms))
            }
            svg.plot viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1])) role="img" aria-label=(row.name) {
                @for (index, (_, value, colour)) in LINES.iter().enumerate() {
                    @let scale = if index == 0 { [-most, most] } else { [low, high] };
                    @for part in parts() {
                        polyline class=(format!("curve curve{colour}")) points=(points(part, *value, scale)) {}
                    }
                }
            }
        }
    }
}
