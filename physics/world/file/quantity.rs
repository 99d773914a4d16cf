//! The quantities of a world file, each with its unit and its range.

use schemars::JsonSchema;
use sim_settings::quantities;

use crate::world::EDGE_M as EDGE;

quantities! {
    /// A size, which is never nothing.
    pub(super) Size in "m", 0.001..=EDGE, example "0.5 m";
    /// A radius that may be nothing.
    pub(super) Radius in "m", 0.0..=EDGE, example "300 mm";
    /// A direction, counter-clockwise from the x axis.
    pub(super) Direction in "deg", -360.0..=360.0, example "90 deg";
    /// Steepness of the ground.
    pub(super) Steepness in "deg", -45.0..=45.0, example "12 deg";
}

/// A number of a world file that must lie in a range.
fn within(value: f64, low: f64, high: f64) -> Result<f64, String> {
    if (low..=high).contains(&value) {
        Ok(value)
    } else {
        Err(format!("{value} is out of range; allowed: {low} to {high}"))
    }
}

/// A place on the plane: x and y in metres.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "Vec<f64>")]
#[schemars(with = "[f64; 2]", extend("items" = {"type": "number", "minimum": -EDGE, "maximum": EDGE}))]
pub(super) struct Point(pub(super) [f64; 2]);

impl TryFrom<Vec<f64>> for Point {
    type Error = String;

    fn try_from(numbers: Vec<f64>) -> Result<Self, String> {
        let [x, y] = numbers[..] else {
            return Err("a place is two numbers, x and y, as in [1.5, -2]".to_owned());
        };
        Ok(Self([within(x, -EDGE, EDGE)?, within(y, -EDGE, EDGE)?]))
    }
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
                "\"{name}\" is no name; allowed: 1 to 64 letters, digits, - and _"
            ))
        }
    }
}

/// A coefficient of friction between wheel and ground, 0 to 2.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "f64")]
#[schemars(extend("minimum" = 0, "maximum" = 2))]
pub(super) struct Friction(pub(super) f64);

impl TryFrom<f64> for Friction {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        within(value, 0.0, 2.0).map(Self)
    }
}

/// The number that a reader reads of a tag: 1 to 4294967295, since 0 stands for no tag.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "i64")]
#[schemars(extend("minimum" = 1, "maximum" = u32::MAX))]
pub(super) struct TagNumber(pub(super) u32);

impl TryFrom<i64> for TagNumber {
    type Error = String;

    fn try_from(value: i64) -> Result<Self, String> {
        u32::try_from(value)
            .ok()
            .filter(|number| *number != 0)
            .map(Self)
            .ok_or_else(|| format!("{value} is out of range; allowed: 1 to {}", u32::MAX))
    }
}

/// Version of the file's form: 1.
#[derive(Debug, Clone, Copy, PartialEq, serde::Deserialize, JsonSchema)]
#[serde(try_from = "i64")]
#[schemars(extend("minimum" = 1, "maximum" = 1))]
pub(super) struct Version(u8);

impl TryFrom<i64> for Version {
    type Error = String;

    fn try_from(value: i64) -> Result<Self, String> {
        if value == 1 {
            Ok(Self(1))
        } else {
            Err(format!(
                "{value} is not a version that this program reads; allowed: 1"
            ))
        }
    }
}
