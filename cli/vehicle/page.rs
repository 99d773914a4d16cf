//! The report of `sim compare --report`: one file with a plot of each field.

use maud::{DOCTYPE, Markup, PreEscaped, html};

use super::report::{FieldRow, Report};

const STYLE: &str = "body{font:15px sans-serif;margin:2em;max-width:70em}table{border-collapse:collapse}\
    td,th{padding:.2em .6em;text-align:left;border-bottom:1px solid #ddd;vertical-align:top}\
    svg{background:#f8f8f8}.contradicted{color:#b00}figure{display:inline-block;margin:.5em}";
const SIZE: [f64; 2] = [480.0, 160.0];

pub(super) fn page(report: &Report) -> String {
    let page = html! {
        (DOCTYPE)
        meta charset="utf-8";
        meta name="generator" content="sim";
        title { "A recording beside the model" }
        style { (PreEscaped(STYLE)) }
        h1 { "A recording beside the model" }
        h2 { "Commands" }
        table {
            tr { th { "command" } th { "asked" } th { "answered: vehicle" } th { "model" } th { "ms p50, p99: vehicle" } th { "model" } }
            @for row in &report.commands {
                tr {
                    td { (row.name) } td { (row.asked) } td { (row.answered_by_vehicle) } td { (row.answered_by_model) }
                    @for [p50, p99] in [row.vehicle_ms, row.model_ms] { td { (format!("{p50:.1}, {p99:.1}")) } }
                }
            }
        }
        h2 { "Settings" }
        table {
            tr { th { "setting" } th { "basis" } th { "verdict" } th { "value" } th { "found" } th { "why" } }
            @for row in &report.settings {
                tr class=(row.verdict) {
                    td { (row.key) } td { (row.basis) } td { (row.verdict) } td { (row.value) }
                    td { (row.found.as_deref().unwrap_or_default()) } td { (row.why) }
                }
            }
        }
        @for row in &report.unexplained { p.contradicted { (row) } }
        h2 { "Fields: vehicle black, model blue, difference red" }
        @for row in report.fields.iter().filter(|row| row.range[0] < row.range[1]) { (plot(row)) }
    };
    page.into_string()
}

fn plot(row: &FieldRow) -> Markup {
    let all = || {
        row.series
            .iter()
            .flat_map(|[_, seen, model]| [*seen, *model, seen - model])
    };
    let (low, high) = (all().fold(0.0, f64::min), all().fold(0.0, f64::max));
    let end = row.series.last().map_or(1.0, |[time, ..]| *time);
    let line = |value: &dyn Fn(&[f64; 3]) -> f64| {
        let point = |at: &[f64; 3]| {
            let x = at[0] / end * SIZE[0];
            let y = (high - value(at)) / (high - low).max(1e-9) * SIZE[1];
            format!("{x:.1},{y:.1}")
        };
        row.series.iter().map(point).collect::<Vec<_>>().join(" ")
    };
    let lines = [
        ("#d00", line(&|[_, seen, model]| seen - model)),
        ("#000", line(&|[_, seen, _]| *seen)),
        ("#06c", line(&|[_, _, model]| *model)),
    ];
    html! {
        figure {
            figcaption { (row.name) " " (row.unit) ", " (format!("{low:.3} to {high:.3}, bias {:.4}, RMS {:.4}", row.bias, row.rms)) }
            svg width=(SIZE[0]) height=(SIZE[1]) {
                @for (colour, points) in &lines {
                    polyline fill="none" stroke=(colour) points=(points) {}
                }
            }
        }
    }
}
