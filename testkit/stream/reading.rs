//! Streams read a second time, by other code than the decoders': with all bytes at hand, each
//! format is a loop over its description.

use std::ops::Range;

use rigsim_core::mecanum_device::Link;

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
pub(super) fn frames(bytes: &[u8]) -> Vec<Range<usize>> {
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
        at += match frame {
            Some(frame) if crc(&frame[3..total - 2]).to_le_bytes() == frame[total - 2..] => {
                found.push(at..at + total);
                total
            }
            _ => 1,
        };
    }
    found
}

/// Returns whether `bytes` are whole frames of the R150, one after the other.
pub(super) fn frames_cover(bytes: &[u8]) -> bool {
    let frames = frames(bytes);
    frames.iter().map(ExactSizeIterator::len).sum::<usize>() == bytes.len()
}

/// Finds the packets of one direction in `bytes`.
pub(super) fn packets(bytes: &[u8], headers: &[[u8; 2]]) -> Vec<Range<usize>> {
    let mut found = Vec::new();
    let mut at = 0;
    while let Some(length) = bytes.get(at + 1).map(|length| usize::from(*length)) {
        let known = headers.contains(&[bytes[at], bytes[at + 1]]);
        at += if known && at + length <= bytes.len() {
            found.push(at..at + length);
            length
        } else {
            1
        };
    }
    found
}

/// Returns whether `bytes` are what the board sends on this link, whole.
pub(super) fn sends_well(link: Link, bytes: &[u8]) -> bool {
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

/// Reading of a line: the letter and number of a command, or the bytes of a bad line.
pub(super) type Line<'b> = Result<(u8, i32), &'b [u8]>;

/// Reads the lines in `bytes`.
pub(super) fn lines(bytes: &[u8]) -> Vec<Line<'_>> {
    let mut lines = bytes.split(|byte| *byte == b'\n');
    let last = lines.next_back().unwrap_or_default();
    let whole = lines.filter_map(line);
    // A line that goes on counts only once it is too long.
    let begun = (last.len() > LONGEST).then(|| line(last)).flatten();
    whole.chain(begun).collect()
}

/// Meaning of a line without its end; nothing of a blank one.
fn line(bytes: &[u8]) -> Option<Line<'_>> {
    if bytes.len() > LONGEST {
        return Some(Err(&bytes[..LONGEST]));
    }
    let meant: String = bytes.iter().copied().map(char::from).collect();
    let meant = meant.replace([' ', '\r'], "");
    let first = meant.chars().next()?;
    let number = &meant[first.len_utf8()..];
    // A plus sign is not part of the article's numbers.
    let number = number
        .parse::<i32>()
        .ok()
        .filter(|_| !number.starts_with('+'));
    let number = number.filter(|number| (-32_768..=32_768).contains(number));
    let letter = u8::try_from(first).ok();
    let letter = letter.filter(|letter| b"XYZAB".contains(letter));
    Some(letter.zip(number).ok_or(bytes))
}
