//! Motors, gears, brakes and wheels: from bridge voltage to the velocity of the body.

use super::R150Plant;
use super::driver::Driver;
use super::faults::SideFaults;
use super::settings::R150PlantSettings;
use super::signals::Side;
use crate::pose::BodyMotion;
use crate::tolerance::Draw;
use crate::traction::{Chassis, Patch, Stance, Traction, Wheel};
use crate::world::{Ground, World};

/// Front left, front right, rear left, rear right.
pub(super) const WHEELS: usize = 4;

/// The moving parts.
#[derive(Debug, Clone)]
pub(super) struct Drive {
    pub(super) traction: Traction<2, WHEELS>,
    /// Of the wheels of each side, rad/s.
    pub(super) wheel_speed: [f64; 2],
    pub(super) drivers: [Driver; 2],
    /// Set if a wheel would lift off the ground.
    pub(super) tipping: bool,
    pub(super) mass: f64,
    pub(super) inertia: f64,
    stance: Stance,
    wheel_radius: f64,
    rolling_resistance: f64,
    /// Of each side; a smaller wheel is a shorter gear.
    gear_ratio: [f64; 2],
    torque_constant: [f64; 2],
    winding_resistance: f64,
    /// Of rotor and wheels at the wheel's speed, kg·m².
    side_inertia: f64,
    gear_friction: f64,
    gear_loss: f64,
    brake_torque: f64,
}

/// What turns the wheels of one side.
#[derive(Debug, Clone, Copy)]
struct SideDrive {
    /// Voltage of the bridge; `None` if no current can flow.
    voltage: Option<f64>,
    /// Through the windings at the start of the step, A.
    current: f64,
    brake: bool,
    faults: SideFaults,
    /// Load on the wheels, N.
    load: f64,
}

impl Drive {
    pub(super) fn new(name: &str, settings: &R150PlantSettings) -> Self {
        let mut draw = Draw::of(name);
        let tolerance = &settings.tolerance;
        let body = &settings.body;
        let motor = &settings.motor;
        let (x, y) = (body.wheelbase / 2.0, body.track / 2.0);
        let patch = |x, y, side: Side| Patch {
            x,
            y,
            wheel: side.index(),
        };
        let patches = [
            patch(x, y, Side::Left),
            patch(x, -y, Side::Right),
            patch(-x, y, Side::Left),
            patch(-x, -y, Side::Right),
        ];
        let ratio = motor.gear_ratio;
        let mut drive = Self {
            traction: Traction::new(&settings.tyre, patches),
            wheel_speed: [0.0; 2],
            drivers: [Driver::new(motor); 2],
            tipping: false,
            mass: 0.0,
            inertia: 0.0,
            stance: Stance {
                half_wheelbase: x,
                half_track: y,
                centre_height: 0.0,
                centre: [0.0; 2],
                carried: None,
            },
            wheel_radius: settings.tyre.wheel_radius,
            rolling_resistance: settings.tyre.rolling_resistance,
            gear_ratio: Side::BOTH.map(|_| ratio / draw.factor(tolerance.wheel)),
            torque_constant: Side::BOTH
                .map(|_| motor.back_emf_constant * draw.factor(tolerance.motor)),
            winding_resistance: motor.resistance,
            side_inertia: motor.rotor_inertia * ratio * ratio + 2.0 * motor.wheel_inertia,
            gear_friction: motor.gear_friction,
            gear_loss: motor.gear_loss,
            brake_torque: motor.brake_torque,
        };
        drive.set_payload(settings, body.payload);
        drive
    }

    /// The payload lies spread over the deck.
    pub(super) fn set_payload(&mut self, settings: &R150PlantSettings, payload: f64) {
        let body = &settings.body;
        let deck = body.length * body.length + body.width * body.width;
        self.mass = body.mass + payload;
        self.inertia = body.yaw_inertia + payload * deck / 12.0;
        self.stance.centre_height =
            (body.mass * body.centre_of_mass_height + payload * body.payload_height) / self.mass;
        self.stance.centre =
            [body.payload_ahead, body.payload_left].map(|place| payload * place / self.mass);
    }

    /// Forgets how the vehicle leaned, as after lifting it off the ground.
    pub(super) fn forget_leaning(&mut self) {
        self.stance.carried = None;
    }

    /// Speed of a motor shaft, rad/s.
    pub(super) fn motor_speed(&self, side: Side) -> f64 {
        self.wheel_speed[side.index()] * self.gear_ratio[side.index()]
    }

    pub(super) fn back_emf(&self, side: Side) -> f64 {
        self.motor_speed(side) * self.torque_constant[side.index()]
    }

    /// Forces the wheels to a stand, as a blocked side does.
    pub(super) fn stop(&mut self, side: Side) {
        self.wheel_speed[side.index()] = 0.0;
    }

    /// The wheels of one side over a step, without the ground. The motor's back-EMF answers to the
    /// speed at the end of the step: its time constant is near the step itself.
    fn wheel(&self, side: Side, drive: &SideDrive, dt: f64) -> Wheel {
        let speed = self.wheel_speed[side.index()];
        let (ratio, constant) = (
            self.gear_ratio[side.index()],
            self.torque_constant[side.index()],
        );
        let faults = &drive.faults;
        let brake = if (drive.brake && !faults.brake_stuck_open) || faults.brake_stuck_on {
            self.brake_torque
        } else {
            0.0
        };
        let motor_torque = drive.current * constant;
        let gear = self.gear_friction + self.gear_loss * motor_torque.abs();
        let hold_torque = gear * ratio
            + self.rolling_resistance * drive.load * self.wheel_radius
            + brake
            + faults.drag_torque;
        if faults.blocked {
            return Wheel {
                speed: 0.0,
                inertia: self.side_inertia,
                compliance: 0.0,
                hold_torque,
            };
        }
        let mut momentum = self.side_inertia * speed;
        let mut inertia = self.side_inertia;
        if let Some(voltage) = drive.voltage {
            let torque_per_volt = ratio * constant / self.winding_resistance;
            momentum += dt * torque_per_volt * voltage;
            inertia += dt * torque_per_volt * ratio * constant;
        }
        Wheel {
            speed: momentum / inertia,
            inertia,
            compliance: 1.0 / inertia,
            hold_torque,
        }
    }

    /// Downhill pull of gravity in the axes of the body, N.
    fn pull(&self, ground: &Ground, gravity: f64, motion: &BodyMotion) -> [f64; 2] {
        let weight = self.mass * gravity;
        motion
            .to_body(ground.downhill())
            .map(|share| share * weight)
    }
}

/// Computes the tyre forces of one step and gives the body the velocity they lead to.
pub(super) fn step(plant: &mut R150Plant, world: &mut World) {
    let dt = world.step_length().as_secs_f64();
    let motion = world.motion(plant.body.id());
    let ground = world.ground_at(motion.x, motion.y);
    let gravity = world.gravity();

    plant.follow_duty(dt);
    let drive = &mut plant.drive;
    let pull = drive.pull(&ground, gravity, &motion);
    let weight = drive.mass * gravity * ground.cos_slope();
    let on_tyres = drive.traction.force(dt);
    let (loads, lifts) = drive.stance.carry(pull, on_tyres, weight, dt);
    drive.tipping = lifts;
    let drive = &plant.drive;
    let side_loads = [loads[1] + loads[3], loads[0] + loads[2]];
    let mut wheels = Side::BOTH.map(|side| {
        let index = side.index();
        let port = plant.motor_port(side);
        let side_drive = SideDrive {
            voltage: port.connected.then_some(port.duty * plant.flow.bus),
            current: plant.flow.motor_current[index],
            brake: plant.commands.parking_brake,
            faults: plant.side_faults[side],
            load: side_loads[index],
        };
        drive.wheel(side, &side_drive, dt)
    });

    let [push_ahead, push_left, push_turn] = plant.total_push();
    let [ahead, left, yaw_rate] = motion.body_velocity();
    let mut chassis = Chassis {
        mass: drive.mass,
        inertia: drive.inertia,
        velocity: [
            ahead + dt * (pull[0] + push_ahead) / drive.mass,
            left + dt * (pull[1] + push_left) / drive.mass,
            yaw_rate + dt * push_turn / drive.inertia,
        ],
    };
    let mut friction = world.friction_under(&motion, &drive.stance.places());
    if let Some(most) = plant.faults.friction {
        friction = friction.map(|friction| friction.min(most));
    }
    let rolling = drive.wheel_speed;
    plant
        .drive
        .traction
        .solve(&mut chassis, &mut wheels, rolling, loads, friction, dt);
    plant.drive.wheel_speed = wheels.map(|wheel| wheel.speed);
    let [ahead, left, yaw_rate] = chassis.velocity;
    world.set_velocity(plant.body.id(), motion.to_world([ahead, left]), yaw_rate);
}
