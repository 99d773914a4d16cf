//! Running gear of every vehicle: four wheels under its weight, and what they do in a step.

use crate::traction::{
    Chassis, Contact, GroundForce, Patch, Stance, Straight, Traction, TyreSettings, Wheel,
};
use crate::twist::{Twist, Wrench};
use crate::vehicle_body::VehicleBody;
use crate::world::{Course, World};

/// Length that no part of a step exceeds in which tyres slide, or what drives the wheels changes in
/// a turn, s. Other steps are taken as a whole, but for what changes at once: parts would double the
/// cost and show nothing.
const PART: f64 = 1e-3;
/// Length of the shortest part that a sudden change cuts off, s.
const SHORTEST: f64 = 1e-4;
/// Acceleration from which on what drives a wheel counts as changing, rad/s².
const QUICK: f64 = 0.4;
/// Share of what friction gives with which a tyre pulls across in a turn. Rollers always do: what
/// turns their wheels pushes the vehicle aside.
const ACROSS: f64 = 0.1;

/// Patches of a vehicle on the ground: front left, front right, rear left, rear right.
pub(crate) const PATCHES: usize = 4;

/// Balance of the energy of a vehicle's motion since the start, J.
///
/// Motors, gravity, pushes and neighbours give it; it ends as heat or is in the motion:
/// `motors + outside` is `held + tyres` and what body and wheels have by their speeds, as long as nothing
/// lifts the vehicle or changes its load as it drives.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct Energy {
    /// Given to the wheels by the motors, less what these took back.
    pub motors: f64,
    /// Given by gravity, by pushes, and by what the body ran into, less what those took.
    pub outside: f64,
    /// Heat of gears, bearings, brakes and rolling.
    pub held: f64,
    /// Heat of what slips on the ground, with what the rubber holds like a spring.
    pub tyres: f64,
}

/// Part of a step, s.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Span {
    /// From the beginning of the step.
    pub(crate) from: f64,
    pub(crate) to: f64,
}

/// How what drives the wheels changes in a step.
#[derive(Debug, Default)]
pub(crate) struct Changes {
    /// Set if it does so little by little.
    pub(crate) gradual: bool,
    /// Times at which it does so at once, in order, s.
    pub(crate) sudden: Vec<f64>,
}

/// Drive and brake of a wheel over a part of a step.
#[derive(Debug, Clone, Copy)]
pub(crate) struct WheelDrive {
    /// Impulse that the motor gives a wheel that stands, as at the end of the part, N·m·s.
    pub(crate) impulse: f64,
    /// By how much less it gives for each rad/s at the end of the part, kg·m².
    pub(crate) opposed: f64,
    /// Dry friction of the gear, N·m.
    pub(crate) gear: f64,
    /// Torque that the brake holds, N·m.
    pub(crate) brake: f64,
    /// Torque of what drags besides, N·m.
    pub(crate) drag: f64,
    /// It cannot turn.
    pub(crate) blocked: bool,
}

/// What acts on the vehicle from outside in a step.
struct Outside {
    /// Downhill, ahead and left in the axes of the step's beginning, N.
    pull: [f64; 2],
    push: Wrench,
    /// That presses it on the ground, N.
    pressing: f64,
    /// Under each patch.
    friction: [f64; PATCHES],
}

/// The running gear; wheels that are geared together are one.
#[derive(Debug, Clone)]
pub struct RunningGear<const WHEELS: usize, C = Straight> {
    pub(crate) traction: Traction<WHEELS, PATCHES, C>,
    /// rad/s
    pub(crate) wheel_speed: [f64; WHEELS],
    /// Acceleration of each at the end of the last step, rad/s².
    pub(crate) acceleration: [f64; WHEELS],
    /// Angle by which each turned in the last step, rad.
    pub(crate) turned: [f64; WHEELS],
    /// Impulse that each motor gave its wheel in the last step, N·m·s.
    pub(crate) motor_impulse: [f64; WHEELS],
    /// Set if a wheel would lift off the ground.
    pub(crate) tipping: bool,
    /// Of the vehicle in the last step, kg.
    mass: f64,
    /// kg·m²
    inertia: f64,
    /// The balance of its energy, once a test asks for it.
    pub energy: Option<Energy>,
    stance: Stance,
    /// Index of the wheel of each patch.
    wheel_of: [usize; PATCHES],
    /// Of a wheel with all that turns with it, kg·m².
    wheel_inertia: f64,
    wheel_radius: f64,
    rolling_resistance: f64,
}

impl Span {
    pub(crate) fn seconds(self) -> f64 {
        self.to - self.from
    }

    /// For how long two spans are at the same time, s.
    pub(crate) fn overlap(self, other: Self) -> f64 {
        (self.to.min(other.to) - self.from.max(other.from)).max(0.0)
    }
}

impl<const WHEELS: usize, C: Contact> RunningGear<WHEELS, C> {
    /// Wheels that stand, with tyres that damp below a speed in m/s; half the wheelbase and half the track in m, the inertia of a wheel in
    /// kg·m². `contacts` has the wheel of each patch, and how it touches the ground.
    pub(crate) fn new(
        (tyre, fade_speed): (&TyreSettings, f64),
        [half_wheelbase, half_track]: [f64; 2],
        wheel_inertia: f64,
        contacts: [(usize, C); PATCHES],
    ) -> Self {
        let stance = Stance {
            half_wheelbase,
            half_track,
            centre_height: 0.0,
            centre: [0.0; 2],
            carried: None,
        };
        let places = stance.places();
        let patches = std::array::from_fn(|at| {
            let ([x, y], (wheel, contact)) = (places[at], contacts[at]);
            (Patch { x, y, wheel }, contact)
        });
        Self {
            traction: Traction::new(tyre, fade_speed, patches),
            wheel_speed: [0.0; WHEELS],
            acceleration: [0.0; WHEELS],
            turned: [0.0; WHEELS],
            motor_impulse: [0.0; WHEELS],
            tipping: false,
            mass: 0.0,
            inertia: 0.0,
            energy: None,
            stance,
            wheel_of: contacts.map(|(wheel, _)| wheel),
            wheel_inertia,
            wheel_radius: tyre.wheel_radius,
            rolling_resistance: tyre.rolling_resistance,
        }
    }

    /// Forces a wheel to a stand, as one that is blocked.
    pub(crate) fn stop(&mut self, wheel: usize) {
        if let Some(energy) = &mut self.energy {
            energy.held += self.wheel_inertia * square(self.wheel_speed[wheel]) / 2.0;
        }
        self.wheel_speed[wheel] = 0.0;
        self.acceleration[wheel] = 0.0;
        self.turned[wheel] = 0.0;
    }

    /// Returns whether body and wheels are slow enough to stand.
    pub(crate) fn is_slow(&self, body: &VehicleBody) -> bool {
        body.is_slow(self.wheel_speed.map(|speed| speed * self.wheel_radius))
    }

    /// Counts for how long the vehicle `could_stand`; brings it to a full stop when that has been
    /// long enough, and says so.
    pub(crate) fn stop_when_slow(
        &mut self,
        body: &mut VehicleBody,
        world: &mut World,
        seconds: f64,
        could_stand: bool,
    ) -> bool {
        let velocity = body.motion().body_velocity();
        let stands = body.stop_when_slow(world, seconds, could_stand);
        if stands {
            self.balance(velocity, |energy, of_body| energy.held += of_body);
            for wheel in 0..WHEELS {
                self.stop(wheel);
            }
        }
        stands
    }

    /// Forgets how it leaned and strained its tyres, as after lifting it off the ground.
    pub(crate) fn lift(&mut self) {
        self.traction.relax();
        self.stance.carried = None;
        for wheel in 0..WHEELS {
            self.stop(wheel);
        }
    }

    /// Returns what each wheel did on the ground at the end of the last step, front left, front
    /// right, rear left, rear right.
    #[must_use]
    pub fn on_ground(&self) -> [GroundForce; PATCHES] {
        self.traction.on_ground()
    }

    /// Computes the forces of one step and sets the body's velocity. Queries the drives of every part of
    /// the step, with the speeds of the wheels at its beginning, rad/s.
    pub(crate) fn step(
        &mut self,
        world: &mut World,
        body: &VehicleBody,
        changes: &Changes,
        mut drives: impl FnMut(Span, &[f64; WHEELS]) -> [WheelDrive; WHEELS],
    ) {
        (self.mass, self.inertia) = (body.mass(), body.inertia());
        (self.stance.centre, self.stance.centre_height) = body.centre();
        let push = body.push();
        let motion = world.motion(body.id());
        let ground = world.ground_at(motion.x, motion.y);
        let weight = self.mass * world.gravity();
        let pull = motion
            .to_body(ground.downhill())
            .map(|share| share * weight);
        let mut friction = world.friction_under(&motion, &self.stance.places());
        if let Some(most) = body.most_friction() {
            friction = friction.map(|friction| friction.min(most));
        }
        let outside = Outside {
            pull,
            push,
            pressing: weight * ground.cos_slope(),
            friction,
        };

        let step = world.step_length().as_secs_f64();
        // What it runs into is known for a step as a whole.
        let whole = world.is_touching(body.id());
        let part = if whole {
            step
        } else {
            self.part(changes, step)
        };
        let sudden: &[f64] = if whole { &[] } else { &changes.sudden };
        let mut course = Course::new(motion.body_velocity());
        self.turned = [0.0; WHEELS];
        self.motor_impulse = [0.0; WHEELS];
        self.tipping = false;
        let mut span = Span { from: 0.0, to: 0.0 };
        loop {
            span = next_part(span.to, part, step, sudden);
            let drives = drives(span, &self.wheel_speed);
            let velocity = self.advance(&mut course, &drives, &outside, span.seconds());
            if span.to >= step {
                self.balance(velocity, |energy, of_body| energy.outside -= of_body);
                break;
            }
            self.traction.update_deflections(velocity, self.wheel_speed);
        }
        world.lead(body.id(), &course);
    }

    /// Length of the parts in which a step is taken, s.
    fn part(&self, changes: &Changes, step: f64) -> f64 {
        let quick = self.acceleration.iter().any(|rate| rate.abs() > QUICK);
        let turns = C::DRIVEN > 1 || self.traction.is_strained_across(ACROSS);
        if self.traction.slides() || (quick || changes.gradual) && turns {
            step / (step / PART).ceil()
        } else {
            step
        }
    }

    /// Advances by a part of `dt` seconds; returns the velocity at its end, in its axes.
    fn advance(
        &mut self,
        course: &mut Course,
        drives: &[WheelDrive; WHEELS],
        outside: &Outside,
        dt: f64,
    ) -> Twist {
        let part = course.part(dt);
        let pull = part.look_at(outside.pull);
        let force = Wrench {
            ahead: pull[0] + outside.push.ahead,
            left: pull[1] + outside.push.left,
            ..outside.push
        };
        let on_tyres = if self.stance.carried.is_some() {
            self.traction.force()
        } else {
            // It has stood here before the run began.
            let (loads, _) = self.stance.loads(pull, outside.pressing);
            self.traction.strain(pull, loads);
            pull.map(|pull| -pull)
        };
        let (loads, lifts) = self.stance.carry(pull, on_tyres, outside.pressing, dt);
        self.tipping |= lifts;
        let mut wheels = self.wheels(drives, &loads);
        let before = course.coasting(part);
        let mut chassis = Chassis {
            mass: self.mass,
            inertia: self.inertia,
            velocity: before.pushed(force, dt, self.mass, self.inertia),
        };
        let rolling = self.wheel_speed;
        self.traction.solve(
            &mut chassis,
            &mut wheels,
            rolling,
            loads,
            outside.friction,
            dt,
        );
        self.wheel_speed = wheels.map(|wheel| wheel.speed);
        for (wheel, before) in rolling.into_iter().enumerate() {
            let after = self.wheel_speed[wheel];
            self.turned[wheel] += dt * (before + after) / 2.0;
            self.acceleration[wheel] = (after - before) / dt;
            let drive = &drives[wheel];
            self.motor_impulse[wheel] += drive.impulse - drive.opposed * after;
        }
        self.account(drives, [before, chassis.velocity], (force, dt), rolling);
        course.advance(part, chassis.velocity);
        chassis.velocity
    }

    /// Takes over the velocity that a step really ended with.
    pub(crate) fn take_velocity(&mut self, velocity: Twist) {
        self.balance(velocity, |energy, of_body| energy.outside += of_body);
        self.traction.update_deflections(velocity, self.wheel_speed);
    }

    /// Counts the energy of the body at a velocity, J, if the balance is kept.
    fn balance(&mut self, velocity: Twist, count: impl FnOnce(&mut Energy, f64)) {
        if let Some(energy) = &mut self.energy {
            let moving = self.mass * (square(velocity.ahead) + square(velocity.left));
            count(
                energy,
                (moving + self.inertia * square(velocity.turn)) / 2.0,
            );
        }
    }

    /// Counts the work of a part of a step, if the balance is kept: the body and the wheels had these
    /// velocities at its beginning, and the force on the body came from outside for that many seconds.
    fn account(
        &mut self,
        drives: &[WheelDrive; WHEELS],
        [before, after]: [Twist; 2],
        (force, seconds): (Wrench, f64),
        rolling: [f64; WHEELS],
    ) {
        let Some(energy) = &mut self.energy else {
            return;
        };
        let mean = before.mean(after);
        energy.outside += seconds * force.power(mean);
        let turning: [f64; WHEELS] =
            std::array::from_fn(|wheel| (rolling[wheel] + self.wheel_speed[wheel]) / 2.0);
        let held = self.traction.held();
        for (wheel, drive) in drives
            .iter()
            .enumerate()
            .filter(|(_, drive)| !drive.blocked)
        {
            let motor = drive.impulse - drive.opposed * self.wheel_speed[wheel];
            energy.motors += motor * turning[wheel];
            energy.held -= held[wheel] * turning[wheel];
        }
        energy.tyres += self.traction.lost(mean, turning);
    }

    /// The wheels over a step, without the ground.
    fn wheels(&self, drives: &[WheelDrive; WHEELS], loads: &[f64; PATCHES]) -> [Wheel; WHEELS] {
        let mut pressed = [0.0; WHEELS];
        for (wheel, load) in self.wheel_of.into_iter().zip(loads) {
            pressed[wheel] += load;
        }
        std::array::from_fn(|wheel| {
            let drive = &drives[wheel];
            let hold_torque = drive.gear
                + self.rolling_resistance * pressed[wheel] * self.wheel_radius
                + drive.brake
                + drive.drag;
            if drive.blocked {
                return Wheel {
                    speed: 0.0,
                    inertia: self.wheel_inertia,
                    compliance: 0.0,
                    hold_torque,
                };
            }
            let inertia = self.wheel_inertia + drive.opposed;
            let momentum = self.wheel_inertia * self.wheel_speed[wheel] + drive.impulse;
            Wheel {
                speed: momentum / inertia,
                inertia,
                compliance: 1.0 / inertia,
                hold_torque,
            }
        })
    }
}

/// The part that begins at `from` of a step that is taken in equal parts, s; a sudden change ends one.
fn next_part(from: f64, part: f64, step: f64, sudden: &[f64]) -> Span {
    let even = ((from / part + 1e-6).floor() + 1.0) * part;
    let even = if even < step - SHORTEST { even } else { step };
    let cut = sudden.iter().copied();
    let mut cut = cut.filter(|cut| *cut >= from + SHORTEST && *cut <= even - SHORTEST);
    let to = cut.next().unwrap_or(even);
    Span { from, to }
}

fn square(number: f64) -> f64 {
    number * number
}

#[cfg(test)]
mod tests;
