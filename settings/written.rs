//! Quantities as types, for files that are read by serde: a setting's value with its unit and range.

use std::time::Duration;

use schemars::{Schema, json_schema};

use crate::quantity::pattern;
use crate::value::{Bounds, SettingValue, Value, read_in};

/// A quantity of files. One with a unit is written as text with its unit, never as a bare number.
pub trait Written: Sized {
    /// Type of its number.
    type Value: SettingValue;
    /// Unit of the number; empty where it has none.
    const UNIT: &'static str;
    /// How it is written, as in `1.2 m`.
    const EXAMPLE: &'static str;

    /// Its range, if it has one.
    fn range() -> Option<Bounds<<Self::Value as SettingValue>::Bound>>;

    /// The allowed values in words.
    #[must_use]
    fn allowed() -> String {
        let values = Self::Value::allowed(Self::UNIT, Self::range().as_ref()).words;
        match Self::UNIT {
            "" => format!("{values}, as in {}", Self::EXAMPLE),
            _ => format!("{values}, with its unit, as in {:?}", Self::EXAMPLE),
        }
    }

    /// Reads its number.
    ///
    /// # Errors
    /// Says in words what is wrong and what is allowed.
    fn number(value: &Value) -> Result<Self::Value, String> {
        let read = read_in::<Self::Value>(value, Self::UNIT, Self::range().as_ref());
        read.map_err(|why| format!("{why}; allowed: {}", Self::allowed()))
    }

    /// The JSON Schema of it in a file.
    #[must_use]
    fn schema() -> Schema {
        let values = Self::Value::allowed(Self::UNIT, Self::range().as_ref());
        if Self::UNIT.is_empty() {
            let mut schema = values.schema;
            schema.insert("description".to_owned(), Self::allowed().into());
            return schema;
        }
        let ends = values.range.into_iter().flatten();
        let mut examples = vec![Self::EXAMPLE.to_owned()];
        examples.extend(ends.map(|end| end.trim_matches('"').to_owned()));
        json_schema!({
            "type": "string",
            "description": Self::allowed(),
            "pattern": pattern(Self::UNIT),
            "examples": examples,
        })
    }
}

/// Declares quantities that are written with their unit.
///
/// ```
/// rigsim_settings::quantities! {
///     /// A width, which is never nothing.
///     pub Width: f64, unit "m", range 0.001..=1000.0, example "50 mm";
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
        $vis:vis $name:ident: $type:ty $(, unit $unit:literal)? $(, range $range:expr)?, example $example:literal;
    )*) => { $(
        $(#[$meta])*
        #[derive(Debug, Clone, Copy, PartialEq, PartialOrd)]
        $vis struct $name(
            /// The number in the type's unit.
            pub $type,
        );

        impl $crate::Written for $name {
            type Value = $type;
            const UNIT: &'static str = $crate::settings!(@unit $($unit)?);
            const EXAMPLE: &'static str = $example;

            fn range() -> Option<$crate::Bounds<<$type as $crate::SettingValue>::Bound>> {
                $crate::quantities!(@range $($range)?)
            }
        }

        impl std::str::FromStr for $name {
            type Err = String;

            fn from_str(text: &str) -> Result<Self, String> {
                let value = $crate::Value::Text(text.to_owned());
                <Self as $crate::Written>::number(&value).map(Self)
            }
        }

        impl std::fmt::Display for $name {
            fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str($crate::SettingValue::show(&self.0, <Self as $crate::Written>::UNIT).trim_matches('"'))
            }
        }

        impl<'de> $crate::private::serde::Deserialize<'de> for $name {
            fn deserialize<D>(deserializer: D) -> Result<Self, D::Error>
            where
                D: $crate::private::serde::Deserializer<'de>,
            {
                let value = $crate::private::serde::Deserialize::deserialize(deserializer)?;
                <Self as $crate::Written>::number(&value)
                    .map(Self)
                    .map_err($crate::private::serde::de::Error::custom)
            }
        }

        impl $crate::private::serde::Serialize for $name {
            fn serialize<S>(&self, serializer: S) -> Result<S::Ok, S::Error>
            where
                S: $crate::private::serde::Serializer,
            {
                match <Self as $crate::Written>::UNIT {
                    "" => $crate::private::serde::Serialize::serialize(&self.0, serializer),
                    _ => serializer.collect_str(self),
                }
            }
        }

        impl $crate::private::schemars::JsonSchema for $name {
            fn schema_name() -> std::borrow::Cow<'static, str> {
                stringify!($name).into()
            }

            fn json_schema(
                _: &mut $crate::private::schemars::SchemaGenerator,
            ) -> $crate::private::schemars::Schema {
                <Self as $crate::Written>::schema()
            }
        }
    )* };
    (@range) => { None };
    (@range $range:expr) => { Some($range) };
}

quantities! {
    /// Metres.
    pub Length: f64, unit "m", range -10_000.0..=10_000.0, example "1.2 m";
    /// Metres a second.
    pub Speed: f64, unit "m/s", range -100.0..=100.0, example "1.4 m/s";
    /// Degrees, counter-clockwise.
    pub Angle: f64, unit "deg", range -36_000.0..=36_000.0, example "90 deg";
    /// Kilograms.
    pub Mass: f64, unit "kg", range 0.0..=10_000.0, example "150 kg";
    /// Newtons.
    pub Force: f64, unit "N", range -100_000.0..=100_000.0, example "200 N";
    /// Newton metres.
    pub Torque: f64, unit "N*m", range -100_000.0..=100_000.0, example "20 N*m";
    /// Volts.
    pub Voltage: f64, unit "V", range 0.0..=1000.0, example "48 V";
    /// Watts.
    pub Power: f64, unit "W", range 0.0..=1_000_000.0, example "300 W";
    /// Ohms.
    pub Resistance: f64, unit "ohm", range 0.0..=1_000_000_000.0, example "0.5 ohm";
    /// Hertz.
    pub Frequency: f64, unit "Hz", range 0.0..=100_000_000.0, example "1 kHz";
    /// Per cent, 0 to 100.
    pub Percent: f64, unit "%", range 0.0..=100.0, example "50 %";
    /// A coefficient of friction between wheel and ground.
    pub Friction: f64, range 0.0..=2.0, example "0.5";
    /// A span of simulated time.
    #[derive(Eq, Ord, Default, Hash)]
    pub Span: Duration, unit "s", example "250ms";
}

/// Things that [`quantities!`] needs where it is used.
#[doc(hidden)]
pub mod private {
    pub use schemars;
    pub use serde;
}

#[cfg(test)]
mod tests;
