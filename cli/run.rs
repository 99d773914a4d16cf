//! The `run` and `check` subcommands: scenarios, played and judged.

mod case;
mod folder;
mod junit;
mod live;
mod lockstep;
mod play;
mod pool;
mod report;
mod tell;
mod twice;

use std::collections::BTreeMap;
use std::fs;
use std::io::IsTerminal as _;
use std::path::PathBuf;

use anyhow::{Context as _, anyhow};
use sim_core::device::Devices;
use sim_core::settings::SimSettings;

use crate::args::{GivenArgs, RunArgs, TimeArg};
use crate::config;
use crate::exit::{Exit, Failure};
use crate::print::print;
use crate::report::Report;
use crate::scenario_files::{Given, Loaded, find, load_all};
use crate::start::random_seed;
use crate::supervise::adopt_orphans;
use crate::visible;

use junit::Junit;

pub(crate) use case::{Case, CaseResult, Played as PlayedCase, Verdict};
pub(crate) use live::NO_PORT_OPENED;
pub(crate) use tell::{client_report, verdict_json, verdict_text, worth};

/// The `run` subcommand.
pub(crate) fn run(devices: Devices, args: &RunArgs) -> Result<Exit, Failure> {
    let settings = config::load_file(devices, &args.settings)?;
    let given = Given::new(settings, &args.given, &args.settings.set)?;
    let mut loaded = load_all(&given, &find(&args.files, args.filter.as_deref())?)?;
    if !args.tag.is_empty() {
        loaded.retain(|one| {
            // What could not be read may have the tag.
            one.broken.is_some() || one.scenario.tags.iter().any(|tag| args.tag.contains(tag))
        });
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
    check_time(args)?;
    if args.output.is_some() || args.report.is_some() {
        refuse_shared_files(&loaded)?;
    }
    let base = random_seed();
    let mut cases: Vec<Case> = loaded
        .iter()
        .flat_map(|one| (0..args.repeat).map(move |repeat| Case::new(args, one, repeat, base)))
        .collect();
    if args.dry_run {
        let text: Vec<String> = cases.iter().map(tell::planned).collect();
        return print(&text.join("\n"));
    }
    prepare(args)?;
    let report = args.report.as_deref();
    let report = report
        .map(|path| Report::begin(devices, path))
        .transpose()?;
    for case in &mut cases {
        case.report = report.as_ref();
    }
    let junit = args.junit.as_deref();
    let mut audience = Told {
        args,
        cases: &cases,
        counts: Counts::default(),
        progress: progress(cases.len()),
        junit: junit.map(|path| Junit::begin(path, &cases)).transpose()?,
    };
    adopt_orphans().map_err(Failure::system)?;
    let wrong = pool::play_all(args, &cases, &mut audience);
    audience.progress.finish_and_clear();
    let wrong = wrong?;
    let exit = audience.counts.finish(cases.len());
    // Also when the run was broken off.
    audience.junit.map_or(Ok(()), Junit::finish)?;
    if let Some(report) = &report {
        report.write(&cases)?;
    }
    let exit = exit?;
    wrong.map_or(Ok(exit), Err)
}

/// Refuses flags that the time of the run has no use for.
fn check_time(args: &RunArgs) -> Result<(), Failure> {
    let is_real = !args.client.is_empty() && args.time == TimeArg::Real;
    let is_lockstep = !args.client.is_empty() && args.time == TimeArg::Lockstep;
    if args.speed.is_some() && !is_real {
        return Err(Failure::usage(anyhow!(
            "--speed is for a client with --time real; in simulated time a scenario takes as long as \
             the machine needs"
        )));
    }
    if args.twice && !is_lockstep {
        return Err(Failure::usage(anyhow!(
            "--twice is for a client with --time lockstep, whose runs are the same each time"
        )));
    }
    Ok(())
}

/// Prints results, counts them, and keeps them for the JUnit file.
struct Told<'a> {
    args: &'a RunArgs,
    cases: &'a [Case<'a>],
    counts: Counts,
    progress: indicatif::ProgressBar,
    junit: Option<Junit>,
}

impl Told<'_> {
    /// A case has a result; they come as they come.
    fn known(&mut self, index: usize, result: &CaseResult) -> Result<(), Failure> {
        self.counts.add(result);
        let case = &self.cases[index];
        if let Some(report) = case.report {
            report.known(index, case, result);
        }
        match &mut self.junit {
            Some(junit) => junit.known(index, case, result),
            None => Ok(()),
        }
    }

    /// Nothing has come for a moment.
    fn idle(&mut self) -> Result<(), Failure> {
        // Without a thread of its own, which the system may refuse.
        self.progress.tick();
        self.junit.as_mut().map_or(Ok(()), Junit::catch_up)
    }

    /// A case has a result; they come in the order of the cases.
    fn told(&mut self, index: usize, result: &CaseResult) -> Result<(), Failure> {
        let text = tell::told(self.args, &self.cases[index], result);
        self.progress.inc(1);
        self.progress.suspend(|| print(&text)).map(|_| ())
    }
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
            return Err(Failure::usage(anyhow!(
                "{} and {} would write the same files for --output or --report; rename one, or run them \
                 apart",
                visible::name(other),
                visible::name(&one.path)
            )));
        }
    }
    Ok(())
}

/// Finds out now, and not when all has been played, whether results can be written.
fn prepare(args: &RunArgs) -> Result<(), Failure> {
    let Some(output) = &args.output else {
        return Ok(());
    };
    fs::create_dir_all(output)
        .with_context(|| format!("cannot make the folder {}", visible::name(output)))
        .map_err(Failure::usage)?;
    tempfile::tempfile_in(output)
        .with_context(|| format!("cannot write into the folder {}", visible::name(output)))
        .map_err(Failure::usage)?;
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
    bar
}

/// Number of results of each kind.
#[derive(Default)]
struct Counts(BTreeMap<Verdict, usize>);

impl Counts {
    fn add(&mut self, result: &CaseResult) {
        *self.0.entry(result.verdict()).or_default() += 1;
    }

    /// The last line, and the exit code; `all` were to be played.
    fn finish(&self, all: usize) -> Result<Exit, Failure> {
        let count = |verdict| self.0.get(&verdict).copied().unwrap_or_default();
        let (passed, failed) = (count(Verdict::Passed), count(Verdict::Failed));
        let known: usize = self.0.values().sum();
        let mut text = format!("{passed} passed, {failed} failed, {} skipped", all - known);
        for (verdict, what) in [
            (Verdict::Spoilt, "spoilt by the machine"),
            (Verdict::Broken, "could not be played"),
            (Verdict::BrokenOff, "broken off"),
        ] {
            if count(verdict) > 0 {
                text += &format!(", {} {what}", count(verdict));
            }
        }
        print(&text)?;
        Ok(if known > passed + failed {
            Exit::System
        } else if failed > 0 {
            Exit::Failed
        } else {
            Exit::Clean
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::{Cli, Command};
    use std::ffi::OsString;

    use sim_core::SHIPPED;
    use sim_core::device::DeviceSpec;

    /// Devices that break when they are built: one when it is to be played with seed 7, the other also
    /// when its file is read, which is tried with seed 0.
    fn clumsy() -> Devices {
        let when_played = DeviceSpec {
            id: "clumsy",
            build: |setup, world| match setup.seed {
                7 => panic!("dropped \u{1b}[2J"),
                _ => (SHIPPED[0].build)(setup, world),
            },
            ..*SHIPPED[0]
        };
        let when_read = DeviceSpec {
            id: "clumsier",
            build: |_, _| panic!("dropped \u{1b}[2J"),
            ..*SHIPPED[0]
        };
        let own = [when_played, when_read].map(|spec| &*Box::leak(Box::new(spec)));
        Box::leak(Box::new([SHIPPED[0], own[0], own[1]]))
    }

    #[test]
    fn a_panic_in_one_scenario_is_its_error_and_the_others_are_played() {
        let folder = tempfile::tempdir().unwrap();
        let folder = folder.path();
        let kinds = [
            ("a", "r150"),
            ("b", "clumsy"),
            ("c", "clumsier"),
            ("d", "r150"),
        ];
        for (name, kind) in kinds {
            let text = format!(
                "schema = 1\ntitle = \"{name}\"\ngood_client = \"Any.\"\nlimit = \"100 ms\"\n\
                 [[device]]\nkind = \"{kind}\"\n"
            );
            fs::write(folder.join(format!("{name}.toml")), text).unwrap();
        }
        let junit = folder.join("r.xml");
        for players in ["1", "3"] {
            let mut words = ["sim", "run", "--seed", "7", "-j", players, "--junit"]
                .map(OsString::from)
                .to_vec();
            words.extend([junit.clone().into(), folder.into()]);
            let cli = Cli::parse(clumsy(), &words).unwrap();
            let Some(Command::Run(args)) = cli.command else {
                panic!("another command");
            };
            let ended = run(clumsy(), &args);
            assert_eq!(
                ended.map_err(|failure| failure.error).unwrap(),
                Exit::System
            );
            let results = fs::read_to_string(&junit).unwrap();
            assert!(
                results.contains("tests=\"4\" failures=\"0\" errors=\"2\""),
                "{results}"
            );
            let why = "the simulator panicked: dropped \\u{1b}[2J";
            assert_eq!(results.matches(why).count(), 2, "{results}");
            let unread = results.split("<testsuite ").nth(3).unwrap();
            assert!(
                unread.contains("c.toml") && unread.contains(why),
                "{results}"
            );
        }
        // Nothing is played here, and what is wrong is told all the same.
        let checked = check(clumsy(), &[folder.to_owned()], &GivenArgs::default());
        let failure = checked.unwrap_err();
        assert_eq!(failure.exit, Exit::System);
        let told = failure.error.to_string();
        assert!(
            told.contains("c.toml") && !told.contains("b.toml"),
            "{told}"
        );
    }
}
