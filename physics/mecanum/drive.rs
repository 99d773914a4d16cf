//! Motors, wheels and rollers: from the pins to the velocity of the body.

use super::MecanumPlant;
use super::encoder::PulseWire;
use super::faults::WheelFaults;
use super::motor::{Grip, Motor, MotorLaw, Order};
use super::settings::MecanumPlantSettings;
use super::signals::{PortCommand, WHEELS, Wheel};
use crate::tolerance::Draw;
use crate::traction::{Chassis, Patch, Slanted, Stance, Traction, Wheel as DrivenWheel};
use crate::world::World;

/// The moving parts; arrays are by [`Wheel::index`].
#[derive(Debug, Clone)]
pub(super) struct Drive {
    pub(super) traction: Traction<WHEELS, WHEELS, Slanted>,
    motors: [Motor; WHEELS],
    pulses: [PulseWire; WHEELS],
    /// Factor by which each wheel turns faster than it should.
    speed_factors: [f64; WHEELS],
    /// Factor by which the rollers of each wheel drag more than they should.
    roller_factors: [f64; WHEELS],
    /// Part of the step that comes that has passed, s, and what the pulses were told by then that
    /// the wheels turn in it, rad.
    passed: f64,
    turned: [f64; WHEELS],
    /// rad/s
    pub(super) wheel_speed: [f64; WHEELS],
    /// Angle that each wheel has turned, rad.
    pub(super) wheel_angle: [f64; WHEELS],
    /// Torque of each motor in the last step, N·m.
    pub(super) motor_torque: [f64; WHEELS],
    pub(super) mass: f64,
    pub(super) inertia: f64,
    stance: Stance,
    law: MotorLaw,
    wheel_radius: f64,
    rolling_resistance: f64,
    wheel_inertia: f64,
    gear_friction: f64,
    brake_torque: f64,
}

impl Drive {
    pub(super) fn new(name: &str, settings: &MecanumPlantSettings) -> Self {
        let mut draw = Draw::of(name);
        let wheel_factors = [(); WHEELS].map(|()| draw.factor(settings.tolerance.wheel));
        let motor_factors = [(); WHEELS].map(|()| draw.factor(settings.tolerance.motor));
        let roller_factors = [(); WHEELS].map(|()| draw.factor(settings.wheel.roller_spread));
        let body = &settings.body;
        let stance = Stance {
            half_wheelbase: body.half_wheelbase,
            half_track: body.half_track,
            centre_height: 0.0,
            centre: [0.0; 2],
            carried: None,
        };
        let places = stance.places();
        let patches = Wheel::ALL.map(|wheel| {
            let [x, y] = places[wheel.index()];
            let patch = Patch {
                x,
                y,
                wheel: wheel.index(),
            };
            (patch, Slanted::new(settings.wheel.axle_on_ground(wheel)))
        });
        let mut drive = Self {
            traction: Traction::with_contacts(&settings.wheel.tyre(), patches),
            motors: [Motor::new(); WHEELS],
            // Speeds and angles are those of a wheel of the nominal radius that gets as far.
            pulses: wheel_factors.map(|factor| {
                let pulses = f64::from(settings.encoder.pulses_per_revolution);
                PulseWire::new(pulses / factor, settings.encoder.hysteresis)
            }),
            roller_factors,
            speed_factors: std::array::from_fn(|wheel| wheel_factors[wheel] * motor_factors[wheel]),
            passed: 0.0,
            turned: [0.0; WHEELS],
            wheel_speed: [0.0; WHEELS],
            wheel_angle: [0.0; WHEELS],
            motor_torque: [0.0; WHEELS],
            mass: 0.0,
            inertia: 0.0,
            stance,
            law: MotorLaw::new(&settings.motor),
            wheel_radius: settings.wheel.radius,
            rolling_resistance: settings.wheel.rolling_resistance,
            wheel_inertia: settings.motor.inertia,
            gear_friction: settings.motor.gear_friction,
            brake_torque: settings.motor.brake_torque,
        };
        drive.set_payload(settings, body.payload);
        drive
    }

    /// The payload lies spread over the deck.
    pub(super) fn set_payload(&mut self, settings: &MecanumPlantSettings, payload: f64) {
        let body = &settings.body;
        let deck = body.length * body.length + body.width * body.width;
        self.mass = body.mass + payload;
        let grown = 1.0 + settings.wheel.roller_drag_growth * payload / body.mass;
        self.traction
            .set_across(self.roller_factors.map(|factor| factor * grown));
        self.inertia = body.yaw_inertia + payload * deck / 12.0;
        self.stance.centre_height =
            (body.mass * body.centre_of_mass_height + payload * body.payload_height) / self.mass;
    }

    /// Forces a wheel to a stand.
    pub(super) fn stop(&mut self, wheel: Wheel) {
        self.wheel_speed[wheel.index()] = 0.0;
    }

    pub(super) fn set_directed(&mut self, directed: bool) {
        for pulses in &mut self.pulses {
            pulses.set_directed(directed);
        }
    }

    pub(super) fn count(&self, wheel: Wheel) -> u32 {
        self.pulses[wheel.index()].count()
    }

    /// Takes over the velocity that a step really ended with.
    pub(super) fn follow(
        &mut self,
        velocity: [f64; 3],
        seconds: f64,
        faults: &[WheelFaults; WHEELS],
    ) {
        self.traction.follow(velocity, self.wheel_speed, seconds);
        for (index, pulses) in self.pulses.iter_mut().enumerate() {
            let turned = self.wheel_speed[index] * seconds;
            self.wheel_angle[index] += turned;
            pulses.turn(turned - self.turned[index], faults[index].encoder);
        }
        self.passed = 0.0;
        self.turned = [0.0; WHEELS];
    }

    /// Forgets what was ordered for a step that does not come.
    pub(super) fn forget_step(&mut self) {
        self.passed = 0.0;
        for motor in &mut self.motors {
            motor.forget();
        }
    }

    /// Part of the step that comes after which a wheel gives its next pulse, s.
    pub(super) fn next_pulse(&self) -> Option<f64> {
        let wheels = self.pulses.iter().zip(self.wheel_speed);
        let next = wheels.filter_map(|(pulses, speed)| pulses.next_in(speed));
        next.reduce(f64::min).map(|seconds| self.passed + seconds)
    }

    /// One wheel over a step, without the ground. The motor answers to the speed at the end of the
    /// step: its control is quicker than the step.
    fn wheel(
        &self,
        wheel: Wheel,
        grip: Grip,
        faults: &WheelFaults,
        load: f64,
        dt: f64,
    ) -> DrivenWheel {
        let hold_torque = self.gear_friction
            + self.rolling_resistance * load * self.wheel_radius
            + self.brake_torque * grip.held
            + faults.drag_torque;
        if faults.blocked {
            return DrivenWheel {
                speed: 0.0,
                inertia: self.wheel_inertia,
                compliance: 0.0,
                hold_torque,
            };
        }
        let inertia = self.wheel_inertia + dt * grip.gain;
        let momentum =
            self.wheel_inertia * self.wheel_speed[wheel.index()] + dt * grip.gain * grip.speed;
        DrivenWheel {
            speed: momentum / inertia,
            inertia,
            compliance: 1.0 / inertia,
            hold_torque,
        }
    }
}

impl MecanumPlant {
    /// Lets the orders as they are act up to `passed` seconds into the step that comes, and gives
    /// the pulses of the wheels until then, which turn on as they did.
    pub(super) fn drive_to(&mut self, passed: f64) {
        let seconds = passed - self.drive.passed;
        if seconds <= 0.0 {
            return;
        }
        self.drive.passed = passed;
        if self.body.is_resting() {
            return;
        }
        for wheel in Wheel::ALL {
            let order = self.order(wheel);
            let index = wheel.index();
            let drive = &mut self.drive;
            let speed = drive.wheel_speed[index];
            drive.motors[index].carry_out(order, speed, &drive.law, seconds);
            drive.turned[index] += speed * seconds;
            drive.pulses[index].turn(speed * seconds, self.wheel_faults[index].encoder);
        }
    }

    /// Returns what a wheel's motor is asked to do.
    pub(super) fn order(&self, wheel: Wheel) -> Order {
        let faults = &self.wheel_faults[wheel.index()];
        if faults.brake_stuck_on {
            return Order::Brake;
        }
        if !self.is_supplied() || faults.free_wheeling {
            return Order::Coast;
        }
        let PortCommand { reverse, brake } = self.wiring.command(&self.commands, wheel);
        match (brake, faults.brake_stuck_open) {
            (true, true) => Order::Coast,
            (true, false) => Order::Brake,
            (false, _) => {
                let reverse = reverse != faults.reversed;
                let speed = self.commands.speed_voltage * self.drive.speed_factors[wheel.index()];
                self.drive.law.order(speed, reverse)
            }
        }
    }
}

/// Computes the forces of one step and gives the body the velocity they lead to.
pub(super) fn step(plant: &mut MecanumPlant, world: &mut World) {
    let dt = world.step_length().as_secs_f64();
    let motion = world.motion(plant.body.id());
    let ground = world.ground_at(motion.x, motion.y);
    let gravity = world.gravity();
    for wheel in Wheel::ALL {
        let order = plant.order(wheel);
        let drive = &mut plant.drive;
        let (index, rest) = (wheel.index(), dt - drive.passed);
        let speed = drive.wheel_speed[index];
        drive.motors[index].carry_out(order, speed, &drive.law, rest);
    }

    let push = plant.total_push();
    let drive = &mut plant.drive;
    let weight = drive.mass * gravity;
    let pull = motion
        .to_body(ground.downhill())
        .map(|share| share * weight);
    let (loads, _) = drive.stance.loads(pull, weight * ground.cos_slope());
    let grips = Wheel::ALL.map(|wheel| {
        let index = wheel.index();
        let speed = drive.wheel_speed[index];
        drive.motors[index].grip(speed, &drive.law, dt)
    });
    let mut wheels = Wheel::ALL.map(|wheel| {
        let index = wheel.index();
        drive.wheel(
            wheel,
            grips[index],
            &plant.wheel_faults[index],
            loads[index],
            dt,
        )
    });

    let [push_ahead, push_left, push_turn] = push;
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
    drive
        .traction
        .solve(&mut chassis, &mut wheels, rolling, loads, friction, dt);
    drive.wheel_speed = wheels.map(|wheel| wheel.speed);
    for (index, grip) in grips.iter().enumerate() {
        drive.motor_torque[index] = grip.gain * (grip.speed - drive.wheel_speed[index]);
    }
    let [ahead, left, yaw_rate] = chassis.velocity;
    world.set_velocity(plant.body.id(), motion.to_world([ahead, left]), yaw_rate);
}
