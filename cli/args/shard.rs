//! `--shard`: the part of a campaign that one process plays.

use std::fmt;
use std::hash::Hasher as _;
use std::str::FromStr;

use siphasher::sip::SipHasher13;

use crate::visible;

/// Most shards of a campaign.
const MOST_SHARDS: u32 = 100_000;

/// Number of shards where the engine does not say it.
const SHARDS: &str = "SIM_SHARDS";

/// One of equal parts of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    /// From 1.
    pub(crate) index: u32,
    pub(crate) of: u32,
    /// The engine whose variables say so.
    pub(crate) engine: Option<&'static str>,
}

/// Reads what `--shard` says.
impl FromStr for Shard {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        if text == "auto" {
            return find(|name| std::env::var(name).ok());
        }
        let (index, of) = text
            .split_once('/')
            .ok_or("wanted: K/N with K from 1 to N, as in 3/20, or auto")?;
        let number = |text: &str| text.parse().map_err(|_| format!("`{text}` is no number"));
        Self::new(number(index)?, number(of)?, None)
    }
}

impl Shard {
    /// All of it.
    pub(crate) const WHOLE: Self = Self {
        index: 1,
        of: 1,
        engine: None,
    };

    /// # Errors
    /// When `index` is not from 1 to `of`.
    fn new(index: u64, of: u64, engine: Option<&'static str>) -> Result<Self, String> {
        let small = |number: u64| u32::try_from(number).ok().filter(|n| *n <= MOST_SHARDS);
        match (small(index), small(of)) {
            (Some(index), Some(of)) if (1..=of).contains(&index) => Ok(Self { index, of, engine }),
            (Some(_), Some(_)) => Err(format!(
                "shard {index} of {of}: shards count from 1 to {of}"
            )),
            _ => Err(format!("at most {MOST_SHARDS} shards")),
        }
    }

    /// Returns the number, from 1, of the shard that has a case. It depends on the case alone, so
    /// that a new file moves no other case.
    pub(crate) fn owner(of: u32, case: &str, set: &[String], seed: u64) -> u32 {
        let mut hasher = SipHasher13::new();
        for part in [case].into_iter().chain(set.iter().map(String::as_str)) {
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
    /// Number of shards, or of the last one.
    shards: &'static str,
    shards_is_last: bool,
}

/// Each by its own documentation.
#[rustfmt::skip]
const ENGINES: &[Engine] = &[
    Engine { name: "GitLab", index: "CI_NODE_INDEX", first: "1", step: "1", shards: "CI_NODE_TOTAL", shards_is_last: false },
    Engine { name: "CircleCI", index: "CIRCLE_NODE_INDEX", first: "0", step: "1", shards: "CIRCLE_NODE_TOTAL", shards_is_last: false },
    Engine { name: "Buildkite", index: "BUILDKITE_PARALLEL_JOB", first: "0", step: "1", shards: "BUILDKITE_PARALLEL_JOB_COUNT", shards_is_last: false },
    Engine { name: "Bazel", index: "TEST_SHARD_INDEX", first: "0", step: "1", shards: "TEST_TOTAL_SHARDS", shards_is_last: false },
    Engine { name: "Kubernetes", index: "JOB_COMPLETION_INDEX", first: "0", step: "1", shards: SHARDS, shards_is_last: false },
    Engine { name: "AWS Batch", index: "AWS_BATCH_JOB_ARRAY_INDEX", first: "0", step: "1", shards: "AWS_BATCH_JOB_ARRAY_SIZE", shards_is_last: false },
    Engine { name: "GNU parallel", index: "PARALLEL_SEQ", first: "1", step: "1", shards: SHARDS, shards_is_last: false },
    Engine { name: "Slurm", index: "SLURM_ARRAY_TASK_ID", first: "SLURM_ARRAY_TASK_MIN", step: "SLURM_ARRAY_TASK_STEP", shards: "SLURM_ARRAY_TASK_COUNT", shards_is_last: false },
    Engine { name: "Grid Engine", index: "SGE_TASK_ID", first: "SGE_TASK_FIRST", step: "SGE_TASK_STEPSIZE", shards: "SGE_TASK_LAST", shards_is_last: true },
];

/// Finds the shard that the environment names.
///
/// # Errors
/// When there is none, or two differ, or one is incomplete.
fn find(variable: impl Fn(&str) -> Option<String>) -> Result<Shard, String> {
    // What Grid Engine says to a job that is no array.
    let variable =
        |name: &str| variable(name).filter(|value| !matches!(value.as_str(), "" | "undefined"));
    let engines = ENGINES.iter().filter(|one| variable(one.index).is_some());
    let found = engines.map(|engine| engine.shard(&variable));
    let found: Vec<Shard> = found.collect::<Result<_, _>>()?;
    let Some(shard) = found.first() else {
        let names: Vec<&str> = ENGINES.iter().map(|engine| engine.index).collect();
        let names = names.join(", ");
        return Err(format!("none of {names} is set: say --shard K/N"));
    };
    let same = |one: &Shard| (one.index, one.of) == (shard.index, shard.of);
    if !found.iter().all(same) {
        let said = found
            .iter()
            .map(|one| format!("{} says shard {one}", one.engine.unwrap_or_default()));
        let said = said.collect::<Vec<_>>().join(", ");
        return Err(format!("{said}: say which with --shard K/N"));
    }
    if let Some(path) = variable("TEST_SHARD_STATUS_FILE") {
        // Bazel takes its presence for the promise that shards are known here.
        std::fs::write(&path, b"")
            .map_err(|error| format!("TEST_SHARD_STATUS_FILE {path}: {error}"))?;
    }
    Ok(*shard)
}

impl Engine {
    /// The shard that its variables name.
    fn shard(&self, variable: &impl Fn(&str) -> Option<String>) -> Result<Shard, String> {
        let number = |name: &str| {
            let is_number = name.bytes().all(|byte| byte.is_ascii_digit());
            let text = is_number.then(|| name.to_owned());
            let text = text.or_else(|| variable(name)).ok_or_else(|| {
                let what = match name == self.shards && !self.shards_is_last {
                    true => "set it to the number of shards, or say --shard K/N",
                    false => "say --shard K/N",
                };
                let (index, engine) = (self.index, self.name);
                format!("{index} is set, by {engine}, but {name} is not: {what}")
            })?;
            text.parse::<u64>()
                .map_err(|_| format!("{name} is `{}`, and not a number", visible::line(&text)))
        };
        let (index, first) = (number(self.index)?, number(self.first)?);
        let step = number(self.step)?.max(1);
        let count = match (self.shards_is_last, number(self.shards)?) {
            (false, count) => count,
            (true, last) => last.saturating_sub(first) / step + 1,
        };
        let distance = index.checked_sub(first).filter(|far| far % step == 0);
        let place = distance.map(|distance| distance / step);
        let place = place.filter(|place| *place < count).ok_or_else(|| format!(
            "{} is {index}, which is none of the {count} numbers from {first} in steps of {step}: an \
             array with gaps needs --shard K/N",
            self.index
        ))?;
        Shard::new(place + 1, count, Some(self.name))
    }
}

#[cfg(test)]
mod tests;
