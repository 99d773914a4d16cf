//! The R150's frames, written from the manual and sharing no code with the program under test, so
//! that a mistake in its codec is not repeated here.

/// Frame bytes around the parameters.
const OVERHEAD: usize = 6;

/// CRC-16/X-25, bit by bit.
pub fn crc(bytes: &[u8]) -> u16 {
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

/// A whole frame.
pub fn frame(command: u8, parameters: &[u8]) -> Vec<u8> {
    let length = u8::try_from(parameters.len()).unwrap();
    let mut bytes = vec![0xAA, 0x55, length, command];
    bytes.extend(parameters);
    let crc = crc(&bytes[3..]);
    bytes.extend(crc.to_le_bytes());
    bytes
}

/// A set-motors request, both in 0.1 %.
pub fn motors(right: i16, left: i16) -> Vec<u8> {
    frame(0x12, &[right.to_le_bytes(), left.to_le_bytes()].concat())
}

/// What stands at the beginning of a stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Parsed {
    /// A valid frame and its length.
    Frame(u8, Vec<u8>, usize),
    /// The beginning of one.
    Partial,
    /// Something else.
    Invalid,
}

/// Parses the beginning of `bytes`.
pub fn parse(bytes: &[u8]) -> Parsed {
    let header = [0xAA, 0x55];
    let begun = bytes.len().min(2);
    if bytes[..begun] != header[..begun] {
        return Parsed::Invalid;
    }
    let Some(length) = bytes.get(2) else {
        return Parsed::Partial;
    };
    let total = OVERHEAD + usize::from(*length);
    let Some(whole) = bytes.get(..total) else {
        return Parsed::Partial;
    };
    let (body, trailer) = whole[3..].split_at(total - 5);
    if crc(body).to_le_bytes() == trailer {
        Parsed::Frame(body[0], body[1..].to_vec(), total)
    } else {
        Parsed::Invalid
    }
}

/// Whether a valid frame stands anywhere in `bytes`.
pub fn holds_frame(bytes: &[u8]) -> bool {
    (0..bytes.len()).any(|at| matches!(parse(&bytes[at..]), Parsed::Frame(..)))
}

/// The little-endian word at a byte offset.
pub fn u32_at(bytes: &[u8], at: usize) -> u32 {
    u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
}

/// The little-endian signed half-word at a byte offset.
pub fn i16_at(bytes: &[u8], at: usize) -> i16 {
    i16::from_le_bytes(bytes[at..at + 2].try_into().unwrap())
}

#[test]
fn the_reference_frames_come_out() {
    assert_eq!(crc(b"123456789"), 0x906E);
    assert_eq!(frame(0x07, &[]), [0xAA, 0x55, 0, 0x07, 0xC7, 0x84]);
    assert_eq!(frame(0xF0, &[]), [0xAA, 0x55, 0, 0xF0, 0xF7, 0x07]);
    assert_eq!(frame(0x06, &[]), [0xAA, 0x55, 0, 0x06, 0x4E, 0x95]);
    let full = [0xAA, 0x55, 4, 0x12, 0xE8, 0x03, 0xE8, 0x03, 0x4B, 0xC6];
    assert_eq!(motors(1000, 1000), full);
    assert_eq!(parse(&full), Parsed::Frame(0x12, full[4..8].to_vec(), 10));
}
