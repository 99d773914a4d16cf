//! The plane that all vehicles share.

mod area;
mod bodies;
mod features;
mod file;
mod ground;
mod map;
mod obstacle;
mod obstacles;
mod scan;
mod strip;
mod terrain;

use std::time::Duration;

use rapier2d::prelude as rapier;

pub use area::{Band, Disc, Rectangle, Shape};
pub use bodies::{Course, Part};
pub use features::{Feature, FeatureKind};
pub use file::WorldFileError;
pub use ground::Ground;
pub use map::{FrictionPatch, Slope, Strip, WorldMap};
pub use obstacle::{EDGE_M, MOST_PARTS, Obstacle, ObstacleError, ObstacleShape, Obstacles};
pub use scan::{Cone, Tag};

use crate::pose::Pose;
use crate::tolerance::Tolerances;
use bodies::Lead;
use obstacles::Standing;
use terrain::Change;

/// Acceleration of gravity near sea level, m/s².
const GRAVITY: f64 = 9.81;
/// Coefficient of friction between a vehicle's body and what it hits; assumed: painted metal on a wall.
const WALL_FRICTION: f64 = 0.3;

rigsim_settings::settings! {
    /// The plane that all vehicles share.
    pub struct WorldSettings {
        /// Length of one physics step.
        step: Duration = Duration::from_millis(5),
            range Duration::from_micros(500)..=Duration::from_millis(10),
            assumed "short against the motors' response, 200 steps a second";
        /// Coefficient of friction between tyre and ground.
        friction: f64 = 0.8, range 0.0..=2.0,
            assumed "rubber on dry firm ground, 0.7 to 0.9 in textbooks";
        /// Slope of the ground.
        slope: f64 = 0.0, unit "deg", range -45.0..=45.0, assumed "flat unless chosen";
        /// Direction in which the ground rises, counter-clockwise from the x axis.
        uphill: f64 = 0.0, unit "deg", range -360.0..=360.0, assumed "uphill is straight ahead";
        /// Source of the differences between the vehicles of one make. Runs of `--repeat` after the
        /// first are by seed, unless this says otherwise.
        tolerances: Tolerances = Tolerances::FirstByName,
            assumed "a client has to work with every vehicle of the make, not with one";
    }
}

/// Distance from the edge of the plane to the wall around it: what is placed on the edge stands free.
const ENCLOSURE_M: f64 = 10.0;
/// Half of the thickness of that wall. No body is fast enough to pass it within a step.
const HALF_THICKNESS_M: f64 = 500.0;

/// The wall around the plane, which no sensor sees.
fn enclosure() -> [rapier::ColliderBuilder; 4] {
    let middle = EDGE_M + ENCLOSURE_M + HALF_THICKNESS_M;
    [[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]].map(|[x, y]: [f64; 2]| {
        let half = |across: f64| HALF_THICKNESS_M + across.abs() * middle;
        rapier::ColliderBuilder::cuboid(half(y), half(x))
            .translation(rapier_vector([x * middle, y * middle]))
    })
}

/// A body of this world.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct BodyId(usize);

/// Shape and material of a body, as far as collisions are concerned.
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

/// Reason for which the world could not go on.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum PhysicsError {
    /// A body's position or velocity is not a number.
    #[error("the physics of `{body}` broke down: its position or velocity is no longer finite")]
    NotFinite {
        /// The name that the body was added under.
        body: String,
    },
}

/// One rapier2d world without gravity, seen from above.
pub struct World {
    rapier: rapier::PhysicsWorld,
    step: Duration,
    ground: Ground,
    areas: Vec<(Shape, Change)>,
    /// Things that stand around.
    standing: Vec<Standing>,
    tags: Vec<Tag>,
    /// Pieces of magnetic strips.
    strips: Vec<Band>,
    bodies: Vec<Body>,
    /// Counts whatever sensors may notice.
    changes: u64,
    tolerances: Tolerances,
    seed: u64,
}

struct Body {
    name: String,
    handle: rapier::RigidBodyHandle,
    collider: rapier::ColliderHandle,
    /// Half its length and width, m.
    half: [f64; 2],
    /// Where its plant leads it in the step that comes.
    lead: Option<Lead>,
    touching: bool,
    collisions: u64,
}

impl World {
    /// An empty plane.
    #[must_use]
    pub fn new(settings: &WorldSettings) -> Self {
        let mut world = rapier::PhysicsWorld::new();
        world.gravity = rapier::Vector::ZERO;
        world.integration_parameters.dt = settings.step.as_secs_f64();
        for collider in enclosure() {
            world.insert_collider(collider.friction(WALL_FRICTION), None);
        }
        Self {
            rapier: world,
            step: settings.step,
            ground: Ground::new(
                settings.friction,
                settings.slope.to_radians(),
                settings.uphill.to_radians(),
            ),
            areas: Vec::new(),
            standing: Vec::new(),
            tags: Vec::new(),
            strips: Vec::new(),
            bodies: Vec::new(),
            changes: 0,
            tolerances: settings.tolerances,
            seed: 0,
        }
    }

    /// Sets the seed of the run, for the vehicles that come after it.
    pub fn set_seed(&mut self, seed: u64) {
        self.seed = seed;
    }

    /// The seed by which tolerances are drawn, beside names: 0 where names alone decide.
    pub(crate) fn tolerance_seed(&self) -> u64 {
        match self.tolerances {
            Tolerances::BySeed => self.seed,
            Tolerances::FirstByName | Tolerances::ByName => 0,
        }
    }

    /// Advances by one step of [`World::step_length`].
    ///
    /// # Errors
    /// Names a body that is no longer finite. The world is not to be used after that.
    pub fn step(&mut self) -> Result<(), PhysicsError> {
        self.rapier.step();
        self.end_leads();
        self.check_finite()?;
        self.record_contacts();
        Ok(())
    }

    /// The fixed step.
    #[must_use]
    pub fn step_length(&self) -> Duration {
        self.step
    }

    /// Acceleration of gravity, m/s².
    #[must_use]
    pub fn gravity(&self) -> f64 {
        GRAVITY
    }

    /// A number that changes whenever something moves, comes or goes, so that a sensor at rest
    /// knows whether it has to look again.
    #[must_use]
    pub fn changes(&self) -> u64 {
        self.changes
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

    fn record_contacts(&mut self) {
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

/// Least impulse of a contact that counts as touching, N·s: what is under it is rounding.
const TOUCH: f64 = 1e-9;
/// Shapes that lie deeper in one another than this touch whatever their impulse, m: they are eased
/// out of one another without one.
const DEEP: f64 = 0.002;

/// Returns whether two shapes really meet: rapier lists contacts a little before they do.
fn pair_touches(pair: &rapier::ContactPair) -> bool {
    pair.solver_manifolds()
        .iter()
        .flat_map(|manifold| &manifold.points)
        .any(|point| point.data.impulse > TOUCH || point.dist < -DEEP)
}

fn rapier_pose(pose: Pose) -> rapier::Pose {
    rapier::Pose::new(rapier_vector([pose.x, pose.y]), pose.heading)
}

fn rapier_vector([x, y]: [f64; 2]) -> rapier::Vector {
    rapier::Vector::new(x, y)
}

#[cfg(test)]
mod tests;
