//! The bodies of the world: what plants ask of them and do to them.

use rapier2d::prelude as rapier;

use super::{Body, BodyId, BodyShape, World, rapier_pose, rapier_vector};
use crate::pose::{BodyMotion, Pose};
use crate::twist::Twist;

/// Course of a body through a step, part by part. Vectors are in the axes that it has at the
/// beginning, so that momentum stays what it is as it turns.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Course {
    velocity: Twist,
    /// m
    way: [f64; 2],
    /// By which it has turned, rad, and the cosine and the sine of that.
    turn: f64,
    axes: [f64; 2],
}

impl Course {
    /// Of a body that has this velocity.
    #[must_use]
    pub fn new(velocity: Twist) -> Self {
        Self {
            velocity,
            way: [0.0; 2],
            turn: 0.0,
            axes: [1.0, 0.0],
        }
    }

    /// The part of so many seconds that comes, looked at in the axes that the body then has if it
    /// turns on as it does.
    #[must_use]
    pub fn part(&self, seconds: f64) -> Part {
        let axes = turned(self.axes, rotation(self.velocity.turn * seconds));
        Part { axes, seconds }
    }

    /// Returns the velocity in the axes of a part.
    #[must_use]
    pub fn coasting(&self, part: Part) -> Twist {
        let [ahead, left] = part.look_at([self.velocity.ahead, self.velocity.left]);
        Twist {
            ahead,
            left,
            ..self.velocity
        }
    }

    /// Advances by a part, evenly, to the velocity that it has in the axes of the part.
    pub fn advance(&mut self, part: Part, velocity: Twist) {
        let half = part.seconds / 2.0;
        let turn = half * (self.velocity.turn + velocity.turn);
        self.turn += turn;
        self.axes = turned(self.axes, rotation(turn));
        let [ahead, left] = turned([velocity.ahead, velocity.left], part.axes);
        self.way[0] += half * (self.velocity.ahead + ahead);
        self.way[1] += half * (self.velocity.left + left);
        self.velocity = Twist {
            ahead,
            left,
            ..velocity
        };
    }
}

/// Part of a step.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Part {
    /// Cosine and sine of the turn since the beginning of the step.
    axes: [f64; 2],
    seconds: f64,
}

impl Part {
    /// A vector in the axes of the step's beginning as seen in this part's.
    #[must_use]
    pub fn look_at(&self, vector: [f64; 2]) -> [f64; 2] {
        let [cos, sin] = self.axes;
        turned(vector, [cos, -sin])
    }
}

/// Cosine and sine of an angle that is meant to be small, within its cube by 12; of a rotation in
/// any case.
fn rotation(angle: f64) -> [f64; 2] {
    let half = angle / 2.0;
    let scale = 1.0 / (1.0 + half * half);
    [(1.0 - half * half) * scale, 2.0 * half * scale]
}

fn turned([x, y]: [f64; 2], [cos, sin]: [f64; 2]) -> [f64; 2] {
    [cos * x - sin * y, sin * x + cos * y]
}

/// Velocities of a body in a step: along the world's axes, and yaw rate.
pub(super) struct Lead {
    /// In the mean, which is what rapier moves it by.
    mean: (rapier::Vector, f64),
    /// At the end.
    end: (rapier::Vector, f64),
}

/// Most change of velocity in a step that is rounding and no contact, m/s and rad/s.
const UNTOUCHED: f64 = 1e-9;
/// Multiple of the speed of rest at which a resting body may be eased out of a contact.
/// Where one side of a contact rests first, the strain of the other pushes it for a step or two.
const EASING: f64 = 5.0;

impl World {
    /// Adds a movable box at rest; `name` is what errors call it.
    pub fn add_body(&mut self, name: &str, shape: BodyShape, pose: Pose) -> BodyId {
        let body = rapier::RigidBodyBuilder::dynamic()
            .pose(rapier_pose(pose))
            .additional_mass_properties(mass_properties(shape.mass, shape.inertia))
            // Resting is decided by the plant, which knows about brakes and slopes.
            .can_sleep(false)
            .build();
        let collider = rapier::ColliderBuilder::cuboid(shape.length / 2.0, shape.width / 2.0)
            .density(0.0)
            .friction(super::WALL_FRICTION)
            .build();
        let handle = self.rapier.insert_body(body);
        let collider = self.rapier.insert_collider(collider, Some(handle));
        self.bodies.push(Body {
            name: name.to_owned(),
            handle,
            collider,
            half: [shape.length / 2.0, shape.width / 2.0],
            lead: None,
            touching: false,
            collisions: 0,
        });
        self.changes += 1;
        BodyId(self.bodies.len() - 1)
    }

    /// Returns the pose and motion of a body.
    #[must_use]
    pub fn motion(&self, id: BodyId) -> BodyMotion {
        let body = self.rigid_body(id);
        let position = body.position();
        let velocity = body.linvel();
        BodyMotion {
            x: position.translation.x,
            y: position.translation.y,
            cos: position.rotation.re,
            sin: position.rotation.im,
            vx: velocity.x,
            vy: velocity.y,
            yaw_rate: body.angvel(),
        }
    }

    /// Returns whether nothing of a body moves; cheaper than [`World::motion`].
    #[must_use]
    pub fn is_still(&self, id: BodyId) -> bool {
        !self.rigid_body(id).is_moving()
    }

    /// Returns whether a body that rested still does, looked at after a step; `speed` is that under
    /// which a body may rest, m/s.
    ///
    /// One that is only eased out of what it touches, or pushed by what strain is left in another's
    /// wheels, is stopped again and goes on resting; otherwise vehicles that lean on a wall or on
    /// one another would keep waking for ever.
    pub fn rests_on(&mut self, id: BodyId, speed: f64) -> bool {
        if self.is_still(id) {
            return true;
        }
        let motion = self.motion(id);
        let [half_length, half_width] = self.bodies[id.0].half;
        let spin = motion.yaw_rate.abs() * (half_length + half_width);
        let eased = motion.vx.abs() + motion.vy.abs() + spin <= EASING * speed;
        if eased {
            self.set_velocity(id, [0.0; 2], 0.0);
        }
        eased
    }

    /// Leads a body through the step that comes, on this course unless it runs into something.
    ///
    /// A plant hands its tyre forces over as the velocity that they lead to, which is what its
    /// implicit solution finds. A body that touches something moves by that velocity from the
    /// beginning, or the contact would leave half of what pushes it.
    pub fn lead(&mut self, id: BodyId, course: &Course) {
        let motion = self.motion(id);
        let end = motion.to_world([course.velocity.ahead, course.velocity.left]);
        if self.is_touching(id) {
            self.set_velocity(id, end, course.velocity.turn);
            return;
        }
        let seconds = self.step.as_secs_f64();
        let mean = motion.to_world(course.way.map(|way| way / seconds));
        let mean_yaw_rate = course.turn / seconds;
        self.set_velocity(id, mean, mean_yaw_rate);
        self.bodies[id.0].lead = Some(Lead {
            mean: (rapier_vector(mean), mean_yaw_rate),
            end: (rapier_vector(end), course.velocity.turn),
        });
    }

    /// Sets the bodies that were led to their velocities at the end of the step. One that ran into
    /// something keeps the velocity that it has after that.
    pub(super) fn end_leads(&mut self) {
        for body in &mut self.bodies {
            let Some(Lead { mean, end }) = body.lead.take() else {
                continue;
            };
            let rigid = &mut self.rapier.bodies[body.handle];
            let pushed = (rigid.linvel() - mean.0).length() + (rigid.angvel() - mean.1).abs();
            if pushed <= UNTOUCHED {
                rigid.set_linvel(end.0, true);
                rigid.set_angvel(end.1, true);
            }
        }
    }

    /// Sets the velocity of a body: along the world's axes, and yaw rate.
    pub fn set_velocity(&mut self, id: BodyId, velocity: [f64; 2], yaw_rate: f64) {
        self.changes += 1;
        self.bodies[id.0].lead = None;
        let handle = self.bodies[id.0].handle;
        let body = &mut self.rapier.bodies[handle];
        body.set_linvel(rapier_vector(velocity), true);
        body.set_angvel(yaw_rate, true);
    }

    /// Puts a body somewhere else, at rest.
    pub fn place(&mut self, id: BodyId, pose: Pose) {
        self.changes += 1;
        self.bodies[id.0].lead = None;
        let handle = self.bodies[id.0].handle;
        let body = &mut self.rapier.bodies[handle];
        body.set_position(rapier_pose(pose), true);
        body.set_linvel(rapier::Vector::ZERO, true);
        body.set_angvel(0.0, true);
    }

    /// Changes what a body weighs: kg and kg·m².
    pub fn set_mass(&mut self, id: BodyId, mass: f64, inertia: f64) {
        let handle = self.bodies[id.0].handle;
        self.rapier.bodies[handle]
            .set_additional_mass_properties(mass_properties(mass, inertia), true);
    }

    /// Returns whether a body touched anything at the end of the last step.
    #[must_use]
    pub fn is_touching(&self, id: BodyId) -> bool {
        self.bodies[id.0].touching
    }

    /// Number of times that a body came to touch something after touching nothing.
    #[must_use]
    pub fn collisions(&self, id: BodyId) -> u64 {
        self.bodies[id.0].collisions
    }

    fn rigid_body(&self, id: BodyId) -> &rapier::RigidBody {
        &self.rapier.bodies[self.bodies[id.0].handle]
    }
}

fn mass_properties(mass: f64, inertia: f64) -> rapier::MassProperties {
    rapier::MassProperties::new(rapier::Vector::ZERO, mass, inertia)
}
