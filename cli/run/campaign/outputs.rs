//! What `sim merge` prints and writes.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use maud::html;
use quick_junit::{Property, Report, TestCase, TestSuite};
use serde::Serialize;

use crate::args::MergeArgs;
use crate::exit::{Exit, Failure};
use crate::print::OutputFile;
use crate::run::case::{Verdict, counts};
use crate::run::{junit, page};
use crate::visible::{self, lines as readable};

/// Verdicts that cases have, in the order in which they are counted.
pub(super) const VERDICTS: [Verdict; 4] = [
    Verdict::Passed,
    Verdict::Failed,
    Verdict::Skipped,
    Verdict::Error,
];
/// Most findings that are printed.
const MOST_PRINTED: usize = 20;

/// Everything that is shown of a campaign: as JSON as it is, and on the page, in JUnit and on the
/// terminal.
#[derive(Serialize)]
pub(super) struct Summary<'a> {
    pub(super) sim_merge: u32,
    pub(super) program: &'a str,
    pub(super) client: &'a [String],
    pub(super) repeat: u32,
    pub(super) cases: usize,
    pub(super) missing: usize,
    pub(super) not_repeatable: usize,
    pub(super) verdicts: Verdicts,
    pub(super) findings: Vec<Finding<'a>>,
    pub(super) files: Vec<FileSummary<'a>>,
}

/// Number of cases with each verdict.
pub(super) type Verdicts = BTreeMap<Verdict, usize>;

/// Something to look at: a failure that cases have, a case that is not repeatable, results that are
/// missing.
#[derive(Serialize)]
pub(super) struct Finding<'a> {
    #[serde(skip)]
    pub(super) verdict: Verdict,
    pub(super) kind: &'static str,
    pub(super) what: String,
    /// Number of cases.
    pub(super) count: usize,
    /// The first of them.
    pub(super) cases: Vec<Example<'a>>,
}

/// A case that is shown.
#[derive(Serialize)]
pub(super) struct Example<'a> {
    pub(super) name: String,
    pub(super) reason: &'a str,
    pub(super) command: String,
}

/// A file with one combination of its parameters.
#[derive(Serialize)]
pub(super) struct FileSummary<'a> {
    pub(super) name: &'a str,
    pub(super) title: &'a str,
    #[serde(flatten)]
    pub(super) verdicts: Verdicts,
}

impl Finding<'_> {
    /// The cases in lines, and the command that plays the first again.
    fn lines(&self) -> Vec<String> {
        let cases = self.cases.iter();
        let reasons = cases.map(|case| format!("{}: {}", case.name, visible::line(case.reason)));
        let first = self.cases.first();
        reasons
            .chain(first.map(|case| format!("again: {}", case.command)))
            .collect()
    }
}

impl Summary<'_> {
    /// Writes the files that are asked for.
    pub(super) fn write(&self, args: &MergeArgs) -> Result<(), Failure> {
        let write = |path: &Option<PathBuf>, marks, text: &dyn Fn() -> anyhow::Result<String>| {
            let Some(path) = path else { return Ok(()) };
            OutputFile::find(path, marks)?.write(&text().map_err(Failure::system)?)
        };
        write(&args.junit, junit::MARKS, &|| self.junit())?;
        write(&args.report, page::MARKS, &|| Ok(self.page()))?;
        write(&args.json, &["\"sim_merge\""], &|| {
            Ok(serde_json::to_string_pretty(self)? + "\n")
        })
    }

    /// The exit code that the results stand for.
    pub(super) fn exit(&self) -> Exit {
        let findings = self.findings.iter();
        let worst = findings.map(|finding| finding.verdict.exit()).max();
        worst.unwrap_or(Exit::Clean)
    }

    /// Counts in words: `990 passed, 10 failed, 0 skipped`.
    fn counts(&self) -> String {
        let mut text = counts(&self.verdicts);
        for (count, word) in [
            (self.not_repeatable, "not repeatable"),
            (self.missing, "MISSING"),
        ] {
            if count > 0 {
                text += &format!(", {count} {word}");
            }
        }
        text
    }

    /// A test case for each finding, and one for each file of which cases passed.
    fn junit(&self) -> anyhow::Result<String> {
        let mut suite = TestSuite::new("sim merge");
        for (verdict, count) in &self.verdicts {
            let name = format!("sim.{}", verdict.word());
            suite.add_property(Property::new(name, count.to_string()));
        }
        for finding in &self.findings {
            let message = format!("{} of {} cases", finding.count, self.cases);
            let (verdict, lines) = (finding.verdict, finding.lines());
            let status = junit::status(verdict, finding.kind, &message, &lines);
            let mut test = TestCase::new(junit::text(&finding.what), status);
            test.set_classname(format!("sim.{}", finding.kind));
            suite.add_test_case(test);
        }
        for file in &self.files {
            let verdicts = [Verdict::Passed, Verdict::Skipped].into_iter();
            if let Some(verdict) = verdicts.into_iter().find(|one| file.verdicts[one] > 0) {
                let status = junit::status(verdict, "", "", &[]);
                let mut test = TestCase::new(junit::text(file.title), status);
                test.set_classname(format!("sim.{}", junit::text(file.name).replace('.', "_")));
                suite.add_test_case(test);
            }
        }
        let mut report = Report::new("sim merge");
        report.add_test_suite(suite);
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
        let body = html! {
            table.cases {
                thead { tr { th { "verdict" } th.number { "cases" } th { "failure" } } }
                tbody {
                    @for finding in &self.findings {
                        tr class=(finding.verdict.word()) {
                            td { span class=(format!("badge {}", finding.verdict.word())) { (finding.kind) } }
                            td.number { (finding.count) }
                            td {
                                (readable(&finding.what))
                                @for case in &finding.cases {
                                    details {
                                        summary { (readable(&case.name)) }
                                        p { (readable(case.reason)) }
                                        pre { (readable(&case.command)) }
                                    }
                                }
                            }
                        }
                    }
                }
            }
            table.cases {
                thead { tr {
                    th { "file" }
                    @for verdict in VERDICTS { th.number { (verdict.word()) } }
                } }
                tbody {
                    @for file in &self.files {
                        tr {
                            td { (readable(file.title)) br; small { (readable(file.name)) } }
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
        for finding in self.findings.iter().take(MOST_PRINTED) {
            let (kind, what) = (finding.kind.to_uppercase(), visible::line(&finding.what));
            writeln!(f, "{kind:<7} {}x  {what}", finding.count)?;
            for line in finding.lines() {
                writeln!(f, "  {line}")?;
            }
        }
        if let Some(more @ 1..) = self.findings.len().checked_sub(MOST_PRINTED) {
            writeln!(f, "and {more} more")?;
        }
        f.write_str(&self.counts())
    }
}
