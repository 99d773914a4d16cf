//! What `sim merge` prints and writes.

use std::cmp::Reverse;
use std::collections::BTreeMap;

use quick_junit::Report;
use serde::Serialize;
use serde_json::json;

use crate::exit::Exit;
use crate::run::case::{Verdict, counts};
use crate::run::page::{self, Row};
use crate::run::view::View;
use crate::run::{junit, tell};

use super::merged::{Known, Merged};
use super::plan::Example;
use super::results::TRACES;

/// Most findings that are printed.
const MOST_PRINTED: usize = 20;

/// The class of files.
const FILE: &str = "file";

/// Number of cases with each verdict.
type Verdicts = BTreeMap<Verdict, usize>;

/// What cases have in common that did not pass.
#[derive(Serialize)]
struct Finding<'a> {
    kind: Verdict,
    what: &'a str,
    /// Number of cases.
    count: usize,
    /// The first cases.
    cases: Vec<Example>,
}

impl Merged {
    /// Whatever did not pass, what is missing last.
    fn findings(&self) -> Vec<Finding<'_>> {
        let mut findings: Vec<Finding<'_>> = Vec::new();
        for ((kind, what), group) in &self.kinds {
            if group.count > 0 && kind.exit() != Exit::Clean {
                let first = group.first.iter();
                let first = first.filter_map(|(number, why)| self.plan.example(*number, why));
                findings.push(Finding {
                    kind: *kind,
                    what,
                    count: group.count,
                    cases: first.take(TRACES).collect(),
                });
            }
        }
        findings.sort_by_key(|one| (one.kind == Verdict::Missing, Reverse(one.count), one.what));
        findings
    }

    /// The verdicts of each file.
    fn files(&self) -> BTreeMap<&str, Verdicts> {
        let names = self.plan.files.iter().map(|file| file.name.as_str());
        let cases = self.cases.chunks(self.plan.repeat.max(1) as usize);
        names.zip(cases.map(tally)).collect()
    }

    /// The exit code that the results stand for.
    pub(super) fn exit(&self) -> Exit {
        worst(&tally(&self.cases)).exit()
    }

    /// Findings in words, or those alone that say what is missing.
    pub(super) fn text(&self, only_missing: bool) -> String {
        let mut findings = self.findings();
        findings.retain(|one| !only_missing || one.kind == Verdict::Missing);
        let line = |one: &Finding<'_>| tell::brief(one.what, &self.view(one));
        let mut lines: Vec<String> = findings.iter().map(line).collect();
        if let Some(more @ 1..) = lines.len().checked_sub(MOST_PRINTED) {
            lines.truncate(MOST_PRINTED);
            lines.push(format!("and {more} more"));
        }
        lines.push(counts(&tally(&self.cases)));
        lines.join("\n")
    }

    pub(super) fn json(&self) -> String {
        let plan = &self.plan;
        let json = json!({
            "sim_merge": 1,
            "program": plan.program,
            "client": plan.client,
            "repeat": plan.repeat,
            "cases": plan.cases(),
            "verdicts": tally(&self.cases),
            "findings": self.findings(),
            "files": self.files(),
        });
        format!("{json:#}\n")
    }

    /// A suite for each finding, and one for each file without.
    pub(super) fn junit(&self) -> anyhow::Result<String> {
        let mut entries = self.entries();
        entries.retain(|(class, _, view)| *class != FILE || view.verdict.exit() == Exit::Clean);
        let suites = entries.iter();
        let suites = suites.map(|(class, what, view)| junit::suite(what, class, what, view));
        let mut report = Report::new("sim merge");
        report.test_suites = suites.collect();
        junit::document(&mut report)
    }

    pub(super) fn page(&self) -> String {
        let plan = &self.plan;
        let client = Some(plan.client.join(" ")).filter(|words| !words.is_empty());
        let times = format!("{} files, {} times each", plan.files.len(), plan.repeat);
        let about = [
            ("Client", client.unwrap_or_else(|| "scripted".to_owned())),
            ("Cases", times),
            ("Program", format!("sim {}", plan.program)),
        ];
        let rows = self.entries().into_iter();
        let rows = rows.map(|(class, what, view)| Row::new(class, &what, view));
        page::page(&about, &tally(&self.cases), &rows.collect::<Vec<_>>()).into_string()
    }

    /// Findings and files: the class of each, its name, and what there is to say of it.
    fn entries(&self) -> Vec<(&'static str, String, View<'static>)> {
        let findings = self.findings().into_iter();
        let findings =
            findings.map(|one| (one.kind.as_str(), one.what.to_owned(), self.view(&one)));
        let files = self.files().into_iter().map(|(name, verdicts)| {
            let mut view = View::bare(worst(&verdicts), None);
            view.summary = Some(counts(&verdicts));
            (FILE, name.to_owned(), view)
        });
        findings.chain(files).collect()
    }

    fn view(&self, finding: &Finding<'_>) -> View<'static> {
        let (word, count, all) = (finding.kind.as_str(), finding.count, self.plan.cases());
        let reason = format!("{word} in {count} of {all} cases");
        let mut view = View::bare(finding.kind, Some(reason));
        let cases = finding.cases.iter();
        let cases = cases.map(|case| [case.name.as_str(), &case.reason].join(": "));
        view.add_notes("case", cases);
        let first = finding.cases.first().map(|case| case.command.clone());
        let first = first.filter(|_| finding.kind != Verdict::Missing);
        view.add_notes("again", first.into_iter());
        view
    }
}

/// Counts cases by verdict.
fn tally(cases: &[Option<Known>]) -> Verdicts {
    // A case that a signal has ended has no result.
    let possible = Verdict::ALL
        .into_iter()
        .filter(|one| *one != Verdict::Aborted);
    let mut verdicts: Verdicts = possible.map(|verdict| (verdict, 0)).collect();
    for known in cases.iter().flatten() {
        *verdicts.entry(known.verdict).or_default() += 1;
    }
    verdicts
}

/// The worst verdict that a case has.
fn worst(verdicts: &Verdicts) -> Verdict {
    let some = verdicts.iter().filter(|(_, count)| **count > 0);
    some.map(|(verdict, _)| *verdict)
        .max()
        .unwrap_or(Verdict::Passed)
}
