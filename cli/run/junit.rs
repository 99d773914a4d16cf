//! Results as JUnit XML, in the subset that Jenkins, GitLab and GitHub's actions read.
//!
//! Each scenario is a test suite, with a test case for each time that it was played, since only
//! suites can have properties everywhere.

use std::path::Path;
use std::time::{Duration, Instant};

use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};
use rigsim_runner::run;

use crate::exit::Failure;
use crate::print::OutputFile;
use crate::visible;

use super::case::{Case, CaseResult, Verdict};
use super::view::View;

/// Multiple of the last writing's time for which is played on before the next: with thousands of
/// results the file is not written for each.
const RARELY: u32 = 20;

/// By these a file is known that may be replaced.
pub(super) const MARKS: &[&str] = &["<testsuites", "<testsuite "];

/// The file, with what is known so far; the rest counts as skipped. Who kills the program finds a
/// whole document.
pub(crate) struct Junit {
    to: OutputFile,
    report: Report,
    /// Time at which it was written, and how long that took.
    written: Option<(Instant, Duration)>,
    /// Something is known that is not written.
    is_behind: bool,
}

impl Junit {
    /// A file in which nothing is known of the cases.
    ///
    /// # Errors
    /// When it cannot be written, or something else is there that is no file of results.
    pub(crate) fn begin(path: &Path, cases: &[Case<'_>]) -> Result<Self, Failure> {
        let to = OutputFile::find(path, MARKS)?;
        let mut report = Report::new("sim");
        report.test_suites = cases.iter().map(|case| suite(case, None)).collect();
        let mut junit = Self {
            to,
            report,
            written: None,
            is_behind: true,
        };
        junit
            .update()
            .map_err(|failure| Failure::usage(failure.error))?;
        Ok(junit)
    }

    /// A case has a result.
    pub(crate) fn known(
        &mut self,
        index: usize,
        case: &Case<'_>,
        result: &CaseResult,
    ) -> Result<(), Failure> {
        self.report.test_suites[index] = suite(case, Some(result));
        self.is_behind = true;
        self.catch_up()
    }

    /// Writes what is known and not written, unless that was done just now.
    pub(crate) fn catch_up(&mut self) -> Result<(), Failure> {
        match self.written {
            Some((at, took)) if !self.is_behind || at.elapsed() < took * RARELY => Ok(()),
            _ => self.update(),
        }
    }

    /// Writes all that is known.
    pub(crate) fn finish(mut self) -> Result<(), Failure> {
        self.write()
    }

    /// Writes it on the way, unless it can be written only once.
    fn update(&mut self) -> Result<(), Failure> {
        match self.to.is_stream() {
            true => Ok(()),
            false => self.write(),
        }
    }

    fn write(&mut self) -> Result<(), Failure> {
        let begun = Instant::now();
        let text = self.text().map_err(Failure::system)?;
        self.to.write(&text)?;
        self.written = Some((Instant::now(), begun.elapsed()));
        self.is_behind = false;
        Ok(())
    }

    fn text(&mut self) -> anyhow::Result<String> {
        let report = &mut self.report;
        let sum = |of: fn(&TestSuite) -> usize| report.test_suites.iter().map(of).sum();
        (report.tests, report.failures) = (sum(|suite| suite.tests), sum(|suite| suite.failures));
        (report.errors, report.skipped) = (sum(|suite| suite.errors), sum(|suite| suite.skipped));
        let times = report.test_suites.iter().filter_map(|suite| suite.time);
        report.time = Some(times.sum());
        Ok(without_skipped_total(&self.report.to_string()?))
    }
}

/// The schema that Jenkins publishes knows no total of skipped tests over all suites, and the
/// library always writes one.
pub(super) fn without_skipped_total(text: &str) -> String {
    let Some(begin) = text.find("<testsuites ") else {
        return text.to_owned();
    };
    let end = begin + text[begin..].find('>').unwrap_or(0);
    let root = &text[begin..end];
    let attribute = root.find(" skipped=\"").and_then(|from| {
        let value = from + " skipped=\"".len();
        let to = root[value..].find('"')?;
        Some(&root[from..=value + to])
    });
    match attribute {
        Some(attribute) => text.replacen(attribute, "", 1),
        None => text.to_owned(),
    }
}

/// Text as it may go into the document: shown as on a terminal, so that the library finds nothing
/// to take out and XML nothing that it forbids.
pub(super) fn text(text: &str) -> String {
    visible::lines(text).into_owned()
}

fn suite(case: &Case<'_>, result: Option<&CaseResult>) -> TestSuite {
    let mut suite = TestSuite::new(case.name());
    let mut property = |name: &str, value: &str| {
        suite.add_property(Property::new(format!("sim.{name}"), text(value)));
    };
    property("version", env!("CARGO_PKG_VERSION"));
    property("scenario", &case.loaded.name());
    property("seed", &case.seed.to_string());
    property("time", case.time_word());
    property("command", &case.command());
    if let Some(trace) = case.file("trace.jsonl") {
        property("trace", &visible::name(&trace));
    }
    let view = View::new(&case.loaded.scenario, result, case.is_live());
    for note in &view.notes {
        property(&note.label.replace(' ', "_"), &note.text);
    }
    let played = result.and_then(|result| result.played.as_ref());
    for rule in played.iter().flat_map(|played| &played.outcome.margins) {
        let value = format!("{:.4} at {} s: {}", rule.margin, rule.at, rule.what);
        property("margin", &value);
    }
    if let Some(stalled) = result.and_then(|result| result.played.as_ref()?.stalled) {
        let seconds = |time: Duration| format!("{:.3}", time.as_secs_f64());
        property("stalled_s", &seconds(stalled.total));
        property("stalled_longest_s", &seconds(stalled.longest));
    }
    let test = test_case(case, result, &view);
    suite.set_time(test.time.unwrap_or_default());
    suite.add_test_case(test);
    suite
}

fn test_case(case: &Case<'_>, result: Option<&CaseResult>, view: &View<'_>) -> TestCase {
    let title = visible::line(&case.loaded.scenario.title);
    let kind = match view.verdict {
        Verdict::Failed => "scenario",
        verdict => verdict.word(),
    };
    let reason = view.reason.as_deref().unwrap_or_default();
    let mut lines = view.lines();
    lines.extend(view.notes.iter().map(ToString::to_string));
    let mut test = TestCase::new(title, status(view.verdict, kind, reason, &lines));
    // Shown as a tree by its dots.
    let stem = visible::name(&case.loaded.stem());
    test.set_classname(format!("sim.{}", stem.replace('.', "_")));
    let played = result.and_then(|result| result.played.as_ref());
    test.set_time(played.map_or(Duration::ZERO, |played| played.took));
    if let Some(client) = view.client {
        test.set_system_out(text(&client.output));
    }
    if !view.failures.is_empty() {
        test.set_system_err(text(&surroundings(view.failures)));
    }
    test
}

/// Events before each failure.
fn surroundings(failures: &[run::Failure]) -> String {
    let lines = failures.iter().flat_map(|failure| {
        let before = failure.context.before.iter().cloned();
        before.chain([format!("FAILED {failure}")])
    });
    lines.collect::<Vec<_>>().join("\n")
}

/// The status of a test case with this verdict, and what there is to say of it.
pub(super) fn status(
    verdict: Verdict,
    kind: &str,
    message: &str,
    lines: &[String],
) -> TestCaseStatus {
    let mut status = match verdict {
        Verdict::Passed => return TestCaseStatus::success(),
        Verdict::Skipped => TestCaseStatus::skipped(),
        Verdict::Failed => TestCaseStatus::non_success(NonSuccessKind::Failure),
        Verdict::Error | Verdict::Aborted => TestCaseStatus::non_success(NonSuccessKind::Error),
    };
    if !kind.is_empty() {
        status.set_message(text(message)).set_type(kind);
    }
    if !lines.is_empty() {
        status.set_description(text(&lines.join("\n")));
    }
    status
}

#[cfg(test)]
mod tests;
