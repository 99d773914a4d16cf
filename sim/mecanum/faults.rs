//! Faults of a mecanum car's hardware and sensors.

use sim_physics::faults::MotorFaults;
use sim_physics::mecanum::{
    ECHOES, MecanumFaults, MecanumPlant, Port, PortCommand, Ultrasonic, Wheel,
};
use sim_settings::SimTime;

use super::Mecanum;
use crate::device::{Breakable, EffectHandle};
use crate::fault::parameters::{EchoSensor, Motors, PortName};
use crate::fault::{
    ElectricalFault, Fault, FaultKind, MechanicalFault, MotorState, OperatorFault, ProtocolFault,
    SensorFault,
};
use crate::noise::Noise;

/// Drag on a wheel unless given, N·m.
const USUAL_DRAG: f64 = 0.5;
/// Slower than this a wheel stands, rad/s.
const STANDING: f64 = 0.01;

/// Checks that a car can have a fault with these parameters.
pub(super) fn check(fault: &Fault) -> Result<(), String> {
    let cannot = |why: &str| Err(format!("a mecanum car cannot have `{}`: {why}", fault.id()));
    match &fault.kind {
        FaultKind::Protocol(ProtocolFault::BadCrc {}) => {
            return cannot("its packets have no checksum");
        }
        FaultKind::Mechanical(MechanicalFault::SidesSwapped {}) => {
            return cannot("use `ports-swapped`");
        }
        FaultKind::Operator(OperatorFault::RemoteControlTakesOver { .. }) => {
            return cannot("only its client can switch it to the remote control");
        }
        FaultKind::Mechanical(MechanicalFault::PortsSwapped { port, with }) if port == with => {
            return Err(format!("`ports-swapped`: both ports are \"{port}\""));
        }
        _ => {}
    }
    match fault.scope.command {
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
    handle: EffectHandle,
    fault: Fault,
    noise: Noise,
    echoes: Echoes,
    /// Shares of the next pulses of interference, by wheel.
    pulses: [f64; 4],
}

impl Breakable for Mecanum {
    fn arm(&mut self, handle: EffectHandle, fault: &Fault, noise: Noise) {
        self.faults.armed.push(Armed {
            handle,
            fault: fault.clone(),
            noise,
            echoes: self.plant.unspoilt().echoes,
            pulses: [0.0; 4],
        });
    }

    fn disarm(&mut self, handle: EffectHandle) {
        self.faults.armed.retain(|armed| armed.handle != handle);
    }

    fn apply_faults(&mut self, _now: SimTime) {
        let armed = self.faults.armed.iter();
        let layer = Layer::of(armed.map(|armed| (&armed.fault, &armed.echoes)));
        layer.apply(&self.faults.layer, &mut self.plant);
        self.faults.layer = layer;
    }

    fn interfere(&mut self, seconds: f64, acted: &mut dyn FnMut(EffectHandle, String)) {
        for own in &mut self.faults.armed {
            let FaultKind::Mechanical(MechanicalFault::EncoderNoisy {
                pulses_per_second, ..
            }) = own.fault.kind
            else {
                continue;
            };
            let motors = own.fault.scope.motors;
            for wheel in Wheel::ALL {
                let mean = f64::from(pulses_per_second) * seconds;
                let share = &mut own.pulses[wheel.index()];
                *share += mean * 2.0 * own.noise.uniform();
                let whole = share.floor();
                *share -= whole;
                if is_about(motors, wheel) && whole >= 1.0 {
                    self.plant.add_pulses(wheel, pulses(whole));
                    acted(own.handle, format!("wheel {}", wheel.name()));
                }
            }
        }
    }

    fn acts(&self, handle: EffectHandle, fault: &Fault) -> bool {
        let plant = &self.plant;
        let commands = plant.commands();
        let runs = |pins: PortCommand| !pins.brake && commands.speed_voltage > 0.0;
        match &fault.kind {
            FaultKind::Electrical(kind) => *kind == ElectricalFault::SupplyLost {},
            FaultKind::Mechanical(MechanicalFault::PortsSwapped { port, with }) => [port, with]
                .into_iter()
                .any(|port| runs(commands.ports[port_of(*port).index()])),
            FaultKind::Mechanical(kind) => {
                let truth = plant.truth();
                Wheel::ALL.into_iter().any(|wheel| {
                    let pins = plant.wiring().command(commands, wheel);
                    let turns = truth.wheel_speed[wheel.index()].abs() > STANDING;
                    let state = MotorState {
                        driven: runs(pins),
                        turns,
                        repeats_wrongly: turns,
                        braked: pins.brake,
                    };
                    is_about(fault.scope.motors, wheel) && kind.acts_on(state)
                })
            }
            FaultKind::Sensor(kind) => {
                let unspoilt = plant.unspoilt();
                let mut alone = MecanumFaults::default();
                let mut armed = self.faults.armed.iter();
                if let Some(own) = armed.find(|armed| armed.handle == handle) {
                    add_of_sensor(&mut alone, kind, &own.echoes);
                }
                let mut spoilt = unspoilt;
                alone.spoil(&mut spoilt);
                spoilt != unspoilt
            }
            FaultKind::Wire(_)
            | FaultKind::Protocol(_)
            | FaultKind::Firmware(_)
            | FaultKind::Operator(_) => false,
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

/// Tells whether a fault of these motors is about this wheel; one of none is about all.
fn is_about(motors: Option<Motors>, wheel: Wheel) -> bool {
    match motors.unwrap_or(Motors::All) {
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
            if let FaultKind::Mechanical(kind) = &fault.kind {
                for wheel in Wheel::ALL {
                    if is_about(fault.scope.motors, wheel) {
                        kind.add_to_motor(&mut layer.wheels[wheel.index()], USUAL_DRAG);
                    }
                }
            }
            add(&mut layer.whole, &fault.kind, echoes);
        }
        layer
    }

    /// Puts this in the place of what was there `before`, and touches nothing else.
    fn apply(&self, before: &Self, plant: &mut MecanumPlant) {
        for wheel in Wheel::ALL {
            let own = self.wheels[wheel.index()];
            if own != before.wheels[wheel.index()] {
                plant.set_wheel_faults(wheel, own);
            }
        }
        if self.whole != before.whole {
            plant.set_faults(&self.whole);
        }
    }
}

fn add(whole: &mut MecanumFaults, fault: &FaultKind, echoes: &Echoes) {
    match fault {
        FaultKind::Electrical(fault) => match fault {
            ElectricalFault::SupplyLost {} => whole.unsupplied = true,
            // A car has nothing of the kind.
            ElectricalFault::RailLoad { .. }
            | ElectricalFault::RailShort { .. }
            | ElectricalFault::RailOpen { .. }
            | ElectricalFault::SupplySag { .. }
            | ElectricalFault::OverTemperature { .. }
            | ElectricalFault::PowerModuleFault {}
            | ElectricalFault::BatteryEmpty {}
            | ElectricalFault::ChargeDrop { .. }
            | ElectricalFault::FuseBlown { .. }
            | ElectricalFault::CanFailing { .. } => {}
        },
        FaultKind::Mechanical(MechanicalFault::PortsSwapped { port, with }) => {
            whole.swaps = whole.swaps.and(port_of(*port), port_of(*with));
        }
        FaultKind::Sensor(fault) => add_of_sensor(whole, fault, echoes),
        FaultKind::Wire(_)
        | FaultKind::Protocol(_)
        | FaultKind::Firmware(_)
        | FaultKind::Mechanical(_)
        | FaultKind::Operator(_) => {}
    }
}

fn add_of_sensor(whole: &mut MecanumFaults, fault: &SensorFault, echoes: &Echoes) {
    let mut spoil = |sensor: EchoSensor, how: &dyn Fn(usize) -> Ultrasonic| {
        for (index, own) in whole.ultrasonic.iter_mut().enumerate() {
            if sensor.has(index) {
                *own = how(index);
            }
        }
    };
    match fault {
        SensorFault::UltrasonicMissing { sensor } => spoil(*sensor, &|_| Ultrasonic::Missing),
        SensorFault::UltrasonicStuck { sensor } => {
            spoil(*sensor, &|index| Ultrasonic::Stuck(echoes[index]));
        }
        SensorFault::UltrasonicGhost { sensor, distance } => {
            spoil(*sensor, &|_| Ultrasonic::Ghost(distance.0));
        }
        SensorFault::TagMisread { reads_as } => whole.tag_reads_as = Some(*reads_as),
        SensorFault::StripLost {} => whole.strip_lost = true,
        SensorFault::InfraredStuck { sees } => whole.infrared_stuck = Some(*sees),
    }
}
