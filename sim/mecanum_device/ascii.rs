//! The lines of the ROS link (article, control by a ROS system).
//!
//! ```text
//! client to board: letter, number, \n     X10 \n
//! board to client: V number S number \n   V4 S500 \n
//! ```

use std::fmt;

/// The longest line, without its `\n`.
pub const MAX_LINE: usize = 32;
/// The lowest number of a command.
pub const LOWEST: i32 = -32_768;
/// The highest number of a command; the article's range is one more than 16 bits hold.
pub const HIGHEST: i32 = 32_768;

/// A letter that begins a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Letter {
    /// `X`.
    X,
    /// `Y`.
    Y,
    /// `Z`.
    Z,
    /// `A`.
    A,
    /// `B`.
    B,
}

impl Letter {
    /// All.
    pub const ALL: [Self; 5] = [Self::X, Self::Y, Self::Z, Self::A, Self::B];

    /// On the wire.
    #[must_use]
    pub const fn byte(self) -> u8 {
        match self {
            Self::X => b'X',
            Self::Y => b'Y',
            Self::Z => b'Z',
            Self::A => b'A',
            Self::B => b'B',
        }
    }

    fn from_byte(byte: u8) -> Option<Self> {
        Self::ALL.into_iter().find(|letter| letter.byte() == byte)
    }
}

/// A command: a letter and a number in [`LOWEST`]`..=`[`HIGHEST`], 1/10 revolution.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Command {
    /// Which motion.
    pub letter: Letter,
    /// How far, and which way.
    pub tenths: i32,
}

impl Command {
    /// The line on the wire, as the article writes it, with a space before its end.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        format!("{self} \n").into_bytes()
    }
}

impl fmt::Display for Command {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}{}", char::from(self.letter.byte()), self.tenths)
    }
}

/// What the board reports.
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

    /// Reads a line as a client does, with or without its end.
    #[must_use]
    pub fn parse(line: &[u8]) -> Option<Self> {
        let line = std::str::from_utf8(line).ok()?;
        let (speed, mileage) = line.trim_ascii().strip_prefix('V')?.split_once(" S")?;
        Some(Self {
            speed: speed.parse().ok()?,
            mileage: mileage.parse().ok()?,
        })
    }
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "V{} S{}", self.speed, self.mileage)
    }
}

/// Why a line is no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Fault {
    /// Neither a letter of a command nor a number after it.
    Malformed,
    /// The number is beyond its range.
    OutOfRange,
    /// Longer than [`MAX_LINE`]; the bytes are its beginning.
    TooLong,
}

/// What a line was.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// A command.
    Command(Command),
    /// None.
    Bad {
        /// What is wrong with it.
        fault: Fault,
        /// The line without its `\n`.
        bytes: Vec<u8>,
    },
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// A line that is too long is told of once, when it becomes so. A line with nothing on it is
/// nothing.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    /// The line so far; at most [`MAX_LINE`] bytes.
    line: Vec<u8>,
    /// The rest of the line was told of already.
    skipping: bool,
}

impl Decoder {
    /// At the beginning of a line.
    #[must_use]
    pub fn new() -> Self {
        Self::default()
    }

    /// Takes one byte; gives what it completes.
    pub fn push(&mut self, byte: u8) -> Option<Line> {
        if byte == b'\n' {
            let line = std::mem::take(&mut self.line);
            let skipped = std::mem::take(&mut self.skipping);
            return if skipped { None } else { read(line) };
        }
        if self.skipping {
            return None;
        }
        if self.line.len() < MAX_LINE {
            self.line.push(byte);
            return None;
        }
        self.skipping = true;
        Some(Line::Bad {
            fault: Fault::TooLong,
            bytes: std::mem::take(&mut self.line),
        })
    }

    /// Forgets everything held, as a reset does.
    pub fn clear(&mut self) {
        *self = Self::new();
    }
}

fn read(bytes: Vec<u8>) -> Option<Line> {
    let meant: Vec<u8> = bytes
        .iter()
        .copied()
        .filter(|byte| !matches!(byte, b' ' | b'\r'))
        .collect();
    let (first, number) = meant.split_first()?;
    let command = Letter::from_byte(*first)
        .ok_or(Fault::Malformed)
        .and_then(|letter| read_number(number).map(|tenths| Command { letter, tenths }));
    Some(match command {
        Ok(command) => Line::Command(command),
        Err(fault) => Line::Bad { fault, bytes },
    })
}

/// Digits, perhaps after a minus.
fn read_number(text: &[u8]) -> Result<i32, Fault> {
    let digits = text.strip_prefix(b"-").unwrap_or(text);
    if digits.is_empty() || !digits.iter().all(u8::is_ascii_digit) {
        return Err(Fault::Malformed);
    }
    // Beyond the range it only matters that it stays there.
    let size = digits.iter().fold(0i32, |size, digit| {
        (size * 10 + i32::from(digit - b'0')).min(HIGHEST + 1)
    });
    let number = if digits.len() < text.len() {
        -size
    } else {
        size
    };
    if (LOWEST..=HIGHEST).contains(&number) {
        Ok(number)
    } else {
        Err(Fault::OutOfRange)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(bytes: &[u8]) -> Vec<Line> {
        let mut decoder = Decoder::new();
        bytes
            .iter()
            .filter_map(|&byte| decoder.push(byte))
            .collect()
    }

    fn command(letter: Letter, tenths: i32) -> Line {
        Line::Command(Command { letter, tenths })
    }

    fn bad(fault: Fault, bytes: &[u8]) -> Line {
        Line::Bad {
            fault,
            bytes: bytes.to_vec(),
        }
    }

    #[test]
    fn the_articles_lines() {
        assert_eq!(decode(b"X10 \n"), [command(Letter::X, 10)]);
        let one_revolution = Command {
            letter: Letter::X,
            tenths: 10,
        };
        assert_eq!(one_revolution.encode(), b"X10 \n");
        let report = Report {
            speed: 4,
            mileage: 500,
        };
        assert_eq!(report.encode(), b"V4 S500 \n");
        assert_eq!(Report::parse(b"V4 S500 \n"), Some(report));
        assert_eq!(Report::parse(b"V4 S"), None);
    }

    #[test]
    fn every_letter_and_both_ends_of_the_range() {
        assert_eq!(decode(b"Y-32768\n"), [command(Letter::Y, -32_768)]);
        assert_eq!(decode(b"Z32768\n"), [command(Letter::Z, 32_768)]);
        assert_eq!(decode(b"A0\n"), [command(Letter::A, 0)]);
        assert_eq!(decode(b"B-0007\n"), [command(Letter::B, -7)]);
    }

    #[test]
    fn spaces_and_carriage_returns_are_skipped() {
        assert_eq!(decode(b" X - 1 0\r\n"), [command(Letter::X, -10)]);
        assert_eq!(decode(b"\n \r\n\n"), []);
    }

    #[test]
    fn what_is_no_command_is_told_and_the_next_line_counts() {
        for line in [
            &b"x10"[..],
            b"10",
            b"X",
            b"X-",
            b"X+1",
            b"X1.5",
            b"X1X2",
            b"X--1",
            b"C5",
            b"\xFF\x00",
        ] {
            let bytes = [line, b"\nX1\n"].concat();
            assert_eq!(
                decode(&bytes),
                [bad(Fault::Malformed, line), command(Letter::X, 1)]
            );
        }
        assert_eq!(decode(b"X32769\n"), [bad(Fault::OutOfRange, b"X32769")]);
        assert_eq!(decode(b"X-32769\n"), [bad(Fault::OutOfRange, b"X-32769")]);
        let huge = b"X99999999999999999999";
        assert_eq!(
            decode(&[&huge[..], b"\n"].concat()),
            [bad(Fault::OutOfRange, huge)]
        );
    }

    #[test]
    fn a_line_of_32_bytes_is_read_and_one_more_is_too_many() {
        let fits = format!("X{:031}", 7);
        assert_eq!(
            decode(format!("{fits}\n").as_bytes()),
            [command(Letter::X, 7)]
        );
        let long = format!("{fits}0");
        let found = decode(format!("{long}1234\nX2\n").as_bytes());
        assert_eq!(found[0], bad(Fault::TooLong, fits.as_bytes()));
        assert_eq!(found[1..], [command(Letter::X, 2)]);
        // It is told as soon as it is too long, not when it ends.
        assert_eq!(decode(long.as_bytes()).len(), 1);
    }

    proptest! {
        #[test]
        fn what_is_encoded_decodes(letter in prop::sample::select(&Letter::ALL[..]), tenths in LOWEST..=HIGHEST) {
            let line = Command { letter, tenths };
            prop_assert_eq!(decode(&line.encode()), [Line::Command(line)]);
        }

        #[test]
        fn reports_read_back(speed: i64, mileage: i64) {
            let report = Report { speed, mileage };
            prop_assert_eq!(Report::parse(&report.encode()), Some(report));
        }

        #[test]
        fn any_bytes_give_at_most_one_report_a_line_and_a_good_line_after_them_counts(
            bytes in prop::collection::vec(
                prop_oneof![any::<u8>(), prop::sample::select(&b"XYZAB-0123456789 \r\n"[..])],
                0..300,
            ),
        ) {
            let lines = bytes.iter().filter(|&&byte| byte == b'\n').count() + 1;
            let found = decode(&[&bytes[..], b"\nX42\n"].concat());
            prop_assert!(found.len() <= lines + 1);
            prop_assert_eq!(found.last(), Some(&command(Letter::X, 42)));
        }
    }
}
