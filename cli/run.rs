//! The `run` and `check` subcommands: scenarios, played and judged.

mod job;
mod junit;
mod live;
mod pool;
mod report;
mod scripted;
mod tell;
mod trace_file;

use std::collections::BTreeMap;
use std::fs;
use std::io::IsTerminal as _;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};

use crate::args::RunArgs;
use crate::exit::{Exit, Failure};
use crate::print::print;
use crate::report::Report;
use crate::scenario_files::{Loaded, find, load_all};
use crate::start::random_seed;
use crate::supervise::adopt_orphans;

pub(crate) use job::{Job, JobResult, Played as PlayedCase};
pub(crate) use tell::{client_report, verdict_json, verdict_text, worth};

/// The `run` subcommand.
pub(crate) fn run(args: &RunArgs) -> Result<Exit, Failure> {
    let mut loaded = load_all(&find(&args.files, args.filter.as_deref())?)?;
    if !args.tag.is_empty() {
        loaded.retain(|one| one.scenario.tags.iter().any(|tag| args.tag.contains(tag)));
    }
    if loaded.is_empty() {
        return Err(Failure::usage(anyhow!(
            "no scenario there has the tag {}: nothing to run",
            args.tag.join(" or ")
        )));
    }
    if args.list {
        let text: Vec<String> = loaded.iter().map(tell::listed).collect();
        return print(&text.join("\n"));
    }
    if args.client.is_empty() && args.speed.is_some() {
        return Err(Failure::usage(anyhow!(
            "--speed is for runs with a client; without one there is no real time, and a scenario \
             takes as long as the machine needs"
        )));
    }
    if args.output.is_some() || args.report.is_some() {
        refuse_shared_files(&loaded)?;
    }
    let base = random_seed();
    let mut jobs: Vec<Job> = loaded
        .iter()
        .flat_map(|one| (0..args.repeat).map(move |repeat| Job::new(args, one, repeat, base)))
        .collect();
    if args.dry_run {
        let text: Vec<String> = jobs.iter().map(tell::planned).collect();
        return print(&text.join("\n"));
    }
    prepare(args)?;
    let report = args.report.as_deref().map(Report::begin).transpose()?;
    for job in &mut jobs {
        job.report = report.as_ref();
    }
    adopt_orphans().map_err(Failure::system)?;
    let progress = progress(jobs.len());
    let results = pool::play_all(args, &jobs, |job, result| {
        let text = tell::told(args, job, result);
        progress.suspend(|| print(&text))?;
        progress.inc(1);
        Ok(())
    });
    progress.finish_and_clear();
    let (results, wrong) = results?;
    let exit = finish(&results);
    // Also when the run was broken off.
    if let Some(path) = &args.junit {
        junit::write(path, &jobs, &results)?;
    }
    if let Some(report) = &report {
        report.write(&jobs, &results)?;
    }
    let exit = exit?;
    wrong.map_or(Ok(exit), Err)
}

/// The `check` subcommand: reads the files and plays nothing.
pub(crate) fn check(files: &[PathBuf]) -> Result<Exit, Failure> {
    let loaded = load_all(&find(files, None)?)?;
    print(&match loaded.len() {
        1 => "1 scenario is well-formed".to_owned(),
        count => format!("{count} scenarios are well-formed"),
    })
}

/// Refuses scenarios whose traces and reports would have the same name.
fn refuse_shared_files(loaded: &[Loaded]) -> Result<(), Failure> {
    let mut stems = BTreeMap::new();
    for one in loaded {
        if let Some(other) = stems.insert(one.stem(), &one.path) {
            return Err(Failure::usage(anyhow!(
                "{} and {} would write the same files for --output or --report; rename one, or run them \
                 apart",
                other.display(),
                one.path.display()
            )));
        }
    }
    Ok(())
}

/// Finds out now, and not when all has been played, whether results can be written.
fn prepare(args: &RunArgs) -> Result<(), Failure> {
    let folder = |path: &std::path::Path| {
        fs::create_dir_all(path)
            .with_context(|| format!("cannot make the folder {}", path.display()))
            .map_err(Failure::usage)
    };
    if let Some(output) = &args.output {
        folder(output)?;
        tempfile::tempfile_in(output)
            .with_context(|| format!("cannot write into the folder {}", output.display()))
            .map_err(Failure::usage)?;
    }
    if let Some(junit) = &args.junit {
        if let Some(parent) = junit.parent().filter(|p| !p.as_os_str().is_empty()) {
            folder(parent)?;
        }
        // Emptied, lest the results of a former run be taken for this one's if it is killed.
        fs::File::create(junit)
            .with_context(|| format!("cannot write {}", junit.display()))
            .map_err(Failure::usage)?;
    }
    Ok(())
}

/// A bar on a terminal, and nothing elsewhere.
fn progress(count: usize) -> indicatif::ProgressBar {
    if !std::io::stderr().is_terminal() || count < 2 {
        return indicatif::ProgressBar::hidden();
    }
    let bar = indicatif::ProgressBar::new(count as u64);
    if let Ok(style) =
        indicatif::ProgressStyle::with_template("{bar:30} {pos}/{len} scenarios, {elapsed}")
    {
        bar.set_style(style);
    }
    bar.enable_steady_tick(std::time::Duration::from_millis(500));
    bar
}

/// The last line, and the exit code.
fn finish(results: &[Option<JobResult>]) -> Result<Exit, Failure> {
    let count = |is: fn(&JobResult) -> bool| results.iter().flatten().filter(|r| is(r)).count();
    let passed = count(JobResult::passed);
    let broken = count(|result| matches!(result, JobResult::Broken(_)));
    let failed = count(|result| matches!(result, JobResult::Played(_))) - passed;
    let broken_off = count(|result| matches!(result, JobResult::BrokenOff));
    let skipped = results.len() - passed - failed - broken - broken_off;
    let mut text = format!("{passed} passed, {failed} failed, {skipped} skipped");
    if broken > 0 {
        text += &format!(", {broken} could not be played");
    }
    if broken_off > 0 {
        text += &format!(", {broken_off} broken off");
    }
    print(&text)?;
    Ok(if broken > 0 || broken_off > 0 {
        Exit::System
    } else if failed > 0 {
        Exit::Failed
    } else {
        Exit::Clean
    })
}
