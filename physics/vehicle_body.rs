//! Body of every vehicle: place, payload, pushes, standing still.

use crate::faults::{BodyFaults, Bounds};
use crate::pose::{BodyMotion, Pose};
use crate::twist::{Twist, Wrench};
use crate::world::{BodyId, BodyShape, World};

/// Speed of body and tyres under which it may stand, m/s.
const STANDING: f64 = 0.001;
/// Time for which it must stay under that speed, s: longer than half a swing on the tyres.
const SETTLE_TIME: f64 = 0.25;

/// What a vehicle weighs, and where.
#[derive(Debug, Clone, Copy)]
pub struct Build {
    /// Shape, with the mass and the inertia without payload.
    pub shape: BodyShape,
    /// Height of the centre of mass without payload, m.
    pub height: f64,
    /// Height of the centre of mass of a payload, which is spread over the vehicle, m.
    pub payload_height: f64,
    /// Place of a payload ahead and left of the middle, m.
    pub payload_place: [f64; 2],
    /// The most that may be done to it.
    pub bounds: Bounds,
}

/// The body of a vehicle, which stands still when it can.
#[derive(Debug, Clone)]
pub struct VehicleBody {
    id: BodyId,
    build: Build,
    motion: BodyMotion,
    /// m.
    distance: f64,
    faults: BodyFaults,
    /// For how long it has been slow enough to stand, s.
    settled: f64,
    resting: bool,
}

impl VehicleBody {
    /// Puts a body into the world, standing; `name` is what errors call it.
    pub fn new(world: &mut World, name: &str, build: Build, pose: Pose) -> Self {
        let id = world.add_body(name, build.shape, pose);
        Self {
            id,
            build,
            motion: world.motion(id),
            distance: 0.0,
            faults: BodyFaults::default(),
            settled: 0.0,
            resting: false,
        }
    }

    /// Mass with payload, kg.
    #[must_use]
    pub fn mass(&self) -> f64 {
        self.build.shape.mass + self.faults.payload
    }

    /// Moment of inertia about the vertical, with payload, kg·m².
    #[must_use]
    pub fn inertia(&self) -> f64 {
        let BodyShape {
            length,
            width,
            inertia,
            ..
        } = self.build.shape;
        inertia + self.faults.payload * (length * length + width * width) / 12.0
    }

    /// Centre of mass with payload: ahead and left of the middle, and its height, m.
    pub(crate) fn centre(&self) -> ([f64; 2], f64) {
        let (build, payload, mass) = (&self.build, self.faults.payload, self.mass());
        let moment = build.shape.mass * build.height + payload * build.payload_height;
        let place = build.payload_place.map(|place| payload * place / mass);
        (place, moment / mass)
    }

    /// Its place in the world.
    #[must_use]
    pub fn id(&self) -> BodyId {
        self.id
    }

    /// Pose and motion at the end of the last step.
    pub fn motion(&self) -> &BodyMotion {
        &self.motion
    }

    /// Distance that it has driven, from step to step, m.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Returns whether it stands.
    #[must_use]
    pub fn is_resting(&self) -> bool {
        self.resting
    }

    /// Force and torque that push it.
    pub fn push(&self) -> Wrench {
        self.faults.push
    }

    /// Returns what is wrong with it.
    pub fn faults(&self) -> &BodyFaults {
        &self.faults
    }

    /// Replaces what is wrong with it.
    pub fn set_faults(&mut self, world: &mut World, faults: &BodyFaults) {
        self.faults = faults.within(self.build.bounds);
        self.wake();
        world.set_mass(self.id, self.mass(), self.inertia());
    }

    /// Most friction that the ground gives it, if a fault bounds it.
    pub fn most_friction(&self) -> Option<f64> {
        self.faults.friction
    }

    /// Lifts it and sets it down elsewhere, standing. The plant stops the wheels.
    pub fn place(&mut self, world: &mut World, pose: Pose) {
        world.place(self.id, pose);
        self.motion = world.motion(self.id);
        self.wake();
    }

    /// Checks again whether it can stand.
    pub fn wake(&mut self) {
        self.resting = false;
        self.settled = 0.0;
    }

    /// Returns whether it goes on resting in the step that comes; woken if something has moved it.
    pub fn rests_before(&mut self, world: &World) -> bool {
        if self.resting && !world.is_still(self.id) {
            self.wake();
        }
        self.resting
    }

    /// Returns whether it goes on resting after a step; woken if something ran into it.
    pub fn rests_after(&mut self, world: &mut World) -> bool {
        if !self.resting {
            return false;
        }
        if world.rests_on(self.id, STANDING) {
            self.motion = world.motion(self.id);
        } else {
            self.wake();
        }
        self.resting
    }

    /// Takes over what a step did; returns its velocity.
    pub fn update_motion(&mut self, world: &World) -> Twist {
        let before = std::mem::replace(&mut self.motion, world.motion(self.id));
        let (x, y) = (self.motion.x - before.x, self.motion.y - before.y);
        self.distance += (x * x + y * y).sqrt();
        self.motion.body_velocity()
    }

    /// Returns whether body and tyres are slow enough to stand; the tyres' speeds in m/s.
    pub fn is_slow(&self, tyre_speeds: impl IntoIterator<Item = f64>) -> bool {
        let limit = STANDING;
        let velocity = self.motion.body_velocity();
        velocity.ahead.abs() <= limit
            && velocity.left.abs() <= limit
            && velocity.turn.abs() * self.build.shape.length / 2.0 <= limit
            && tyre_speeds.into_iter().all(|speed| speed.abs() <= limit)
    }

    /// Counts for how long it `could_stand`, being slow and driven by nothing; brings it to a full
    /// stop when that has been long enough, and says so.
    pub fn stop_when_slow(&mut self, world: &mut World, seconds: f64, could_stand: bool) -> bool {
        if !could_stand {
            self.settled = 0.0;
            return false;
        }
        self.settled += seconds;
        if self.settled < SETTLE_TIME {
            return false;
        }
        self.resting = true;
        world.set_velocity(self.id, [0.0; 2], 0.0);
        self.motion = world.motion(self.id);
        true
    }
}
