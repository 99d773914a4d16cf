//! Faults of the car's hardware and firmware, all that are armed together.

use sim_physics::World;
use sim_physics::mecanum::{
    ECHOES, Encoder, MecanumFaults, Port, PortCommand, Ultrasonic, Wheel, WheelFaults,
};
use sim_settings::SimTime;

use super::{Fault, firmware};
use crate::defects::Defects;
use crate::mecanum::Mecanum;

/// Drag on a wheel unless given, N·m.
const USUAL_DRAG: f64 = 0.5;
/// Slower than this a wheel stands, rad/s.
const STANDING: f64 = 0.01;

/// What the ultrasonic sensors gave when a fault began.
pub(super) type Echoes = [Option<f64>; ECHOES];

/// What all armed faults do to one car.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layer {
    wheels: [WheelFaults; 4],
    whole: MecanumFaults,
    defects: Defects,
}

impl Layer {
    pub(super) fn of<'f>(faults: impl Iterator<Item = (&'f Fault, &'f Echoes)>) -> Self {
        let mut layer = Self::default();
        for (fault, echoes) in faults {
            layer.add_to_wheels(fault);
            add(&mut layer.whole, fault, echoes);
            firmware::add(&mut layer.defects, fault);
        }
        layer
    }

    fn add_to_wheels(&mut self, fault: &Fault) {
        let Some(motors) = fault.motors() else {
            return;
        };
        for wheel in Wheel::ALL
            .into_iter()
            .filter(|wheel| motors.has_wheel(*wheel))
        {
            let own = &mut self.wheels[wheel.index()];
            match fault {
                Fault::Blocked { .. } => own.blocked = true,
                Fault::Dragging { torque, .. } => {
                    own.drag_torque += torque.map_or(USUAL_DRAG, |torque| torque.0.abs());
                }
                Fault::FreeWheeling { .. } => own.free_wheeling = true,
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
    pub(super) fn apply(&self, before: &Self, car: &mut Mecanum, world: &mut World, now: SimTime) {
        for wheel in Wheel::ALL {
            let own = self.wheels[wheel.index()];
            if own != before.wheels[wheel.index()] {
                car.plant_mut().set_wheel_faults(wheel, own);
            }
        }
        if self.whole != before.whole {
            car.plant_mut().set_faults(world, &self.whole);
        }
        if self.defects != before.defects {
            car.set_defects(now, self.defects);
        }
    }
}

fn add(whole: &mut MecanumFaults, fault: &Fault, echoes: &Echoes) {
    match fault {
        Fault::SupplyLost {} => whole.unsupplied = true,
        Fault::PortsSwapped { port, with } => {
            whole.swaps = whole.swaps.and(port.port(), with.port());
        }
        Fault::Ice { friction } => {
            let most = whole.friction.unwrap_or(f64::INFINITY);
            whole.friction = Some(most.min(friction.get()));
        }
        Fault::Payload { mass } => whole.payload += mass.0,
        Fault::Push { ahead, left, turn } => {
            let [old_ahead, old_left, old_turn] = whole.push;
            whole.push = [old_ahead + ahead.0, old_left + left.0, old_turn + turn.0];
        }
        Fault::UltrasonicMissing { sensor }
        | Fault::UltrasonicStuck { sensor }
        | Fault::UltrasonicGhost { sensor, .. } => {
            for (index, own) in whole.ultrasonic.iter_mut().enumerate() {
                if sensor.has(index) {
                    *own = match fault {
                        Fault::UltrasonicStuck { .. } => Ultrasonic::Stuck(echoes[index]),
                        Fault::UltrasonicGhost { distance, .. } => Ultrasonic::Ghost(distance.0),
                        _ => Ultrasonic::Missing,
                    };
                }
            }
        }
        Fault::TagMisread { reads_as } => whole.tag_reads_as = Some(*reads_as),
        Fault::StripLost {} => whole.strip_lost = true,
        Fault::InfraredStuck { sees } => whole.infrared_stuck = Some(*sees),
        _ => {}
    }
}

/// Whether a fault of the hardware has an effect now.
pub(super) fn acts(fault: &Fault, echoes: &Echoes, car: &Mecanum) -> bool {
    let plant = car.plant();
    let truth = plant.truth();
    let commands = plant.commands();
    let command = |wheel| plant.wiring().command(commands, wheel);
    let runs = |pins: PortCommand| !pins.brake && commands.speed_voltage > 0.0;
    let driven = |wheel| runs(command(wheel));
    let turns = |wheel: Wheel| truth.wheel_speed[wheel.index()].abs() > STANDING;
    let any = |holds: &dyn Fn(Wheel) -> bool| {
        let motors = fault.motors();
        Wheel::ALL
            .into_iter()
            .any(|wheel| motors.is_none_or(|motors| motors.has_wheel(wheel)) && holds(wheel))
    };
    match fault {
        Fault::SupplyLost {} => true,
        Fault::Blocked { .. }
        | Fault::FreeWheeling { .. }
        | Fault::WiredBackwards { .. }
        | Fault::BrakeStuckOn { .. } => any(&driven),
        Fault::Dragging { .. } | Fault::Ice { .. } | Fault::Payload { .. } => {
            any(&|wheel| driven(wheel) || turns(wheel))
        }
        Fault::EncoderLost { .. } | Fault::EncoderStuck { .. } => any(&turns),
        Fault::BrakeStuckOpen { .. } => any(&|wheel| command(wheel).brake),
        Fault::PortsSwapped { port, with } => {
            let runs = |port: Port| runs(commands.ports[port.index()]);
            runs(port.port()) || runs(with.port())
        }
        Fault::Push { ahead, left, turn } => [ahead.0, left.0, turn.0] != [0.0; 3],
        Fault::UltrasonicMissing { .. }
        | Fault::UltrasonicStuck { .. }
        | Fault::UltrasonicGhost { .. }
        | Fault::TagMisread { .. }
        | Fault::StripLost {}
        | Fault::InfraredStuck { .. } => {
            let unspoilt = plant.unspoilt();
            let mut alone = MecanumFaults::default();
            add(&mut alone, fault, echoes);
            let mut spoilt = unspoilt;
            alone.spoil(&mut spoilt);
            spoilt != unspoilt
        }
        _ => false,
    }
}

/// What a fault of the hardware acts on.
pub(super) fn words(fault: &Fault) -> String {
    match (fault, fault.motors()) {
        (_, Some(motors)) => format!("motors {motors}"),
        (
            Fault::UltrasonicMissing { sensor }
            | Fault::UltrasonicStuck { sensor }
            | Fault::UltrasonicGhost { sensor, .. },
            None,
        ) => format!("ultrasonic {sensor}"),
        (Fault::PortsSwapped { port, with }, None) => format!("ports {port} and {with}"),
        (other, None) => other.info().counts.trim_end_matches('.').to_owned(),
    }
}
