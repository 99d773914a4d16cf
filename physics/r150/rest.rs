//! The passing of time, and the coming to rest.

use super::R150Plant;
use super::fuse::FuseId;
use super::signals::Side;
use crate::world::World;

impl R150Plant {
    /// Lets the slow states follow the present currents, which change whenever a fuse blows. Each
    /// round but the last blows one, so there are at most as many as there are fuses.
    pub(super) fn pass(&mut self, seconds: f64) {
        self.count_turns(seconds);
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
            self.body.wake();
        }
        if self.slow.advance(&self.flow, left) {
            self.solve_network();
            self.body.wake();
        }
    }

    /// Counts how long the vehicle has been slow enough, and then brings it to a full stop.
    pub(super) fn settle(&mut self, world: &mut World, seconds: f64) {
        let radius = self.settings.tyre.wheel_radius;
        let tyre_speeds = self.drive.gear.wheel_speed.map(|speed| speed * radius);
        let could_stand = self.body.is_slow(tyre_speeds) && !self.is_driven();
        let velocity = self.body.motion().body_velocity();
        if !self.body.settle(world, seconds, could_stand) {
            return;
        }
        self.drive.gear.stand(velocity);
        self.note_encoders();
        self.solve_network();
    }

    /// Tells whether something is trying to move the vehicle. A motor against a blocked wheel
    /// counts: its current must go on being integrated.
    fn is_driven(&self) -> bool {
        let motors = Side::BOTH.iter().any(|side| {
            let port = self.motor_port(*side);
            let driven = self.commands.propulsion_power && self.wanted_duty(*side) != 0.0;
            port.connected && (port.duty != 0.0 || driven)
        });
        motors || self.total_push() != [0.0; 3]
    }

    /// Ahead, left, counter-clockwise; N and N·m.
    pub(super) fn total_push(&self) -> [f64; 3] {
        let push = self.body.push();
        std::array::from_fn(|part| push[part] + self.faults.body.push[part])
    }
}
