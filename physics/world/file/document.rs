//! The form of a world file. The comments are the descriptions in its JSON Schema.

use schemars::JsonSchema;
use serde::Deserialize;

use rigsim_settings::Friction;
use toml::Spanned;

use super::quantity::{Direction, Line, Name, Point, Radius, Size, Steepness, TagNumber, Version};
use crate::world::{self, Disc, Obstacle, ObstacleShape, Obstacles, WorldMap};

/// The contents of a world for `sim --world`: what stands and lies on the plane. x points east, y
/// north. Coordinates are metres, other quantities text with a unit, as in "50 mm".
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(title = "sim world file")]
pub(super) struct Document {
    /// Version of the form of this file.
    #[schemars(required)]
    pub(super) schema: Option<Version>,
    /// Purpose of this world; free text.
    #[expect(dead_code, reason = "for readers of the file")]
    description: Option<String>,
    /// Walls.
    #[serde(default)]
    wall: Vec<Wall>,
    /// Boxes that nothing moves.
    #[serde(default, rename = "box")]
    boxes: Vec<Block>,
    /// Posts that nothing moves.
    #[serde(default)]
    circle: Vec<Post>,
    /// Slopes of the ground. Of several at one place the last counts.
    #[serde(default)]
    slope: Vec<Slope>,
    /// Places where the ground has another friction. Of several at one place the last counts.
    #[serde(default)]
    friction: Vec<FrictionPatch>,
    /// RFID tags on the ground.
    #[serde(default)]
    tag: Vec<Tag>,
    /// Magnetic strips on the ground.
    #[serde(default)]
    strip: Vec<Strip>,
}

/// A wall along a line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Wall {
    /// By which it can be moved and removed in a run.
    #[schemars(with = "Option<Name>")]
    name: Option<Spanned<Name>>,
    /// Its middle line: points in metres.
    points_m: Line,
    /// Set if it comes back to its first point.
    #[serde(default)]
    closed: bool,
    /// From side to side.
    thickness: Size,
}

/// A box.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
#[schemars(rename = "Box")]
struct Block {
    /// By which it can be moved and removed in a run.
    #[schemars(with = "Option<Name>")]
    name: Option<Spanned<Name>>,
    /// Its middle, in metres.
    at_m: Point,
    /// Direction of its length; default along x.
    heading: Option<Direction>,
    /// From end to end along its heading.
    length: Size,
    /// From side to side.
    width: Size,
}

/// A post.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Post {
    /// By which it can be moved and removed in a run.
    #[schemars(with = "Option<Name>")]
    name: Option<Spanned<Name>>,
    /// Its middle, in metres.
    at_m: Point,
    /// From the middle to the rim.
    radius: Size,
}

/// A rectangle.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Rectangle {
    /// Its middle, in metres.
    at_m: Point,
    /// Direction of its length; default along x.
    heading: Option<Direction>,
    /// From end to end along its heading.
    length: Size,
    /// From side to side.
    width: Size,
}

/// A disc.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Circle {
    /// Its middle, in metres.
    at_m: Point,
    /// From the middle to the rim.
    radius: Size,
}

/// A part of the plane.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Area {
    /// A rectangle.
    Rectangle(Rectangle),
    /// A disc.
    Circle(Circle),
}

/// Sloping ground.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Slope {
    /// Where it lies.
    area: Area,
    /// How steep it is.
    slope: Steepness,
    /// Direction in which it rises.
    uphill: Direction,
}

/// Ground of another friction.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct FrictionPatch {
    /// Where it lies.
    area: Area,
    /// Coefficient of friction between wheel and ground.
    friction: Friction,
}

/// An RFID tag.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Tag {
    /// Where it stands, in metres.
    at_m: Point,
    /// Number that a reader reads.
    number: TagNumber,
}

/// A magnetic strip along a line.
#[derive(Debug, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct Strip {
    /// Its middle line: points in metres.
    points_m: Line,
    /// Set if it comes back to its first point.
    #[serde(default)]
    closed: bool,
    /// Radius of its corners; default sharp.
    corner_radius: Option<Radius>,
}

impl Document {
    /// The contents, or the byte that is wrong and why.
    pub(super) fn into_map(self) -> Result<WorldMap, (usize, String)> {
        let walls = self.wall.into_iter().map(|wall| {
            let shape = ObstacleShape::Wall {
                points: points(wall.points_m),
                closed: wall.closed,
                thickness: wall.thickness.0,
            };
            (wall.name, shape)
        });
        let boxes = self.boxes.into_iter().map(|one| {
            let shape = rectangle(one.at_m, one.heading, [one.length, one.width]);
            (one.name, ObstacleShape::Box(shape))
        });
        let circles = self.circle.into_iter().map(|post| {
            let disc = disc(post.at_m, post.radius);
            (post.name, ObstacleShape::Circle(disc))
        });
        let mut obstacles = Obstacles::default();
        for (name, shape) in walls.chain(boxes).chain(circles) {
            let at = name.as_ref().map_or(0, |name| name.span().start);
            let obstacle = match name {
                Some(name) => Obstacle::new(shape).named(name.into_inner().0),
                None => Obstacle::new(shape),
            };
            obstacles
                .add(obstacle)
                .map_err(|error| (at, error.to_string()))?;
        }
        let slopes = self.slope.iter().map(|slope| world::Slope {
            area: slope.area.shape(),
            slope: slope.slope.0.to_radians(),
            uphill: slope.uphill.0.to_radians(),
        });
        let frictions = self.friction.iter().map(|patch| world::FrictionPatch {
            area: patch.area.shape(),
            friction: patch.friction.0,
        });
        let tags = self.tag.iter().map(|tag| world::Tag {
            at: tag.at_m.0,
            number: tag.number.0,
        });
        let strips = self.strip.into_iter().map(|strip| world::Strip {
            points: points(strip.points_m),
            closed: strip.closed,
            corner_radius: strip.corner_radius.map_or(0.0, |radius| radius.0),
        });
        Ok(WorldMap {
            obstacles,
            slopes: slopes.collect(),
            frictions: frictions.collect(),
            tags: tags.collect(),
            strips: strips.collect(),
        })
    }
}

impl Area {
    fn shape(&self) -> world::Shape {
        match self {
            Self::Rectangle(own) => {
                let shape = rectangle(own.at_m, own.heading, [own.length, own.width]);
                world::Shape::Rectangle(shape)
            }
            Self::Circle(own) => world::Shape::Disc(disc(own.at_m, own.radius)),
        }
    }
}

fn rectangle(
    at: Point,
    heading: Option<Direction>,
    [length, width]: [Size; 2],
) -> world::Rectangle {
    let heading = heading.map_or(0.0, |heading| heading.0.to_radians());
    world::Rectangle::new(at.0, heading, length.0, width.0)
}

fn disc(at: Point, radius: Size) -> Disc {
    Disc {
        centre: at.0,
        radius: radius.0,
    }
}

fn points(line: Line) -> Vec<[f64; 2]> {
    line.0.into_iter().map(|point| point.0).collect()
}
