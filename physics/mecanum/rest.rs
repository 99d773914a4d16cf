//! The coming to rest.

use super::MecanumPlant;
use super::motor::Order;
use super::signals::Wheel;
use crate::world::World;

impl MecanumPlant {
    /// Counts how long the car has been slow enough, and then brings it to a full stop.
    pub(super) fn settle(&mut self, world: &mut World, seconds: f64) {
        let limit = self.settings.rest.speed;
        let half_length = self.settings.body.length / 2.0;
        let [ahead, left, yaw_rate] = self.motion.body_velocity();
        let radius = self.settings.wheel.radius;
        let slow = ahead.abs() <= limit
            && left.abs() <= limit
            && yaw_rate.abs() * half_length <= limit
            && self
                .drive
                .wheel_speed
                .iter()
                .all(|speed| speed.abs() * radius <= limit);
        if !slow || self.is_driven() {
            self.settled = 0.0;
            return;
        }
        self.settled += seconds;
        if self.settled < self.settings.rest.settle_time.as_secs_f64() {
            return;
        }
        self.resting = true;
        world.set_velocity(self.body, [0.0; 2], 0.0);
        self.motion = world.motion(self.body);
        for wheel in Wheel::ALL {
            self.drive.stop(wheel);
        }
    }

    /// Ahead, left, counter-clockwise; N and N·m.
    pub(super) fn total_push(&self) -> [f64; 3] {
        std::array::from_fn(|part| self.push[part] + self.faults.push[part])
    }

    /// Whether something is trying to move the car.
    fn is_driven(&self) -> bool {
        let turns = |wheel| matches!(self.order(wheel), Order::Turn(speed) if speed != 0.0);
        self.total_push() != [0.0; 3] || Wheel::ALL.into_iter().any(turns)
    }
}
