//! Events for the log, the client report and scenarios.

pub mod code;

use std::borrow::Cow;
use std::fmt;

use rigsim_settings::SimTime;

pub use code::{Attribution, Code, Level, Role};

use crate::message::MessageInfo;

/// Something that happened, when and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// Simulated time.
    pub at: SimTime,
    /// Index of the device in the rig.
    pub device: usize,
    /// Kind and details.
    pub kind: EventKind,
}

/// Kind and details of an event on a line, with a fault, or in a device.
///
/// [`fmt::Display`] puts it into words; a message and noise, of which there may be many, only then.
#[derive(Debug, Clone, PartialEq)]
pub struct EventKind {
    code: Code,
    text: Cow<'static, str>,
    link: Option<usize>,
    bytes: Option<Vec<u8>>,
    shows_bytes: bool,
    message: Option<(&'static MessageInfo, Vec<u8>)>,
    /// Number of bytes that were lost.
    pub(crate) lost_bytes: u64,
    is_excused: bool,
    fault: Option<(String, &'static str)>,
}

impl EventKind {
    /// It as an event of a device at a time.
    pub(crate) fn at(self, at: SimTime, device: usize) -> Event {
        let kind = self;
        Event { at, device, kind }
    }

    /// An event with this code, in these words.
    #[must_use]
    pub fn new(code: Code, text: impl Into<Cow<'static, str>>) -> Self {
        Self {
            code,
            text: text.into(),
            link: None,
            bytes: None,
            shows_bytes: false,
            message: None,
            lost_bytes: 0,
            is_excused: false,
            fault: None,
        }
    }

    /// Something became of a fault: its name is that of its step, its id that of the catalogue.
    pub(crate) fn of_fault(code: Code, name: &str, id: &'static str, what: &str) -> Self {
        // A name that says nothing new is not said twice.
        let text = match name == id {
            true => format!("fault {id} {what}"),
            false => format!("fault {name} ({id}) {what}"),
        };
        let fault = Some((name.to_owned(), id));
        Self {
            fault,
            ..Self::new(code, text)
        }
    }

    /// The same about the link with this index.
    #[must_use]
    pub fn on(self, link: usize) -> Self {
        let link = Some(link);
        Self { link, ..self }
    }

    /// The same about these bytes of a link.
    #[must_use]
    pub fn with(self, link: usize, bytes: Vec<u8>) -> Self {
        let bytes = Some(bytes);
        Self { bytes, ..self }.on(link)
    }

    /// The same about these bytes of a link, which end the words.
    #[must_use]
    pub fn showing(self, link: usize, bytes: Vec<u8>) -> Self {
        let shows_bytes = true;
        Self {
            shows_bytes,
            ..self.with(link, bytes)
        }
    }

    /// The same about a message that was understood or sent, with the bytes of its fields and of
    /// the whole. Its fields end the words.
    #[must_use]
    pub fn saying(self, message: &'static MessageInfo, fields: Vec<u8>, bytes: Vec<u8>) -> Self {
        let link = message.link;
        let message = Some((message, fields));
        Self { message, ..self }.with(link, bytes)
    }

    /// The same; so many bytes were lost.
    #[must_use]
    pub fn losing(self, lost_bytes: u64) -> Self {
        Self { lost_bytes, ..self }
    }

    /// The same; if it is excused, it is attributed to no party, whatever its code says.
    #[must_use]
    pub fn excused(self, is_excused: bool) -> Self {
        Self { is_excused, ..self }
    }

    /// Returns its name.
    #[must_use]
    pub fn code(&self) -> Code {
        self.code
    }

    /// Returns how much it matters.
    #[must_use]
    pub fn level(&self) -> Level {
        self.code.role.level()
    }

    /// Index of the link that it is about, if it is about one.
    #[must_use]
    pub fn link(&self) -> Option<usize> {
        self.link
    }

    /// The bytes it is about, if it is about bytes.
    #[must_use]
    pub fn bytes(&self) -> Option<&[u8]> {
        self.bytes.as_deref()
    }

    /// The message that was understood or sent, with the bytes of its fields, if it is one.
    #[must_use]
    pub fn message(&self) -> Option<(&'static MessageInfo, &[u8])> {
        let (info, fields) = self.message.as_ref()?;
        Some((info, fields))
    }

    /// Returns whether it is something that the client did and the protocol forbids, or that is
    /// risky.
    #[must_use]
    pub fn is_client_error(&self) -> bool {
        self.code.may_be_client_error() && !self.is_excused
    }

    /// Name and id of the fault that it is about, if it is about one.
    #[must_use]
    pub fn fault(&self) -> Option<(&str, &'static str)> {
        let (name, id) = self.fault.as_ref()?;
        Some((name, id))
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)?;
        if let Some((message, fields)) = self.message() {
            return match message.is_text() {
                true => write!(f, " {}", fields.trim_ascii().escape_ascii()),
                false => message.show(fields).fmt(f),
            };
        }
        match self.bytes() {
            Some(bytes) if self.shows_bytes => write!(f, " {}", Hex(bytes)),
            _ => Ok(()),
        }
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
