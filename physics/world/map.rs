//! What lies and stands on the plane.

use super::area::{Disc, Rectangle};
use super::scan::Tag;
use super::{World, WorldSettings};
use crate::pose::Pose;

/// The contents of a world. Lengths are in metres, angles in radians counter-clockwise from x.
///
/// The ground outside of the areas is that of [`WorldSettings`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct WorldMap {
    /// Walls.
    pub walls: Vec<Wall>,
    /// Boxes that nothing moves.
    pub boxes: Vec<Rectangle>,
    /// Posts that nothing moves.
    pub circles: Vec<Disc>,
    /// Where the ground slopes; of several at one place the last counts.
    pub slopes: Vec<Slope>,
    /// Where the ground has another friction; of several at one place the last counts.
    pub frictions: Vec<FrictionPatch>,
    /// RFID tags on the ground.
    pub tags: Vec<Tag>,
    /// Magnetic strips on the ground.
    pub strips: Vec<Strip>,
}

/// A wall.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Wall {
    /// Where its middle line begins.
    pub from: [f64; 2],
    /// Where its middle line ends.
    pub to: [f64; 2],
    /// m
    pub thickness: f64,
}

/// A part of the plane.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum Area {
    /// A rectangle.
    Rectangle(Rectangle),
    /// A disc.
    Disc(Disc),
}

/// Sloping ground.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Slope {
    /// Where.
    pub area: Area,
    /// How steep.
    pub slope: f64,
    /// Direction in which it rises.
    pub uphill: f64,
}

/// Ground of another friction.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FrictionPatch {
    /// Where.
    pub area: Area,
    /// Coefficient of friction between wheel and ground.
    pub friction: f64,
}

/// A magnetic strip.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Strip {
    /// Its middle line, from point to point.
    pub points: Vec<[f64; 2]>,
    /// Whether it comes back to its first point.
    pub closed: bool,
    /// Radius with which it goes around its points; where it does not fit, as much as does.
    pub corner_radius: f64,
}

impl Area {
    /// Whether a point lies in it or on its rim.
    #[must_use]
    pub fn contains(&self, point: [f64; 2]) -> bool {
        match self {
            Self::Rectangle(rectangle) => rectangle.contains(point),
            Self::Disc(disc) => disc.contains(point),
        }
    }
}

impl World {
    /// A plane with these contents.
    #[must_use]
    pub fn with_map(settings: &WorldSettings, map: &WorldMap) -> Self {
        let mut world = Self::new(settings);
        world.add_map(map);
        world
    }

    /// Puts contents into the world, beside those that it has.
    pub fn add_map(&mut self, map: &WorldMap) {
        for wall in &map.walls {
            self.add_wall(wall.from, wall.to, wall.thickness);
        }
        for block in &map.boxes {
            let [x, y] = block.centre;
            let heading = libm::atan2(block.direction[1], block.direction[0]);
            let [length, width] = block.half.map(|half| half * 2.0);
            self.add_box(Pose { x, y, heading }, length, width);
        }
        for Disc { centre, radius } in &map.circles {
            self.add_disc(centre[0], centre[1], *radius);
        }
        for slope in &map.slopes {
            self.add_slope(slope);
        }
        for patch in &map.frictions {
            self.add_friction(patch);
        }
        self.tags.extend(&map.tags);
        for strip in &map.strips {
            self.strips.extend(strip.bands());
        }
        self.changes += 1;
    }
}
