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

use crate::scanner::{Form, Scanner};

/// First byte of every frame.
pub const HEADER: [u8; 2] = [0xAA, 0x55];
/// Bytes of a frame beside its parameters: header, length, command, CRC.
pub const OVERHEAD: usize = 6;
/// Index of the command byte in a frame.
pub const COMMAND_AT: usize = 3;

static CRC: Crc<u16, Table<16>> = Crc::<u16, Table<16>>::new(&CRC_16_IBM_SDLC);

/// The CRC over bytes.
#[must_use]
pub fn crc(bytes: &[u8]) -> u16 {
    CRC.checksum(bytes)
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
    frame.extend_from_slice(&crc(&frame[COMMAND_AT..]).to_le_bytes());
    frame
}

/// The form of frames.
pub const FORM: Form = Form::Frames {
    header: &HEADER,
    length_at: 2,
    uncounted: OVERHEAD,
    id_at: COMMAND_AT,
    answers: Some(0x80),
    fields_at: COMMAND_AT + 1,
    check: Some(crc),
};

/// A decoder that drops a partial frame after `inter_byte_timeout` of silence.
#[must_use]
pub fn decoder(inter_byte_timeout: Duration) -> Scanner {
    Scanner::new(FORM, [], inter_byte_timeout)
}

/// The command byte of a whole frame, and its parameter bytes; `None` if it is none.
#[must_use]
pub fn parts(frame: &[u8]) -> Option<(u8, &[u8])> {
    let parameters = frame.get(COMMAND_AT + 1..frame.len().checked_sub(2)?)?;
    Some((frame[COMMAND_AT], parameters))
}

/// The CRC that a whole frame should have.
#[must_use]
pub fn expected(frame: &[u8]) -> u16 {
    let covered = COMMAND_AT..frame.len().saturating_sub(2);
    crc(frame.get(covered).unwrap_or_default())
}

#[cfg(test)]
mod tests;
