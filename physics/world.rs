//! The plane that all vehicles share.

mod area;
mod file;
mod ground;
mod map;
mod scan;
mod settings;
mod strip;

use std::time::Duration;

use rapier2d::prelude as rapier;

pub use area::{Band, Disc, Rectangle};
pub use file::WorldFileError;
pub use ground::Ground;
pub use map::{Area, FrictionPatch, Slope, Strip, Wall, WorldMap};
pub use scan::{Cone, Tag};
pub use settings::WorldSettings;

use crate::pose::{BodyMotion, Pose};
use map::Change;
use scan::Solid;

/// A body of this world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BodyId(usize);

/// What a body is made of, as far as collisions are concerned.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct BodyShape {
    /// Extent along the body's forward axis, m.
    pub length: f64,
    /// Extent across, m.
    pub width: f64,
    /// Mass, kg.
    pub mass: f64,
    /// Moment of inertia about the vertical through the centre, kg·m².
    pub inertia: f64,
}

/// Why the world could not go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum PhysicsError {
    /// A body's position or velocity is not a number.
    #[error("the physics of `{body}` broke down: its position or velocity is no longer finite")]
    NotFinite {
        /// The name that the body was added under.
        body: String,
    },
}

/// Multiple of the speed of rest at which a resting body may be eased out of a contact.
/// Where one side of a contact rests first, the strain of the other pushes it for a step or two.
const EASING: f64 = 5.0;

/// One rapier2d world without gravity, seen from above.
pub struct World {
    rapier: rapier::PhysicsWorld,
    step: Duration,
    gravity: f64,
    ground: Ground,
    areas: Vec<(Area, Change)>,
    /// What stands around, as sensors see it.
    solids: Vec<Solid>,
    tags: Vec<Tag>,
    /// Pieces of magnetic strips.
    strips: Vec<Band>,
    wall_friction: f64,
    bodies: Vec<Body>,
    steps: u64,
    /// Counts whatever sensors may notice.
    changes: u64,
}

struct Body {
    name: String,
    handle: rapier::RigidBodyHandle,
    collider: rapier::ColliderHandle,
    /// Half its length and width, m.
    half: [f64; 2],
    touching: bool,
    collisions: u64,
}

impl World {
    /// An empty plane.
    #[must_use]
    pub fn new(settings: &WorldSettings) -> Self {
        let mut world = rapier::PhysicsWorld::new();
        world.gravity = rapier::Vector::ZERO;
        world.integration_parameters.dt = narrow(settings.step.as_secs_f64());
        Self {
            rapier: world,
            step: settings.step,
            gravity: settings.gravity,
            ground: Ground::new(
                settings.friction,
                settings.slope.to_radians(),
                settings.uphill.to_radians(),
            ),
            areas: Vec::new(),
            solids: Vec::new(),
            tags: Vec::new(),
            strips: Vec::new(),
            wall_friction: settings.wall_friction,
            bodies: Vec::new(),
            steps: 0,
            changes: 0,
        }
    }

    /// Adds a movable box at rest; `name` is what errors call it.
    pub fn add_body(&mut self, name: &str, shape: BodyShape, pose: Pose) -> BodyId {
        let body = rapier::RigidBodyBuilder::dynamic()
            .pose(rapier_pose(pose))
            .additional_mass_properties(mass_properties(shape.mass, shape.inertia))
            // Resting is decided by the plant, which knows about brakes and slopes.
            .can_sleep(false)
            .build();
        let collider =
            rapier::ColliderBuilder::cuboid(narrow(shape.length / 2.0), narrow(shape.width / 2.0))
                .density(0.0)
                .friction(narrow(self.wall_friction))
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

    /// Adds an immovable box, `length` along its heading and `width` across, m.
    pub fn add_box(&mut self, pose: Pose, length: f64, width: f64) {
        self.add_fixed(
            rapier::ColliderBuilder::cuboid(narrow(length / 2.0), narrow(width / 2.0))
                .position(rapier_pose(pose)),
            Solid::Rectangle(Rectangle::new(
                [pose.x, pose.y],
                pose.heading,
                length,
                width,
            )),
        );
    }

    /// Adds an immovable disc of `radius` metres.
    pub fn add_disc(&mut self, x: f64, y: f64, radius: f64) {
        self.add_fixed(
            rapier::ColliderBuilder::ball(narrow(radius)).translation(rapier_vector([x, y])),
            Solid::Disc(Disc {
                centre: [x, y],
                radius,
            }),
        );
    }

    /// Adds a wall of `thickness` metres whose middle line runs between two points.
    ///
    /// A wall has a thickness because a fast body cannot slip through one; rapier's line segment
    /// has none.
    pub fn add_wall(&mut self, from: [f64; 2], to: [f64; 2], thickness: f64) {
        let radius = thickness / 2.0;
        self.add_fixed(
            rapier::ColliderBuilder::capsule_from_endpoints(
                rapier_vector(from),
                rapier_vector(to),
                narrow(radius),
            ),
            Solid::Band(Band {
                ends: [from, to],
                radius,
            }),
        );
    }

    /// Advances by one step of [`World::step_length`].
    ///
    /// # Errors
    /// Names a body that is no longer finite. The world is not to be used after that.
    pub fn step(&mut self) -> Result<(), PhysicsError> {
        self.rapier.step();
        self.steps += 1;
        self.check_finite()?;
        self.note_contacts();
        Ok(())
    }

    /// The fixed step.
    #[must_use]
    pub fn step_length(&self) -> Duration {
        self.step
    }

    /// Steps taken so far.
    #[must_use]
    pub fn steps(&self) -> u64 {
        self.steps
    }

    /// Acceleration of gravity, m/s².
    #[must_use]
    pub fn gravity(&self) -> f64 {
        self.gravity
    }

    /// The ground at a point.
    #[must_use]
    pub fn ground_at(&self, x: f64, y: f64) -> Ground {
        let mut ground = self.ground;
        for (area, change) in &self.areas {
            if area.contains([x, y]) {
                ground = match change {
                    Change::Slope(of) => ground.with_slope_of(of),
                    Change::Friction(of) => ground.with_friction_of(of),
                };
            }
        }
        ground
    }

    /// The friction under places of a body, ahead and left of its middle, m. Every wheel stands on
    /// its own ground, while the body as a whole is pulled down the slope under its middle.
    #[must_use]
    pub fn friction_under<const N: usize>(
        &self,
        motion: &BodyMotion,
        places: &[[f64; 2]; N],
    ) -> [f64; N] {
        if self.areas.is_empty() {
            return [self.ground.friction(); N];
        }
        places.map(|place| {
            let [x, y] = motion.to_world(place);
            self.ground_at(motion.x + x, motion.y + y).friction()
        })
    }

    /// Replaces the ground outside of the areas that have one of their own. Plants that rest must be
    /// woken by their owner.
    pub fn set_ground(&mut self, ground: Ground) {
        self.ground = ground;
    }

    /// A number that changes whenever something moves, comes or goes, so that a sensor at rest
    /// knows whether it has to look again.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
    }

    /// Where a body is and how it moves.
    #[must_use]
    pub fn motion(&self, id: BodyId) -> BodyMotion {
        let body = self.rigid_body(id);
        let position = body.position();
        let velocity = body.linvel();
        BodyMotion {
            x: f64::from(position.translation.x),
            y: f64::from(position.translation.y),
            cos: f64::from(position.rotation.re),
            sin: f64::from(position.rotation.im),
            vx: f64::from(velocity.x),
            vy: f64::from(velocity.y),
            yaw_rate: f64::from(body.angvel()),
        }
    }

    /// Whether nothing of a body moves; cheaper than [`World::motion`].
    #[must_use]
    pub fn is_still(&self, id: BodyId) -> bool {
        !self.rigid_body(id).is_moving()
    }

    /// Whether a body that rested still does, looked at after a step; `speed` is that under which a
    /// body may rest, m/s.
    ///
    /// One that is only eased out of what it touches, or pushed by what strain is left in another's
    /// wheels, is stopped again and goes on resting; otherwise vehicles that lean on a wall or on one
    /// another would keep waking for ever.
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
    /// A plant hands its tyre forces over as the velocity that they lead to, since an impulse would
    /// be rounded twice on its way through rapier's `f32`.
    pub fn set_velocity(&mut self, id: BodyId, velocity: [f64; 2], yaw_rate: f64) {
        self.changes += 1;
        let handle = self.bodies[id.0].handle;
        let body = &mut self.rapier.bodies[handle];
        body.set_linvel(rapier_vector(velocity), true);
        body.set_angvel(narrow(yaw_rate), true);
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

    /// Whether a body touched anything at the end of the last step.
    #[must_use]
    pub fn is_touching(&self, id: BodyId) -> bool {
        self.bodies[id.0].touching
    }

    /// How often a body came to touch something after touching nothing.
    #[must_use]
    pub fn collisions(&self, id: BodyId) -> u64 {
        self.bodies[id.0].collisions
    }

    /// The name that a body was added under.
    #[must_use]
    pub fn name(&self, id: BodyId) -> &str {
        &self.bodies[id.0].name
    }

    fn rigid_body(&self, id: BodyId) -> &rapier::RigidBody {
        &self.rapier.bodies[self.bodies[id.0].handle]
    }

    fn add_fixed(&mut self, collider: rapier::ColliderBuilder, solid: Solid) {
        self.solids.push(solid);
        self.changes += 1;
        let collider = collider.friction(narrow(self.wall_friction)).build();
        self.rapier.insert_collider(collider, None);
    }

    /// rapier disables a body that is not finite and goes on with the others; for us that would be
    /// a vehicle standing still for no visible reason.
    fn check_finite(&self) -> Result<(), PhysicsError> {
        if self.rapier.quarantine().is_empty() {
            return Ok(());
        }
        let quarantine = self.rapier.quarantine();
        let broken = self.bodies.iter().find(|body| {
            quarantine.bodies().contains(&body.handle)
                || quarantine.colliders().contains(&body.collider)
        });
        Err(PhysicsError::NotFinite {
            body: broken.map_or_else(|| "an obstacle".to_owned(), |body| body.name.clone()),
        })
    }

    fn note_contacts(&mut self) {
        let narrow_phase = &self.rapier.narrow_phase;
        let anything_near = narrow_phase.contact_pairs().next().is_some();
        for body in &mut self.bodies {
            let touching = anything_near
                && narrow_phase
                    .contact_pairs_with(body.collider)
                    .any(pair_touches);
            if touching && !body.touching {
                body.collisions += 1;
            }
            body.touching = touching;
        }
    }
}

/// Whether two shapes really meet: rapier lists contacts a little before they do.
fn pair_touches(pair: &rapier::ContactPair) -> bool {
    pair.solver_manifolds()
        .iter()
        .flat_map(|manifold| &manifold.points)
        .any(|point| point.data.impulse > 0.0)
}

fn mass_properties(mass: f64, inertia: f64) -> rapier::MassProperties {
    rapier::MassProperties::new(rapier::Vector::ZERO, narrow(mass), narrow(inertia))
}

fn rapier_pose(pose: Pose) -> rapier::Pose {
    rapier::Pose::new(rapier_vector([pose.x, pose.y]), narrow(pose.heading))
}

fn rapier_vector([x, y]: [f64; 2]) -> rapier::Vector {
    rapier::Vector::new(narrow(x), narrow(y))
}

#[expect(
    clippy::cast_possible_truncation,
    reason = "rapier computes in f32; rounding to it is meant"
)]
fn narrow(value: f64) -> f32 {
    value as f32
}

#[cfg(test)]
mod tests;
