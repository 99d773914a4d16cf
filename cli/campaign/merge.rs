//! The `merge` subcommand: results of all shards, put together.

use std::collections::BTreeMap;
use std::hash::Hasher as _;
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use clap::Args;
use siphasher::sip::SipHasher13;

use crate::exit::{Exit, Failure};
use crate::print::{complain, print};
use crate::run::Verdict;
use crate::visible;

use super::plan::Plan;
use super::results::{Line, Part, TRACES, Tail, files, read};
use super::summary;

/// Most entries of a list that is printed.
const MOST_LISTED: usize = 20;
/// Most cases that were different when they were played again, of which both results are shown.
const MOST_DIFFERENT: usize = 100;

const EXAMPLES: &str = "\
Examples:
  sim run --repeat 1000 --shard auto --results out scenarios -- python3 my_client.py
      On each machine; the folder is shared, or is collected afterwards.
  sim merge out --junit all.xml --report all.html
      Afterwards, anywhere. A result that is missing is an error: exit code 3.
  sim merge out --partial --report so-far.html
      While shards are still playing.";

/// What to put together, and where to write it.
#[derive(Debug, Args)]
#[command(after_help = format!("{EXAMPLES}\n\n{}", Exit::HELP))]
pub(crate) struct MergeArgs {
    /// Folders of `sim run --results`.
    #[arg(required = true, value_name = "DIR")]
    pub(crate) folders: Vec<PathBuf>,
    /// Write JUnit XML, with a test case for each failure of a file that differs, and not for each seed.
    #[arg(long, value_name = "PATH")]
    pub(crate) junit: Option<PathBuf>,
    /// Write an HTML page: failures by how often they came, and the command that shows each again.
    #[arg(long, value_name = "PATH")]
    pub(crate) report: Option<PathBuf>,
    /// Write the same as JSON.
    #[arg(long, value_name = "PATH")]
    pub(crate) json: Option<PathBuf>,
    /// Write the files although results are missing; each says what is missing.
    #[arg(long)]
    pub(crate) partial: bool,
}

/// Everything that is known of a campaign.
pub(crate) struct Merged {
    pub(crate) plan: Plan,
    /// By the place of the case.
    pub(crate) cases: Vec<Option<Known>>,
    pub(crate) failures: Vec<Failed>,
    /// Places of cases whose results differed, with both results.
    pub(crate) different: BTreeMap<usize, Vec<Line>>,
}

/// Result of a case.
#[derive(Clone, Copy)]
pub(crate) struct Known {
    pub(crate) verdict: Verdict,
    /// Number of its failure, of one that has a reason.
    failure: u32,
    /// Of all that is the same each time.
    digest: u64,
}

/// A failure that any number of cases have.
pub(crate) struct Failed {
    pub(crate) verdict: Verdict,
    pub(crate) signature: String,
    /// The first cases that have it, with the reason of each.
    pub(crate) first: BTreeMap<usize, String>,
}

const NO_FAILURE: u32 = u32::MAX;

/// The `merge` subcommand.
pub(crate) fn merge(args: &MergeArgs) -> Result<Exit, Failure> {
    let outputs = summary::Outputs::find(args)?;
    let mut paths = Vec::new();
    for folder in &args.folders {
        let inside = files(folder)
            .with_context(|| format!("cannot read the folder {}", visible::name(folder)))
            .map_err(Failure::usage)?;
        paths.extend(inside);
    }
    let mut merging = Merging::default();
    for path in &paths {
        merging.read(path)?;
    }
    let Some(mut merged) = merging.merged.take() else {
        return Err(Failure::system(anyhow!(
            "there are no results in {}",
            args.folders
                .iter()
                .map(visible::name)
                .collect::<Vec<_>>()
                .join(" and ")
        )));
    };
    merged.reread_different(&paths)?;
    let missing = merged.missing();
    let is_whole = missing.is_empty() && merging.refused.is_empty();
    if missing.is_empty() {
        merging.torn.clear();
    }
    for line in merging.refused.iter().chain(&merging.torn) {
        complain(line);
    }
    for line in merged.missing_by_shard(&missing) {
        complain(&line);
    }
    let only_missing = merging.refused.is_empty();
    if !(is_whole || args.partial && only_missing) {
        let hint = match only_missing {
            true => {
                "; play the missing ones with the same command, or see what is known with --partial"
            }
            false => "",
        };
        return Err(Failure::system(anyhow!("the results are not whole{hint}")));
    }
    let exit = outputs.write(&merged, missing.len())?;
    print(&summary::text(&merged, missing.len()))?;
    Ok(if is_whole { exit } else { Exit::System })
}

/// Results that are being put together.
#[derive(Default)]
struct Merging {
    merged: Option<Merged>,
    /// File that the plan is from.
    first: String,
    by_signature: BTreeMap<(Verdict, String), u32>,
    /// Why this is no whole campaign.
    refused: Vec<String>,
    /// Files that end too early; they matter if results are missing.
    torn: Vec<String>,
}

impl Merging {
    /// Takes what one file has.
    fn read(&mut self, path: &Path) -> Result<(), Failure> {
        let shown = visible::name(path);
        let mut shard = None;
        let tail = read(path, |part| {
            match part {
                Part::Header(header) => {
                    shard = Some(header.shard);
                    return Ok(self.begin(&shown, header.plan));
                }
                Part::Line(line) => self.take(&shown, shard.unwrap_or_default(), line),
            }
            Ok(true)
        });
        match tail {
            Ok(Tail::Whole) => {}
            Ok(Tail::Torn) => self.torn.push(format!(
                "{shown} is torn: the process that wrote it was killed"
            )),
            Err(error) => self.refused.push(format!("{error:#}")),
        }
        Ok(())
    }

    /// Returns whether the plan of a file is that of the others.
    fn begin(&mut self, path: &str, plan: Plan) -> bool {
        let Some(merged) = &self.merged else {
            path.clone_into(&mut self.first);
            self.merged = Some(Merged {
                cases: vec![None; plan.cases()],
                failures: Vec::new(),
                different: BTreeMap::new(),
                plan,
            });
            return true;
        };
        let difference = merged.plan.difference(&plan);
        if let Some(what) = &difference {
            let first = &self.first;
            self.refused.push(format!(
                "{path} is of another plan than {first}. They differ in {what}"
            ));
        }
        difference.is_none()
    }

    fn take(&mut self, path: &str, shard: u32, line: Line) {
        let Some(merged) = &mut self.merged else {
            return;
        };
        let place = merged.plan.place(line.file, line.repeat);
        let is_planned = |place: &usize| {
            merged.plan.at(*place).1 == line.seed && merged.plan.owner(*place) == shard
        };
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
        if let Some(known) = merged.cases[place] {
            let is_verdict = known.verdict < Verdict::Error;
            if is_verdict
                && line.is_verdict()
                && known.digest != digest
                && merged.different.len() < MOST_DIFFERENT
            {
                merged.different.entry(place).or_default();
            }
            // An error of the machine gives way to a verdict, a verdict to a worse one.
            let is_better = match (is_verdict, line.is_verdict()) {
                (false, is) => is,
                (true, false) => false,
                (true, true) => line.verdict > known.verdict,
            };
            if !is_better {
                return;
            }
        }
        let mut failure = NO_FAILURE;
        if let (Some(signature), Verdict::Failed | Verdict::Error) = (line.signature, line.verdict)
        {
            let next = u32::try_from(merged.failures.len()).unwrap_or(NO_FAILURE);
            failure = *self
                .by_signature
                .entry((line.verdict, signature.clone()))
                .or_insert(next);
            if failure == next {
                merged.failures.push(Failed {
                    verdict: line.verdict,
                    signature,
                    first: BTreeMap::new(),
                });
            }
            let first = &mut merged.failures[failure as usize].first;
            first.insert(place, line.reason.unwrap_or_default());
            // One more than is shown, since another result may take the place of one.
            if first.len() > 2 * TRACES {
                first.pop_last();
            }
        }
        merged.cases[place] = Some(Known {
            verdict: line.verdict,
            failure,
            digest,
        });
    }
}

impl Merged {
    /// Places of cases without a result.
    fn missing(&self) -> Vec<usize> {
        let cases = self.cases.iter().enumerate();
        cases
            .filter(|(_, known)| known.is_none())
            .map(|(place, _)| place)
            .collect()
    }

    /// The missing cases, a line for each shard.
    fn missing_by_shard(&self, missing: &[usize]) -> Vec<String> {
        let mut shards: BTreeMap<u32, Vec<usize>> = BTreeMap::new();
        for place in missing {
            shards
                .entry(self.plan.owner(*place))
                .or_default()
                .push(*place);
        }
        let line = |(shard, places): (&u32, &Vec<usize>)| {
            let names = places.iter().take(3).map(|place| self.plan.name(*place));
            let names: Vec<String> = names.collect();
            let more = if places.len() > names.len() {
                ", …"
            } else {
                ""
            };
            format!(
                "shard {shard}/{}: {} missing: {}{more}",
                self.plan.shards,
                match places.len() {
                    1 => "1 case is".to_owned(),
                    count => format!("{count} cases are"),
                },
                names.join(", ")
            )
        };
        let mut lines: Vec<String> = shards.iter().take(MOST_LISTED).map(line).collect();
        if shards.len() > MOST_LISTED {
            lines.push(format!(
                "and cases of {} more shards",
                shards.len() - MOST_LISTED
            ));
        }
        lines
    }

    /// Reads both results of what differed.
    fn reread_different(&mut self, paths: &[PathBuf]) -> Result<(), Failure> {
        if self.different.is_empty() {
            return Ok(());
        }
        for path in paths {
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
        Ok(())
    }

    /// Number of cases that have a verdict; of those of one file, if it is given.
    pub(crate) fn count(&self, verdict: Verdict, file: Option<usize>) -> usize {
        let cases = match file {
            Some(file) => {
                let repeat = self.plan.repeat as usize;
                &self.cases[file * repeat..(file + 1) * repeat]
            }
            None => &self.cases,
        };
        cases
            .iter()
            .flatten()
            .filter(|known| known.verdict == verdict)
            .count()
    }

    /// Failures with the places of the cases that have them, the most frequent first; of one file, if
    /// it is given.
    pub(crate) fn frequent(&self, file: Option<usize>) -> Vec<(&Failed, usize)> {
        let repeat = self.plan.repeat as usize;
        let places = file.map_or(0..self.cases.len(), |file| {
            file * repeat..(file + 1) * repeat
        });
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        for known in self.cases[places]
            .iter()
            .flatten()
            .filter(|known| known.failure != NO_FAILURE)
        {
            *counts.entry(known.failure).or_default() += 1;
        }
        let failed = |(failure, count): (&u32, &usize)| (&self.failures[*failure as usize], *count);
        let mut all: Vec<(&Failed, usize)> = counts.iter().map(failed).collect();
        all.sort_by(|(one, count), (other, more)| {
            more.cmp(count)
                .then_with(|| one.signature.cmp(&other.signature))
        });
        all
    }

    /// The first cases that have a failure, with the reason of each.
    pub(crate) fn examples<'a>(
        &'a self,
        failed: &'a Failed,
    ) -> impl Iterator<Item = (usize, &'a str)> {
        let has = |place: &usize| {
            let known = self.cases[*place].filter(|known| known.failure != NO_FAILURE);
            known.is_some_and(|known| std::ptr::eq(&self.failures[known.failure as usize], failed))
        };
        let first = failed.first.iter().filter(move |(place, _)| has(place));
        first
            .map(|(place, reason)| (*place, reason.as_str()))
            .take(TRACES)
    }
}
