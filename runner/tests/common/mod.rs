//! The files of the library, read for the pure crate.

#![allow(
    dead_code,
    reason = "each test program uses the part of this that it needs"
)]

use std::fs;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use sim_core::settings::SimSettings;
use sim_runner::scenario::is_scenario_file;
use sim_runner::{Run, RunOptions, Scenario};
use sim_settings::Source;

/// The folders of the library, one for each kind of device.
pub const FOLDERS: [&str; 2] = ["r150", "mecanum"];

/// A scenario file with the world file that it names.
pub struct Loaded {
    pub path: PathBuf,
    pub scenario: Arc<Scenario>,
    world: Option<(String, String)>,
}

/// The shipped scenario files, in the order of their names.
pub fn files() -> Vec<PathBuf> {
    let mut files = Vec::new();
    for folder in FOLDERS {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../scenarios")
            .join(folder);
        for entry in fs::read_dir(folder).unwrap() {
            files.push(entry.unwrap().path());
        }
    }
    files.retain(|file| is_scenario_file(file));
    files.sort();
    files
}

/// The name of a file as users write it, as in `r150/cable-pulled`.
pub fn name(file: &Path) -> String {
    let stem = file.with_extension("");
    let parts: Vec<_> = stem.iter().rev().take(2).collect();
    format!("{}/{}", parts[1].display(), parts[0].display())
}

impl Loaded {
    pub fn read(path: &Path) -> Result<Self, String> {
        let text = fs::read_to_string(path).map_err(|error| error.to_string())?;
        let file = path.display().to_string();
        let source = Source {
            file: &file,
            text: &text,
        };
        let scenario = Scenario::parse(source, &SimSettings::new(sim_core::SHIPPED))
            .map_err(|errors| errors.to_string())?;
        let world = match scenario.world() {
            Some(world) => {
                let world = path.with_file_name("").join(world);
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
        let world = self
            .world
            .as_ref()
            .map(|(file, text)| Source { file, text });
        Run::new(
            Arc::clone(&self.scenario),
            world,
            RunOptions { seed, ..options },
        )
        .unwrap()
    }
}
