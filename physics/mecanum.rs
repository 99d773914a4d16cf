//! The hardware of the mecanum car: chassis, motors, rollers, encoders and sensors.
//!
//! The firmware sets [`MecanumCommands`] and reads [`MecanumMeasurements`].
//!
//! # Model
//!
//! Each wheel pushes the ground along the axle of the roller that it stands on, as far as friction
//! goes, and rolls across it against a drag; [`crate::traction`] has the law. Seen from above the
//! upper rollers lie LF `\\`, RF `/`, LR `/`, RR `\\`, and those on the ground mirrored. Without
//! slip the speeds of the contacts are then, with `k` half the wheelbase plus half the track,
//!
//! ```text
//! LF = vx − vy − kω    RF = vx + vy + kω    LR = vx + vy − kω    RR = vx − vy + kω
//! ```
//!
//! Source: H. Taheri, B. Qiao, N. Ghaeminezhad, *Kinematic Model of a Four Mecanum Wheeled Mobile
//! Robot*, IJCA 113(3), 2015. Nothing here computes with that formula; the tests do.
//!
//! The motors are brushless gear motors with their own speed control: it follows the speed
//! voltage along a ramp, in the direction that FR says, with no more torque than it has.

mod drive;
mod encoder;
mod faults;
mod motor;
mod sensing;
mod sensors;
mod settings;
pub mod signals;

use std::time::Duration;

pub use faults::{MecanumFaults, Ultrasonic};
pub use sensing::MecanumTruth;
pub use settings::{
    CarBodySettings, CarMotorSettings, EncoderSettings, MecanumPlantSettings, MecanumWheelSettings,
    UltrasonicSettings,
};
pub use signals::{
    ECHOES, MecanumCommands, MecanumMeasurements, PORTS, PlugSwaps, Port, PortCommand, WHEELS,
    Wheel,
};

use crate::drawing::{Drawing, EchoDrawing, WheelDrawing};
use crate::faults::MotorFaults;
use crate::noise::Noise;
use crate::plant::Plant;
use crate::pose::Pose;
use crate::vehicle_body::VehicleBody;
use crate::world::World;
use drive::Drive;
use sensors::Sensors;

/// One car.
///
/// Time passes for it as for an [`R150Plant`](crate::R150Plant): with the world, through
/// [`before_step`](Self::before_step) and [`after_step`](Self::after_step) around every
/// [`World::step`]; or, while it and everything else in the world [rests](Self::at_rest), through
/// [`rest`](Self::rest) in spans of any length.
#[derive(Debug, Clone)]
pub struct MecanumPlant {
    pub(crate) settings: MecanumPlantSettings,
    body: VehicleBody,
    commands: MecanumCommands,
    wheel_faults: [MotorFaults; WHEELS],
    faults: MecanumFaults,
    /// Count of the ports' counters besides their wheel's pulses.
    pulse_offset: [u32; PORTS],
    drive: Drive,
    sensors: Sensors,
}

impl MecanumPlant {
    /// Puts a car into the world, standing; `name` is what errors call it.
    #[must_use]
    pub fn new(name: &str, settings: &MecanumPlantSettings, world: &mut World, pose: Pose) -> Self {
        let drive = Drive::new(name, world, settings);
        let body = VehicleBody::new(world, name, settings.body.build(), pose);
        let mut sensors = Sensors::new(settings);
        sensors.look(world, body.id(), body.motion());
        Self {
            pulse_offset: [0; PORTS],
            settings: settings.clone(),
            body,
            commands: MecanumCommands::default(),
            wheel_faults: [MotorFaults::default(); WHEELS],
            faults: MecanumFaults::default(),
            drive,
            sensors,
        }
    }

    /// From where the errors of its sensors are drawn.
    pub fn set_chance(&mut self, chance: Noise) {
        self.sensors.chance = chance;
    }

    /// Drives the pins.
    pub fn set_commands(&mut self, commands: &MecanumCommands) {
        let commands = commands.within_limits();
        if commands != self.commands {
            self.commands = commands;
            self.body.wake();
        }
    }

    /// The pins as they are driven.
    #[must_use]
    pub fn commands(&self) -> &MecanumCommands {
        &self.commands
    }

    /// The pins to a wheel's motor, wherever it is plugged in.
    #[must_use]
    pub fn pins(&self, wheel: Wheel) -> PortCommand {
        self.commands.ports[self.faults.swaps.port(wheel).index()]
    }

    /// Says that so much of the step that comes has passed when what follows is done to the pins.
    /// The wheels give their pulses until then, as they are foreseen to turn.
    pub fn pass_to(&mut self, passed: Duration) {
        self.drive_to(passed.as_secs_f64());
    }

    /// Part of the step that comes after which a wheel gives its next pulse, if it turns on as
    /// it does and that is within a second.
    #[must_use]
    pub fn next_pulse(&self) -> Option<Duration> {
        let seconds = self.drive.next_pulse().filter(|seconds| *seconds < 1.0)?;
        Some(Duration::from_secs_f64(seconds))
    }
}

impl Plant for MecanumPlant {
    fn vehicle(&self) -> &VehicleBody {
        &self.body
    }

    fn vehicle_mut(&mut self) -> &mut VehicleBody {
        &mut self.body
    }

    fn is_tipping(&self) -> bool {
        self.drive.gear.tipping
    }

    fn drawing(&self) -> Drawing {
        let settings = &self.settings;
        let (x, y) = (settings.body.half_wheelbase, settings.body.half_track);
        let radius = settings.wheel.radius;
        let places = [[x, y], [x, -y], [-x, y], [-x, -y]];
        let speeds = self.truth().wheel_speed;
        let wheels = places.into_iter().zip(speeds);
        let ultrasonic = &settings.ultrasonic;
        let echoes = self.measurements().echoes.into_iter().enumerate();
        let echo = |(index, distance): (usize, Option<f64>)| EchoDrawing {
            place: [ultrasonic.x[index], ultrasonic.y[index]],
            heading: ultrasonic.angle[index].to_radians(),
            opening: 2.0 * ultrasonic.half_angle.to_radians(),
            range: ultrasonic.range,
            distance,
        };
        Drawing {
            wheels: wheels
                .map(|(place, speed)| WheelDrawing::new(place, radius, speed))
                .collect(),
            echoes: echoes.map(echo).collect(),
        }
    }

    fn before_step(&mut self, world: &mut World) {
        if !self.body.rests_before(world) {
            drive::step(self, world);
        }
    }

    fn after_step(&mut self, world: &mut World) {
        let step = world.step_length();
        if self.body.rests_after(world) {
            self.rest(step);
        } else {
            let seconds = step.as_secs_f64();
            let velocity = self.body.update_motion(world);
            self.drive.take_velocity(velocity, &self.wheel_faults);
            self.stop_when_slow(world, seconds);
        }
        // Others may be moving around it.
        self.sensors
            .measure_due(step, world, self.body.id(), self.body.motion());
    }

    /// Nothing changes then, so the span may be anything.
    fn rest(&mut self, _span: Duration) {
        self.drive.forget_step();
    }

    fn place(&mut self, world: &mut World, pose: Pose) {
        self.body.place(world, pose);
        self.drive.gear.lift();
        self.sensors.look(world, self.body.id(), self.body.motion());
    }
}
