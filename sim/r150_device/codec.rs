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
use sim_settings::SimTime;

use super::settings::Resync;

/// First byte of every frame.
pub const HEADER: [u8; 2] = [0xAA, 0x55];
/// Bytes of a frame beside its parameters: header, length, command, CRC.
pub const OVERHEAD: usize = 6;
/// The longest frame: 255 parameter bytes.
pub const MAX_FRAME: usize = OVERHEAD + 255;
/// Noise is reported in runs of at most this many bytes.
const NOISE_RUN: usize = 64;

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
pub struct Frame {
    /// Command byte.
    pub command: u8,
    /// Parameter bytes, 0 to 255 of them.
    pub parameters: Vec<u8>,
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

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// After a frame with a wrong CRC, and after a partial frame older than the inter-byte timeout, it
/// resumes at that frame's second byte ([`Resync::SecondByte`]), so a valid frame inside what
/// looked like parameters is never lost. A frame with the right CRC is never looked into. Bytes
/// that one such report has covered are not reported again, so the reports of a stream are no
/// longer than the stream.
#[derive(Debug, Clone)]
pub struct Decoder {
    inter_byte_timeout: Duration,
    resync: Resync,
    /// Bytes from the first that may begin a frame; shorter than [`MAX_FRAME`].
    buffer: Vec<u8>,
    /// Number of bytes at the front of `buffer` that a report has covered already.
    reported: usize,
    noise: Vec<u8>,
    last_byte: SimTime,
}

impl Decoder {
    /// A decoder that drops a partial frame after `inter_byte_timeout` of silence, and goes on
    /// after it or a bad one as `resync` says.
    #[must_use]
    pub fn new(inter_byte_timeout: Duration, resync: Resync) -> Self {
        Self {
            inter_byte_timeout,
            resync,
            buffer: Vec::with_capacity(MAX_FRAME),
            reported: 0,
            noise: Vec::new(),
            last_byte: SimTime::ZERO,
        }
    }

    /// Takes one byte; hands whatever it completes to `found`.
    pub fn push(&mut self, now: SimTime, byte: u8, found: &mut impl FnMut(Decoded)) {
        self.last_byte = now;
        self.buffer.push(byte);
        self.scan(found);
    }

    /// Time at which the bytes held so far are given up, unless more come.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        (!self.buffer.is_empty() || !self.noise.is_empty())
            .then(|| self.last_byte + self.inter_byte_timeout)
    }

    /// Gives up what is held if its deadline is `now` or earlier.
    pub fn expire(&mut self, now: SimTime, found: &mut impl FnMut(Decoded)) {
        if self.deadline().is_some_and(|deadline| deadline <= now) {
            self.give_up(found);
        }
    }

    /// Gives up what is held, whatever the time: no more bytes come of whoever sent it.
    pub fn give_up(&mut self, found: &mut impl FnMut(Decoded)) {
        // Every round takes at least one byte off a buffer of at most 261.
        while !self.buffer.is_empty() {
            if self.reported == 0 {
                self.flush_noise(found);
                found(Decoded::Partial(self.buffer.clone()));
                self.reported = self.buffer.len();
            }
            self.skip_bad(self.buffer.len(), found);
            self.scan(found);
        }
        self.flush_noise(found);
    }

    /// Forgets everything held, as a reset does.
    pub fn clear(&mut self) {
        self.buffer.clear();
        self.noise.clear();
        self.reported = 0;
    }

    /// Takes complete frames and noise off the buffer until it holds a possible beginning only.
    fn scan(&mut self, found: &mut impl FnMut(Decoded)) {
        loop {
            let start = self.possible_start();
            self.skip(start, found);
            let [_, _, length, command, rest @ ..] = self.buffer.as_slice() else {
                return;
            };
            let length = usize::from(*length);
            let Some((parameters, trailer)) = rest.split_at_checked(length) else {
                return;
            };
            let [low, high, ..] = trailer else { return };
            let expected = checksum(*command, parameters);
            let total = OVERHEAD + length;
            if u16::from_le_bytes([*low, *high]) == expected {
                let frame = Frame {
                    command: *command,
                    parameters: parameters.to_vec(),
                };
                self.flush_noise(found);
                self.buffer.drain(..total);
                self.reported = self.reported.saturating_sub(total);
                found(Decoded::Frame(frame));
            } else {
                if self.reported == 0 {
                    let bad = Decoded::BadCrc {
                        bytes: self.buffer[..total].to_vec(),
                        command: *command,
                        expected,
                    };
                    self.flush_noise(found);
                    found(bad);
                    self.reported = total;
                }
                self.skip_bad(total, found);
            }
        }
    }

    /// Index of the first byte at which a frame may begin.
    fn possible_start(&self) -> usize {
        let bytes = &self.buffer;
        (0..bytes.len())
            .find(|&at| {
                bytes[at] == HEADER[0] && bytes.get(at + 1).is_none_or(|next| *next == HEADER[1])
            })
            .unwrap_or(bytes.len())
    }

    /// Leaves a bad frame of `total` bytes at the front behind.
    fn skip_bad(&mut self, total: usize, found: &mut impl FnMut(Decoded)) {
        let count = match self.resync {
            Resync::SecondByte => 1,
            Resync::NextFrame => total,
        };
        self.skip(count, found);
    }

    /// Drops `count` bytes from the front; those that no report has covered are noise.
    fn skip(&mut self, count: usize, found: &mut impl FnMut(Decoded)) {
        let silent = count.min(self.reported);
        self.reported -= silent;
        self.noise.extend_from_slice(&self.buffer[silent..count]);
        self.buffer.drain(..count);
        if self.noise.len() >= NOISE_RUN {
            self.flush_noise(found);
        }
    }

    fn flush_noise(&mut self, found: &mut impl FnMut(Decoded)) {
        if !self.noise.is_empty() {
            found(Decoded::Noise(std::mem::take(&mut self.noise)));
        }
    }
}

#[cfg(test)]
mod tests;
