//! `--shard`: the part of a campaign that one process plays.

use std::fmt;
use std::hash::Hasher as _;
use std::str::FromStr;

use anyhow::anyhow;
use siphasher::sip::SipHasher13;

use crate::exit::Failure;
use crate::visible;

/// Most shards of a campaign.
const MOST_SHARDS: u32 = 100_000;

/// Number of shards where the engine does not say it.
const SHARDS: &str = "SIM_SHARDS";

/// What `--shard` says.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum ShardArg {
    /// The variables of the engine say it.
    Auto,
    Given(Shard),
}

impl FromStr for ShardArg {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return Ok(Self::Auto);
        }
        let (index, of) = text
            .split_once('/')
            .ok_or("wanted: K/N with K from 1 to N, as in 3/20, or auto")?;
        let number = |text: &str| text.parse().map_err(|_| format!("`{text}` is no number"));
        Shard::new(number(index)?, number(of)?).map(Self::Given)
    }
}

impl ShardArg {
    /// Returns the shard that this process is, and the engine whose variables said so.
    ///
    /// # Errors
    /// When no engine, two that differ, or half of one is found.
    pub(crate) fn find(self) -> Result<(Shard, Option<&'static str>), Failure> {
        match self {
            Self::Given(shard) => Ok((shard, None)),
            Self::Auto => find(|name| std::env::var(name).ok())
                .map(|(shard, engine)| (shard, Some(engine)))
                .map_err(|why| Failure::usage(anyhow!("--shard auto: {why}"))),
        }
    }
}

/// One of equal parts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    /// From 1.
    pub(crate) index: u32,
    pub(crate) of: u32,
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self { index: 1, of: 1 };

    /// # Errors
    /// When `index` is not from 1 to `of`.
    fn new(index: u64, of: u64) -> Result<Self, String> {
        let small = |number: u64| u32::try_from(number).ok().filter(|n| *n <= MOST_SHARDS);
        let (Some(index), Some(of)) = (small(index), small(of)) else {
            return Err(format!("at most {MOST_SHARDS} shards"));
        };
        if index == 0 || index > of {
            return Err(format!(
                "shard {index} of {of}: shards count from 1 to {of}"
            ));
        }
        Ok(Self { index, of })
    }

    /// Returns the number, from 1, of the shard that has a case. It depends on the case alone, so
    /// that a new file moves no other case.
    pub(crate) fn owner(
        of: u32,
        file: &str,
        parameters: &[(String, String)],
        set: &[String],
        seed: u64,
    ) -> u32 {
        let mut hasher = SipHasher13::new();
        let pairs = parameters.iter().flat_map(|(name, value)| [name, value]);
        let parts = pairs.map(String::as_str).chain([""]);
        let set = set.iter().map(String::as_str);
        for part in [file].into_iter().chain(parts).chain(set) {
            hasher.write(part.as_bytes());
            hasher.write_u8(0);
        }
        hasher.write(&seed.to_le_bytes());
        let place = hasher.finish() % u64::from(of);
        u32::try_from(place).unwrap_or_default() + 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// An engine that starts shards: each number is a variable, or the number itself.
struct Engine {
    name: &'static str,
    /// Number of the shard.
    index: &'static str,
    /// Number of the first shard.
    first: &'static str,
    /// Distance between the numbers of two shards.
    step: &'static str,
    shards: Shards,
}

/// Number of shards, or of the last one.
enum Shards {
    Are(&'static str),
    UpTo(&'static str),
}

use Shards::{Are, UpTo};

/// Each by its own documentation.
#[rustfmt::skip]
const ENGINES: &[Engine] = &[
    Engine { name: "GitLab", index: "CI_NODE_INDEX", first: "1", step: "1", shards: Are("CI_NODE_TOTAL") },
    Engine { name: "CircleCI", index: "CIRCLE_NODE_INDEX", first: "0", step: "1", shards: Are("CIRCLE_NODE_TOTAL") },
    Engine { name: "Buildkite", index: "BUILDKITE_PARALLEL_JOB", first: "0", step: "1", shards: Are("BUILDKITE_PARALLEL_JOB_COUNT") },
    Engine { name: "Bazel", index: "TEST_SHARD_INDEX", first: "0", step: "1", shards: Are("TEST_TOTAL_SHARDS") },
    Engine { name: "Kubernetes", index: "JOB_COMPLETION_INDEX", first: "0", step: "1", shards: Are(SHARDS) },
    Engine { name: "AWS Batch", index: "AWS_BATCH_JOB_ARRAY_INDEX", first: "0", step: "1", shards: Are("AWS_BATCH_JOB_ARRAY_SIZE") },
    Engine { name: "GNU parallel", index: "PARALLEL_SEQ", first: "1", step: "1", shards: Are(SHARDS) },
    Engine { name: "Slurm", index: "SLURM_ARRAY_TASK_ID", first: "SLURM_ARRAY_TASK_MIN", step: "SLURM_ARRAY_TASK_STEP", shards: Are("SLURM_ARRAY_TASK_COUNT") },
    Engine { name: "Grid Engine", index: "SGE_TASK_ID", first: "SGE_TASK_FIRST", step: "SGE_TASK_STEPSIZE", shards: UpTo("SGE_TASK_LAST") },
];

/// Finds the shard that the environment names, and the engine that does.
///
/// # Errors
/// When there is none, or two differ, or one is incomplete.
fn find(variable: impl Fn(&str) -> Option<String>) -> Result<(Shard, &'static str), String> {
    // What Grid Engine says to a job that is no array.
    let variable =
        |name: &str| variable(name).filter(|value| !matches!(value.as_str(), "" | "undefined"));
    let mut found: Option<(Shard, &Engine)> = None;
    for engine in ENGINES.iter().filter(|one| variable(one.index).is_some()) {
        let shard = engine.shard(&variable)?;
        match found {
            Some((other, first)) if other != shard => {
                return Err(format!(
                    "{} says shard {other} ({}), {} says {shard} ({}): say which with --shard K/N",
                    first.name, first.index, engine.name, engine.index
                ));
            }
            _ => found = found.or(Some((shard, engine))),
        }
    }
    let (shard, engine) = found.ok_or_else(|| {
        let names: Vec<&str> = ENGINES.iter().map(|engine| engine.index).collect();
        format!("none of {} is set: say --shard K/N", names.join(", "))
    })?;
    if let Some(path) = variable("TEST_SHARD_STATUS_FILE") {
        // Bazel takes its presence for the promise that shards are known here.
        std::fs::write(&path, b"")
            .map_err(|error| format!("TEST_SHARD_STATUS_FILE {path}: {error}"))?;
    }
    Ok((shard, engine.name))
}

impl Engine {
    /// The shard that its variables name.
    fn shard(&self, variable: &impl Fn(&str) -> Option<String>) -> Result<Shard, String> {
        let number = |name: &'static str| {
            let is_number = name.starts_with(|first: char| first.is_ascii_digit());
            let text = if is_number {
                Some(name.to_owned())
            } else {
                variable(name)
            };
            let text = text.ok_or_else(|| format!(
                "{} is set, by {}, but {name} is not: set it to the number of shards, or say --shard K/N",
                self.index, self.name
            ))?;
            text.parse::<u64>()
                .map_err(|_| format!("{name} is `{}`, and not a number", visible::line(&text)))
        };
        let (index, first) = (number(self.index)?, number(self.first)?);
        let step = number(self.step)?.max(1);
        let count = match self.shards {
            Are(name) => number(name)?,
            UpTo(name) => number(name)?.saturating_sub(first) / step + 1,
        };
        let distance = index
            .checked_sub(first)
            .filter(|distance| distance % step == 0);
        let place = distance.map(|distance| distance / step);
        let place = place.filter(|place| *place < count).ok_or_else(|| format!(
            "{} is {index}, which is none of the {count} numbers from {first} in steps of {step}: an \
             array with gaps needs --shard K/N",
            self.index
        ))?;
        Shard::new(place + 1, count)
    }
}

#[cfg(test)]
mod tests;
