//! What a campaign plays: the same for all its shards, so that results of two campaigns never mix.

use std::fs::{self, File};
use std::hash::Hasher as _;
use std::io::Read as _;
use std::path::Path;

use rigsim_runner::RunOptions;
use serde::{Deserialize, Serialize};
use siphasher::sip128::{Hasher128 as _, SipHasher13};

use crate::exit::Failure;
use crate::scenario_files::Loaded;
use crate::visible;

use crate::args::Shard;
use crate::run::case::Case;

/// Most bytes of a file of the client that are looked at.
const MOST_CLIENT: u64 = 64 << 20;

/// Most cases of a campaign.
pub(crate) const MOST_CASES: usize = 10_000_000;

/// Everything that decides what is played.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Plan {
    /// Version of the program.
    pub(crate) program: String,
    /// Number of shards.
    pub(crate) shards: u32,
    /// Number of times that each file is played.
    pub(crate) repeat: u32,
    /// Words of the client's command; none for scripted clients.
    pub(crate) client: Vec<String>,
    /// Digests of those words that are files.
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
    /// Digest of the files and settings that it is played with.
    pub(crate) digest: String,
    pub(crate) title: String,
    /// The command that plays it again, behind `sim run --seed N`: the first time, and the others, which
    /// have other vehicles of the same make.
    pub(crate) commands: [String; 2],
}

impl Plan {
    /// The plan of these files, of each of which the first two cases are given.
    pub(crate) fn new(shard: Shard, cases: &[[Case<'_>; 2]]) -> Result<Self, Failure> {
        let args = cases.first().map(|[first, _]| first.args);
        let client = args.map_or(&[][..], |args| &args.client);
        let files = cases.iter().map(|[first, second]| {
            let command = |case: &Case<'_>| {
                let again = format!("sim run --seed {} ", case.seed);
                let command = case.command();
                command.strip_prefix(&again).unwrap_or(&command).to_owned()
            };
            Ok(PlannedFile {
                name: first.loaded.name(),
                seed: first.seed,
                digest: digest(first.loaded, first.is_live())?,
                title: first.loaded.scenario.title.clone(),
                commands: [command(first), command(second)],
            })
        });
        Ok(Self {
            program: env!("CARGO_PKG_VERSION").to_owned(),
            shards: shard.of,
            repeat: args.map_or(1, |args| args.repeat),
            client: client.iter().map(visible::name).collect(),
            client_files: client
                .iter()
                .filter_map(|word| file_digest(Path::new(word)))
                .collect(),
            set: args.map_or_else(Vec::new, |args| args.settings.set.clone()),
            files: files.collect::<Result<_, Failure>>()?,
        })
    }

    /// Number of cases.
    pub(crate) fn cases(&self) -> usize {
        self.files.len().saturating_mul(self.repeat as usize)
    }

    /// Place of a case among all.
    pub(crate) fn place(&self, file: usize, repeat: u32) -> Option<usize> {
        let is_planned = file < self.files.len() && repeat < self.repeat;
        is_planned.then(|| file * self.repeat as usize + repeat as usize)
    }

    /// The file of the case at a place, and its seed.
    pub(crate) fn at(&self, place: usize) -> (&PlannedFile, u64) {
        let repeat = self.repeat.max(1) as usize;
        let file = &self.files[place / repeat];
        (file, file.seed.wrapping_add((place % repeat) as u64))
    }

    /// Number of the shard that has the case at a place.
    pub(crate) fn owner(&self, place: usize) -> u32 {
        let (file, seed) = self.at(place);
        Shard::owner(self.shards, &file.name, &self.set, seed)
    }

    /// Name of the case at a place, as `sim run` prints it, and the command that plays it again.
    pub(crate) fn case(&self, place: usize) -> (String, String) {
        let (file, seed) = self.at(place);
        let number = seed.wrapping_sub(file.seed);
        let name = match self.repeat {
            1 => file.name.clone(),
            _ => format!("{} #{}", file.name, number + 1),
        };
        let command = &file.commands[usize::from(number > 0)];
        (name, format!("sim run --seed {seed} {command}"))
    }

    /// Returns what makes another plan of `other`, in words; `None` if nothing does.
    pub(crate) fn difference(&self, other: &Self) -> Option<String> {
        let [ours, theirs] = [self, other].map(|plan| {
            let head = Self {
                files: Vec::new(),
                ..plan.clone()
            };
            serde_json::to_value(head).unwrap_or_default()
        });
        for (part, ours) in ours.as_object()? {
            let theirs = &theirs[part];
            if ours != theirs {
                let [ours, theirs] = [ours, theirs].map(visible::json);
                return Some(format!("`{part}`: {ours} and {theirs}"));
            }
        }
        let [ours, theirs] = [self, other].map(|plan| plan.files.len());
        if ours != theirs {
            return Some(format!("the number of files: {ours} and {theirs}"));
        }
        let mut files = self.files.iter().zip(&other.files);
        let (ours, _) = files.find(|(ours, theirs)| ours != theirs)?;
        let name = &ours.name;
        Some(format!(
            "{name}, its base or world, its seed, or the settings or flags"
        ))
    }
}

/// Digest of all that a scenario is played with: the first line of a trace has it.
fn digest(loaded: &Loaded, live: bool) -> Result<String, Failure> {
    let mut run = loaded.run(RunOptions {
        live,
        trace: true,
        ..RunOptions::scripted(0)
    })?;
    let mut hasher = SipHasher13::new();
    hasher.write(run.poll_trace().unwrap_or_default().as_bytes());
    Ok(hex(&hasher))
}

fn file_digest(path: &Path) -> Option<String> {
    let size = fs::metadata(path).ok().filter(fs::Metadata::is_file)?.len();
    let mut bytes = Vec::new();
    let file = File::open(path).ok()?;
    file.take(MOST_CLIENT).read_to_end(&mut bytes).ok()?;
    let mut hasher = SipHasher13::new();
    hasher.write_u64(size);
    hasher.write(&bytes);
    Some(hex(&hasher))
}

/// A digest, in hexadecimal digits.
pub(crate) fn hex(hasher: &SipHasher13) -> String {
    format!("{:032x}", hasher.finish128().as_u128())
}
