//! What a campaign plays: the same for all its shards, so that results of two campaigns never mix.

use std::fs::{self, File};
use std::io::Read as _;
use std::path::Path;

use rigsim_runner::RunOptions;
use serde::{Deserialize, Serialize};
use serde_json::{Value, json};

use crate::args::{RunArgs, Shard};
use crate::digest::digest;
use crate::exit::Failure;
use crate::run::case::Case;
use crate::scenario_files::Loaded;
use crate::visible;

/// Most bytes of a file of the client that are looked at.
const MOST_CLIENT: u64 = 64 << 20;

/// Everything that decides what is played.
#[derive(Debug, Clone, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Plan {
    /// Version of the program.
    pub(crate) program: String,
    /// Number of shards.
    pub(crate) shards: u64,
    /// Number of times that each file is played.
    pub(crate) repeat: u32,
    /// Words of the client's command; none for scripted clients.
    pub(crate) client: Vec<String>,
    /// Sizes and digests of those words that are files.
    pub(crate) client_files: Vec<String>,
    /// Settings that win over those of the files.
    pub(crate) set: Vec<String>,
    pub(crate) files: Vec<PlannedFile>,
}

/// A scenario file with one combination of its parameters.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct PlannedFile {
    /// Its path, as it was given, and its parameters.
    pub(crate) name: String,
    /// Seed of the first time.
    pub(crate) seed: u64,
    /// Digest of the file, its base, its world and its settings.
    pub(crate) digest: String,
    /// The command that plays it again, behind `sim run --seed N`: the first time, and the others, which
    /// have other vehicles of the same make.
    pub(crate) command: String,
    pub(crate) later_command: String,
}

/// A case that is shown.
#[derive(Serialize)]
pub(crate) struct Example {
    pub(crate) name: String,
    pub(crate) reason: String,
    pub(crate) command: String,
}

impl Plan {
    /// The plan of these files, whose seed is 1 unless they or a flag say another.
    pub(crate) fn new(args: &RunArgs, shards: u64, loaded: &[Loaded]) -> Result<Self, Failure> {
        let files = loaded.iter().map(|one| {
            let [first, second] = [0, 1].map(|repeat| Case::new(args, one, repeat, 1));
            Ok(PlannedFile {
                name: one.name(),
                seed: first.seed,
                digest: content(one, first.is_live())?,
                command: first.again(),
                later_command: second.again(),
            })
        });
        let client_files = args.client.iter().map(Path::new).filter_map(file_digest);
        Ok(Self {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            shards,
            repeat: args.repeat,
            client: args.client.iter().map(visible::name).collect(),
            client_files: client_files.collect(),
            set: args.settings.set.clone(),
            files: files.collect::<Result<_, Failure>>()?,
        })
    }

    /// Number of cases.
    pub(crate) fn cases(&self) -> usize {
        self.files.len().saturating_mul(self.repeat as usize)
    }

    /// The file of a case by its number, which time it is, from 0, and its seed.
    fn at(&self, number: usize) -> Option<(&PlannedFile, u64, u64)> {
        let repeat = self.repeat.max(1) as usize;
        let (file, time) = (self.files.get(number / repeat)?, number % repeat);
        Some((file, time as u64, file.seed.wrapping_add(time as u64)))
    }

    /// The shard that has a case, and the seed of it; `None` beyond the plan.
    pub(crate) fn key(&self, number: usize) -> Option<(u64, u64)> {
        let (file, _, seed) = self.at(number)?;
        Some((Shard::owner(self.shards, &file.name, &self.set, seed), seed))
    }

    /// Returns a case as it is shown.
    pub(crate) fn example(&self, number: usize, reason: &str) -> Option<Example> {
        let (file, time, seed) = self.at(number)?;
        let (again, name) = match time {
            0 if self.repeat == 1 => (&file.command, file.name.clone()),
            0 => (&file.command, format!("{} #1", file.name)),
            _ => (&file.later_command, format!("{} #{}", file.name, time + 1)),
        };
        Some(Example {
            name,
            reason: reason.to_owned(),
            command: format!("sim run --seed {seed} {again}"),
        })
    }

    /// Returns what makes another plan of `other`, in words; `None` if nothing does.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let facts = |plan: &Self| {
            let mut facts = json!(plan);
            let files = plan.files.iter();
            facts["files"] = files.map(|file| (file.name.clone(), json!(file))).collect();
            facts
        };
        let what = || difference(&facts(self), &facts(other));
        (self != other).then(|| what().trim_start().to_owned())
    }
}

/// The first place at which two documents differ, and what is there.
fn difference(ours: &Value, theirs: &Value) -> String {
    if let (Value::Object(one), Value::Object(other)) = (ours, theirs) {
        let mut keys = one.keys().chain(other.keys());
        return match keys.find(|key| one.get(*key) != other.get(*key)) {
            Some(key) => format!(" `{key}`{}", difference(&ours[key], &theirs[key])),
            None => "the order of the files".to_owned(),
        };
    }
    format!(": {} and {}", visible::json(ours), visible::json(theirs))
}

/// Digest of all that a scenario is played with: the first line of a trace has it.
fn content(loaded: &Loaded, live: bool) -> Result<String, Failure> {
    if loaded.broken.is_some() {
        return Ok(String::new());
    }
    let mut run = loaded.run(RunOptions {
        live,
        trace: true,
        ..RunOptions::scripted(0)
    })?;
    let header = run.poll_trace().unwrap_or_default();
    Ok(format!("{:016x}", digest(header.as_bytes())))
}

fn file_digest(path: &Path) -> Option<String> {
    let about = fs::metadata(path).ok().filter(fs::Metadata::is_file)?;
    let mut bytes = Vec::new();
    let file = File::open(path).ok()?;
    file.take(MOST_CLIENT).read_to_end(&mut bytes).ok()?;
    Some(format!("{} {:016x}", about.len(), digest(&bytes)))
}
