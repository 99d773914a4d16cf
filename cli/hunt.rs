//! The `hunt` subcommand: searches for the smallest schedule of faults that makes a client break a rule.
//!
//! Every schedule is an ordinary scenario file based on the job, and is played as `sim run` plays it. Each
//! round is planned before it is played, so the result does not depend on how many are played at a time.

mod attribution;
mod finding;
mod moments;
mod player;
mod report;
mod search;
mod space;

use std::ffi::OsString;

use anyhow::Context as _;
use clap::{Args as _, FromArgMatches as _};
use indicatif::ProgressBar;
use rigsim_core::device::Devices;
use rigsim_core::effect::catalogue;
use rigsim_core::noise::Noise;
use rigsim_settings::nearest;

use crate::args::{GivenArgs, HuntArgs, RunArgs, StageArg, again};
use crate::config;
use crate::exit::{Exit, Failure, refuse};
use crate::scenario_files::{Given, find, load_all};
use crate::visible;

use player::Player;
use search::{Hunt, State};
use space::{Frame, add_rules};

/// The `hunt` subcommand.
pub(crate) fn hunt(devices: Devices, args: &HuntArgs) -> Result<Exit, Failure> {
    let known: Vec<&str> = catalogue(devices).iter().map(|info| info.id).collect();
    if let Some(unknown) = args.faults.iter().find(|id| !known.contains(&id.as_str())) {
        let near = nearest(unknown, known);
        let hint = near.map_or_else(String::new, |near| format!(", did you mean {near}?"));
        refuse!("--faults: there is no fault or action {unknown}{hint}; `sim faults` lists them");
    }
    let none = GivenArgs::default();
    let base = config::load_file(devices, &args.settings)?;
    let given = Given::new(base, &none, &args.settings.set)?;
    let jobs = load_all(&given, &find(&args.jobs, None)?)?;
    let mut rules = toml::Table::new();
    let mut files = Vec::new();
    for path in &args.rules {
        let (name, text) = (visible::name(path), config::read(path, "file of rules")?);
        let mut alone = toml::Table::new();
        for table in [&mut rules, &mut alone] {
            let added = add_rules(table, &text).with_context(|| name.clone());
            added.map_err(Failure::usage)?;
        }
        files.push((name, alone));
    }
    let begins = |stage: &StageArg| matches!(stage, StageArg::Single | StageArg::Random);
    if !args.stages.is_empty() && !args.stages.iter().any(begins) {
        refuse!(
            "--stages: the stage further goes on from schedules of others; add single or random"
        );
    }
    let cores = || std::thread::available_parallelism().map_or(1, usize::from);
    let threads = args.threads.map_or_else(cores, |threads| threads as usize);
    let shell = |command: &String| ["sh", "-c", command].map(OsString::from).to_vec();
    let reference = args.reference.as_ref().map(shell);
    let mut hunts = Vec::new();
    for (number, job) in jobs.iter().enumerate() {
        let folder = match jobs.len() {
            1 => args.output.clone(),
            _ => args.output.join(format!("job-{}", number + 1)),
        };
        let player = |client: &Vec<OsString>, threads| {
            Player::new(run_args(args, client)?, &given, &folder, threads)
        };
        let mut hunt = Hunt {
            devices,
            args,
            job,
            frame: Frame::new(&job.path, &job.scenario.title, &rules),
            player: player(&args.client, threads)?,
            reference: reference
                .as_ref()
                .map(|words| player(words, 1))
                .transpose()?,
            budget: (u64::from(args.runs) / jobs.len() as u64).max(1),
            noise: Noise::new(args.seed, "hunt"),
            bar: ProgressBar::hidden(),
            state: State::default(),
        };
        for (name, rules) in &files {
            let alone = Frame::new(&job.path, &job.scenario.title, rules);
            hunt.player.check(&alone.document(&[]), name)?;
        }
        hunt.begin()?;
        hunts.push(hunt);
    }
    // All errors in the files are found before the first search.
    let mut summary = report::Summary::find(args)?;
    for hunt in &mut hunts {
        hunt.keep_journal()?;
        // No other hunt uses the folder now.
        summary.begin()?;
        hunt.search()?;
        summary.add(hunt)?;
        if hunt.is_enough() {
            break;
        }
    }
    let exit = summary.finish()?;
    for hunt in &mut hunts {
        hunt.player.end_journal();
    }
    Ok(exit)
}

/// The flags of `sim run` that play a file of a hunt.
fn run_args(args: &HuntArgs, client: &[OsString]) -> Result<RunArgs, Failure> {
    let mut words: Vec<OsString> = vec!["--seed".into(), args.seed.to_string().into()];
    for set in &args.settings.set {
        words.extend(["--set".into(), set.into()]);
    }
    if let Some(config) = &args.settings.config {
        words.extend(["--config".into(), config.into()]);
    }
    words.extend(["job".into(), "--".into()]);
    words.extend(client.iter().cloned());
    let command = RunArgs::augment_args(clap::Command::new("run").no_binary_name(true));
    let matches = command
        .try_get_matches_from(words)
        .map_err(Failure::usage)?;
    let mut run = RunArgs::from_arg_matches(&matches).map_err(Failure::usage)?;
    run.again = again(&matches);
    Ok(run)
}
