//! Scenario files: what happens to devices, and what must come of it.
//!
//! ```toml
//! schema = 1
//! title = "The motor watchdog stops a silent client's vehicle"
//! good_client = "Repeats motor commands every 50 ms and sends a stop before it falls silent."
//! limit = "4 s"
//!
//! [[device]]
//! kind = "r150"
//!
//! [[step]]
//! name = "drive"
//! at = "100 ms"
//! every = "50 ms"
//! for = "2 s"
//! host = { send = { set_motors = { right = 500, left = 500 } } }
//!
//! [[step]]
//! after = "drive"
//! expect = { that = "truth.at_rest", within = "1.5 s" }
//!
//! [[always]]
//! that = "client.travel_since_motor_command_m < 0.6"
//! ```

mod actions;
mod check;
mod compose;
mod document;
mod files;
mod host;

use std::collections::BTreeMap;
use std::path::Path;
use std::time::Duration;

use rigsim_core::device::Devices;
use rigsim_core::device::parameters::{Motors, Scope};
use rigsim_core::effect::{self, Checked};
use rigsim_core::noise::Noise;
use rigsim_core::settings::SimSettings;
use rigsim_physics::{Tolerances, WorldMap};
use rigsim_settings::{Source, or_allowed, shorten};
use schemars::JsonSchema as _;
use serde_json::{Value, json};

pub use compose::{EXCLUSIVE, NamedText, ScenarioText};
pub use document::Only;
pub use files::ScenarioFiles;

pub(crate) use check::{read, read_step};
pub(crate) use host::{HostAction, HostDoes, ReplyWanted, Wanted, matches_fields};

use crate::assemble::PlannedLink;
use crate::condition::{Condition, Reading, Saved};
use crate::error::FileErrors;
use crate::rig_file::{RigPlan, device_schema, link_schema, settings_schema};
use crate::schema;
use crate::sources::MOST_ERRORS;

/// Most steps, and most conditions over time, of a file.
pub const MOST_STEPS: usize = 1000;

/// Returns whether a file that lies in a folder of scenarios is one, by its name: it ends in `.toml`
/// and is not hidden. What is in it does not count, so that a scenario with a mistake in it is
/// never passed over in silence.
#[must_use]
pub fn is_scenario_file(path: &Path) -> bool {
    let hidden = path
        .file_name()
        .is_some_and(|name| name.as_encoded_bytes().starts_with(b"."));
    path.extension().is_some_and(|ending| ending == "toml") && !hidden
}

/// The setting by which a run has other vehicles of the same make.
pub const OTHER_VEHICLES: &str = "world.tolerances=by-seed";

/// A scenario that makes sense.
#[derive(Debug, Clone)]
pub struct Scenario {
    /// What it was read from.
    pub source: ScenarioText,
    /// Title: what is tried, in a few words.
    pub title: String,
    /// Description: what happens.
    pub description: Option<String>,
    /// Behaviour of a good client.
    pub good_client: String,
    /// Words by which runs select it.
    pub tags: Vec<String>,
    /// The devices, the world file, the seed.
    pub rig: RigPlan,
    /// Time that it takes, in simulated time.
    pub limit: Duration,
    pub(crate) base: SimSettings,
    /// The parameters that are not texts.
    pub(crate) parameters: BTreeMap<String, Reading>,
    /// Devices that have the script for a client also where there is a real one.
    pub(crate) scripted: Vec<bool>,
    /// Verdicts of the mission do not count.
    pub(crate) mission_may_fail: bool,
    pub(crate) steps: Vec<Step>,
    pub(crate) rules: Vec<Rule>,
    pub(crate) responses: Vec<Response>,
    /// Values that steps remember.
    pub(crate) saved: Vec<Saved>,
    pub(crate) demand: Option<Demand>,
    /// Obstacles that have to be there, and where the file says so.
    pub(crate) obstacles: Vec<(String, String)>,
    /// Obstacles that steps bring, by their names.
    pub(crate) brought: Vec<String>,
}

/// One thing that happens.
#[derive(Debug, Clone)]
pub(crate) struct Step {
    /// As the file says, or `step 3`, or `bit-flips 2` for the second fault of a kind.
    pub name: String,
    pub trigger: Trigger,
    /// From what the trigger says to the first time.
    pub delay: Times,
    pub every: Option<Times>,
    pub count: Option<u32>,
    /// Time for which each effect lasts; of what has no effect that lasts, how long it is repeated.
    /// `None` for what has no end or needs none.
    pub lasts: Option<Times>,
    /// It ends as soon as this holds.
    pub until: Option<Condition>,
    /// Values that it remembers: for each its index among all that is saved, and the condition.
    pub remember: Vec<(usize, Condition)>,
    pub probability: Option<f64>,
    pub optional: bool,
    pub only: Option<Only>,
    pub mission: bool,
    pub device: usize,
    pub action: StepAction,
}

impl Step {
    /// The fault that it brings, if it brings one.
    pub(crate) fn fault(&self) -> Option<&Checked> {
        match &self.action {
            StepAction::Effect(effect) => Some(effect).filter(|effect| effect.info().is_fault()),
            StepAction::Host(_) | StepAction::Expect { .. } | StepAction::Nothing => None,
        }
    }

    /// Returns whether what it does has an end only by `for` and `until` of the whole step, not of
    /// each time.
    pub(crate) fn is_repeated_for(&self) -> bool {
        matches!(self.action, StepAction::Host(_) | StepAction::Expect { .. })
    }

    /// Returns whether it is repeated without end.
    pub(crate) fn is_endless(&self) -> bool {
        let ends = self.count.is_some()
            || self.until.is_some()
            || (self.is_repeated_for() && self.lasts.is_some());
        self.every.is_some() && !ends
    }
}

/// A time, or a range from which one is drawn.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub(crate) struct Times {
    pub min: Duration,
    pub max: Duration,
}

impl Times {
    /// The time, or one that is drawn.
    pub(crate) fn draw(self, noise: &mut Noise) -> Duration {
        if self.min == self.max {
            return self.min;
        }
        self.min + (self.max - self.min).mul_f64(noise.uniform())
    }
}

/// Beginning of a step.
#[derive(Debug, Clone)]
pub(crate) enum Trigger {
    At(Times),
    When(Condition),
    /// The step with this index is done.
    After(usize),
}

/// Action of a step.
#[derive(Debug, Clone)]
pub(crate) enum StepAction {
    Host(HostAction),
    /// Something breaks, an action is done, or something changes around the device.
    Effect(Checked),
    Expect {
        that: Condition,
        within: Option<Duration>,
        message: Option<String>,
    },
    /// It only remembers, or others wait for it.
    Nothing,
}

/// A condition over time.
#[derive(Debug, Clone)]
pub(crate) struct Rule {
    pub that: Condition,
    /// Set if the condition must hold; it must not otherwise.
    pub must_hold: bool,
    pub message: Option<String>,
    /// For how long it may be violated.
    pub longer_than: Duration,
    pub from: Duration,
    pub until: Option<Duration>,
    pub after: Option<usize>,
    pub only: Option<Only>,
    pub mission: bool,
}

/// Response that has to come each time that something happens.
#[derive(Debug, Clone)]
pub(crate) struct Response {
    pub to: Cause,
    pub then: Condition,
    /// Nothing is said if it is never due.
    pub optional: bool,
    pub within: Duration,
    pub until: Option<Duration>,
    pub message: Option<String>,
    pub only: Option<Only>,
    pub mission: bool,
}

/// Cause of a response.
#[derive(Debug, Clone)]
pub(crate) enum Cause {
    /// This becomes true.
    Whenever(Condition),
    /// The step with this index happens.
    Step(usize),
}

/// Content that the client report may have.
#[derive(Debug, Clone)]
pub(crate) struct Demand {
    pub allowed: Option<Vec<String>>,
    pub forbidden: Vec<String>,
    pub only: Option<Only>,
}

impl Scenario {
    /// Reads a scenario file; its settings change those of `base`.
    ///
    /// # Errors
    /// Up to 20 lines, each naming the file, the line, the column, the key, and what is allowed.
    pub fn parse(source: Source<'_>, base: &SimSettings) -> Result<Self, FileErrors> {
        let NamedText { file, text } = source.into();
        let source = ScenarioText {
            file,
            text,
            ..ScenarioText::default()
        };
        read(&source, base)
    }

    /// Returns whether a device has the script for a client also where there is a real one.
    #[must_use]
    pub fn is_scripted(&self, device: usize) -> bool {
        self.scripted.get(device).copied().unwrap_or(false)
    }

    /// The links that a client may open: all but those of devices that have the script for one.
    pub fn client_links(&self) -> impl Iterator<Item = PlannedLink> {
        let links = self.rig.links();
        links.filter(|link| !self.is_scripted(link.id.device))
    }

    /// The device that is meant where none is named: the only one, or the only one for a real
    /// client.
    pub(crate) fn usual_device(&self) -> Option<usize> {
        check::usual_device(&self.scripted)
    }

    /// Devices that are served and nothing else: no steps, nothing to judge, no end.
    #[must_use]
    pub fn serving(rig: RigPlan) -> Self {
        Self {
            source: ScenarioText {
                file: "rig".to_owned(),
                ..ScenarioText::default()
            },
            title: String::new(),
            description: None,
            good_client: String::new(),
            tags: Vec::new(),
            limit: Duration::MAX,
            base: rig.settings.clone(),
            parameters: BTreeMap::new(),
            scripted: vec![false; rig.devices.len()],
            mission_may_fail: false,
            rig,
            steps: Vec::new(),
            rules: Vec::new(),
            responses: Vec::new(),
            saved: Vec::new(),
            demand: None,
            obstacles: Vec::new(),
            brought: Vec::new(),
        }
    }

    /// Returns the same scenario with other vehicles of the same make, which the seed of the run
    /// chooses; `None` if its settings say by what they are chosen.
    #[must_use]
    pub fn with_other_vehicles(&self) -> Option<Self> {
        let world = &self.rig.settings.world;
        (world.tolerances == Tolerances::FirstByName).then(|| {
            let mut other = self.clone();
            other.rig.settings.world.tolerances = Tolerances::BySeed;
            other.source.set.push(OTHER_VEHICLES.to_owned());
            other
        })
    }

    /// Returns whether it has no end by itself, as devices that are only served.
    #[must_use]
    pub fn is_endless(&self) -> bool {
        self.limit == Duration::MAX
    }

    /// Returns whether the obstacles that steps move or remove are in this world, or are added by a
    /// step.
    ///
    /// # Errors
    /// A line for each that is not there, with its place in the file.
    pub(crate) fn check_obstacles(&self, map: &WorldMap) -> Result<(), String> {
        let in_map = map.obstacles.iter().filter_map(|obstacle| obstacle.name());
        let brought = self.brought.iter().map(String::as_str);
        let known: Vec<&str> = in_map.chain(brought).collect();
        let unknown: Vec<String> = self
            .obstacles
            .iter()
            .filter(|(name, _)| !known.contains(&name.as_str()))
            .map(|(name, place)| {
                let hint = or_allowed(name, &known);
                let why = format!("no obstacle is named `{name}`; {hint}");
                format!("{place}: {}", shorten(why))
            })
            .take(MOST_ERRORS)
            .collect();
        if unknown.is_empty() {
            Ok(())
        } else {
            Err(unknown.join("\n"))
        }
    }

    /// The JSON Schema of scenario files with these devices.
    #[must_use]
    pub fn json_schema(devices: Devices) -> String {
        schema::compose::<document::Document>(devices, |devices, generator| {
            let mut device = device_schema(devices, generator);
            let mut client = document::ClientText::json_schema(generator);
            let about = "Client of the device in a run with a real client: the real one, or the scripted one.";
            client.insert("description".to_owned(), about.into());
            let client = [("client".to_owned(), client.to_value())];
            schema::add_properties(&mut device, client.into_iter().collect());
            let commands = devices.iter().flat_map(|d| (d.host.schema)(generator));
            let commands = commands.collect();
            let [fault, operator, world] = ["fault", "operator", "world"].map(|key| {
                let kinds = effect::kinds(devices, key);
                kinds
                    .into_iter()
                    .map(|kind| (kind.schema)(generator))
                    .collect()
            });
            let mut changed = vec![
                ("DeviceText", device),
                ("LinkName", link_schema(devices)),
                ("SettingsText", settings_schema(devices)),
                (
                    "CommandText",
                    schema::one_of(
                        "A command by name and fields. Numbers are as on the wire.",
                        commands,
                    ),
                ),
                ("Fault", schema::one_of("Something that breaks.", fault)),
                (
                    "OperatorText",
                    schema::one_of("What an operator, the app or a passer-by does.", operator),
                ),
                (
                    "WorldText",
                    schema::one_of("A change around the vehicle.", world),
                ),
            ];
            changed.extend(motors_schema(devices).map(|motors| ("Motors", motors)));
            changed
        })
    }

    /// The faults of its steps, by their ids in the catalogue, in the order of the file.
    pub fn faults(&self) -> impl Iterator<Item = &'static str> {
        let faults = self.steps.iter().filter_map(Step::fault);
        faults.map(|fault| fault.info().id)
    }
}

/// The motors that faults of these devices may name, where they may not name all.
fn motors_schema(devices: Devices) -> Option<Value> {
    let is_taken = |&motors: &Motors| {
        let scope = Scope {
            motors: Some(motors),
            ..Scope::default()
        };
        devices.iter().any(|d| (d.check_scope)(&scope).is_ok())
    };
    let taken = Motors::ALL.into_iter().filter(is_taken);
    let words: Vec<&str> = taken.map(Motors::as_str).collect();
    (words.len() < Motors::ALL.len()).then(|| json!({ "type": "string", "enum": words }))
}

#[cfg(test)]
mod tests;
