//! Version words.

use std::convert::Infallible;
use std::fmt;

use rigsim_settings::{Allowed, Bounds, SettingValue, Value};
use schemars::json_schema;

use super::VersionOrder;

/// A version word: major, minor, region and build, a byte each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub [u8; 4]);

impl Version {
    /// The version word.
    #[must_use]
    pub fn word(self, order: VersionOrder) -> u32 {
        match order {
            VersionOrder::MajorHigh => u32::from_be_bytes(self.0),
            VersionOrder::MajorLow => u32::from_le_bytes(self.0),
        }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, region, build] = self.0;
        write!(f, "{major}.{minor}.{region}.{build}")
    }
}

impl SettingValue for Version {
    type Bound = Infallible;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        let wrong = || format!("{value} is not a version");
        let Value::Text(text) = value else {
            return Err(wrong());
        };
        let parts: Vec<u8> = text
            .split('.')
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|_| wrong())?;
        parts.try_into().map(Self).map_err(|_| wrong())
    }

    fn show(&self, _unit: &str) -> String {
        format!("\"{self}\"")
    }

    fn allowed(_unit: &str, _bounds: Option<&Bounds<Infallible>>) -> Allowed {
        let schema = json_schema!({
            "type": "string",
            "pattern": "^[0-9]{1,3}(\\.[0-9]{1,3}){3}$",
            "examples": ["1.2.3.4"],
        });
        Allowed::any("\"major.minor.region.build\", each 0 to 255", schema)
    }
}
