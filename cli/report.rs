//! The report of `sim run --report`: a page to look at, in one file that needs nothing else.
//!
//! Recordings are played again for what is shown: so a run with a real client is shown like one
//! without, and nothing is gathered while it has to be in time.

mod case;
mod film;
mod map;
mod plots;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;
use std::sync::{Mutex, MutexGuard, PoisonError};

use anyhow::Context as _;
use maud::{DOCTYPE, Markup, PreEscaped, html};
use sim_core::device::Devices;

use crate::exit::Failure;
use crate::run::{Case, CaseResult, PlayedCase, Verdict, worth};
use crate::visible::{self, lines as readable};
use crate::whole_file::Target;
use case::{Detail, shown};

const STYLE: &str = include_str!("report/style.css");
/// By this a report is known, which may be replaced.
const MARK: &str = "<meta name=\"generator\" content=\"sim\">";
/// Most cases that failed of which everything is shown.
const MOST_FULL: usize = 30;
/// Most cases of which the map is shown.
const MOST_MAPS: usize = 1500;

/// A report that is being made.
pub(crate) struct Report {
    devices: Devices,
    path: PathBuf,
    to: Target,
    /// Folder of recordings that nobody else wants.
    pub(crate) folder: tempfile::TempDir,
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

impl Report {
    /// Makes sure that it can be written later on.
    pub(crate) fn begin(devices: Devices, path: &Path) -> Result<Self, Failure> {
        let cannot = || format!("cannot write the report {}", visible::name(path));
        let to = Target::find(path, "a report", &[MARK])
            .with_context(cannot)
            .map_err(Failure::usage)?;
        if let Target::File = &to {
            // Emptied, lest a former report be taken for this one's if it is killed.
            to.write(path, b"")
                .with_context(cannot)
                .map_err(Failure::usage)?;
        }
        let folder = tempfile::Builder::new().prefix("sim-report-").tempdir();
        let folder = folder.context("cannot make a folder for recordings");
        Ok(Self {
            devices,
            path: path.to_owned(),
            to,
            folder: folder.map_err(Failure::system)?,
            shown: Mutex::default(),
        })
    }

    /// Adds a case, whose recording is there. Without a picture when `stop` becomes true meanwhile.
    pub(crate) fn add(
        &self,
        case: &Case<'_>,
        played: &PlayedCase,
        stop: &AtomicBool,
    ) -> Result<(), Failure> {
        let detail = self.shown().detail(played.outcome.passed);
        let text = shown(self.devices, case, played, detail, stop)?.into_string();
        self.shown().cases.insert(case.name(), text);
        Ok(())
    }

    fn shown(&self) -> MutexGuard<'_, Shown> {
        self.shown.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// A case has a result.
    pub(crate) fn known(&self, index: usize, case: &Case<'_>, result: &CaseResult) {
        self.shown()
            .rows
            .insert(index, Row::new(case, Some(result)));
    }

    /// Writes the page, also of a run that was broken off.
    pub(crate) fn write(&self, cases: &[Case<'_>]) -> Result<(), Failure> {
        let mut shown = self.shown();
        let row = |(index, case)| {
            let known = shown.rows.remove(&index);
            known.unwrap_or_else(|| Row::new(case, None))
        };
        let rows: Vec<Row> = cases.iter().enumerate().map(row).collect();
        let text = page(&rows, &shown.cases).into_string();
        let written = self.to.write(&self.path, text.as_bytes());
        written
            .with_context(|| format!("cannot write the report {}", visible::name(&self.path)))
            .map_err(Failure::system)
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

/// A case in the table.
struct Row {
    name: String,
    title: String,
    verdict: Verdict,
    /// Worth of it, or reason for which there is nothing.
    says: String,
    /// Simulated, s.
    time: Option<f64>,
}

/// A verdict as it is shown: its word, its class in the style sheet, and what is counted.
fn shown_as(verdict: Verdict) -> [&'static str; 3] {
    match verdict {
        Verdict::Passed => ["ok", "passed", "passed"],
        Verdict::Failed => ["FAILED", "failed", "failed"],
        // Not played to an end, or spoilt by the machine.
        Verdict::Spoilt | Verdict::Broken | Verdict::BrokenOff => {
            ["error", "other", "could not be judged"]
        }
        Verdict::Skipped => ["skipped", "other", "skipped"],
    }
}

impl Row {
    fn new(case: &Case<'_>, result: Option<&CaseResult>) -> Self {
        let (says, time) = match result {
            Some(CaseResult::Played(played)) => {
                let time = played.outcome.ended_at.as_secs_f64();
                (worth(&played.outcome), Some(time))
            }
            Some(CaseResult::BrokenOff) => ("broken off".to_owned(), None),
            Some(CaseResult::Broken(why)) => (why.clone(), None),
            None => ("not played".to_owned(), None),
        };
        Self {
            name: case.name(),
            title: case.loaded.scenario.title.clone(),
            verdict: result.map_or(Verdict::Skipped, CaseResult::verdict),
            says,
            time,
        }
    }
}

/// The whole page.
fn page(rows: &[Row], cases: &BTreeMap<String, String>) -> Markup {
    let passed = rows.iter().filter(|row| row.verdict == Verdict::Passed);
    let passed = passed.count();
    let title = format!("{passed} of {} passed", rows.len());
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                meta name="generator" content="sim";
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                // Nothing is fetched and nothing is executed, whatever anybody's titles say.
                meta http-equiv="Content-Security-Policy"
                    content="default-src 'none'; style-src 'unsafe-inline'";
                title { (title) }
                style { (PreEscaped(STYLE)) }
            }
            body {
                h1 { (title) }
                p.about { (tally(rows)) ", by sim " (env!("CARGO_PKG_VERSION")) }
                (table(rows))
                @for failed in [true, false] {
                    @for (index, row) in rows.iter().enumerate() {
                        @if (row.verdict != Verdict::Passed) == failed
                            && let Some(inside) = cases.get(&row.name) {
                            (shown_case(index, row, inside))
                        }
                    }
                }
            }
        }
    }
}

fn tally(rows: &[Row]) -> String {
    let kinds = [
        Verdict::Passed,
        Verdict::Failed,
        Verdict::Broken,
        Verdict::Skipped,
    ];
    let words = kinds.into_iter().filter_map(|kind| {
        let is_such = |row: &&Row| shown_as(row.verdict) == shown_as(kind);
        let count = rows.iter().filter(is_such).count();
        let [.., counted] = shown_as(kind);
        (count > 0).then(|| format!("{count} {counted}"))
    });
    words.collect::<Vec<_>>().join(", ")
}

fn table(rows: &[Row]) -> Markup {
    html! {
        table.cases {
            thead { tr { th { "verdict" } th { "case" } th { "worth" } th.number { "time" } } }
            tbody {
                @for (index, row) in rows.iter().enumerate() {
                    tr {
                        td { (badge(row.verdict)) }
                        td {
                            a href=(format!("#case-{index}")) { (readable(&row.title)) }
                            br;
                            small { (readable(&row.name)) }
                        }
                        td { (readable(&row.says)) }
                        td.number { @if let Some(time) = row.time { (format!("{time:.1} s")) } }
                    }
                }
            }
        }
    }
}

fn badge(verdict: Verdict) -> Markup {
    let [word, class, _] = shown_as(verdict);
    html! { span class=(format!("badge {class}")) { (word) } }
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
            details.case {
                summary { (head) }
                div id=(id) { (inside) }
            }
        } @else {
            article.case id=(id) {
                h2 { (head) }
                (inside)
            }
        }
    }
}
