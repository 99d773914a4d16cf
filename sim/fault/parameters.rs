//! The words that faults take as parameters.

use std::borrow::Cow;
use std::fmt;

use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};

/// A share of chances, 0 to 1.
#[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Deserialize, Serialize)]
#[serde(try_from = "f64", into = "f64")]
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

impl From<Probability> for f64 {
    fn from(value: Probability) -> Self {
        value.0
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

/// Bytes written in hexadecimal: `"AA 55 00"`. At most 300.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
#[serde(try_from = "String", into = "String")]
pub struct HexBytes(pub Vec<u8>);

/// More than the longest frame.
const MOST_BYTES: usize = 300;

impl TryFrom<String> for HexBytes {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        let digits = || text.chars().filter(|c| !c.is_whitespace());
        if digits().any(|c| !c.is_ascii_hexdigit()) {
            return Err(format!(
                "\"{text}\" is not hexadecimal; write bytes as in \"AA 55 00\""
            ));
        }
        let bytes = crate::event::read_hex(digits());
        let fits = |bytes: &Vec<u8>| (1..=MOST_BYTES).contains(&bytes.len());
        bytes
            .filter(fits)
            .map(Self)
            .ok_or_else(|| format!("\"{text}\" is not 1 to {MOST_BYTES} bytes of two digits each"))
    }
}

impl From<HexBytes> for String {
    fn from(bytes: HexBytes) -> Self {
        crate::event::Hex(&bytes.0).to_string()
    }
}

impl JsonSchema for HexBytes {
    fn schema_name() -> Cow<'static, str> {
        "HexBytes".into()
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({
            "type": "string",
            "description": "bytes in hexadecimal",
            "pattern": "^( *[0-9A-Fa-f]{2})+ *$",
            "examples": ["AA 55 00 07 C7 84"],
        })
    }
}

/// Declares words that files have.
macro_rules! words {
    ($( $(#[doc = $doc:literal])+ $name:ident $(default $default:ident)? {
        $( $(#[doc = $about:literal])+ $variant:ident = $word:literal $(or $alias:literal)?, )+
    } )+) => { $(
        sim_settings::words! {
            $(#[doc = $doc])+
            #[derive(Deserialize, Serialize, JsonSchema)]
            pub enum $name {
                $(
                    $(#[doc = $about])+
                    #[serde(rename = $word $(, alias = $alias)?)]
                    $variant = $word,
                )+
            }
        }

        $( impl Default for $name {
            fn default() -> Self {
                Self::$default
            }
        } )?
    )+ };
}

words! {
    /// Direction in which bytes travel.
    Direction default Both {
        /// From the client to the device.
        ToDevice = "to-device",
        /// From the device to the client.
        ToClient = "to-client",
        /// Either way.
        Both = "both",
    }
    /// Part of a frame that is wrong about its length.
    WrongLength default Parameters {
        /// Parameters are missing or added, and the rest of the frame fits them.
        Parameters = "parameters",
        /// The length field alone lies.
        Field = "field",
    }
    /// An output of the R150's module. Its name in conditions will do as well: `v12a`.
    RailName {
        /// 12 V output A.
        V12A = "12v-a" or "v12a",
        /// 12 V output B.
        V12B = "12v-b" or "v12b",
        /// 12 V output C.
        V12C = "12v-c" or "v12c",
        /// 12 V output D.
        V12D = "12v-d" or "v12d",
        /// The 48 V output.
        V48 = "48v" or "v48",
        /// The 5 V outputs.
        V5 = "5v" or "v5",
    }
    /// A pair of 12 V outputs, which share a converter.
    PairName {
        /// A and B.
        Ab = "ab",
        /// C and D.
        Cd = "cd",
    }
    /// A fuse of the R150.
    FuseName {
        /// Supply of the right motor.
        MotorRight = "motor-right",
        /// Supply of the left motor.
        MotorLeft = "motor-left",
        /// Tail supply, which feeds the module and its outputs.
        Tail = "tail",
        /// The vehicle's small modules.
        SmallModules = "small-modules",
    }
    /// Motors with their gears and wheels. The wheels of one side of an R150 are geared together.
    Motors {
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
    /// A motor port of the car's board.
    PortName {
        /// X.
        X = "x",
        /// Y.
        Y = "y",
        /// Z, which no motor has in the default wiring.
        Z = "z",
        /// E0.
        E0 = "e0",
        /// E1.
        E1 = "e1",
    }
    /// A motion key of the R150's remote control.
    Key {
        /// Forward.
        Forward = "forward",
        /// Backward.
        Backward = "backward",
        /// Turn left on the spot.
        Left = "left",
        /// Turn right on the spot.
        Right = "right",
    }
    /// Ultrasonic sensors of the car, each row counted from the left.
    EchoSensor default All {
        /// All eight.
        All = "all",
        /// All in front.
        Front = "front",
        /// All in the rear.
        Rear = "rear",
        /// Leftmost in front, `ut_f[0]`.
        Front1 = "front-1",
        /// `ut_f[1]`.
        Front2 = "front-2",
        /// `ut_f[2]`.
        Front3 = "front-3",
        /// Rightmost in front, `ut_f[3]`.
        Front4 = "front-4",
        /// Leftmost in the rear, `ut_b[0]`.
        Rear1 = "rear-1",
        /// `ut_b[1]`.
        Rear2 = "rear-2",
        /// `ut_b[2]`.
        Rear3 = "rear-3",
        /// Rightmost in the rear, `ut_b[3]`.
        Rear4 = "rear-4",
    }
}

/// A serial link of a device, by the id that its row gives it.
#[derive(Debug, Clone, PartialEq, Eq, Deserialize, Serialize)]
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
    /// Tells whether it is one wheel of a car.
    #[must_use]
    pub fn is_wheel(self) -> bool {
        !matches!(self, Self::Left | Self::Right | Self::All)
    }
}

impl EchoSensor {
    /// Tells whether a sensor is meant, by its place among the eight.
    #[must_use]
    pub fn has(self, index: usize) -> bool {
        match self {
            Self::All => true,
            Self::Front => index < 4,
            Self::Rear => index >= 4,
            one => one as usize == Self::Front1 as usize + index,
        }
    }
}
