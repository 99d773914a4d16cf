//! Messages of devices, each declared once: identity, fields, wire types, units, names and text.
//!
//! [`messages!`](crate::messages) turns a declaration into a type that reads and writes the bytes, and into a
//! [`MessageInfo`], the same as data. Words of the log, fields of replies, names of conditions and
//! everything that lists a protocol come from that.

use std::fmt;

/// Declares messages of one sender: an enum of several, or a struct that is one.
///
/// Every message has an identity byte and a name; every field a name, a wire type and, behind
/// commas, whatever else of [`FieldInfo`] it has. Fields follow one another without gaps.
///
/// ```
/// use rigsim_core::message::Message;
///
/// rigsim_core::messages! {
///     /// State of a pump.
///     pub struct Pump = 0x21 "pump", Device, link 0 {
///         /// Pressure behind it.
///         pressure: u16, unit "bar", per 100;
///     }
/// }
/// let pump = Pump { pressure: 512 };
/// assert_eq!(pump.payload(), [0x00, 0x02]);
/// assert_eq!(pump.info().show(&pump.payload()).to_string(), " pressure 5.12 bar");
/// ```
#[macro_export]
macro_rules! messages {
    (
        $(#[doc = $doc:literal])+
        pub enum $name:ident, $sender:ident, link $link:literal {
            $(
                $(#[doc = $text:literal])+
                $variant:ident = $id:literal $message:literal $(, $key:ident $value:literal)* $({
                    $(
                        $(#[doc = $field_text:literal])+
                        $(#[serde($($serde:tt)*)])?
                        $(#[schemars($($schemars:tt)*)])?
                        $field:ident: $ty:ty $(, $field_key:ident $field_value:expr)*;
                    )*
                })?;
            )+
        }
    ) => {
        $(#[doc = $doc])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Deserialize, schemars::JsonSchema)]
        #[serde(deny_unknown_fields)]
        #[non_exhaustive]
        pub enum $name { $(
            $(#[doc = $text])+
            #[serde(rename = $message)]
            $variant $({ $(
                $(#[doc = $field_text])+
                $(#[serde($($serde)*)])?
                $(#[schemars($($schemars)*)])?
                $field: $ty,
            )* })?,
        )+ }

        impl $crate::message::Message for $name {
            const INFOS: &'static [$crate::message::MessageInfo] = &[ $(
                $crate::messages!(
                    @info ($($text),+) $sender $link $id $message ($(, $key $value)*)
                    $($( ($($field_text),+) $field $ty, ($(, $field_key $field_value)*) )*)?
                ),
            )+ ];

            fn id(&self) -> u8 {
                match self { $( Self::$variant { .. } => $id, )+ }
            }

            fn put(&self, bytes: &mut Vec<u8>) {
                match self { $(
                    Self::$variant $({ $($field),* })? => {
                        $( $( $crate::message::OnWire::put($field, bytes); )* )?
                    }
                )+ }
            }

            fn take(id: u8, bytes: &mut &[u8]) -> Option<Self> {
                match id {
                    $( $id => Some(Self::$variant $({
                        $( $field: $crate::message::OnWire::take(bytes)?, )*
                    })?), )+
                    _ => None,
                }
            }
        }
    };
    (
        $(#[doc = $text:literal])+
        pub struct $name:ident = $id:literal $message:literal, $sender:ident, link $link:literal
        $(, $key:ident $value:literal)* {
            $(
                $(#[doc = $field_text:literal])+
                $field:ident: $ty:ty $(, $field_key:ident $field_value:expr)*;
            )*
        }
    ) => {
        $(#[doc = $text])+
        #[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
        pub struct $name { $(
            $(#[doc = $field_text])+
            pub $field: $ty,
        )* }

        impl $crate::message::Message for $name {
            const INFOS: &'static [$crate::message::MessageInfo] = &[$crate::messages!(
                @info ($($text),+) $sender $link $id $message ($(, $key $value)*)
                $( ($($field_text),+) $field $ty, ($(, $field_key $field_value)*) )*
            )];

            fn id(&self) -> u8 {
                $id
            }

            fn put(&self, bytes: &mut Vec<u8>) {
                $( $crate::message::OnWire::put(&self.$field, bytes); )*
            }

            fn take(_id: u8, bytes: &mut &[u8]) -> Option<Self> {
                Some(Self { $( $field: $crate::message::OnWire::take(bytes)?, )* })
            }
        }
    };
    (
        @info ($($text:literal),+) $sender:ident $link:literal $id:literal $message:literal
        ($(, $key:ident $value:literal)*)
        $( ($($field_text:literal),+) $field:ident $ty:ty, ($(, $field_key:ident $field_value:expr)*) )*
    ) => {
        $crate::message::MessageInfo {
            id: $id,
            name: $message,
            text: concat!($($text),+),
            count: concat!("count.command_", $message),
            $($key: $value,)*
            ..$crate::message::MessageInfo::new($crate::message::Sender::$sender, $link, const { &[
                $( $crate::message::FieldInfo {
                    name: stringify!($field),
                    text: concat!($($field_text),+),
                    $($field_key: $field_value,)*
                    ..$crate::message::FieldInfo::new::<$ty>()
                }, )*
            ] })
        }
    };
}

/// Sender of a message.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Sender {
    /// The client.
    Client,
    /// The device.
    Device,
}

/// A message as its declaration has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct MessageInfo {
    /// Byte by which it is known on the wire; the device's framing says where that stands.
    pub id: u8,
    /// Name in files, in the log and in documentation.
    pub name: &'static str,
    /// Meaning, in a sentence.
    pub text: &'static str,
    /// Who sends it.
    pub sender: Sender,
    /// Index of the link that carries it.
    pub link: usize,
    /// Fields in the order of the wire.
    pub fields: &'static [FieldInfo],
    /// Bytes of its fields, with the reserved ones at the end.
    pub length: usize,
    /// Set if it asks for motion.
    pub motion: bool,
    /// Name of a condition: the time since the last one; empty for none.
    pub age: &'static str,
    /// Name of a condition: how many a client has sent; empty for none.
    pub count: &'static str,
}

impl MessageInfo {
    /// A message with these fields and no bytes behind them, yet without identity and names.
    #[must_use]
    pub const fn new(sender: Sender, link: usize, fields: &'static [FieldInfo]) -> Self {
        let (mut length, mut rest) = (0, fields);
        while let [field, after @ ..] = rest {
            length += field.size();
            rest = after;
        }
        Self {
            id: 0,
            name: "",
            text: "",
            sender,
            link,
            fields,
            length,
            motion: false,
            age: "",
            count: "",
        }
    }

    /// The same message with its identity, name and text.
    #[must_use]
    pub const fn named(self, id: u8, name: &'static str, text: &'static str) -> Self {
        Self {
            id,
            name,
            text,
            ..self
        }
    }

    /// Returns whether it is a line of text.
    pub(crate) fn is_text(&self) -> bool {
        let is_word = |field: &FieldInfo| matches!(field.wire, WireType::Decimal { .. });
        self.fields.iter().any(is_word)
    }

    /// The fields with the offset of each from the first one, in bytes.
    pub fn layout(&self) -> impl Iterator<Item = (usize, &'static FieldInfo)> {
        self.fields.iter().scan(0, |next, field| {
            let offset = *next;
            *next += field.size();
            Some((offset, field))
        })
    }

    /// Reads the fields, each as one number per element; a payload that is cut short has fewer.
    ///
    /// Bytes are those of [`Message::payload`]; fields of text are words of a line.
    pub fn values(&self, payload: &[u8]) -> impl Iterator<Item = (&'static FieldInfo, Vec<f64>)> {
        let words = payload.split(u8::is_ascii_whitespace);
        let mut words = words.filter(|word| !word.is_empty());
        self.layout().map_while(move |(offset, field)| {
            let numbers = match field.wire {
                WireType::Decimal { prefix } => {
                    let word = std::str::from_utf8(words.next()?).ok()?;
                    vec![word.strip_prefix(prefix)?.parse().ok()?]
                }
                wire => {
                    let bytes = payload.get(offset..offset + field.size())?;
                    let elements = bytes.chunks_exact(wire.size());
                    elements.map(|bytes| wire.number(bytes)).collect()
                }
            };
            Some((field, numbers))
        })
    }

    /// Turns the bytes of each element of the fields around, which makes of the least significant byte
    /// first the most significant first, or back.
    pub fn swap_bytes(&self, payload: &mut [u8]) {
        let mut rest = payload;
        for field in self.fields {
            for _ in 0..field.count.unwrap_or(1) {
                let Some((element, after)) = rest.split_at_mut_checked(field.wire.size()) else {
                    return;
                };
                element.reverse();
                rest = after;
            }
        }
    }

    /// Reads the fields by name.
    #[must_use]
    pub fn fields(&self, payload: &[u8]) -> Fields {
        let values = self.values(payload);
        let field = |(field, numbers): (&FieldInfo, Vec<f64>)| {
            let value = match (field.wire, field.count, numbers.first()) {
                (WireType::Bool, None, Some(number)) => Field::Flag(*number != 0.0),
                (_, None, Some(number)) => Field::Number(*number),
                _ => Field::List(numbers),
            };
            (field.name, value)
        };
        values.map(field).collect()
    }

    /// Shows the fields in words, each behind a space.
    #[must_use]
    pub fn show<'a>(&'a self, payload: &'a [u8]) -> impl fmt::Display + use<'a> {
        fmt::from_fn(move |f| {
            for (field, numbers) in self.values(payload) {
                write!(f, " {} ", field.name)?;
                field.show(f, &numbers)?;
            }
            Ok(())
        })
    }
}

/// A field as its declaration has it.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct FieldInfo {
    /// Name in files, in the log and in documentation.
    pub name: &'static str,
    /// Meaning, in a sentence.
    pub text: &'static str,
    /// Type on the wire, of each element.
    pub wire: WireType,
    /// Number of elements, for a list.
    pub count: Option<usize>,
    /// Unit of the value; empty for a pure number.
    pub unit: &'static str,
    /// Steps on the wire in one such unit, a power of ten.
    pub per: u32,
    /// Set if people read it in hexadecimal.
    pub hex: bool,
    /// Names of its bits, the lowest first.
    pub bits: &'static [&'static str],
    /// Names of its values, from 0 on.
    pub values: &'static [&'static str],
    /// Names of conditions: one for each element, or one of a list for its smallest element.
    pub named: &'static [&'static str],
    /// Names of conditions that are true or false, with their meaning: one for each bit or value,
    /// empty for none.
    pub flags: &'static [(&'static str, &'static str)],
}

impl FieldInfo {
    /// A field of this type, yet without name and text.
    #[must_use]
    pub const fn new<T: OnWire>() -> Self {
        Self {
            name: "",
            text: "",
            wire: T::WIRE,
            count: T::COUNT,
            unit: "",
            per: 1,
            hex: false,
            bits: &[],
            values: &[],
            named: &[],
            flags: &[],
        }
    }

    /// A number of a line of text, behind these letters.
    #[must_use]
    pub const fn decimal(
        prefix: &'static str,
        name: &'static str,
        text: &'static str,
        unit: &'static str,
    ) -> Self {
        Self {
            name,
            text,
            wire: WireType::Decimal { prefix },
            unit,
            ..Self::new::<u8>()
        }
    }

    /// Bytes on the wire; 0 for text, which has no fixed width.
    #[must_use]
    pub const fn size(&self) -> usize {
        match self.count {
            Some(count) => count * self.wire.size(),
            None => self.wire.size(),
        }
    }

    /// The values of its names for conditions.
    pub(crate) fn named_values(
        &self,
        numbers: &[f64],
    ) -> impl Iterator<Item = (&'static str, f64)> {
        let lowest = numbers.iter().copied().fold(f64::INFINITY, f64::min);
        let alone = (self.named.len() == 1).then_some([lowest]);
        let each: Vec<f64> = alone.map_or_else(|| numbers.to_vec(), Vec::from);
        let per = f64::from(self.per);
        let named = self.named.iter().copied();
        let named = named.zip(each.into_iter().map(move |number| number / per));
        let whole = numbers.first().map_or(0, |number| whole(*number));
        let by_value = !self.values.is_empty();
        let flags = (0..).zip(self.flags).filter(|(_, flag)| !flag.0.is_empty());
        named.chain(flags.map(move |(index, (name, _))| {
            let is_set = if by_value {
                whole == index
            } else {
                whole >> index & 1 == 1
            };
            (*name, f64::from(u8::from(is_set)))
        }))
    }

    fn show(&self, f: &mut fmt::Formatter<'_>, numbers: &[f64]) -> fmt::Result {
        if self.count.is_none() {
            numbers
                .iter()
                .try_for_each(|number| self.show_one(f, *number))?;
        } else {
            f.write_str("[")?;
            for (index, number) in numbers.iter().enumerate() {
                f.write_str(if index == 0 { "" } else { ", " })?;
                self.show_one(f, *number)?;
            }
            f.write_str("]")?;
        }
        match self.per {
            1 => Ok(()),
            _ => write!(f, " {}", self.unit),
        }
    }

    fn show_one(&self, f: &mut fmt::Formatter<'_>, number: f64) -> fmt::Result {
        let whole = whole(number);
        let value = usize::try_from(whole)
            .ok()
            .and_then(|at| self.values.get(at));
        if let Some(name) = value {
            return f.write_str(name);
        }
        if !self.bits.is_empty() {
            return show_bits(f, self.bits, whole);
        }
        match self.wire {
            WireType::Bool => write!(f, "{}", number != 0.0),
            wire if self.hex => write!(f, "0x{whole:0width$X}", width = 2 * wire.size()),
            _ => {
                let digits = self.per.ilog10() as usize;
                write!(f, "{:.digits$}", number / f64::from(self.per))
            }
        }
    }
}

/// The names of the bits that are set; what has no name is a number.
fn show_bits(f: &mut fmt::Formatter<'_>, names: &[&str], bits: i64) -> fmt::Result {
    if bits == 0 {
        return f.write_str("none");
    }
    let set = (0..).zip(names).filter(|(bit, _)| bits >> bit & 1 == 1);
    let mut words: Vec<String> = set.map(|(_, name)| (*name).to_owned()).collect();
    let unnamed = bits >> names.len() << names.len();
    if unnamed != 0 {
        words.push(format!("0x{unnamed:X}"));
    }
    f.write_str(&words.join("+"))
}

/// A number of the wire, which has at most 32 bits, or one of a line, which saturates.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast from a float saturates"
)]
fn whole(number: f64) -> i64 {
    number as i64
}

/// Type of a field on the wire. Where a protocol has a byte order, it is the framing's to say.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WireType {
    /// A byte, 0 for false.
    Bool,
    /// One byte.
    U8,
    /// Two bytes.
    U16,
    /// Four bytes.
    U32,
    /// Two bytes, with a sign.
    I16,
    /// Four bytes, with a sign.
    I32,
    /// A word of a line of text: these letters and a whole number.
    Decimal {
        /// Letters before the number.
        prefix: &'static str,
    },
}

impl WireType {
    /// Bytes of one element; 0 for text, which has no fixed width.
    #[must_use]
    pub const fn size(self) -> usize {
        match self {
            Self::Bool | Self::U8 => 1,
            Self::U16 | Self::I16 => 2,
            Self::U32 | Self::I32 => 4,
            Self::Decimal { .. } => 0,
        }
    }

    /// One element of that size, little-endian.
    fn number(self, bytes: &[u8]) -> f64 {
        let bits = bytes.iter().rev();
        let bits = bits.fold(0, |bits, byte| bits << 8 | u32::from(*byte));
        match self {
            Self::I16 => f64::from((bits << 16).cast_signed() >> 16),
            Self::I32 => f64::from(bits.cast_signed()),
            _ => f64::from(bits),
        }
    }
}

/// Value that a field can have.
pub trait OnWire: Sized {
    /// Type of it, or of each of its elements.
    const WIRE: WireType;
    /// Number of elements, for a list.
    const COUNT: Option<usize> = None;

    /// Appends its bytes, little-endian.
    fn put(&self, bytes: &mut Vec<u8>);

    /// Takes its bytes off the front; `None` if there are too few.
    fn take(bytes: &mut &[u8]) -> Option<Self>;
}

macro_rules! integers {
    ($($ty:ident $wire:ident)*) => { $(
        impl OnWire for $ty {
            const WIRE: WireType = WireType::$wire;

            fn put(&self, bytes: &mut Vec<u8>) {
                bytes.extend(self.to_le_bytes());
            }

            fn take(bytes: &mut &[u8]) -> Option<Self> {
                let (first, rest) = bytes.split_first_chunk()?;
                *bytes = rest;
                Some(Self::from_le_bytes(*first))
            }
        }
    )* };
}

integers! { u8 U8  u16 U16  u32 U32  i16 I16  i32 I32 }

impl OnWire for bool {
    const WIRE: WireType = WireType::Bool;

    fn put(&self, bytes: &mut Vec<u8>) {
        bytes.push(u8::from(*self));
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        Some(u8::take(bytes)? != 0)
    }
}

impl<T: OnWire + Copy + Default, const N: usize> OnWire for [T; N] {
    const WIRE: WireType = T::WIRE;
    const COUNT: Option<usize> = Some(N);

    fn put(&self, bytes: &mut Vec<u8>) {
        for element in self {
            element.put(bytes);
        }
    }

    fn take(bytes: &mut &[u8]) -> Option<Self> {
        let mut elements = [T::default(); N];
        for element in &mut elements {
            *element = T::take(bytes)?;
        }
        Some(elements)
    }
}

/// A message, or one of several of one sender, that was declared by [`messages!`](crate::messages).
pub trait Message: Sized {
    /// The declarations.
    const INFOS: &'static [MessageInfo];

    /// The byte by which it is known.
    fn id(&self) -> u8;

    /// Appends the bytes of its fields, little-endian.
    fn put(&self, bytes: &mut Vec<u8>);

    /// Takes the fields of the message with this identity off the front, little-endian; `None` if
    /// there is none, or there are too few bytes.
    fn take(id: u8, bytes: &mut &[u8]) -> Option<Self>;

    /// The bytes of its fields and the reserved ones behind them, little-endian.
    fn payload(&self) -> Vec<u8> {
        let length = self.info().length;
        let mut bytes = Vec::with_capacity(length);
        self.put(&mut bytes);
        bytes.resize(length, 0);
        bytes
    }

    /// Its own declaration.
    fn info(&self) -> &'static MessageInfo {
        Self::info_of(self.id()).unwrap_or(&Self::INFOS[0])
    }

    /// Finds a declaration.
    #[must_use]
    fn info_of(id: u8) -> Option<&'static MessageInfo> {
        Self::INFOS.iter().find(|info| info.id == id)
    }
}

/// Fields of a message by name.
pub type Fields = Vec<(&'static str, Field)>;

/// The value of a field.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Field {
    /// True or false.
    Flag(bool),
    /// A number as on the wire.
    Number(f64),
    /// Several numbers.
    List(Vec<f64>),
}

#[cfg(test)]
mod tests;
