//! Results as JUnit XML, in the subset that Jenkins, GitLab and GitHub's actions read.
//!
//! Each scenario is a test suite, with a test case for each time that it was played, since only
//! suites can have properties everywhere.

use std::collections::BTreeMap;
use std::path::Path;
use std::time::{Duration, Instant};

use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};
use rigsim_runner::run;

use crate::exit::Failure;
use crate::print::OutputFile;
use crate::visible;

use super::case::{Case, CaseResult, Verdict, unplayed};
use super::view::View;

/// Multiple of the last writing's time for which is played on before the next: with thousands of
/// results the file is not written for each.
const RARELY: u32 = 20;

/// By these a file is known that may be replaced.
pub(super) const MARKS: &[&str] = &["<testsuites", "<testsuite "];

/// A case that an earlier attempt has played, its verdict, and what failed.
pub(super) type Earlier<'a> = (Case<'a>, Verdict, String);

/// The file, with what is known so far; the rest counts as skipped. Who kills the program finds a
/// whole document.
pub(crate) struct Junit<'a> {
    to: OutputFile,
    cases: &'a [Case<'a>],
    /// By the numbers of their cases.
    known: BTreeMap<usize, TestSuite>,
    /// Time at which it was written, and how long that took.
    written: Option<(Instant, Duration)>,
    /// Something is known that is not written.
    is_behind: bool,
}

impl<'a> Junit<'a> {
    /// A file in which nothing is known of the cases.
    ///
    /// # Errors
    /// When it cannot be written, or something else is there that is not a file of results.
    pub(crate) fn begin(
        path: &Path,
        cases: &'a [Case<'a>],
        earlier: Vec<Earlier<'_>>,
    ) -> Result<Self, Failure> {
        let suite = |(case, verdict, what): Earlier<'_>| {
            let reason = Some(what).filter(|what| !what.is_empty());
            let suite = suite_of(&case, &case.name(), &View::bare(verdict, reason), None);
            (case.number, suite)
        };
        let mut junit = Self {
            to: OutputFile::find(path, MARKS)?,
            cases,
            known: earlier.into_iter().map(suite).collect(),
            written: None,
            is_behind: true,
        };
        junit
            .update()
            .map_err(|failure| Failure::usage(failure.error))?;
        Ok(junit)
    }

    /// A case has a result.
    pub(crate) fn known(&mut self, index: usize, result: &CaseResult) -> Result<(), Failure> {
        let case = &self.cases[index];
        let view = View::new(&case.loaded.scenario, result, case.is_live());
        let suite = suite_of(case, &case.name(), &view, Some(result));
        self.known.insert(case.number, suite);
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
        let is_known = |index: usize| self.known.contains_key(&self.cases[index].number);
        let unplayed = unplayed(self.cases, is_known);
        let (numbers, mut suites): (Vec<usize>, Vec<TestSuite>) =
            std::mem::take(&mut self.known).into_iter().unzip();
        let is_clean = suites
            .iter()
            .all(|suite| suite.failures + suite.errors == 0);
        suites.extend(unplayed.iter().map(|one| {
            let view = View::unplayed(one.count, is_clean);
            suite_of(one.first, &one.name(), &view, None)
        }));
        let mut report = Report::new("sim");
        report.test_suites = suites;
        let text = document(&mut report).map_err(Failure::system)?;
        self.known = numbers.into_iter().zip(report.test_suites).collect();
        self.to.write(&text)?;
        self.written = Some((Instant::now(), begun.elapsed()));
        self.is_behind = false;
        Ok(())
    }
}

/// A document, with the sums of its suites.
pub(super) fn document(report: &mut Report) -> anyhow::Result<String> {
    let sum = |of: fn(&TestSuite) -> usize| report.test_suites.iter().map(of).sum();
    let (tests, failures) = (sum(|suite| suite.tests), sum(|suite| suite.failures));
    let (errors, skipped) = (sum(|suite| suite.errors), sum(|suite| suite.skipped));
    (report.tests, report.failures) = (tests, failures);
    (report.errors, report.skipped) = (errors, skipped);
    let times = report.test_suites.iter().filter_map(|suite| suite.time);
    report.time = Some(times.sum());
    // The schema that Jenkins publishes knows no total of skipped tests over all suites, and the library always
    // writes one, into the first element.
    let total = format!(" skipped=\"{skipped}\"");
    Ok(report.to_string()?.replacen(&total, "", 1))
}

/// Text as it may go into the document: shown as on a terminal, so that the library finds nothing
/// to take out and XML nothing that it forbids.
fn text(text: &str) -> String {
    visible::lines(text).into_owned()
}

/// A suite of a case that was played, or of others of its file that were not.
fn suite_of(
    case: &Case<'_>,
    name: &str,
    view: &View<'_>,
    result: Option<&CaseResult>,
) -> TestSuite {
    let stem = visible::name(&case.loaded.stem());
    let mut suite = suite(name, &stem, &case.loaded.scenario.title, view);
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
    let Some(played) = result.and_then(|result| result.played.as_ref()) else {
        return suite;
    };
    for rule in &played.outcome.margins {
        let value = format!("{:.4} at {} s: {}", rule.margin, rule.at, rule.what);
        property("margin", &value);
    }
    if let Some(stalled) = played.stalled {
        let seconds = |time: Duration| format!("{:.3}", time.as_secs_f64());
        property("stalled_s", &seconds(stalled.total));
        property("stalled_longest_s", &seconds(stalled.longest));
    }
    suite.test_cases[0].set_time(played.took);
    suite.set_time(played.took);
    suite
}

/// A suite of one test case.
pub(super) fn suite(name: &str, class: &str, title: &str, view: &View<'_>) -> TestSuite {
    let mut suite = TestSuite::new(text(name));
    for note in &view.notes {
        let name = format!("sim.{}", note.label.replace(' ', "_"));
        suite.add_property(Property::new(name, text(&note.text)));
    }
    let kind = match view.verdict {
        Verdict::Failed => "scenario",
        verdict => verdict.as_str(),
    };
    let reason = view.reason().unwrap_or_default();
    let mut lines = view.lines();
    lines.extend(view.notes.iter().map(ToString::to_string));
    let status = status(view.verdict, kind, &reason, &lines);
    let mut test = TestCase::new(visible::line(title), status);
    // Shown as a tree by its dots.
    test.set_classname(format!("sim.{}", text(class).replace('.', "_")));
    test.set_time(Duration::ZERO);
    if let Some(client) = view.client {
        test.set_system_out(text(&client.output));
    }
    if !view.failures.is_empty() {
        test.set_system_err(text(&surroundings(view.failures)));
    }
    suite.set_time(Duration::ZERO);
    suite.add_test_case(test);
    suite
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
fn status(verdict: Verdict, kind: &str, message: &str, lines: &[String]) -> TestCaseStatus {
    let mut status = match verdict {
        Verdict::Passed => return TestCaseStatus::success(),
        Verdict::Skipped => TestCaseStatus::skipped(),
        Verdict::Failed | Verdict::NotRepeatable => {
            TestCaseStatus::non_success(NonSuccessKind::Failure)
        }
        Verdict::Error | Verdict::Missing | Verdict::Aborted => {
            TestCaseStatus::non_success(NonSuccessKind::Error)
        }
    };
    status.set_message(text(message)).set_type(kind);
    if !lines.is_empty() {
        status.set_description(text(&lines.join("\n")));
    }
    status
}

#[cfg(test)]
mod tests;
