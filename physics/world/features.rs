//! The world as a map shows it.

use super::World;
use super::area::{Band, Disc, Shape};
use super::terrain::Change;

/// Width of a magnetic strip as it is shown, m.
const STRIP_WIDTH: f64 = 0.05;
/// Radius of an RFID tag as it is shown, m.
const TAG_RADIUS: f64 = 0.05;

/// Something that lies or stands in the world.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Feature {
    /// What it is.
    pub kind: FeatureKind,
    /// Where it lies, m.
    pub shape: Shape,
}

/// Kind of a feature.
#[derive(Debug, Clone, Copy, PartialEq)]
pub enum FeatureKind {
    /// Ground that slopes.
    Slope,
    /// Ground with this coefficient of friction.
    Friction(f64),
    /// A piece of a magnetic strip.
    Strip,
    /// An RFID tag with this number.
    Tag(u32),
    /// A wall or a piece of one, a box, a post.
    Obstacle,
}

impl World {
    /// All that lies and stands around, the lowest first. Vehicles are none of it.
    pub fn features(&self) -> impl Iterator<Item = Feature> {
        let areas = self.areas.iter().map(|(area, change)| Feature {
            kind: match change {
                Change::Slope(_) => FeatureKind::Slope,
                Change::Friction(ground) => FeatureKind::Friction(ground.friction()),
            },
            shape: *area,
        });
        let strips = self.strips.iter().map(|piece| Feature {
            kind: FeatureKind::Strip,
            shape: Shape::Band(Band {
                radius: STRIP_WIDTH / 2.0,
                ..*piece
            }),
        });
        let tags = self.tags.iter().map(|tag| Feature {
            kind: FeatureKind::Tag(tag.number),
            shape: Shape::Disc(Disc {
                centre: tag.at,
                radius: TAG_RADIUS,
            }),
        });
        let solids = self.obstacles().flat_map(|obstacle| obstacle.solids());
        let obstacles = solids.map(|shape| Feature {
            kind: FeatureKind::Obstacle,
            shape,
        });
        areas.chain(strips).chain(tags).chain(obstacles)
    }

    /// The bodies: name, length and width in m.
    pub fn bodies(&self) -> impl Iterator<Item = (&str, [f64; 2])> {
        let bodies = self.bodies.iter();
        bodies.map(|body| (body.name.as_str(), body.half.map(|half| half * 2.0)))
    }
}

#[cfg(test)]
mod tests;
