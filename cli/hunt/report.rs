//! Output of a hunt: the summary, `hunt.json` and the page.

use std::collections::BTreeMap;

use maud::{Markup, html};
use serde_json::{Value, json};

use crate::args::{HuntArgs, StageArg};
use crate::exit::{Exit, Failure};
use crate::print::{OutputFile, print};
use crate::run::{REPORT_MARKS, about_page, report_page};
use crate::visible::{self, lines as readable};

use super::finding::GAVE_UP;
use super::search::{Hunt, Tried};
use super::space::{counted, duration};

/// Beginnings of a `hunt.json`, by which a later hunt may replace it.
const RESULT_MARKS: &[&str] = &[
    "{\n  \"jobs\": [\n    {\n      \"findings\": [",
    "{\n  \"jobs\": []",
];

/// Results of all jobs of a hunt.
pub(super) struct Summary {
    /// `hunt.json`, and the page if there is to be one.
    results: OutputFile,
    report: Option<OutputFile>,
    jobs: Vec<Value>,
    pages: Vec<Markup>,
    lines: Vec<String>,
    found: usize,
    /// No run of the search of a job has a verdict.
    is_unjudged: bool,
}

impl Summary {
    /// Checks that all files can be written later.
    pub(super) fn find(args: &HuntArgs) -> Result<Self, Failure> {
        let report = args.report.as_deref();
        let report = report.map(|path| OutputFile::find(path, REPORT_MARKS));
        Ok(Self {
            report: report.transpose()?,
            results: OutputFile::find(&args.output.join("hunt.json"), RESULT_MARKS)?,
            jobs: Vec::new(),
            pages: Vec::new(),
            lines: Vec::new(),
            found: 0,
            is_unjudged: false,
        })
    }

    /// Replaces the files of an earlier hunt, before the search of the first job.
    pub(super) fn begin(&self) -> Result<(), Failure> {
        if self.jobs.is_empty() {
            self.write()?;
            self.report.as_ref().map_or(Ok(()), OutputFile::clear)?;
        }
        Ok(())
    }

    /// The search of a job is over.
    pub(super) fn add(&mut self, hunt: &Hunt<'_>) -> Result<(), Failure> {
        let state = &hunt.state;
        let moments = state.moments.iter();
        let moments =
            moments.map(|one| json!({ "at_ms": one.at, "trigger": one.trigger.to_string() }));
        let tried = state.tried.iter().map(|tried| {
            let words = tried.planned.schedule.iter().map(|fault| fault.words());
            let alone = tried.alone.iter().map(|seen| seen.nearest(&state.usual));
            let kinds = tried.planned.schedule.iter().map(|fault| fault.kind);
            json!({
                "kinds": kinds.collect::<Vec<_>>(),
                "faults": words.collect::<Vec<_>>(),
                "moments": tried.planned.cells.iter().map(|(.., moment)| moment).collect::<Vec<_>>(),
                "hit": tried.seen.hit.iter().take(tried.planned.schedule.len()).collect::<Vec<_>>(),
                "margin": tried.seen.nearest(&state.usual),
                "alone": alone.collect::<Vec<_>>(),
                "nearer": tried.seen.nearer(&state.usual).collect::<BTreeMap<_, _>>(),
                "broken": tried.seen.broken.values().map(|one| &one.failure).collect::<Vec<_>>(),
                "error": tried.seen.error,
            })
        });
        self.jobs.push(json!({
            "job": visible::path_value(&hunt.job.path),
            "seed": hunt.player.seed,
            "margins": state.usual.margins,
            "runs": state.spent,
            "stages": state.counts,
            "reactions": hunt.reactions(),
            "findings": state.found,
            "unavoidable": state.unavoidable.values().cloned().collect::<BTreeMap<_, _>>(),
            "moments": moments.collect::<Vec<_>>(),
            "tried": tried.collect::<Vec<_>>(),
        }));
        if self.report.is_some() {
            self.pages.push(page_of(hunt)?);
        }
        self.found += state.written().count();
        self.is_unjudged |= state.unjudged().is_some();
        self.lines.push(text_of(hunt));
        self.write()
    }

    fn write(&self) -> Result<(), Failure> {
        let text = format!("{:#}\n", json!({ "jobs": self.jobs }));
        self.results.write(&text)
    }

    /// Prints all, and writes the page.
    pub(super) fn finish(self) -> Result<Exit, Failure> {
        if let Some(report) = &self.report {
            let body = html! { @for page in &self.pages { (page) } };
            let page = report_page(
                &format!("{} found", self.found),
                &about_page("lockstep"),
                &body,
            );
            report.write(&page.into_string())?;
        }
        print(&self.lines.join("\n"))?;
        Ok(match self.found {
            0 if self.is_unjudged => Exit::System,
            0 => Exit::Clean,
            _ => Exit::Failed,
        })
    }
}

/// Result of a job as text.
fn text_of(hunt: &Hunt<'_>) -> String {
    let state = &hunt.state;
    let count = |stage| state.counts.get(&stage).copied().unwrap_or_default();
    let random = count(StageArg::Random);
    let singles = state.tried.iter().flat_map(|tried| {
        let all = tried.seen.begun.iter().zip(&tried.seen.hit);
        all.take(tried.planned.cells.len())
    });
    let begun = singles.filter(|(begun, _)| begun.is_some());
    let hits: Vec<bool> = begun.map(|(_, hit)| *hit).collect();
    let mut text = format!(
        "{}: {} of {} at {} ({} hit nothing); {} in {}; {}",
        hunt.job.name(),
        counted(hits.len(), "single fault"),
        counted(state.kinds.len(), "kind"),
        counted(state.moments.len(), "moment"),
        hits.iter().filter(|hit| !**hit).count(),
        counted(count(StageArg::Further).runs, "further fault"),
        counted(hunt.reactions(), "reaction"),
        counted(random.runs, "random schedule"),
    );
    // Runs without a verdict do not count.
    let excused = random.unavoidable;
    let mut others = "";
    if excused > 0 {
        text += &format!(", {excused} with a failure that is not the client's");
        others = ", the others";
    }
    match (
        random.runs - random.without_verdict - excused,
        random.failed,
    ) {
        (0, _) => {}
        // The bound that holds with a confidence of 95 %.
        (runs, 0) => {
            let most = (100.0 * (1.0 - 0.05_f64.powf(1.0 / runs as f64))).ceil();
            text +=
                &format!("{others} without failure: fewer than {most:.0} % of them fail (95 %)");
        }
        (_, failed) => text += &format!(", {failed} with a failure"),
    }
    let without: u64 = state
        .counts
        .values()
        .map(|count| count.without_verdict)
        .sum();
    if without > 0 {
        text += &format!("; {} without a verdict", counted(without, "run"));
    }
    for found in &state.found {
        let (rule, faults) = (&found.rule, found.faults.join("; "));
        text += &match &found.file {
            Some(file) => {
                let place = visible::name(&hunt.player.folder.join(file));
                format!("\nfound: {rule}\n  {faults}\n  {place}")
            }
            None => format!("\nseen once, not repeatable: {rule}\n  {faults}"),
        };
    }
    for (key, (rule, times)) in &state.unavoidable {
        let what = if key.starts_with(GAVE_UP) {
            "the client gave up where a fault lasts"
        } else {
            "unavoidable for any client"
        };
        text += &format!("\n{what}, {}: {rule}", counted(*times, "time"));
    }
    if let Some(why) = state.unjudged() {
        text += &format!("\nno run of the search has a verdict: {why}");
    } else if state.written().next().is_none() {
        text += "\nnothing found";
    }
    text
}

/// The findings of a job with their pictures, and the map: kinds by moments, coloured by margin.
fn page_of(hunt: &Hunt<'_>) -> Result<Markup, Failure> {
    let state = &hunt.state;
    let pictures = state.found.iter().map(|found| hunt.picture(found));
    let pictures: Vec<Markup> = pictures.collect::<Result<_, _>>()?;
    let has_several = hunt.job.scenario.rig.devices.len() > 1;
    // The smallest margin of single faults that hit something; none if none did.
    let margin = |kind: usize, moment: usize| {
        let is_clear = |tried: &&Tried| {
            let is_pair = tried.planned.cells.len() > 1;
            !is_pair || !tried.alone.is_empty() || tried.seen.broken.is_empty()
        };
        let all = state.tried.iter().filter(is_clear).filter_map(|tried| {
            let mut cells = tried.planned.cells.iter();
            let index = cells.position(|(of, _, at)| (*of, *at) == (kind, moment))?;
            let (seen, hit) = tried.of(index);
            Some((hit, seen.nearest(&state.usual)))
        });
        let mut all = all.peekable();
        all.peek()?;
        let margins = all.filter_map(|(hit, margin)| hit.then_some(margin));
        Some(margins.reduce(f64::min))
    };
    Ok(html! {
        h2 { (readable(&hunt.job.name())) }
        pre.wrapped { (readable(&text_of(hunt))) }
        @for (found, picture) in state.found.iter().zip(&pictures) {
            h3 { (readable(&found.rule)) }
            p { (readable(&found.failure)) }
            ul { @for fault in &found.faults { li { (readable(fault)) } } }
            @for line in found.head.lines() { p.about { (readable(line.trim_start_matches("# "))) } }
            (picture)
        }
        p.about {
            "A number is the margin of a rule that came nearer to being broken than without faults. A run with two "
            "faults counts for both. If it broke a rule in a new way, each was played alone, and that counts; if in a "
            "known way, the run is left out. Green without a number: no rule came nearer. –: the fault hit nothing. "
            "Empty: not tried."
        }
        table {
            thead {
                tr {
                    th { "fault" }
                    @for moment in &state.moments {
                        th title=(readable(&moment.trigger.to_string())) { (duration(moment.at)) }
                    }
                }
            }
            @for (row, kind) in state.kinds.iter().enumerate() {
                tr {
                    td { (kind.info.id) @if has_several { " of " (readable(&kind.device)) } }
                    @for column in 0..state.moments.len() {
                        @match margin(row, column) {
                            Some(Some(margin)) => {
                                td.number style=(format!("color:#000;background:hsl({:.0} 70% 75%)", 120.0 * margin.min(1.0))) {
                                    @match margin {
                                        // 0.00 would be a broken rule.
                                        margin if margin > 0.0 && margin < 0.005 => "<0.01",
                                        margin if margin.is_finite() => (format!("{margin:.2}")),
                                        _ => "",
                                    }
                                }
                            }
                            Some(None) => { td.number { "–" } }
                            None => { td {} }
                        }
                    }
                }
            }
        }
    })
}
