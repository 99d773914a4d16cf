//! Finding and reading scenario files.

use std::collections::BTreeSet;
use std::ffi::{OsStr, OsString};
use std::fs;
use std::path::{Component, Path, PathBuf};
use std::sync::Arc;

use anyhow::{Context as _, anyhow};
use sim_core::device::Devices;
use sim_core::settings::SimSettings;
use sim_runner::scenario::is_scenario_file;
use sim_runner::{RigPlan, Run, RunOptions, Scenario};
use sim_settings::Source;

use crate::config;
use crate::exit::Failure;
use crate::visible;

/// Most scenario files of one call.
const MOST_FILES: usize = 10_000;

/// A scenario with its world file; devices that are only served are one without steps.
#[derive(Clone)]
pub(crate) struct Loaded {
    pub(crate) path: PathBuf,
    pub(crate) scenario: Arc<Scenario>,
    /// Name and text.
    world: Option<(String, String)>,
}

impl Loaded {
    /// Devices to be served, as the rig file `path` names them; their paths are relative to it.
    pub(crate) fn serving(
        rig: RigPlan,
        path: PathBuf,
        world: Option<&Path>,
    ) -> Result<Self, Failure> {
        let read = |path: &Path| {
            let text = config::read(path, "world file")?;
            Ok((visible::name(path), text))
        };
        Ok(Self {
            path,
            scenario: Arc::new(Scenario::serving(rig)),
            world: world.map(read).transpose()?,
        })
    }

    /// A run of it.
    pub(crate) fn run(&self, options: RunOptions) -> Result<Run, Failure> {
        let world = self.world.as_ref();
        let world = world.map(|(file, text)| Source { file, text });
        Run::new(Arc::clone(&self.scenario), world, options).map_err(Failure::usage)
    }

    /// The folder that its paths are relative to.
    pub(crate) fn folder(&self) -> PathBuf {
        self.path.parent().map(Path::to_owned).unwrap_or_default()
    }

    /// What distinguishes it in names of files: the whole path, so that files of one name in two
    /// folders do not meet.
    pub(crate) fn stem(&self) -> OsString {
        let path = self.path.with_extension("");
        let parts = path.components().filter_map(|part| match part {
            Component::Normal(part) => Some(part),
            _ => None,
        });
        let parts: Vec<&OsStr> = parts.collect();
        parts.join(OsStr::new("-"))
    }
}

/// Every scenario file that the paths name; of folders those whose names are scenarios'.
pub(crate) fn find(paths: &[PathBuf], filter: Option<&str>) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    let mut seen = BTreeSet::new();
    let mut pending: Vec<PathBuf> = paths.iter().rev().cloned().collect();
    while let Some(path) = pending.pop() {
        if found.len() + pending.len() > MOST_FILES {
            return Err(Failure::usage(anyhow!(
                "more than {MOST_FILES} files are named"
            )));
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
            None => anyhow!("no scenario file is there: nothing to run"),
        }));
    }
    Ok(found)
}

fn is_hidden(path: &Path) -> bool {
    path.file_name()
        .is_some_and(|name| name.to_string_lossy().starts_with('.'))
}

/// Reads all, or says what is wrong with each.
pub(crate) fn load_all(devices: Devices, files: &[PathBuf]) -> Result<Vec<Loaded>, Failure> {
    let mut errors = Vec::new();
    let mut loaded = Vec::new();
    for path in files {
        match load(path, &SimSettings::new(devices)) {
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

/// Reads one, with `base` for what it does not set.
pub(crate) fn load(path: &Path, base: &SimSettings) -> Result<Loaded, Failure> {
    let text = config::read(path, "scenario file")?;
    let shown = visible::name(path);
    let source = Source {
        file: &shown,
        text: &text,
    };
    let scenario = Scenario::parse(source, base).map_err(Failure::usage)?;
    for device in &scenario.rig.devices {
        config::check(&device.settings)?;
    }
    let mut loaded = Loaded {
        path: path.to_owned(),
        scenario: Arc::new(scenario),
        world: None,
    };
    if let Some(world) = loaded.scenario.world() {
        let world = loaded.folder().join(world);
        let text = config::read(&world, "world file")?;
        loaded.world = Some((visible::name(&world), text));
    }
    // A world that is wrong is found now, not when others have been played.
    loaded.run(RunOptions::scripted(0))?;
    Ok(loaded)
}
