//! The report of `sim run --report`: a page to look at, in one file that needs nothing else.
//!
//! Recordings are played again for what is shown: so a run with a real client is shown like one
//! without, and nothing is gathered while it has to be in time.

mod case;
mod frames;
mod map;
mod plots;

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::path::Path;
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::SystemTime;

use maud::{DOCTYPE, Markup, PreEscaped, html};
use rigsim_core::device::Devices;

use crate::args::RunArgs;
use crate::exit::Failure;
use crate::print::OutputFile;
use crate::visible::{self, lines as readable};

use super::case::{Case, CaseResult, Verdict, unplayed};
use super::view::View;
use case::{Detail, render_note, shown};

const STYLE: &str = include_str!("page/style.css");
/// By this a report is known, which may be replaced.
pub(crate) const MARKS: &[&str] = &["<meta name=\"generator\" content=\"sim\">"];
/// Most cases that failed of which everything is shown.
const MOST_FULL: usize = 30;
/// Most cases of which the map is shown.
const MOST_MAPS: usize = 1500;

/// A page that is being made.
pub(crate) struct Page {
    devices: Devices,
    to: OutputFile,
    /// What was played, and how.
    about: Vec<(&'static str, String)>,
    shown: Mutex<Shown>,
}

/// Shown parts of cases, by their names.
#[derive(Default)]
struct Shown {
    /// In the table, by the places of their cases.
    rows: BTreeMap<usize, Row>,
    cases: BTreeMap<String, String>,
    full: usize,
    maps: usize,
}

impl Page {
    /// Makes sure that it can be written later on.
    pub(crate) fn begin(devices: Devices, path: &Path, args: &RunArgs) -> Result<Self, Failure> {
        let to = OutputFile::find(path, MARKS)?;
        to.clear()?;
        let time = match args.client.is_empty() {
            true => "simulated, with scripted clients",
            false => args.time.word(),
        };
        Ok(Self {
            devices,
            to,
            about: about(time),
            shown: Mutex::default(),
        })
    }

    /// Adds a case that was played, whose recording is there. Without a picture when `stop` becomes
    /// true meanwhile.
    pub(crate) fn add(&self, case: &Case<'_>, result: &CaseResult, stop: &AtomicBool) {
        let Some(played) = &result.played else {
            return;
        };
        let detail = self.shown().detail(played.outcome.failures.is_empty());
        let text = shown(self.devices, case, result, played, detail, stop).into_string();
        self.shown().cases.insert(case.name(), text);
    }

    fn shown(&self) -> MutexGuard<'_, Shown> {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A case has a result.
    pub(crate) fn known(&self, index: usize, case: &Case<'_>, result: &CaseResult) {
        let view = View::new(&case.loaded.scenario, result, case.is_live());
        let played = result.played.as_ref();
        let row = Row {
            seed: Some(case.seed),
            time: played.map(|played| played.outcome.ended_at.as_secs_f64()),
            ..Row::new(&case.name(), &case.loaded.scenario.title, view)
        };
        self.shown().rows.insert(index, row);
    }

    /// Writes the page, also of an aborted run. `is_clean` says that all that was played passed, also earlier.
    pub(crate) fn write(&self, cases: &[Case<'_>], is_clean: bool) -> Result<(), Failure> {
        let mut shown = self.shown();
        let unplayed = unplayed(cases, |index| shown.rows.contains_key(&index));
        let mut rows: Vec<Row> = std::mem::take(&mut shown.rows).into_values().collect();
        let mut counts = BTreeMap::new();
        for row in &mut rows {
            row.inside = shown.cases.remove(&row.name);
            *counts.entry(row.verdict).or_default() += 1;
        }
        for one in unplayed {
            let title = &one.first.loaded.scenario.title;
            let view = View::unplayed(one.count, is_clean);
            *counts.entry(view.verdict).or_default() += one.count;
            rows.push(Row::new(&one.name(), title, view));
        }
        let text = page(&self.about, &counts, &rows).into_string();
        self.to.write(&text)
    }
}

impl Shown {
    /// Detail in which the next case is shown.
    fn detail(&mut self, passed: bool) -> Detail {
        if !passed && self.full < MOST_FULL {
            self.full += 1;
            return Detail::Full;
        }
        self.maps += 1;
        match self.maps > MOST_MAPS {
            true => Detail::Words,
            false => Detail::Map,
        }
    }
}

/// What was played, and how, in words.
pub(crate) fn about(time: &str) -> Vec<(&'static str, String)> {
    let words: Vec<OsString> = std::env::args_os().skip(1).collect();
    let command = visible::command(words.iter().map(OsString::as_os_str));
    vec![
        ("Command", format!("sim {command}")),
        ("Time", time.to_owned()),
        (
            "Date",
            humantime::format_rfc3339_seconds(SystemTime::now()).to_string(),
        ),
        ("Program", format!("sim {}", env!("CARGO_PKG_VERSION"))),
    ]
}

/// Something in the table.
pub(super) struct Row {
    name: String,
    title: String,
    verdict: Verdict,
    /// Reason for the verdict, or a summary of what passed.
    says: String,
    seed: Option<u64>,
    /// Simulated, s.
    time: Option<f64>,
    /// What is shown of it below the table.
    inside: Option<String>,
}

impl Row {
    pub(super) fn new(name: &str, title: &str, view: View<'_>) -> Self {
        let inside = html! { @for one in &view.notes { (render_note(one)) } };
        Self {
            name: name.to_owned(),
            title: title.to_owned(),
            verdict: view.verdict,
            inside: (!view.notes.is_empty()).then(|| inside.into_string()),
            says: view.reason().or(view.summary).unwrap_or_default(),
            seed: None,
            time: None,
        }
    }
}

/// The whole page, with the number of cases that have each verdict.
pub(super) fn page(
    about: &[(&str, String)],
    counts: &BTreeMap<Verdict, usize>,
    rows: &[Row],
) -> Markup {
    let passed = counts.get(&Verdict::Passed).copied().unwrap_or_default();
    let all = counts.values().sum();
    let body = html! {
        (filter(counts, all))
        (table(rows))
        @for failed in [true, false] {
            @for (index, row) in rows.iter().enumerate() {
                @if (row.verdict != Verdict::Passed) == failed
                    && let Some(inside) = &row.inside {
                    (shown_case(index, row, inside))
                }
            }
        }
    };
    document(&format!("{passed} of {all} passed"), about, &body)
}

/// Everything of a case whose recording is there, if it has begun.
pub(crate) fn case_in_full(
    devices: Devices,
    case: &Case<'_>,
    result: &CaseResult,
    stop: &AtomicBool,
) -> Option<Markup> {
    let played = result.played.as_ref()?;
    Some(shown(devices, case, result, played, Detail::Full, stop))
}

/// A page of results, with what they are about.
pub(crate) fn document(title: &str, about: &[(&str, String)], body: &Markup) -> Markup {
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content="sim";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                // Nothing is fetched and nothing is executed, whatever titles say.
                meta http-equiv="Content-Security-Policy"
                    content="default-src 'none'; style-src 'unsafe-inline'";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                dl.run {
                    @for (name, value) in about { div { dt { (name) } dd { (readable(value)) } } }
                }
                (body)
            }
        }
    }
}

/// Buttons that show cases of one verdict; the style sheet does what they say.
fn filter(counts: &BTreeMap<Verdict, usize>, all: usize) -> Markup {
    html! {
        fieldset.filter {
            label { input type="radio" name="show" id="show-all" checked; (all) " in all" }
            @for (verdict, count) in counts {
                @let id = format!("show-{}", class(*verdict));
                label { input type="radio" name="show" id=(id); (count) " " (verdict.as_str()) }
            }
        }
    }
}

fn table(rows: &[Row]) -> Markup {
    html! {
        table.cases {
            thead { tr { th { "verdict" } th { "case" } th { "reason" } th.number { "seed" } th.number { "time" } } }
            tbody {
                @for (index, row) in rows.iter().enumerate() {
                    tr class=(class(row.verdict)) {
                        td { (badge(row.verdict)) }
                        td {
                            a href=(format!("#case-{index}")) { (readable(&row.title)) }
                            br;
                            small { (readable(&row.name)) }
                        }
                        td { (readable(&row.says)) }
                        td.number { @if let Some(seed) = row.seed { (seed) } }
                        td.number { @if let Some(time) = row.time { (format!("{time:.1} s")) } }
                    }
                }
            }
        }
    }
}

pub(super) fn badge(verdict: Verdict) -> Markup {
    html! { span class=(format!("badge {}", class(verdict))) { (verdict.as_str()) } }
}

/// Name of a verdict in the style sheet.
fn class(verdict: Verdict) -> String {
    verdict.as_str().replace(' ', "-")
}

/// A case that failed is open, one that passed is folded.
fn shown_case(index: usize, row: &Row, inside: &str) -> Markup {
    let id = format!("case-{index}");
    let head = html! {
        (badge(row.verdict)) " " (readable(&row.title)) " " small { (readable(&row.name)) }
    };
    let inside = PreEscaped(inside);
    html! {
        @if row.verdict == Verdict::Passed {
            details.case.passed {
                summary { (head) }
                div id=(id) { (inside) }
            }
        } @else {
            article class=(format!("case {}", class(row.verdict))) id=(id) {
                h2 { (head) }
                (inside)
            }
        }
    }
}
