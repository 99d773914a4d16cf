//! Results of all shards, put together.

use std::collections::BTreeMap;
use std::hash::Hasher as _;
use std::ops::Range;
use std::path::{Path, PathBuf};

use indexmap::IndexMap;
use siphasher::sip::SipHasher13;

use crate::run::case::Verdict;
use crate::visible;

use super::outputs::{Different, Example, FileSummary, Signature, Summary, VERDICTS, Verdicts};
use super::plan::Plan;
use super::results::{Line, Part, TRACES, Tail, read};

/// Most entries of a list that is printed.
const MOST_LISTED: usize = 20;
/// Most cases that were different when they were played again, of which both results are shown.
const MOST_DIFFERENT: usize = 100;

/// Everything that is known of a campaign.
pub(super) struct Merged {
    plan: Plan,
    /// File that the plan is from.
    first: String,
    /// By the place of the case.
    cases: Vec<Option<Known>>,
    /// The first cases of each failure, with the reason of each.
    failures: IndexMap<(Verdict, String), BTreeMap<usize, String>>,
    /// Places of cases whose results differed, with both results.
    different: BTreeMap<usize, Vec<Line>>,
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
}

impl Merged {
    /// Reads all files; `None` if there is no plan in them.
    pub(super) fn read(paths: &[PathBuf]) -> Option<Self> {
        let mut merged: Option<Self> = None;
        let (mut refused, mut torn) = (Vec::new(), Vec::new());
        for path in paths {
            let shown = visible::name(path);
            let mut shard = 0;
            let tail = read(path, |part| {
                match (part, &mut merged) {
                    (Part::Header(header), Some(merged)) => {
                        shard = header.shard;
                        return Ok(merged.has_plan(&shown, &header.plan));
                    }
                    (Part::Header(header), none) => {
                        shard = header.shard;
                        *none = Some(Self::new(&shown, header.plan));
                    }
                    (Part::Line(line), Some(merged)) => merged.take(&shown, shard, line),
                    (Part::Line(_), None) => {}
                }
                Ok(true)
            });
            match tail {
                Ok(Tail::Whole) => {}
                Ok(Tail::Torn) => torn.push(format!(
                    "{shown} is torn: the process that wrote it was killed"
                )),
                Err(error) => refused.push(format!("{error:#}")),
            }
        }
        let mut merged = merged?;
        merged.refused.extend(refused);
        merged.torn = torn;
        if !merged.different.is_empty() {
            paths.iter().for_each(|path| merged.reread_different(path));
        }
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
        let mut hasher = SipHasher13::new();
        hasher.write(line.repeatable().as_bytes());
        let digest = hasher.finish();
        if let Some(known) = self.cases[place] {
            let both = known.verdict < Verdict::Error && line.is_verdict();
            if both && known.digest != digest && self.different.len() < MOST_DIFFERENT {
                self.different.entry(place).or_default();
            }
            // An error of the machine gives way to a verdict, a verdict to a worse one.
            let is_better = match both {
                true => line.verdict > known.verdict,
                false => line.is_verdict(),
            };
            if !is_better {
                return;
            }
        }
        let failed = matches!(line.verdict, Verdict::Failed | Verdict::Error);
        let failure = line.signature.filter(|_| failed).and_then(|signature| {
            let entry = self.failures.entry((line.verdict, signature));
            let index = entry.index();
            let first = entry.or_default();
            first.insert(place, line.reason.unwrap_or_default());
            // One more than is shown, since another result may take the place of one.
            if first.len() > 2 * TRACES {
                first.pop_last();
            }
            u32::try_from(index).ok()
        });
        self.cases[place] = Some(Known {
            verdict: line.verdict,
            failure,
            digest,
        });
    }

    /// Reads both results of what differed.
    fn reread_different(&mut self, path: &Path) {
        let take = |part| {
            if let Part::Line(line) = part
                && let Some(place) = self.plan.place(line.file, line.repeat)
                && let Some(lines) = self.different.get_mut(&place)
                && lines
                    .iter()
                    .all(|known: &Line| known.repeatable() != line.repeatable())
            {
                lines.push(line);
            }
            Ok(true)
        };
        // What cannot be read has been refused already.
        let _ = read(path, take);
    }

    /// Places of cases without a result.
    pub(super) fn missing(&self) -> Vec<usize> {
        let cases = self.cases.iter().enumerate();
        let missing = cases.filter(|(_, known)| known.is_none());
        missing.map(|(place, _)| place).collect()
    }

    /// The missing cases, a line for each shard.
    pub(super) fn missing_by_shard(&self, missing: &[usize]) -> Vec<String> {
        let mut shards: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for place in missing {
            let owner = self.plan.owner(*place);
            shards.entry(owner).or_default().push(*place);
        }
        let line = |(shard, places): (&u32, &Vec<usize>)| {
            let names = places.iter().take(3).map(|place| self.plan.name(*place));
            let names: Vec<String> = names.collect();
            let more = if places.len() > names.len() {
                ", …"
            } else {
                ""
            };
            let count = match places.len() {
                1 => "1 case is".to_owned(),
                count => format!("{count} cases are"),
            };
            let (of, names) = (self.plan.shards, names.join(", "));
            format!("shard {shard}/{of}: {count} missing: {names}{more}")
        };
        let mut lines: Vec<String> = shards.iter().take(MOST_LISTED).map(line).collect();
        if let Some(more) = shards.len().checked_sub(MOST_LISTED + 1) {
            lines.push(format!("and cases of {} more shards", more + 1));
        }
        lines
    }

    /// Everything that is shown, where so many cases are missing.
    pub(super) fn summary(&self, missing: usize) -> Summary<'_> {
        let plan = &self.plan;
        let repeat = plan.repeat as usize;
        let different = self.different.iter().map(|(place, results)| Different {
            file: place / repeat,
            name: plan.name(*place),
            command: plan.command(*place),
            results,
        });
        let files = plan.files.iter().enumerate().map(|(number, file)| {
            let (verdicts, failures) = self.tally(number * repeat..(number + 1) * repeat);
            let parameters = file.parameters.iter();
            FileSummary {
                name: file.name(),
                file: &file.file,
                parameters: parameters
                    .map(|(name, value)| (&**name, &**value))
                    .collect(),
                title: &file.title,
                verdicts,
                failures,
            }
        });
        let (verdicts, failures) = self.tally(0..self.cases.len());
        Summary {
            sim_merge: 1,
            program: &plan.program,
            client: &plan.client,
            repeat: plan.repeat,
            cases: plan.cases(),
            missing,
            verdicts,
            failures,
            not_repeatable: different.collect(),
            files: files.collect(),
        }
    }

    /// Counts the cases at these places, and their failures, the most frequent first.
    fn tally(&self, places: Range<usize>) -> (Verdicts, Vec<Signature<'_>>) {
        let mut verdicts = BTreeMap::from(VERDICTS.map(|verdict| (verdict, 0)));
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for known in self.cases[places.clone()].iter().flatten() {
            if let Some(count) = verdicts.get_mut(&known.verdict) {
                *count += 1;
            }
            if let Some(failure) = known.failure {
                *counts.entry(failure).or_default() += 1;
            }
        }
        let failure = |(number, count): (u32, usize)| {
            let ((verdict, signature), first) = self.failures.get_index(number as usize)?;
            let has = |place: &usize| {
                self.cases[*place].is_some_and(|known| known.failure == Some(number))
            };
            let first = first.range(places.clone()).filter(|(place, _)| has(place));
            let first = first.take(TRACES).map(|(place, reason)| Example {
                name: self.plan.name(*place),
                seed: self.plan.at(*place).1,
                reason,
                command: self.plan.command(*place),
            });
            Some(Signature {
                verdict: *verdict,
                signature,
                count,
                first: first.collect(),
            })
        };
        let mut failures: Vec<_> = counts.into_iter().filter_map(failure).collect();
        failures.sort_by(|one, other| {
            let by_count = other.count.cmp(&one.count);
            by_count.then_with(|| one.signature.cmp(other.signature))
        });
        (verdicts, failures)
    }
}
