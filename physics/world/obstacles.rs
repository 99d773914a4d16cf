//! The obstacles of the world: putting them there, moving them, taking them away.

use rapier2d::prelude as rapier;

use super::area::{Band, Disc, Rectangle, Shape};
use super::obstacle::{Obstacle, ObstacleError, free};
use super::{World, rapier_pose, rapier_vector};
use crate::pose::Pose;

/// An obstacle in the world.
pub(super) struct Standing {
    obstacle: Obstacle,
    /// As sensors see it.
    solids: Vec<Shape>,
    colliders: Vec<rapier::ColliderHandle>,
}

impl World {
    /// Adds an obstacle. Vehicles that rest must be woken by their owner, here and when one is
    /// moved or removed; a vehicle where an obstacle comes to stand is pushed out of it.
    ///
    /// # Errors
    /// When its name is taken.
    pub fn add_obstacle(&mut self, obstacle: Obstacle) -> Result<(), ObstacleError> {
        self.check_name(&obstacle)?;
        self.stand(obstacle);
        Ok(())
    }

    /// Moves the obstacle with this name at once, without passing the places between; returns its
    /// earlier [pose](Obstacle::pose). Without a heading it keeps its own.
    ///
    /// # Errors
    /// When none has this name.
    pub fn move_obstacle(
        &mut self,
        name: &str,
        place: [f64; 2],
        heading: Option<f64>,
    ) -> Result<Pose, ObstacleError> {
        let index = self.find(name)?;
        let mut obstacle = self.standing[index].obstacle.clone();
        let old = obstacle.pose();
        let [x, y] = place;
        let heading = heading.unwrap_or(old.heading);
        obstacle.move_to(Pose { x, y, heading });
        self.clear(index);
        self.standing[index] = self.build(obstacle);
        Ok(old)
    }

    /// Removes the obstacle with this name, and returns it.
    ///
    /// # Errors
    /// When none has this name.
    pub fn remove_obstacle(&mut self, name: &str) -> Result<Obstacle, ObstacleError> {
        let index = self.find(name)?;
        self.clear(index);
        Ok(self.standing.remove(index).obstacle)
    }

    /// All obstacles, in the order in which they were added.
    pub fn obstacles(&self) -> impl Iterator<Item = &Obstacle> {
        self.standing.iter().map(|standing| &standing.obstacle)
    }

    pub(super) fn check_name(&self, obstacle: &Obstacle) -> Result<(), ObstacleError> {
        free(obstacle.name(), self.obstacles())
    }

    /// Adds an obstacle whose name is free.
    pub(super) fn stand(&mut self, obstacle: Obstacle) {
        let standing = self.build(obstacle);
        self.standing.push(standing);
    }

    /// Lists what stands around, as sensors see it.
    pub(super) fn solids(&self) -> impl Iterator<Item = &Shape> {
        self.standing.iter().flat_map(|standing| &standing.solids)
    }

    fn find(&self, name: &str) -> Result<usize, ObstacleError> {
        let named = |obstacle: &Obstacle| obstacle.name() == Some(name);
        self.obstacles()
            .position(named)
            .ok_or_else(|| ObstacleError::Unknown {
                name: name.to_owned(),
                names: self
                    .obstacles()
                    .filter_map(Obstacle::name)
                    .map(str::to_owned)
                    .collect(),
            })
    }

    fn build(&mut self, obstacle: Obstacle) -> Standing {
        self.changes += 1;
        let solids = obstacle.solids();
        let colliders = solids
            .iter()
            .map(|solid| {
                let collider = collider(solid).friction(super::WALL_FRICTION).build();
                self.rapier.insert_collider(collider, None)
            })
            .collect();
        Standing {
            obstacle,
            solids,
            colliders,
        }
    }

    /// Takes the colliders of an obstacle out of the world.
    fn clear(&mut self, index: usize) {
        self.changes += 1;
        for collider in self.standing[index].colliders.drain(..) {
            self.rapier.remove_collider(collider);
        }
    }
}

/// A wall is a capsule because a fast body cannot slip through one; rapier's line segment has no
/// thickness.
fn collider(solid: &Shape) -> rapier::ColliderBuilder {
    match solid {
        Shape::Rectangle(Rectangle {
            centre: [x, y],
            direction: [cos, sin],
            half: [length, width],
        }) => rapier::ColliderBuilder::cuboid(*length, *width).position(rapier_pose(Pose {
            x: *x,
            y: *y,
            heading: libm::atan2(*sin, *cos),
        })),
        Shape::Disc(Disc { centre, radius }) => {
            rapier::ColliderBuilder::ball(*radius).translation(rapier_vector(*centre))
        }
        Shape::Band(Band {
            ends: [from, to],
            radius,
        }) => rapier::ColliderBuilder::capsule_from_endpoints(
            rapier_vector(*from),
            rapier_vector(*to),
            *radius,
        ),
    }
}
