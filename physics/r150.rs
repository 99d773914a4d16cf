//! The hardware of the R150: chassis, drive, battery and the electrics of its IO module.
//!
//! The firmware sets [`R150Commands`] and reads [`R150Measurements`]; it decides about trips and
//! timeouts, the plant only ever measures. Currents are solved again on every change of a command or
//! load, not once a step, so that the firmware's protection timers start at the exact instant.

mod battery;
mod drive;
mod driver;
mod faults;
mod fuse;
mod network;
mod pwm;
mod sensing;
mod settings;
mod signals;
mod slow;

use std::time::Duration;

pub use faults::R150Faults;
pub use fuse::FuseId;
pub use settings::{
    AtZeroPwm, BatterySettings, BodySettings, FuseSettings, MotorSettings, MotorThermalSettings,
    R150PlantSettings, RailSettings, ThermalSettings,
};
pub use signals::{
    Load, Pair, PwmReading, PwmSource, R150Commands, R150Health, R150Measurements, R150Truth,
    RAILS, Rail, Side, Sides,
};

use crate::drawing::{Drawing, WheelDrawing};
use crate::faults::MotorFaults;
use crate::plant::Plant;
use crate::pose::Pose;
use crate::vehicle_body::VehicleBody;
use crate::world::World;
use drive::Drive;
use network::{Demand, Flow, MotorPort, Source};
use slow::SlowStates;

/// Least voltage that a supply keeps, V; divisions stay bounded by it.
const LOWEST_SUPPLY: f64 = 1.0;

/// One vehicle.
///
/// Time passes for it in one of two ways, never both for the same span: with the world, through
/// [`before_step`](Self::before_step) and [`after_step`](Self::after_step) around every
/// [`World::step`]; or, while it and everything else in the world [rests](Self::at_rest), through
/// [`rest`](Self::rest) in spans of any length.
#[derive(Debug, Clone)]
pub struct R150Plant {
    pub(crate) settings: R150PlantSettings,
    body: VehicleBody,
    commands: R150Commands,
    loads: [Load; RAILS],
    pwm_sources: [PwmSource; 4],
    /// Readings of the PWM inputs.
    pwm_in: [PwmReading; 4],
    side_faults: Sides<MotorFaults>,
    faults: R150Faults,
    drive: Drive,
    slow: SlowStates,
    flow: Flow,
    /// Speed that a stuck encoder repeats, r/min.
    encoder_rpm: [f64; 2],
    /// Count of the encoders, turns of the motors.
    encoder_turns: Sides<f64>,
    /// Part of the step that comes that has passed, s.
    passed: f64,
}

impl R150Plant {
    /// Puts a vehicle into the world, standing; `name` is what errors call it.
    #[must_use]
    pub fn new(name: &str, settings: &R150PlantSettings, world: &mut World, pose: Pose) -> Self {
        let drive = Drive::new(name, world, settings);
        let body = VehicleBody::new(world, name, settings.body.build(), pose);
        let mut plant = Self {
            settings: settings.clone(),
            body,
            commands: R150Commands::default(),
            loads: [Load::Open; RAILS],
            pwm_sources: [PwmSource::None; 4],
            pwm_in: [PwmReading::default(); 4],
            side_faults: Sides::default(),
            faults: R150Faults::default(),
            drive,
            slow: SlowStates::new(settings),
            flow: Flow::default(),
            encoder_rpm: [0.0; 2],
            encoder_turns: Sides::default(),
            passed: 0.0,
        };
        plant.solve_network();
        plant
    }

    /// Says that so much of the step that comes has passed when what follows is done to the pins.
    pub fn pass_to(&mut self, passed: Duration) {
        self.ramp_duties(passed.as_secs_f64());
    }

    /// Drives the pins. Voltages and currents follow at once, and the motors' duty along its ramp.
    pub fn set_commands(&mut self, commands: &R150Commands) {
        let commands = commands.within_limits();
        let moves = commands.motor_duty != self.commands.motor_duty
            || commands.propulsion_power != self.commands.propulsion_power
            || commands.parking_brake != self.commands.parking_brake;
        let switches = moves
            || commands.rail_on != self.commands.rail_on
            || commands.tail_power != self.commands.tail_power;
        let captures = commands.pwm_out_duty != self.commands.pwm_out_duty;
        self.commands = commands;
        if captures {
            self.capture_pwm();
        }
        if moves {
            self.body.wake();
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

    fn motor_port(&self, side: Side) -> MotorPort {
        let fuse = match side {
            Side::Right => FuseId::MotorRight,
            Side::Left => FuseId::MotorLeft,
        };
        let faults = &self.side_faults[side];
        let motor = MotorPort {
            connected: false,
            duty: 0.0,
            back_emf: self.drive.back_emf(side),
            resistance: self.settings.motor.resistance,
        };
        if self.is_fuse_blown(fuse) || faults.free_wheeling {
            return motor;
        }
        let driver = &self.drive.drivers[side.index()];
        let duty = driver.duty;
        let open = duty == 0.0 && self.settings.motor.at_zero_pwm == AtZeroPwm::Coast;
        let on = self.commands.propulsion_power && !open;
        let bus = self.flow.bus.max(LOWEST_SUPPLY);
        let duty = if faults.reversed { -duty } else { duty };
        driver.port(on, duty, bus, motor)
    }

    /// Moves the drivers' duties towards what the firmware wants, up to so many seconds into the step
    /// that comes.
    fn ramp_duties(&mut self, passed: f64) {
        let seconds = passed - self.passed;
        if seconds <= 0.0 {
            return;
        }
        self.passed = passed;
        for side in Side::ALL {
            let wanted = self.wanted_duty(side);
            let opens = wanted == 0.0 && self.settings.motor.at_zero_pwm == AtZeroPwm::Coast;
            let driver = &mut self.drive.drivers[side.index()];
            if self.commands.propulsion_power && !opens {
                driver.ramp(wanted, &self.settings.motor, seconds);
            } else {
                driver.duty = 0.0;
            }
        }
    }

    /// Duty that the firmware wants of the driver of a side.
    fn wanted_duty(&self, side: Side) -> f64 {
        let duty = self.commands.motor_duty[self.port_of(side)];
        let is_heard = duty.abs() >= self.settings.motor.dead_band / 100.0;
        if is_heard { duty } else { 0.0 }
    }

    /// Limits the drivers by how hot they and their motors are.
    fn warm_drivers(&mut self) {
        let stall = self.flow.bus / self.settings.motor.resistance;
        let drivers = self.drive.drivers.iter_mut();
        for (driver, celsius) in drivers.zip(self.slow.motors) {
            driver.warm(
                &self.settings.motor,
                &self.settings.motor_thermal,
                stall,
                celsius,
            );
        }
    }

    /// The side for which the firmware takes the motor and the encoder of a side.
    #[must_use]
    pub fn port_of(&self, side: Side) -> Side {
        match (self.faults.sides_swapped, side) {
            (false, side) => side,
            (true, Side::Right) => Side::Left,
            (true, Side::Left) => Side::Right,
        }
    }

    fn solve_network(&mut self) {
        let fuse_whole = |fuse: FuseId| !self.is_fuse_blown(fuse);
        let battery = &self.slow.battery;
        let mut loads = self.loads;
        for (load, fault) in loads.iter_mut().zip(self.faults.loads) {
            *load = fault.unwrap_or(*load);
        }
        let demand = Demand {
            source: Source {
                voltage: (battery.open_circuit() - self.faults.supply_drop).max(LOWEST_SUPPLY),
                resistance: battery.resistance + self.faults.supply_resistance,
            },
            takes_charge: !battery.full,
            motors: Side::ALL.map(|side| self.motor_port(side)),
            tail: fuse_whole(FuseId::Tail) && self.commands.tail_power,
            rail_on: self.commands.rail_on,
            loads,
            small_modules: if fuse_whole(FuseId::SmallModules) {
                self.settings.rails.small_modules_power
            } else {
                0.0
            },
        };
        self.flow = network::solve(&demand);
    }
}

impl Plant for R150Plant {
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
        let body = &self.settings.body;
        let radius = self.settings.tyre.wheel_radius;
        let (x, y) = (body.wheelbase / 2.0, body.track / 2.0);
        let speed = self.truth().wheel_speed;
        let wheels = [x, -x].into_iter().flat_map(|x| {
            [(y, speed.left), (-y, speed.right)]
                .map(|(y, speed)| WheelDrawing::new([x, y], radius, speed))
        });
        Drawing {
            wheels: wheels.collect(),
            echoes: Vec::new(),
        }
    }

    fn before_step(&mut self, world: &mut World) {
        if !self.body.rests_before(world) {
            drive::step(self, world);
        }
    }

    fn after_step(&mut self, world: &mut World) {
        if self.body.rests_after(world) {
            self.rest(world.step_length());
            return;
        }
        let seconds = world.step_length().as_secs_f64();
        self.passed = 0.0;
        let velocity = self.body.update_motion(world);
        self.drive.gear.take_velocity(velocity);
        self.update_encoders();
        self.solve_network();
        self.pass(seconds);
        self.warm_drivers();
        self.stop_when_slow(world, seconds);
    }

    /// Charge, temperatures and fuses advance in closed form, so the span may be anything; the
    /// currents follow the sinking voltage once a call.
    fn rest(&mut self, span: Duration) {
        self.passed = 0.0;
        self.pass(span.as_secs_f64());
        self.warm_drivers();
        self.solve_network();
    }

    fn place(&mut self, world: &mut World, pose: Pose) {
        self.body.place(world, pose);
        self.drive.gear.lift();
        self.solve_network();
    }
}
