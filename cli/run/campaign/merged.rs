//! Results of all shards, put together.

use std::collections::BTreeMap;
use std::fs::File;
use std::io::BufReader;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, bail, ensure};
use flate2::bufread::MultiGzDecoder;
use indexmap::IndexMap;

use crate::json_lines::Lines;
use crate::run::case::Verdict;
use crate::visible;

use super::plan::Plan;
use super::results::{Header, Line, TRACES};

/// Most cases of a campaign.
const MOST_CASES: usize = 10_000_000;
/// Most reasons of a refusal that are listed.
const MOST_REFUSED: usize = 20;

/// Everything that is known of a campaign.
#[derive(Default)]
pub(super) struct Merged {
    pub(super) plan: Plan,
    /// File that the plan is from; empty if there was none.
    pub(super) first: String,
    /// By their numbers.
    pub(super) cases: Vec<Option<Known>>,
    /// Kinds of results: a verdict, and what failed.
    pub(super) kinds: IndexMap<(Verdict, String), Group>,
    /// Why this is not a whole campaign.
    pub(super) refused: Vec<String>,
    /// Files that end too early; they matter if results are missing.
    pub(super) torn: Vec<String>,
}

/// Result of a case.
#[derive(Clone, Copy)]
pub(super) struct Known {
    pub(super) verdict: Verdict,
    /// Number of its kind.
    kind: usize,
    /// The first half of the digest of its trace. What is the same to the byte has the same.
    trace: u64,
}

/// Cases whose results are of one kind.
#[derive(Default)]
pub(super) struct Group {
    pub(super) count: usize,
    /// The first of them, and the reason of each. They are more than are shown, since a case may come to
    /// be of another kind.
    pub(super) first: BTreeMap<usize, String>,
}

impl Merged {
    /// Reads all files; of those of other shards than `ours` only the plan, which has to be ours.
    pub(super) fn read(paths: &[PathBuf], ours: Option<(&Plan, u64)>) -> Self {
        let mut merged = Self::default();
        if let Some((plan, _)) = ours {
            merged.begin(plan.clone(), "this run");
        }
        for path in paths {
            let shown = visible::name(path);
            if let Err(error) = merged.file(path, &shown, ours.map(|(_, shard)| shard)) {
                merged.refuse(format!("{shown}: {error:#}"));
            }
        }
        merged
    }

    fn begin(&mut self, plan: Plan, first: &str) {
        self.cases = vec![None; plan.cases()];
        (self.plan, self.first) = (plan, first.to_owned());
    }

    fn refuse(&mut self, why: String) {
        if self.refused.len() < MOST_REFUSED {
            self.refused.push(why);
        }
    }

    fn file(&mut self, path: &Path, shown: &str, only: Option<u64>) -> anyhow::Result<()> {
        let file = File::open(path).context("cannot read it")?;
        let text = MultiGzDecoder::new(BufReader::new(file));
        let mut lines = Lines::new(BufReader::new(text));
        if let Some(Header { shard, plan }) = lines.next().context("no header")? {
            if self.first.is_empty() {
                ensure!(plan.cases() <= MOST_CASES, "more than {MOST_CASES} cases");
                self.begin(plan, shown);
            } else if let Some(what) = self.plan.difference(&plan) {
                let first = &self.first;
                bail!("it is of another plan than {first}. They differ in {what}");
            }
            while only.is_none_or(|only| only == shard)
                && let Some(line) = lines.next().context("a malformed line")?
            {
                self.take(shown, shard, line);
            }
        }
        if lines.is_torn {
            self.torn.push(format!(
                "{shown} has no end: the process that writes it still runs, or was killed"
            ));
        }
        Ok(())
    }

    /// Names what has no result. Returns whether there is such.
    pub(super) fn name_missing(&mut self) -> bool {
        let missing = (0..self.cases.len()).filter(|number| self.cases[*number].is_none());
        let missing: Vec<usize> = missing.collect();
        for number in &missing {
            let (shard, _) = self.plan.key(*number).unwrap_or_default();
            let what = format!("results of shard {shard}/{}", self.plan.shards);
            let kind = (Verdict::Missing, what);
            self.put(*number, kind, "there is no result".to_owned(), 0);
        }
        !missing.is_empty()
    }

    /// Takes a result. Whatever comes first, an error of the machine gives way to a verdict, and two
    /// verdicts that differ become one.
    fn take(&mut self, path: &str, shard: u64, line: Line) {
        let number = line.case;
        if self.plan.key(number) != Some((shard, line.seed)) {
            let (name, seed) = (visible::line(&line.name), line.seed);
            let why = format!("{path}: {name}, seed {seed}, is not a case of shard {shard}");
            return self.refuse(why);
        }
        let digits = line.trace.as_deref().and_then(|trace| trace.get(..16));
        let trace = digits.and_then(|digits| u64::from_str_radix(digits, 16).ok());
        let trace = trace.unwrap_or_default();
        let mut kind = (line.verdict, line.signature.unwrap_or_default());
        let mut reason = line.reason.unwrap_or_default();
        if let Some(other) = self.cases[number]
            && let Some((before, _)) = self.kinds.get_index(other.kind)
        {
            let is_same = kind == *before && trace == other.trace;
            let [was_error, is_error] = [before.0, kind.0].map(|one| one == Verdict::Error);
            if is_error || !was_error && (is_same || before.0 == Verdict::NotRepeatable) {
                return;
            }
            if !was_error {
                let words = |(verdict, what): &(Verdict, String)| {
                    format!("{} {what}", verdict.as_str()).trim_end().to_owned()
                };
                let mut both = [(words(before), other.trace), (words(&kind), trace)];
                both.sort();
                let [(one, trace), (two, other_trace)] = both;
                kind = (Verdict::NotRepeatable, format!("{one} / {two}"));
                reason = format!("traces {trace:016x} / {other_trace:016x}");
            }
        }
        self.put(number, kind, reason, trace);
    }

    /// Puts a result in the place of what is known of a case.
    fn put(&mut self, number: usize, kind: (Verdict, String), reason: String, trace: u64) {
        let verdict = kind.0;
        let entry = self.kinds.entry(kind);
        let kind = entry.index();
        let group = entry.or_default();
        group.count += 1;
        group.first.insert(number, reason);
        if group.first.len() > 2 * TRACES {
            group.first.pop_last();
        }
        let known = Known {
            verdict,
            kind,
            trace,
        };
        if let Some(before) = self.cases[number].replace(known) {
            let group = &mut self.kinds[before.kind];
            group.count -= 1;
            group.first.remove(&number);
        }
    }

    /// Returns the verdicts of all cases that have one, each with what failed.
    pub(super) fn verdicts(&self) -> Vec<Option<(Verdict, String)>> {
        let verdict = |known: &Option<Known>| {
            let ((verdict, what), _) = self.kinds.get_index(known.as_ref()?.kind)?;
            (*verdict < Verdict::Error).then(|| (*verdict, what.clone()))
        };
        self.cases.iter().map(verdict).collect()
    }
}
