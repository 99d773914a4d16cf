//! Faults of an R150: its hardware, and what people do to it at the worst time.

use sim_physics::faults::MotorFaults;
use sim_physics::r150::{FuseId, Load, R150Faults, R150Plant, Side, Sides};
use sim_settings::SimTime;

use super::{R150, actions};
use crate::device::{Breakable, Change, EffectHandle};
use crate::fault::parameters::{Motors, RailName};
use crate::fault::{ElectricalFault, Fault, FaultKind, MechanicalFault, MotorState, OperatorFault};
use crate::noise::Noise;
use crate::r150_device::can::CanFailure;
use crate::r150_device::command;

/// Drag on the wheels of a side unless given, N·m.
const USUAL_DRAG: f64 = 100.0;
/// Slower than this wheels stand, rad/s.
const STANDING: f64 = 0.01;

/// Checks that an R150 can have a fault with these parameters.
pub(super) fn check(fault: &Fault) -> Result<(), String> {
    if let Some(command) = fault.scope.command
        && command::name(command).is_none()
    {
        let known = command::COMMANDS.map(|(known, _)| format!("0x{known:02X}"));
        let known = known.join(", ");
        return Err(format!(
            "`command`: the R150 has no command 0x{command:02X}; it has {known}"
        ));
    }
    if let Some(motors) = fault.scope.motors.filter(|motors| motors.is_wheel()) {
        return Err(format!(
            "`motors`: the wheels of one side of an R150 are geared together; \"{motors}\" must \
             be \"left\", \"right\" or \"all\""
        ));
    }
    if let FaultKind::Electrical(ElectricalFault::RailLoad {
        power,
        resistance,
        current,
        ..
    }) = &fault.kind
    {
        let given = [power.is_some(), resistance.is_some(), current.is_some()];
        if given.iter().filter(|given| **given).count() != 1 {
            return Err("`rail-load` takes one of `power`, `resistance` and `current`".to_owned());
        }
    }
    if let FaultKind::Operator(OperatorFault::AppTakesControl {
        power: false,
        pwm: false,
    }) = fault.kind
    {
        return Err("`app-takes-control` takes power, PWM or both".to_owned());
    }
    Ok(())
}

/// The faults that are armed on one vehicle.
#[derive(Debug, Default)]
pub(super) struct Faults {
    armed: Vec<Armed>,
    layer: Layer,
}

#[derive(Debug)]
struct Armed {
    handle: EffectHandle,
    fault: Fault,
    noise: Noise,
    /// Error that interference adds to the encoders now, r/min.
    errors: [f64; 2],
}

impl Breakable for R150 {
    fn arm(&mut self, handle: EffectHandle, fault: &Fault, noise: Noise) {
        self.faults.armed.push(Armed {
            handle,
            fault: fault.clone(),
            noise,
            errors: [0.0; 2],
        });
    }

    fn disarm(&mut self, handle: EffectHandle) {
        self.faults.armed.retain(|armed| armed.handle != handle);
    }

    fn apply_faults(&mut self, now: SimTime) {
        let armed = &self.faults.armed;
        let errors = armed.iter().fold([0.0; 2], |sum: [f64; 2], own| {
            [sum[0] + own.errors[0], sum[1] + own.errors[1]]
        });
        let layer = Layer::of(armed.iter().map(|armed| &armed.fault), errors);
        layer.apply(&self.faults.layer, &mut self.plant);
        self.device.set_can_failure(now, layer.can);
        self.faults.layer = layer;
    }

    fn be_operated(&mut self, now: SimTime, fault: &OperatorFault) -> Vec<Change> {
        actions::at_the_worst_time(self, now, fault)
    }

    fn interfere(&mut self, _seconds: f64, acted: &mut dyn FnMut(EffectHandle, String)) {
        let mut errors = [0.0; 2];
        for own in &mut self.faults.armed {
            let FaultKind::Mechanical(MechanicalFault::EncoderNoisy { spread_rpm, .. }) =
                own.fault.kind
            else {
                continue;
            };
            for (index, side) in Side::BOTH.into_iter().enumerate() {
                let error = own.noise.normal() * f64::from(spread_rpm);
                if is_about(own.fault.scope.motors, side) {
                    own.errors[index] = error;
                    errors[index] += error;
                }
            }
            if own.errors != [0.0; 2] {
                acted(own.handle, own.fault.in_words());
            }
        }
        if self.faults.layer.set_errors(errors) {
            self.plant.set_encoder_error(errors.into());
        }
    }

    fn acts(&self, _handle: EffectHandle, fault: &Fault) -> bool {
        let plant = &self.plant;
        let commands = plant.commands();
        match &fault.kind {
            FaultKind::Electrical(kind) => self.acts_on_supply(kind),
            FaultKind::Mechanical(MechanicalFault::SidesSwapped {}) => {
                (commands.motor_duty.right - commands.motor_duty.left).abs() > 1e-6
            }
            FaultKind::Mechanical(kind) => {
                let truth = plant.truth();
                Side::BOTH.into_iter().any(|side| {
                    let state = MotorState {
                        driven: is_driven(plant, side),
                        turns: truth.wheel_speed[side].abs() > STANDING,
                        repeats_wrongly: plant.encoder_lag(side).abs() > 1.0,
                        braked: commands.parking_brake,
                    };
                    is_about(fault.scope.motors, side) && kind.acts_on(state)
                })
            }
            FaultKind::Wire(_)
            | FaultKind::Protocol(_)
            | FaultKind::Firmware(_)
            | FaultKind::Operator(_)
            | FaultKind::Sensor(_) => false,
        }
    }

    fn acted_on(&self, fault: &Fault) -> String {
        let FaultKind::Electrical(kind) = &fault.kind else {
            return fault.in_words();
        };
        let measured = self.plant.measurements();
        match kind {
            ElectricalFault::RailLoad { rail, .. }
            | ElectricalFault::RailShort { rail }
            | ElectricalFault::RailOpen { rail } => {
                let index = super::rail(*rail).index();
                format!(
                    "output {rail}: {:.2} A at {:.2} V",
                    measured.rail_current[index], measured.rail_voltage[index]
                )
            }
            ElectricalFault::SupplySag { .. }
            | ElectricalFault::BatteryEmpty {}
            | ElectricalFault::ChargeDrop { .. } => {
                let truth = self.truth();
                let charge = truth.soc * 100.0;
                format!("{:.1} V, {charge:.1} % charge", truth.battery_voltage)
            }
            ElectricalFault::OverTemperature { pair, .. } => {
                let celsius = measured.temperature[*pair as usize];
                format!("converter {pair}: {celsius:.1} degC")
            }
            ElectricalFault::FuseBlown { fuse } => format!("fuse {fuse}"),
            ElectricalFault::PowerModuleFault {}
            | ElectricalFault::CanFailing { .. }
            | ElectricalFault::SupplyLost {} => fault.in_words(),
        }
    }
}

/// Tells whether a fault of these motors is about this side; one of none is about both.
fn is_about(motors: Option<Motors>, side: Side) -> bool {
    match motors.unwrap_or(Motors::All) {
        Motors::Left => side == Side::Left,
        Motors::Right => side == Side::Right,
        Motors::All => true,
        // A car's.
        Motors::LeftFront | Motors::RightFront | Motors::LeftRear | Motors::RightRear => false,
    }
}

/// What an output should have, V.
fn nominal_voltage(rail: RailName) -> f64 {
    match rail {
        RailName::V48 => 48.0,
        RailName::V5 => 5.0,
        RailName::V12A | RailName::V12B | RailName::V12C | RailName::V12D => 12.0,
    }
}

/// Sum of the effects of all armed faults on one vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layer {
    sides: Sides<MotorFaults>,
    whole: R150Faults,
    can: Option<CanFailure>,
}

impl Layer {
    /// `errors` is what interference adds to the encoders, right then left, rpm.
    fn of<'f>(faults: impl Iterator<Item = &'f Fault>, errors: [f64; 2]) -> Self {
        let mut layer = Self::default();
        for fault in faults {
            match &fault.kind {
                FaultKind::Electrical(kind) => layer.add(kind),
                FaultKind::Mechanical(kind) => {
                    for side in Side::BOTH {
                        if is_about(fault.scope.motors, side) {
                            kind.add_to_motor(&mut layer.sides[side], USUAL_DRAG);
                        }
                    }
                    if let MechanicalFault::SidesSwapped {} = kind {
                        layer.whole.sides_swapped = !layer.whole.sides_swapped;
                    }
                }
                FaultKind::Wire(_)
                | FaultKind::Protocol(_)
                | FaultKind::Firmware(_)
                | FaultKind::Operator(_)
                | FaultKind::Sensor(_) => {}
            }
        }
        layer.whole.encoder_error = Sides::from(errors);
        layer
    }

    /// Interference goes on; says whether that is news.
    fn set_errors(&mut self, errors: [f64; 2]) -> bool {
        let errors = Sides::from(errors);
        errors != std::mem::replace(&mut self.whole.encoder_error, errors)
    }

    /// Puts this in the place of what was there `before`, and touches nothing else.
    fn apply(&self, before: &Self, plant: &mut R150Plant) {
        for side in Side::BOTH {
            if self.sides[side] != before.sides[side] {
                plant.set_side_faults(side, self.sides[side]);
            }
        }
        if self.whole != before.whole {
            plant.set_faults(&self.whole);
        }
    }

    /// Adds what a fault of its supply and outputs does to the vehicle.
    fn add(&mut self, fault: &ElectricalFault) {
        let whole = &mut self.whole;
        match fault {
            ElectricalFault::RailLoad {
                rail,
                power,
                resistance,
                current,
            } => {
                let resistance = resistance.map(|resistance| Load::Resistance(resistance.0));
                let power = power.map(|power| power.0);
                let power = power.or(current.map(|current| current.0 * nominal_voltage(*rail)));
                whole.loads[super::rail(*rail).index()] = resistance.or(power.map(Load::Power));
            }
            ElectricalFault::RailShort { rail } => {
                whole.loads[super::rail(*rail).index()] = Some(Load::Short)
            }
            ElectricalFault::RailOpen { rail } => {
                whole.loads[super::rail(*rail).index()] = Some(Load::Open)
            }
            ElectricalFault::SupplySag { by, resistance } => {
                whole.supply_drop += by.0;
                whole.supply_resistance += resistance.0;
            }
            ElectricalFault::OverTemperature { pair, temperature } => {
                let least = &mut whole.temperature[*pair as usize];
                *least = Some(least.map_or(temperature.0, |least| least.max(temperature.0)));
            }
            ElectricalFault::PowerModuleFault {} => whole.power_module = true,
            ElectricalFault::BatteryEmpty {} => whole.missing_charge = 1.0,
            ElectricalFault::ChargeDrop { by } => whole.missing_charge += by.0 / 100.0,
            ElectricalFault::FuseBlown { fuse } => whole.fuses_out[*fuse as usize] = true,
            ElectricalFault::CanFailing { delay } => {
                self.can = Some(match (self.can, delay) {
                    (Some(CanFailure::Cut), _) | (_, None) => CanFailure::Cut,
                    (None, Some(delay)) => CanFailure::Late(delay.0),
                    (Some(CanFailure::Late(before)), Some(delay)) => {
                        CanFailure::Late(before.saturating_add(delay.0))
                    }
                });
            }
            // A car's.
            ElectricalFault::SupplyLost {} => {}
        }
    }
}

impl R150 {
    fn acts_on_supply(&self, fault: &ElectricalFault) -> bool {
        let plant = &self.plant;
        let powered = plant.measurements().module_powered;
        match fault {
            ElectricalFault::RailLoad { rail, .. }
            | ElectricalFault::RailShort { rail }
            | ElectricalFault::RailOpen { rail } => {
                powered && plant.commands().rail_on[super::rail(*rail).index()]
            }
            ElectricalFault::SupplySag { by, resistance } => {
                by.0 + resistance.0 * plant.truth().battery_current.abs() >= 0.1
            }
            ElectricalFault::OverTemperature { pair, temperature } => {
                powered && temperature.0 > plant.own_temperature()[*pair as usize]
            }
            ElectricalFault::PowerModuleFault {} => powered,
            ElectricalFault::BatteryEmpty {} | ElectricalFault::ChargeDrop { .. } => {
                plant.own_soc() > 0.0
            }
            ElectricalFault::FuseBlown { fuse } => match FuseId::ALL[*fuse as usize] {
                FuseId::MotorRight => is_driven(plant, Side::Right),
                FuseId::MotorLeft => is_driven(plant, Side::Left),
                FuseId::Tail | FuseId::SmallModules => true,
            },
            ElectricalFault::CanFailing { .. } => {
                self.device.heard_set_point() != self.device.motor_set_point()
            }
            // A car's.
            ElectricalFault::SupplyLost {} => false,
        }
    }
}

fn is_driven(plant: &R150Plant, side: Side) -> bool {
    let commands = plant.commands();
    let port = match (plant.faults().sides_swapped, side) {
        (false, side) => side,
        (true, Side::Right) => Side::Left,
        (true, Side::Left) => Side::Right,
    };
    commands.propulsion_power && commands.motor_duty[port] != 0.0
}
