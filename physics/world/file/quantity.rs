//! The quantities of a world file, each with its unit and its range.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::de::{Deserialize, Deserializer, Error, Visitor};
use sim_settings::parse_quantity;

/// The plane ends here, m: far enough out, and near enough for the rounding of rapier's `f32`.
const EDGE: f64 = 1000.0;

/// Declares a quantity that is written as text with its unit.
macro_rules! quantity {
    ($(#[doc = $doc:literal])+ $name:ident, $unit:literal, $range:expr, $example:literal) => {
        $(#[doc = $doc])+
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub(super) struct $name(pub(super) f64);

        impl $name {
            fn allowed() -> String {
                let range = $range;
                format!(
                    "a quantity with its unit, as in {:?}, from {} to {} {}",
                    $example,
                    range.start(),
                    range.end(),
                    $unit
                )
            }
        }

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                let text = Text { allowed: Self::allowed() };
                let text = deserializer.deserialize_str(text)?;
                let value = read(&text, $unit)
                    .and_then(|value| {
                        if ($range).contains(&value) {
                            Ok(value)
                        } else {
                            Err(format!("`{text}` is out of range"))
                        }
                    })
                    .map_err(|why| D::Error::custom(format!("{why}; allowed: {}", Self::allowed())))?;
                Ok(Self(value))
            }
        }

        impl JsonSchema for $name {
            fn schema_name() -> Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(_: &mut SchemaGenerator) -> Schema {
                json_schema!({
                    "type": "string",
                    "description": Self::allowed(),
                    "pattern": r"^[-+]?[0-9.]+([eE][-+]?[0-9]+)? *[^0-9. ]+$",
                    "examples": [$example],
                })
            }
        }
    };
}

quantity! {
    /// A size, which is never nothing.
    Size, "m", 0.001..=EDGE, "0.5 m"
}
quantity! {
    /// A radius that may be nothing.
    Radius, "m", 0.0..=EDGE, "300 mm"
}
quantity! {
    /// A direction, counter-clockwise from the x axis.
    Direction, "deg", -360.0..=360.0, "90 deg"
}
quantity! {
    /// How steep the ground is.
    Steepness, "deg", -45.0..=45.0, "12 deg"
}

/// A quantity without its unit could mean anything.
fn read(text: &str, unit: &str) -> Result<f64, String> {
    if text.trim().parse::<f64>().is_ok() {
        return Err(format!("`{text}` lacks a unit"));
    }
    parse_quantity(text, unit)
}

struct Text {
    allowed: String,
}

impl Visitor<'_> for Text {
    type Value = String;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.allowed)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<String, E> {
        Ok(text.to_owned())
    }
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
