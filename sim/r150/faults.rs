//! Faults that only an R150 has, and what all faults together make of its hardware.

use std::time::Duration;

use rigsim_physics::r150::{FuseId, Load, Pair, R150Faults, R150Plant, Rail, Side, Sides};
use rigsim_settings::{Percent, Power, Resistance, SimTime, Span, Voltage};

use super::R150;
use crate::device::parameters::{Motors, Scope};
use crate::device::{
    Begin, Declared, Device, Effect, EffectError, MotorState, OnHardware, Sum, Tally, Work,
};
use crate::effect::{Frames, defaults};
use crate::message::Message;
use crate::noise::Noise;
use crate::r150_device::can::CanFailure;
use crate::r150_device::command::{self, Request};

/// Drag on the wheels of a side unless given, N·m.
pub(super) const USUAL_DRAG: f64 = 100.0;
/// Slower than this wheels stand, rad/s.
const STANDING: f64 = 0.01;
/// Temperature of a converter that is too hot, °C.
const HOT: f64 = 95.0;

/// Checks that an R150 has such a target.
pub(super) fn check_scope(scope: &Scope) -> Result<(), String> {
    if let Some(command) = scope.command
        && command::name(command).is_none()
    {
        let known = Request::INFOS
            .iter()
            .map(|info| format!("0x{:02X}", info.id));
        let known = known.collect::<Vec<_>>().join(", ");
        return Err(format!(
            "`command`: the R150 has no command 0x{command:02X}; it has {known}"
        ));
    }
    if let Some(motors) = scope.motors.filter(|motors| motors.is_wheel()) {
        return Err(format!(
            "`motors`: the wheels of one side of an R150 are geared together; \"{motors}\" must \
             be \"left\", \"right\" or \"all\""
        ));
    }
    Ok(())
}

crate::faults! {
    /// Replies, supply, outputs, fuses and cables of an R150.
    pub enum R150Fault {
        /// Replies have a wrong CRC.
        BadCrc = "bad-crc", Protocol,
        sees "A reply that it must discard.",
        counts "The CRC of a reply was changed.",
        tries ["", "count = 1"]
        {}
        only "Only replies to this command; default all."
        chance "Probability for each reply; default 1." "defaults::always"
        most
        /// Another load is connected to an output. Give its power or its resistance.
        RailLoad = "rail-load", Electrical,
        sees "Another current in 0x06; above the limit the output trips and `sysStatus` says so.",
        counts "The output was on.",
        tries ["rail = \"12v-a\", power = \"300 W\"", "rail = \"48v\", power = \"1000 W\"", "rail = \"5v\", power = \"100 W\""]
        {
            /// Output.
            rail: Rail,
            /// Power that it draws.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            power: Option<Power>,
            /// Resistance of the load.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            resistance: Option<Resistance>,
        }
        /// An output is shorted.
        RailShort = "rail-short", Electrical,
        sees "The output trips within a millisecond and `sysStatus` says so; 0x02 may answer false.",
        counts "The output was on.",
        tries ["rail = \"12v-a\"", "rail = \"48v\"", "rail = \"5v\""]
        weaker ["rail-load"]
        {
            /// Output.
            rail: Rail,
        }
        /// The supply sags.
        SupplySag = "supply-sag", Electrical,
        sees "A lower `voltage_48v` and speed; under 39 V the power module fault and all outputs off.",
        counts "The supply was lower by 0.1 V or more.",
        tries ["by = \"15 V\"", ""]
        {
            /// Voltage drop at any current; default 10 V.
            #[serde(default = "defaults::sag")]
            by: Voltage,
            /// Further resistance in series, up to 10 ohm; default none.
            #[serde(default = "defaults::no_resistance")]
            resistance: Resistance,
        }
        /// A pair of 12 V outputs gets hot: 95 °C.
        OverTemperature = "over-temperature", Electrical,
        sees "A high `temp_12v`; above 85 °C the pair goes off and `sysStatus` says so.",
        counts "The sensor read more than without the fault.",
        tries ["pair = \"ab\"", "pair = \"cd\""]
        lasts [2000, 0]
        {
            /// Pair of outputs.
            pair: Pair,
        }
        /// The power module is faulty.
        PowerModuleFault = "power-module-fault", Electrical,
        sees "Bit 6 of `sysStatus`, and all outputs off.",
        counts "The module was powered.",
        weaker ["rail-short"]
        {}
        /// The battery suddenly has less charge, as with a bad cell; at the end the charge returns.
        ChargeDrop = "charge-drop", Electrical,
        sees "`soc` falls at once, and the voltage with it.",
        counts "The battery had charge.",
        tries ["by = \"75 %\"", ""]
        {
            /// Part of the full charge that is lost; default 50 %.
            #[serde(default = "defaults::half")]
            by: Percent,
        }
        /// A fuse is blown; it is replaced at the end.
        FuseBlown = "fuse-blown", Electrical,
        sees "A side that the other side drags along; without the tail supply, a silent module.",
        counts "Current would have flowed through it.",
        tries ["fuse = \"tail\"", "fuse = \"motor-left\"", "fuse = \"small-modules\""]
        lasts [300, 2000, 0]
        weaker ["free-wheeling"]
        {
            /// Fuse.
            fuse: FuseId,
        }
        /// The CAN from the module to the vehicle's controller fails. The module does not notice.
        CanFailing = "can-failing", Electrical,
        sees "Normal replies, but speeds that do not follow commands, or follow late; after some time 0.",
        counts "The vehicle had received another command than the module sent.",
        tries ["", "delay = \"300 ms\""]
        {
            /// Delay of commands to the vehicle; default they never arrive.
            #[serde(default, skip_serializing_if = "Option::is_none")]
            delay: Option<Span>,
        }
        /// The cables of the two sides, motors and encoders, are swapped.
        SidesSwapped = "sides-swapped", Mechanical,
        sees "Left turns become right turns, although the reported speeds are as expected.",
        counts "The sides were driven differently.",
        lasts [2000, 0]
        {}
        /// Interference disturbs encoders.
        EncoderNoisy = "encoder-noisy", Mechanical,
        sees "Speeds that jump.",
        counts "A reading was disturbed.",
        tries ["motors = \"all\", spread_rpm = 200", "motors = \"all\"", "motors = \"left\""]
        motors "Motors."
        {
            /// Spread of the readings, in r/min of the motor; default 50.
            #[serde(default = "defaults::spread")]
            spread_rpm: u16,
        }
    }
}

impl Effect for R150Fault {
    fn check(&self) -> Result<(), String> {
        match self {
            Self::RailLoad {
                power, resistance, ..
            } if power.is_some() == resistance.is_some() => {
                Err("`rail-load` takes one of `power` and `resistance`".to_owned())
            }
            _ => Ok(()),
        }
    }

    fn begin(&self, at: &mut Begin<'_>) -> Result<Work, EffectError> {
        Ok(match self {
            Self::BadCrc { .. } => Work::Frames(Box::new(Frames::new(
                at,
                self.scope(),
                |_, mut frame, _| {
                    if let Some(last) = frame.last_mut() {
                        *last ^= 0xFF;
                    }
                    Some(vec![(Duration::ZERO, frame)])
                },
            ))),
            _ => Work::Hardware(Box::new(AtWork {
                kind: self.clone(),
                noise: (at.stream)("device"),
                errors: Sides::default(),
            })),
        })
    }
}

/// A fault of the hardware at work.
struct AtWork {
    kind: R150Fault,
    noise: Noise,
    /// Error that interference adds to the encoders now, r/min.
    errors: Sides<f64>,
}

impl OnHardware for AtWork {
    fn add(&self, sum: &mut Sum) {
        let Some(Layer { whole, can }) = sum.own_mut::<Layer>() else {
            return;
        };
        match &self.kind {
            R150Fault::BadCrc { .. } => {}
            R150Fault::RailLoad {
                rail,
                power,
                resistance,
            } => {
                let resistance = resistance.map(|resistance| Load::Resistance(resistance.0));
                let power = power.map(|power| Load::Power(power.0));
                whole.loads[rail.index()] = resistance.or(power);
            }
            R150Fault::RailShort { rail } => whole.loads[rail.index()] = Some(Load::Short),
            R150Fault::SupplySag { by, resistance } => {
                whole.supply_drop += by.0;
                whole.supply_resistance += resistance.0;
            }
            R150Fault::OverTemperature { pair } => whole.temperature[pair.index()] = Some(HOT),
            R150Fault::PowerModuleFault {} => whole.power_module = true,
            R150Fault::ChargeDrop { by } => whole.missing_charge += by.0 / 100.0,
            R150Fault::FuseBlown { fuse } => whole.fuses_out[fuse.index()] = true,
            R150Fault::CanFailing { delay } => {
                *can = Some(match (*can, delay) {
                    (Some(CanFailure::Cut), _) | (_, None) => CanFailure::Cut,
                    (None, Some(delay)) => CanFailure::Late(delay.0),
                    (Some(CanFailure::Late(before)), Some(delay)) => {
                        CanFailure::Late(before.saturating_add(delay.0))
                    }
                });
            }
            R150Fault::SidesSwapped {} => whole.sides_swapped = !whole.sides_swapped,
            R150Fault::EncoderNoisy { .. } => {
                for side in Side::ALL {
                    whole.encoder_error[side] += self.errors[side];
                }
            }
        }
    }

    fn watch(&mut self, device: &dyn Device, tally: &mut Tally) {
        let Some(r150) = device.get::<R150>() else {
            return;
        };
        let plant = &r150.plant;
        let (measured, commands) = (plant.measurements(), plant.commands());
        let powered = measured.module_powered;
        let acts = match &self.kind {
            R150Fault::RailLoad { rail, .. } | R150Fault::RailShort { rail } => {
                powered && commands.rail_on[rail.index()]
            }
            R150Fault::SupplySag { by, resistance } => {
                by.0 + resistance.0 * plant.truth().battery_current.abs() >= 0.1
            }
            R150Fault::OverTemperature { pair } => {
                powered && HOT > plant.own_temperature()[pair.index()]
            }
            R150Fault::PowerModuleFault {} => powered,
            R150Fault::ChargeDrop { .. } => plant.own_soc() > 0.0,
            R150Fault::FuseBlown { fuse } => match fuse {
                FuseId::MotorRight => is_driven(plant, Side::Right),
                FuseId::MotorLeft => is_driven(plant, Side::Left),
                FuseId::Tail | FuseId::SmallModules => true,
            },
            R150Fault::CanFailing { .. } => {
                r150.device.heard_set_point() != r150.device.motor_set_point()
            }
            R150Fault::SidesSwapped {} => {
                (commands.motor_duty.right - commands.motor_duty.left).abs() > 1e-6
            }
            // Frames are counted as they are sent, interference as it acts.
            R150Fault::BadCrc { .. } | R150Fault::EncoderNoisy { .. } => return,
        };
        tally.hit_when(acts, || match &self.kind {
            R150Fault::RailLoad { rail, .. } | R150Fault::RailShort { rail } => format!(
                "output {rail}: {:.2} A at {:.2} V",
                measured.rail_current[rail.index()],
                measured.rail_voltage[rail.index()]
            ),
            R150Fault::SupplySag { .. } | R150Fault::ChargeDrop { .. } => {
                let truth = plant.truth();
                let charge = truth.soc * 100.0;
                format!("{:.1} V, {charge:.1} % charge", truth.battery_voltage)
            }
            R150Fault::OverTemperature { pair } => {
                let celsius = measured.temperature[pair.index()];
                format!("converter {pair}: {celsius:.1} degC")
            }
            R150Fault::FuseBlown { fuse } => format!("fuse {fuse}"),
            other => other.info().counts.trim_end_matches('.').to_owned(),
        });
    }

    fn interfere(&mut self, _device: &mut dyn Device, _seconds: f64, tally: &mut Tally) -> bool {
        let R150Fault::EncoderNoisy { motors, spread_rpm } = self.kind else {
            return false;
        };
        for side in Side::ALL {
            let error = self.noise.normal() * f64::from(spread_rpm);
            if is_about(motors, side) {
                self.errors[side] = error;
            }
        }
        if self.errors != Sides::default() {
            tally.hit(|| format!("motors {motors}"));
        }
        true
    }
}

/// Returns whether a fault of these motors is about this side.
fn is_about(motors: Motors, side: Side) -> bool {
    let [left, right, ..] = motors.wheels();
    match side {
        Side::Left => left,
        Side::Right => right,
    }
}

/// Sum of the faults at work that only an R150 has.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layer {
    whole: R150Faults,
    can: Option<CanFailure>,
}

impl R150 {
    /// Puts all faults in the place of those before, and touches nothing else.
    pub(super) fn set_layer(&mut self, now: SimTime, sum: &Sum) {
        let Some(Layer { whole, can }) = sum.own::<Layer>() else {
            return;
        };
        let [left, right, ..] = sum.motors;
        self.plant.set_side_faults(Side::Right, right);
        self.plant.set_side_faults(Side::Left, left);
        self.plant.set_faults(whole);
        self.device.set_can_failure(now, *can);
    }

    pub(super) fn motor_states(&self) -> [MotorState; 4] {
        let plant = &self.plant;
        let turning = plant.truth().wheel_speed;
        let [right, left] = [Side::Right, Side::Left].map(|side| MotorState {
            driven: is_driven(plant, side),
            turns: turning[side].abs() > STANDING,
            repeats_wrongly: plant.encoder_lag(side).abs() > 1.0,
            braked: plant.commands().parking_brake,
        });
        [left, right, left, right]
    }
}

fn is_driven(plant: &R150Plant, side: Side) -> bool {
    let commands = plant.commands();
    commands.propulsion_power && commands.motor_duty[plant.port_of(side)] != 0.0
}
