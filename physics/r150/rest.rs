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
        let could_stand = self.drive.gear.is_slow(&self.body) && !self.is_driven();
        let (gear, body) = (&mut self.drive.gear, &mut self.body);
        if gear.settle(body, world, seconds, could_stand) {
            self.note_encoders();
            self.solve_network();
        }
    }

    /// Tells whether something is trying to move the vehicle. A motor against a blocked wheel
    /// counts: its current must go on being integrated.
    fn is_driven(&self) -> bool {
        let motors = Side::BOTH.iter().any(|side| {
            let port = self.motor_port(*side);
            let driven = self.commands.propulsion_power && self.wanted_duty(*side) != 0.0;
            port.connected && (port.duty != 0.0 || driven)
        });
        motors || self.body.total_push() != [0.0; 3]
    }
}
