//! The coming to rest.

use super::MecanumPlant;
use super::motor::Order;
use super::signals::Wheel;
use crate::world::World;

impl MecanumPlant {
    /// Counts how long the car has been slow enough, and then brings it to a full stop.
    pub(super) fn settle(&mut self, world: &mut World, seconds: f64) {
        let radius = self.settings.wheel.radius;
        let tyre_speeds = self.drive.gear.wheel_speed.map(|speed| speed * radius);
        let could_stand = self.body.is_slow(tyre_speeds) && !self.is_driven();
        let velocity = self.body.motion().body_velocity();
        if self.body.settle(world, seconds, could_stand) {
            self.drive.gear.stand(velocity);
        }
    }

    /// Ahead, left, counter-clockwise; N and N·m.
    pub(super) fn total_push(&self) -> [f64; 3] {
        let push = self.body.push();
        std::array::from_fn(|part| push[part] + self.faults.body.push[part])
    }

    /// Tells whether something is trying to move the car.
    fn is_driven(&self) -> bool {
        let turns = |wheel| matches!(self.order(wheel), Order::Turn(speed) if speed != 0.0);
        self.total_push() != [0.0; 3] || Wheel::ALL.into_iter().any(turns)
    }
}
