//! The report of `sim compare --report`: the text, and a plot of each field.

use maud::{Markup, html};

use super::report::{FieldRow, Report};
use crate::run::report_page;

/// Size of a plot, in its own units.
const SIZE: [f64; 2] = [480.0, 160.0];
/// A value of time, vehicle and model.
type Value = fn(&[f64; 3]) -> f64;
/// What is drawn.
const LINES: [(&str, Value); 3] = [
    ("vehicle", |[_, seen, _]| *seen),
    ("model", |[_, _, model]| *model),
    ("difference", |[_, seen, model]| seen - model),
];

pub(super) fn page(report: &Report) -> String {
    let body = html! {
        pre { (report.text()) }
        p.legend {
            @for (index, (name, _)) in LINES.iter().enumerate() {
                span.key { span class=(format!("line line{index}")) {} (name) }
            }
        }
        div.plots {
            @for row in report.fields.iter().filter(|row| row.range[0] < row.range[1]) { (plot(row)) }
        }
    };
    report_page("A recording beside the model", &[], &body).into_string()
}

fn plot(row: &FieldRow) -> Markup {
    let values = |at| LINES.map(|(_, value)| value(at));
    let all = || row.series.iter().flat_map(values);
    let (low, high) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    let end = row.series.last().map_or(1.0, |[time, ..]| *time);
    let points = |value: Value| {
        let point = |at: &[f64; 3]| {
            let x = at[0] / end * SIZE[0];
            let y = (high - value(at)) / (high - low).max(1e-9) * SIZE[1];
            format!("{x:.1},{y:.1} ")
        };
        row.series.iter().map(point).collect::<String>()
    };
    html! {
        figure {
            figcaption {
                (row.name) " " (row.unit) ", "
                (format!("{low:.3} to {high:.3}, bias {:.4}, RMS {:.4}", row.bias, row.rms))
            }
            svg.plot viewBox=(format!("0 0 {} {}", SIZE[0], SIZE[1])) role="img" aria-label=(row.name) {
                @for (index, (_, value)) in LINES.iter().enumerate() {
                    polyline class=(format!("curve curve{index}")) points=(points(*value)) {}
                }
            }
        }
    }
}
