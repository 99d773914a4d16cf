//! Plays schedules in lockstep, as `sim run` plays a file, and reads the results.

use std::collections::{BTreeMap, BTreeSet};
use std::fs::{self, File};
use std::hash::Hasher as _;
use std::io::{BufReader, Seek as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::AtomicBool;

use anyhow::{Context as _, anyhow};
use rigsim_pty::paths::{Held, Results};
use rigsim_runner::Outcome;
use rigsim_runner::run::{FailureKind, Margin};
use rigsim_runner::trace::Record;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};
use siphasher::sip::SipHasher13;

use crate::args::RunArgs;
use crate::digest::digest;
use crate::exit::Failure;
use crate::json_lines::Lines;
use crate::print::complain;
use crate::run::{
    Case, CaseResult, DIFFERS, Plan, Verdict, play_quietly, play_twice, scratch, signature,
    stop_by_signals,
};
use crate::scenario_files::{Given, Loaded, load_text};
use crate::visible;

use super::space::step_name;

/// Most moments of reaction in a run.
const MOST_REACTIONS: usize = 8;
/// Most faults of a schedule.
pub(super) const MOST_FAULTS: usize = 4;
/// Most transitions that describe how a client reacted.
const MOST_TRANSITIONS: usize = 64;
/// Runs of a journal that are played again, since not all files of the client are known.
const CHECKS: usize = 8;
/// Length of the prefix that messages of one kind share, bytes.
const MOST_HEAD: usize = 4;

/// Result of a run.
#[derive(Debug, Clone, Default, Serialize, Deserialize)]
pub(super) struct Seen {
    /// Broken rules by key.
    pub(super) broken: BTreeMap<String, Broken>,
    /// Margins of the rules.
    pub(super) margins: BTreeMap<String, f64>,
    /// Digest of what the client sent.
    pub(super) sent: u64,
    /// Digest of which message followed which, without counts.
    pub(super) class: u64,
    /// Digest of the trace.
    pub(super) trace: String,
    /// Faults that hit something, with the start of each, ms.
    pub(super) begun: Vec<Option<u64>>,
    pub(super) hit: Vec<bool>,
    /// Times of new transitions from one message to another, from the client's first deviation on, ms.
    pub(super) reactions: Vec<u64>,
    /// Time at which the client closed its last port and did nothing more, or the end of the run, ms.
    pub(super) ended: u64,
    /// Why there is no verdict, if there is none.
    pub(super) error: Option<String>,
}

/// A rule that was broken.
#[derive(Debug, Clone, Serialize, Deserialize)]
pub(super) struct Broken {
    pub(super) rule: String,
    /// Its first failure, with time and values.
    pub(super) failure: String,
}

impl Seen {
    /// Margins of the rules that came nearer to being broken than in another run.
    pub(super) fn nearer<'s>(&'s self, usual: &'s Self) -> impl Iterator<Item = (&'s String, f64)> {
        let margins = self.margins.iter().map(|(rule, margin)| (rule, *margin));
        margins
            .filter(|(rule, margin)| usual.margins.get(*rule).is_some_and(|usual| usual > margin))
    }

    /// The smallest of these: 0 if a rule was broken, infinite if none came nearer.
    pub(super) fn nearest(&self, usual: &Self) -> f64 {
        let broken = if self.broken.is_empty() {
            f64::INFINITY
        } else {
            0.0
        };
        let nearer = self.nearer(usual).map(|(_, margin)| margin);
        nearer.fold(broken, f64::min)
    }

    /// Returns whether a fault of the schedule did something.
    pub(super) fn hits(&self) -> bool {
        self.hit.contains(&true)
    }
}

/// Digests of what is no message.
const ATTACH: u64 = 1;
const DETACH: u64 = 2;

/// Something that a client does.
struct Act {
    /// In milliseconds.
    at: u64,
    /// Digest of the whole message, and of its prefix.
    what: u64,
    head: u64,
}

/// Plays files that exist in memory.
pub(super) struct Player<'a> {
    args: RunArgs,
    given: &'a Given<'a>,
    pub(super) folder: PathBuf,
    scratch: Held,
    stop: Arc<AtomicBool>,
    threads: usize,
    pub(super) seed: u64,
    journal: Option<File>,
    /// Runs that were played, by their files and seeds, and those of the journal.
    known: BTreeMap<u64, Seen>,
    journaled: BTreeMap<u64, Seen>,
    /// Number of those still to be played again, as a check of the journal.
    checks: usize,
    usual: Vec<Act>,
    words: BTreeSet<u64>,
    /// Requested runs, known ones included, so that a resumed hunt counts the same.
    pub(super) asked: u64,
}

impl<'a> Player<'a> {
    /// A player of files, which are read as if they were in this folder.
    pub(super) fn new(
        args: RunArgs,
        given: &'a Given<'a>,
        folder: &Path,
        threads: usize,
    ) -> Result<Self, Failure> {
        Ok(Self {
            seed: args.seed.unwrap_or(1),
            args,
            given,
            folder: folder.to_owned(),
            scratch: scratch().map_err(Failure::system)?,
            stop: stop_by_signals()?,
            threads,
            journal: None,
            known: BTreeMap::new(),
            journaled: BTreeMap::new(),
            checks: CHECKS,
            usual: Vec::new(),
            words: BTreeSet::new(),
            asked: 0,
        })
    }

    /// Begins a journal, or continues the one in the folder if it is of the same hunt. No other hunt can use the
    /// folder until this one ends.
    pub(super) fn keep_journal(&mut self, text: &str, usual: &Seen) -> Result<(), Failure> {
        let path = self.journal_path();
        let identity = self.identity(text, usual)?;
        let head = json!({ "hunt": format!("{identity:016x}") });
        let cannot = || format!("cannot keep the journal {}", visible::name(&path));
        let journal = Results::at(&path, &["{\"hunt\":\""]).and_then(Results::into_log);
        let mut journal = journal.with_context(cannot).map_err(Failure::usage)?;
        let (whole, runs) = read_journal(&journal, &head);
        if whole == 0 && journal.metadata().is_ok_and(|found| found.len() > 0) {
            complain(&format!(
                "{} is of another hunt, which cannot go on now",
                visible::name(&path)
            ));
        }
        self.journaled = runs;
        let begun = journal.set_len(whole).and_then(|()| match whole {
            0 => writeln!(journal, "{head}"),
            _ => Ok(()),
        });
        begun.with_context(cannot).map_err(Failure::usage)?;
        self.journal = Some(journal);
        Ok(())
    }

    /// Removes the journal of a finished hunt: later, its results may no longer be those of the client.
    pub(super) fn end_journal(&mut self) {
        // Locked until it is removed, so that no other hunt uses it meanwhile.
        if let Some(_locked) = self.journal.take() {
            let _ = fs::remove_file(self.journal_path());
        }
    }

    fn journal_path(&self) -> PathBuf {
        self.folder.join("journal.jsonl")
    }

    /// Digest of all that a run depends on except its schedule: the job with its bases, the client's command and
    /// the files in it, the simulator, and the runs without faults.
    fn identity(&self, text: &str, usual: &Seen) -> Result<u64, Failure> {
        let loaded = self.load(text)?;
        let plan = Plan::new(&self.args, 1, std::slice::from_ref(&loaded))?;
        let plan = serde_json::to_string(&plan).map_err(Failure::system)?;
        let program = std::env::current_exe().and_then(fs::metadata);
        let program = program.map_err(Failure::system)?;
        let built = (program.len(), program.modified().ok());
        let all = format!("{plan} {built:?} {}", usual.trace);
        Ok(digest(all.as_bytes()))
    }

    /// Reads a file.
    ///
    /// # Errors
    /// When it is not valid, for example because this vehicle cannot have its fault.
    pub(super) fn load(&self, text: &str) -> Result<Loaded, Failure> {
        load_text(&self.path(text), text, self.given)
    }

    /// Checks that a file can be played. Errors name `what`, since the file exists only in memory.
    pub(super) fn check(&self, text: &str, what: &str) -> Result<(), Failure> {
        let Err(failure) = self.load(text) else {
            return Ok(());
        };
        let file = visible::name(&self.path(text));
        let shown = format!("{:#}", failure.error);
        let lines = shown.lines().map(|line| {
            let behind = line.strip_prefix(&file).and_then(|at| at.split_once(": "));
            behind.map_or_else(|| line.to_owned(), |(_, why)| format!("{what}: {why}"))
        });
        Err(Failure::usage(anyhow!(
            lines.collect::<Vec<_>>().join("\n")
        )))
    }

    /// The path of a file that exists only in memory.
    fn path(&self, text: &str) -> PathBuf {
        let name = format!("hunt-{:016x}.toml", digest(text.as_bytes()));
        self.folder.join(name)
    }

    /// The command that plays a file at this path as it is played here.
    pub(super) fn command(&self, text: &str, path: &Path) -> Result<String, Failure> {
        let mut loaded = self.load(text)?;
        path.clone_into(&mut loaded.path);
        Ok(Case::new(&self.args, &loaded, 0, self.seed).command())
    }

    /// Plays files with the seed of the hunt; results are in the order of the files.
    pub(super) fn play(&mut self, texts: &[String]) -> Result<Vec<Seen>, Failure> {
        let all: Vec<(&str, u64)> = texts
            .iter()
            .map(|text| (text.as_str(), self.seed))
            .collect();
        self.play_seeds(&all, false)
    }

    /// Plays a file, even if it was played before.
    pub(super) fn play_again(&mut self, text: &str) -> Result<Seen, Failure> {
        Ok(self.play_seeds(&[(text, self.seed)], true)?.remove(0))
    }

    /// What differs first between two runs of a file; `None` if nothing does this time.
    pub(super) fn difference(&self, text: &str) -> Result<Option<String>, Failure> {
        let loaded = self.load(text)?;
        let result = play_twice(&Case::new(&self.args, &loaded, 0, self.seed), &self.stop)?;
        let played = result.played.iter();
        let mut failures = played.flat_map(|played| &played.outcome.failures);
        let differs = failures.find(|failure| failure.what.starts_with(DIFFERS));
        Ok(differs.map(|failure| failure.what.clone()))
    }

    /// Plays files with seeds. Results of earlier plays are reused unless `again` is set.
    pub(super) fn play_seeds(
        &mut self,
        all: &[(&str, u64)],
        again: bool,
    ) -> Result<Vec<Seen>, Failure> {
        self.asked += all.len() as u64;
        let runs = all
            .iter()
            .map(|(text, seed)| digest(format!("{seed}\n{text}").as_bytes()));
        let runs: Vec<u64> = runs.collect();
        let mut new = Vec::new();
        let mut taken = BTreeSet::new();
        for ((text, seed), run) in all.iter().zip(&runs) {
            if (!again && self.known.contains_key(run)) || !taken.insert(*run) {
                continue;
            }
            if let Some(seen) = self.journaled.get(run).filter(|_| !again) {
                if self.checks == 0 || !seen.hits() {
                    self.known.insert(*run, seen.clone());
                    continue;
                }
                self.checks -= 1;
            }
            match self.load(text) {
                Ok(loaded) => {
                    // The same file with two seeds has the same name.
                    let folder = self.scratch.path().join(format!("{run:016x}"));
                    fs::create_dir_all(&folder).map_err(Failure::system)?;
                    new.push((*run, *seed, loaded, folder));
                }
                Err(failure) => {
                    let error = Some(format!("{:#}", failure.error));
                    let seen = Seen {
                        error,
                        ..Seen::default()
                    };
                    self.known.insert(*run, seen);
                }
            }
        }
        let cases = new.iter().map(|(_, seed, loaded, folder)| Case {
            seed: *seed,
            scratch: Some(folder),
            ..Case::new(&self.args, loaded, 0, *seed)
        });
        let cases: Vec<Case<'_>> = cases.collect();
        let mut results = play_quietly(&cases, self.threads, &self.stop)?;
        for (case, result) in cases.iter().zip(&mut results) {
            if result.verdict == Verdict::Error {
                // Once more, alone: the machine may have been too busy.
                *result = play_quietly(std::slice::from_ref(case), 1, &self.stop)?.remove(0);
            }
        }
        for ((case, (run, .., folder)), result) in cases.iter().zip(&new).zip(results) {
            let Some(played) = result.played else {
                return Err(self.unplayed(result.why));
            };
            let mut seen = self.seen(&played.outcome, case);
            if result.verdict == Verdict::Error {
                // This is not a verdict about the client.
                seen.broken.clear();
                seen.error = result.why;
            }
            seen.trace = played.trace.unwrap_or_default();
            // It is removed with the hunt's folder.
            let _ = fs::remove_dir_all(folder);
            if let Some(before) = self.journaled.get(run) {
                let has_verdict = seen.error.is_none() && before.error.is_none();
                if has_verdict && before.trace != seen.trace {
                    return Err(self.forget());
                }
            } else if let Some(journal) = &mut self.journal {
                let line = serde_json::to_string(&(run, &seen)).map_err(Failure::system)?;
                let written = writeln!(journal, "{line}").context("cannot write the journal");
                written.map_err(Failure::system)?;
            }
            self.known.insert(*run, seen);
        }
        Ok(runs.iter().map(|run| self.known[run].clone()).collect())
    }

    /// A run was aborted, or could not be played.
    fn unplayed(&self, why: Option<String>) -> Failure {
        let why = why.unwrap_or_default();
        let folder = visible::name(&self.folder);
        Failure::system(match self.journal {
            Some(_) => anyhow!("{why}; the same command resumes it from {folder}"),
            None => anyhow!(why),
        })
    }

    /// Empties the journal of another client.
    fn forget(&self) -> Failure {
        let emptied = self.journal.as_ref().map(|journal| journal.set_len(0));
        let path = visible::name(&self.journal_path());
        match emptied {
            Some(Err(error)) => Failure::system(anyhow!(error).context(path)),
            _ => Failure::usage(anyhow!(
                "the client has changed since {path} was written, which is emptied now; the same command \
                 searches from the beginning"
            )),
        }
    }

    /// Plays the file at this path, and calls `read` with its trace.
    pub(super) fn trace_of<T>(
        &self,
        path: &Path,
        text: &str,
        read: impl FnOnce(&Case<'_>, &CaseResult, &AtomicBool) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        let loaded = load_text(path, text, self.given)?;
        let scratch = tempfile::tempdir_in(self.scratch.path()).map_err(Failure::system)?;
        let case = Case {
            scratch: Some(scratch.path()),
            ..Case::new(&self.args, &loaded, 0, self.seed)
        };
        let result = play_quietly(std::slice::from_ref(&case), 1, &self.stop)?.remove(0);
        if result.played.is_none() {
            return Err(self.unplayed(result.why));
        }
        read(&case, &result, &self.stop)
    }

    /// The same of a file that exists in memory.
    pub(super) fn trace<T>(
        &self,
        text: &str,
        read: impl FnOnce(&Case<'_>, &CaseResult, &AtomicBool) -> Result<T, Failure>,
    ) -> Result<T, Failure> {
        self.trace_of(&self.path(text), text, read)
    }

    /// Stores the client's actions without faults as its usual ones.
    pub(super) fn learn(&mut self, records: &[Record]) {
        self.usual = acts(records);
        self.words = self.usual.iter().map(|act| act.what).collect();
    }

    fn seen(&self, outcome: &Outcome, case: &Case<'_>) -> Seen {
        let records = records(case);
        let acts = acts(&records);
        let begun = |index| {
            let name = step_name(index);
            let fault = outcome.faults.iter().find(|fault| fault.step == name);
            let at = records.iter().find_map(|record| match record {
                Record::Step { t, step, what } if *step == name && what == "begun" => {
                    Some(millis(*t))
                }
                _ => None,
            });
            (at, fault.map_or(at.is_some(), |fault| fault.hits > 0))
        };
        let (begun, hit): (Vec<_>, Vec<_>) = (0..MOST_FAULTS).map(begun).unzip();
        let first = begun.iter().flatten().min().copied().unwrap_or(u64::MAX);
        let pairs = acts.iter().zip(&self.usual);
        let same = pairs
            .take_while(|(one, other)| one.what == other.what)
            .count();
        let (mut sent, mut class) = (SipHasher13::new(), SipHasher13::new());
        let (mut transitions, mut reactions) = (BTreeSet::new(), Vec::new());
        let mut before = 0;
        for (index, act) in acts.iter().enumerate() {
            sent.write_u64(act.what);
            // Values that vary count as one.
            let is_usual = self.words.contains(&act.what);
            let word = if is_usual { act.what } else { act.head };
            if index >= same && act.at >= first && transitions.insert((before, word)) {
                reactions.push(act.at);
            }
            before = word;
        }
        reactions.truncate(MOST_REACTIONS);
        for (before, word) in transitions.into_iter().take(MOST_TRANSITIONS) {
            class.write_u64(before);
            class.write_u64(word);
        }
        // Rounded so that it is the same when it is read from the journal.
        let rounded = |margin: f64| (margin * 1e4).round() / 1e4;
        let margin = |rule: &Margin| (rule.what.clone(), rounded(rule.margin));
        Seen {
            broken: broken(outcome),
            margins: outcome.margins.iter().map(margin).collect(),
            sent: sent.finish(),
            class: class.finish(),
            trace: String::new(),
            begun,
            hit,
            reactions,
            ended: end_of(&acts).unwrap_or(millis(outcome.ended_at.as_nanos())),
            error: None,
        }
    }
}

/// The runs in a journal, and the length of its complete lines; none if it is of another hunt.
fn read_journal(mut journal: &File, head: &Value) -> (u64, BTreeMap<u64, Seen>) {
    let mut runs = BTreeMap::new();
    let begun = journal.rewind().is_ok();
    let mut lines = Lines::new(BufReader::new(journal));
    if !begun || !lines.next().is_ok_and(|first| first.as_ref() == Some(head)) {
        return (0, runs);
    }
    while let Ok(Some((run, seen))) = lines.next() {
        runs.insert(run, seen);
    }
    (lines.whole, runs)
}

/// What failed, by a key that is the same for the same failure of two runs.
pub(super) fn broken(outcome: &Outcome) -> BTreeMap<String, Broken> {
    let mut all = BTreeMap::new();
    for failure in &outcome.failures {
        let step = failure.step.as_deref().unwrap_or_default();
        let key = match failure.kind {
            FailureKind::Rule if failure.rule != failure.what => {
                format!("rule {step}: {}", failure.rule)
            }
            // Values may stand anywhere in it.
            FailureKind::Rule => format!("rule {step}: {}", signature(&failure.rule)),
            // What each thread waited for stands behind.
            FailureKind::Client => {
                let what = failure.rule.split([',', ';', ':']).next();
                signature(what.unwrap_or_default())
            }
            FailureKind::Consequence => continue,
        };
        all.entry(key).or_insert_with(|| Broken {
            rule: failure.rule.clone(),
            failure: failure.to_string(),
        });
    }
    all
}

/// The trace of a case that was played.
pub(super) fn records(case: &Case<'_>) -> Vec<Record> {
    let path = case.recording().unwrap_or_default();
    let text = fs::read_to_string(path).unwrap_or_default();
    let records = text.lines().skip(1).map(serde_json::from_str);
    records.filter_map(Result::ok).collect()
}

/// Nanoseconds in milliseconds.
fn millis(nanos: u64) -> u64 {
    (nanos + 500_000) / 1_000_000
}

/// Time at which the client closed its last port and did nothing more; `None` if a port was open until the end.
fn end_of(acts: &[Act]) -> Option<u64> {
    let count = |what| acts.iter().filter(|act| act.what == what).count();
    let last = acts.last().filter(|act| act.what == DETACH)?;
    (count(ATTACH) == count(DETACH)).then_some(last.at)
}

fn acts(records: &[Record]) -> Vec<Act> {
    let act = |record: &Record| {
        let (t, what, head) = match record {
            Record::Attach { t, .. } => (*t, ATTACH, ATTACH),
            Record::Detach { t, .. } => (*t, DETACH, DETACH),
            Record::In { t, bytes, .. } => {
                let head = bytes.0.get(..MOST_HEAD).unwrap_or(&bytes.0);
                (*t, digest(&bytes.0), digest(head))
            }
            _ => return None,
        };
        let at = millis(t);
        Some(Act { at, what, head })
    };
    records.iter().filter_map(act).collect()
}
