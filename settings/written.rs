//! Quantities as types, for files that are read by serde: a number with its unit, in a range.

use std::fmt;
use std::time::Duration;

use crate::quantity::parse_quantity;
use crate::time::show_duration;
use crate::value::{SettingValue as _, Value};

/// Declares quantities that are written with their unit.
///
/// ```
/// sim_settings::quantities! {
///     /// A width, which is never nothing.
///     pub Width in "m", 0.001..=1000.0, example "50 mm";
/// }
/// let parsed: Result<Width, _> = "50 mm".parse();
/// assert_eq!(parsed, Ok(Width(0.05)));
/// assert!("0 m".parse::<Width>().is_err());
/// assert!("3".parse::<Width>().is_err(), "a unit is wanted");
/// ```
#[macro_export]
macro_rules! quantities {
    ($(
        $(#[$meta:meta])*
        $vis:vis $name:ident in $unit:literal, $range:expr, example $example:literal;
    )*) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
        $vis struct $name(
            /// The number in the type's unit.
            pub f64,
        );

        impl $name {
            fn allowed() -> String {
                let range: std::ops::RangeInclusive<f64> = $range;
                format!(
                    "a quantity with its unit, as in {:?}, from {} to {} {}",
                    $example, range.start(), range.end(), $unit
                )
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                $crate::read_written(text, $unit, &($range))
                    .map(Self)
                    .map_err(|why| format!("{why}; allowed: {}", Self::allowed()))
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                write!(f, "{} {}", self.0, $unit)
            }
        }

        $crate::written!($name, "^[-+]?[0-9.]+([eE][-+]?[0-9]+)? *[^0-9. ]+$", $example);
    )* };
}

/// Lets a type that reads and shows itself stand in files as a string.
#[macro_export]
#[doc(hidden)]
macro_rules! written {
    ($name:ident, $pattern:literal, $example:literal) => {
        impl<'de> $crate::private::serde::Deserialize<'de> for $name {
            fn deserialize<D>(deserializer: D) -> Result<Self, D::Error>
            where
                D: $crate::private::serde::Deserializer<'de>,
            {
                let text = $crate::private::text(deserializer, Self::allowed())?;
                text.parse().map_err($crate::private::serde::de::Error::custom)
            }
        }

        impl $crate::private::serde::Serialize for $name {
            fn serialize<S>(&self, serializer: S) -> Result<S::Ok, S::Error>
            where
                S: $crate::private::serde::Serializer,
            {
                serializer.collect_str(self)
            }
        }

        impl $crate::private::schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(
                _: &mut $crate::private::schemars::SchemaGenerator,
            ) -> $crate::private::schemars::Schema {
                $crate::private::schemars::json_schema!({
                    "type": "string",
                    "description": Self::allowed(),
                    "pattern": $pattern,
                    "examples": [$example],
                })
            }
        }
    };
}

quantities! {
    /// Metres.
    pub Length in "m", -10_000.0..=10_000.0, example "1.2 m";
    /// Metres a second.
    pub Speed in "m/s", -100.0..=100.0, example "1.4 m/s";
    /// Degrees, counter-clockwise.
    pub Angle in "deg", -36_000.0..=36_000.0, example "90 deg";
    /// Kilograms.
    pub Mass in "kg", 0.0..=10_000.0, example "150 kg";
    /// Newtons.
    pub Force in "N", -100_000.0..=100_000.0, example "200 N";
    /// Newton metres.
    pub Torque in "N*m", -100_000.0..=100_000.0, example "20 N*m";
    /// Volts.
    pub Voltage in "V", 0.0..=1000.0, example "48 V";
    /// Amperes.
    pub Current in "A", 0.0..=100_000.0, example "30 A";
    /// Watts.
    pub Power in "W", 0.0..=1_000_000.0, example "300 W";
    /// Ohms.
    pub Resistance in "ohm", 0.0..=1_000_000_000.0, example "0.5 ohm";
    /// Degrees Celsius.
    pub Temperature in "degC", -100.0..=500.0, example "90 degC";
    /// Hertz.
    pub Frequency in "Hz", 0.0..=100_000_000.0, example "1 kHz";
    /// Per cent, 0 to 100.
    pub Percent in "%", 0.0..=100.0, example "50 %";
}

/// A span of simulated time.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Hash)]
pub struct Span(
    /// The span.
    pub Duration,
);

impl Span {
    fn allowed() -> String {
        "a time with its unit, as in \"250ms\" or \"3 s\"".to_owned()
    }
}

impl std::str::FromStr for Span {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        Duration::read(&Value::Text(text.to_owned()), "")
            .map(Self)
            .map_err(|why| format!("{why}; allowed: {}", Self::allowed()))
    }
}

impl fmt::Display for Span {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&show_duration(self.0))
    }
}

written!(
    Span,
    "^[0-9.]+([eE][-+]?[0-9]+)? *(ns|us|µs|ms|s|min|h)$",
    "250ms"
);

/// Reads a quantity that must have its unit and lie in a range.
///
/// # Errors
/// Says in words what is wrong.
pub fn read_written(
    text: &str,
    unit: &str,
    range: &std::ops::RangeInclusive<f64>,
) -> Result<f64, String> {
    if text.trim().parse::<f64>().is_ok() {
        return Err(format!("`{text}` lacks a unit"));
    }
    let value = parse_quantity(text, unit)?;
    if range.contains(&value) {
        Ok(value)
    } else {
        Err(format!("`{text}` is out of range"))
    }
}

/// Things that [`quantities!`] needs where it is used.
#[doc(hidden)]
pub mod private {
    pub use schemars;
    pub use serde;

    use serde::de::{Deserializer, Visitor};

    /// Takes a string; `allowed` is what an error says is wanted.
    ///
    /// # Errors
    /// When something else than a string is there.
    pub fn text<'de, D: Deserializer<'de>>(
        deserializer: D,
        allowed: String,
    ) -> Result<String, D::Error> {
        struct Text(String);

        impl Visitor<'_> for Text {
            type Value = String;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str(&self.0)
            }

            fn visit_str<E: serde::de::Error>(self, text: &str) -> Result<String, E> {
                Ok(text.to_owned())
            }
        }

        deserializer.deserialize_str(Text(allowed))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_written_reads_back() {
        for text in ["250ms", "3s", "1500us"] {
            assert_eq!(text.parse::<Span>().unwrap().to_string(), text);
        }
        assert_eq!("0.25 kA".parse::<Current>(), Ok(Current(250.0)));
        assert_eq!(Current(250.0).to_string().parse(), Ok(Current(250.0)));
        assert!(
            "-1 kg"
                .parse::<Mass>()
                .unwrap_err()
                .contains("out of range")
        );
        assert!("1 V".parse::<Mass>().unwrap_err().contains("not a unit"));
        assert!("nan kg".parse::<Mass>().is_err());
        assert!("5".parse::<Span>().is_err());
        assert!("-5s".parse::<Span>().is_err());
    }
}
