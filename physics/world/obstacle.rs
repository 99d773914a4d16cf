//! Things that stand on the plane and are not vehicles: walls, boxes, posts.

use super::area::{Band, Disc, Rectangle, Shape, from};
use crate::pose::Pose;

/// The plane ends here, m.
pub const EDGE_M: f64 = 10_000.0;
/// Most parts of a world: boxes, posts, areas, tags, and the pieces of walls and strips. With so
/// many at one place a step of the physics takes a tenth of a second, and that grows with their
/// square.
pub const MOST_PARTS: usize = 4000;

/// Something that stands on the plane. Vehicles do not move it; the owner of the world may, if it
/// has a name.
#[derive(Debug, Clone, PartialEq)]
pub struct Obstacle {
    name: Option<String>,
    shape: ObstacleShape,
}

/// The shape of an obstacle and where it stands. Lengths are in metres.
#[derive(Debug, Clone, PartialEq)]
pub enum ObstacleShape {
    /// A wall along a line.
    Wall {
        /// Its middle line, from point to point.
        points: Vec<[f64; 2]>,
        /// Set if it comes back to its first point.
        closed: bool,
        /// From side to side.
        thickness: f64,
    },
    /// A box.
    Box(Rectangle),
    /// A post.
    Circle(Disc),
}

/// Reason for which an obstacle was not added, moved or removed. Nothing has changed then.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum ObstacleError {
    /// Names are given once.
    #[error(
        "there is an obstacle named `{name}` already; move that one, or give this another name"
    )]
    NameTaken {
        /// The name.
        name: String,
    },
    /// The world is full.
    #[error(
        "more than {MOST_PARTS} things in the world: boxes, posts, areas, tags, and pieces of walls \
         and strips"
    )]
    TooMany,
    /// No obstacle has this name.
    #[error("no obstacle is named `{name}`; {}", known(names))]
    Unknown {
        /// The name that was asked for.
        name: String,
        /// Those that there are.
        names: Vec<String>,
    },
}

impl Obstacle {
    /// One without a name, which stays for ever.
    #[must_use]
    pub fn new(shape: ObstacleShape) -> Self {
        Self { name: None, shape }
    }

    /// The same with a name, by which it can be moved and removed.
    #[must_use]
    pub fn named(self, name: impl Into<String>) -> Self {
        Self {
            name: Some(name.into()),
            ..self
        }
    }

    /// A straight wall.
    #[must_use]
    pub fn wall(from: [f64; 2], to: [f64; 2], thickness: f64) -> Self {
        Self::new(ObstacleShape::Wall {
            points: vec![from, to],
            closed: false,
            thickness,
        })
    }

    /// A post.
    #[must_use]
    pub fn circle(centre: [f64; 2], radius: f64) -> Self {
        Self::new(ObstacleShape::Circle(Disc { centre, radius }))
    }

    /// Its name, if it has one.
    #[must_use]
    pub fn name(&self) -> Option<&str> {
        self.name.as_deref()
    }

    /// Its shape and where it stands.
    #[must_use]
    pub fn shape(&self) -> &ObstacleShape {
        &self.shape
    }

    /// Place and direction: the middle and the direction of the length of a box, the middle of a
    /// post, whose heading is 0; the first point of a wall and the direction of its first piece.
    #[must_use]
    pub fn pose(&self) -> Pose {
        let (place, direction) = match &self.shape {
            ObstacleShape::Wall { points, .. } => {
                let first = points.first().copied().unwrap_or_default();
                let next = points.iter().find(|point| **point != first);
                (first, next.map_or([1.0, 0.0], |next| from(first, *next)))
            }
            ObstacleShape::Box(rectangle) => (rectangle.centre, rectangle.direction),
            ObstacleShape::Circle(disc) => (disc.centre, [1.0, 0.0]),
        };
        Pose {
            x: place[0],
            y: place[1],
            heading: libm::atan2(direction[1], direction[0]),
        }
    }

    /// The same elsewhere: its [`pose`](Self::pose) becomes this one. The place is held within
    /// ±[`EDGE_M`]; what is not a number counts as 0.
    pub(super) fn move_to(&mut self, pose: Pose) {
        let old = self.pose();
        let number = |value: f64| if value.is_finite() { value } else { 0.0 };
        let [x, y] = [pose.x, pose.y].map(|axis| number(axis).clamp(-EDGE_M, EDGE_M));
        let heading = number(pose.heading);
        match &mut self.shape {
            ObstacleShape::Wall { points, .. } => {
                let turn = heading - old.heading;
                // The same heading keeps the wall's lengths to the last bit.
                let (cos, sin) = if turn == 0.0 {
                    (1.0, 0.0)
                } else {
                    (libm::cos(turn), libm::sin(turn))
                };
                for point in points {
                    let [ahead, left] = from([old.x, old.y], *point);
                    *point = [x + cos * ahead - sin * left, y + sin * ahead + cos * left];
                }
            }
            ObstacleShape::Box(rectangle) => {
                let [length, width] = rectangle.half.map(|half| half * 2.0);
                *rectangle = Rectangle::new([x, y], heading, length, width);
            }
            ObstacleShape::Circle(disc) => disc.centre = [x, y],
        }
    }

    /// Its parts, as sensors see them.
    pub(super) fn solids(&self) -> Vec<Shape> {
        match &self.shape {
            ObstacleShape::Wall {
                points,
                closed,
                thickness,
            } => {
                let back = points.first().filter(|_| *closed && points.len() > 2);
                let ends = points.iter().skip(1).chain(back);
                let piece = |(from, to): (&[f64; 2], &[f64; 2])| {
                    Shape::Band(Band {
                        ends: [*from, *to],
                        radius: thickness / 2.0,
                    })
                };
                points.iter().zip(ends).map(piece).collect()
            }
            ObstacleShape::Box(rectangle) => vec![Shape::Rectangle(*rectangle)],
            ObstacleShape::Circle(disc) => vec![Shape::Disc(*disc)],
        }
    }
}

/// Obstacles of which no two have the same name.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Obstacles(Vec<Obstacle>);

impl Obstacles {
    /// Adds one.
    ///
    /// # Errors
    /// When its name is taken.
    pub fn add(&mut self, obstacle: Obstacle) -> Result<(), ObstacleError> {
        free(obstacle.name(), self.iter())?;
        self.0.push(obstacle);
        Ok(())
    }

    /// All, in the order in which they were added.
    pub fn iter(&self) -> impl Iterator<Item = &Obstacle> {
        self.0.iter()
    }
}

/// Returns whether a name is free among these.
pub(super) fn free<'o>(
    name: Option<&str>,
    mut others: impl Iterator<Item = &'o Obstacle>,
) -> Result<(), ObstacleError> {
    match name {
        Some(name) if others.any(|other| other.name() == Some(name)) => {
            Err(ObstacleError::NameTaken {
                name: name.to_owned(),
            })
        }
        _ => Ok(()),
    }
}

fn known(names: &[String]) -> String {
    if names.is_empty() {
        "none has a name".to_owned()
    } else {
        format!("there are `{}`", names.join("`, `"))
    }
}
