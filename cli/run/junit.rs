//! Results as JUnit XML, in the subset that Jenkins, GitLab and GitHub's actions read.
//!
//! Each scenario is a test suite, with a test case for each time that it was played, since only
//! suites can have properties everywhere.

use std::fs;
use std::path::Path;
use std::time::Duration;

use anyhow::Context as _;
use quick_junit::{NonSuccessKind, Property, Report, TestCase, TestCaseStatus, TestSuite};

use crate::exit::Failure;

use super::job::{Job, JobResult, Played};
use super::tell;

/// Writes the file, also of a run that was broken off.
pub(crate) fn write(
    path: &Path,
    jobs: &[Job<'_>],
    results: &[Option<JobResult>],
) -> Result<(), Failure> {
    let mut report = Report::new("sim");
    let mut total = Duration::ZERO;
    for (job, result) in jobs.iter().zip(results) {
        let suite = suite(job, result.as_ref());
        total += suite.time.unwrap_or_default();
        report.add_test_suite(suite);
    }
    report.set_time(total);
    report
        .to_string()
        .map_err(anyhow::Error::from)
        .and_then(|text| Ok(fs::write(path, without_skipped_total(&text))?))
        .with_context(|| format!("cannot write {}", path.display()))
        .map_err(Failure::system)
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

fn suite(job: &Job<'_>, result: Option<&JobResult>) -> TestSuite {
    let mut suite = TestSuite::new(job.name());
    let mut properties = vec![
        ("sim.version", env!("CARGO_PKG_VERSION").to_owned()),
        ("sim.scenario", job.loaded.path.display().to_string()),
        ("sim.seed", job.seed.to_string()),
        ("sim.time", job.time_word().to_owned()),
        ("sim.command", job.command()),
    ];
    if let Some(trace) = job.file("trace.jsonl") {
        properties.push(("sim.trace", trace.display().to_string()));
    }
    if let Some(JobResult::Played(played)) = result {
        for what in played.client.iter().flat_map(|client| &client.outside) {
            properties.push(("sim.not_repeatable", what.clone()));
        }
        for line in tell::client_report(&played.outcome) {
            properties.push(("sim.client_report", line));
        }
    }
    for (name, value) in properties {
        suite.add_property(Property::new(name, value));
    }
    let case = case(job, result);
    suite.set_time(case.time.unwrap_or_default());
    suite.add_test_case(case);
    suite
}

fn case(job: &Job<'_>, result: Option<&JobResult>) -> TestCase {
    let title = &job.loaded.scenario.title;
    let mut case = TestCase::new(title.as_str(), status(result));
    // Shown as a tree by its dots.
    case.set_classname(format!("sim.{}", job.loaded.stem().replace('.', "_")));
    case.set_time(Duration::ZERO);
    if let Some(JobResult::Played(played)) = result {
        case.set_time(played.took);
        if let Some(client) = &played.client {
            case.set_system_out(client.output.as_str());
        }
        if !played.outcome.passed {
            case.set_system_err(played.outcome.traffic.join("\n"));
        }
    }
    case
}

fn status(result: Option<&JobResult>) -> TestCaseStatus {
    match result {
        Some(JobResult::Played(played)) if played.outcome.passed => TestCaseStatus::success(),
        Some(JobResult::Played(played)) => failed(played),
        Some(JobResult::Broken(why)) => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
            status.set_message(why.as_str()).set_type("simulator");
            status
        }
        Some(JobResult::BrokenOff) => {
            let mut status = TestCaseStatus::non_success(NonSuccessKind::Error);
            let why = "a signal ended the run while this was being played";
            status.set_message(why).set_type("broken off");
            status
        }
        None => {
            let mut status = TestCaseStatus::skipped();
            status.set_message("the run ended before this was played");
            status
        }
    }
}

fn failed(played: &Played) -> TestCaseStatus {
    let mut status = TestCaseStatus::non_success(NonSuccessKind::Failure);
    let lines: Vec<String> = played
        .outcome
        .failures
        .iter()
        .map(ToString::to_string)
        .collect();
    let first = lines.first().cloned().unwrap_or_default();
    status
        .set_message(first)
        .set_type("scenario")
        .set_description(lines.join("\n"));
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
