//! Faults of a mecanum car's hardware and sensors.

use sim_physics::World;
use sim_physics::faults::MotorFaults;
use sim_physics::mecanum::{
    ECHOES, MecanumFaults, MecanumPlant, Port, PortCommand, Ultrasonic, Wheel,
};
use sim_settings::SimTime;

use super::Mecanum;
use crate::device::Breakable;
use crate::fault::parameters::{Motors, PortName};
use crate::fault::{Fault, FaultHandle};
use crate::noise::Noise;

/// Drag on a wheel unless given, N·m.
const USUAL_DRAG: f64 = 0.5;
/// Slower than this a wheel stands, rad/s.
const STANDING: f64 = 0.01;

/// Checks that a car can have a fault with these parameters.
pub(super) fn check(fault: &Fault) -> Result<(), String> {
    let cannot = |why: &str| Err(format!("a mecanum car cannot have `{}`: {why}", fault.id()));
    match fault {
        Fault::BadCrc { .. } => return cannot("its packets have no checksum"),
        Fault::SidesSwapped { .. } => return cannot("use `ports-swapped`"),
        Fault::RemoteControlTakesOver { .. } => {
            return cannot("only its client can switch it to the remote control");
        }
        Fault::PortsSwapped { port, with } if port == with => {
            return Err(format!("`ports-swapped`: both ports are \"{port}\""));
        }
        _ => {}
    }
    match fault.command() {
        Some(_) if fault.link().is_some_and(|link| link.as_str() == "ros") => {
            Err("`command`: the lines of the ROS link have none".to_owned())
        }
        Some(command) if command != 0 => Err(format!(
            "`command`: the car sends packets of type 0 only, not {command}"
        )),
        _ => Ok(()),
    }
}

/// The faults that are armed on one car.
#[derive(Debug, Default)]
pub(super) struct Faults {
    armed: Vec<Armed>,
    layer: Layer,
}

#[derive(Debug)]
struct Armed {
    handle: FaultHandle,
    fault: Fault,
    noise: Noise,
    echoes: Echoes,
    /// Shares of the next pulses of interference, by wheel.
    pulses: [f64; 4],
}

impl Breakable for Mecanum {
    fn arm(&mut self, _now: SimTime, handle: FaultHandle, fault: &Fault, noise: Noise) -> bool {
        self.faults.armed.push(Armed {
            handle,
            fault: fault.clone(),
            noise,
            echoes: self.plant.unspoilt().echoes,
            pulses: [0.0; 4],
        });
        false
    }

    fn disarm(&mut self, _now: SimTime, handle: FaultHandle) {
        self.faults.armed.retain(|armed| armed.handle != handle);
    }

    fn apply_faults(&mut self, world: &mut World) {
        let armed = self.faults.armed.iter();
        let layer = Layer::of(armed.map(|armed| (&armed.fault, &armed.echoes)));
        layer.apply(&self.faults.layer, &mut self.plant, world);
        self.faults.layer = layer;
    }

    fn interfere(&mut self, seconds: f64, acted: &mut dyn FnMut(FaultHandle, String)) {
        for own in &mut self.faults.armed {
            let Fault::EncoderNoisy {
                motors,
                pulses_per_second,
                ..
            } = own.fault
            else {
                continue;
            };
            for wheel in Wheel::ALL {
                let mean = f64::from(pulses_per_second) * seconds;
                let share = &mut own.pulses[wheel.index()];
                *share += mean * 2.0 * own.noise.uniform();
                let whole = share.floor();
                *share -= whole;
                if has_wheel(motors, wheel) && whole >= 1.0 {
                    self.plant.add_pulses(wheel, pulses(whole));
                    acted(own.handle, format!("wheel {}", wheel.name()));
                }
            }
        }
    }

    fn acts(&self, handle: FaultHandle, fault: &Fault) -> bool {
        let plant = &self.plant;
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
                .any(|wheel| motors.is_none_or(|motors| has_wheel(motors, wheel)) && holds(wheel))
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
                runs(port_of(*port)) || runs(port_of(*with))
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
                let mut armed = self.faults.armed.iter();
                if let Some(own) = armed.find(|armed| armed.handle == handle) {
                    add(&mut alone, fault, &own.echoes);
                }
                let mut spoilt = unspoilt;
                alone.spoil(&mut spoilt);
                spoilt != unspoilt
            }
            _ => false,
        }
    }
}

#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates, and nobody counts so many pulses"
)]
fn pulses(whole: f64) -> u32 {
    whole as u32
}

fn has_wheel(motors: Motors, wheel: Wheel) -> bool {
    match motors {
        Motors::Left => wheel.is_left(),
        Motors::Right => !wheel.is_left(),
        Motors::All => true,
        Motors::LeftFront => wheel == Wheel::LeftFront,
        Motors::RightFront => wheel == Wheel::RightFront,
        Motors::LeftRear => wheel == Wheel::LeftRear,
        Motors::RightRear => wheel == Wheel::RightRear,
    }
}

fn port_of(name: PortName) -> Port {
    Port::ALL[name as usize]
}

/// What the ultrasonic sensors gave when a fault began.
type Echoes = [Option<f64>; ECHOES];

/// Sum of the effects of all armed faults on one car.
#[derive(Debug, Clone, PartialEq, Default)]
pub(super) struct Layer {
    wheels: [MotorFaults; 4],
    whole: MecanumFaults,
}

impl Layer {
    fn of<'f>(faults: impl Iterator<Item = (&'f Fault, &'f Echoes)>) -> Self {
        let mut layer = Self::default();
        for (fault, echoes) in faults {
            layer.add_to_wheels(fault);
            fault.add_to_body(&mut layer.whole.body);
            add(&mut layer.whole, fault, echoes);
        }
        layer
    }

    fn add_to_wheels(&mut self, fault: &Fault) {
        let Some(motors) = fault.motors() else {
            return;
        };
        for wheel in Wheel::ALL
            .into_iter()
            .filter(|wheel| has_wheel(motors, *wheel))
        {
            let own = &mut self.wheels[wheel.index()];
            fault.add_to_motor(own, USUAL_DRAG);
        }
    }

    /// Puts this in the place of what was there `before`, and touches nothing else.
    fn apply(&self, before: &Self, plant: &mut MecanumPlant, world: &mut World) {
        for wheel in Wheel::ALL {
            let own = self.wheels[wheel.index()];
            if own != before.wheels[wheel.index()] {
                plant.set_wheel_faults(wheel, own);
            }
        }
        if self.whole != before.whole {
            plant.set_faults(world, &self.whole);
        }
    }
}

fn add(whole: &mut MecanumFaults, fault: &Fault, echoes: &Echoes) {
    match fault {
        Fault::SupplyLost {} => whole.unsupplied = true,
        Fault::PortsSwapped { port, with } => {
            whole.swaps = whole.swaps.and(port_of(*port), port_of(*with));
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
