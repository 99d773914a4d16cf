//! The subcommands that play scenarios in simulated time: `run`, `check` and `replay`.

use std::fs;
use std::io::{BufRead as _, BufReader, BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use sim_core::settings::SimSettings;
use sim_scenarios::trace::Replay;
use sim_scenarios::{Outcome, Run, RunOptions, Scenario};
use sim_settings::Source;

use crate::args::RunArgs;
use crate::config;
use crate::exit::{Exit, Failure};
use crate::start::random_seed;

/// Most scenario files of one call.
const MOST_FILES: usize = 10_000;

/// A scenario file with the world file that it names.
struct Loaded {
    path: PathBuf,
    scenario: Arc<Scenario>,
    world: Option<(String, String)>,
}

/// The `run` subcommand.
pub(crate) fn run(args: &RunArgs) -> Result<Exit, Failure> {
    let files = find(&args.files, args.filter.as_deref())?;
    if args.list {
        let text: Vec<String> = files
            .iter()
            .map(|file| file.display().to_string())
            .collect();
        return print(&text.join("\n"));
    }
    let loaded = load_all(&files)?;
    if let Some(folder) = &args.output {
        fs::create_dir_all(folder)
            .with_context(|| format!("cannot make the folder {}", folder.display()))
            .map_err(Failure::usage)?;
    }
    let mut failed = 0;
    let mut played = 0;
    for one in &loaded {
        let seed = args
            .seed
            .or(one.scenario.rig.seed)
            .unwrap_or_else(random_seed);
        let outcome = play(one, seed, args.output.as_deref())?;
        played += 1;
        print(&told(one, &outcome))?;
        if !outcome.passed {
            failed += 1;
            if args.fail_fast {
                break;
            }
        }
    }
    let skipped = loaded.len() - played;
    print(&format!(
        "{} passed, {failed} failed, {skipped} skipped",
        played - failed
    ))?;
    Ok(if failed == 0 {
        Exit::Clean
    } else {
        Exit::Failed
    })
}

/// The `check` subcommand: reads the files and plays nothing.
pub(crate) fn check(files: &[PathBuf]) -> Result<Exit, Failure> {
    let loaded = load_all(&find(files, None)?)?;
    print(&format!("{} scenarios are well-formed", loaded.len()))
}

/// The `replay` subcommand.
pub(crate) fn replay(path: &Path) -> Result<Exit, Failure> {
    let shown = path.display();
    let file = fs::File::open(path)
        .with_context(|| format!("cannot read the trace {shown}"))
        .map_err(Failure::usage)?;
    let mut replay: Option<Replay> = None;
    for line in BufReader::new(file).lines() {
        let line = line
            .with_context(|| format!("cannot read the trace {shown}"))
            .map_err(Failure::system)?;
        let outcome = match &mut replay {
            None => Replay::begin(&line).map(|begun| replay = Some(begun)),
            Some(replay) => replay.line(&line),
        };
        if let Err(error) = outcome {
            return differs(&error);
        }
    }
    let Some(replay) = replay else {
        return Err(Failure::usage(anyhow!("the trace {shown} is empty")));
    };
    match replay.finish() {
        Ok(()) => print("the devices did the same to the last byte"),
        Err(error) => differs(&error),
    }
}

fn differs(error: &sim_scenarios::trace::ReplayError) -> Result<Exit, Failure> {
    print(&format!("FAILED: {error}"))?;
    Ok(Exit::Failed)
}

/// Every scenario file that the paths name; of folders those that end in `.toml`, by name.
fn find(paths: &[PathBuf], filter: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    let mut pending: Vec<PathBuf> = paths.iter().rev().cloned().collect();
    while let Some(path) = pending.pop() {
        if found.len() + pending.len() > MOST_FILES {
            return Err(Failure::usage(anyhow!(
                "more than {MOST_FILES} files are named"
            )));
        }
        if path.is_dir() {
            let entries = fs::read_dir(&path)
                .with_context(|| format!("cannot look into {}", path.display()))
                .map_err(Failure::usage)?;
            let mut inside: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            inside.retain(|p| p.is_dir() || p.extension().is_some_and(|end| end == "toml"));
            inside.sort();
            pending.extend(inside.into_iter().rev());
        } else {
            found.push(path);
        }
    }
    if let Some(filter) = filter {
        found.retain(|path| path.display().to_string().contains(filter));
    }
    if found.is_empty() {
        return Err(Failure::usage(anyhow!(
            "no scenario file is named: nothing to run"
        )));
    }
    Ok(found)
}

fn load_all(files: &[PathBuf]) -> Result<Vec<Loaded>, Failure> {
    let mut errors = Vec::new();
    let mut loaded = Vec::new();
    for path in files {
        match load(path) {
            Ok(one) => loaded.push(one),
            Err(failure) => errors.push(format!("{:#}", failure.error)),
        }
    }
    if errors.is_empty() {
        Ok(loaded)
    } else {
        Err(Failure::usage(anyhow!(errors.join("\n"))))
    }
}

fn load(path: &Path) -> Result<Loaded, Failure> {
    let text = config::read(path, "scenario file")?;
    let shown = path.display().to_string();
    let source = Source {
        file: &shown,
        text: &text,
    };
    let scenario = Scenario::parse(source, &SimSettings::default()).map_err(Failure::usage)?;
    for device in &scenario.rig.devices {
        config::check(&device.settings)?;
    }
    let world = match scenario.world() {
        Some(world) => {
            let folder = path.parent().map(Path::to_owned).unwrap_or_default();
            let world = folder.join(world);
            Some((
                world.display().to_string(),
                config::read(&world, "world file")?,
            ))
        }
        None => None,
    };
    Ok(Loaded {
        path: path.to_owned(),
        scenario: Arc::new(scenario),
        world,
    })
}

fn play(one: &Loaded, seed: u64, output: Option<&Path>) -> Result<Outcome, Failure> {
    let world = one.world.as_ref().map(|(file, text)| Source { file, text });
    let options = RunOptions {
        trace: output.is_some(),
        ..RunOptions::scripted(seed)
    };
    let mut run = Run::new(Arc::clone(&one.scenario), world, options).map_err(Failure::usage)?;
    let mut trace = output
        .map(|folder| Trace::create(folder, &one.path))
        .transpose()?;
    let outcome = run
        .play(&mut |line| {
            if let Some(trace) = &mut trace {
                trace.line(line);
            }
        })
        .map_err(Failure::system)?
        .clone();
    trace.map_or(Ok(()), Trace::finish)?;
    Ok(outcome)
}

/// A trace file; the first error is kept for the end.
struct Trace {
    path: PathBuf,
    out: BufWriter<fs::File>,
    error: Option<std::io::Error>,
}

impl Trace {
    fn create(folder: &Path, scenario: &Path) -> Result<Self, Failure> {
        // The whole path, so that files of one name in two folders do not meet.
        let parts: Vec<String> = scenario
            .with_extension("")
            .components()
            .filter_map(|part| match part {
                std::path::Component::Normal(part) => Some(part.to_string_lossy().into_owned()),
                _ => None,
            })
            .collect();
        let path = folder.join(format!("{}.trace.jsonl", parts.join("-")));
        let file = fs::File::create(&path)
            .with_context(|| format!("cannot write the trace {}", path.display()))
            .map_err(Failure::system)?;
        Ok(Self {
            path,
            out: BufWriter::new(file),
            error: None,
        })
    }

    fn line(&mut self, line: &str) {
        if self.error.is_none() {
            self.error = writeln!(self.out, "{line}").err();
        }
    }

    fn finish(mut self) -> Result<(), Failure> {
        let flushed = self.out.flush();
        let shown = self.path.display();
        self.error
            .map_or(flushed, Err)
            .with_context(|| format!("cannot write the trace {shown}; it is not complete"))
            .map_err(Failure::system)
    }
}

/// What to print of a scenario that has been played.
fn told(one: &Loaded, outcome: &Outcome) -> String {
    let path = one.path.display();
    let (title, time) = (&outcome.title, outcome.ended_at.as_secs_f64());
    if outcome.passed {
        return format!("ok      {path}: {title} ({time:.1} s simulated)");
    }
    let mut text = format!("FAILED  {path}: {title} ({time:.1} s simulated)");
    for failure in &outcome.failures {
        text += &format!("\n  {failure}");
    }
    if outcome.more_failures > 0 {
        text += &format!("\n  and {} more", outcome.more_failures);
    }
    text += "\n  the last that happened:";
    let skip = outcome.traffic.len().saturating_sub(12);
    for line in outcome.traffic.iter().skip(skip) {
        text += &format!("\n    {line}");
    }
    text + &format!("\n  again: sim run --seed {} {path}", outcome.seed)
}

/// Prints a line; nobody reading any more is no failure.
pub(crate) fn print(text: &str) -> Result<Exit, Failure> {
    match writeln!(anstream::stdout(), "{text}") {
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            Err(Failure::system(anyhow!(error).context("cannot print")))
        }
        _ => Ok(Exit::Clean),
    }
}
