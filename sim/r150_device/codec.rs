//! The frame of the R150 IO module (manual section 4.2): streaming decoder and encoder.
//!
//! ```text
//! AA 55 | len | command | len parameter bytes | CRC-16 of command and parameters, low byte first
//! ```
//!
//! The appendix of the manual gives the CRC as a table and a routine; they are CRC-16/IBM-SDLC,
//! also named X-25.

use std::time::Duration;

use crc::{CRC_16_IBM_SDLC, Crc, Table};

use crate::scanner::{Format, Read, Scanner};

/// First byte of every frame.
pub const HEADER: [u8; 2] = [0xAA, 0x55];
/// Bytes of a frame beside its parameters: header, length, command, CRC.
pub const OVERHEAD: usize = 6;
/// Index of the command byte in a frame.
pub const COMMAND_AT: usize = 3;
/// The longest frame: 255 parameter bytes.
pub const MAX_FRAME: usize = OVERHEAD + 255;

static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_IBM_SDLC);

/// The CRC over a command and its parameters.
#[must_use]
pub fn checksum(command: u8, parameters: &[u8]) -> u16 {
    let mut digest = CRC.digest();
    digest.update(&[command]);
    digest.update(parameters);
    digest.finalize()
}

/// A whole frame around a command and its parameters.
///
/// # Panics
/// Never for the commands of this protocol; more than 255 parameter bytes do not fit the frame and
/// are cut, which a debug build asserts against.
#[must_use]
pub fn encode(command: u8, parameters: &[u8]) -> Vec<u8> {
    debug_assert!(
        parameters.len() <= 255,
        "a frame holds at most 255 parameter bytes"
    );
    let length = u8::try_from(parameters.len()).unwrap_or(u8::MAX);
    let parameters = &parameters[..usize::from(length)];
    let mut frame = Vec::with_capacity(OVERHEAD + parameters.len());
    frame.extend_from_slice(&HEADER);
    frame.extend_from_slice(&[length, command]);
    frame.extend_from_slice(parameters);
    frame.extend_from_slice(&checksum(command, parameters).to_le_bytes());
    frame
}

/// A frame whose CRC is right; what it means is the command layer's business.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Frame(Vec<u8>);

impl Frame {
    /// The whole frame as received.
    #[must_use]
    pub fn bytes(&self) -> &[u8] {
        &self.0
    }

    /// Command byte.
    #[must_use]
    pub fn command(&self) -> u8 {
        self.0[COMMAND_AT]
    }

    /// Parameter bytes, 0 to 255 of them.
    #[must_use]
    pub fn parameters(&self) -> &[u8] {
        parameters(&self.0).unwrap_or_default()
    }
}

/// The parameter bytes of a whole frame.
#[must_use]
pub fn parameters(frame: &[u8]) -> Option<&[u8]> {
    frame.get(COMMAND_AT + 1..frame.len().checked_sub(2)?)
}

/// Finding of the decoder in the stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decoded {
    /// A frame with the right CRC.
    Frame(Frame),
    /// A complete frame whose CRC is wrong.
    BadCrc {
        /// The whole frame as received.
        bytes: Vec<u8>,
        /// Its command byte.
        command: u8,
        /// The CRC that its command and parameters have.
        expected: u16,
    },
    /// A frame that was begun and not finished in time.
    Partial(Vec<u8>),
    /// Bytes outside any frame.
    Noise(Vec<u8>),
}

/// Streaming decoder of frames.
pub type Decoder = Scanner<Frames>;

impl Decoder {
    /// A decoder that drops a partial frame after `inter_byte_timeout` of silence.
    #[must_use]
    pub const fn new(inter_byte_timeout: Duration) -> Self {
        Self::of(Frames, inter_byte_timeout)
    }
}

/// The form of frames.
#[derive(Debug, Clone, Copy)]
pub struct Frames;

impl Format for Frames {
    type Decoded = Decoded;

    fn may_begin(&self, bytes: &[u8]) -> bool {
        bytes[0] == HEADER[0] && bytes.get(1).is_none_or(|next| *next == HEADER[1])
    }

    fn read(&self, bytes: &[u8]) -> Read<Decoded> {
        let [_, _, length, command, rest @ ..] = bytes else {
            return Read::Begun;
        };
        let length = usize::from(*length);
        let Some((parameters, [low, high, ..])) = rest.split_at_checked(length) else {
            return Read::Begun;
        };
        let expected = checksum(*command, parameters);
        let total = OVERHEAD + length;
        let frame = bytes[..total].to_vec();
        if u16::from_le_bytes([*low, *high]) == expected {
            return Read::Whole(total, Decoded::Frame(Frame(frame)));
        }
        let bad = Decoded::BadCrc {
            bytes: frame,
            command: *command,
            expected,
        };
        Read::Wrong(total, bad)
    }

    fn partial(bytes: Vec<u8>) -> Decoded {
        Decoded::Partial(bytes)
    }

    fn noise(bytes: Vec<u8>) -> Decoded {
        Decoded::Noise(bytes)
    }
}

#[cfg(test)]
mod tests;
