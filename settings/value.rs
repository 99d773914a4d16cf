//! Values as files and flags give them, and the types that settings may have.

use std::ops::RangeInclusive;
use std::time::Duration;

use schemars::{Schema, json_schema};

use crate::quantity::{lacks_unit, parse_quantity, pattern};
use crate::time::show_duration;

/// A value as a file or a flag gives it, before its setting has judged it.
#[derive(Debug, Clone, PartialEq, serde::Deserialize)]
#[serde(untagged, expecting = "expected a text, a number or a list of these")]
pub enum Value {
    /// A string, perhaps a quantity with its unit.
    Text(String),
    /// A bare integer.
    Integer(i64),
    /// A bare number with a fraction.
    Float(f64),
    /// `true` or `false`.
    Bool(bool),
    /// Several values in brackets.
    List(Vec<Value>),
    /// Something that no setting takes, such as a date; the text names it.
    #[serde(skip)]
    Other(std::borrow::Cow<'static, str>),
}

impl std::fmt::Display for Value {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Text(text) => write!(f, "{text:?}"),
            Self::Integer(number) => write!(f, "{number}"),
            Self::Float(number) => write!(f, "{number}"),
            Self::Bool(flag) => write!(f, "{flag}"),
            Self::List(values) => {
                let shown: Vec<String> = values.iter().map(ToString::to_string).collect();
                write!(f, "[{}]", shown.join(", "))
            }
            Self::Other(what) => write!(f, "{what}"),
        }
    }
}

/// Lowest and highest allowed value.
pub type Bounds<T> = RangeInclusive<T>;

/// The values that a setting may have.
#[derive(Debug, Clone)]
pub struct Allowed {
    /// In words.
    pub words: String,
    /// The ends of the range as TOML literals, or of the range of each value of a list; `None` without
    /// one.
    pub range: Option<[String; 2]>,
    /// Only whole numbers are allowed.
    pub whole: bool,
    /// The JSON Schema of them in a TOML file.
    pub schema: Schema,
}

impl Allowed {
    /// Values without a range.
    #[must_use]
    pub fn any(words: impl Into<String>, schema: Schema) -> Self {
        Self {
            words: words.into(),
            range: None,
            whole: false,
            schema,
        }
    }
}

/// A type that a setting may have.
///
/// `unit` is the unit of its declaration, empty where it has none.
pub trait SettingValue: Sized + Clone {
    /// Type of the ends of its range: the type itself, or the element of a list;
    /// [`Infallible`](std::convert::Infallible) of a type that has no range.
    type Bound: PartialOrd;

    /// Takes `value` if it has the right form.
    ///
    /// # Errors
    /// Says in words what is wrong.
    fn read(value: &Value, unit: &str) -> Result<Self, String>;

    /// The value as a TOML literal that [`SettingValue::read`] takes back unchanged.
    fn show(&self, unit: &str) -> String;

    /// Returns whether it lies in the range; `true` for a type that has none.
    fn within(&self, _bounds: &Bounds<Self::Bound>) -> bool {
        true
    }

    /// The allowed values.
    fn allowed(unit: &str, bounds: Option<&Bounds<Self::Bound>>) -> Allowed;
}

/// Reads a value and checks its range.
///
/// # Errors
/// Says in words what is wrong.
pub fn read_in<T: SettingValue>(
    value: &Value,
    unit: &str,
    bounds: Option<&Bounds<T::Bound>>,
) -> Result<T, String> {
    let read = T::read(value, unit)?;
    match bounds {
        Some(bounds) if !read.within(bounds) => Err(format!("{value} is out of range")),
        _ => Ok(read),
    }
}

fn shown<T: SettingValue>(unit: &str, bounds: Option<&Bounds<T>>) -> Option<[String; 2]> {
    bounds.map(|bounds| [bounds.start().show(unit), bounds.end().show(unit)])
}

/// A number, or a text with one of the units of its dimension.
fn number_schema(
    kind: &str,
    unit: &str,
    bounds: Option<(impl Into<serde_json::Value>, impl Into<serde_json::Value>)>,
) -> Schema {
    if !unit.is_empty() {
        return json_schema!({"type": "string", "pattern": pattern(unit)});
    }
    let mut number = json_schema!({"type": kind});
    if let Some((low, high)) = bounds {
        number.insert("minimum".to_owned(), low.into());
        number.insert("maximum".to_owned(), high.into());
    }
    number
}

fn in_words(what: &str, unit: &str, bounds: Option<(String, String)>) -> String {
    let unit = if unit.is_empty() {
        String::new()
    } else {
        format!(" in {unit}")
    };
    match bounds {
        Some((low, high)) => format!("{what}{unit} from {low} to {high}"),
        None => format!("{what}{unit}"),
    }
}

/// What the numbers have in common as settings: a kind of JSON, and what it is in words.
macro_rules! number {
    ($kind:literal, $what:literal) => {
        type Bound = Self;

        fn within(&self, bounds: &Bounds<Self>) -> bool {
            bounds.contains(self)
        }

        fn allowed(unit: &str, bounds: Option<&Bounds<Self>>) -> Allowed {
            let ends = bounds.map(|b| (b.start().to_string(), b.end().to_string()));
            Allowed {
                words: in_words($what, unit, ends),
                range: shown(unit, bounds),
                whole: $kind == "integer",
                schema: number_schema($kind, unit, bounds.map(|b| (*b.start(), *b.end()))),
            }
        }
    };
}

impl SettingValue for f64 {
    fn read(value: &Value, unit: &str) -> Result<Self, String> {
        match value {
            Value::Text(text) => parse_quantity(text, unit),
            Value::Integer(_) | Value::Float(_) if !unit.is_empty() => Err(lacks_unit(value, unit)),
            #[expect(
                clippy::cast_precision_loss,
                reason = "a setting beyond 2^53 is out of range"
            )]
            Value::Integer(number) => Ok(*number as f64),
            Value::Float(number) if number.is_finite() => Ok(*number),
            other => Err(format!("{other} is not a finite number")),
        }
    }

    fn show(&self, unit: &str) -> String {
        if unit.is_empty() {
            format!("{self:?}")
        } else {
            format!("\"{self} {unit}\"")
        }
    }

    number!("number", "a number");
}

impl SettingValue for u32 {
    fn read(value: &Value, unit: &str) -> Result<Self, String> {
        let number = match value {
            Value::Integer(_) if !unit.is_empty() => return Err(lacks_unit(value, unit)),
            Value::Integer(number) => u32::try_from(*number).ok(),
            Value::Text(text) => {
                let number = parse_quantity(text, unit)?;
                #[expect(
                    clippy::cast_possible_truncation,
                    clippy::cast_sign_loss,
                    reason = "checked to be a whole number in range"
                )]
                let whole = (number.fract() == 0.0
                    && (0.0..=f64::from(u32::MAX)).contains(&number))
                .then_some(number as u32);
                whole
            }
            _ => None,
        };
        number.ok_or_else(|| format!("{value} is not a whole number"))
    }

    fn show(&self, unit: &str) -> String {
        if unit.is_empty() {
            self.to_string()
        } else {
            format!("\"{self} {unit}\"")
        }
    }

    number!("integer", "a whole number");
}

impl SettingValue for bool {
    type Bound = std::convert::Infallible;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        match value {
            Value::Bool(flag) => Ok(*flag),
            Value::Text(text) if text == "true" => Ok(true),
            Value::Text(text) if text == "false" => Ok(false),
            other => Err(format!("{other} is neither true nor false")),
        }
    }

    fn show(&self, _unit: &str) -> String {
        self.to_string()
    }

    fn allowed(_unit: &str, _bounds: Option<&Bounds<Self::Bound>>) -> Allowed {
        Allowed::any("true or false", json_schema!({"type": "boolean"}))
    }
}

impl SettingValue for Duration {
    type Bound = Duration;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        let seconds = match value {
            Value::Text(text) => parse_quantity(text, "s")?,
            Value::Integer(0) => 0.0,
            other => return Err(lacks_unit(other, "s")),
        };
        if seconds < 0.0 {
            return Err(format!("{value} is negative"));
        }
        // Whole nanoseconds, so that 0.1 s is exactly 100 ms.
        let nanos = (seconds * 1e9).round();
        if nanos >= 1.8e19 {
            return Err(format!("{value} is longer than 500 years"));
        }
        #[expect(
            clippy::cast_possible_truncation,
            clippy::cast_sign_loss,
            reason = "checked above to fit"
        )]
        Ok(Duration::from_nanos(nanos as u64))
    }

    fn show(&self, _unit: &str) -> String {
        format!("\"{}\"", show_duration(*self))
    }

    fn within(&self, bounds: &Bounds<Duration>) -> bool {
        bounds.contains(self)
    }

    fn allowed(unit: &str, bounds: Option<&Bounds<Duration>>) -> Allowed {
        let ends = bounds.map(|b| (show_duration(*b.start()), show_duration(*b.end())));
        let schema = json_schema!({"type": "string", "pattern": pattern("s")});
        Allowed {
            range: shown(unit, bounds),
            ..Allowed::any(in_words("a time", "", ends), schema)
        }
    }
}

/// A list of a fixed length; the range holds for each element.
impl<T: SettingValue, const N: usize> SettingValue for [T; N] {
    type Bound = T::Bound;

    fn read(value: &Value, unit: &str) -> Result<Self, String> {
        let Value::List(values) = value else {
            return Err(format!("{value} is not a list of {N} values"));
        };
        let read: Vec<T> = values
            .iter()
            .map(|v| T::read(v, unit))
            .collect::<Result<_, _>>()?;
        let found = read.len();
        read.try_into()
            .map_err(|_| format!("{N} values are wanted, {found} given"))
    }

    fn show(&self, unit: &str) -> String {
        let shown: Vec<String> = self.iter().map(|v| v.show(unit)).collect();
        format!("[{}]", shown.join(", "))
    }

    fn within(&self, bounds: &Bounds<T::Bound>) -> bool {
        self.iter().all(|v| v.within(bounds))
    }

    fn allowed(unit: &str, bounds: Option<&Bounds<T::Bound>>) -> Allowed {
        let each = T::allowed(unit, bounds);
        let list = json_schema!({
            "type": "array", "items": each.schema, "minItems": N, "maxItems": N,
        });
        Allowed {
            range: each.range,
            ..Allowed::any(format!("a list of {N}, each {}", each.words), list)
        }
    }
}

/// A number that `"off"` switches off.
impl<T: SettingValue> SettingValue for Option<T> {
    type Bound = T::Bound;

    fn read(value: &Value, unit: &str) -> Result<Self, String> {
        match value {
            Value::Text(text) if text == "off" => Ok(None),
            other => T::read(other, unit).map(Some),
        }
    }

    fn show(&self, unit: &str) -> String {
        self.as_ref()
            .map_or_else(|| "\"off\"".to_owned(), |v| v.show(unit))
    }

    fn within(&self, bounds: &Bounds<T::Bound>) -> bool {
        self.as_ref().is_none_or(|v| v.within(bounds))
    }

    fn allowed(unit: &str, bounds: Option<&Bounds<T::Bound>>) -> Allowed {
        let on = T::allowed(unit, bounds);
        Allowed {
            words: format!("\"off\", or {}", on.words),
            schema: json_schema!({"anyOf": [{"const": "off"}, on.schema]}),
            ..on
        }
    }
}

#[cfg(test)]
mod tests;
