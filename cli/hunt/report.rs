//! What a hunt says: the summary, `hunt.json` and the page.

use std::collections::BTreeMap;
use std::fs;
use std::path::PathBuf;

use anyhow::Context as _;
use maud::{Markup, html};
use serde_json::{Value, json};

use crate::args::HuntArgs;
use crate::exit::{Exit, Failure};
use crate::print::{OutputFile, print};
use crate::run::{REPORT_MARKS, report_page};
use crate::visible::{self, lines as readable};

use super::Hunt;

/// Longest name of a file of a finding.
const MOST_NAME: usize = 60;

/// What all jobs of a hunt came to.
pub(super) struct Summary {
    output: PathBuf,
    report: Option<PathBuf>,
    jobs: Vec<Value>,
    maps: Vec<Markup>,
    lines: Vec<String>,
    found: usize,
}

impl Summary {
    pub(super) fn new(args: &HuntArgs) -> Self {
        Self {
            output: args.output.clone(),
            report: args.report.clone(),
            jobs: Vec::new(),
            maps: Vec::new(),
            lines: Vec::new(),
            found: 0,
        }
    }

    /// The search of a job is over.
    pub(super) fn add(&mut self, hunt: &Hunt<'_>) -> Result<(), Failure> {
        let cells = cells(hunt);
        let map = cells.iter().map(|((kind, moment), cell)| {
            json!({
                "kind": hunt.kinds[*kind].id,
                "device": hunt.kinds[*kind].device,
                "moment": hunt.moments[*moment].trigger,
                "moment_s": hunt.moments[*moment].at,
                "runs": cell.runs,
                "hits": cell.hits,
                "margin": cell.margin,
            })
        });
        self.jobs.push(json!({
            "job": visible::path_value(&hunt.job.path),
            "seed": hunt.player.seed(),
            "runs": hunt.spent,
            "counts": hunt.counts,
            "findings": hunt.found,
            "unavoidable": hunt.unavoidable,
            "moments": hunt.moments.iter().map(|one| json!({ "at_s": one.at, "trigger": one.trigger })).collect::<Vec<_>>(),
            "map": map.collect::<Vec<_>>(),
        }));
        self.maps.push(page_of(hunt, &cells));
        self.found += hunt
            .found
            .iter()
            .filter(|found| found.file.is_some())
            .count();
        self.lines.push(text_of(hunt));
        let path = self.output.join("hunt.json");
        fs::write(&path, format!("{:#}\n", json!({ "jobs": self.jobs })))
            .with_context(|| format!("cannot write {}", visible::name(&path)))
            .map_err(Failure::usage)
    }

    /// Prints all, and writes the page.
    pub(super) fn finish(self) -> Result<Exit, Failure> {
        if let Some(path) = &self.report {
            let body = html! { @for map in &self.maps { (map) } };
            let page = report_page(&format!("{} found", self.found), &[], &body);
            OutputFile::find(path, REPORT_MARKS)?.write(&page.into_string())?;
        }
        print(&self.lines.join("\n"))?;
        Ok(match self.found {
            0 => Exit::Clean,
            _ => Exit::Failed,
        })
    }
}

/// What was tried of a kind at a moment.
struct Cell {
    runs: u64,
    hits: u64,
    margin: Option<f64>,
}

fn cells(hunt: &Hunt<'_>) -> BTreeMap<(usize, usize), Cell> {
    let mut cells = BTreeMap::new();
    for tried in &hunt.tried {
        let Some(at) = tried.cell else {
            continue;
        };
        let cell = cells.entry(at).or_insert(Cell {
            runs: 0,
            hits: 0,
            margin: None,
        });
        cell.runs += 1;
        cell.hits += u64::from(tried.seen.hit.first().is_some_and(|hit| *hit));
        let broken = (!tried.seen.broken.is_empty()).then_some(0.0);
        let margin = broken.or(tried.seen.nearest().map(|(_, margin)| margin));
        cell.margin = match (cell.margin, margin) {
            (Some(one), Some(other)) => Some(f64::min(one, other)),
            (one, other) => one.or(other),
        };
    }
    cells
}

/// What came of a job, in words.
fn text_of(hunt: &Hunt<'_>) -> String {
    let counts = &hunt.counts;
    let mut text = format!(
        "{}: {} single faults of {} kinds at {} moments ({} hit nothing); {} refined; {} second faults in {} \
         reactions; {} random schedules",
        hunt.job.name(),
        counts.single,
        hunt.kinds.len(),
        hunt.moments.len(),
        counts.single_without_hit,
        counts.refined,
        counts.second,
        counts.reactions,
        counts.random,
    );
    match (counts.random, counts.random_failed) {
        (0, _) => {}
        // The rule of three: the bound that holds with a confidence of 95 %.
        (random, 0) => {
            let most = 300_u64.div_ceil(random).min(100);
            text += &format!(" without failure: fewer than {most} % of them fail (95 %)");
        }
        (_, failed) => text += &format!(", {failed} with a failure"),
    }
    for found in &hunt.found {
        let place = match &found.file {
            Some(file) => visible::name(&hunt.folder.join(file)),
            None => "not repeatable".to_owned(),
        };
        text += &format!(
            "\nfound: {}\n  {}\n  {place}",
            found.rule,
            found.faults.join("; ")
        );
    }
    for (rule, times) in &hunt.unavoidable {
        text += &format!("\nunavoidable for any client, {times} times: {rule}");
    }
    if hunt.found.is_empty() {
        text += "\nnothing found";
    }
    text
}

/// The map of a job: kinds by moments, coloured by margin.
fn page_of(hunt: &Hunt<'_>, cells: &BTreeMap<(usize, usize), Cell>) -> Markup {
    let colour = |margin: f64| {
        format!(
            "background:hsl({:.0} 70% 75%)",
            120.0 * margin.clamp(0.0, 1.0)
        )
    };
    html! {
        h2 { (readable(&hunt.job.name())) }
        p { (readable(&text_of(hunt))) }
        @for found in &hunt.found {
            h3 { (readable(&found.rule)) }
            p { (readable(&found.failure)) }
            ul { @for fault in &found.faults { li { (readable(fault)) } } }
            p.about { "Fails with " (found.seeds) " of 20 seeds. " @if let Some(file) = &found.file { code { (readable(file)) } } }
        }
        table {
            thead {
                tr {
                    th { "fault" }
                    @for moment in &hunt.moments {
                        th title=(readable(&moment.trigger)) { (format!("{:.1} s", moment.at)) }
                    }
                }
            }
            @for (row, kind) in hunt.kinds.iter().enumerate() {
                tr {
                    td { (kind.id) @if hunt.job.scenario.rig.devices.len() > 1 { " of " (readable(&kind.device)) } }
                    @for column in 0..hunt.moments.len() {
                        @match cells.get(&(row, column)) {
                            Some(Cell { margin: Some(margin), hits, .. }) if *hits > 0 => {
                                td.number style=(colour(*margin)) { (format!("{margin:.2}")) }
                            }
                            Some(_) => { td.number { "–" } }
                            None => { td {} }
                        }
                    }
                }
            }
        }
    }
}

/// A rule as part of the name of a file.
pub(super) fn slug(rule: &str) -> String {
    let mut slug = String::new();
    for letter in rule.chars() {
        if letter.is_ascii_alphanumeric() {
            slug.push(letter.to_ascii_lowercase());
        } else if !slug.ends_with('-') {
            slug.push('-');
        }
    }
    slug.truncate(MOST_NAME);
    slug.trim_matches('-').to_owned()
}
