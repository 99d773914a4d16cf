//! Reads types from TOML by serde, with errors that are data: where, on which way, and what is wrong.

use std::borrow::Cow;
use std::convert::Infallible;
use std::fmt;
use std::ops::Range;

use serde::de::value::{MapAccessDeserializer, StrDeserializer};
use serde::de::{
    DeserializeOwned, DeserializeSeed, Deserializer, Error as _, Expected, IntoDeserializer,
    MapAccess, SeqAccess, Unexpected, Visitor,
};
use serde::forward_to_deserialize_any;
use serde_spanned::de::{SpannedDeserializer, is_spanned};
use toml::Spanned;
use toml::de::{DeString, DeTable, DeValue};

use crate::document::nearest;
use crate::error::shorten;

/// The key that names the variant in a table of [`Reader::of_kind`].
const KIND: &str = "kind";

/// Reads a value.
///
/// # Errors
/// The first thing that is wrong.
pub fn read<T: DeserializeOwned>(value: &Spanned<DeValue<'_>>) -> Result<T, ReadError> {
    T::deserialize(Reader::new(value)).map_err(|error| error.or_at(&value.span()))
}

/// A step on the way to a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Part {
    /// The value of a key of a table.
    Key(String),
    /// The table in a list that begins at this byte.
    Element(usize),
}

/// Something wrong with a value.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("{why}")]
pub struct ReadError {
    /// The way to it from what was read.
    pub path: Vec<Part>,
    /// Its bytes; `None` if it is all that was read.
    pub at: Option<Range<usize>>,
    /// What is wrong.
    pub why: Wrong,
}

/// What is wrong with a value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Wrong {
    /// A table lacks this key.
    MissingKey(String),
    /// A table has a key that is none of those allowed.
    UnknownKey(String, Vec<&'static str>),
    /// A word is none of those allowed.
    UnknownWord(String, Vec<&'static str>),
    /// A word stands where a table of it and its value belongs.
    NeedsValue(String),
    /// Anything else, in words.
    Other(String),
}

impl fmt::Display for Wrong {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::MissingKey(key) => write!(f, "missing key `{key}`"),
            Self::UnknownKey(key, allowed) => {
                let hint = or_allowed(key, allowed);
                write!(f, "unknown key `{}`; {hint}", shorten(key.clone()))
            }
            Self::UnknownWord(word, allowed) => {
                let hint = or_allowed(word, allowed);
                write!(f, "unknown word `{}`; {hint}", shorten(word.clone()))
            }
            Self::NeedsValue(word) => {
                write!(
                    f,
                    "a value belongs to it: `{{ {word} = … }}` instead of \"{word}\""
                )
            }
            Self::Other(why) => f.write_str(why),
        }
    }
}

/// `did you mean …?` and what is allowed, if anything is.
#[must_use]
pub fn or_allowed(word: &str, allowed: &[&str]) -> String {
    if allowed.is_empty() {
        return "there is none".to_owned();
    }
    let list = allowed.join(", ");
    nearest(word, allowed).map_or_else(
        || format!("allowed: {list}"),
        |near| format!("did you mean `{near}`? allowed: {list}"),
    )
}

impl ReadError {
    fn new(why: Wrong) -> Self {
        Self {
            path: Vec::new(),
            at: None,
            why,
        }
    }

    fn or_at(mut self, at: &Range<usize>) -> Self {
        self.at.get_or_insert_with(|| at.clone());
        self
    }

    /// The error of what holds the value at `at` as this part.
    #[must_use]
    pub fn inside(mut self, part: Part, at: &Range<usize>) -> Self {
        self.path.insert(0, part);
        self.or_at(at)
    }
}

impl serde::de::Error for ReadError {
    fn custom<T: fmt::Display>(why: T) -> Self {
        Self::new(Wrong::Other(why.to_string()))
    }

    fn missing_field(key: &'static str) -> Self {
        Self::new(Wrong::MissingKey(key.to_owned()))
    }

    fn unknown_field(key: &str, allowed: &'static [&'static str]) -> Self {
        Self::new(Wrong::UnknownKey(key.to_owned(), allowed.to_vec()))
    }

    fn unknown_variant(word: &str, allowed: &'static [&'static str]) -> Self {
        Self::new(Wrong::UnknownWord(word.to_owned(), allowed.to_vec()))
    }

    fn invalid_type(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        let found = match found {
            Unexpected::UnitVariant => return Self::new(Wrong::NeedsValue(String::new())),
            Unexpected::Bool(flag) => flag.to_string(),
            Unexpected::Unsigned(number) => number.to_string(),
            Unexpected::Signed(number) => number.to_string(),
            Unexpected::Float(number) => number.to_string(),
            Unexpected::Str(text) => format!("{text:?}"),
            Unexpected::Map => "a table".to_owned(),
            Unexpected::Seq => "a list".to_owned(),
            other => other.to_string(),
        };
        Self::custom(format!(
            "{} is not {}",
            shorten(found),
            wanted_in_words(wanted)
        ))
    }

    fn invalid_value(found: Unexpected<'_>, wanted: &dyn Expected) -> Self {
        Self::invalid_type(found, wanted)
    }

    fn invalid_length(count: usize, wanted: &dyn Expected) -> Self {
        Self::custom(format!("{count} values are not {wanted}"))
    }
}

/// A value as serde reads it.
#[derive(Debug, Clone, Copy)]
pub struct Reader<'v, 't> {
    value: &'v Spanned<DeValue<'t>>,
    /// Its key [`KIND`] names its variant.
    is_of_kind: bool,
}

impl<'v, 't> Reader<'v, 't> {
    /// Reads this value.
    #[must_use]
    pub fn new(value: &'v Spanned<DeValue<'t>>) -> Self {
        Self {
            value,
            is_of_kind: false,
        }
    }

    /// Reads an enum from a table whose key `kind` names the variant, and whose other keys are the
    /// variant's. Unlike serde's own way it keeps the places.
    #[must_use]
    pub fn of_kind(value: &'v Spanned<DeValue<'t>>) -> Self {
        Self {
            value,
            is_of_kind: true,
        }
    }

    fn entries(self, table: &'v DeTable<'t>) -> Entries<'v, 't> {
        Entries {
            entries: table.iter(),
            leaves_kind_out: self.is_of_kind,
            value: None,
        }
    }
}

impl<'de> IntoDeserializer<'de, ReadError> for Reader<'_, '_> {
    type Deserializer = Self;

    fn into_deserializer(self) -> Self {
        self
    }
}

/// What serde's own types want, as a user would say it.
fn wanted_in_words(wanted: &dyn Expected) -> Cow<'static, str> {
    let wanted = wanted.to_string();
    Cow::Borrowed(match wanted.as_str() {
        "a boolean" => "true or false",
        "a string" => "a text",
        "f64" => "a number",
        "u8" => "a whole number from 0 to 255",
        "u16" => "a whole number from 0 to 65535",
        "u32" => "a whole number from 0 to 4294967295",
        "u64" => "a whole number, 0 or more",
        "i8" => "a whole number from -128 to 127",
        "i16" => "a whole number from -32768 to 32767",
        "i32" => "a whole number from -2147483648 to 2147483647",
        "i64" => "a whole number",
        _ if wanted.starts_with("struct ") || wanted == "a map" => "a table, `{ … }`",
        _ if wanted.starts_with("an array ") || wanted == "a sequence" => {
            "a list, `[…]`, which one alone needs too"
        }
        _ => return wanted.into(),
    })
}

/// One of a few words.
struct OneOf(&'static [&'static str]);

impl Visitor<'_> for OneOf {
    type Value = Infallible;

    fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "one of {}", self.0.join(", "))
    }
}

impl<'de> Deserializer<'de> for Reader<'_, '_> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        let is_not = |found: &str| ReadError::invalid_type(Unexpected::Other(found), &visitor);
        match self.value.get_ref() {
            DeValue::String(text) => visitor.visit_str(text),
            DeValue::Integer(number) => {
                let read = i64::from_str_radix(number.as_str(), number.radix());
                let read = read.map_err(|_| is_not(number.as_str()))?;
                visitor.visit_i64(read)
            }
            DeValue::Float(number) => {
                let read = number.as_str().parse::<f64>();
                let read = read.map_err(|_| is_not(number.as_str()))?;
                visitor.visit_f64(read)
            }
            DeValue::Boolean(flag) => visitor.visit_bool(*flag),
            DeValue::Datetime(_) => Err(is_not("a date")),
            DeValue::Array(values) => {
                let mut elements = Elements(values.iter());
                let read = visitor.visit_seq(&mut elements)?;
                match elements.0.len() {
                    0 => Ok(read),
                    more => Err(ReadError::custom(format!("{more} values too many"))),
                }
            }
            DeValue::Table(table) => visitor.visit_map(self.entries(table)),
        }
    }

    fn deserialize_option<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_some(self)
    }

    fn deserialize_newtype_struct<V: Visitor<'de>>(
        self,
        _name: &'static str,
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        visitor.visit_newtype_struct(self)
    }

    fn deserialize_map<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match self.value.get_ref() {
            // Serde would take a list for the fields in their order.
            DeValue::Array(_) => Err(ReadError::invalid_type(Unexpected::Seq, &visitor)),
            _ => self.deserialize_any(visitor),
        }
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _keys: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match is_spanned(name) {
            true => visitor.visit_map(SpannedDeserializer::new(self, self.value.span())),
            false => self.deserialize_map(visitor),
        }
    }

    fn deserialize_enum<V: Visitor<'de>>(
        self,
        _name: &'static str,
        words: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        match self.value.get_ref() {
            DeValue::String(word) => {
                let read = visitor.visit_enum(StrDeserializer::new(word));
                read.map_err(|mut error: ReadError| {
                    if let Wrong::NeedsValue(needed) = &mut error.why {
                        *needed = word.to_string();
                    }
                    error
                })
            }
            DeValue::Table(table) if self.is_of_kind => {
                let kind = table.get(KIND);
                let kind = kind.ok_or_else(|| ReadError::missing_field(KIND))?;
                visitor.visit_enum(MapAccessDeserializer::new(OfKind { kind, table: self }))
            }
            DeValue::Table(table) if table.len() == 1 => {
                visitor.visit_enum(MapAccessDeserializer::new(self.entries(table)))
            }
            DeValue::Table(_) => {
                let words = words.join(", ");
                let why = format!("one thing alone belongs here; allowed: {words}");
                Err(ReadError::custom(why))
            }
            _ => match self.deserialize_any(OneOf(words))? {},
        }
    }

    fn deserialize_unit<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        match self.value.get_ref() {
            DeValue::Table(table) if table.is_empty() => visitor.visit_unit(),
            _ => Err(ReadError::custom("no value belongs to it")),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf
        unit_struct seq tuple tuple_struct identifier ignored_any
    }
}

/// The entries of a table.
struct Entries<'v, 't> {
    entries: <&'v DeTable<'t> as IntoIterator>::IntoIter,
    leaves_kind_out: bool,
    /// The entry whose key has been read.
    value: Option<(&'v Spanned<DeString<'t>>, &'v Spanned<DeValue<'t>>)>,
}

impl<'de> MapAccess<'de> for Entries<'_, '_> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ReadError> {
        let leaves_kind_out = self.leaves_kind_out;
        let entries = self.entries.by_ref();
        self.value = entries.find(|(key, _)| !leaves_kind_out || *key.get_ref() != KIND);
        let Some((key, _)) = self.value else {
            return Ok(None);
        };
        let part = || Part::Key(key.get_ref().to_string());
        let read = seed.deserialize(KeyReader(key));
        read.map(Some)
            .map_err(|error| error.inside(part(), &key.span()))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        let (key, value) = self
            .value
            .ok_or_else(|| ReadError::custom("no key was read"))?;
        let part = || Part::Key(key.get_ref().to_string());
        let read = seed.deserialize(Reader::new(value));
        read.map_err(|error| error.inside(part(), &value.span()))
    }
}

/// The elements of a list.
struct Elements<'v, 't>(std::slice::Iter<'v, Spanned<DeValue<'t>>>);

impl<'de> SeqAccess<'de> for Elements<'_, '_> {
    type Error = ReadError;

    fn next_element_seed<T: DeserializeSeed<'de>>(
        &mut self,
        seed: T,
    ) -> Result<Option<T::Value>, ReadError> {
        let Some(value) = self.0.next() else {
            return Ok(None);
        };
        let read = seed.deserialize(Reader::new(value));
        read.map(Some).map_err(|error| match value.get_ref() {
            DeValue::Table(_) => error.inside(Part::Element(value.span().start), &value.span()),
            _ => error.or_at(&value.span()),
        })
    }
}

/// A key of a table.
struct KeyReader<'v, 't>(&'v Spanned<DeString<'t>>);

impl<'de> Deserializer<'de> for KeyReader<'_, '_> {
    type Error = ReadError;

    fn deserialize_any<V: Visitor<'de>>(self, visitor: V) -> Result<V::Value, ReadError> {
        visitor.visit_str(self.0.get_ref())
    }

    fn deserialize_struct<V: Visitor<'de>>(
        self,
        name: &'static str,
        _keys: &'static [&'static str],
        visitor: V,
    ) -> Result<V::Value, ReadError> {
        let key = self.0.get_ref().to_string();
        match is_spanned(name) {
            true => visitor.visit_map(SpannedDeserializer::new(key, self.0.span())),
            false => visitor.visit_str(&key),
        }
    }

    forward_to_deserialize_any! {
        bool i8 i16 i32 i64 i128 u8 u16 u32 u64 u128 f32 f64 char str string bytes byte_buf option
        unit unit_struct newtype_struct seq tuple tuple_struct map enum identifier ignored_any
    }
}

/// A table whose key [`KIND`] names what it is: that word, and the other keys as its value.
struct OfKind<'v, 't> {
    kind: &'v Spanned<DeValue<'t>>,
    table: Reader<'v, 't>,
}

impl<'de> MapAccess<'de> for OfKind<'_, '_> {
    type Error = ReadError;

    fn next_key_seed<K: DeserializeSeed<'de>>(
        &mut self,
        seed: K,
    ) -> Result<Option<K::Value>, ReadError> {
        let read = seed.deserialize(Reader::new(self.kind));
        read.map(Some)
            .map_err(|error| error.inside(Part::Key(KIND.to_owned()), &self.kind.span()))
    }

    fn next_value_seed<V: DeserializeSeed<'de>>(&mut self, seed: V) -> Result<V::Value, ReadError> {
        seed.deserialize(self.table)
    }
}

#[cfg(test)]
mod tests;
