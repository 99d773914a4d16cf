//! Campaigns: many cases, played by many processes, and put together afterwards.
//!
//! The engine that starts the processes is the user's. Each process plays the shard that it is, and
//! keeps its results in a folder; `sim merge` reads the folders.

mod merged;
mod outputs;
mod plan;
mod results;

use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};

use crate::args::{MergeArgs, Shard};
use crate::exit::{Exit, Failure};
use crate::print::{complain, print};
use crate::run::case::Verdict;
use crate::visible;

use merged::Merged;

pub(crate) use plan::Plan;
pub(crate) use results::{Results, signature};

/// Begins another attempt of a shard in a folder. Returns also the verdicts of the plan's cases that have one.
///
/// # Errors
/// When the folder has results of another plan, or cannot be read or written.
pub(crate) fn resume(
    folder: &Path,
    shard: Shard,
    plan: &Plan,
) -> Result<(Results, Vec<Option<Verdict>>), Failure> {
    let paths = match folder.exists() {
        true => files_in(folder)?,
        false => Vec::new(),
    };
    // A file that ends before its first line has nothing to be taken over.
    let Some(earlier) = Merged::read(&paths, Some(shard.index)) else {
        let results = Results::begin(folder, shard, plan)?;
        return Ok((results, vec![None; plan.cases()]));
    };
    if let Some(what) = plan.difference(&earlier.plan) {
        let folder = visible::name(folder);
        return Err(Failure::usage(anyhow!(
            "{folder} has results of another plan. They differ in {what}. Take an empty folder, or remove \
             this one"
        )));
    }
    if !earlier.refused.is_empty() {
        return Err(Failure::usage(anyhow!(earlier.refused.join("\n"))));
    }
    let results = Results::begin(folder, shard, plan)?;
    Ok((results, earlier.verdicts()))
}

fn files_in(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    results::files(folder)
        .with_context(|| format!("cannot read the folder {}", visible::name(folder)))
        .map_err(Failure::usage)
}

/// The `merge` subcommand.
pub(crate) fn merge(args: &MergeArgs) -> Result<Exit, Failure> {
    let mut paths = Vec::new();
    for folder in &args.folders {
        paths.extend(files_in(folder)?);
    }
    let Some(merged) = Merged::read(&paths, None) else {
        let folders: Vec<String> = args.folders.iter().map(visible::name).collect();
        let why = anyhow!("there are no results in {}", folders.join(" and "));
        return Err(Failure::system(why));
    };
    let summary = merged.summary();
    let is_refused = !merged.refused.is_empty();
    let is_whole = summary.missing == 0 && !is_refused;
    // Whatever a torn file lacks is there if nothing is missing.
    let torn = merged.torn.iter().filter(|_| summary.missing > 0);
    let refused = merged.refused.iter();
    refused.chain(torn).for_each(|line| complain(line));
    if is_whole || args.partial && !is_refused {
        summary.write(args)?;
        print(&summary.to_string())?;
        return Ok(if is_whole {
            summary.exit()
        } else {
            Exit::System
        });
    }
    for finding in summary.findings.iter().filter(|one| one.kind == "missing") {
        complain(&finding.what);
    }
    let hint = match is_refused {
        false => {
            "; play the missing ones with the same command, or see what is known with --partial"
        }
        true => "",
    };
    Err(Failure::system(anyhow!("the results are incomplete{hint}")))
}
