//! Deeds of people to an R150, and things that hang on it.

use schemars::JsonSchema;
use serde::Deserialize;
use sim_physics::World;
use sim_physics::r150::{Load, PwmSource};
use sim_settings::{Frequency, Percent, Power, Resistance, SimTime, Voltage};

use super::R150;
use crate::device::{self, Actions, Change, Device, Performed, actions};
use crate::fault::parameters::{Key, RailName};
use crate::r150_device::control::{Outputs, Parts};
use crate::r150_device::vehicle::OperatorInput;

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

/// What an input changes that stays, and the input that would make it what it is now.
fn is_now(r150: &R150, input: OperatorInput) -> Option<(&'static str, OperatorInput)> {
    let (vehicle, control) = (r150.device().vehicle(), r150.device().control());
    match input {
        OperatorInput::Unlock | OperatorInput::Lock if vehicle.locked => {
            Some(("lock", OperatorInput::Lock))
        }
        OperatorInput::Unlock | OperatorInput::Lock => Some(("lock", OperatorInput::Unlock)),
        OperatorInput::Press(_) | OperatorInput::ReleaseKey => {
            let held = vehicle.held_key();
            let key = held.map_or(OperatorInput::ReleaseKey, OperatorInput::Press);
            Some(("key", key))
        }
        OperatorInput::EmergencyStop(_) => {
            let stop = OperatorInput::EmergencyStop(vehicle.emergency_stop);
            Some(("emergency stop", stop))
        }
        OperatorInput::AppHolds { .. } => {
            let Parts { power, pwm } = control.held_by_app;
            Some(("app holds", OperatorInput::AppHolds { power, pwm }))
        }
        OperatorInput::AppSets(_) => Some(("app sets", OperatorInput::AppSets(control.app))),
        OperatorInput::ReleaseParking | OperatorInput::Park | OperatorInput::Autonomous => None,
    }
}

impl device::Action for Operator {
    fn perform(&self, device: &mut dyn Device, _world: &mut World, now: SimTime) -> Performed {
        let r150 = device.get_mut::<R150>()?;
        let input = self.input();
        let before = is_now(r150, input);
        r150.operate(now, input);
        let (of, before) = before?;
        Some(Change::of(of, before, &input, |before, device, _, now| {
            if let Some(r150) = device.get_mut::<R150>() {
                r150.operate(now, before);
            }
        }))
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
        let r150 = device.get_mut::<R150>()?;
        match *self {
            Self::Load(LoadText { rail, load }) => {
                let rail = super::rail(rail);
                let before = r150.plant().load(rail);
                r150.plant_mut().set_load(rail, load);
                let now = r150.plant().load(rail);
                let of = format!("load {}", rail.index());
                Some(Change::of(of, before, &now, move |load, device, _, _| {
                    if let Some(r150) = device.get_mut::<R150>() {
                        r150.plant_mut().set_load(rail, load);
                    }
                }))
            }
            Self::PwmSignal(SignalText { input, source }) => {
                let before = r150.plant().pwm_source(input);
                r150.plant_mut().set_pwm_source(input, source);
                let of = format!("pwm input {input}");
                let restore = move |source, device: &mut dyn Device, _: &mut World, _| {
                    if let Some(r150) = device.get_mut::<R150>() {
                        r150.plant_mut().set_pwm_source(input, source);
                    }
                };
                Some(Change::of(of, before, &source, restore))
            }
        }
    }

    fn can_end(&self) -> bool {
        true
    }
}
