//! The hardware of a vehicle, as the world and the rig see it.

use std::time::Duration;

use crate::drawing::Drawing;
use crate::faults::BodyFaults;
use crate::pose::Pose;
use crate::vehicle_body::VehicleBody;
use crate::world::{BodyId, World};

/// True pose and motion of a vehicle.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Motion {
    /// Place and heading.
    pub pose: Pose,
    /// m/s, negative backward.
    pub forward_speed: f64,
    /// m/s.
    pub leftward_speed: f64,
    /// rad/s, counter-clockwise.
    pub yaw_rate: f64,
    /// Length of the path driven so far, m.
    pub distance: f64,
    /// With payload, kg.
    pub mass: f64,
}

/// Hardware of a vehicle.
pub trait Plant {
    /// Returns its body.
    fn vehicle(&self) -> &VehicleBody;

    /// The same, to change.
    fn vehicle_mut(&mut self) -> &mut VehicleBody;

    /// Draws it from above, beside its body; of one that does not say, the body is all.
    fn drawing(&self) -> Drawing {
        Drawing::default()
    }

    /// Applies the forces of one step. Call before every [`World::step`].
    fn before_step(&mut self, world: &mut World);

    /// Takes over what the step did. Call after every [`World::step`].
    fn after_step(&mut self, world: &mut World);

    /// Advances time while it [rests](Self::at_rest) and the world is not stepped. Of no concern to
    /// hardware without slow states.
    fn rest(&mut self, _span: Duration) {}

    /// Lifts it and sets it down elsewhere, standing.
    fn place(&mut self, world: &mut World, pose: Pose);

    /// Returns its body in the world, for contact queries.
    fn body(&self) -> BodyId {
        self.vehicle().id()
    }

    /// Returns its true pose and motion at the end of the last step.
    fn motion(&self) -> Motion {
        let motion = self.vehicle().motion();
        let velocity = motion.body_velocity();
        Motion {
            pose: motion.pose(),
            forward_speed: velocity.ahead,
            leftward_speed: velocity.left,
            yaw_rate: velocity.turn,
            distance: self.vehicle().distance(),
            mass: self.vehicle().mass(),
        }
    }

    /// Returns whether nothing moves and nothing drives, so that [`rest`](Self::rest) may stand in
    /// for steps of the world.
    fn at_rest(&self) -> bool {
        self.vehicle().is_resting()
    }

    /// Returns whether a wheel would lift off the ground, and the vehicle begin to tip over.
    fn is_tipping(&self) -> bool {
        false
    }

    /// Checks again whether it can stand, after a change around it such as another ground.
    fn wake(&mut self) {
        self.vehicle_mut().wake();
    }

    /// Replaces all that is wrong with it as a body.
    fn set_body_faults(&mut self, world: &mut World, faults: &BodyFaults) {
        self.vehicle_mut().set_faults(world, faults);
    }
}
