//! The files that make a scenario: the one that is named, and those that it is based on.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use rigsim_core::settings::SimSettings;

use super::Scenario;
use super::check::read;
use super::compose::{NamedText, ScenarioText};
use crate::error::{FileError, FileErrors};

/// Most files that are based on one another.
const MOST_BASES: usize = 8;

/// A scenario file with those that it is based on, not yet read as a scenario.
#[derive(Debug)]
pub struct ScenarioFiles {
    files: Vec<NamedText>,
    parameters: BTreeSet<String>,
    keys: BTreeSet<String>,
    /// The folder of the first of them that names a world file, which is relative to it.
    world_folder: PathBuf,
    /// Set if there is a job although the first has its own devices.
    pub is_no_fault_file: bool,
}

impl ScenarioFiles {
    /// Reads a file, then what it is based on, and so on. In the place of the file with the devices comes
    /// the `job`, if there is one.
    ///
    /// # Errors
    /// Those of `read`; and if files are based on one another in a circle.
    pub fn read<E: From<FileErrors>>(
        path: &Path,
        job: Option<&Path>,
        read: &mut dyn FnMut(&Path) -> Result<NamedText, E>,
    ) -> Result<Self, E> {
        let mut all = Self {
            files: Vec::new(),
            parameters: BTreeSet::new(),
            keys: BTreeSet::new(),
            world_folder: PathBuf::new(),
            is_no_fault_file: false,
        };
        let mut wanted_job = job;
        let mut has_world = false;
        let mut next = Some(path.to_owned());
        while let Some(path) = next.take() {
            if all.files.len() >= MOST_BASES {
                let first = all.files.first().map_or("", |first| &first.file);
                let why = format!(
                    "{first}: more than {MOST_BASES} files are based on one another, perhaps in a circle"
                );
                return Err(FileErrors::from(FileError::general(why)).into());
            }
            let file = read(&path)?;
            let glance = Glance::at(&file.text);
            let has_devices = glance.keys.contains("device");
            if has_devices && all.files.is_empty() {
                all.is_no_fault_file = wanted_job.take().is_some();
            }
            if let Some(job) = wanted_job.filter(|_| has_devices) {
                next = Some(job.to_owned());
                wanted_job = None;
                continue;
            }
            let folder = path.parent().unwrap_or(Path::new(""));
            if !has_world && glance.keys.contains("world") {
                has_world = true;
                all.world_folder = folder.to_owned();
            }
            let base = glance.base.map(|base| folder.join(base));
            if all.files.is_empty() {
                all.keys = glance.keys;
            }
            all.parameters.extend(glance.parameters);
            all.files.push(file);
            // Without a base it has no devices, which the job has.
            next = base.or_else(|| wanted_job.take().map(Path::to_owned));
        }
        Ok(all)
    }

    /// Returns the path of the world file that a scenario of these files names, if it names one.
    #[must_use]
    pub fn world_of(&self, scenario: &Scenario) -> Option<PathBuf> {
        let world = scenario.rig.world.as_ref()?;
        Some(self.world_folder.join(world))
    }

    /// Returns whether any of them has a parameter of this name.
    #[must_use]
    pub fn has_parameter(&self, name: &str) -> bool {
        self.parameters.contains(name)
    }

    /// The kind of file that the first looks like, if it is not a scenario.
    #[must_use]
    pub fn other_kind(&self) -> Option<&'static str> {
        let has = |key: &&str| self.keys.contains(*key);
        if ["title", "limit", "step", "base"].iter().any(has) {
            return None;
        }
        let things = ["wall", "box", "circle", "slope", "friction", "tag", "strip"];
        match (things.iter().any(has), has(&"device")) {
            (true, false) => Some("world"),
            (false, true) if has(&"schema") && !has(&"good_client") => Some("rig"),
            _ => None,
        }
    }

    /// The scenario that they make with these `parameters` and settings `set`, which win over the files';
    /// the files' settings change those of `base`.
    ///
    /// # Errors
    /// As [`Scenario::parse`]; and if there is a job for what is not a fault file.
    pub fn compose(
        &self,
        parameters: &[(String, String)],
        set: &[String],
        base: &SimSettings,
    ) -> Result<Scenario, FileErrors> {
        let mut files = self.files.iter().cloned();
        let first = files.next().unwrap_or_default();
        if self.is_no_fault_file {
            let why = "has its own devices, so it is not a fault file for a job";
            return Err(FileError::general(format!("{} {why}", first.file)).into());
        }
        let source = ScenarioText {
            file: first.file,
            text: first.text,
            base: files.collect(),
            parameters: parameters.to_vec(),
            set: set.to_vec(),
        };
        read(&source, base)
    }
}

/// Parts of a file that are read before those that it is based on. Of what is not TOML nothing is
/// known; that is reported when it is read.
#[derive(Debug, Default)]
struct Glance {
    keys: BTreeSet<String>,
    /// The file that it is based on, relative to it.
    base: Option<PathBuf>,
    /// The names of its parameters.
    parameters: BTreeSet<String>,
}

impl Glance {
    fn at(text: &str) -> Self {
        let table: toml::Table = text.parse().unwrap_or_default();
        let base = table.get("base").and_then(toml::Value::as_str);
        let parameters = table.get("parameters").and_then(toml::Value::as_table);
        let parameters = parameters.into_iter().flatten();
        Self {
            base: base.map(PathBuf::from),
            parameters: parameters.map(|(name, _)| name.clone()).collect(),
            keys: table.into_iter().map(|(key, _)| key).collect(),
        }
    }
}
