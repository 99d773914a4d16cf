//! Faults of the R150's hardware and firmware, all that are armed together.

use sim_physics::World;
use sim_physics::r150::{Encoder, FuseId, Load, R150Faults, R150Plant, Side, SideFaults, Sides};
use sim_settings::SimTime;

use super::{Fault, firmware};
use crate::defects::Defects;
use crate::r150::R150;

/// Drag on the wheels of a side unless given, N·m.
const USUAL_DRAG: f64 = 100.0;
/// Slower than this wheels stand, rad/s.
const STANDING: f64 = 0.01;

/// What all armed faults do to one vehicle.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layer {
    sides: Sides<SideFaults>,
    whole: R150Faults,
    defects: Defects,
}

impl Layer {
    /// `errors` is what interference adds to the encoders, right then left, rpm.
    pub(super) fn of<'f>(faults: impl Iterator<Item = &'f Fault>, errors: [f64; 2]) -> Self {
        let mut layer = Self::default();
        for fault in faults {
            layer.add(fault);
            layer.whole.add(fault);
            firmware::add(&mut layer.defects, fault);
        }
        layer.whole.encoder_error = Sides::from(errors);
        layer
    }

    /// Interference goes on; says whether that is news.
    pub(super) fn set_errors(&mut self, errors: [f64; 2]) -> bool {
        let errors = Sides::from(errors);
        errors != std::mem::replace(&mut self.whole.encoder_error, errors)
    }

    fn add(&mut self, fault: &Fault) {
        let Some(motors) = fault.motors() else {
            return;
        };
        for side in Side::BOTH.into_iter().filter(|side| motors.has_side(*side)) {
            let own = &mut self.sides[side];
            match fault {
                Fault::Blocked { .. } => own.blocked = true,
                Fault::Dragging { torque, .. } => {
                    own.drag_torque += torque.map_or(USUAL_DRAG, |torque| torque.0.abs());
                }
                Fault::FreeWheeling { .. } => own.motor_disconnected = true,
                Fault::EncoderLost { .. } => own.encoder = Encoder::Lost,
                Fault::EncoderStuck { .. } => own.encoder = Encoder::Stuck,
                Fault::WiredBackwards { .. } => own.reversed = !own.reversed,
                Fault::BrakeStuckOn { .. } => own.brake_stuck_on = true,
                Fault::BrakeStuckOpen { .. } => own.brake_stuck_open = true,
                _ => {}
            }
        }
    }

    /// Puts this in the place of what was there `before`, and touches nothing else.
    pub(super) fn apply(&self, before: &Self, r150: &mut R150, world: &mut World, now: SimTime) {
        for side in Side::BOTH {
            if self.sides[side] != before.sides[side] {
                r150.plant_mut().set_side_faults(side, self.sides[side]);
            }
        }
        if self.whole != before.whole {
            r150.plant_mut().set_faults(world, &self.whole);
        }
        if self.defects != before.defects {
            r150.set_defects(now, self.defects);
        }
    }
}

/// Lets a fault be part of what is wrong as a whole.
trait Add {
    fn add(&mut self, fault: &Fault);
}

impl Add for R150Faults {
    fn add(&mut self, fault: &Fault) {
        match fault {
            Fault::RailLoad {
                rail,
                power,
                resistance,
                current,
            } => {
                let resistance = resistance.map(|resistance| Load::Resistance(resistance.0));
                let power = power.map(|power| power.0);
                let power = power.or(current.map(|current| current.0 * rail.nominal_voltage()));
                self.loads[rail.rail().index()] = resistance.or(power.map(Load::Power));
            }
            Fault::RailShort { rail } => self.loads[rail.rail().index()] = Some(Load::Short),
            Fault::RailOpen { rail } => self.loads[rail.rail().index()] = Some(Load::Open),
            Fault::SupplySag { by, resistance } => {
                self.supply_drop += by.0;
                self.supply_resistance += resistance.0;
            }
            Fault::OverTemperature { pair, temperature } => {
                let least = &mut self.temperature[*pair as usize];
                *least = Some(least.map_or(temperature.0, |least| least.max(temperature.0)));
            }
            Fault::PowerModuleFault {} => self.power_module = true,
            Fault::BatteryEmpty {} => self.missing_charge = 1.0,
            Fault::ChargeDrop { by } => self.missing_charge += by.0 / 100.0,
            Fault::FuseBlown { fuse } => self.fuses_out[*fuse as usize] = true,
            Fault::SidesSwapped {} => self.sides_swapped = !self.sides_swapped,
            Fault::Ice { friction } => {
                let most = self.friction.unwrap_or(f64::INFINITY);
                self.friction = Some(most.min(friction.get()));
            }
            Fault::Payload { mass } => self.payload += mass.0,
            Fault::Push { ahead, left, turn } => {
                let [old_ahead, old_left, old_turn] = self.push;
                self.push = [old_ahead + ahead.0, old_left + left.0, old_turn + turn.0];
            }
            _ => {}
        }
    }
}

/// Whether a fault of the hardware has an effect now.
pub(super) fn acts(fault: &Fault, r150: &R150) -> bool {
    let plant = r150.plant();
    let commands = plant.commands();
    let truth = plant.truth();
    let powered = plant.measurements().module_powered;
    let driven = |side| is_driven(plant, side);
    let turns = |side: Side| truth.wheel_speed[side].abs() > STANDING;
    let any = |holds: &dyn Fn(Side) -> bool| {
        let motors = fault.motors();
        Side::BOTH
            .into_iter()
            .any(|side| motors.is_none_or(|motors| motors.has_side(side)) && holds(side))
    };
    match fault {
        Fault::RailLoad { rail, .. } | Fault::RailShort { rail } | Fault::RailOpen { rail } => {
            powered && commands.rail_on[rail.rail().index()]
        }
        Fault::SupplySag { by, resistance } => {
            by.0 + resistance.0 * truth.battery_current.abs() >= 0.1
        }
        Fault::OverTemperature { pair, temperature } => {
            powered && temperature.0 > plant.own_temperature()[*pair as usize]
        }
        Fault::PowerModuleFault {} => powered,
        Fault::BatteryEmpty {} | Fault::ChargeDrop { .. } => plant.own_soc() > 0.0,
        Fault::FuseBlown { fuse } => match fuse.id() {
            FuseId::MotorRight => driven(Side::Right),
            FuseId::MotorLeft => driven(Side::Left),
            FuseId::Tail | FuseId::SmallModules => true,
        },
        Fault::Blocked { .. }
        | Fault::FreeWheeling { .. }
        | Fault::WiredBackwards { .. }
        | Fault::BrakeStuckOn { .. } => any(&driven),
        Fault::Dragging { .. } | Fault::Ice { .. } | Fault::Payload { .. } => {
            any(&|side| driven(side) || turns(side))
        }
        Fault::EncoderLost { .. } => any(&turns),
        Fault::EncoderStuck { .. } => any(&|side| plant.encoder_lag(side).abs() > 1.0),
        Fault::SidesSwapped {} => {
            (commands.motor_duty.right - commands.motor_duty.left).abs() > 1e-6
        }
        Fault::Push { ahead, left, turn } => [ahead.0, left.0, turn.0] != [0.0; 3],
        Fault::BrakeStuckOpen { .. } => commands.parking_brake,
        _ => false,
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

/// What a fault of the hardware acts on now.
pub(super) fn what(fault: &Fault, r150: &R150) -> String {
    let measured = r150.plant().measurements();
    match fault {
        Fault::RailLoad { rail, .. } | Fault::RailShort { rail } | Fault::RailOpen { rail } => {
            let index = rail.rail().index();
            format!(
                "output {rail}: {:.2} A at {:.2} V",
                measured.rail_current[index], measured.rail_voltage[index]
            )
        }
        Fault::SupplySag { .. } | Fault::BatteryEmpty {} | Fault::ChargeDrop { .. } => {
            let truth = r150.truth();
            let charge = truth.soc * 100.0;
            format!("{:.1} V, {charge:.1} % charge", truth.battery_voltage)
        }
        Fault::OverTemperature { pair, .. } => {
            let celsius = measured.temperature[*pair as usize];
            format!("converter {pair}: {celsius:.1} degC")
        }
        Fault::FuseBlown { fuse } => format!("fuse {fuse}"),
        other => super::mecanum::words(other),
    }
}
