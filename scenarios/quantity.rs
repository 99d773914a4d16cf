//! Quantities in files: a number with its unit, as `"1.2 m"` or `"90 deg"`.

use std::fmt;

use serde::de::{Deserialize, Deserializer, Error, Visitor};
use sim_settings::parse_quantity;

macro_rules! quantities {
    ($( $(#[$meta:meta])* $name:ident in $unit:literal ),* $(,)?) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd, Default)]
        pub struct $name(pub f64);

        impl<'de> Deserialize<'de> for $name {
            fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
                deserializer.deserialize_any(InUnit($unit)).map(Self)
            }
        }
    )* };
}

quantities! {
    /// Metres.
    Length in "m",
    /// Degrees, counter-clockwise.
    Angle in "deg",
}

/// Reads a number of a unit.
struct InUnit(&'static str);

impl Visitor<'_> for InUnit {
    type Value = f64;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "a number in {unit}, as \"1.5 {unit}\"", unit = self.0)
    }

    fn visit_str<E: Error>(self, text: &str) -> Result<f64, E> {
        parse_quantity(text, self.0).map_err(E::custom)
    }

    fn visit_f64<E: Error>(self, number: f64) -> Result<f64, E> {
        if number.is_finite() {
            Ok(number)
        } else {
            Err(E::custom("a finite number is wanted"))
        }
    }

    #[expect(
        clippy::cast_precision_loss,
        reason = "lengths and angles stay far below 2^53"
    )]
    fn visit_i64<E: Error>(self, number: i64) -> Result<f64, E> {
        Ok(number as f64)
    }
}
