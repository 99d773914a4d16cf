//! `--shard`: the part of a campaign that one process plays.

use std::fmt;

use crate::digest::digest;
use crate::visible;

/// Most shards of a campaign.
const MOST_SHARDS: u64 = 100_000;

/// One of equal parts of a campaign.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct Shard {
    /// From 1.
    pub(crate) index: u64,
    pub(crate) of: u64,
    /// The engine whose variables say so.
    pub(crate) engine: Option<&'static str>,
}

/// Reads what `--shard` says.
pub(crate) fn shard(text: &str) -> Result<Shard, String> {
    if text == "auto" {
        return find(|name| std::env::var(name).ok());
    }
    let (index, of) = text.split_once('/').unwrap_or_default();
    match (index.parse(), of.parse()) {
        (Ok(index), Ok(of)) => Shard::new(index, of, None),
        _ => Err("wanted: K/N with K from 1 to N, as in 3/20, or auto".to_owned()),
    }
}

impl Shard {
    /// The whole campaign.
    pub(crate) const WHOLE: Self = Self {
        index: 1,
        of: 1,
        engine: None,
    };

    /// # Errors
    /// When `index` is not from 1 to `of`.
    fn new(index: u64, of: u64, engine: Option<&'static str>) -> Result<Self, String> {
        if !(1..=of).contains(&index) || of > MOST_SHARDS {
            return Err(format!(
                "shard {index} of {of}: shards count from 1 to {of}, and are at most {MOST_SHARDS}"
            ));
        }
        Ok(Self { index, of, engine })
    }

    /// Returns the number, from 1, of the shard that has a case. It depends on the case alone, so
    /// that a new file moves no other case.
    pub(crate) fn owner(of: u64, case: &str, set: &[String], seed: u64) -> u64 {
        let key = format!("{case}\0{}\0{seed}", set.join("\0"));
        digest(key.as_bytes()) % of.max(1) + 1
    }
}

impl fmt::Display for Shard {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}/{}", self.index, self.of)
    }
}

/// Engines that start shards, each by its own documentation: its name, and where it says the number of the
/// shard, the number of the first, the distance of two numbers, and how many shards there are. That is a
/// variable, or the number itself.
#[rustfmt::skip]
const ENGINES: [[&str; 5]; 9] = [
    ["GitLab", "CI_NODE_INDEX", "1", "1", "CI_NODE_TOTAL"],
    ["CircleCI", "CIRCLE_NODE_INDEX", "0", "1", "CIRCLE_NODE_TOTAL"],
    ["Buildkite", "BUILDKITE_PARALLEL_JOB", "0", "1", "BUILDKITE_PARALLEL_JOB_COUNT"],
    ["Bazel", "TEST_SHARD_INDEX", "0", "1", "TEST_TOTAL_SHARDS"],
    ["Kubernetes", "JOB_COMPLETION_INDEX", "0", "1", SHARDS],
    ["AWS Batch", "AWS_BATCH_JOB_ARRAY_INDEX", "0", "1", "AWS_BATCH_JOB_ARRAY_SIZE"],
    ["GNU parallel", "PARALLEL_SEQ", "1", "1", SHARDS],
    ["Slurm", "SLURM_ARRAY_TASK_ID", "SLURM_ARRAY_TASK_MIN", "SLURM_ARRAY_TASK_STEP", "SLURM_ARRAY_TASK_COUNT"],
    ["Grid Engine", "SGE_TASK_ID", "SGE_TASK_FIRST", "SGE_TASK_STEPSIZE", LAST],
];

/// Number of shards where the engine does not say it.
const SHARDS: &str = "SIM_SHARDS";
/// Number of the last shard, where the engine says that instead.
const LAST: &str = "SGE_TASK_LAST";

/// Finds the shard that the environment names.
///
/// # Errors
/// When there is none, or two differ, or one is incomplete.
fn find(variable: impl Fn(&str) -> Option<String>) -> Result<Shard, String> {
    // What Grid Engine says to a job that is not an array.
    let variable =
        |name: &str| variable(name).filter(|value| !matches!(value.as_str(), "" | "undefined"));
    let engines = ENGINES.into_iter();
    let engines = engines.filter(|[_, index, ..]| variable(index).is_some());
    let found = engines.map(|engine| shard_of(engine, &variable));
    let found: Vec<Shard> = found.collect::<Result<_, _>>()?;
    let Some(shard) = found.first() else {
        let names = ENGINES.map(|[_, index, ..]| index).join(", ");
        return Err(format!("none of {names} is set: say --shard K/N"));
    };
    if found.iter().any(|one| one.to_string() != shard.to_string()) {
        let says = |one: &Shard| format!("{} says shard {one}", one.engine.unwrap_or_default());
        let said: Vec<String> = found.iter().map(says).collect();
        return Err(format!("{}: say which with --shard K/N", said.join(", ")));
    }
    if let Some(path) = variable("TEST_SHARD_STATUS_FILE") {
        // Bazel takes its presence for the promise that shards are known here.
        std::fs::write(&path, b"")
            .map_err(|error| format!("TEST_SHARD_STATUS_FILE {path}: {error}"))?;
    }
    Ok(*shard)
}

/// The shard that the variables of an engine name.
fn shard_of(
    [engine, index, first, step, shards]: [&'static str; 5],
    variable: &impl Fn(&str) -> Option<String>,
) -> Result<Shard, String> {
    let number = |name: &str| {
        if let Ok(number) = name.parse::<u64>() {
            return Ok(number);
        }
        let text = variable(name).ok_or_else(|| {
            format!("{index} is set, by {engine}, but {name} is not: set it, or say --shard K/N")
        })?;
        text.parse()
            .map_err(|_| format!("{name} is `{}`, and not a number", visible::line(&text)))
    };
    let (at, first, step) = (number(index)?, number(first)?, number(step)?.max(1));
    let count = match (number(shards)?, shards) {
        (last, LAST) => last.saturating_sub(first) / step + 1,
        (count, _) => count,
    };
    let distance = at.checked_sub(first);
    let distance = distance.filter(|far| far % step == 0 && far / step < count);
    let distance = distance.ok_or_else(|| format!(
        "{index} is {at}, which is none of the {count} numbers from {first} in steps of {step}: an array with \
         gaps needs --shard K/N"
    ))?;
    Shard::new(distance / step + 1, count, Some(engine))
}

#[cfg(test)]
mod tests;
