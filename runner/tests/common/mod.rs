//! The files of the library, read for the pure crate.

#![allow(
    dead_code,
    reason = "each test program uses the part of this that it needs"
)]

use std::error::Error;
use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use rigsim_core::settings::SimSettings;
use rigsim_runner::scenario::{NamedText, ScenarioFiles, is_scenario_file};
use rigsim_runner::{Run, RunOptions, Scenario};
use rigsim_settings::Source;

/// The folders of the library, one for each kind of device.
pub const FOLDERS: [&str; 2] = ["r150", "mecanum"];

/// A scenario file with the world file that it names.
pub struct Loaded {
    pub path: PathBuf,
    pub scenario: Arc<Scenario>,
    world: Option<(String, String)>,
}

fn library() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../scenarios")
}

/// The shipped scenario files, in the order of their names.
pub fn files() -> Vec<PathBuf> {
    let mut files = Vec::new();
    for folder in FOLDERS {
        for inner in ["", "faults", "jobs"] {
            for entry in fs::read_dir(library().join(folder).join(inner)).unwrap() {
                files.push(entry.unwrap().path());
            }
        }
    }
    files.retain(|file| file.is_file() && is_scenario_file(file));
    files.sort();
    files
}

/// The name of a file as users write it, as in `r150/faults/cable-pulled`.
pub fn name(file: &Path) -> String {
    let inside = file.strip_prefix(library()).unwrap();
    inside.with_extension("").display().to_string()
}

impl Loaded {
    pub fn read(path: &Path) -> Result<Self, String> {
        let mut read = |path: &Path| -> Result<NamedText, Box<dyn Error>> {
            let (file, text) = (path.display().to_string(), fs::read_to_string(path)?);
            Ok(NamedText { file, text })
        };
        let files =
            ScenarioFiles::read(path, None, &mut read).map_err(|error| error.to_string())?;
        let scenario = files
            .compose(&[], &[], &SimSettings::new(rigsim_core::SHIPPED))
            .map_err(|errors| errors.to_string())?;
        let world = match files.world_of(&scenario) {
            Some(world) => {
                let text = fs::read_to_string(&world)
                    .map_err(|error| format!("{}: {error}", world.display()))?;
                Some((world.display().to_string(), text))
            }
            None => None,
        };
        Ok(Self {
            path: path.to_owned(),
            scenario: Arc::new(scenario),
            world,
        })
    }

    /// A run with the file's own seed, or with this one if it has none.
    pub fn run(&self, options: RunOptions) -> Run {
        let seed = self.scenario.rig.seed.unwrap_or(options.seed);
        self.run_with_seed(RunOptions { seed, ..options })
    }

    /// A run with the seed of the options, whatever the file says.
    pub fn run_with_seed(&self, options: RunOptions) -> Run {
        let world = self
            .world
            .as_ref()
            .map(|(file, text)| Source { file, text });
        Run::new(Arc::clone(&self.scenario), world, options).unwrap()
    }
}
