//! Streams read a second time, by other code than the decoders': with all bytes at hand, each
//! format is a loop over its description.

use std::ops::Range;

use sim_core::mecanum_device::Link;
use sim_core::mecanum_device::ascii::Syntax;
use sim_core::mecanum_device::codec::Rules;
use sim_core::mecanum_device::settings::{
    AsciiNumbers, AsciiOutOfRange, AsciiSpaces, Framing, PartialPacket,
};
use sim_core::r150_device::settings::Resync;

/// The longest line of the ROS link.
pub(super) const LONGEST: usize = 32;

/// CRC-16/X-25, bit by bit.
fn crc(bytes: &[u8]) -> u16 {
    let mut crc = 0xFFFF_u16;
    for byte in bytes {
        crc ^= u16::from(*byte);
        for _ in 0..8 {
            let carry = crc & 1 == 1;
            crc >>= 1;
            if carry {
                crc ^= 0x8408;
            }
        }
    }
    !crc
}

/// Finds the frames of the R150 in `bytes`.
pub(super) fn frames(bytes: &[u8], resync: Resync) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        if !bytes[at..].starts_with(&[0xAA, 0x55]) {
            at += 1;
            continue;
        }
        let total = bytes
            .get(at + 2)
            .map_or(usize::MAX, |length| 6 + usize::from(*length));
        let frame = bytes[at..].get(..total);
        at += match (frame, resync) {
            (Some(frame), _) if crc(&frame[3..total - 2]).to_le_bytes() == frame[total - 2..] => {
                found.push(at..at + total);
                total
            }
            (_, Resync::SecondByte) => 1,
            (Some(_), Resync::NextFrame) => total,
            (None, Resync::NextFrame) => bytes.len(),
        };
    }
    found
}

/// Tells whether `bytes` are whole frames of the R150, one after the other.
#[must_use]
pub fn frames_cover(bytes: &[u8]) -> bool {
    let frames = frames(bytes, Resync::SecondByte);
    frames.iter().map(ExactSizeIterator::len).sum::<usize>() == bytes.len()
}

/// Finds the packets of one direction in `bytes`.
pub(super) fn packets(bytes: &[u8], headers: &[[u8; 2]], rules: Rules) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(length) = bytes.get(at + 1).map(|length| usize::from(*length)) {
        let known = headers.contains(&[bytes[at], bytes[at + 1]]);
        let begins = match rules.framing {
            Framing::TypeAndLength => known,
            Framing::Length => length >= 3,
        };
        let whole = at + length <= bytes.len();
        if begins && whole && known {
            found.push(at..at + length);
        }
        at += match (begins, whole, rules.partial) {
            (true, true, _) => length,
            (true, false, PartialPacket::Drop) => bytes.len(),
            _ => 1,
        };
    }
    found
}

/// Tells whether `bytes` are what the board sends on this link, whole.
#[must_use]
pub fn sends_well(link: Link, bytes: &[u8]) -> bool {
    match link {
        Link::Main => bytes
            .chunks(39)
            .all(|packet| packet.len() == 39 && packet.starts_with(&[0, 39])),
        Link::Ros => bytes.split_inclusive(|byte| *byte == b'\n').all(is_report),
    }
}

/// `V4 S500 \n`
fn is_report(line: &[u8]) -> bool {
    let is_number = |text: &str| {
        let digits = text.strip_prefix('-').unwrap_or(text);
        !digits.is_empty() && digits.bytes().all(|byte| byte.is_ascii_digit())
    };
    let numbers = std::str::from_utf8(line).ok().and_then(|line| {
        line.strip_prefix('V')?
            .strip_suffix(" \n")?
            .split_once(" S")
    });
    numbers.is_some_and(|(speed, mileage)| is_number(speed) && is_number(mileage))
}

/// Reading of a line: the line, if it is a bad one, and the letter and number of a command that
/// comes of it.
pub(super) type Line<'b> = (Option<&'b [u8]>, Option<(u8, i32)>);

/// Reads the lines in `bytes`.
pub(super) fn lines(bytes: &[u8], syntax: Syntax) -> Vec<Line<'_>> {
    let mut lines = bytes.split(|byte| *byte == b'\n');
    let last = lines.next_back().unwrap_or_default();
    let told = lines.filter_map(|bytes| line(bytes, syntax));
    // A line that goes on counts only once it is too long.
    let begun = (last.len() > LONGEST).then(|| line(last, syntax)).flatten();
    told.chain(begun).collect()
}

/// Meaning of a line without its end; nothing of a blank one.
fn line(bytes: &[u8], syntax: Syntax) -> Option<Line<'_>> {
    if bytes.len() > LONGEST {
        return Some((Some(&bytes[..LONGEST]), None));
    }
    let meant: String = bytes.iter().copied().map(char::from).collect();
    let meant = match syntax.spaces {
        AsciiSpaces::Anywhere => meant.replace([' ', '\r'], ""),
        AsciiSpaces::Trailing => meant.trim_end_matches([' ', '\r']).to_owned(),
    };
    let Some(first) = meant.chars().next() else {
        return syntax.blank_is_bad.then_some((Some(bytes), None));
    };
    let number = &meant[first.len_utf8()..];
    let first = match first {
        'x' | 'y' | 'z' | 'a' | 'b' if syntax.lower_case => first.to_ascii_uppercase(),
        _ => first,
    };
    let number = match syntax.numbers {
        // A plus sign is no part of the article's numbers.
        AsciiNumbers::Strict if number.starts_with('+') => None,
        AsciiNumbers::Strict => number.parse::<i128>().ok(),
        AsciiNumbers::Atoi => {
            let signed = number.strip_prefix(['+', '-']).unwrap_or(number);
            let end = signed.find(|c: char| !c.is_ascii_digit());
            let digits = &signed[..end.unwrap_or(signed.len())];
            let size = digits.parse::<i128>().unwrap_or(0);
            Some(if number.starts_with('-') { -size } else { size })
        }
    };
    let letter = u8::try_from(first)
        .ok()
        .filter(|letter| b"XYZAB".contains(letter));
    let command = letter.zip(number);
    let cut = command.map(|(letter, number)| (letter, number.clamp(-32_768, 32_768)));
    let shown = |(letter, number)| i32::try_from(number).ok().map(|number| (letter, number));
    Some(if cut == command && command.is_some() {
        (None, cut.and_then(shown))
    } else if syntax.out_of_range == AsciiOutOfRange::Clamp {
        (Some(bytes), cut.and_then(shown))
    } else {
        (Some(bytes), None)
    })
}
