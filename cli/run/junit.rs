//! Results as JUnit XML, in the subset that Jenkins, GitLab and GitHub's actions read.
//!
//! Each scenario is a test suite, with a test case for each time that it was played, since only
//! suites can have properties everywhere.

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};
use sim_runner::Outcome;

use crate::exit::Failure;
use crate::visible;
use crate::whole_file::Target;

use super::case::{Case, CaseResult, Played};
use super::tell;

/// Multiple of the last writing's time for which is played on before the next: with thousands of
/// results the file is not written for each.
const RARELY: u32 = 20;

/// The file, with what is known so far; the rest counts as skipped. Who kills the program finds a
/// whole document.
pub(crate) struct Junit {
    path: PathBuf,
    to: Target,
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
        let to = Target::find(path, "JUnit results", &["<testsuites", "<testsuite "])
            .with_context(|| format!("cannot write results to {}", visible::name(path)))
            .map_err(Failure::usage)?;
        let mut report = Report::new("sim");
        report.test_suites = cases.iter().map(|case| suite(case, None)).collect();
        let mut junit = Self {
            path: path.to_owned(),
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
        match &self.to {
            Target::Stream(_) => Ok(()),
            Target::File => self.write(),
        }
    }

    fn write(&mut self) -> Result<(), Failure> {
        let begun = Instant::now();
        let text = self.text().map_err(Failure::system)?;
        self.to
            .write(&self.path, text.as_bytes())
            .with_context(|| format!("cannot write {}", visible::name(&self.path)))
            .map_err(Failure::system)?;
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
fn without_skipped_total(text: &str) -> String {
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
fn text(text: &str) -> String {
    visible::lines(text).into_owned()
}

fn suite(case: &Case<'_>, result: Option<&CaseResult>) -> TestSuite {
    let mut suite = TestSuite::new(case.name());
    let mut properties = vec![
        ("sim.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("sim.scenario", case.loaded.name()),
        ("sim.seed", case.seed.to_string()),
        ("sim.time", case.time_word().to_owned()),
        ("sim.command", case.command()),
    ];
    if let Some(trace) = case.file("trace.jsonl") {
        properties.push(("sim.trace", visible::name(&trace)));
    }
    if let Some(CaseResult::Played(played)) = result {
        for what in played.client.iter().flat_map(|client| &client.outside) {
            properties.push(("sim.not_repeatable", what.clone()));
        }
        for line in tell::client_report(&played.outcome) {
            properties.push(("sim.client_report", line));
        }
        for what in &played.outcome.not_judged {
            properties.push(("sim.not_judged", what.clone()));
        }
        if let Some(held_up) = played.held_up {
            let seconds = |time: Duration| format!("{:.3}", time.as_secs_f64());
            properties.push(("sim.held_up_s", seconds(held_up.total)));
            properties.push(("sim.held_up_longest_s", seconds(held_up.longest)));
        }
    }
    for (name, value) in properties {
        suite.add_property(Property::new(name, text(&value)));
    }
    let test = test_case(case, result);
    suite.set_time(test.time.unwrap_or_default());
    suite.add_test_case(test);
    suite
}

fn test_case(case: &Case<'_>, result: Option<&CaseResult>) -> TestCase {
    let title = visible::line(&case.loaded.scenario.title);
    let mut test = TestCase::new(title, status(result));
    // Shown as a tree by its dots.
    let stem = visible::name(&case.loaded.stem());
    test.set_classname(format!("sim.{}", stem.replace('.', "_")));
    test.set_time(Duration::ZERO);
    if let Some(CaseResult::Played(played)) = result {
        test.set_time(played.took);
        if let Some(client) = &played.client {
            test.set_system_out(text(&client.output));
        }
        if !played.outcome.passed {
            test.set_system_err(text(&surroundings(&played.outcome)));
        }
    }
    test
}

/// Events before each failure.
fn surroundings(outcome: &Outcome) -> String {
    let lines = outcome.failures.iter().flat_map(|failure| {
        let before = failure.context.before.iter().cloned();
        before.chain([format!("FAILED {failure}")])
    });
    lines.collect::<Vec<_>>().join("\n")
}

fn status(result: Option<&CaseResult>) -> TestCaseStatus {
    let error = |kind: &str, why: &str| {
        let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
        status.set_message(text(why)).set_type(kind);
        status
    };
    match result {
        Some(CaseResult::Played(played)) if played.outcome.passed => TestCaseStatus::success(),
        Some(CaseResult::Played(played)) => failed(played),
        Some(CaseResult::Broken(why)) => error("simulator", why),
        Some(CaseResult::BrokenOff) => {
            let why = "a signal ended the run while this was being played";
            error("broken off", why)
        }
        None => {
            let mut status = TestCaseStatus::skipped();
            status.set_message("the run ended before this was played");
            status
        }
    }
}

fn failed(played: &Played) -> TestCaseStatus {
    let (kind, what) = match played.is_spoilt {
        true => (NonSuccessKind::Error, "machine"),
        false => (NonSuccessKind::Failure, "scenario"),
    };
    let mut status = TestCaseStatus::non_success(kind);
    let machine = played.held_up.and_then(tell::machines_part);
    let failures = played.outcome.failures.iter().map(ToString::to_string);
    let lines: Vec<String> = match played.is_spoilt {
        true => machine.into_iter().chain(failures).collect(),
        false => failures.chain(machine).collect(),
    };
    let first = lines.first().map(|line| text(line)).unwrap_or_default();
    status
        .set_message(first)
        .set_type(what)
        .set_description(text(&lines.join("\n")));
    status
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_the_total_of_skipped_tests_goes() {
        let mut report = Report::new("a > b");
        let mut suite = TestSuite::new("suite");
        suite.add_test_case(TestCase::new("case", TestCaseStatus::skipped()));
        report.add_test_suite(suite);
        let text = without_skipped_total(&report.to_string().unwrap());
        assert_eq!(text.matches("skipped=\"1\"").count(), 1, "{text}");
        assert!(text.contains("<testsuite name=\"suite\" tests=\"1\" skipped=\"1\""));
    }
}
