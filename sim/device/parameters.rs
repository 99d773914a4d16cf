//! The parameters that many faults take.

use std::borrow::Cow;
use std::fmt;
use std::time::Duration;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::Deserialize;

rigsim_settings::quantities! {
    /// Time between two of what comes again and again.
    pub Interval: Duration, unit "s", range Duration::from_millis(1)..=Duration::from_hours(24),
        example "100ms";
}

/// A share of chances, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Deserialize)]
#[serde(try_from = "f64")]
pub struct Probability(f64);

impl Probability {
    /// Without fail.
    pub const ALWAYS: Self = Self(1.0);

    /// As a number from 0 to 1.
    #[must_use]
    pub fn get(self) -> f64 {
        self.0
    }
}

impl Default for Probability {
    fn default() -> Self {
        Self::ALWAYS
    }
}

impl TryFrom<f64> for Probability {
    type Error = String;

    fn try_from(value: f64) -> Result<Self, String> {
        if (0.0..=1.0).contains(&value) {
            Ok(Self(value))
        } else {
            Err(format!("{value} is not a probability; allowed: 0 to 1"))
        }
    }
}

impl JsonSchema for Probability {
    fn schema_name() -> Cow<'static, str> {
        "Probability".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({"type": "number", "minimum": 0, "maximum": 1})
    }
}

rigsim_settings::words! {
    /// Direction in which bytes travel.
    #[derive(Default, Deserialize, JsonSchema)]
    #[serde(rename_all = "kebab-case")]
    pub enum Direction {
        /// From the client to the device.
        ToDevice = "to-device",
        /// From the device to the client.
        ToClient = "to-client",
        /// Either way.
        #[default]
        Both = "both",
    }

    /// Motors with their gears and wheels. The wheels of one side of an R150 are geared together.
    #[derive(Deserialize, JsonSchema)]
    #[serde(rename_all = "kebab-case")]
    pub enum Motors {
        /// Of the left side.
        Left = "left",
        /// Of the right side.
        Right = "right",
        /// All of them.
        All = "all",
        /// Left front of a car.
        LeftFront = "left-front",
        /// Right front of a car.
        RightFront = "right-front",
        /// Left rear of a car.
        LeftRear = "left-rear",
        /// Right rear of a car.
        RightRear = "right-rear",
    }
}

/// A serial link of a device, by the id that its row gives it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize)]
#[serde(transparent)]
pub struct LinkName(Cow<'static, str>);

impl LinkName {
    /// As it is in files.
    #[must_use]
    pub fn as_str(&self) -> &str {
        &self.0
    }
}

/// The main link, which every device has.
impl Default for LinkName {
    fn default() -> Self {
        Self(Cow::Borrowed("main"))
    }
}

impl fmt::Display for LinkName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.0)
    }
}

impl JsonSchema for LinkName {
    fn schema_name() -> Cow<'static, str> {
        "LinkName".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({"type": "string"})
    }
}

impl Motors {
    /// Returns whether it is one wheel of a car.
    #[must_use]
    pub fn is_wheel(self) -> bool {
        !matches!(self, Self::Left | Self::Right | Self::All)
    }

    /// Returns which wheels are meant: left front, right front, left rear, right rear.
    #[must_use]
    pub fn wheels(self) -> [bool; 4] {
        match self {
            Self::Left => [true, false, true, false],
            Self::Right => [false, true, false, true],
            Self::All => [true; 4],
            Self::LeftFront => [true, false, false, false],
            Self::RightFront => [false, true, false, false],
            Self::LeftRear => [false, false, true, false],
            Self::RightRear => [false, false, false, true],
        }
    }
}

/// Target of a fault, and how often it acts. What a fault does not take has its default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scope {
    /// Motors, or wheels of a car.
    pub motors: Option<Motors>,
    /// The command to whose replies it keeps.
    pub command: Option<u8>,
    /// Probability of each time.
    pub probability: Probability,
    /// Number of times that it acts at most.
    pub count: Option<u64>,
    /// Direction in which it acts.
    pub direction: Direction,
    /// The link on which it acts, if it acts on one.
    pub link: Option<LinkName>,
}
