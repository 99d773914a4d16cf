//! What people do to an R150, and what hangs on it.

use rigsim_physics::r150::PwmSource;
use rigsim_settings::{Frequency, Percent, SimTime};
use schemars::JsonSchema;
use serde::Deserialize;

use super::R150;
use crate::device::{Begin, Change, Effect, EffectError, Work};
use crate::r150_device::control::Parts;
use crate::r150_device::vehicle::{Key, OperatorInput, Vehicle};

/// A change that these inputs take back, unless nothing `changed`.
fn undone_by(of: &str, changed: bool, inputs: Vec<OperatorInput>) -> Change {
    Change::of_own(of, changed, move |r150: &mut R150, now| {
        for input in inputs {
            r150.device.operate(now, input);
        }
    })
}

/// Changes of what the app holds, `before` and now.
fn of_app(before: Parts, now: Parts) -> Vec<Change> {
    type Part = fn(&mut Parts) -> &mut bool;
    let each: [(&str, Part); 2] = [
        ("app holds power", |parts| &mut parts.power),
        ("app holds PWM", |parts| &mut parts.pwm),
    ];
    let change = |(of, part): (&str, Part)| {
        let [before, now] = [before, now].map(|mut all| *part(&mut all));
        let restore = move |r150: &mut R150, at| {
            let mut held = r150.device.control().held_by_app;
            *part(&mut held) = before;
            r150.device.operate(at, OperatorInput::AppHolds(held));
        };
        Change::of_own(of, before != now, restore)
    };
    each.into_iter().map(change).collect()
}

impl Effect for OperatorInput {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let r150 = at.device.typed::<R150>();
        Ok(Work::Done(operate(*self, r150, at.now)))
    }

    fn can_end(&self) -> bool {
        !matches!(
            self,
            Self::ReleaseParking | Self::Autonomous | Self::ReleaseKey
        )
    }
}

/// This key drives nothing: it is let go at the same instant.
const TOUCH: [OperatorInput; 2] = [
    OperatorInput::Press(Key::Forward),
    OperatorInput::ReleaseKey,
];

/// Works buttons; returns what that changes, also where it was so before.
fn operate(input: OperatorInput, r150: &mut R150, now: SimTime) -> Vec<Change> {
    let vehicle = r150.device.vehicle();
    let &Vehicle {
        locked,
        parked,
        autonomous,
        emergency_stop,
        ..
    } = vehicle;
    let (held, app) = {
        let control = r150.device.control();
        (control.held_by_app, control.app)
    };
    let key = vehicle.key_input();
    let mode = autonomous.then_some(OperatorInput::Autonomous);
    let inputs = match input {
        OperatorInput::TakeOver if !autonomous => Vec::new(),
        OperatorInput::TakeOver => TOUCH.to_vec(),
        input => vec![input],
    };
    for &input in &inputs {
        r150.device.operate(now, input);
    }
    let vehicle = r150.device.vehicle();
    let back = if locked {
        OperatorInput::Lock
    } else {
        OperatorInput::Unlock
    };
    let lock = undone_by("lock", vehicle.locked != locked, vec![back]);
    // The parking brake can be released in remote mode only.
    let release = TOUCH.into_iter().chain([OperatorInput::ReleaseParking]);
    let release = release.chain(mode).collect();
    let release = undone_by("parking brake", vehicle.parked && !parked, release);
    match input {
        OperatorInput::Unlock => vec![lock],
        OperatorInput::Lock => vec![lock, release],
        OperatorInput::Park => vec![release],
        OperatorInput::Press(_) | OperatorInput::TakeOver | OperatorInput::ReleaseKey => {
            let changed = !inputs.is_empty() && inputs != [key];
            let back = [key].into_iter().chain(mode).collect();
            vec![undone_by("key", changed, back)]
        }
        OperatorInput::EmergencyStop(pushed_in) => {
            let back = vec![OperatorInput::EmergencyStop(emergency_stop)];
            let stop = undone_by("emergency stop", emergency_stop != pushed_in, back);
            match pushed_in {
                // It may have locked the vehicle, too.
                true => vec![stop, lock, release],
                false => vec![stop],
            }
        }
        OperatorInput::AppHolds(_) => of_app(held, r150.device.control().held_by_app),
        OperatorInput::AppSets(_) => {
            let before = OperatorInput::AppSets(app);
            vec![undone_by("app sets", input != before, vec![before])]
        }
        OperatorInput::ReleaseParking | OperatorInput::Autonomous => Vec::new(),
    }
}

crate::actions! {
    /// What hangs on the vehicle.
    pub enum Surroundings: World {
        /// R150: wires a signal to a PWM input.
        PwmSignal(SignalText) = "pwm_signal";
    }
}

/// A signal: a generator's `frequency` and `duty`, one of the module's own outputs, or nothing.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(try_from = "SignalKeys")]
#[schemars(with = "SignalKeys", rename = "SignalText")]
pub struct SignalText {
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
    /// Of a generator; default 50 %.
    duty: Option<Percent>,
    /// The module's own output.
    from_output: Option<ChannelText>,
}

rigsim_settings::file_words! {
    /// A PWM input or output.
    enum ChannelText {
        /// A.
        A = "A",
        /// B.
        B = "B",
        /// C.
        C = "C",
        /// D.
        D = "D",
    }
}

impl TryFrom<SignalKeys> for SignalText {
    type Error = &'static str;

    fn try_from(keys: SignalKeys) -> Result<Self, Self::Error> {
        let source = match (keys.frequency, keys.from_output) {
            (Some(frequency), None) => PwmSource::Generator {
                frequency: frequency.0,
                duty: keys.duty.map_or(0.5, |duty| duty.0 / 100.0),
                high_voltage: 5.0,
            },
            (None, _) if keys.duty.is_some() => {
                return Err("`duty` is a generator's, which has a `frequency`");
            }
            (None, Some(output)) => PwmSource::OwnOutput(output.index()),
            (None, None) => PwmSource::None,
            (Some(_), Some(_)) => {
                return Err("a signal has only one of `frequency` and `from_output`");
            }
        };
        let input = keys.input.index();
        Ok(Self { input, source })
    }
}

impl Effect for Surroundings {
    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        let r150 = at.device.typed::<R150>();
        let Self::PwmSignal(SignalText { input, source }) = *self;
        let before = r150.plant.pwm_source(input);
        r150.plant.set_pwm_source(input, source);
        let of = format!("pwm input {input}");
        let restore = move |r150: &mut R150, _| r150.plant.set_pwm_source(input, before);
        Ok(Work::Done(vec![Change::of_own(
            of,
            before != source,
            restore,
        )]))
    }
}
