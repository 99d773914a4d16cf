//! The parameters that many faults take.

use std::borrow::Cow;
use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;

rigsim_settings::quantities! {
    /// Time between two of what comes again and again.
    pub Interval: Duration, unit "s", range Duration::from_millis(1)..=Duration::from_hours(24),
        example "100ms";
    /// A share of chances.
    pub Probability: f64, range 0.0..=1.0, example "0.5";
}

impl Probability {
    /// Without fail.
    pub const ALWAYS: Self = Self(1.0);
}

impl Default for Probability {
    fn default() -> Self {
        Self::ALWAYS
    }
}

rigsim_settings::file_words! {
    /// Direction in which bytes travel.
    #[derive(Default)]
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
    pub enum Motors {
        /// Of the left side.
        Left = "left",
        /// Of the right side.
        Right = "right",
        /// Every motor or wheel.
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
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, JsonSchema)]
pub struct LinkName(pub Cow<'static, str>);

/// The main link, which every device has.
impl Default for LinkName {
    fn default() -> Self {
        Self(Cow::Borrowed("main"))
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
