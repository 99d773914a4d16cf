//! The passing of time, and the coming to rest.

use super::R150Plant;
use super::fuse::FuseId;
use super::signals::Side;
use crate::world::World;

impl R150Plant {
    /// Lets the slow states follow the present currents, which change whenever a fuse blows. Each
    /// round but the last blows one, so there are at most as many as there are fuses.
    pub(super) fn pass(&mut self, seconds: f64) {
        let mut left = seconds;
        for _ in FuseId::ALL {
            let Some(due) = self
                .slow
                .time_to_blow(&self.flow)
                .filter(|due| *due <= left)
            else {
                break;
            };
            if !self.slow.advance(&self.flow, due) {
                self.slow.blow_next(&self.flow);
            }
            left -= due;
            self.solve_network();
            self.wake();
        }
        if self.slow.advance(&self.flow, left) {
            self.solve_network();
            self.wake();
        }
    }

    /// Counts how long the vehicle has been slow enough, and then brings it to a full stop.
    pub(super) fn settle(&mut self, world: &mut World, seconds: f64) {
        let limit = self.settings.rest.speed;
        let half_length = self.settings.body.length / 2.0;
        let [ahead, left, yaw_rate] = self.motion.body_velocity();
        let radius = self.settings.tyre.wheel_radius;
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
        self.drive.wheel_speed = [0.0; 2];
        self.note_encoders();
        self.solve_network();
    }

    /// Whether something is trying to move the vehicle. A motor against a blocked wheel counts: its
    /// current must go on being integrated.
    fn is_driven(&self) -> bool {
        let motors = Side::BOTH.iter().any(|side| {
            let port = self.motor_port(*side);
            port.connected && port.duty != 0.0
        });
        motors || self.total_push() != [0.0; 3]
    }

    /// Ahead, left, counter-clockwise; N and N·m.
    pub(super) fn total_push(&self) -> [f64; 3] {
        std::array::from_fn(|part| self.push[part] + self.faults.push[part])
    }
}
