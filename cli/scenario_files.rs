//! Finding and reading scenario files.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::os::unix::ffi::OsStrExt as _;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;
use std::time::Duration;

use anyhow::{Context as _, anyhow};
use rigsim_core::settings::SimSettings;
use rigsim_runner::scenario::{NamedText, ScenarioFiles, is_scenario_file};
use rigsim_runner::{RigPlan, Run, RunOptions, Scenario};

use crate::args::GivenArgs;
use crate::config;
use crate::digest::digest;
use crate::exit::{Failure, refuse};
use crate::print::{complain, words_of_panic};
use crate::visible;

/// Most scenario files of one call.
const MOST_FILES: usize = 10_000;
/// Most bytes of a part of names of files: a name has 255, also that of a lock beside it.
const MOST_STEM: usize = 200;

/// A scenario with its world file; devices that are only served are one without steps.
#[derive(Clone)]
pub(crate) struct Loaded {
    pub(crate) path: PathBuf,
    pub(crate) scenario: Arc<Scenario>,
    world: Option<NamedText>,
    /// The parameters that were given.
    pub(crate) parameters: Vec<(String, String)>,
    /// Why there is nothing to play: reading it failed through no fault of the file.
    pub(crate) broken: Option<String>,
}

impl Loaded {
    /// One that cannot be read, as its error among the results of the others.
    fn broken(path: &Path, settings: &SimSettings, why: String) -> Self {
        let rig = RigPlan {
            world: None,
            seed: None,
            settings: settings.clone(),
            devices: Vec::new(),
        };
        let mut scenario = Scenario::serving(rig);
        scenario.title = "could not be read".to_owned();
        scenario.limit = Duration::ZERO;
        Self {
            path: path.to_owned(),
            scenario: Arc::new(scenario),
            world: None,
            parameters: Vec::new(),
            broken: Some(why),
        }
    }

    /// Devices to be served, as the rig file `path` names them; their paths are relative to it.
    pub(crate) fn serving(
        rig: RigPlan,
        path: PathBuf,
        world: Option<&Path>,
    ) -> Result<Self, Failure> {
        let read = |path: &Path| {
            let text = config::read(path, "world file")?;
            Ok(named(path, text))
        };
        Ok(Self {
            path,
            scenario: Arc::new(Scenario::serving(rig)),
            world: world.map(read).transpose()?,
            parameters: Vec::new(),
            broken: None,
        })
    }

    /// That of a run which was played again.
    pub(crate) fn replayed(run: &Run, world: Option<NamedText>) -> Self {
        let scenario = run.scenario().clone();
        Self {
            path: PathBuf::from(&scenario.source.file),
            scenario: Arc::new(scenario),
            world,
            parameters: Vec::new(),
            broken: None,
        }
    }

    /// Returns the beginning of a scenario file with the same devices, world and settings, to which
    /// steps can be added. Its title and the like are missing where it is not based on a scenario.
    pub(crate) fn beginning(&self) -> String {
        let line = |key: &str, path: &Path| {
            // That of a recording may have been made elsewhere.
            let absolute = std::path::absolute(path).ok().filter(|_| path.exists());
            let path = absolute.unwrap_or_else(|| path.to_owned());
            format!(
                "{key} = {}\n",
                toml::Value::from(path.display().to_string())
            )
        };
        let rig = &self.scenario.rig;
        let changed = config::changed(&rig.settings).into_iter();
        let changed: String = changed.map(|line| format!("settings.{line}\n")).collect();
        if !self.scenario.is_endless() {
            return format!("schema = 1\n{}{changed}", line("base", &self.path));
        }
        let world = self.world.as_ref();
        let world = world.map(|world| line("world", Path::new(&world.file)));
        format!("{}{changed}{}", world.unwrap_or_default(), rig.to_toml())
    }

    /// A run of it.
    pub(crate) fn run(&self, options: RunOptions) -> Result<Run, Failure> {
        self.run_as(&self.scenario, options)
    }

    /// A run of a variant of it.
    pub(crate) fn run_as(
        &self,
        scenario: &Arc<Scenario>,
        options: RunOptions,
    ) -> Result<Run, Failure> {
        let world = self.world.as_ref().map(NamedText::source);
        Run::new(Arc::clone(scenario), world, options).map_err(Failure::usage)
    }

    /// The folder that its paths are relative to.
    pub(crate) fn folder(&self) -> PathBuf {
        self.path.parent().map(Path::to_owned).unwrap_or_default()
    }

    /// Part of names of files by which it is known: the whole path, so that files of one name in
    /// two folders do not meet. Of a long one, a digest and its end.
    pub(crate) fn stem(&self) -> OsString {
        let path = self.path.with_extension("");
        let parts = path.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part),
            _ => None,
        });
        let parts: Vec<&OsStr> = parts.collect();
        let mut stem = parts.join(OsStr::new("-"));
        for (name, value) in &self.parameters {
            let letter = |c: char| {
                if c.is_ascii_alphanumeric() || c == '.' {
                    c
                } else {
                    '_'
                }
            };
            let value: String = value.chars().map(letter).collect();
            stem.push(format!("-{name}-{value}"));
        }
        let mut begins = stem.len().saturating_sub(MOST_STEM);
        if begins > 0 {
            // Not within a character.
            while stem
                .as_bytes()
                .get(begins)
                .is_some_and(|byte| byte & 0xC0 == 0x80)
            {
                begins += 1;
            }
            let number = digest(stem.as_bytes()) & 0xFFFF_FFFF;
            let mut short = OsString::from(format!("{number:08x}-"));
            short.push(OsStr::from_bytes(&stem.as_bytes()[begins..]));
            stem = short;
        }
        stem
    }

    /// Its path, and the parameters that were given.
    pub(crate) fn name(&self) -> String {
        let given = self.parameters.iter();
        let given: Vec<String> = given
            .map(|(name, value)| format!("{name}={value}"))
            .collect();
        match given.as_slice() {
            [] => visible::name(&self.path),
            given => format!(
                "{} {}",
                visible::name(&self.path),
                visible::line(&given.join(" "))
            ),
        }
    }
}

/// Every scenario file that the paths name; of folders those whose names are scenarios'.
pub(crate) fn find(paths: &[PathBuf], filter: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    let mut pending: Vec<PathBuf> = paths.iter().rev().cloned().collect();
    while let Some(path) = pending.pop() {
        if found.len() + pending.len() > MOST_FILES {
            refuse!("more than {MOST_FILES} files are named");
        }
        // Links may lead in circles, and what is named twice is meant once.
        if !fs::canonicalize(&path).is_ok_and(|real| seen.insert(real)) && path.exists() {
            continue;
        }
        if path.is_dir() {
            let entries = fs::read_dir(&path)
                .with_context(|| format!("cannot look into {}", visible::name(&path)))
                .map_err(Failure::usage)?;
            let mut inside: Vec<PathBuf> = entries.flatten().map(|entry| entry.path()).collect();
            inside.retain(|path| {
                !is_hidden(path) && (path.is_dir() || path.is_file() && is_scenario_file(path))
            });
            inside.sort();
            pending.extend(inside.into_iter().rev());
        } else {
            found.push(path);
        }
    }
    if let Some(filter) = filter {
        found.retain(|path| visible::name(path).contains(filter));
    }
    if found.is_empty() {
        return Err(Failure::usage(match filter {
            Some(filter) => anyhow!("no scenario file's path contains `{filter}`: nothing to run"),
            None => {
                let places: Vec<String> = paths.iter().map(visible::name).collect();
                anyhow!("no scenario file is in {}", places.join(" or "))
            }
        }));
    }
    Ok(found)
}

fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// Most combinations of parameters of one file.
const MOST_CASES: usize = 10_000;

/// Things that files are read with.
pub(crate) struct Given<'a> {
    pub(crate) base: SimSettings,
    /// The job for fault files.
    pub(crate) job: Option<&'a Path>,
    /// Parameters and their values.
    pub(crate) parameters: Vec<(String, Vec<String>)>,
    /// Settings that win over the files'.
    pub(crate) set: &'a [String],
    /// The world that wins over the files'.
    pub(crate) world: Option<&'a Path>,
}

impl<'a> Given<'a> {
    /// Collects what flags say; their own settings go into `base`.
    pub(crate) fn new(
        base: SimSettings,
        args: &'a GivenArgs,
        set: &'a [String],
    ) -> Result<Self, Failure> {
        let mut parameters: Vec<(String, Vec<String>)> = Vec::new();
        for text in &args.param {
            let (name, values) = text.split_once('=').ok_or_else(|| {
                let why = anyhow!("--param {text}: wanted NAME=VALUE, as in --param pwm=300");
                Failure::usage(why)
            })?;
            if let Some((_, before)) = parameters.iter().find(|(known, _)| known == name) {
                let both = format!("{},{values}", before.join(","));
                refuse!(
                    "--param {name} is given twice; for a case of each value: --param {name}={both}"
                );
            }
            let values = values.split(',').map(str::to_owned).collect();
            parameters.push((name.to_owned(), values));
        }
        Ok(Self {
            base,
            job: args.job.as_deref(),
            parameters,
            set,
            world: args.world.as_deref(),
        })
    }

    /// Nothing but settings.
    pub(crate) fn plain(base: SimSettings) -> Given<'static> {
        Given {
            base,
            job: None,
            parameters: Vec::new(),
            set: &[],
            world: None,
        }
    }
}

/// Reads all, each with each combination of its parameters; or says what is wrong with each. World
/// and rig files that lie among them are named and left out. A panic is that file's alone.
pub(crate) fn load_all(given: &Given<'_>, files: &[PathBuf]) -> Result<Vec<Loaded>, Failure> {
    if let Some(job) = given.job {
        // Said once, and not of each file.
        config::read(job, "job")?;
    }
    let mut errors = Vec::new();
    let mut loaded = Vec::new();
    let mut used = BTreeSet::new();
    let mut others = Vec::new();
    let mut others_ending = Vec::new();
    for path in files {
        let load = || load_cases(given, path, &mut used, &mut others);
        match catch_unwind(AssertUnwindSafe(load)) {
            Ok(Ok(cases)) => loaded.extend(cases),
            Ok(Err(failure)) => {
                let lines = format!("{:#}", failure.error);
                let mut lines = lines.lines().map(str::to_owned);
                if is_scenario_file(path) {
                    errors.extend(lines);
                } else {
                    errors.extend(lines.next());
                    others_ending.push(visible::name(path));
                }
            }
            Err(panic) => loaded.push(Loaded::broken(path, &given.base, words_of_panic(&*panic))),
        }
    }
    let unused = given
        .parameters
        .iter()
        .find(|(name, _)| !used.contains(name));
    let all_known = errors.is_empty() && loaded.iter().all(|one| one.broken.is_none());
    if let Some((name, _)) = unused.filter(|_| all_known) {
        errors.push(format!(
            "--param {name}: no file has a parameter of this name"
        ));
    }
    if !others_ending.is_empty() && others_ending.len() < files.len() {
        errors.push(format!(
            "names of scenario files end in .toml; `--` stands before a client: `sim run FILE -- {}`",
            others_ending.join(" ")
        ));
    }
    let left_out = match others.as_slice() {
        [] => None,
        [one] => Some(format!(
            "{one} has its own devices, so it is not a fault file for --job"
        )),
        [first, rest @ ..] => Some(format!(
            "{first} and {} more have their own devices, so they are not fault files for --job",
            rest.len()
        )),
    };
    if errors.is_empty() && loaded.is_empty() {
        errors.push(left_out.unwrap_or_else(|| "no scenario file is among these files".into()));
    } else if let Some(left_out) = left_out {
        complain(&format!("{left_out}: left out"));
    }
    if errors.is_empty() {
        Ok(loaded)
    } else {
        // The first has it from the printing of all errors.
        Err(Failure::usage(anyhow!(errors.join("\nerror: "))))
    }
}

fn load_cases(
    given: &Given<'_>,
    path: &Path,
    used: &mut BTreeSet<String>,
    others: &mut Vec<String>,
) -> Result<Vec<Loaded>, Failure> {
    let files = read_files(given, path)?;
    if files.is_no_fault_file {
        others.push(visible::name(path));
        return Ok(Vec::new());
    }
    if let Some(kind) = files.other_kind() {
        let shown = visible::name(path);
        complain(&format!("{shown} looks like a {kind} file and is left out"));
        return Ok(Vec::new());
    }
    let matching: Vec<&(String, Vec<String>)> = given
        .parameters
        .iter()
        .filter(|(name, _)| files.has_parameter(name))
        .collect();
    used.extend(matching.iter().map(|(name, _)| name.clone()));
    let mut cases: Vec<Vec<(String, String)>> = vec![Vec::new()];
    for (name, values) in matching {
        let with = |case: &Vec<(String, String)>| {
            let values = values.iter().map(|value| (name.clone(), value.clone()));
            let case = case.clone();
            values
                .map(move |value| [case.clone(), vec![value]].concat())
                .collect::<Vec<_>>()
        };
        cases = cases.iter().flat_map(with).collect();
        if cases.len() > MOST_CASES {
            refuse!("{MOST_CASES} combinations of parameters are the most of one file");
        }
    }
    let cases = cases.iter();
    cases
        .map(|case| compose(given, path, &files, case))
        .collect()
}

/// Reads one, with `given` for what it does not set.
pub(crate) fn load(path: &Path, given: &Given<'_>) -> Result<Loaded, Failure> {
    compose(given, path, &read_files(given, path)?, &[])
}

/// Reads one whose text is not in a file yet; what it is based on is.
pub(crate) fn load_text(path: &Path, text: &str, given: &Given<'_>) -> Result<Loaded, Failure> {
    let mut read = |file: &Path| {
        let text = match file == path {
            true => text.to_owned(),
            false => config::read(file, "base").map_err(|failure| failure.error)?,
        };
        Ok::<_, anyhow::Error>(named(file, text))
    };
    let files = ScenarioFiles::read(path, None, &mut read).map_err(Failure::usage)?;
    compose(given, path, &files, &[])
}

fn read_files(given: &Given<'_>, path: &Path) -> Result<ScenarioFiles, Failure> {
    let mut read = |file: &Path| {
        let text = match file == path {
            true => config::read(file, "scenario file").map_err(|failure| failure.error),
            false => named_in(path, config::read(file, "base")),
        };
        Ok::<_, anyhow::Error>(named(file, text?))
    };
    ScenarioFiles::read(path, given.job, &mut read).map_err(Failure::usage)
}

fn named(path: &Path, text: String) -> NamedText {
    NamedText {
        file: visible::name(path),
        text,
    }
}

/// An error in reading a file names the one that names it.
fn named_in(path: &Path, text: Result<String, Failure>) -> Result<String, anyhow::Error> {
    text.map_err(|failure| failure.error)
        .with_context(|| visible::name(path))
}

fn compose(
    given: &Given<'_>,
    path: &Path,
    files: &ScenarioFiles,
    parameters: &[(String, String)],
) -> Result<Loaded, Failure> {
    let scenario = files.compose(parameters, given.set, &given.base);
    let scenario = scenario.map_err(Failure::usage)?;
    let world = |world: &Path| {
        let text = config::read(world, "world file");
        let text = match given.world {
            Some(_) => text?,
            None => named_in(path, text).map_err(Failure::usage)?,
        };
        Ok(named(world, text))
    };
    let own_world = files.world_of(&scenario);
    let loaded = Loaded {
        path: path.to_owned(),
        scenario: Arc::new(scenario),
        world: given
            .world
            .or(own_world.as_deref())
            .map(world)
            .transpose()?,
        parameters: parameters.to_vec(),
        broken: None,
    };
    // A world that is wrong is found now, not when others have been played.
    loaded.run(RunOptions::scripted(0))?;
    Ok(loaded)
}
