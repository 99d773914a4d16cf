//! The hardware of the R150: chassis, drive, battery and the electrics of its IO module.
//!
//! The firmware sets [`R150Commands`] and reads [`R150Measurements`]; it decides about trips and
//! timeouts, the plant only ever measures. Currents are solved anew on every change of a command or
//! load, not once a step, so that the firmware's protection timers start at the exact instant.

mod battery;
mod drive;
mod faults;
mod fuse;
mod network;
mod pwm;
mod settings;
mod signals;
mod slow;

use std::time::Duration;

pub use faults::{Encoder, SideFaults};
pub use fuse::FuseId;
pub use settings::{
    BatterySettings, BodySettings, FuseSettings, MotorSettings, PwmSettings, R150PlantSettings,
    RailSettings, RestSettings, ThermalSettings,
};
pub use signals::{
    Load, PwmReading, PwmSource, R150Commands, R150Measurements, R150Truth, RAILS, Rail, Side,
    Sides,
};

use crate::pose::{BodyMotion, Pose};
use crate::world::{BodyId, BodyShape, World};
use drive::Drive;
use network::{Demand, Flow, MotorPort, Source};
use slow::SlowStates;

/// One vehicle.
///
/// Time passes for it in one of two ways, never both for the same span: with the world, through
/// [`before_step`](Self::before_step) and [`after_step`](Self::after_step) around every
/// [`World::step`]; or, while it and everything else in the world [rests](Self::at_rest), through
/// [`rest`](Self::rest) in spans of any length.
#[derive(Debug, Clone)]
pub struct R150Plant {
    settings: R150PlantSettings,
    body: BodyId,
    commands: R150Commands,
    loads: [Load; RAILS],
    pwm_sources: [PwmSource; 4],
    side_faults: Sides<SideFaults>,
    power_module_fault: bool,
    /// Ahead, left, counter-clockwise; N and N·m.
    push: [f64; 3],
    drive: Drive,
    slow: SlowStates,
    flow: Flow,
    motion: BodyMotion,
    distance: f64,
    /// What a stuck encoder repeats, rpm.
    encoder_rpm: [f64; 2],
    /// For how long it has been slow enough to stand, s.
    settled: f64,
    resting: bool,
}

impl R150Plant {
    /// Puts a vehicle into the world, standing, under the name `r150`.
    #[must_use]
    pub fn new(settings: &R150PlantSettings, world: &mut World, pose: Pose) -> Self {
        Self::with_name("r150", settings, world, pose)
    }

    /// Puts a vehicle into the world, standing; `name` is what errors call it.
    #[must_use]
    pub fn with_name(
        name: &str,
        settings: &R150PlantSettings,
        world: &mut World,
        pose: Pose,
    ) -> Self {
        let drive = Drive::new(settings);
        let shape = BodyShape {
            length: settings.body.length,
            width: settings.body.width,
            mass: drive.mass,
            inertia: drive.inertia,
        };
        let body = world.add_body(name, shape, pose);
        let mut plant = Self {
            settings: settings.clone(),
            body,
            commands: R150Commands::default(),
            loads: [Load::Open; RAILS],
            pwm_sources: [PwmSource::None; 4],
            side_faults: Sides::default(),
            power_module_fault: false,
            push: [0.0; 3],
            drive,
            slow: SlowStates::new(settings),
            flow: Flow::default(),
            motion: world.motion(body),
            distance: 0.0,
            encoder_rpm: [0.0; 2],
            settled: 0.0,
            resting: false,
        };
        plant.solve_network();
        plant
    }

    /// Drives the pins. Voltages and currents follow at once.
    pub fn set_commands(&mut self, commands: &R150Commands) {
        let commands = commands.within_limits();
        let moves = commands.motor_duty != self.commands.motor_duty
            || commands.propulsion_power != self.commands.propulsion_power
            || commands.parking_brake != self.commands.parking_brake;
        let switches = moves || commands.rail_on != self.commands.rail_on;
        self.commands = commands;
        if moves {
            self.wake();
        }
        if switches {
            self.solve_network();
        }
    }

    /// The pins as they are driven.
    #[must_use]
    pub fn commands(&self) -> &R150Commands {
        &self.commands
    }

    /// Applies the forces of one step. Call before every [`World::step`].
    pub fn before_step(&mut self, world: &mut World) {
        if self.resting {
            if world.is_still(self.body) {
                return;
            }
            self.wake();
        }
        drive::step(self, world);
    }

    /// Takes over what the step did and advances the electrics. Call after every [`World::step`].
    pub fn after_step(&mut self, world: &mut World) {
        if self.resting {
            if world.is_still(self.body) {
                self.rest(world.step_length());
                return;
            }
            // Something ran into it during this step.
            self.wake();
        }
        let seconds = world.step_length().as_secs_f64();
        self.motion = world.motion(self.body);
        let velocity = self.motion.body_velocity();
        let speed = velocity[0] * velocity[0] + velocity[1] * velocity[1];
        self.distance += speed.sqrt() * seconds;
        self.drive
            .traction
            .follow(velocity, self.drive.wheel_speed, seconds);
        self.note_encoders();
        self.solve_network();
        self.pass(seconds);
        self.settle(world, seconds);
    }

    /// Lets time pass while the vehicle [rests](Self::at_rest) and the world is not stepped.
    ///
    /// Charge, temperatures and fuses advance in closed form, so the span may be anything; the
    /// currents follow the sinking voltage once a call.
    pub fn rest(&mut self, span: Duration) {
        self.pass(span.as_secs_f64());
        self.solve_network();
    }

    /// Whether nothing moves and nothing drives, so that [`rest`](Self::rest) may stand in for steps
    /// of the world.
    #[must_use]
    pub fn at_rest(&self) -> bool {
        self.resting
    }

    /// Looks again whether the vehicle can stand, after a change around it such as another ground.
    pub fn wake(&mut self) {
        self.resting = false;
        self.settled = 0.0;
    }

    /// What the firmware's sensors read now.
    #[must_use]
    pub fn measurements(&self) -> R150Measurements {
        if !self.flow.module_powered {
            return R150Measurements::unpowered();
        }
        R150Measurements {
            module_powered: true,
            motor_rpm: Side::BOTH.map(|side| self.encoder(side)).into(),
            soc: self.slow.battery.soc(),
            bus_voltage: self.flow.bus,
            rail_voltage: self.flow.rail_voltage,
            rail_current: self.flow.rail_current,
            temperature: self.slow.temperature,
            pwm_in: self
                .pwm_sources
                .map(|source| pwm::read(source, &self.commands.pwm_out_duty, &self.settings.pwm)),
            power_module_fault: self.power_module_fault,
        }
    }

    /// How things really are.
    #[must_use]
    pub fn truth(&self) -> R150Truth {
        let [forward_speed, leftward_speed, yaw_rate] = self.motion.body_velocity();
        R150Truth {
            pose: self.motion.pose(),
            forward_speed,
            leftward_speed,
            yaw_rate,
            distance: self.distance,
            wheel_speed: self.drive.wheel_speed.into(),
            motor_current: self.flow.motor_current.into(),
            motor_supply_current: self.flow.motor_supply.into(),
            battery_voltage: self.flow.bus,
            battery_current: self.flow.battery_current,
            soc: self.slow.battery.soc(),
            charge_drawn: self.slow.battery.drawn(),
            mass: self.drive.mass,
            at_rest: self.resting,
        }
    }

    /// Its body in the world, for contact queries.
    #[must_use]
    pub fn body(&self) -> BodyId {
        self.body
    }

    fn motor_port(&self, side: Side) -> MotorPort {
        let fuse = match side {
            Side::Right => FuseId::MotorRight,
            Side::Left => FuseId::MotorLeft,
        };
        let supplied = self.commands.propulsion_power && !self.slow.fuses[fuse.index()].is_blown();
        MotorPort {
            connected: supplied && !self.side_faults[side].motor_disconnected,
            duty: self.commands.motor_duty[side],
            back_emf: self.drive.back_emf(side),
            resistance: self.settings.motor.resistance,
        }
    }

    fn solve_network(&mut self) {
        let fuse_whole = |fuse: FuseId| !self.slow.fuses[fuse.index()].is_blown();
        let demand = Demand {
            source: Source {
                voltage: self.slow.battery.open_circuit(),
                resistance: self.slow.battery.resistance(),
            },
            motors: Side::BOTH.map(|side| self.motor_port(side)),
            tail: fuse_whole(FuseId::Tail),
            rail_on: self.commands.rail_on,
            loads: self.loads,
            small_modules: if fuse_whole(FuseId::SmallModules) {
                self.settings.rails.small_modules_power
            } else {
                0.0
            },
        };
        self.flow = network::solve(&demand, &self.settings.rails);
    }

    /// Lets the slow states follow the present currents, which change whenever a fuse blows. Each
    /// round but the last blows one, so there are at most as many as there are fuses.
    fn pass(&mut self, seconds: f64) {
        let mut left = seconds;
        for _ in FuseId::ALL {
            let Some(due) = self
                .slow
                .time_to_blow(&self.flow)
                .filter(|due| *due <= left)
            else {
                break;
            };
            if !self.slow.advance(&self.flow, due) {
                self.slow.blow_next(&self.flow);
            }
            left -= due;
            self.solve_network();
            self.wake();
        }
        if self.slow.advance(&self.flow, left) {
            self.solve_network();
            self.wake();
        }
    }

    /// Counts how long the vehicle has been slow enough, and then brings it to a full stop.
    fn settle(&mut self, world: &mut World, seconds: f64) {
        let limit = self.settings.rest.speed;
        let half_length = self.settings.body.length / 2.0;
        let [ahead, left, yaw_rate] = self.motion.body_velocity();
        let radius = self.settings.tyre.wheel_radius;
        let slow = ahead.abs() <= limit
            && left.abs() <= limit
            && yaw_rate.abs() * half_length <= limit
            && self
                .drive
                .wheel_speed
                .iter()
                .all(|speed| speed.abs() * radius <= limit);
        if !slow || self.is_driven() {
            self.settled = 0.0;
            return;
        }
        self.settled += seconds;
        if self.settled < self.settings.rest.settle_time.as_secs_f64() {
            return;
        }
        self.resting = true;
        world.set_velocity(self.body, [0.0; 2], 0.0);
        self.motion = world.motion(self.body);
        self.drive.wheel_speed = [0.0; 2];
        self.note_encoders();
        self.solve_network();
    }

    /// Whether something is trying to move the vehicle. A motor against a blocked wheel counts: its
    /// current must go on being integrated.
    fn is_driven(&self) -> bool {
        let motors = Side::BOTH.iter().any(|side| {
            let port = self.motor_port(*side);
            port.connected && port.duty != 0.0
        });
        motors || self.push != [0.0; 3]
    }

    fn note_encoders(&mut self) {
        for side in Side::BOTH {
            if self.side_faults[side].encoder != Encoder::Stuck {
                self.encoder_rpm[side.index()] =
                    self.drive.motor_speed(side) * 60.0 / std::f64::consts::TAU;
            }
        }
    }

    fn encoder(&self, side: Side) -> f64 {
        match self.side_faults[side].encoder {
            Encoder::Lost => 0.0,
            Encoder::Working | Encoder::Stuck => self.encoder_rpm[side.index()],
        }
    }
}

impl R150Commands {
    /// A bridge cannot do more than follow its supply; anything that is not a number is off.
    fn within_limits(&self) -> Self {
        let within = |duty: f64, low: f64| {
            if duty.is_nan() {
                0.0
            } else {
                duty.clamp(low, 1.0)
            }
        };
        Self {
            motor_duty: Sides {
                right: within(self.motor_duty.right, -1.0),
                left: within(self.motor_duty.left, -1.0),
            },
            pwm_out_duty: self.pwm_out_duty.map(|duty| within(duty, 0.0)),
            ..*self
        }
    }
}

impl R150Measurements {
    fn unpowered() -> Self {
        Self {
            module_powered: false,
            motor_rpm: Sides::default(),
            soc: 0.0,
            bus_voltage: 0.0,
            rail_voltage: [0.0; RAILS],
            rail_current: [0.0; RAILS],
            temperature: [0.0; 2],
            pwm_in: [PwmReading::default(); 4],
            power_module_fault: false,
        }
    }
}
