//! The `run` and `check` subcommands: scenarios, played and judged.

mod campaign;
mod case;
mod folder;
mod json;
mod junit;
mod live;
mod lockstep;
mod page;
mod play;
mod pool;
mod tell;
mod twice;
mod view;

use std::collections::BTreeMap;
use std::collections::hash_map::RandomState;
use std::fs;
use std::hash::{BuildHasher as _, Hasher as _};
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use rigsim_core::device::Devices;
use rigsim_core::settings::SimSettings;
use rigsim_pty::ExitOnSignals;
use rigsim_pty::paths::Held;
use rigsim_runner::Scenario;

use crate::args::{ExitArg, GivenArgs, RunArgs, Shard, TimeArg};
use crate::config;
use crate::exit::{Exit, Failure, refuse};
use crate::print::{complain, print, progress, refuse_same_file};
use crate::scenario_files::{Given, Loaded, find, load_all};
use crate::supervise::adopt_orphans;
use crate::visible;

use campaign::{Known, Results};
use junit::{Earlier, Junit};
use page::Page;
use view::View;

pub(crate) use campaign::{Plan, merge};
pub(crate) use case::{Case, CaseResult, Played, Verdict};
pub(crate) use folder::scratch;
pub(crate) use json::verdict as verdict_json;
pub(crate) use live::NO_PORT_OPENED;
pub(crate) use page::{
    MARKS as REPORT_MARKS, about as about_page, case_in_full, document as report_page,
};
pub(crate) use pool::{play_quietly, stop_by_signals};
pub(crate) use tell::written as client_output;
pub(crate) use twice::{DIFFERS, play as play_twice};
pub(crate) use view::signature;

/// The `run` subcommand.
pub(crate) fn run(devices: Devices, args: &RunArgs) -> Result<Exit, Failure> {
    let settings = config::load_file(devices, &args.settings)?;
    let given = Given::new(settings, &args.given, &args.settings.set)?;
    // Reading has nothing to end in order.
    let exit_on_signals = ExitOnSignals::with(Exit::System as i32).map_err(Failure::system)?;
    let mut loaded = load_all(&given, &find(&args.files, args.filter.as_deref())?)?;
    let stop = stop_by_signals()?;
    drop(exit_on_signals);
    if !args.tag.is_empty() {
        loaded.retain(|one| {
            // What could not be read may have the tag.
            one.broken.is_some() || one.scenario.tags.iter().any(|tag| args.tag.contains(tag))
        });
    }
    if loaded.is_empty() {
        refuse!(
            "no scenario there has the tag {}: nothing to run",
            args.tag.join(" or ")
        );
    }
    if args.list {
        let text: Vec<String> = loaded.iter().map(tell::listed).collect();
        return print(&text.join("\n"));
    }
    check_client(args)?;
    check_time(args)?;
    if args.output.is_some() || args.report.is_some() {
        refuse_shared_files(&loaded)?;
    }
    let (mut cases, shard) = cases(args, &loaded);
    if args.dry_run {
        let text: Vec<String> = cases.iter().map(tell::planned).collect();
        return print(&text.join("\n"));
    }
    prepare(args)?;
    folder::sweep();
    let page = args.report.as_deref();
    let page = page
        .map(|path| Page::begin(devices, path, args))
        .transpose()?;
    let mut counts = Counts {
        all: cases.len(),
        of: BTreeMap::new(),
    };
    let mut earlier = Vec::new();
    let results = match &args.results {
        Some(folder) => {
            let plan = Plan::new(args, shard.of, &loaded)?;
            let (results, known) = campaign::resume(folder, shard, plan)?;
            earlier = leave_out_known(&mut cases, known, &mut counts);
            Some(results)
        }
        None => None,
    };
    let scratch = (page.is_some() || results.is_some()).then(folder::scratch);
    let scratch = scratch.transpose().map_err(Failure::system)?;
    let folder = scratch.as_ref().map(|folder| folder.path().to_owned());
    for case in &mut cases {
        case.scratch = folder.as_deref();
    }
    let junit = args.junit.as_deref();
    let mut audience = Audience {
        cases: &cases,
        counts,
        progress: progress(
            cases.len() as u64,
            "{bar:30} {pos}/{len} scenarios, {elapsed}",
        ),
        junit: junit
            .map(|path| Junit::begin(path, &cases, earlier))
            .transpose()?,
        page: page.as_ref(),
        results,
        scratch,
    };
    adopt_orphans().map_err(Failure::system)?;
    let wrong = pool::play_all(args, &cases, &mut audience, &stop);
    audience.progress.finish_and_clear();
    let wrong = wrong?;
    let exit = audience.counts.finish();
    // Also of an aborted run.
    audience.results.as_mut().map_or(Ok(()), Results::flush)?;
    audience.junit.map_or(Ok(()), Junit::finish)?;
    if let Some(page) = &page {
        page.write(&cases, audience.counts.exit() == Exit::Clean)?;
    }
    let exit = match exit? {
        Exit::Failed if args.exit == ExitArg::Complete => Exit::Clean,
        exit => exit,
    };
    wrong.map_or(Ok(exit), Err)
}

/// The cases of this shard.
fn cases<'a>(args: &'a RunArgs, loaded: &'a [Loaded]) -> (Vec<Case<'a>>, Shard) {
    let shard = args.shard.unwrap_or(Shard::WHOLE);
    let is_campaign = args.shard.is_some() || args.results.is_some();
    // Two shards know the same case by its seed.
    let base = if is_campaign { 1 } else { random_seed() };
    let mut cases = Vec::new();
    for (file, one) in loaded.iter().enumerate() {
        let name = one.name();
        let case = |repeat| Case {
            number: file * args.repeat as usize + repeat as usize,
            ..Case::new(args, one, repeat, base)
        };
        let is_ours = |case: &Case<'_>| {
            Shard::owner(shard.of, &name, &args.settings.set, case.seed) == shard.index
        };
        cases.extend((0..args.repeat).map(case).filter(is_ours));
    }
    if args.shard.is_some() {
        let all = loaded.len() * args.repeat as usize;
        let by = shard.engine;
        let by = by.map_or(String::new(), |engine| format!(", as {engine} says"));
        complain(&format!(
            "shard {shard}{by}: {} of {all} cases",
            cases.len()
        ));
    }
    (cases, shard)
}

/// Takes out the cases whose verdicts are known. They count: a shard that failed and is started again
/// has still failed.
fn leave_out_known<'a>(
    cases: &mut Vec<Case<'a>>,
    mut known: Known,
    counts: &mut Counts,
) -> Vec<Earlier<'a>> {
    let mut earlier = Vec::new();
    for case in std::mem::take(cases) {
        match known[case.number].take() {
            Some((verdict, what)) => {
                counts.add(verdict);
                earlier.push((case, verdict, what));
            }
            None => cases.push(case),
        }
    }
    if !earlier.is_empty() {
        complain(&format!("{} cases have a verdict already", earlier.len()));
    }
    earlier
}

/// Refuses `--` with nothing behind it: otherwise the scripts pass where the variable of a build that names the
/// client is empty.
fn check_client(args: &RunArgs) -> Result<(), Failure> {
    let last = std::env::args_os().next_back();
    if args.client.is_empty() && last.is_some_and(|last| last == "--") {
        refuse!("no client stands behind `--`; leave `--` out to play the scripts in the files");
    }
    Ok(())
}

/// Refuses flags that the time of the run has no use for.
fn check_time(args: &RunArgs) -> Result<(), Failure> {
    let is_real = !args.client.is_empty() && args.time == TimeArg::Real;
    let is_lockstep = !args.client.is_empty() && args.time == TimeArg::Lockstep;
    if args.speed.is_some() && !is_real {
        refuse!(
            "--speed is for a client with --time real; in simulated time a scenario takes as long as \
             the machine needs"
        );
    }
    if args.twice && !is_lockstep {
        refuse!("--twice is for a client with --time lockstep, whose runs are the same each time");
    }
    Ok(())
}

/// Prints results, counts them, and keeps them for the JUnit file and the page.
struct Audience<'a> {
    cases: &'a [Case<'a>],
    counts: Counts,
    progress: indicatif::ProgressBar,
    junit: Option<Junit<'a>>,
    page: Option<&'a Page>,
    results: Option<Results>,
    /// Folder of recordings that only the page or the results need.
    scratch: Option<Held>,
}

impl Audience<'_> {
    /// A case has a result; they come as they come.
    fn known(&mut self, index: usize, result: &CaseResult) -> Result<(), Failure> {
        self.counts.add(result.verdict);
        let case = &self.cases[index];
        if let Some(page) = self.page {
            page.known(index, case, result);
        }
        if let Some(results) = &mut self.results {
            results.known(case, result)?;
        }
        let has_use = self.results.is_some() && result.failed().is_some();
        if let Some(trace) = case.scratch_recording().filter(|_| !has_use) {
            // A thousand of them need not be there at a time. Of a case that was not played there is none.
            let _ = fs::remove_file(trace);
        }
        match &mut self.junit {
            Some(junit) => junit.known(index, result),
            None => Ok(()),
        }
    }

    /// Nothing has come for a moment.
    fn idle(&mut self) -> Result<(), Failure> {
        // Without its own thread, which the system may refuse.
        self.progress.tick();
        self.results.as_mut().map_or(Ok(()), Results::catch_up)?;
        self.junit.as_mut().map_or(Ok(()), Junit::catch_up)
    }

    /// A case has a result; they come in the order of the cases.
    fn in_order(&mut self, index: usize, result: &CaseResult) -> Result<(), Failure> {
        let case = &self.cases[index];
        self.progress.inc(1);
        if let Some(results) = &mut self.results {
            if let (Some(trace), Some(failure)) = (case.scratch_recording(), result.failed()) {
                results.keep_trace(&trace, failure)?;
                let _ = fs::remove_file(trace);
            }
            // A campaign has too many that passed.
            if result.verdict == Verdict::Passed {
                return Ok(());
            }
        }
        let text = tell::result(case, result);
        self.progress.suspend(|| print(&text)).map(|_| ())
    }
}

impl Audience<'_> {
    /// A signal came. With results the program ends at once, and what is known is written.
    fn interrupted(&mut self) -> Result<(), Failure> {
        let Some(mut results) = self.results.take() else {
            return Ok(());
        };
        self.progress.finish_and_clear();
        results.flush()?;
        let is_clean = self.counts.exit() == Exit::Clean;
        self.junit.take().map_or(Ok(()), Junit::finish)?;
        self.page
            .map_or(Ok(()), |page| page.write(self.cases, is_clean))?;
        drop(self.scratch.take());
        self.counts.finish()?;
        std::process::exit(Exit::System as i32);
    }
}

/// The verdict of a scenario that was served, in words.
pub(crate) fn verdict_text(scenario: &Scenario, result: &CaseResult) -> String {
    tell::verdict(&View::new(scenario, result, true), result)
}

/// A seed short enough to type again.
pub(crate) fn random_seed() -> u64 {
    RandomState::new().build_hasher().finish() % 1_000_000_000
}

/// The `check` subcommand: reads the files and plays nothing.
pub(crate) fn check(
    devices: Devices,
    files: &[PathBuf],
    given: &GivenArgs,
) -> Result<Exit, Failure> {
    let given = Given::new(SimSettings::new(devices), given, &[])?;
    let loaded = load_all(&given, &find(files, None)?)?;
    let broken = loaded
        .iter()
        .filter_map(|one| Some((one, one.broken.as_ref()?)));
    let broken: Vec<String> = broken
        .map(|(one, why)| format!("{}: {}", one.name(), visible::line(why)))
        .collect();
    if !broken.is_empty() {
        return Err(Failure::system(anyhow!(broken.join("\n"))));
    }
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
            refuse!(
                "{} and {} would write the same files for --output or --report; rename one, or run them \
                 apart",
                visible::name(other),
                visible::name(&one.path)
            );
        }
    }
    Ok(())
}

/// Finds out now, and not when all has been played, whether results can be written.
fn prepare(args: &RunArgs) -> Result<(), Failure> {
    refuse_same_file([("--junit", &args.junit), ("--report", &args.report)])?;
    let Some(output) = &args.output else {
        return Ok(());
    };
    if output.exists() && !output.is_dir() {
        refuse!("--output {} is not a folder", visible::name(output));
    }
    fs::create_dir_all(output)
        .with_context(|| format!("cannot make the folder {}", visible::name(output)))
        .map_err(Failure::usage)?;
    tempfile::tempfile_in(output)
        .with_context(|| format!("cannot write into the folder {}", visible::name(output)))
        .map_err(Failure::usage)?;
    Ok(())
}

/// Number of results of each kind.
#[derive(Clone)]
struct Counts {
    /// Number of cases.
    all: usize,
    of: BTreeMap<Verdict, usize>,
}

impl Counts {
    fn add(&mut self, verdict: Verdict) {
        *self.of.entry(verdict).or_default() += 1;
    }

    /// Exit code of what has a result, also an earlier one.
    fn exit(&self) -> Exit {
        let exits = self.of.keys().map(|verdict| verdict.exit());
        exits.max().unwrap_or(Exit::Clean)
    }

    /// Prints the last line, and returns the exit code.
    fn finish(&self) -> Result<Exit, Failure> {
        let mut all = self.clone();
        let unplayed = self.all - self.of.values().sum::<usize>();
        if unplayed > 0 {
            let verdict = Verdict::of_unplayed(self.exit() == Exit::Clean);
            *all.of.entry(verdict).or_default() += unplayed;
        }
        print(&case::counts(&all.of))?;
        Ok(all.exit())
    }
}

#[cfg(test)]
mod tests;
