//! The stream of the mecanum board's main link: packets without header or checksum.
//!
//! ```text
//! cmd_type | pkg_length | seq | fields; pkg_length counts the whole packet
//! ```
//!
//! All that tells a packet from noise is that a known type is followed by the length which that
//! type has. The article names neither a byte order nor a way to find the beginning of a packet
//! again; both are our assumptions, and [`Rules`] has the alternatives.

use std::time::Duration;

use sim_settings::SimTime;

use super::settings::{ByteOrder, Framing, PartialPacket};

/// Noise is reported in runs of at most this many bytes.
const NOISE_RUN: usize = 64;

/// Packet that travels in one direction of the link.
pub trait Packet: Sized {
    /// Type and length of every packet of this direction; lengths are at least 3.
    const HEADERS: &'static [[u8; 2]];

    /// Reads a whole packet, fields little-endian; `None` if type or length is none of this
    /// direction's.
    fn parse(bytes: &[u8]) -> Option<Self>;

    /// Widths in bytes of the fields after the third byte, for a type of this direction.
    fn widths(kind: u8) -> &'static [usize];

    /// Turns the bytes of a packet of this direction from little-endian into `order`, or back.
    fn reorder(bytes: &mut [u8], order: ByteOrder) {
        let (Some(&kind), ByteOrder::Big) = (bytes.first(), order) else {
            return;
        };
        let mut fields = bytes.get_mut(3..).unwrap_or_default();
        for width in Self::widths(kind) {
            let Some((field, rest)) = fields.split_at_mut_checked(*width) else {
                return;
            };
            field.reverse();
            fields = rest;
        }
    }
}

/// Rules by which the stream is read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rules {
    /// A packet that was begun is given up after so much silence.
    pub inter_byte_timeout: Duration,
    /// Mark of a packet's beginning.
    pub framing: Framing,
    /// Fate of the bytes of a packet that was given up.
    pub partial: PartialPacket,
    /// Order of the bytes in a field.
    pub order: ByteOrder,
}

impl Rules {
    /// Those of the default settings, with this timeout.
    #[must_use]
    pub fn new(inter_byte_timeout: Duration) -> Self {
        Self {
            inter_byte_timeout,
            framing: Framing::TypeAndLength,
            partial: PartialPacket::Rescan,
            order: ByteOrder::Little,
        }
    }
}

/// Finding of the decoder in the stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decoded<P> {
    /// A whole packet.
    Packet(P),
    /// A packet that was begun and not finished in time.
    Partial(Vec<u8>),
    /// Bytes that begin no packet.
    Noise(Vec<u8>),
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// By default a byte that begins no packet is skipped, and after a partial packet older than the
/// inter-byte timeout it resumes at that packet's second byte, so that a packet behind a torn one
/// is never lost; the torn one's bytes are not reported again.
#[derive(Debug, Clone)]
pub struct Decoder<P> {
    rules: Rules,
    /// Bytes from the first that may begin a packet; fewer than a length byte can say.
    buffer: Vec<u8>,
    /// Number of bytes at the front of `buffer` that a report has covered already.
    reported: usize,
    noise: Vec<u8>,
    last_byte: SimTime,
    direction: std::marker::PhantomData<P>,
}

impl<P: Packet> Decoder<P> {
    /// A decoder by the default rules, which drops a partial packet after `inter_byte_timeout` of
    /// silence.
    #[must_use]
    pub fn new(inter_byte_timeout: Duration) -> Self {
        Self::by(Rules::new(inter_byte_timeout))
    }

    /// A decoder by these rules.
    #[must_use]
    pub fn by(rules: Rules) -> Self {
        Self {
            rules,
            buffer: Vec::new(),
            reported: 0,
            noise: Vec::new(),
            last_byte: SimTime::ZERO,
            direction: std::marker::PhantomData,
        }
    }

    /// Takes one byte; hands whatever it completes to `found`.
    pub fn push(&mut self, now: SimTime, byte: u8, found: &mut impl FnMut(Decoded<P>)) {
        self.last_byte = now;
        self.buffer.push(byte);
        self.scan(found);
    }

    /// Time at which the bytes held so far are given up, unless more come.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        (!self.buffer.is_empty() || !self.noise.is_empty())
            .then(|| self.last_byte + self.rules.inter_byte_timeout)
    }

    /// Gives up what is held if its deadline is `now` or earlier.
    pub fn expire(&mut self, now: SimTime, found: &mut impl FnMut(Decoded<P>)) {
        if self.deadline().is_none_or(|deadline| deadline > now) {
            return;
        }
        // Every round takes at least one byte off a buffer shorter than a packet.
        while !self.buffer.is_empty() {
            if self.reported == 0 {
                self.flush_noise(found);
                found(Decoded::Partial(self.buffer.clone()));
                self.reported = self.buffer.len();
            }
            let dropped = match self.rules.partial {
                PartialPacket::Rescan => 1,
                PartialPacket::Drop => self.buffer.len(),
            };
            self.skip(dropped, found);
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

    /// Takes packets and noise off the buffer until it holds a possible beginning only.
    fn scan(&mut self, found: &mut impl FnMut(Decoded<P>)) {
        loop {
            let start = self.possible_start();
            self.skip(start, found);
            let Some(length) = self.buffer.get(1).copied().map(usize::from) else {
                return;
            };
            let Some(bytes) = self.buffer.get(..length) else {
                return;
            };
            let mut bytes = bytes.to_vec();
            P::reorder(&mut bytes, self.rules.order);
            let Some(packet) = P::parse(&bytes) else {
                // By its length alone it has a beginning and an end, known or not.
                self.skip(length.max(1), found);
                continue;
            };
            self.flush_noise(found);
            self.buffer.drain(..length);
            self.reported = self.reported.saturating_sub(length);
            found(Decoded::Packet(packet));
        }
    }

    /// Index of the first byte at which a packet may begin.
    fn possible_start(&self) -> usize {
        let bytes = &self.buffer;
        let begins = |at: usize| {
            let length = bytes.get(at + 1);
            match self.rules.framing {
                Framing::TypeAndLength => P::HEADERS.iter().any(|[kind, own]| {
                    bytes[at] == *kind && length.is_none_or(|length| length == own)
                }),
                // No packet is shorter than its first three bytes.
                Framing::Length => length.is_none_or(|length| *length >= 3),
            }
        };
        (0..bytes.len())
            .find(|&at| begins(at))
            .unwrap_or(bytes.len())
    }

    /// Drops `count` bytes from the front; those that no report has covered are noise.
    fn skip(&mut self, count: usize, found: &mut impl FnMut(Decoded<P>)) {
        let silent = count.min(self.reported);
        self.reported -= silent;
        self.noise.extend_from_slice(&self.buffer[silent..count]);
        self.buffer.drain(..count);
        if self.noise.len() >= NOISE_RUN {
            self.flush_noise(found);
        }
    }

    fn flush_noise(&mut self, found: &mut impl FnMut(Decoded<P>)) {
        if !self.noise.is_empty() {
            found(Decoded::Noise(std::mem::take(&mut self.noise)));
        }
    }
}

#[cfg(test)]
mod tests;
