//! The bodies of the world: what plants ask of them and do to them.

use rapier2d::prelude as rapier;

use super::{Body, BodyId, BodyShape, World, rapier_pose, rapier_vector};
use crate::pose::{BodyMotion, Pose};

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
            .friction(self.wall_friction)
            .build();
        let handle = self.rapier.insert_body(body);
        let collider = self.rapier.insert_collider(collider, Some(handle));
        self.bodies.push(Body {
            name: name.to_owned(),
            handle,
            collider,
            half: [shape.length / 2.0, shape.width / 2.0],
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

    /// Tells whether nothing of a body moves; cheaper than [`World::motion`].
    #[must_use]
    pub fn is_still(&self, id: BodyId) -> bool {
        !self.rigid_body(id).is_moving()
    }

    /// Tells whether a body that rested still does, looked at after a step; `speed` is that under
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

    /// Gives a body a velocity: along the world's axes, and yaw rate.
    ///
    /// A plant hands its tyre forces over as the velocity that they lead to, which is what its
    /// implicit solution finds.
    pub fn set_velocity(&mut self, id: BodyId, velocity: [f64; 2], yaw_rate: f64) {
        self.changes += 1;
        let handle = self.bodies[id.0].handle;
        let body = &mut self.rapier.bodies[handle];
        body.set_linvel(rapier_vector(velocity), true);
        body.set_angvel(yaw_rate, true);
    }

    /// Puts a body somewhere else, at rest.
    pub fn place(&mut self, id: BodyId, pose: Pose) {
        self.changes += 1;
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

    /// Tells whether a body touched anything at the end of the last step.
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
