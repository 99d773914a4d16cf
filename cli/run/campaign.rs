//! Campaigns: many cases, played by many processes, and put together afterwards.
//!
//! The engine that starts the processes is the user's. Each process plays the shard that it is, and
//! keeps its results in a folder; `sim merge` reads the folders.

mod merged;
mod outputs;
mod plan;
mod results;

use std::fs;
use std::path::Path;

use anyhow::{Context as _, anyhow};

use crate::args::{MergeArgs, Shard};
use crate::exit::{Exit, Failure, refuse};
use crate::print::{OutputFile, complain, print, refuse_same_file};
use crate::run::case::Verdict;
use crate::run::{junit, page};
use crate::visible;

use merged::Merged;

pub(crate) use plan::Plan;
pub(crate) use results::Results;

/// Of each case of a plan the verdict, if it has one, and what failed.
pub(crate) type Known = Vec<Option<(Verdict, String)>>;

/// Begins another attempt of a shard in a folder. Returns also what is known.
///
/// # Errors
/// When the folder has results of another plan, or cannot be read or written.
pub(crate) fn resume(folder: &Path, shard: Shard, plan: Plan) -> Result<(Results, Known), Failure> {
    let paths = fs::create_dir_all(folder).and_then(|()| results::files(folder));
    let paths = paths
        .with_context(|| format!("cannot keep results in {}", visible::name(folder)))
        .map_err(Failure::usage)?;
    let earlier = Merged::read(&paths, Some((&plan, shard.index)));
    if !earlier.refused.is_empty() {
        let (why, folder) = (earlier.refused.join("\n"), visible::name(folder));
        refuse!("{why}\nTake another folder than {folder}, or remove it");
    }
    Ok((Results::begin(folder, shard, plan)?, earlier.verdicts()))
}

/// The `merge` subcommand.
pub(crate) fn merge(args: &MergeArgs) -> Result<Exit, Failure> {
    let mut paths = Vec::new();
    for folder in &args.folders {
        let found = results::files(folder)
            .with_context(|| format!("cannot read the folder {}", visible::name(folder)));
        paths.extend(found.map_err(Failure::usage)?);
    }
    let outputs: [(_, _, &[_]); 3] = [
        ("--junit", &args.junit, junit::MARKS),
        ("--report", &args.report, page::MARKS),
        ("--json", &args.json, &["\"sim_merge\""]),
    ];
    refuse_same_file(outputs.map(|(flag, path, _)| (flag, path)))?;
    let found = outputs.map(|(_, path, marks)| {
        let found = path.as_deref().map(|path| OutputFile::find(path, marks));
        found.transpose()
    });
    let files: Vec<_> = found.into_iter().collect::<Result<_, _>>()?;
    // What an earlier merge found says nothing of this one.
    for file in files.iter().flatten() {
        file.clear()?;
    }
    let mut merged = Merged::read(&paths, None);
    merged.refused.iter().for_each(|why| complain(why));
    if !merged.refused.is_empty() || merged.first.is_empty() {
        let folders: Vec<String> = args.folders.iter().map(visible::name).collect();
        let why = anyhow!("{} has no results of one campaign", folders.join(" and "));
        return Err(Failure::system(why));
    }
    if merged.name_missing() {
        // Otherwise whatever a torn file lacks is there.
        merged.torn.iter().for_each(|file| complain(file));
        if !args.partial {
            complain(&merged.text(true));
            return Err(Failure::system(anyhow!(
                "the results are incomplete; play the missing ones with the same command, or see what is \
                 known with --partial"
            )));
        }
    }
    let junit = merged.junit().map_err(Failure::system)?;
    for (file, text) in files.iter().zip([junit, merged.page(), merged.json()]) {
        file.as_ref().map_or(Ok(()), |file| file.write(&text))?;
    }
    print(&merged.text(false))?;
    Ok(merged.exit())
}
