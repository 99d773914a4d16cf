//! Deeds of people to an R150, and things that hang on it.

use schemars::JsonSchema;
use serde::Deserialize;
use sim_physics::World;
use sim_physics::r150::{Load, PwmSource};
use sim_settings::{Frequency, Percent, Power, Resistance, SimTime, Voltage};

use super::R150;
use crate::device::{self, Actions, Change, Device, Performed, actions};
use crate::fault::OperatorFault;
use crate::fault::parameters::{Key, RailName};
use crate::r150_device::control::{Outputs, Parts};
use crate::r150_device::vehicle::{self, OperatorInput, Vehicle};

pub(super) const OPERATOR: Actions = actions::<Operator>();
pub(super) const SURROUNDINGS: Actions = actions::<Surroundings>();

/// What an operator or the app does.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Operator {
    /// R150: long press of both rear buttons.
    Unlock,
    /// R150: short press of the rear buttons.
    Lock,
    /// R150: long press of the top button.
    ReleaseParking,
    /// R150: long press of the middle button.
    Autonomous,
    /// R150: a motion key of the remote control goes down.
    Press(Key),
    /// The motion key goes up.
    Release,
    /// R150: the emergency stop goes in (true) or out.
    EmergencyStop(bool),
    /// R150: the app takes or leaves control.
    AppHolds(AppHoldsText),
    /// R150: what the app wants of the outputs.
    AppSets(AppSetsText),
}

/// Of what the app has control, whatever the client sends.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct AppHoldsText {
    /// Of the power rails.
    #[serde(default)]
    power: bool,
    /// Of the PWM outputs.
    #[serde(default)]
    pwm: bool,
}

/// The app's set-points.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct AppSetsText {
    /// Rails to be on.
    #[serde(default)]
    on: Vec<RailName>,
    /// Duty of the PWM outputs, 0.1 %.
    #[serde(default)]
    pwm: [u16; 4],
}

impl Operator {
    fn input(&self) -> OperatorInput {
        match self {
            Self::Unlock => OperatorInput::Unlock,
            Self::Lock => OperatorInput::Lock,
            Self::ReleaseParking => OperatorInput::ReleaseParking,
            Self::Autonomous => OperatorInput::Autonomous,
            Self::Press(key) => OperatorInput::Press(super::key(*key)),
            Self::Release => OperatorInput::ReleaseKey,
            Self::EmergencyStop(pushed_in) => OperatorInput::EmergencyStop(*pushed_in),
            Self::AppHolds(AppHoldsText { power, pwm }) => OperatorInput::AppHolds {
                power: *power,
                pwm: *pwm,
            },
            Self::AppSets(sets) => OperatorInput::AppSets(Outputs {
                power: super::bits(&sets.on),
                pwm: sets.pwm,
            }),
        }
    }
}

/// A change that these inputs take back, unless nothing `changed`.
fn undone_by(of: &str, changed: bool, inputs: Vec<OperatorInput>) -> Change {
    Change::of_own(of, changed, move |r150: &mut R150, now| {
        for input in inputs {
            r150.operate(now, input);
        }
    })
}

/// Changes of what the app holds, `before` and now, of these parts.
fn of_app(before: Parts, now: Parts, parts: Parts) -> Vec<Change> {
    type Part = fn(&mut Parts) -> &mut bool;
    let each: [(&str, Part); 2] = [
        ("app holds power", |parts| &mut parts.power),
        ("app holds PWM", |parts| &mut parts.pwm),
    ];
    let change = |(of, part): (&str, Part)| {
        let [before, now, is_meant] = [before, now, parts].map(|mut all| *part(&mut all));
        let restore = move |r150: &mut R150, at| {
            let mut held = r150.device().control().held_by_app;
            *part(&mut held) = before;
            let Parts { power, pwm } = held;
            r150.operate(at, OperatorInput::AppHolds { power, pwm });
        };
        is_meant.then(|| Change::of_own(of, before != now, restore))
    };
    each.into_iter().filter_map(change).collect()
}

impl device::Action for Operator {
    fn perform(&self, device: &mut dyn Device, _world: &mut World, now: SimTime) -> Performed {
        let Some(r150) = device.get_mut::<R150>() else {
            return Ok(Vec::new());
        };
        let (vehicle, control) = (r150.device().vehicle(), r150.device().control());
        let (held, app) = (control.held_by_app, control.app);
        let input = self.input();
        let back = |of, before: OperatorInput| vec![undone_by(of, before != input, vec![before])];
        let changes = match input {
            OperatorInput::Unlock | OperatorInput::Lock if vehicle.locked => {
                back("lock", OperatorInput::Lock)
            }
            OperatorInput::Unlock | OperatorInput::Lock => back("lock", OperatorInput::Unlock),
            OperatorInput::Press(_) | OperatorInput::ReleaseKey => back("key", vehicle.key_input()),
            OperatorInput::EmergencyStop(_) => back(
                "emergency stop",
                OperatorInput::EmergencyStop(vehicle.emergency_stop),
            ),
            OperatorInput::AppHolds { power, pwm } => {
                let all = Parts {
                    power: true,
                    pwm: true,
                };
                of_app(held, Parts { power, pwm }, all)
            }
            OperatorInput::AppSets(_) => back("app sets", OperatorInput::AppSets(app)),
            OperatorInput::ReleaseParking | OperatorInput::Park | OperatorInput::Autonomous => {
                Vec::new()
            }
        };
        r150.operate(now, input);
        Ok(changes)
    }

    fn can_end(&self) -> bool {
        !matches!(
            self,
            Self::ReleaseParking | Self::Autonomous | Self::Release
        )
    }
}

/// What hangs on the vehicle.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Surroundings {
    /// R150: wires a load to a rail.
    Load(LoadText),
    /// R150: wires a signal to a PWM input.
    PwmSignal(SignalText),
}

/// A load: one of `power` and `resistance`, or nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(try_from = "LoadKeys")]
#[schemars(with = "LoadKeys", rename = "LoadText")]
struct LoadText {
    rail: RailName,
    load: Load,
}

/// A load: one of `power` and `resistance`, or nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "LoadText")]
struct LoadKeys {
    /// Output on which it hangs.
    rail: RailName,
    /// A device that draws this at any voltage.
    power: Option<Power>,
    /// A resistor.
    resistance: Option<Resistance>,
    /// A dead short.
    #[serde(default)]
    short: bool,
}

impl TryFrom<LoadKeys> for LoadText {
    type Error = &'static str;

    fn try_from(keys: LoadKeys) -> Result<Self, Self::Error> {
        let load = match (keys.power, keys.resistance, keys.short) {
            (None, None, false) => Load::Open,
            (None, None, true) => Load::Short,
            (Some(power), None, false) => Load::Power(power.0),
            (None, Some(resistance), false) => Load::Resistance(resistance.0),
            _ => return Err("a load has only one of `power`, `resistance` and `short`"),
        };
        let rail = keys.rail;
        Ok(Self { rail, load })
    }
}

/// A signal: a generator's `frequency` and `duty`, one of the module's own outputs, or nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(try_from = "SignalKeys")]
#[schemars(with = "SignalKeys", rename = "SignalText")]
struct SignalText {
    input: usize,
    source: PwmSource,
}

/// A signal: a generator's `frequency` and `duty`, one of the module's own outputs, or nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "SignalText")]
struct SignalKeys {
    /// The input.
    input: ChannelText,
    /// Of a generator.
    frequency: Option<Frequency>,
    /// Of a generator; 50 % unless given.
    duty: Option<Percent>,
    /// Of a generator; 5 V unless given.
    high: Option<Voltage>,
    /// The module's own output.
    from_output: Option<ChannelText>,
}

/// A PWM input or output.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Deserialize, JsonSchema)]
enum ChannelText {
    /// A.
    A,
    /// B.
    B,
    /// C.
    C,
    /// D.
    D,
}

impl TryFrom<SignalKeys> for SignalText {
    type Error = &'static str;

    fn try_from(keys: SignalKeys) -> Result<Self, Self::Error> {
        let source = match (keys.frequency, keys.from_output) {
            (Some(frequency), None) => PwmSource::Generator {
                frequency: frequency.0,
                duty: keys.duty.map_or(0.5, |duty| duty.0 / 100.0),
                high_voltage: keys.high.map_or(5.0, |high| high.0),
            },
            (None, _) if keys.duty.is_some() || keys.high.is_some() => {
                return Err("`duty` and `high` are a generator's, which has a `frequency`");
            }
            (None, Some(output)) => PwmSource::OwnOutput(output as usize),
            (None, None) => PwmSource::None,
            (Some(_), Some(_)) => {
                return Err("a signal has only one of `frequency` and `from_output`");
            }
        };
        let input = keys.input as usize;
        Ok(Self { input, source })
    }
}

impl device::Action for Surroundings {
    fn perform(&self, device: &mut dyn Device, _world: &mut World, _now: SimTime) -> Performed {
        let Some(r150) = device.get_mut::<R150>() else {
            return Ok(Vec::new());
        };
        let change = match *self {
            Self::Load(LoadText { rail, load }) => {
                let rail = super::rail(rail);
                let before = r150.plant().load(rail);
                r150.plant_mut().set_load(rail, load);
                let changed = before != r150.plant().load(rail);
                let restore = move |r150: &mut R150, _| r150.plant_mut().set_load(rail, before);
                Change::of_own(format!("load {}", rail.index()), changed, restore)
            }
            Self::PwmSignal(SignalText { input, source }) => {
                let before = r150.plant().pwm_source(input);
                r150.plant_mut().set_pwm_source(input, source);
                let of = format!("pwm input {input}");
                Change::of_own(of, before != source, move |r150: &mut R150, _| {
                    r150.plant_mut().set_pwm_source(input, before);
                })
            }
        };
        Ok(vec![change])
    }

    fn can_end(&self) -> bool {
        true
    }
}

/// Nobody drives with this key: it is let go at the same instant.
const TOUCH: [OperatorInput; 2] = [
    OperatorInput::Press(vehicle::Key::Forward),
    OperatorInput::ReleaseKey,
];

/// Does what people do at the worst time, unless it is done already; gives what they change.
pub(super) fn at_the_worst_time(
    r150: &mut R150,
    now: SimTime,
    fault: &OperatorFault,
) -> Vec<Change> {
    let vehicle = r150.device().vehicle();
    let &Vehicle {
        locked,
        parked,
        autonomous,
        emergency_stop,
        ..
    } = vehicle;
    let held = r150.device().control().held_by_app;
    let key = vehicle.key_input();
    // A key that goes on driving after it is let go is ended by the top button, which does nothing
    // else while the parking brake is off; while it is on, nothing drives.
    let ends_key = vehicle.key_outlasts_press() && !parked;
    let end_key = ends_key.then_some(OperatorInput::ReleaseParking);
    let mode = autonomous.then_some(OperatorInput::Autonomous);
    let (is_so, acts) = match *fault {
        OperatorFault::EmergencyStop {} => {
            (emergency_stop, vec![OperatorInput::EmergencyStop(true)])
        }
        OperatorFault::RemoteControlTakesOver { key: Some(key) } => {
            (false, vec![OperatorInput::Press(super::key(key))])
        }
        OperatorFault::RemoteControlTakesOver { key: None } => {
            (!autonomous, TOUCH.into_iter().chain(end_key).collect())
        }
        OperatorFault::Locked {} => (locked, vec![OperatorInput::Lock]),
        OperatorFault::Parked {} => (parked, vec![OperatorInput::Park]),
        OperatorFault::AppTakesControl { power, pwm } => {
            let (power, pwm) = (power || held.power, pwm || held.pwm);
            let all = vec![OperatorInput::AppHolds { power, pwm }];
            (held == Parts { power, pwm }, all)
        }
    };
    for act in acts.into_iter().filter(|_| !is_so) {
        r150.operate(now, act);
    }
    let vehicle = r150.device().vehicle();
    let unlock = undone_by(
        "lock",
        vehicle.locked && !locked,
        vec![OperatorInput::Unlock],
    );
    // The parking brake can be released in remote mode only.
    let release = TOUCH.into_iter().chain([OperatorInput::ReleaseParking]);
    let release = release.chain(mode).collect();
    let release = undone_by("parking brake", vehicle.parked && !parked, release);
    match *fault {
        OperatorFault::EmergencyStop {} => {
            // It may have locked the vehicle, too.
            let out = vec![OperatorInput::EmergencyStop(false)];
            vec![undone_by("emergency stop", !is_so, out), unlock, release]
        }
        OperatorFault::RemoteControlTakesOver { .. } => {
            let back = [key].into_iter().chain(end_key).chain(mode).collect();
            vec![undone_by("key", !is_so, back)]
        }
        OperatorFault::Locked {} => vec![unlock, release],
        OperatorFault::Parked {} => vec![release],
        OperatorFault::AppTakesControl { power, pwm } => {
            let now = r150.device().control().held_by_app;
            of_app(held, now, Parts { power, pwm })
        }
    }
}
