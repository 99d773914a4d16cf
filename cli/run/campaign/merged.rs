//! Results of all shards, put together.

use std::collections::BTreeMap;
use std::hash::Hasher as _;
use std::path::PathBuf;

use indexmap::IndexMap;
use siphasher::sip::SipHasher13;

use crate::run::case::Verdict;
use crate::visible;

use super::outputs::{Example, FileSummary, Finding, Summary, VERDICTS, Verdicts};
use super::plan::Plan;
use super::results::{Line, Part, TRACES, Tail, read};

/// Most entries of a list that is printed.
const MOST_LISTED: usize = 20;
/// Most cases that were different when they were played again, of which both results are shown.
const MOST_DIFFERENT: usize = 100;
/// Digits of a digest that are shown.
const DIGITS: usize = 16;

/// Everything that is known of a campaign.
pub(super) struct Merged {
    pub(super) plan: Plan,
    /// File that the plan is from.
    first: String,
    /// By the place of the case.
    cases: Vec<Option<Known>>,
    /// The first cases of each failure, with the reason of each.
    failures: IndexMap<(Verdict, String), BTreeMap<usize, String>>,
    /// By the places of cases whose results differed, both of them.
    different: BTreeMap<usize, [String; 2]>,
    /// Why this is no whole campaign.
    pub(super) refused: Vec<String>,
    /// Files that end too early; they matter if results are missing.
    pub(super) torn: Vec<String>,
}

/// Result of a case.
#[derive(Clone, Copy)]
struct Known {
    verdict: Verdict,
    /// Number of its failure, of one that has a reason.
    failure: Option<u32>,
    /// Of all that is the same each time.
    digest: u64,
    /// The first digits of the digest of its trace.
    trace: [u8; DIGITS],
}

impl Merged {
    /// Reads all files, or of those of other shards than `only` the plan; `None` if there is no plan in
    /// them.
    pub(super) fn read(paths: &[PathBuf], only: Option<u32>) -> Option<Self> {
        let mut merged: Option<Self> = None;
        let (mut refused, mut torn) = (Vec::new(), Vec::new());
        for path in paths {
            let shown = visible::name(path);
            let mut shard = 0;
            let tail = read(path, |part| {
                let (header, merged) = match (part, &mut merged) {
                    (Part::Line(line), Some(merged)) => {
                        merged.take(&shown, shard, line);
                        return Ok(true);
                    }
                    (Part::Line(_), None) => return Ok(true),
                    (Part::Header(header), merged) => (header, merged),
                };
                shard = header.shard;
                let merged = merged.get_or_insert_with(|| Self::new(&shown, header.plan.clone()));
                let is_wanted = only.is_none_or(|only| only == shard);
                Ok(merged.has_plan(&shown, &header.plan) && is_wanted)
            });
            match tail {
                Ok(Tail::Whole) => {}
                Ok(Tail::Torn) => torn.push(format!(
                    "{shown} has no end: the process that writes it still runs, or was killed"
                )),
                Err(error) => refused.push(format!("{error:#}")),
            }
        }
        let mut merged = merged?;
        merged.refused.extend(refused);
        merged.torn = torn;
        Some(merged)
    }

    fn new(path: &str, plan: Plan) -> Self {
        Self {
            first: path.to_owned(),
            cases: vec![None; plan.cases()],
            failures: IndexMap::new(),
            different: BTreeMap::new(),
            refused: Vec::new(),
            torn: Vec::new(),
            plan,
        }
    }

    /// Returns whether the plan of a file is that of the others.
    fn has_plan(&mut self, path: &str, plan: &Plan) -> bool {
        let difference = self.plan.difference(plan);
        if let Some(what) = &difference {
            let first = &self.first;
            self.refused.push(format!(
                "{path} is of another plan than {first}. They differ in {what}"
            ));
        }
        difference.is_none()
    }

    fn take(&mut self, path: &str, shard: u32, line: Line) {
        let place = self.plan.place(line.file, line.repeat);
        let is_planned =
            |place: &usize| self.plan.at(*place).1 == line.seed && self.plan.owner(*place) == shard;
        let Some(place) = place.filter(is_planned) else {
            if self.refused.len() < MOST_LISTED {
                let name = visible::line(&line.name);
                self.refused.push(format!(
                    "{path}: {name}, seed {}, is no case of shard {shard}",
                    line.seed
                ));
            }
            return;
        };
        let known = self.known(place, line);
        if let Some(other) = self.cases[place] {
            let both = other.verdict < Verdict::Error && known.verdict < Verdict::Error;
            if both && other.digest != known.digest && self.different.len() < MOST_DIFFERENT {
                let shown = [other, known].map(|one| self.shown(one));
                self.different.insert(place, shown);
            }
            // An error of the machine gives way to a verdict, a verdict to a worse one.
            let is_better = match both {
                true => known.verdict > other.verdict,
                false => known.verdict < Verdict::Error,
            };
            if !is_better {
                return;
            }
        }
        self.cases[place] = Some(known);
    }

    /// Returns the verdicts of all cases that have one.
    pub(super) fn verdicts(&self) -> Vec<Option<Verdict>> {
        let verdicts = self.cases.iter().map(|known| Some(known.as_ref()?.verdict));
        let is_verdict = |verdict: &Verdict| *verdict < Verdict::Error;
        verdicts.map(|verdict| verdict.filter(is_verdict)).collect()
    }

    /// What is kept of a line.
    fn known(&mut self, place: usize, line: Line) -> Known {
        let mut hasher = SipHasher13::new();
        hasher.write(line.repeatable().as_bytes());
        let mut trace = [b'-'; DIGITS];
        let digits = line.trace.iter().flat_map(|trace| trace.bytes());
        trace
            .iter_mut()
            .zip(digits)
            .for_each(|(to, digit)| *to = digit);
        let failed = matches!(line.verdict, Verdict::Failed | Verdict::Error);
        let failure = line.signature.filter(|_| failed).and_then(|signature| {
            let entry = self.failures.entry((line.verdict, signature));
            let index = entry.index();
            let first = entry.or_default();
            first.insert(place, line.reason.unwrap_or_default());
            // More than are shown, since another result may take the place of one.
            if first.len() > 2 * TRACES {
                first.pop_last();
            }
            u32::try_from(index).ok()
        });
        Known {
            verdict: line.verdict,
            failure,
            digest: hasher.finish(),
            trace,
        }
    }

    /// A result in words.
    fn shown(&self, known: Known) -> String {
        let failure = known
            .failure
            .and_then(|number| self.failures.get_index(number as usize));
        let failure = failure.map_or("nothing failed", |((_, signature), _)| signature);
        let (word, trace) = (known.verdict.word(), String::from_utf8_lossy(&known.trace));
        format!("{word}: {failure}; digest of the trace {trace}…")
    }

    /// The missing cases, by shard; adds how many there are to `count`.
    fn missing(&self, count: &mut usize) -> Vec<Finding<'_>> {
        let mut shards: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for (place, _) in self
            .cases
            .iter()
            .enumerate()
            .filter(|(_, known)| known.is_none())
        {
            *count += 1;
            shards
                .entry(self.plan.owner(place))
                .or_default()
                .push(place);
        }
        let (of, all) = (self.plan.shards, shards.len());
        let shard = |(shard, places): (u32, Vec<usize>)| {
            let names = places.iter().take(3).map(|place| self.plan.case(*place).0);
            let names = names.collect::<Vec<_>>().join(", ");
            let what = format!("shard {shard}/{of}: {} missing, as {names}", places.len());
            finding("missing", Verdict::Error, what, places.len())
        };
        let mut findings: Vec<_> = shards.into_iter().take(MOST_LISTED).map(shard).collect();
        if let Some(more @ 1..) = all.checked_sub(MOST_LISTED) {
            let what = format!("cases of {more} more shards");
            findings.push(finding("missing", Verdict::Error, what, *count));
        }
        findings
    }

    /// Everything that is shown.
    pub(super) fn summary(&self) -> Summary<'_> {
        let plan = &self.plan;
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for failure in self
            .cases
            .iter()
            .flatten()
            .filter_map(|known| known.failure)
        {
            *counts.entry(failure).or_default() += 1;
        }
        let failures = counts.into_iter();
        let mut findings: Vec<Finding<'_>> = failures
            .filter_map(|(number, count)| self.failure(number, count))
            .collect();
        findings.sort_by(|one, other| {
            let by_count = other.count.cmp(&one.count);
            by_count.then_with(|| one.what.cmp(&other.what))
        });
        findings.extend(self.different.iter().map(|(place, results)| {
            Finding {
                cases: results
                    .iter()
                    .map(|reason| self.example(*place, reason))
                    .collect(),
                ..finding("not repeatable", Verdict::Failed, plan.case(*place).0, 1)
            }
        }));
        let mut missing = 0;
        findings.extend(self.missing(&mut missing));
        let files = plan
            .files
            .iter()
            .zip(self.cases.chunks(plan.repeat.max(1) as usize));
        let files = files.map(|(file, cases)| FileSummary {
            name: &file.name,
            title: &file.title,
            verdicts: tally(cases),
        });
        Summary {
            sim_merge: 1,
            program: &plan.program,
            client: &plan.client,
            repeat: plan.repeat,
            cases: plan.cases(),
            missing,
            not_repeatable: self.different.len(),
            verdicts: tally(&self.cases),
            findings,
            files: files.collect(),
        }
    }

    /// A failure that so many cases have.
    fn failure(&self, number: u32, count: usize) -> Option<Finding<'_>> {
        let ((verdict, signature), first) = self.failures.get_index(number as usize)?;
        let has =
            |place: &usize| self.cases[*place].is_some_and(|known| known.failure == Some(number));
        let first = first.iter().filter(|(place, _)| has(place)).take(TRACES);
        Some(Finding {
            cases: first
                .map(|(place, reason)| self.example(*place, reason))
                .collect(),
            ..finding(verdict.word(), *verdict, signature.clone(), count)
        })
    }

    fn example<'a>(&self, place: usize, reason: &'a str) -> Example<'a> {
        let (name, command) = self.plan.case(place);
        Example {
            name,
            reason,
            command,
        }
    }
}

fn finding(kind: &'static str, verdict: Verdict, what: String, count: usize) -> Finding<'static> {
    Finding {
        verdict,
        kind,
        what,
        count,
        cases: Vec::new(),
    }
}

/// Counts cases by verdict.
fn tally(cases: &[Option<Known>]) -> Verdicts {
    let mut verdicts = BTreeMap::from(VERDICTS.map(|verdict| (verdict, 0)));
    for known in cases.iter().flatten() {
        *verdicts.entry(known.verdict).or_default() += 1;
    }
    verdicts
}
