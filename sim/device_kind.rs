//! Which devices there are.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Which device.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize, Serialize, JsonSchema,
)]
#[serde(rename_all = "lowercase")]
pub enum DeviceKind {
    /// XAG R150 unmanned ground vehicle.
    R150,
    /// Mecanum car on the rayland-dual board.
    Mecanum,
}

impl DeviceKind {
    /// All.
    pub const ALL: [Self; 2] = [Self::R150, Self::Mecanum];

    /// Its name in files, flags and settings.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::R150 => "r150",
            Self::Mecanum => "mecanum",
        }
    }
}

impl fmt::Display for DeviceKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::R150 => "R150",
            Self::Mecanum => "mecanum car",
        })
    }
}
