//! The lines of the ROS link (article, control by a ROS system).
//!
//! ```text
//! client to board: letter, number, \n     X10 \n
//! board to client: V number S number \n   V4 S500 \n
//! ```

use std::fmt;

use crate::message::{FieldInfo, MessageInfo, Sender};

/// The lowest number of a command.
pub const LOWEST: i32 = -32_768;
/// The highest number of a command; the article's range is one more than 16 bits hold.
pub const HIGHEST: i32 = 32_768;

/// The longest line of a client, without its end: four times the longest command.
pub const LONGEST: usize = 32;

/// Declares the lines of clients: the letters, and what each means.
macro_rules! commands {
    ($($letter:ident $word:literal $text:literal)*) => {
        rigsim_settings::words! {
            /// A letter that begins a command.
            pub enum Letter { $( #[doc = $text] $letter = $word, )* }
        }

        /// Lines of clients, by letter. What Y and Z mean is a choice.
        pub static COMMANDS: [MessageInfo; Letter::ALL.len()] = [$( MessageInfo {
            motion: true,
            count: concat!("count.command_line_", $word),
            ..MessageInfo::new(Sender::Client, 1, const { &[FieldInfo {
                named: &["client.distance"],
                ..FieldInfo::decimal($word, "tenths", "Distance and its sign.", "1/10 rev")
            }] })
            .named($word.as_bytes()[0], $word, $text)
        } ),*];
    };
}

commands! {
    X "X" "Forward."
    Y "Y" "Strafe, or rotate."
    Z "Z" "Rotate, or strafe."
    A "A" "To the left front."
    B "B" "To the right front."
}

impl Letter {
    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL
            .into_iter()
            .find(|letter| letter.as_str().as_bytes() == [byte])
    }
}

/// A command: a letter and a number in [`LOWEST`]`..=`[`HIGHEST`], 1/10 revolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Motion.
    pub letter: Letter,
    /// Distance, and its sign.
    pub tenths: i32,
}

/// Lines of the board.
pub static REPORTS: [MessageInfo; 1] = [MessageInfo {
    age: "reported.line_age_s",
    ..MessageInfo::new(
        Sender::Device,
        1,
        const {
            &[
                FieldInfo::decimal("V", "speed", "Speed, negative backward.", "1/100 rev/s"),
                FieldInfo::decimal("S", "mileage", "Mileage.", "1/100 rev"),
            ]
        },
    )
    .named(b'V', "report", "Speed and mileage.")
}];

impl Command {
    /// The declaration of its line.
    #[must_use]
    pub fn info(&self) -> &'static MessageInfo {
        &COMMANDS[self.letter.index()]
    }

    /// The line on the wire, as the article writes it, with a space before its end.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        format!("{self} \n").into_bytes()
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", self.letter, self.tenths)
    }
}

/// Report of the board.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Report {
    /// Speed, 1/100 revolution a second, negative while a motion goes backward.
    pub speed: i64,
    /// Mileage, 1/100 revolution.
    pub mileage: i64,
}

impl Report {
    /// The line on the wire.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        format!("{self} \n").into_bytes()
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "V{} S{}", self.speed, self.mileage)
    }
}

/// Reason for which a line is not a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LineError {
    /// Neither a letter of a command nor a number after it.
    Malformed,
    /// The number is beyond its range.
    OutOfRange,
    /// Longer than a line may be; the bytes are its beginning.
    TooLong,
}

/// Meaning of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// A command.
    Command(Command),
    /// None.
    Bad {
        /// What is wrong with the line.
        error: LineError,
        /// The line without its `\n`.
        bytes: Vec<u8>,
    },
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// A line that is too long is reported once, when it becomes so.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// The line so far, no longer than [`LONGEST`].
    line: Vec<u8>,
    /// The rest of the line was reported already.
    skipping: bool,
}

impl Decoder {
    /// Takes one byte; returns what it completes.
    pub fn push(&mut self, byte: u8) -> Option<Line> {
        if byte == b'\n' {
            let line = std::mem::take(&mut self.line);
            let skipped = std::mem::take(&mut self.skipping);
            return if skipped { None } else { read(line) };
        }
        if self.skipping {
            return None;
        }
        if self.line.len() < LONGEST {
            self.line.push(byte);
            return None;
        }
        self.skipping = true;
        Some(Line::Bad {
            error: LineError::TooLong,
            bytes: std::mem::take(&mut self.line),
        })
    }

    /// Forgets everything held, as a reset does.
    pub fn clear(&mut self) {
        *self = Self::default();
    }
}

/// Reads a line. Spaces and carriage returns are skipped, wherever they stand; a line of nothing
/// else means nothing.
fn read(bytes: Vec<u8>) -> Option<Line> {
    let mut meant = bytes.clone();
    meant.retain(|byte| !matches!(byte, b' ' | b'\r'));
    let (first, number) = meant.split_first()?;
    Some(match (Letter::from_byte(*first), size(number)) {
        (Some(letter), Some(tenths)) if (LOWEST..=HIGHEST).contains(&tenths) => {
            Line::Command(Command { letter, tenths })
        }
        (letter, tenths) => Line::Bad {
            error: match letter.and(tenths) {
                Some(_) => LineError::OutOfRange,
                None => LineError::Malformed,
            },
            bytes,
        },
    })
}

/// A whole number, held one beyond its range; `None` if this is none. A plus sign is not part of the
/// article's numbers.
fn size(text: &[u8]) -> Option<i32> {
    let digits = text.strip_prefix(b"-").unwrap_or(text);
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return None;
    }
    let size = digits.iter().fold(0_i32, |size, digit| {
        (size * 10 + i32::from(digit - b'0')).min(HIGHEST + 1)
    });
    Some(if digits.len() < text.len() {
        -size
    } else {
        size
    })
}

#[cfg(test)]
mod tests;
