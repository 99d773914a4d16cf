//! Playing schedules in lockstep, as `sim run` plays a file, and what is to be known of each run.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::hash::Hasher as _;
use std::io::{BufRead as _, BufReader, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, anyhow};
use rigsim_runner::Outcome;
use rigsim_runner::run::FailureKind;
use rigsim_runner::trace::Record;
use serde::{Deserialize, Serialize};
use siphasher::sip::SipHasher13;

use crate::args::RunArgs;
use crate::exit::Failure;
use crate::run::{Case, Verdict, play_quietly, signature, stop_by_signals};
use crate::scenario_files::{Given, Loaded, load_text};
use crate::visible;

use super::space::step_name;

/// Most moments of reaction of a run.
const MOST_REACTIONS: usize = 3;
/// Most faults of a schedule.
const MOST_FAULTS: usize = 4;

/// What is known of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Rules that were broken, by their keys, with the first failure of each.
    pub(super) broken: BTreeMap<String, String>,
    /// Margins of the rules.
    pub(super) margins: BTreeMap<String, f64>,
    /// Digest of what the client sent.
    pub(super) sent: u64,
    /// Digest of the trace.
    pub(super) trace: String,
    /// Faults that hit something, and when each began, s.
    pub(super) begun: Vec<Option<f64>>,
    pub(super) hit: Vec<bool>,
    /// Times at which the client did something else than without faults, s.
    pub(super) reactions: Vec<f64>,
    pub(super) ended: f64,
    /// Why there is no verdict, if there is none.
    pub(super) error: Option<String>,
}

impl Seen {
    /// The rule that came nearest to being broken.
    pub(super) fn nearest(&self) -> Option<(&str, f64)> {
        let all = self
            .margins
            .iter()
            .map(|(rule, margin)| (rule.as_str(), *margin));
        all.min_by(|one, other| one.1.total_cmp(&other.1))
    }
}

/// A line of the journal.
#[derive(Serialize, Deserialize)]
struct Entry {
    run: u64,
    seen: Option<Seen>,
}

/// What a client does: when, and what.
type Act = (f64, u64);

/// Plays files that exist in memory.
pub(super) struct Player<'a> {
    args: RunArgs,
    given: &'a Given<'a>,
    folder: PathBuf,
    scratch: tempfile::TempDir,
    stop: Arc<AtomicBool>,
    threads: usize,
    seed: u64,
    journal: File,
    /// Runs that are known, by their files and seeds; `None` for a file that is not valid.
    known: BTreeMap<u64, Option<Seen>>,
    usual: Vec<Act>,
    /// Runs that were asked for, known ones included, so that a resumed hunt counts the same.
    pub(super) asked: u64,
}

impl<'a> Player<'a> {
    /// A player that goes on with the journal in the folder if it is one of the same hunt.
    pub(super) fn new(
        args: RunArgs,
        given: &'a Given<'a>,
        folder: &Path,
        threads: usize,
        hunt: u64,
    ) -> Result<Self, Failure> {
        let path = folder.join("journal.jsonl");
        let known = read_journal(&path, hunt);
        let cannot = || format!("cannot write {}", visible::name(&path));
        let mut journal = File::options()
            .create(true)
            .append(true)
            .open(&path)
            .with_context(cannot)
            .map_err(Failure::usage)?;
        if known.is_empty() {
            journal
                .set_len(0)
                .and_then(|()| writeln!(journal, "{{\"hunt\":\"{hunt:016x}\"}}"))
                .with_context(cannot)
                .map_err(Failure::usage)?;
        }
        Ok(Self {
            seed: args.seed.unwrap_or(1),
            args,
            given,
            folder: folder.to_owned(),
            scratch: tempfile::tempdir().map_err(Failure::system)?,
            stop: stop_by_signals()?,
            threads,
            journal,
            known,
            usual: Vec::new(),
            asked: 0,
        })
    }

    /// Reads a file; `None` if it is not valid, as one whose fault this vehicle cannot have.
    pub(super) fn load(&self, text: &str) -> Option<Loaded> {
        let path = self
            .folder
            .join(format!("hunt-{:016x}.toml", digest(text.as_bytes())));
        load_text(&path, text, self.given).ok()
    }

    /// Files are read as if they were in this folder.
    pub(super) fn see_from(&mut self, folder: &Path) {
        folder.clone_into(&mut self.folder);
    }

    pub(super) fn seed(&self) -> u64 {
        self.seed
    }

    /// Plays files with the seed of the hunt; results are in the order of the files. What was played
    /// before is known, unless it is to be played `again`.
    pub(super) fn play(&mut self, texts: &[String]) -> Result<Vec<Option<Seen>>, Failure> {
        let seed = self.seed;
        let all: Vec<(String, u64)> = texts.iter().map(|text| (text.clone(), seed)).collect();
        self.play_seeds(&all, false)
    }

    pub(super) fn play_seeds(
        &mut self,
        all: &[(String, u64)],
        again: bool,
    ) -> Result<Vec<Option<Seen>>, Failure> {
        self.asked += all.len() as u64;
        let runs: Vec<u64> = all.iter().map(|(text, seed)| run_id(text, *seed)).collect();
        let mut new = Vec::new();
        let mut taken = BTreeSet::new();
        for ((text, seed), run) in all.iter().zip(&runs) {
            if (again || !self.known.contains_key(run)) && taken.insert(*run) {
                match self.load(text) {
                    Some(loaded) => new.push((*run, *seed, loaded)),
                    None => {
                        self.known.insert(*run, None);
                    }
                }
            }
        }
        // The same file with two seeds has the same name.
        let folders = new.iter().map(|(run, ..)| {
            let folder = self.scratch.path().join(format!("{run:016x}"));
            fs::create_dir_all(&folder).map(|()| folder)
        });
        let folders: Vec<PathBuf> = folders.collect::<Result<_, _>>().map_err(Failure::system)?;
        let cases = new
            .iter()
            .zip(&folders)
            .map(|((_, seed, loaded), folder)| Case {
                seed: *seed,
                scratch: Some(folder),
                ..Case::new(&self.args, loaded, 0, *seed)
            });
        let cases: Vec<Case<'_>> = cases.collect();
        let results = play_quietly(&cases, self.threads, &self.stop)?;
        for ((case, (run, ..)), result) in cases.iter().zip(&new).zip(results) {
            let Some(played) = result.played else {
                return Err(Failure::system(anyhow!(
                    "{}; the journal in {} lets the same command go on",
                    result.why.unwrap_or_default(),
                    visible::name(&self.folder)
                )));
            };
            let mut seen = seen(&played.outcome, case.recording(), &self.usual);
            if result.verdict == Verdict::Error {
                // It says nothing about the client.
                seen.broken.clear();
                seen.error = result.why;
            }
            seen.trace = played.trace.unwrap_or_default();
            let entry = Entry {
                run: *run,
                seen: Some(seen),
            };
            let line = serde_json::to_string(&entry).map_err(Failure::system)?;
            writeln!(self.journal, "{line}")
                .context("cannot write the journal")
                .map_err(Failure::system)?;
            self.known.insert(*run, entry.seen);
        }
        Ok(runs.iter().map(|run| self.known[run].clone()).collect())
    }

    /// Plays one and keeps its trace, which is read by `read`.
    pub(super) fn trace<T>(
        &self,
        text: &str,
        read: impl FnOnce(&Path, &Loaded) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let Some(loaded) = self.load(text) else {
            return Err(Failure::system(anyhow!(
                "a file of the hunt cannot be read"
            )));
        };
        let scratch = tempfile::tempdir_in(self.scratch.path()).map_err(Failure::system)?;
        let case = Case {
            scratch: Some(scratch.path()),
            ..Case::new(&self.args, &loaded, 0, self.seed)
        };
        play_quietly(std::slice::from_ref(&case), 1, &self.stop)?;
        read(&case.recording().unwrap_or_default(), &loaded)
    }

    /// Takes what the client does without faults for usual.
    pub(super) fn learn(&mut self, text: &str) -> Result<(), Failure> {
        self.usual = self.trace(text, |path, _| Ok(acts(&records(path))))?;
        Ok(())
    }
}

/// The runs in a journal; none if it is one of another hunt. What comes behind a torn line is lost.
fn read_journal(path: &Path, hunt: u64) -> BTreeMap<u64, Option<Seen>> {
    let Ok(file) = File::open(path) else {
        return BTreeMap::new();
    };
    let mut lines = BufReader::new(file).lines().map_while(Result::ok);
    if lines
        .next()
        .is_none_or(|head| !head.contains(&format!("{hunt:016x}")))
    {
        return BTreeMap::new();
    }
    let entries = lines.map_while(|line| serde_json::from_str::<Entry>(&line).ok());
    entries.map(|entry| (entry.run, entry.seen)).collect()
}

pub(super) fn digest(bytes: &[u8]) -> u64 {
    let mut hasher = SipHasher13::new();
    hasher.write(bytes);
    hasher.finish()
}

fn run_id(text: &str, seed: u64) -> u64 {
    digest(format!("{seed}\n{text}").as_bytes())
}

/// The key of a failure: the same for the same failure of two runs.
pub(super) fn keys(outcome: &Outcome) -> BTreeMap<String, String> {
    let counts = |kind| kind < FailureKind::Consequence;
    let failures = outcome
        .failures
        .iter()
        .filter(|failure| counts(failure.kind));
    let mut keys = BTreeMap::new();
    for failure in failures {
        let key = signature(&failure.what);
        let key = key
            .split([',', '×'])
            .next()
            .unwrap_or(&key)
            .trim()
            .to_owned();
        keys.entry(key).or_insert_with(|| failure.to_string());
    }
    keys
}

pub(super) fn records(path: &Path) -> Vec<Record> {
    let text = fs::read_to_string(path).unwrap_or_default();
    text.lines()
        .skip(1)
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

#[expect(clippy::cast_precision_loss, reason = "no run takes 2^53 ns")]
fn seconds(nanos: u64) -> f64 {
    nanos as f64 / 1e9
}

fn acts(records: &[Record]) -> Vec<Act> {
    let act = |record: &Record| {
        let (t, what) = match record {
            Record::Attach { t, .. } => (*t, 1),
            Record::Detach { t, .. } => (*t, 2),
            Record::In { t, bytes, .. } => (*t, digest(&bytes.0)),
            _ => return None,
        };
        Some((seconds(t), what))
    };
    records.iter().filter_map(act).collect()
}

fn seen(outcome: &Outcome, trace: Option<PathBuf>, usual: &[Act]) -> Seen {
    let records = trace.as_deref().map(records).unwrap_or_default();
    if let Some(trace) = trace {
        // It is in a folder that goes with the hunt.
        let _ = fs::remove_file(trace);
    }
    let acts = acts(&records);
    let mut sent = SipHasher13::new();
    for (_, what) in &acts {
        sent.write_u64(*what);
    }
    let begun = |index| {
        let name = step_name(index);
        let fault = outcome.faults.iter().find(|fault| fault.step == name);
        let at = records.iter().find_map(|record| match record {
            Record::Step { t, step, what } if *step == name && what == "begun" => Some(seconds(*t)),
            _ => None,
        });
        (at, fault.map_or(at.is_some(), |fault| fault.hits > 0))
    };
    let (begun, hit): (Vec<_>, Vec<_>) = (0..MOST_FAULTS).map(begun).unzip();
    let first = begun
        .iter()
        .flatten()
        .copied()
        .fold(f64::INFINITY, f64::min);
    let same = acts
        .iter()
        .zip(usual)
        .take_while(|(one, other)| one.1 == other.1)
        .count();
    let differs = acts.get(same).map(|(at, _)| *at);
    let opened = records.iter().filter_map(|record| match record {
        Record::Attach { t, .. } => Some(seconds(*t)),
        _ => None,
    });
    let mut reactions: Vec<f64> = differs
        .into_iter()
        .chain(opened)
        .filter(|at| *at > first)
        .collect();
    reactions.sort_by(f64::total_cmp);
    reactions.dedup();
    reactions.truncate(MOST_REACTIONS);
    let margins = outcome
        .margins
        .iter()
        .map(|rule| (rule.what.clone(), rule.margin));
    Seen {
        broken: keys(outcome),
        margins: margins.collect(),
        sent: sent.finish(),
        trace: String::new(),
        begun,
        hit,
        reactions,
        ended: outcome.ended_at.as_secs_f64(),
        error: None,
    }
}
