//! Motors, wheels and rollers: from the pins to the velocity of the body.

use super::MecanumPlant;
use super::encoder::{PulseWire, Turning};
use super::motor::{Motor, MotorLaw, Order};
use super::settings::MecanumPlantSettings;
use super::signals::{PortCommand, WHEELS, Wheel};
use crate::faults::MotorFaults;
use crate::running_gear::{Changes, RunningGear, Span, WheelDrive};
use crate::tolerance::Draw;
use crate::traction::Slanted;
use crate::twist::{Twist, Wrench};
use crate::world::World;

/// Rolling speed above which the rubber of a roller damps no longer, m/s: well below the car's full
/// speed.
const DAMPING_FADE_SPEED: f64 = 0.1;

/// Most orders that are distinguished in a step; those that follow last until its end.
const MOST_ORDERS: usize = 64;

/// The moving parts; arrays are by [`Wheel::index`].
#[derive(Debug, Clone)]
pub(super) struct Drive {
    pub(super) gear: RunningGear<WHEELS, Slanted>,
    motors: [Motor; WHEELS],
    /// Orders of the step that comes.
    orders: Vec<Orders>,
    pub(super) pulses: [PulseWire; WHEELS],
    /// Factor by which each wheel turns faster than it should.
    speed_factors: [f64; WHEELS],
    /// Factor by which the rollers of each wheel drag more than they should.
    roller_factors: [f64; WHEELS],
    /// Part of the step that comes that has passed, s, and what the pulses got by then that
    /// the wheels turn in it, rad.
    passed: f64,
    turned: [f64; WHEELS],
    /// Angle that each wheel has turned, rad.
    pub(super) wheel_angle: [f64; WHEELS],
    /// Torque of each motor in the mean of the last step, N·m.
    pub(super) motor_torque: [f64; WHEELS],
    law: MotorLaw,
    gear_friction: f64,
    brake_torque: f64,
}

/// Orders to the motors for a part of a step.
#[derive(Debug, Clone, Copy)]
struct Orders {
    span: Span,
    of: [Order; WHEELS],
}

impl Drive {
    pub(super) fn new(name: &str, world: &World, settings: &MecanumPlantSettings) -> Self {
        let mut draw = Draw::of(name, world.tolerance_seed());
        let wheel_factors = [(); WHEELS].map(|()| draw.factor(settings.tolerance.wheel));
        let motor_factors = [(); WHEELS].map(|()| draw.factor(settings.tolerance.motor));
        let roller_factors = [(); WHEELS].map(|()| draw.factor(settings.wheel.roller_spread));
        let body = &settings.body;
        let contacts = Wheel::ALL.map(|wheel| {
            let roller = Slanted::new(settings.wheel.axle_on_ground(wheel));
            (wheel.index(), roller)
        });
        Self {
            gear: RunningGear::new(
                (&settings.wheel.tyre(), DAMPING_FADE_SPEED),
                [body.half_wheelbase, body.half_track],
                settings.motor.inertia,
                contacts,
            ),
            motors: [Motor::new(); WHEELS],
            orders: Vec::new(),
            // Speeds and angles are those of a wheel of the nominal radius that gets as far.
            pulses: wheel_factors.map(|factor| {
                let pulses = f64::from(settings.encoder.pulses_per_revolution);
                PulseWire::new(pulses / factor)
            }),
            roller_factors,
            speed_factors: std::array::from_fn(|wheel| wheel_factors[wheel] * motor_factors[wheel]),
            passed: 0.0,
            turned: [0.0; WHEELS],
            wheel_angle: [0.0; WHEELS],
            motor_torque: [0.0; WHEELS],
            law: MotorLaw::new(&settings.motor),
            gear_friction: settings.motor.gear_friction,
            brake_torque: settings.motor.brake_torque,
        }
    }

    /// Sets the drag of the rollers under a payload, kg.
    fn load_rollers(&mut self, settings: &MecanumPlantSettings, payload: f64) {
        let wheel = &settings.wheel;
        let growth = wheel.roller_drag_growth * payload / settings.body.mass;
        let drag = wheel.roller_drag * (1.0 + growth);
        self.gear
            .traction
            .set_drag(self.roller_factors.map(|factor| factor * drag));
    }

    /// Takes over the velocity that a step really ended with.
    pub(super) fn take_velocity(&mut self, velocity: Twist, faults: &[MotorFaults; WHEELS]) {
        self.gear.take_velocity(velocity);
        for (index, pulses) in self.pulses.iter_mut().enumerate() {
            let turned = self.gear.turned[index];
            self.wheel_angle[index] += turned;
            pulses.turn(turned - self.turned[index], faults[index].encoder);
        }
        self.forget_step();
    }

    /// Forgets what was ordered for a step that is over or does not come.
    pub(super) fn forget_step(&mut self) {
        self.passed = 0.0;
        self.turned = [0.0; WHEELS];
        self.orders.clear();
    }

    /// Notes what is asked of the motors up to `passed` seconds into the step that comes.
    fn ask(&mut self, orders: [Order; WHEELS], passed: f64) {
        if passed <= self.passed {
            return;
        }
        let from = std::mem::replace(&mut self.passed, passed);
        let full = self.orders.len() == MOST_ORDERS;
        match self.orders.last_mut() {
            Some(last) if full || last.of == orders => {
                last.span.to = passed;
                last.of = orders;
            }
            _ => self.orders.push(Orders {
                span: Span { from, to: passed },
                of: orders,
            }),
        }
    }

    /// How what is asked of the motors changes in the step that comes.
    fn changes(&self) -> Changes {
        let starts = self.orders.iter().skip(1).map(|orders| orders.span.from);
        Changes {
            gradual: self.orders.iter().any(|orders| {
                let mut motors = self.motors.iter().zip(orders.of);
                motors.any(|(motor, order)| motor.moves(order))
            }),
            sudden: starts.collect(),
        }
    }

    /// How a wheel is foreseen to turn in the step that comes.
    fn turning(&self, index: usize) -> Turning {
        Turning::new(self.gear.wheel_speed[index], self.gear.acceleration[index])
    }

    /// Part of the step that comes after which a wheel gives its next pulse, s.
    pub(super) fn next_pulse(&self) -> Option<f64> {
        let wheels = self.pulses.iter().enumerate();
        let next = wheels.filter_map(|(index, pulses)| {
            let turning = self.turning(index).after(self.passed);
            pulses.next_in(turning)
        });
        next.reduce(f64::min).map(|seconds| self.passed + seconds)
    }
}

impl MecanumPlant {
    /// Applies the orders as they are up to `passed` seconds into the step that comes, and counts
    /// the pulses of the wheels until then, as they are foreseen to turn.
    pub(super) fn drive_to(&mut self, passed: f64) {
        if passed <= self.drive.passed {
            return;
        }
        let orders = Wheel::ALL.map(|wheel| self.order(wheel));
        let drive = &mut self.drive;
        drive.ask(orders, passed);
        for index in 0..WHEELS {
            let turned = drive.turning(index).angle(passed);
            let angle = turned - std::mem::replace(&mut drive.turned[index], turned);
            drive.pulses[index].turn(angle, self.wheel_faults[index].encoder);
        }
    }

    /// Returns what a wheel's motor is asked to do.
    fn order(&self, wheel: Wheel) -> Order {
        let faults = &self.wheel_faults[wheel.index()];
        if faults.brake_stuck_on {
            return Order::Brake;
        }
        if !self.is_supplied() || faults.free_wheeling {
            return Order::Coast;
        }
        let PortCommand { reverse, brake } = self.pins(wheel);
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

    /// Counts how long the car has been slow enough, and then brings it to a full stop.
    pub(super) fn stop_when_slow(&mut self, world: &mut World, seconds: f64) {
        let could_stand = self.drive.gear.is_slow(&self.body) && !self.is_driven();
        let (gear, body) = (&mut self.drive.gear, &mut self.body);
        gear.stop_when_slow(body, world, seconds, could_stand);
    }

    /// Returns whether something is trying to move the car.
    fn is_driven(&self) -> bool {
        let turns = |wheel| matches!(self.order(wheel), Order::Turn(speed) if speed != 0.0);
        self.body.push() != Wrench::default() || Wheel::ALL.into_iter().any(turns)
    }
}

/// Computes the forces of one step and sets the body's velocity. The motors answer to the speeds at the
/// end of each part of it: their control is quicker.
pub(super) fn step(plant: &mut MecanumPlant, world: &mut World) {
    let dt = world.step_length().as_secs_f64();
    let orders = Wheel::ALL.map(|wheel| plant.order(wheel));
    let drive = &mut plant.drive;
    drive.load_rollers(&plant.settings, plant.body.faults().payload);
    drive.ask(orders, dt);
    let changes = drive.changes();
    let Drive {
        gear,
        motors,
        orders,
        law,
        gear_friction,
        brake_torque,
        ..
    } = drive;
    gear.step(world, &plant.body, &changes, |span, speeds| {
        let seconds = span.seconds();
        std::array::from_fn(|wheel| {
            let faults = &plant.wheel_faults[wheel];
            let parts = orders
                .iter()
                .map(|part| (part.of[wheel], part.span.overlap(span)));
            let parts = parts.filter(|(_, seconds)| *seconds > 0.0);
            let grip = motors[wheel].carry_out(parts, speeds[wheel], law, seconds);
            WheelDrive {
                impulse: seconds * grip.gain * grip.speed,
                opposed: seconds * grip.gain,
                gear: *gear_friction,
                brake: *brake_torque * grip.held,
                drag: faults.drag_torque,
                blocked: faults.blocked,
            }
        })
    });
    drive.motor_torque = drive.gear.motor_impulse.map(|impulse| impulse / dt);
}
