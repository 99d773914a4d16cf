//! The engines that start shards, and the variables by which each says which shard a process is.

use super::shard::Shard;

/// Number of shards where the engine does not say it.
const SHARDS: &str = "SIM_SHARDS";

/// An engine.
struct Engine {
    name: &'static str,
    /// Variable with the number of the shard.
    index: &'static str,
    first: First,
    /// Variable with the distance between the numbers of two shards, where that is not always 1.
    step: Option<&'static str>,
    count: Count,
}

/// Number of the first shard.
enum First {
    Is(u64),
    In(&'static str),
}

/// Number of shards.
enum Count {
    In(&'static str),
    /// From the number of the last one.
    Last(&'static str),
}

const fn plain(name: &'static str, index: &'static str, first: u64, count: &'static str) -> Engine {
    Engine {
        name,
        index,
        first: First::Is(first),
        step: None,
        count: Count::In(count),
    }
}

/// Each by its own documentation.
const ENGINES: &[Engine] = &[
    plain("GitLab", "CI_NODE_INDEX", 1, "CI_NODE_TOTAL"),
    plain("CircleCI", "CIRCLE_NODE_INDEX", 0, "CIRCLE_NODE_TOTAL"),
    plain(
        "Buildkite",
        "BUILDKITE_PARALLEL_JOB",
        0,
        "BUILDKITE_PARALLEL_JOB_COUNT",
    ),
    plain("Bazel", "TEST_SHARD_INDEX", 0, "TEST_TOTAL_SHARDS"),
    plain("Kubernetes", "JOB_COMPLETION_INDEX", 0, SHARDS),
    plain(
        "AWS Batch",
        "AWS_BATCH_JOB_ARRAY_INDEX",
        0,
        "AWS_BATCH_JOB_ARRAY_SIZE",
    ),
    plain("GNU parallel", "PARALLEL_SEQ", 1, SHARDS),
    Engine {
        name: "Slurm",
        index: "SLURM_ARRAY_TASK_ID",
        first: First::In("SLURM_ARRAY_TASK_MIN"),
        step: Some("SLURM_ARRAY_TASK_STEP"),
        count: Count::In("SLURM_ARRAY_TASK_COUNT"),
    },
    Engine {
        name: "Grid Engine",
        index: "SGE_TASK_ID",
        first: First::In("SGE_TASK_FIRST"),
        step: Some("SGE_TASK_STEPSIZE"),
        count: Count::Last("SGE_TASK_LAST"),
    },
];

/// Finds the shard that the environment names, and the engine that does.
///
/// # Errors
/// When there is none, or two differ, or one is incomplete.
pub(crate) fn find(
    variable: impl Fn(&str) -> Option<String>,
) -> Result<(Shard, &'static str), String> {
    // What Grid Engine says to a job that is no array.
    let variable =
        |name: &str| variable(name).filter(|value| !matches!(value.as_str(), "" | "undefined"));
    let mut found: Option<(Shard, &Engine)> = None;
    for engine in ENGINES {
        let Some(shard) = engine.shard(&variable)? else {
            continue;
        };
        match found {
            Some((other, first)) if other != shard => {
                return Err(format!(
                    "{} says shard {other} ({}), {} says {shard} ({}): say which with --shard K/N",
                    first.name, first.index, engine.name, engine.index
                ));
            }
            Some(_) => {}
            None => found = Some((shard, engine)),
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
    /// The shard that its variables name; `None` if they do not.
    fn shard(&self, variable: &impl Fn(&str) -> Option<String>) -> Result<Option<Shard>, String> {
        let Some(index) = variable(self.index) else {
            return Ok(None);
        };
        let read = |name: &str, text: String| {
            let number = text.parse::<u64>();
            number.map_err(|_| {
                format!(
                    "{name} is `{}`, and not a number",
                    crate::visible::line(&text)
                )
            })
        };
        let number = |name: &str| match variable(name) {
            Some(text) => read(name, text),
            None => Err(format!(
                "{} is set, by {}, but {name} is not: set it to the number of shards, or say --shard K/N",
                self.index, self.name
            )),
        };
        let index = read(self.index, index)?;
        let first = match self.first {
            First::Is(first) => first,
            First::In(name) => number(name)?,
        };
        let step = self.step.map_or(Ok(1), number)?.max(1);
        let count = match self.count {
            Count::In(name) => number(name)?,
            Count::Last(name) => number(name)?.saturating_sub(first) / step + 1,
        };
        let from_first = index
            .checked_sub(first)
            .filter(|distance| distance % step == 0);
        let place = from_first.map(|distance| distance / step);
        match place.filter(|place| *place < count) {
            Some(place) => Shard::new(place + 1, count).map(Some),
            None => Err(format!(
                "{} is {index}, which is none of the {count} numbers from {first} in steps of {step}: an \
                 array with gaps needs --shard K/N",
                self.index
            )),
        }
    }
}

#[cfg(test)]
mod tests;
