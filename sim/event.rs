//! Events for the log, the client report and scenarios.

pub mod code;

use std::any::Any;
use std::borrow::Cow;
use std::fmt;
use std::sync::Arc;

use rigsim_settings::SimTime;

pub use code::{Attribution, Code, Level, Role};

use crate::message::MessageInfo;

/// Something that happened, when and where.
#[derive(Debug, Clone)]
pub struct Event {
    /// Time of it.
    pub at: SimTime,
    /// Index of the device in the rig.
    pub device: usize,
    /// Kind and details.
    pub kind: Arc<dyn EventKind>,
}

impl PartialEq for Event {
    fn eq(&self, other: &Self) -> bool {
        self.at == other.at && self.device == other.device && self.kind.is_same(&*other.kind)
    }
}

/// Event on a line, with a fault, or in a device.
///
/// [`fmt::Display`] puts it into words.
pub trait EventKind: fmt::Debug + fmt::Display + Same + Send + Sync {
    /// Returns its name.
    fn code(&self) -> Code;

    /// Returns its part in the counts.
    fn role(&self) -> Role {
        self.code().role()
    }

    /// Returns how much it matters.
    fn level(&self) -> Level {
        self.role().level()
    }

    /// Index of the link that it is about, if it is about one.
    fn link(&self) -> Option<usize> {
        None
    }

    /// The bytes it is about, if it is about bytes.
    fn bytes(&self) -> Option<Cow<'_, [u8]>> {
        None
    }

    /// The message that was understood or sent, with the bytes of its fields, if it is one.
    fn message(&self) -> Option<(&'static MessageInfo, Cow<'_, [u8]>)> {
        None
    }

    /// Number of bytes that were lost.
    fn lost_bytes(&self) -> u64 {
        0
    }

    /// Returns whether it is something that the client did and the protocol forbids, or that is
    /// risky.
    fn is_client_error(&self) -> bool {
        self.code().may_be_client_error()
    }
}

impl dyn EventKind {
    /// The event as one of this type, if it is one.
    #[must_use]
    pub fn get<T: EventKind>(&self) -> Option<&T> {
        (self as &dyn Any).downcast_ref()
    }
}

/// Comparison of events of any type; whatever can be compared with its own type has it.
pub trait Same: Any {
    /// Returns whether both are of the same type, and equal.
    fn is_same(&self, other: &dyn Any) -> bool;
}

impl<T: PartialEq + Any> Same for T {
    fn is_same(&self, other: &dyn Any) -> bool {
        other.downcast_ref() == Some(self)
    }
}

/// An event that needs no type of its own.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlainEvent {
    /// Code by which it is known.
    pub code: Code,
    /// It in words.
    pub text: String,
}

impl PlainEvent {
    /// A wheel would lift.
    pub(crate) fn tipping() -> Self {
        Self {
            code: code::TIPPING,
            text: "a wheel would lift: the vehicle would tip over".to_owned(),
        }
    }
}

impl EventKind for PlainEvent {
    fn code(&self) -> Code {
        self.code
    }
}

impl fmt::Display for PlainEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

/// Reads bytes of two hexadecimal digits each; `None` if that is not what they are.
#[must_use]
pub fn read_hex(digits: impl Iterator<Item = char>) -> Option<Vec<u8>> {
    let digit = |digit: char| {
        digit
            .to_digit(16)
            .and_then(|digit| u8::try_from(digit).ok())
    };
    let digits: Vec<u8> = digits.map(digit).collect::<Option<_>>()?;
    let pairs = digits.chunks_exact(2);
    let is_whole = pairs.remainder().is_empty();
    is_whole.then(|| pairs.map(|pair| pair[0] << 4 | pair[1]).collect())
}

/// Bytes as spaced upper-case hexadecimal: `AA 55 00`.
#[derive(Debug, Clone, Copy)]
pub struct Hex<'a>(pub &'a [u8]);

impl fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, byte) in self.0.iter().enumerate() {
            let space = if index == 0 { "" } else { " " };
            write!(f, "{space}{byte:02X}")?;
        }
        Ok(())
    }
}
