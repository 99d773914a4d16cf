//! The stream of the mecanum board's main link: packets without header or checksum.
//!
//! ```text
//! cmd_type | pkg_length | seq | fields; pkg_length counts the whole packet
//! ```
//!
//! All that tells a packet from noise is that a known type is followed by the length which that
//! type has. The article names neither a byte order nor a way to find the beginning of a packet
//! again; both are our assumptions.

use std::time::Duration;

use sim_settings::SimTime;

/// Noise is reported in runs of at most this many bytes.
const NOISE_RUN: usize = 64;

/// What travels in one direction of the link.
pub trait Packet: Sized {
    /// Type and length of every packet of this direction; lengths are at least 3.
    const HEADERS: &'static [[u8; 2]];

    /// Reads a whole packet; `None` if type or length is none of this direction's.
    fn parse(bytes: &[u8]) -> Option<Self>;
}

/// What the decoder found in the stream.
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
/// A byte that begins no packet is skipped. After a partial packet older than the inter-byte
/// timeout it resumes at that packet's second byte, so that a packet behind a torn one is never
/// lost; the torn one's bytes are not reported again.
#[derive(Debug, Clone)]
pub struct Decoder<P> {
    inter_byte_timeout: Duration,
    /// Bytes from the first that may begin a packet; shorter than the longest packet.
    buffer: Vec<u8>,
    /// How many bytes at the front of `buffer` a report has covered already.
    reported: usize,
    noise: Vec<u8>,
    last_byte: SimTime,
    direction: std::marker::PhantomData<P>,
}

impl<P: Packet> Decoder<P> {
    /// A decoder that drops a partial packet after `inter_byte_timeout` of silence.
    #[must_use]
    pub fn new(inter_byte_timeout: Duration) -> Self {
        Self {
            inter_byte_timeout,
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

    /// When the bytes held so far are given up, unless more come.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        (!self.buffer.is_empty() || !self.noise.is_empty())
            .then(|| self.last_byte + self.inter_byte_timeout)
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
            self.skip(1, found);
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
            let Some(packet) = self.buffer.get(..length).map(P::parse) else {
                return;
            };
            let Some(packet) = packet else {
                self.skip(1, found);
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
            P::HEADERS.iter().any(|[kind, length]| {
                bytes[at] == *kind && bytes.get(at + 1).is_none_or(|next| next == length)
            })
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
