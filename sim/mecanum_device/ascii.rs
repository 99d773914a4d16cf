//! The lines of the ROS link (article, control by a ROS system).
//!
//! ```text
//! client to board: letter, number, \n     X10 \n
//! board to client: V number S number \n   V4 S500 \n
//! ```

use std::fmt;

use super::settings::{AsciiNumbers, AsciiOutOfRange, AsciiSpaces, MecanumFirmwareSettings};

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
    /// Motion.
    pub letter: Letter,
    /// Distance, and its sign.
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

/// Reason for which a line is no command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LineError {
    /// Neither a letter of a command nor a number after it.
    Malformed,
    /// The number is beyond its range.
    OutOfRange,
    /// Longer than a line may be; the bytes are its beginning.
    TooLong,
    /// There is nothing on it.
    Blank,
}

/// Rules of what is a command.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Syntax {
    /// Small letters are commands too.
    pub lower_case: bool,
    /// Reading of a number.
    pub numbers: AsciiNumbers,
    /// Places where spaces and carriage returns are skipped.
    pub spaces: AsciiSpaces,
    /// A line with nothing on it is told of.
    pub blank_is_bad: bool,
    /// The longest line, without its `\n`.
    pub longest: usize,
    /// Reading of a number beyond its range.
    pub out_of_range: AsciiOutOfRange,
}

impl Syntax {
    /// As the settings have it.
    #[must_use]
    pub fn of(settings: &MecanumFirmwareSettings) -> Self {
        Self {
            lower_case: settings.ascii_lower_case,
            numbers: settings.ascii_numbers,
            spaces: settings.ascii_spaces,
            blank_is_bad: settings.ascii_blank_is_bad,
            longest: usize::try_from(settings.ascii_line_length).unwrap_or(usize::MAX),
            out_of_range: settings.ascii_out_of_range,
        }
    }
}

impl Default for Syntax {
    fn default() -> Self {
        Self::of(&MecanumFirmwareSettings::default())
    }
}

/// Meaning of a line.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Line {
    /// A command.
    Command(Command),
    /// None, or not a good one.
    Bad {
        /// Error of it.
        error: LineError,
        /// The line without its `\n`.
        bytes: Vec<u8>,
        /// The command that it is taken for all the same.
        taken_for: Option<Command>,
    },
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// A line that is too long is told of once, when it becomes so.
#[derive(Debug, Clone, Default)]
pub struct Decoder {
    syntax: Syntax,
    /// The line so far, no longer than one may be.
    line: Vec<u8>,
    /// The rest of the line was told of already.
    skipping: bool,
}

impl Decoder {
    /// At the beginning of a line.
    #[must_use]
    pub fn new(syntax: Syntax) -> Self {
        Self {
            syntax,
            line: Vec::new(),
            skipping: false,
        }
    }

    /// Takes one byte; gives what it completes.
    pub fn push(&mut self, byte: u8) -> Option<Line> {
        if byte == b'\n' {
            let line = std::mem::take(&mut self.line);
            let skipped = std::mem::take(&mut self.skipping);
            return if skipped {
                None
            } else {
                self.syntax.read(line)
            };
        }
        if self.skipping {
            return None;
        }
        if self.line.len() < self.syntax.longest {
            self.line.push(byte);
            return None;
        }
        self.skipping = true;
        Some(Line::Bad {
            error: LineError::TooLong,
            bytes: std::mem::take(&mut self.line),
            taken_for: None,
        })
    }

    /// Forgets everything held, as a reset does.
    pub fn clear(&mut self) {
        *self = Self::new(self.syntax);
    }
}

impl Syntax {
    fn read(&self, bytes: Vec<u8>) -> Option<Line> {
        let is_space = |byte: &u8| matches!(byte, b' ' | b'\r');
        let mut meant = bytes.clone();
        match self.spaces {
            AsciiSpaces::Anywhere => meant.retain(|byte| !is_space(byte)),
            AsciiSpaces::Trailing => {
                let end = meant.iter().rposition(|byte| !is_space(byte));
                meant.truncate(end.map_or(0, |last| last + 1));
            }
        }
        let bad = |error, taken_for| {
            Some(Line::Bad {
                error,
                bytes: bytes.clone(),
                taken_for,
            })
        };
        let Some((first, number)) = meant.split_first() else {
            return self
                .blank_is_bad
                .then(|| bad(LineError::Blank, None))
                .flatten();
        };
        let first = if self.lower_case {
            first.to_ascii_uppercase()
        } else {
            *first
        };
        let number = self.number(number);
        let (Some(letter), Some(number)) = (Letter::from_byte(first), number) else {
            return bad(LineError::Malformed, None);
        };
        let tenths = number.clamp(LOWEST, HIGHEST);
        let command = Command { letter, tenths };
        if tenths == number {
            Some(Line::Command(command))
        } else {
            let clamps = self.out_of_range == AsciiOutOfRange::Clamp;
            bad(LineError::OutOfRange, clamps.then_some(command))
        }
    }

    /// A number, held one beyond its range; `None` if this is none.
    fn number(&self, text: &[u8]) -> Option<i32> {
        let (negative, digits) = match (text.split_first(), self.numbers) {
            (Some((b'-', rest)), _) => (true, rest),
            (Some((b'+', rest)), AsciiNumbers::Atoi) => (false, rest),
            _ => (false, text),
        };
        let count = digits
            .iter()
            .take_while(|byte| byte.is_ascii_digit())
            .count();
        let (digits, rest) = digits.split_at(count);
        if self.numbers == AsciiNumbers::Strict && (digits.is_empty() || !rest.is_empty()) {
            return None;
        }
        // Beyond the range it only matters that it stays there.
        let size = digits.iter().fold(0i32, |size, digit| {
            (size * 10 + i32::from(digit - b'0')).min(HIGHEST + 1)
        });
        Some(if negative { -size } else { size })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn decode(bytes: &[u8]) -> Vec<Line> {
        decode_by(Syntax::default(), bytes)
    }

    fn decode_by(syntax: Syntax, bytes: &[u8]) -> Vec<Line> {
        let mut decoder = Decoder::new(syntax);
        bytes
            .iter()
            .filter_map(|&byte| decoder.push(byte))
            .collect()
    }

    fn command(letter: Letter, tenths: i32) -> Line {
        Line::Command(Command { letter, tenths })
    }

    fn bad(error: LineError, bytes: &[u8]) -> Line {
        Line::Bad {
            error,
            bytes: bytes.to_vec(),
            taken_for: None,
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
                [bad(LineError::Malformed, line), command(Letter::X, 1)]
            );
        }
        assert_eq!(decode(b"X32769\n"), [bad(LineError::OutOfRange, b"X32769")]);
        assert_eq!(
            decode(b"X-32769\n"),
            [bad(LineError::OutOfRange, b"X-32769")]
        );
        let huge = b"X99999999999999999999";
        assert_eq!(
            decode(&[&huge[..], b"\n"].concat()),
            [bad(LineError::OutOfRange, huge)]
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
        assert_eq!(found[0], bad(LineError::TooLong, fits.as_bytes()));
        assert_eq!(found[1..], [command(Letter::X, 2)]);
        // It is told as soon as it is too long, not when it ends.
        assert_eq!(decode(long.as_bytes()).len(), 1);
    }

    #[test]
    fn small_letters_count_where_they_may() {
        let syntax = Syntax {
            lower_case: true,
            ..Syntax::default()
        };
        assert_eq!(decode_by(syntax, b"x10\n"), [command(Letter::X, 10)]);
        assert_eq!(decode_by(syntax, b"Z1\n"), [command(Letter::Z, 1)]);
        assert_eq!(
            decode_by(syntax, b"q1\n"),
            [bad(LineError::Malformed, b"q1")]
        );
    }

    #[test]
    fn numbers_as_atoi_reads_them() {
        let syntax = Syntax {
            numbers: AsciiNumbers::Atoi,
            ..Syntax::default()
        };
        for (line, tenths) in [
            (&b"X+10"[..], 10),
            (b"X10", 10),
            (b"X-10", -10),
            (b"X1.5", 1),
            (b"X7Y3", 7),
            (b"X", 0),
            (b"X--1", 0),
            (b"X+", 0),
        ] {
            let line = [line, b"\n"].concat();
            assert_eq!(decode_by(syntax, &line), [command(Letter::X, tenths)]);
        }
        assert_eq!(
            decode_by(syntax, b"X40000\n"),
            [bad(LineError::OutOfRange, b"X40000")]
        );
    }

    #[test]
    fn spaces_may_be_allowed_at_the_end_only() {
        let syntax = Syntax {
            spaces: AsciiSpaces::Trailing,
            ..Syntax::default()
        };
        assert_eq!(decode_by(syntax, b"X10 \r\n"), [command(Letter::X, 10)]);
        for line in [&b" X10"[..], b"X 10", b"X1 0"] {
            let ended = [line, b"\n"].concat();
            assert_eq!(decode_by(syntax, &ended), [bad(LineError::Malformed, line)]);
        }
    }

    #[test]
    fn a_line_with_nothing_on_it_may_be_told() {
        let syntax = Syntax {
            blank_is_bad: true,
            ..Syntax::default()
        };
        let found = decode_by(syntax, b"\n \r\nX1\n");
        assert_eq!(
            found,
            [
                bad(LineError::Blank, b""),
                bad(LineError::Blank, b" \r"),
                command(Letter::X, 1)
            ]
        );
    }

    #[test]
    fn the_longest_line_is_as_long_as_said() {
        let syntax = Syntax {
            longest: 4,
            ..Syntax::default()
        };
        assert_eq!(decode_by(syntax, b"X-12\n"), [command(Letter::X, -12)]);
        let found = decode_by(syntax, b"X-123\nX1\n");
        assert_eq!(
            found,
            [bad(LineError::TooLong, b"X-12"), command(Letter::X, 1)]
        );
    }

    #[test]
    fn numbers_beyond_the_range_may_be_held_in_it() {
        let syntax = Syntax {
            out_of_range: AsciiOutOfRange::Clamp,
            ..Syntax::default()
        };
        for (line, tenths) in [(&b"B99999"[..], HIGHEST), (b"B-99999", LOWEST)] {
            let ended = [line, b"\n"].concat();
            let letter = Letter::B;
            let taken_for = Some(Command { letter, tenths });
            let bad = Line::Bad {
                error: LineError::OutOfRange,
                bytes: line.to_vec(),
                taken_for,
            };
            assert_eq!(decode_by(syntax, &ended), [bad]);
        }
        assert_eq!(decode_by(syntax, b"B-5\n"), [command(Letter::B, -5)]);
    }

    fn syntaxes() -> impl Strategy<Value = Syntax> {
        let numbers = prop::sample::select(AsciiNumbers::ALL);
        let spaces = prop::sample::select(AsciiSpaces::ALL);
        let range = prop::sample::select(AsciiOutOfRange::ALL);
        let flags = (any::<bool>(), any::<bool>(), 2usize..40);
        (numbers, spaces, range, flags).prop_map(|(numbers, spaces, out_of_range, flags)| Syntax {
            lower_case: flags.0,
            blank_is_bad: flags.1,
            longest: flags.2,
            numbers,
            spaces,
            out_of_range,
        })
    }

    proptest! {
        #[test]
        fn by_any_syntax_a_good_line_after_anything_counts(
            syntax in syntaxes(),
            bytes in prop::collection::vec(
                prop_oneof![any::<u8>(), prop::sample::select(&b"XYZABxyzab+-0123456789 \r\n"[..])],
                0..300,
            ),
        ) {
            let lines = bytes.iter().filter(|&&byte| byte == b'\n').count() + 1;
            let found = decode_by(syntax, &[&bytes[..], b"\nX4\n"].concat());
            prop_assert!(found.len() <= lines + 1);
            prop_assert_eq!(found.last(), Some(&command(Letter::X, 4)));
        }

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
