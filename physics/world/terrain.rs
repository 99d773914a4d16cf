//! The ground from place to place.

use super::World;
use super::ground::Ground;
use crate::pose::BodyMotion;

impl World {
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

    /// Replaces the ground outside of the areas that have their own. Plants that rest must be
    /// woken by their owner.
    pub fn set_ground(&mut self, ground: Ground) {
        self.ground = ground;
    }
}

/// In what the ground of an area differs from that around it.
#[derive(Debug, Clone, Copy)]
pub(super) enum Change {
    /// It has the slope of this ground.
    Slope(Ground),
    /// It has the friction of this ground.
    Friction(Ground),
}
