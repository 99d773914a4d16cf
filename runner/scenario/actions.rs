//! What operators do and what changes around a vehicle.

use sim_core::mecanum_device as mecanum;
use sim_core::mecanum_device::kinematics::{Course, Movement};
use sim_core::r150_device::control::Outputs;
use sim_core::r150_device::vehicle::{Action, Key};
use sim_physics::r150::{Load, PwmSource, Rail};
use sim_physics::{Pose, WorldMap};

use super::document::{ChannelText, LoadText, OperatorText, SignalText, WorldText};
use super::host::bits;
use crate::Kind;
use crate::suggest::or_allowed;

/// What somebody does to a vehicle, and what ends it if it is to last.
#[derive(Debug, Clone)]
pub(crate) enum OperatorAction {
    R150(Action, Option<Action>),
    Mecanum(mecanum::Action, Option<mecanum::Action>),
    /// Ahead, left, counter-clockwise.
    Push([f64; 3]),
    Payload(f64),
    Place(Pose),
}

/// What changes around a vehicle.
#[derive(Debug, Clone)]
pub(crate) enum WorldAction {
    Add(Box<WorldMap>),
    Move {
        obstacle: String,
        place: [f64; 2],
        heading: Option<f64>,
    },
    Remove(String),
    Friction(f64),
    Load(Rail, Load),
    Pwm(usize, PwmSource),
}

impl OperatorAction {
    pub(super) fn read(text: &OperatorText, kind: Kind) -> Result<Self, String> {
        let both = match text {
            OperatorText::Push(push) => Some(Self::Push([
                push.ahead.map_or(0.0, |force| force.0),
                push.left.map_or(0.0, |force| force.0),
                push.turn.map_or(0.0, |torque| torque.0),
            ])),
            OperatorText::Payload(mass) => Some(Self::Payload(mass.0)),
            OperatorText::Place(place) => Some(Self::Place(Pose {
                x: place.x.0,
                y: place.y.0,
                heading: place.heading.map_or(0.0, |angle| angle.0.to_radians()),
            })),
            _ => None,
        };
        match (both, kind) {
            (Some(action), _) => Ok(action),
            (None, Kind::R150) => r150(text),
            (None, Kind::Mecanum) => car(text),
        }
    }

    /// Whether it can be undone after a time.
    pub(crate) fn can_end(&self) -> bool {
        match self {
            Self::R150(_, end) => end.is_some(),
            Self::Mecanum(_, end) => end.is_some(),
            Self::Push(_) | Self::Payload(_) => true,
            Self::Place(_) => false,
        }
    }
}

fn r150(text: &OperatorText) -> Result<OperatorAction, String> {
    let (action, end) = match text {
        OperatorText::Unlock => (Action::Unlock, Some(Action::Lock)),
        OperatorText::Lock => (Action::Lock, Some(Action::Unlock)),
        OperatorText::ReleaseParking => (Action::ReleaseParking, None),
        OperatorText::Autonomous => (Action::Autonomous, None),
        OperatorText::Press(key) => {
            let key = match key.as_str() {
                "forward" => Key::Forward,
                "backward" => Key::Backward,
                "left" => Key::Left,
                "right" => Key::Right,
                other => {
                    let allowed = or_allowed(other, &["forward", "backward", "left", "right"]);
                    return Err(format!("no key `{other}`; {allowed}"));
                }
            };
            (Action::Press(key), Some(Action::ReleaseKey))
        }
        OperatorText::Release => (Action::ReleaseKey, None),
        OperatorText::EmergencyStop(pushed_in) => (
            Action::EmergencyStop(*pushed_in),
            Some(Action::EmergencyStop(!pushed_in)),
        ),
        OperatorText::AppHolds(holds) => (
            Action::AppHolds {
                power: holds.power,
                pwm: holds.pwm,
            },
            Some(Action::AppHolds {
                power: false,
                pwm: false,
            }),
        ),
        OperatorText::AppSets(sets) => {
            let outputs = Outputs {
                power: bits(&sets.on),
                pwm: sets.pwm,
            };
            (Action::AppSets(outputs), None)
        }
        OperatorText::Push(_) | OperatorText::Payload(_) | OperatorText::Place(_) => {
            return Err("this is no button".to_owned());
        }
    };
    Ok(OperatorAction::R150(action, end))
}

fn car(text: &OperatorText) -> Result<OperatorAction, String> {
    match text {
        OperatorText::Press(key) => {
            let all = || {
                Course::ALL
                    .into_iter()
                    .flat_map(|course| [false, true].map(|negative| Movement { course, negative }))
            };
            let word = |movement: Movement| movement.name().replace(' ', "-");
            let movement = all().find(|movement| word(*movement) == *key);
            let movement = movement.ok_or_else(|| {
                let names: Vec<String> = all().map(word).collect();
                let names: Vec<&str> = names.iter().map(String::as_str).collect();
                format!("no key `{key}`; {}", or_allowed(key, &names))
            })?;
            Ok(OperatorAction::Mecanum(
                mecanum::Action::Press(movement),
                Some(mecanum::Action::Release),
            ))
        }
        OperatorText::Release => Ok(OperatorAction::Mecanum(mecanum::Action::Release, None)),
        _ => Err("a mecanum car has press, release, push, payload and place".to_owned()),
    }
}

impl WorldAction {
    pub(super) fn read(text: &WorldText, kind: Kind) -> Result<Self, String> {
        match text {
            WorldText::Add(table) => add(table).map(|map| Self::Add(Box::new(map))),
            WorldText::Move(to) => Ok(Self::Move {
                obstacle: to.obstacle.clone(),
                place: [to.x.0, to.y.0],
                heading: to.heading.map(|angle| angle.0.to_radians()),
            }),
            WorldText::Remove(obstacle) => Ok(Self::Remove(obstacle.clone())),
            WorldText::Friction(friction) if (0.0..=2.0).contains(friction) => {
                Ok(Self::Friction(*friction))
            }
            WorldText::Friction(friction) => Err(format!(
                "friction {friction} is out of range; allowed: 0 to 2"
            )),
            WorldText::Load(_) | WorldText::PwmSignal(_) if kind != Kind::R150 => {
                Err("only an R150 has rails and PWM inputs".to_owned())
            }
            WorldText::Load(load) => Ok(Self::Load(load.rail.rail(), read_load(load)?)),
            WorldText::PwmSignal(signal) => {
                Ok(Self::Pwm(signal.input as usize, read_signal(signal)?))
            }
        }
    }

    /// Whether it can be undone after a time.
    pub(crate) fn can_end(&self) -> bool {
        let Self::Add(map) = self else {
            return true;
        };
        let WorldMap {
            obstacles,
            slopes,
            frictions,
            tags,
            strips,
        } = map.as_ref();
        let ground = slopes.len() + frictions.len() + tags.len() + strips.len();
        ground == 0 && obstacles.iter().all(|obstacle| obstacle.name().is_some())
    }

    /// The obstacle that has to be there.
    pub(crate) fn obstacle(&self) -> Option<&str> {
        match self {
            Self::Move { obstacle, .. } | Self::Remove(obstacle) => Some(obstacle),
            _ => None,
        }
    }

    /// The obstacles that it brings, as far as they have names.
    pub(crate) fn brings(&self) -> impl Iterator<Item = &str> {
        let map = match self {
            Self::Add(map) => Some(map),
            _ => None,
        };
        map.into_iter()
            .flat_map(|map| map.obstacles.iter())
            .filter_map(|obstacle| obstacle.name())
    }
}

/// Reads a table as if it were a world file, so that there is one form for both.
fn add(table: &toml::Table) -> Result<WorldMap, String> {
    let mut file = table.clone();
    file.insert("schema".to_owned(), toml::Value::Integer(1));
    WorldMap::from_toml(&file.to_string(), "").map_err(|error| match error.key {
        Some(key) => format!("`{key}`: {}", error.why),
        None => error.why,
    })
}

fn read_load(load: &LoadText) -> Result<Load, String> {
    match (load.power, load.resistance, load.short) {
        (None, None, false) => Ok(Load::Open),
        (None, None, true) => Ok(Load::Short),
        (Some(power), None, false) => Ok(Load::Power(power.0)),
        (None, Some(resistance), false) => Ok(Load::Resistance(resistance.0)),
        _ => Err("a load has only one of `power`, `resistance` and `short`".to_owned()),
    }
}

fn read_signal(signal: &SignalText) -> Result<PwmSource, String> {
    match (signal.frequency, signal.from_output) {
        (Some(frequency), None) => Ok(PwmSource::Generator {
            frequency: frequency.0,
            duty: signal.duty.map_or(0.5, |duty| duty.0 / 100.0),
            high_voltage: signal.high.map_or(5.0, |high| high.0),
        }),
        (None, _) if signal.duty.is_some() || signal.high.is_some() => {
            Err("`duty` and `high` are a generator's, which has a `frequency`".to_owned())
        }
        (None, Some(output)) => Ok(PwmSource::OwnOutput(output as usize)),
        (None, None) => Ok(PwmSource::None),
        (Some(_), Some(_)) => {
            Err("a signal has only one of `frequency` and `from_output`".to_owned())
        }
    }
}

const _: () = assert!(
    ChannelText::D as usize == 3,
    "channels are numbered as they stand"
);
