//! The quantities of a world file, each with its unit and its range.

use rigsim_settings::quantities;
use schemars::JsonSchema;

use crate::world::EDGE_M as EDGE;

quantities! {
    /// A size, which is never nothing.
    pub(super) Size: f64, unit "m", range 0.001..=EDGE, example "0.5 m";
    /// A radius that may be nothing.
    pub(super) Radius: f64, unit "m", range 0.0..=EDGE, example "300 mm";
    /// A direction, counter-clockwise from the x axis.
    pub(super) Direction: f64, unit "deg", range -360.0..=360.0, example "90 deg";
    /// Steepness of the ground.
    pub(super) Steepness: f64, unit "deg", range -45.0..=45.0, example "12 deg";
    /// A place on the plane: x and y in metres.
    pub(super) Point: [f64; 2], range -EDGE..=EDGE, example "[1.5, -2]";
    /// Version of the file's form.
    pub(super) Version: u32, range 1..=1, example "1";
    /// The number that a reader reads of a tag; 0 stands for no tag.
    pub(super) TagNumber: u32, range 1..=u32::MAX, example "77";
}

/// A line from point to point: at least two.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "Vec<Point>")]
#[schemars(extend("minItems" = 2))]
pub(super) struct Line(pub(super) Vec<Point>);

impl TryFrom<Vec<Point>> for Line {
    type Error = String;

    fn try_from(points: Vec<Point>) -> Result<Self, String> {
        if points.len() >= 2 {
            Ok(Self(points))
        } else {
            Err("a line has at least two points, as in [[0, 0], [1.5, 0]]".to_owned())
        }
    }
}

/// The name of an obstacle: letters, digits, `-` and `_`, at most 64.
#[derive(Debug, Clone, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "String")]
#[schemars(extend("pattern" = "^[A-Za-z0-9_-]{1,64}$"))]
pub(super) struct Name(pub(super) String);

impl TryFrom<String> for Name {
    type Error = String;

    fn try_from(name: String) -> Result<Self, String> {
        let allowed = |letter: char| letter.is_ascii_alphanumeric() || "-_".contains(letter);
        if (1..=64).contains(&name.len()) && name.chars().all(allowed) {
            Ok(Self(name))
        } else {
            Err(format!(
                "\"{name}\" is not a name; allowed: 1 to 64 letters, digits, - and _"
            ))
        }
    }
}
