//! Frames in a stream of bytes: where one begins, where it ends, and what lies between.

use std::time::Duration;

use rigsim_settings::SimTime;

/// Noise is reported in runs of at most this many bytes.
const NOISE_RUN: usize = 64;

/// The form of the frames in a stream.
pub trait Format {
    /// A finding in the stream.
    type Decoded;

    /// Returns whether a frame may begin with these bytes, of which there is at least one.
    fn may_begin(&self, bytes: &[u8]) -> bool;

    /// Reads the frame with which these bytes may begin.
    fn read(&self, bytes: &[u8]) -> Read<Self::Decoded>;

    /// Reports a frame that was begun and not finished in time.
    fn partial(bytes: Vec<u8>) -> Self::Decoded;

    /// Reports bytes outside any frame.
    fn noise(bytes: Vec<u8>) -> Self::Decoded;
}

/// A reading of the first bytes of a stream.
#[derive(Debug)]
pub enum Read<D> {
    /// The frame goes on.
    Begun,
    /// A frame of so many bytes.
    Whole(usize, D),
    /// A wrong frame of so many bytes.
    Wrong(usize, D),
    /// So many bytes that are no frame.
    Noise(usize),
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// After a wrong frame, and after a partial one older than the inter-byte timeout, it resumes at that
/// frame's second byte, so that a valid frame inside it is never lost. A whole frame is never looked
/// into. Bytes that a report has covered are not reported again, so the
/// reports of a stream are no longer than the stream.
#[derive(Debug, Clone)]
pub struct Scanner<F> {
    pub(crate) format: F,
    inter_byte_timeout: Duration,
    /// Bytes from the first that may begin a frame; fewer than the longest frame has.
    buffer: Vec<u8>,
    /// Number of bytes at the front of `buffer` that a report has covered already.
    reported: usize,
    noise: Vec<u8>,
    last_byte: SimTime,
}

impl<F: Format> Scanner<F> {
    /// A decoder that gives a partial frame up after `inter_byte_timeout` of silence.
    #[must_use]
    pub const fn of(format: F, inter_byte_timeout: Duration) -> Self {
        Self {
            format,
            inter_byte_timeout,
            buffer: Vec::new(),
            reported: 0,
            noise: Vec::new(),
            last_byte: SimTime::ZERO,
        }
    }

    /// Takes one byte; hands whatever it completes to `found`.
    pub fn push(&mut self, now: SimTime, byte: u8, found: &mut impl FnMut(F::Decoded)) {
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

    /// Reports what is held if its deadline is `now` or earlier.
    pub fn expire(&mut self, now: SimTime, found: &mut impl FnMut(F::Decoded)) {
        if self.deadline().is_some_and(|deadline| deadline <= now) {
            self.give_up(found);
        }
    }

    /// Reports what is held, whatever the time: no more bytes come of the client that sent it.
    pub fn give_up(&mut self, found: &mut impl FnMut(F::Decoded)) {
        // Every round takes at least one byte off a buffer shorter than a frame.
        while !self.buffer.is_empty() {
            if self.reported == 0 {
                self.flush_noise(found);
                found(F::partial(self.buffer.clone()));
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

    /// Takes frames and noise off the buffer until it holds a possible beginning only.
    fn scan(&mut self, found: &mut impl FnMut(F::Decoded)) {
        loop {
            let bytes = &self.buffer;
            let start = (0..bytes.len()).find(|&at| self.format.may_begin(&bytes[at..]));
            self.skip(start.unwrap_or(bytes.len()), found);
            if self.buffer.is_empty() {
                return;
            }
            match self.format.read(&self.buffer) {
                Read::Begun => return,
                Read::Whole(length, frame) => {
                    self.flush_noise(found);
                    self.buffer.drain(..length);
                    self.reported = self.reported.saturating_sub(length);
                    found(frame);
                }
                Read::Wrong(length, frame) => {
                    if self.reported == 0 {
                        self.flush_noise(found);
                        found(frame);
                        self.reported = length;
                    }
                    self.skip(1, found);
                }
                Read::Noise(length) => self.skip(length, found),
            }
        }
    }

    /// Drops `count` bytes from the front; those that no report has covered are noise.
    fn skip(&mut self, count: usize, found: &mut impl FnMut(F::Decoded)) {
        let silent = count.min(self.reported);
        self.reported -= silent;
        self.noise.extend_from_slice(&self.buffer[silent..count]);
        self.buffer.drain(..count);
        if self.noise.len() >= NOISE_RUN {
            self.flush_noise(found);
        }
    }

    fn flush_noise(&mut self, found: &mut impl FnMut(F::Decoded)) {
        if !self.noise.is_empty() {
            found(F::noise(std::mem::take(&mut self.noise)));
        }
    }
}
