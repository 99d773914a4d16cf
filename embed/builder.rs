//! Parts of a simulation.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use rigsim_core::device::Devices;
use rigsim_core::line::Wire;
use rigsim_core::settings::SimSettings;
use rigsim_runner::scenario::{NamedText, ScenarioFiles};
use rigsim_runner::{RigPlan, Run, RunOptions, Scenario};
use rigsim_settings::Source;
use toml::{Table, Value};

use crate::error::Error;
use crate::simulation::Simulation;
use crate::spawn::Spawned;

/// Seed of everything random unless one is given, so that a test is the same every time.
const SEED: u64 = 1;

/// A device to be simulated.
///
/// ```
/// # use rigsim_embed::{NewDevice, Simulation};
/// let car = NewDevice::new("mecanum")
///     .named("car")
///     .with("ros", true)
///     .at(1.0, 0.0, 90.0)
///     .set("link_timeout", "500 ms");
/// let sim = Simulation::builder().device(car).build()?;
/// # Ok::<(), rigsim_embed::Error>(())
/// ```
#[derive(Debug, Clone)]
pub struct NewDevice {
    keys: Table,
    settings: Table,
}

impl NewDevice {
    /// A device of this kind: `r150` or `mecanum`, ready to drive at the origin.
    #[must_use]
    pub fn new(kind: &str) -> Self {
        let kind = ("kind".to_owned(), kind.into());
        Self {
            keys: Table::from_iter([kind]),
            settings: Table::new(),
        }
    }

    /// Sets its name; the default is its kind.
    #[must_use]
    pub fn named(self, name: &str) -> Self {
        self.with("name", name)
    }

    /// Places it there at the start: m, m, degrees counter-clockwise from x.
    #[must_use]
    pub fn at(self, x: f64, y: f64, heading: f64) -> Self {
        let text = |number: f64, unit| Value::from(format!("{number} {unit}"));
        let pose = [
            ("x", text(x, "m")),
            ("y", text(y, "m")),
            ("heading", text(heading, "deg")),
        ];
        let pose = pose.map(|(key, value)| (key.to_owned(), value));
        self.with("pose", Table::from_iter(pose))
    }

    /// Sets any other key of a `[[device]]` of rig files, as `start = "locked"` of an R150.
    #[must_use]
    pub fn with(mut self, key: &str, value: impl Into<Value>) -> Self {
        self.keys.insert(key.to_owned(), value.into());
        self
    }

    /// Changes a setting of it, written without its kind as in rig files: `heartbeat_timeout`, `5
    /// s`.
    #[must_use]
    pub fn set(mut self, setting: &str, value: impl Into<Value>) -> Self {
        insert(&mut self.settings, setting, value.into());
        self
    }

    fn table(mut self) -> Value {
        if !self.settings.is_empty() {
            self.keys
                .insert("settings".to_owned(), self.settings.into());
        }
        self.keys.into()
    }
}

impl From<&str> for NewDevice {
    fn from(kind: &str) -> Self {
        Self::new(kind)
    }
}

/// Makes a table of what has dots in its key, as TOML does.
fn insert(table: &mut Table, key: &str, value: Value) {
    match key.split_once('.') {
        Some((group, rest)) => {
            let inner = table.entry(group).or_insert_with(|| Table::new().into());
            if let Value::Table(inner) = inner {
                insert(inner, rest, value);
            }
        }
        None => drop(table.insert(key.to_owned(), value)),
    }
}

/// Where the devices come from.
#[derive(Debug, Clone)]
enum Origin {
    Devices(Vec<NewDevice>),
    Rig(PathBuf),
    Scenario(PathBuf),
}

/// A simulation to be built.
#[derive(Debug, Clone)]
pub struct Builder {
    table: Devices,
    from: Origin,
    job: Option<PathBuf>,
    parameters: Vec<(String, String)>,
    settings: Table,
    world: Option<PathBuf>,
    seed: Option<u64>,
    speed: f64,
}

impl Default for Builder {
    fn default() -> Self {
        Self {
            table: rigsim_core::SHIPPED,
            from: Origin::Devices(Vec::new()),
            job: None,
            parameters: Vec::new(),
            settings: Table::new(),
            world: None,
            seed: None,
            speed: 1.0,
        }
    }
}

impl Simulation {
    /// One device of this kind with everything as it is by default.
    ///
    /// # Errors
    /// When there is no such kind of device.
    pub fn of(kind: &str) -> Result<Self, Error> {
        Self::builder().device(kind).build()
    }

    /// Devices, settings, worlds and scenarios of your choice.
    #[must_use]
    pub fn builder() -> Builder {
        Builder::default()
    }
}

impl Builder {
    /// Knows the devices of this table instead of those that ship: `docs/devices.md`.
    #[must_use]
    pub fn table(self, table: Devices) -> Self {
        Self { table, ..self }
    }

    /// Adds a device; [`NewDevice`] says more of it than its kind.
    #[must_use]
    pub fn device(mut self, device: impl Into<NewDevice>) -> Self {
        match &mut self.from {
            Origin::Devices(devices) => devices.push(device.into()),
            from => *from = Origin::Devices(vec![device.into()]),
        }
        self
    }

    /// Takes the devices of a rig file instead.
    #[must_use]
    pub fn rig_file(mut self, path: impl Into<PathBuf>) -> Self {
        self.from = Origin::Rig(path.into());
        self
    }

    /// Plays a scenario file with your client in the place of its scripted one;
    /// [`Simulation::finish`] gives the verdict.
    #[must_use]
    pub fn scenario_file(mut self, path: impl Into<PathBuf>) -> Self {
        self.from = Origin::Scenario(path.into());
        self
    }

    /// Plays the scenario file, which is a fault file, within this job.
    #[must_use]
    pub fn job(mut self, path: impl Into<PathBuf>) -> Self {
        self.job = Some(path.into());
        self
    }

    /// Sets a parameter of the scenario file, as `pwm` to `300`.
    #[must_use]
    pub fn parameter(mut self, name: &str, value: impl ToString) -> Self {
        self.parameters.push((name.to_owned(), value.to_string()));
        self
    }

    /// Changes a setting of all devices or of the world, as `world.slope` to `10 deg`; `sim config`
    /// lists them.
    #[must_use]
    pub fn set(mut self, setting: &str, value: impl Into<Value>) -> Self {
        insert(&mut self.settings, setting, value.into());
        self
    }

    /// Builds the world from a world file.
    #[must_use]
    pub fn world_file(mut self, path: impl Into<PathBuf>) -> Self {
        self.world = Some(path.into());
        self
    }

    /// Seeds everything random; the same seed unless given, so that a test is the same every time.
    #[must_use]
    pub fn seed(mut self, seed: u64) -> Self {
        self.seed = Some(seed);
        self
    }

    /// Simulated seconds for each second of real time, where it is served.
    #[must_use]
    pub fn speed(mut self, speed: f64) -> Self {
        self.speed = speed;
        self
    }

    /// Builds it, in simulated time.
    ///
    /// # Errors
    /// When a file cannot be read, or what it or a call here says makes no sense.
    pub fn build(&self) -> Result<Simulation, Error> {
        self.run().map(Simulation::new)
    }

    /// Builds it and serves it in real time, in its own thread.
    ///
    /// # Errors
    /// As [`Builder::build`], or when a pseudo-terminal or the thread cannot be made.
    pub fn spawn(&self) -> Result<Spawned, Error> {
        Spawned::start(self.run()?, self.folder(), self.speed)
    }

    /// The folder that paths in a file are relative to.
    fn folder(&self) -> &Path {
        let parent = match &self.from {
            Origin::Devices(_) => None,
            Origin::Rig(path) | Origin::Scenario(path) => path.parent(),
        };
        parent.unwrap_or(Path::new(""))
    }

    fn run(&self) -> Result<Run, Error> {
        let (scenario, named) = self.scenario()?;
        let world = self.world.clone().or(named);
        let world = world.map(|path| read(&path)).transpose()?;
        let world = world.as_ref().map(NamedText::source);
        let options = RunOptions {
            seed: self.seed.or(scenario.rig.seed).unwrap_or(SEED),
            wire: Wire::Paced,
            live: true,
            trace: false,
        };
        Ok(Run::new(Arc::new(scenario), world, options)?)
    }

    /// With the world file that it names.
    fn scenario(&self) -> Result<(Scenario, Option<PathBuf>), Error> {
        let base = self.base()?;
        let rig = match &self.from {
            Origin::Devices(devices) => {
                let devices = devices.iter().cloned().map(NewDevice::table);
                let rig = [
                    ("schema".to_owned(), Value::from(1)),
                    ("device".to_owned(), Value::Array(devices.collect())),
                ];
                let text = Table::from_iter(rig).to_string();
                let file = "simulation";
                RigPlan::parse(Source { file, text: &text }, &base)?
            }
            Origin::Rig(path) => RigPlan::parse(read(path)?.source(), &base)?,
            Origin::Scenario(path) => {
                let files = ScenarioFiles::read(path, self.job.as_deref(), &mut read)?;
                let scenario = files.compose(&self.parameters, &[], &base)?;
                let world = files.world_of(&scenario);
                return Ok((scenario, world));
            }
        };
        let world = rig.world.as_ref().map(|path| self.folder().join(path));
        Ok((Scenario::serving(rig), world))
    }

    fn base(&self) -> Result<SimSettings, Error> {
        let mut settings = SimSettings::new(self.table);
        let text = self.settings.to_string();
        rigsim_settings::load_toml(&text, "settings", &mut settings)
            .map_err(rigsim_runner::FileErrors::from)?;
        Ok(settings)
    }
}

fn read(path: &Path) -> Result<NamedText, Error> {
    let text = std::fs::read_to_string(path).map_err(|source| Error::File {
        path: path.to_owned(),
        source,
    })?;
    let file = path.display().to_string();
    Ok(NamedText { file, text })
}
