//! Results of a shard: a line of JSON for each case, in its own file for each attempt.
//!
//! The file is compressed, and flushed often. A process that is killed loses what came after the last
//! time, and every prefix can be read.

use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{self, ErrorKind, Write as _};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use anyhow::Context as _;
use flate2::Compression;
use flate2::write::GzEncoder;
use rigsim_pty::{PortErrorKind, paths};
use rigsim_runner::run::{Failure as Failed, FailureKind};
use serde::{Deserialize, Serialize};

use crate::args::Shard;
use crate::exit::Failure;
use crate::recording;
use crate::run::case::{Case, CaseResult, Verdict};
use crate::run::view::{View, signature};
use crate::visible;

use super::plan::Plan;

/// Longest time for which results are kept in memory.
const FLUSH: Duration = Duration::from_secs(2);
/// Number of traces that are kept of each failure.
pub(crate) const TRACES: usize = 3;
/// Ending of the files.
const ENDING: &str = ".jsonl.gz";

/// First line of a file.
#[derive(Serialize, Deserialize)]
pub(crate) struct Header {
    pub(crate) shard: u64,
    pub(crate) plan: Plan,
}

/// Result of a case.
#[derive(Serialize, Deserialize)]
pub(crate) struct Line {
    /// Its number in the plan, from 0.
    pub(crate) case: usize,
    /// For those who read it without the plan.
    pub(crate) name: String,
    pub(crate) seed: u64,
    pub(crate) verdict: Verdict,
    /// Rule that was broken, or what else failed, without what differs from seed to seed.
    pub(crate) signature: Option<String>,
    pub(crate) kind: Option<FailureKind>,
    pub(crate) reason: Option<String>,
    /// Simulated time that it took.
    pub(crate) simulated_s: f64,
    /// How near each rule came to being broken, as a share of its limit.
    pub(crate) margins: BTreeMap<String, f64>,
    /// Digest of its trace.
    pub(crate) trace: Option<String>,
    /// Real time that it took.
    pub(crate) took_s: f64,
}

/// Results that are being written.
pub(crate) struct Results {
    folder: PathBuf,
    file: GzEncoder<File>,
    /// When all was written.
    flushed: Option<Instant>,
    /// Number of failures of each signature, of those whose traces are kept.
    failures: BTreeMap<String, usize>,
}

impl Results {
    /// Begins a new attempt in a folder.
    ///
    /// # Errors
    /// When it cannot be written.
    pub(crate) fn begin(folder: &Path, shard: Shard, plan: Plan) -> Result<Self, Failure> {
        let file = create(folder, shard)
            .with_context(|| format!("cannot keep results in {}", visible::name(folder)))
            .map_err(Failure::usage)?;
        let mut results = Self {
            folder: folder.to_owned(),
            file: GzEncoder::new(file, Compression::fast()),
            flushed: None,
            failures: BTreeMap::new(),
        };
        let shard = shard.index;
        results.add(&Header { shard, plan })?;
        Ok(results)
    }

    /// Adds the result of a case.
    pub(crate) fn known(&mut self, case: &Case<'_>, result: &CaseResult) -> Result<(), Failure> {
        if result.verdict == Verdict::Aborted {
            return Ok(());
        }
        let (played, failed) = (result.played.as_ref(), result.failed());
        let what = failed.map(|failure| &failure.rule);
        let margins = played.iter().flat_map(|played| &played.outcome.margins);
        let margins = margins.map(|rule| (rule.what.clone(), rule.margin));
        self.add(&Line {
            case: case.number,
            name: case.name(),
            seed: case.seed,
            verdict: result.verdict,
            signature: result.why.as_ref().or(what).map(|what| signature(what)),
            kind: failed.map(|failure| failure.kind),
            reason: View::new(&case.loaded.scenario, result, case.is_live()).reason(),
            simulated_s: played.map_or(0.0, |played| played.outcome.ended_at.as_secs_f64()),
            margins: margins.collect(),
            trace: played.and_then(|played| played.trace.clone()),
            took_s: played.map_or(0.0, |played| played.took.as_secs_f64()),
        })
    }

    /// Keeps the trace of a case that failed if it is among the first of its failure; called in the order of cases.
    pub(crate) fn keep_trace(&mut self, trace: &Path, failed: &Failed) -> Result<(), Failure> {
        let count = self.failures.entry(signature(&failed.rule)).or_default();
        *count += 1;
        if *count > TRACES {
            return Ok(());
        }
        let to = self
            .folder
            .join("traces")
            .join(trace.file_name().unwrap_or_default());
        let kept = paths::Results::at(&to, recording::MARKS).and_then(paths::Results::into_file);
        let copied = match kept {
            Ok(mut kept) => File::open(trace).and_then(|mut trace| io::copy(&mut trace, &mut kept)),
            // Another attempt keeps the same.
            Err(PortErrorKind::InUse(_)) => Ok(0),
            Err(error) => Err(io::Error::other(error)),
        };
        copied
            .with_context(|| format!("cannot keep the trace {}", visible::name(&to)))
            .map_err(Failure::system)
            .map(drop)
    }

    fn add(&mut self, line: &impl Serialize) -> Result<(), Failure> {
        let line = serde_json::to_string(line).map_err(Failure::system)?;
        self.write(|file| writeln!(file, "{line}"))?;
        self.catch_up()
    }

    /// Writes what has waited for long.
    pub(crate) fn catch_up(&mut self) -> Result<(), Failure> {
        match self.flushed.is_some_and(|at| at.elapsed() < FLUSH) {
            true => Ok(()),
            false => self.flush(),
        }
    }

    /// Writes all.
    pub(crate) fn flush(&mut self) -> Result<(), Failure> {
        self.flushed = Some(Instant::now());
        self.write(GzEncoder::flush)
    }

    fn write(
        &mut self,
        write: impl FnOnce(&mut GzEncoder<File>) -> io::Result<()>,
    ) -> Result<(), Failure> {
        write(&mut self.file)
            .with_context(|| format!("cannot write results to {}", visible::name(&self.folder)))
            .map_err(Failure::system)
    }
}

/// Makes the file of the next attempt; none is ever written over.
fn create(folder: &Path, Shard { index, of, .. }: Shard) -> io::Result<File> {
    let mut attempt = 1;
    loop {
        let name = format!("shard-{index}-of-{of}.attempt-{attempt}{ENDING}");
        match File::create_new(folder.join(name)) {
            Err(error) if error.kind() == ErrorKind::AlreadyExists => attempt += 1,
            created => return created,
        }
    }
}

/// The files of results in a folder, by their names.
pub(crate) fn files(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let paths = fs::read_dir(folder)?.map(|entry| Ok(entry?.path()));
    let mut paths: Vec<PathBuf> = paths.collect::<io::Result<_>>()?;
    paths.retain(|path| {
        let name = path.file_name().unwrap_or_default().to_string_lossy();
        name.starts_with("shard-") && name.ends_with(ENDING)
    });
    paths.sort();
    Ok(paths)
}

#[cfg(test)]
mod tests;
