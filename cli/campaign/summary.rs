//! What `sim merge` prints and writes.

use std::path::PathBuf;

use anyhow::Context as _;
use maud::{DOCTYPE, PreEscaped, html};
use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};
use rigsim_pty::paths::Results;
use serde_json::{Value, json};

use crate::exit::{Exit, Failure};
use crate::run::{REPORT_MARK, REPORT_STYLE, Verdict, without_skipped_total};
use crate::visible::{self, lines as readable};

use super::merge::{Failed, MergeArgs, Merged};

/// Verdicts that cases have, in the order in which they are counted.
const VERDICTS: [Verdict; 4] = [
    Verdict::Passed,
    Verdict::Failed,
    Verdict::Skipped,
    Verdict::Error,
];
/// Most failures that are printed.
const MOST_PRINTED: usize = 20;

/// The files that are to be written.
pub(crate) struct Outputs {
    junit: Option<(PathBuf, Results)>,
    report: Option<(PathBuf, Results)>,
    json: Option<(PathBuf, Results)>,
}

impl Outputs {
    /// Finds out whether they can be written.
    pub(crate) fn find(args: &MergeArgs) -> Result<Self, Failure> {
        let find = |path: &Option<PathBuf>, marks: &'static [&'static str]| {
            let Some(path) = path else {
                return Ok(None);
            };
            let target = Results::at(path, marks)
                .with_context(|| format!("cannot write to {}", visible::name(path)))
                .map_err(Failure::usage)?;
            Ok(Some((path.clone(), target)))
        };
        Ok(Self {
            junit: find(&args.junit, &["<testsuites", "<testsuite "])?,
            report: find(&args.report, &[REPORT_MARK])?,
            json: find(&args.json, &["\"sim_merge\""])?,
        })
    }

    /// Writes them. Returns the exit code that the results stand for.
    pub(crate) fn write(&self, merged: &Merged, missing: usize) -> Result<Exit, Failure> {
        let write = |to: &Option<(PathBuf, Results)>, text: &dyn Fn() -> anyhow::Result<String>| {
            let Some((path, target)) = to else {
                return Ok(());
            };
            let text = text().map_err(Failure::system)?;
            target
                .write(text.as_bytes())
                .with_context(|| format!("cannot write {}", visible::name(path)))
                .map_err(Failure::system)
        };
        write(&self.junit, &|| junit(merged, missing))?;
        write(&self.report, &|| Ok(page(merged, missing)))?;
        write(&self.json, &|| {
            Ok(format!("{:#}\n", document(merged, missing)))
        })?;
        let worst = VERDICTS
            .iter()
            .filter(|verdict| merged.count(**verdict, None) > 0);
        let exit = worst
            .map(|verdict| verdict.exit())
            .max()
            .unwrap_or(Exit::Clean);
        Ok(match merged.different.is_empty() {
            true => exit,
            false => exit.max(Exit::Failed),
        })
    }
}

/// Counts in words: `990 passed, 10 failed, 0 skipped`.
fn counts(merged: &Merged, missing: usize) -> String {
    let count = |verdict: Verdict| merged.count(verdict, None);
    let mut text = format!(
        "{} passed, {} failed, {} skipped",
        count(Verdict::Passed),
        count(Verdict::Failed),
        count(Verdict::Skipped)
    );
    for (count, word) in [
        (count(Verdict::Error), "errors of the machine"),
        (merged.different.len(), "not repeatable"),
        (missing, "MISSING"),
    ] {
        if count > 0 {
            text += &format!(", {count} {word}");
        }
    }
    text
}

/// What is printed.
pub(crate) fn text(merged: &Merged, missing: usize) -> String {
    let mut lines = Vec::new();
    let frequent = merged.frequent(None);
    for (failed, count) in frequent.iter().take(MOST_PRINTED) {
        let heading = failed.verdict.heading();
        lines.push(format!(
            "{heading:<7} {count}x  {}",
            visible::line(&failed.signature)
        ));
        if let Some((place, _)) = merged.examples(failed).next() {
            lines.push(format!("  again: {}", merged.plan.command(place)));
        }
    }
    if frequent.len() > MOST_PRINTED {
        lines.push(format!(
            "and {} other failures",
            frequent.len() - MOST_PRINTED
        ));
    }
    for place in merged.different.keys() {
        lines.push(format!("not repeatable: {}", merged.plan.name(*place)));
        lines.extend(different(merged, *place).map(|result| format!("  {result}")));
        lines.push(format!("  again: {}", merged.plan.command(*place)));
    }
    lines.push(counts(merged, missing));
    lines.join("\n")
}

/// The results of a case that differ, in words.
fn different(merged: &Merged, place: usize) -> impl Iterator<Item = String> {
    merged.different[&place].iter().map(|line| {
        let reason = line.reason.as_deref().unwrap_or("nothing failed");
        let trace = line.trace.as_deref().unwrap_or("none");
        format!(
            "{}: {}; digest of the trace {trace}",
            line.verdict.word(),
            visible::line(reason)
        )
    })
}

fn document(merged: &Merged, missing: usize) -> Value {
    let plan = &merged.plan;
    let of = |file: Option<usize>| {
        let mut value = json!({});
        for verdict in VERDICTS {
            value[verdict.word()] = json!(merged.count(verdict, file));
        }
        value
    };
    let failures = merged.frequent(None).into_iter().map(|(failed, count)| {
        let cases = merged.examples(failed).map(|(place, reason)| {
            json!({
                "name": plan.name(place),
                "seed": plan.at(place).1,
                "reason": reason,
                "command": plan.command(place),
            })
        });
        json!({
            "verdict": failed.verdict,
            "signature": failed.signature,
            "count": count,
            "first": cases.collect::<Vec<_>>(),
        })
    });
    let files = plan.files.iter().enumerate().map(|(number, file)| {
        let mut value = of(Some(number));
        value["file"] = json!(file.file);
        value["parameters"] = file
            .parameters
            .iter()
            .map(|(name, value)| (name.clone(), json!(value)))
            .collect();
        value["title"] = json!(file.title);
        value
    });
    let different = merged.different.iter().map(|(place, lines)| {
        json!({ "name": plan.name(*place), "command": plan.command(*place), "results": lines })
    });
    json!({
        "sim_merge": 1,
        "program": plan.program,
        "client": plan.client,
        "cases": plan.cases(),
        "missing": missing,
        "verdicts": of(None),
        "failures": failures.collect::<Vec<_>>(),
        "not_repeatable": different.collect::<Vec<_>>(),
        "files": files.collect::<Vec<_>>(),
    })
}

/// A test suite for each file, with a test case for what passed and one for each failure.
fn junit(merged: &Merged, missing: usize) -> anyhow::Result<String> {
    let plan = &merged.plan;
    let mut report = Report::new("sim merge");
    for (number, file) in plan.files.iter().enumerate() {
        let mut suite = TestSuite::new(readable(&file.name()).into_owned());
        for verdict in VERDICTS {
            let count = merged.count(verdict, Some(number)).to_string();
            suite.add_property(Property::new(format!("sim.{}", verdict.word()), count));
        }
        let mut add = |name: &str, status: TestCaseStatus| {
            let mut test = TestCase::new(readable(name), status);
            test.set_classname(format!("sim.{}", readable(&file.file).replace('.', "_")));
            suite.add_test_case(test);
        };
        for (failed, count) in merged.frequent(Some(number)) {
            let kind = match failed.verdict {
                Verdict::Failed => NonSuccessKind::Failure,
                _ => NonSuccessKind::Error,
            };
            let mut status = TestCaseStatus::non_success(kind);
            status
                .set_type(failed.verdict.word())
                .set_message(format!("{count} of {} times", plan.repeat));
            let places = number * plan.repeat as usize..(number + 1) * plan.repeat as usize;
            let of_file = merged
                .examples(failed)
                .filter(|(place, _)| places.contains(place));
            let lines =
                of_file.map(|(place, reason)| format!("{reason}\nagain: {}", plan.command(place)));
            status.set_description(readable(&lines.collect::<Vec<_>>().join("\n")).into_owned());
            add(&failed.signature, status);
        }
        for place in merged
            .different
            .keys()
            .filter(|place| **place / plan.repeat as usize == number)
        {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
            status
                .set_type("not repeatable")
                .set_message(plan.name(*place));
            status.set_description(different(merged, *place).collect::<Vec<_>>().join("\n"));
            add("not repeatable", status);
        }
        match (
            merged.count(Verdict::Passed, Some(number)),
            merged.count(Verdict::Skipped, Some(number)),
        ) {
            (0, 0) => {}
            (0, _) => add(&file.title, TestCaseStatus::skipped()),
            _ => add(&file.title, TestCaseStatus::success()),
        }
        report.add_test_suite(suite);
    }
    if missing > 0 {
        let mut suite = TestSuite::new("missing results");
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_type("missing").set_message(format!(
            "{missing} of {} cases have no result",
            plan.cases()
        ));
        suite.add_test_case(TestCase::new("all cases have a result", status));
        report.add_test_suite(suite);
    }
    Ok(without_skipped_total(&report.to_string()?))
}

fn page(merged: &Merged, missing: usize) -> String {
    let plan = &merged.plan;
    let title = counts(merged, missing);
    let client = match plan.client.is_empty() {
        true => "the scripted ones".to_owned(),
        false => plan.client.join(" "),
    };
    let failure = |failed: &Failed, count: usize| {
        html! {
            tr class=(failed.verdict.word()) {
                td { span class=(format!("badge {}", failed.verdict.word())) { (failed.verdict.word()) } }
                td.number { (count) }
                td {
                    (readable(&failed.signature))
                    @for (place, reason) in merged.examples(failed) {
                        details {
                            summary { (readable(&plan.name(place))) }
                            p { (readable(reason)) }
                            pre { (readable(&plan.command(place))) }
                        }
                    }
                }
            }
        }
    };
    html! {
        (DOCTYPE)
        html lang="en" {
            head {
                meta charset="utf-8";
                (PreEscaped(REPORT_MARK))
                meta name="viewport" content="width=device-width, initial-scale=1";
                meta name="color-scheme" content="light dark";
                meta http-equiv="Content-Security-Policy"
                    content="default-src 'none'; style-src 'unsafe-inline'";
                title { (title) }
                style { (PreEscaped(REPORT_STYLE)) }
            }
            body {
                h1 { (title) }
                dl.run {
                    div { dt { "Client" } dd { (readable(&client)) } }
                    div { dt { "Cases" } dd { (plan.files.len()) " files, " (plan.repeat) " times each" } }
                    div { dt { "Program" } dd { "sim " (plan.program) } }
                }
                @if !merged.different.is_empty() {
                    h2 { "Not repeatable" }
                    @for place in merged.different.keys() {
                        p { (readable(&plan.name(*place))) }
                        ul { @for result in different(merged, *place) { li { (readable(&result)) } } }
                        pre { (readable(&plan.command(*place))) }
                    }
                }
                table.cases {
                    thead { tr { th { "verdict" } th.number { "cases" } th { "failure" } } }
                    tbody { @for (failed, count) in merged.frequent(None) { (failure(failed, count)) } }
                }
                table.cases {
                    thead { tr {
                        th { "file" }
                        @for verdict in VERDICTS { th.number { (verdict.word()) } }
                    } }
                    tbody {
                        @for (number, file) in plan.files.iter().enumerate() {
                            tr {
                                td { (readable(&file.title)) br; small { (readable(&file.name())) } }
                                @for verdict in VERDICTS { td.number { (merged.count(verdict, Some(number))) } }
                            }
                        }
                    }
                }
            }
        }
    }
    .into_string()
}
