//! What `sim merge` prints and writes.

use std::collections::BTreeMap;
use std::fmt;

use maud::html;
use quick_junit::{Property, Report, TestCase, TestCaseStatus, TestSuite};
use serde::Serialize;

use crate::args::MergeArgs;
use crate::exit::{Exit, Failure};
use crate::print::OutputFile;
use crate::run::case::Verdict;
use crate::run::{junit, page};
use crate::visible::{self, lines as readable};

use super::results::Line;

/// Verdicts that cases have, in the order in which they are counted.
pub(super) const VERDICTS: [Verdict; 4] = [
    Verdict::Passed,
    Verdict::Failed,
    Verdict::Skipped,
    Verdict::Error,
];
/// Most failures that are printed.
const MOST_PRINTED: usize = 20;

/// Everything that is shown of a campaign: as JSON as it is, and on the page, in JUnit and on the
/// terminal.
#[derive(Serialize)]
pub(super) struct Summary<'a> {
    pub(super) sim_merge: u32,
    pub(super) program: &'a str,
    pub(super) client: &'a [String],
    #[serde(skip)]
    pub(super) repeat: u32,
    pub(super) cases: usize,
    pub(super) missing: usize,
    pub(super) verdicts: Verdicts,
    pub(super) failures: Vec<Signature<'a>>,
    pub(super) not_repeatable: Vec<Different<'a>>,
    pub(super) files: Vec<FileSummary<'a>>,
}

/// Number of cases with each verdict.
pub(super) type Verdicts = BTreeMap<Verdict, usize>;

/// A failure, by how many cases have it.
#[derive(Serialize)]
pub(super) struct Signature<'a> {
    pub(super) verdict: Verdict,
    pub(super) signature: &'a str,
    pub(super) count: usize,
    pub(super) first: Vec<Example<'a>>,
}

/// A case that has a failure.
#[derive(Serialize)]
pub(super) struct Example<'a> {
    pub(super) name: String,
    pub(super) seed: u64,
    pub(super) reason: &'a str,
    pub(super) command: String,
}

/// A case whose results differ.
#[derive(Serialize)]
pub(super) struct Different<'a> {
    #[serde(skip)]
    pub(super) file: usize,
    pub(super) name: String,
    pub(super) command: String,
    pub(super) results: &'a [Line],
}

/// A file with one combination of its parameters.
#[derive(Serialize)]
pub(super) struct FileSummary<'a> {
    #[serde(skip)]
    pub(super) name: String,
    pub(super) file: &'a str,
    pub(super) parameters: BTreeMap<&'a str, &'a str>,
    pub(super) title: &'a str,
    #[serde(flatten)]
    pub(super) verdicts: Verdicts,
    #[serde(skip)]
    pub(super) failures: Vec<Signature<'a>>,
}

/// The text of a file that is to be written.
type Text = fn(&Summary<'_>) -> anyhow::Result<String>;

/// The files that are to be written.
pub(super) struct Outputs(Vec<(OutputFile, Text)>);

impl Outputs {
    /// Finds out whether they can be written.
    pub(super) fn find(args: &MergeArgs) -> Result<Self, Failure> {
        let all: [(_, _, Text); 3] = [
            (&args.junit, junit::MARKS, |summary| summary.junit()),
            (&args.report, page::MARKS, |summary| Ok(summary.page())),
            (&args.json, &["\"sim_merge\""], |summary| {
                Ok(serde_json::to_string_pretty(summary)? + "\n")
            }),
        ];
        let asked = all.into_iter().filter_map(|(path, marks, text)| {
            let file = OutputFile::find(path.as_ref()?, marks);
            Some(file.map(|file| (file, text)))
        });
        asked.collect::<Result<_, _>>().map(Self)
    }

    /// Writes them.
    pub(super) fn write(&self, summary: &Summary<'_>) -> Result<(), Failure> {
        let write = |(file, text): &(OutputFile, Text)| {
            file.write(&text(summary).map_err(Failure::system)?)
        };
        self.0.iter().try_for_each(write)
    }
}

impl Different<'_> {
    /// Each result in words.
    fn lines(&self) -> impl Iterator<Item = String> {
        self.results.iter().map(|line| {
            let reason = line.reason.as_deref().unwrap_or("nothing failed");
            let trace = line.trace.as_deref().unwrap_or("none");
            let (word, reason) = (line.verdict.word(), visible::line(reason));
            format!("{word}: {reason}; digest of the trace {trace}")
        })
    }
}

impl Summary<'_> {
    /// The exit code that the results stand for.
    pub(super) fn exit(&self) -> Exit {
        let verdicts = self.verdicts.iter().filter(|(_, count)| **count > 0);
        let exits = verdicts.map(|(verdict, _)| verdict.exit());
        let different = self.not_repeatable.iter().map(|_| Exit::Failed);
        exits.chain(different).max().unwrap_or(Exit::Clean)
    }

    /// Counts in words: `990 passed, 10 failed, 0 skipped`.
    fn counts(&self) -> String {
        let [passed, failed, skipped, errors] = VERDICTS.map(|verdict| self.verdicts[&verdict]);
        let mut text = format!("{passed} passed, {failed} failed, {skipped} skipped");
        for (count, word) in [
            (errors, "errors of the machine"),
            (self.not_repeatable.len(), "not repeatable"),
            (self.missing, "MISSING"),
        ] {
            if count > 0 {
                text += &format!(", {count} {word}");
            }
        }
        text
    }

    /// A test suite for each file, with a test case for what passed and one for each failure.
    fn junit(&self) -> anyhow::Result<String> {
        let mut report = Report::new("sim merge");
        for (number, file) in self.files.iter().enumerate() {
            let mut suite = TestSuite::new(junit::text(&file.name));
            for (verdict, count) in &file.verdicts {
                let name = format!("sim.{}", verdict.word());
                suite.add_property(Property::new(name, count.to_string()));
            }
            let mut add = |name: &str, status: TestCaseStatus| {
                let mut test = TestCase::new(junit::text(name), status);
                test.set_classname(format!("sim.{}", junit::text(file.file).replace('.', "_")));
                suite.add_test_case(test);
            };
            for failure in &file.failures {
                let message = format!("{} of {} times", failure.count, self.repeat);
                let again =
                    |case: &Example<'_>| format!("{}\nagain: {}", case.reason, case.command);
                let lines: Vec<String> = failure.first.iter().map(again).collect();
                let (verdict, word) = (failure.verdict, failure.verdict.word());
                add(
                    failure.signature,
                    junit::status(verdict, word, &message, &lines),
                );
            }
            for one in self.not_repeatable.iter().filter(|one| one.file == number) {
                let lines: Vec<String> = one.lines().collect();
                let kind = "not repeatable";
                add(
                    kind,
                    junit::status(Verdict::Failed, kind, &one.name, &lines),
                );
            }
            for verdict in [Verdict::Passed, Verdict::Skipped] {
                if file.verdicts[&verdict] > 0 {
                    add(file.title, junit::status(verdict, "", "", &[]));
                    break;
                }
            }
            report.add_test_suite(suite);
        }
        if self.missing > 0 {
            let mut suite = TestSuite::new("missing results");
            let message = format!("{} of {} cases have no result", self.missing, self.cases);
            let status = junit::status(Verdict::Error, "missing", &message, &[]);
            suite.add_test_case(TestCase::new("all cases have a result", status));
            report.add_test_suite(suite);
        }
        Ok(junit::without_skipped_total(&report.to_string()?))
    }

    fn page(&self) -> String {
        let client = match self.client {
            [] => "the scripted ones".to_owned(),
            words => words.join(" "),
        };
        let times = format!("{} files, {} times each", self.files.len(), self.repeat);
        let about = [
            ("Client", client),
            ("Cases", times),
            ("Program", format!("sim {}", self.program)),
        ];
        let failure = |failure: &Signature<'_>| {
            html! {
                tr class=(failure.verdict.word()) {
                    td { (page::badge(failure.verdict)) }
                    td.number { (failure.count) }
                    td {
                        (readable(failure.signature))
                        @for case in &failure.first {
                            details {
                                summary { (readable(&case.name)) }
                                p { (readable(case.reason)) }
                                pre { (readable(&case.command)) }
                            }
                        }
                    }
                }
            }
        };
        let body = html! {
            @if !self.not_repeatable.is_empty() {
                h2 { "Not repeatable" }
                @for one in &self.not_repeatable {
                    p { (readable(&one.name)) }
                    ul { @for result in one.lines() { li { (readable(&result)) } } }
                    pre { (readable(&one.command)) }
                }
            }
            table.cases {
                thead { tr { th { "verdict" } th.number { "cases" } th { "failure" } } }
                tbody { @for one in &self.failures { (failure(one)) } }
            }
            table.cases {
                thead { tr {
                    th { "file" }
                    @for verdict in VERDICTS { th.number { (verdict.word()) } }
                } }
                tbody {
                    @for file in &self.files {
                        tr {
                            td { (readable(file.title)) br; small { (readable(&file.name)) } }
                            @for count in file.verdicts.values() { td.number { (count) } }
                        }
                    }
                }
            }
        };
        page::document(&self.counts(), &about, &body).into_string()
    }
}

impl fmt::Display for Summary<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for failure in self.failures.iter().take(MOST_PRINTED) {
            let (heading, count) = (failure.verdict.heading(), failure.count);
            writeln!(
                f,
                "{heading:<7} {count}x  {}",
                visible::line(failure.signature)
            )?;
            if let Some(case) = failure.first.first() {
                writeln!(f, "  again: {}", case.command)?;
            }
        }
        if let Some(more) = self
            .failures
            .get(MOST_PRINTED..)
            .filter(|more| !more.is_empty())
        {
            writeln!(f, "and {} other failures", more.len())?;
        }
        for one in &self.not_repeatable {
            writeln!(f, "not repeatable: {}", one.name)?;
            for line in one.lines() {
                writeln!(f, "  {line}")?;
            }
            writeln!(f, "  again: {}", one.command)?;
        }
        f.write_str(&self.counts())
    }
}
