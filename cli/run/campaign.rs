//! Campaigns: many cases, played by many processes, and put together afterwards.
//!
//! The engine that starts the processes is the user's. Each process plays the shard that it is, and
//! keeps its results in a folder; `sim merge` reads the folders.

mod merged;
mod outputs;
mod plan;
mod results;

use anyhow::{Context as _, anyhow};

use crate::args::MergeArgs;
use crate::exit::{Exit, Failure};
use crate::print::{complain, print};
use crate::visible;

use merged::Merged;
use outputs::Outputs;

pub(crate) use plan::Plan;
pub(crate) use results::{Results, signature};

/// The `merge` subcommand.
pub(crate) fn merge(args: &MergeArgs) -> Result<Exit, Failure> {
    let outputs = Outputs::find(args)?;
    let mut paths = Vec::new();
    for folder in &args.folders {
        let inside = results::files(folder)
            .with_context(|| format!("cannot read the folder {}", visible::name(folder)))
            .map_err(Failure::usage)?;
        paths.extend(inside);
    }
    let Some(merged) = Merged::read(&paths) else {
        let folders: Vec<String> = args.folders.iter().map(visible::name).collect();
        let why = anyhow!("there are no results in {}", folders.join(" and "));
        return Err(Failure::system(why));
    };
    let missing = merged.missing();
    let is_whole = missing.is_empty() && merged.refused.is_empty();
    // Whatever a torn file lacks is there if nothing is missing.
    let torn = merged.torn.iter().filter(|_| !missing.is_empty());
    merged
        .refused
        .iter()
        .chain(torn)
        .for_each(|line| complain(line));
    for line in merged.missing_by_shard(&missing) {
        complain(&line);
    }
    if !(is_whole || args.partial && merged.refused.is_empty()) {
        let hint = match merged.refused.is_empty() {
            true => {
                "; play the missing ones with the same command, or see what is known with --partial"
            }
            false => "",
        };
        return Err(Failure::system(anyhow!("the results are not whole{hint}")));
    }
    let summary = merged.summary(missing.len());
    outputs.write(&summary)?;
    print(&summary.to_string())?;
    Ok(if is_whole {
        summary.exit()
    } else {
        Exit::System
    })
}
