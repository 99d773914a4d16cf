//! Things that lie and stand on the plane.

use super::area::Shape;
use super::ground::Ground;
use super::obstacle::{MOST_PARTS, ObstacleError, Obstacles};
use super::scan::Tag;
use super::terrain::Change;
use super::{World, WorldSettings};

/// The contents of a world. Lengths are in metres, angles in radians counter-clockwise from x.
///
/// The ground outside of the areas is that of [`WorldSettings`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WorldMap {
    /// Walls, boxes and posts.
    pub obstacles: Obstacles,
    /// Slopes of the ground; of several at one place the last counts.
    pub slopes: Vec<Slope>,
    /// Places where the ground has another friction; of several at one place the last counts.
    pub frictions: Vec<FrictionPatch>,
    /// RFID tags on the ground.
    pub tags: Vec<Tag>,
    /// Magnetic strips on the ground.
    pub strips: Vec<Strip>,
}

/// Sloping ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// Where it lies, m.
    pub area: Shape,
    /// How steep it is, rad.
    pub slope: f64,
    /// Direction in which it rises.
    pub uphill: f64,
}

/// Ground of another friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionPatch {
    /// Where it lies, m.
    pub area: Shape,
    /// Coefficient of friction between wheel and ground.
    pub friction: f64,
}

/// A magnetic strip.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Strip {
    /// Its middle line, from point to point.
    pub points: Vec<[f64; 2]>,
    /// Set if it comes back to its first point.
    pub closed: bool,
    /// Radius with which it goes around its points; where it does not fit, as much as does.
    pub corner_radius: f64,
}

impl WorldMap {
    /// Number of its parts; there may be [`MOST_PARTS`].
    #[must_use]
    pub fn parts(&self) -> usize {
        let obstacles = self.obstacles.iter().map(|one| one.solids().len());
        let strips = self.strips.iter().map(|strip| strip.bands().len());
        let others = self.slopes.len() + self.frictions.len() + self.tags.len();
        obstacles.chain(strips).sum::<usize>() + others
    }
}

impl World {
    /// A plane with these contents.
    #[must_use]
    pub fn with_map(settings: &WorldSettings, map: &WorldMap) -> Self {
        let mut world = Self::new(settings);
        world.put(map);
        world
    }

    /// Puts contents into the world, beside those that it has.
    ///
    /// # Errors
    /// When the name of an obstacle is taken, or there would be more than [`MOST_PARTS`]; nothing
    /// has changed then.
    pub fn add_map(&mut self, map: &WorldMap) -> Result<(), ObstacleError> {
        let parts = self.solids().count() + self.areas.len() + self.tags.len() + self.strips.len();
        if parts + map.parts() > MOST_PARTS {
            return Err(ObstacleError::TooMany);
        }
        for obstacle in map.obstacles.iter() {
            self.check_name(obstacle)?;
        }
        self.put(map);
        Ok(())
    }

    fn put(&mut self, map: &WorldMap) {
        for obstacle in map.obstacles.iter() {
            self.stand(obstacle.clone());
        }
        for slope in &map.slopes {
            let ground = Ground::new(0.0, slope.slope, slope.uphill);
            self.areas.push((slope.area, Change::Slope(ground)));
        }
        for patch in &map.frictions {
            let ground = Ground::flat(patch.friction);
            self.areas.push((patch.area, Change::Friction(ground)));
        }
        self.tags.extend(&map.tags);
        for strip in &map.strips {
            self.strips.extend(strip.bands());
        }
        self.changes += 1;
    }
}
