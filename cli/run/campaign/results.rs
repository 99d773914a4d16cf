//! Results of a shard: a line of JSON for each case, in a file of its own for each attempt.
//!
//! The file is compressed, and flushed often. A process that is killed loses what came after the last
//! time, and every prefix can be read.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, BufRead as _, BufReader, ErrorKind, Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::{Context as _, anyhow};
use flate2::Compression;
use flate2::bufread::MultiGzDecoder;
use flate2::write::GzEncoder;
use rigsim_pty::{PortErrorKind, paths};
use serde::{Deserialize, Serialize};

use crate::args::Shard;
use crate::exit::Failure;
use crate::recording;
use crate::run::case::{Case, CaseResult, Verdict};
use crate::run::view::View;
use crate::visible;

use super::plan::{MOST_CASES, Plan};

/// Longest time for which results are kept in memory.
const FLUSH: Duration = Duration::from_secs(2);
/// Most bytes of a line.
const MOST_LINE: u64 = 64 << 20;
/// Most attempts of a shard.
const MOST_ATTEMPTS: u32 = 10_000;
/// Number of traces that are kept of each failure.
pub(crate) const TRACES: usize = 3;
/// Ending of the files.
const ENDING: &str = ".jsonl.gz";

/// First line of a file.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) shard: u32,
    pub(crate) plan: Plan,
}

/// Result of a case.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub(crate) struct Line {
    /// Number of the file in the plan, from 0.
    pub(crate) file: usize,
    /// Which time it was played, from 0.
    pub(crate) repeat: u32,
    /// For those who read it without the plan.
    pub(crate) name: String,
    pub(crate) seed: u64,
    pub(crate) verdict: Verdict,
    /// What failed, without what differs from seed to seed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) signature: Option<String>,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) reason: Option<String>,
    /// Simulated time that it took.
    pub(crate) simulated_s: f64,
    /// How near each rule came to being broken, as a share of its limit.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub(crate) margins: BTreeMap<String, f64>,
    /// Digest of its trace.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub(crate) trace: Option<String>,
    /// Real time that it took: the only part that differs when it is played again.
    pub(crate) took_s: f64,
}

impl Line {
    /// Returns the line as it is the same each time.
    pub(crate) fn repeatable(&self) -> String {
        let mut same = self.clone();
        same.took_s = 0.0;
        serde_json::to_string(&same).unwrap_or_default()
    }
}

/// Results that are being written.
pub(crate) struct Results {
    folder: PathBuf,
    path: PathBuf,
    file: GzEncoder<File>,
    flushed: Instant,
    /// Number of failures of each signature, of those whose traces are kept.
    failures: BTreeMap<String, usize>,
    /// Traces of cases that have no verdict yet.
    scratch: tempfile::TempDir,
}

impl Results {
    /// Begins a new attempt in a folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn begin(folder: &Path, shard: Shard, plan: &Plan) -> Result<Self, Failure> {
        let cannot = || format!("cannot keep results in {}", visible::name(folder));
        fs::create_dir_all(folder)
            .with_context(cannot)
            .map_err(Failure::usage)?;
        let (path, file) = create(folder, shard)
            .with_context(cannot)
            .map_err(Failure::usage)?;
        let mut results = Self {
            folder: folder.to_owned(),
            path,
            file: GzEncoder::new(file, Compression::fast()),
            flushed: Instant::now(),
            failures: BTreeMap::new(),
            scratch: tempfile::Builder::new()
                .prefix("sim-results-")
                .tempdir()
                .context("cannot make a folder for traces")
                .map_err(Failure::system)?,
        };
        let header = Header {
            shard: shard.index,
            plan: plan.clone(),
        };
        results.add(&header)?;
        results.flush()?;
        Ok(results)
    }

    /// Folder for traces until it is known whether they are kept.
    pub(crate) fn scratch(&self) -> &Path {
        self.scratch.path()
    }

    /// Adds the result of a case.
    pub(crate) fn known(
        &mut self,
        file: usize,
        case: &Case<'_>,
        result: &CaseResult,
    ) -> Result<(), Failure> {
        if result.verdict == Verdict::Aborted {
            return Ok(());
        }
        let played = result.played.as_ref();
        let what = result.why.as_deref().or_else(|| result.failed());
        self.add(&Line {
            file,
            repeat: case.repeat.unwrap_or_default(),
            name: case.name(),
            seed: case.seed,
            verdict: result.verdict,
            signature: what.map(signature),
            reason: View::new(&case.loaded.scenario, Some(result), case.is_live()).reason,
            simulated_s: played.map_or(0.0, |played| played.outcome.ended_at.as_secs_f64()),
            margins: played.map_or_else(BTreeMap::new, |played| {
                let margins = played.outcome.margins.iter();
                let margins = margins.map(|rule| (rule.what.clone(), rule.margin));
                margins.collect()
            }),
            trace: played.and_then(|played| played.trace.clone()),
            took_s: played.map_or(0.0, |played| played.took.as_secs_f64()),
        })?;
        self.catch_up()
    }

    /// Keeps the trace of a case if it is among the first of its failure; called in the order of cases.
    pub(crate) fn keep_trace(
        &mut self,
        case: &Case<'_>,
        result: &CaseResult,
    ) -> Result<(), Failure> {
        let Some(trace) = case
            .recording()
            .filter(|trace| trace.starts_with(self.scratch()))
        else {
            return Ok(());
        };
        if let Some(what) = result
            .failed()
            .filter(|_| result.verdict == Verdict::Failed)
        {
            let count = self.failures.entry(signature(what)).or_default();
            *count += 1;
            if *count <= TRACES
                && let Some(name) = trace.file_name()
            {
                let to = self.folder.join("traces").join(name);
                let keep = || -> anyhow::Result<u64> {
                    let kept = paths::Results::at(&to, recording::MARKS);
                    match kept.and_then(paths::Results::into_file) {
                        Ok(mut kept) => Ok(io::copy(&mut File::open(&trace)?, &mut kept)?),
                        // Another attempt keeps the same.
                        Err(PortErrorKind::InUse(_)) => Ok(0),
                        Err(error) => Err(error.into()),
                    }
                };
                keep()
                    .with_context(|| format!("cannot keep the trace {}", visible::name(&to)))
                    .map_err(Failure::system)?;
            }
        }
        // Of a case that was not played there is none.
        let _ = fs::remove_file(trace);
        Ok(())
    }

    /// Writes what has waited for long.
    pub(crate) fn catch_up(&mut self) -> Result<(), Failure> {
        match self.flushed.elapsed() > FLUSH {
            true => self.flush(),
            false => Ok(()),
        }
    }

    /// Writes all.
    pub(crate) fn flush(&mut self) -> Result<(), Failure> {
        self.flushed = Instant::now();
        self.write(GzEncoder::flush)
    }

    fn add<T: Serialize>(&mut self, line: &T) -> Result<(), Failure> {
        let mut line = serde_json::to_vec(line).map_err(Failure::system)?;
        line.push(b'\n');
        self.write(|file| file.write_all(&line))
    }

    fn write(
        &mut self,
        write: impl FnOnce(&mut GzEncoder<File>) -> io::Result<()>,
    ) -> Result<(), Failure> {
        write(&mut self.file)
            .with_context(|| format!("cannot write results to {}", visible::name(&self.path)))
            .map_err(Failure::system)
    }
}

/// Makes the file of the next attempt; none is ever written over.
fn create(folder: &Path, shard: Shard) -> io::Result<(PathBuf, File)> {
    let Shard { index, of, .. } = shard;
    let mut attempts = (1..=MOST_ATTEMPTS).map(|attempt| {
        let path = folder.join(format!("shard-{index}-of-{of}.attempt-{attempt}{ENDING}"));
        File::create_new(&path).map(|file| (path, file))
    });
    let is_taken = |error: &io::Error| error.kind() == ErrorKind::AlreadyExists;
    let made = attempts.find(|made| !made.as_ref().is_err_and(is_taken));
    made.unwrap_or_else(|| {
        let why = format!("{MOST_ATTEMPTS} attempts of shard {shard} are there");
        Err(io::Error::other(why))
    })
}

/// The files of results in a folder, by their names.
pub(crate) fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut files = Vec::new();
    for entry in fs::read_dir(folder)? {
        let path = entry?.path();
        let name = path
            .file_name()
            .map(|name| name.to_string_lossy().into_owned());
        if name.is_some_and(|name| name.starts_with("shard-") && name.ends_with(ENDING)) {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// How a file of results ends.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Tail {
    Whole,
    /// It ends within a member or a line, as after a crash.
    Torn,
}

/// A line of a file.
pub(crate) enum Part {
    Header(Box<Header>),
    Line(Line),
}

/// Reads a file of results: hands each line to `take`, which returns whether to go on. Of a torn file
/// these are the lines before the tear.
///
/// # Errors
/// When the file cannot be opened, or is no file of results, or `take` refuses it.
pub(crate) fn read(
    path: &Path,
    mut take: impl FnMut(Part) -> anyhow::Result<bool>,
) -> anyhow::Result<Tail> {
    let shown = || format!("cannot read the results {}", visible::name(path));
    let file = File::open(path).with_context(shown)?;
    let mut text = BufReader::new(MultiGzDecoder::new(BufReader::new(file)));
    let mut line = Vec::new();
    let mut next = |line: &mut Vec<u8>| {
        line.clear();
        match text.by_ref().take(MOST_LINE).read_until(b'\n', line) {
            Ok(0) => Some(Tail::Whole),
            Ok(_) if line.ends_with(b"\n") => None,
            Ok(_) | Err(_) => Some(Tail::Torn),
        }
    };
    if next(&mut line).is_some() {
        return Ok(Tail::Torn);
    }
    let first: Header =
        serde_json::from_slice(&line).with_context(|| format!("{}: no header", shown()))?;
    if first.plan.cases() > MOST_CASES {
        return Err(anyhow!("{}: more than {MOST_CASES} cases", shown()));
    }
    let mut goes_on = take(Part::Header(Box::new(first)))?;
    while goes_on {
        if let Some(tail) = next(&mut line) {
            return Ok(tail);
        }
        let line = serde_json::from_slice(&line);
        goes_on = take(Part::Line(
            line.with_context(|| format!("{}: a malformed line", shown()))?,
        ))?;
    }
    Ok(Tail::Whole)
}

/// What failed, without the values that it was found by and other numbers outside of conditions, so
/// that the same failure of two seeds has the same.
pub(crate) fn signature(what: &str) -> String {
    let what = what.split(", but ").next().unwrap_or(what);
    let mut text = String::new();
    let mut quoted = false;
    let mut in_number = false;
    for c in what.chars() {
        quoted ^= c == '`';
        let is_digit = !quoted && (c.is_ascii_digit() || in_number && c == '.');
        match (is_digit, in_number) {
            (true, false) => text.push('#'),
            (true, true) => {}
            (false, _) => text.push(c),
        }
        in_number = is_digit;
    }
    text
}

#[cfg(test)]
mod tests;
