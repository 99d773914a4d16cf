//! The body of the robot: two driven wheels side by side.
//!
//! Its motors hold the commanded speeds as far as the friction under the wheels allows. Motors and
//! tyres are not modelled any further: use [`rigsim_physics::traction`] where they matter.

use rigsim_physics::world::Course;
use rigsim_physics::{BodyShape, Bounds, Build, Plant, Pose, Twist, VehicleBody, World};

const BOUNDS: Bounds = Bounds {
    payload: 20.0,
    push: 1e3,
};

/// Size and mass of a robot.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct DifferentialShape {
    /// m.
    pub length: f64,
    /// m.
    pub width: f64,
    /// Between the wheels, m.
    pub track: f64,
    /// Without payload, kg.
    pub mass: f64,
}

impl Default for DifferentialShape {
    /// As large as a sheet of paper.
    fn default() -> Self {
        Self {
            length: 0.25,
            width: 0.2,
            track: 0.16,
            mass: 1.5,
        }
    }
}

/// One robot.
#[derive(Debug, Clone)]
pub struct Differential {
    body: VehicleBody,
    shape: DifferentialShape,
    /// Wanted and true speed of the wheels over the ground, left and right, m/s.
    wanted: [f64; 2],
    speed: [f64; 2],
    /// Distance that each has rolled, m.
    travel: [f64; 2],
}

impl Differential {
    /// A robot that stands at `pose`.
    #[must_use]
    pub fn new(name: &str, shape: DifferentialShape, world: &mut World, pose: Pose) -> Self {
        let build = Build {
            shape: BodyShape {
                length: shape.length,
                width: shape.width,
                mass: shape.mass,
                inertia: inertia(shape),
            },
            height: 0.0,
            payload_height: 0.0,
            payload_place: [0.0; 2],
            bounds: BOUNDS,
        };
        Self {
            body: VehicleBody::new(world, name, build, pose),
            shape,
            wanted: [0.0; 2],
            speed: [0.0; 2],
            travel: [0.0; 2],
        }
    }

    /// Sets the speeds of the left and right wheel over the ground, m/s.
    pub fn set_speeds(&mut self, wanted: [f64; 2]) {
        if self.wanted != wanted {
            self.wanted = wanted;
            self.body.wake();
        }
    }

    /// Distance that each wheel has rolled, left and right, m.
    #[must_use]
    pub fn travel(&self) -> [f64; 2] {
        self.travel
    }
}

impl Plant for Differential {
    fn vehicle(&self) -> &VehicleBody {
        &self.body
    }

    fn vehicle_mut(&mut self) -> &mut VehicleBody {
        &mut self.body
    }

    fn place(&mut self, world: &mut World, pose: Pose) {
        self.speed = [0.0; 2];
        self.body.place(world, pose);
    }

    fn before_step(&mut self, world: &mut World) {
        if self.body.rests_before(world) {
            return;
        }
        let dt = world.step_length().as_secs_f64();
        let motion = world.motion(self.body.id());
        let ground = world.ground_at(motion.x, motion.y);
        let (mass, inertia) = (self.body.mass(), self.body.inertia());
        let weight = mass * world.gravity();
        let push = self.body.push();
        let mut course = Course::new(motion.body_velocity());
        let part = course.part(dt);
        let pull = part.look_at(motion.to_body(ground.downhill()));
        let Twist { ahead, left, turn } = course.coasting(part);
        let free = [
            ahead + dt * (pull[0] * weight + push.ahead) / mass,
            left + dt * (pull[1] * weight + push.left) / mass,
            turn + dt * push.turn / inertia,
        ];
        let [left_wheel, right_wheel] = self.wanted;
        let half = self.shape.track / 2.0;
        let held = [
            (left_wheel + right_wheel) / 2.0,
            0.0,
            (right_wheel - left_wheel) / self.shape.track,
        ];
        // The most that friction changes in a step: of both speeds, and of the yaw rate.
        let most = self.body.most_friction().unwrap_or(f64::INFINITY);
        let grip = dt * ground.friction().min(most) * world.gravity() * ground.cos_slope();
        let limits = [grip, grip, grip * mass * half / inertia];
        let [ahead, left, turn] = std::array::from_fn(|axis| {
            let change = held[axis] - free[axis];
            free[axis] + change.clamp(-limits[axis], limits[axis])
        });
        for (wheel, travel) in self.travel.iter_mut().enumerate() {
            *travel += dt * (self.speed[wheel] + self.wanted[wheel]) / 2.0;
        }
        self.speed = self.wanted;
        course.advance(part, Twist { ahead, left, turn });
        world.lead(self.body.id(), &course);
    }

    fn after_step(&mut self, world: &mut World) {
        if self.body.rests_after(world) {
            return;
        }
        let seconds = world.step_length().as_secs_f64();
        self.body.update_motion(world);
        let slow = self.body.is_slow(self.wanted);
        self.body.stop_when_slow(world, seconds, slow);
    }
}

/// As of a plate of its size.
fn inertia(shape: DifferentialShape) -> f64 {
    shape.mass * (shape.length * shape.length + shape.width * shape.width) / 12.0
}
