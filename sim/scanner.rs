//! Frames in a stream of bytes: where one begins, where it ends, and what lies between.

use std::time::Duration;

use rigsim_settings::SimTime;

use crate::message::MessageInfo;

/// Noise is reported in runs of at most this many bytes.
const NOISE_RUN: usize = 64;
/// Most bytes of a line of text.
const MOST_LINE: usize = 1024;

/// Form of what a link carries.
#[derive(Debug, Clone, Copy)]
pub enum Form {
    /// Frames of bytes.
    Frames {
        /// Bytes that begin each frame.
        header: &'static [u8],
        /// Index of the byte that says how long a frame is.
        length_at: usize,
        /// Bytes of a frame beside those that its length counts.
        uncounted: usize,
        /// Index of the identity byte of the message.
        id_at: usize,
        /// Set if a reply has the identity of its request, perhaps with this bit set.
        answers: Option<u8>,
        /// Index of the first field.
        fields_at: usize,
        /// Check bytes over all from the identity to the last field, which follow low byte first.
        check: Option<fn(&[u8]) -> u16>,
    },
    /// Text up to a line feed.
    Lines,
}

/// What a stream of bytes begins with.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Part {
    /// A frame of so many bytes.
    Frame(usize),
    /// A frame of so many bytes whose check bytes are wrong.
    Wrong(usize),
    /// So many bytes that begin no frame.
    Noise(usize),
    /// Part of a frame, or nothing.
    Begun,
}

impl Form {
    /// Reads the front of a stream of these messages. Without check bytes, a frame has the identity and
    /// the length of one of them.
    pub fn part<'m>(
        &self,
        bytes: &[u8],
        messages: impl IntoIterator<Item = &'m MessageInfo>,
    ) -> Part {
        let Self::Frames {
            header,
            length_at,
            uncounted,
            id_at,
            fields_at,
            check,
            ..
        } = *self
        else {
            return match bytes.iter().position(|byte| *byte == b'\n') {
                Some(end) => Part::Frame(end + 1),
                None if bytes.len() > MOST_LINE => Part::Noise(1),
                None => Part::Begun,
            };
        };
        let mut begin = header.iter().zip(bytes);
        if begin.any(|(wanted, byte)| wanted != byte) {
            return Part::Noise(1);
        }
        let id = bytes.get(id_at);
        let length = bytes.get(length_at);
        let length = length.map(|length| usize::from(*length) + uncounted);
        let fits = |info: &MessageInfo| {
            id.is_none_or(|id| info.id == *id)
                && length.is_none_or(|length| fields_at + info.length == length)
        };
        if check.is_none() && !messages.into_iter().any(fits) {
            return Part::Noise(1);
        }
        let length = length.filter(|_| id.is_some());
        let Some(frame) = length.and_then(|length| bytes.get(..length)) else {
            return Part::Begun;
        };
        let is_right = check.is_none_or(|check| {
            let (body, sum) = frame.split_at(frame.len().saturating_sub(2));
            body.get(id_at..)
                .is_some_and(|body| check(body).to_le_bytes() == sum)
        });
        match is_right {
            true => Part::Frame(frame.len()),
            false => Part::Wrong(frame.len()),
        }
    }
}

/// Finding in a stream.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Decoded {
    /// A whole frame.
    Frame(Vec<u8>),
    /// A whole frame whose check bytes are wrong.
    Wrong(Vec<u8>),
    /// A frame that was begun and not finished in time.
    Partial(Vec<u8>),
    /// Bytes outside any frame.
    Noise(Vec<u8>),
}

/// Streaming decoder. Any bytes are legal input, and how they are split changes nothing.
///
/// After a wrong frame, and after a partial one older than the inter-byte timeout, it resumes at that
/// frame's second byte, so that a valid frame inside it is never lost. A whole frame is never looked
/// into. Bytes that a report has covered are not reported again, so the
/// reports of a stream are no longer than the stream.
#[derive(Debug, Clone)]
pub struct Scanner {
    form: Form,
    /// The messages that the stream may have.
    messages: Vec<&'static MessageInfo>,
    inter_byte_timeout: Duration,
    /// Bytes from the first that may begin a frame; fewer than the longest frame has.
    buffer: Vec<u8>,
    /// Number of bytes at the front of `buffer` that a report has covered already.
    reported: usize,
    noise: Vec<u8>,
    last_byte: SimTime,
}

impl Scanner {
    /// A decoder that gives a partial frame up after `inter_byte_timeout` of silence.
    pub fn new(
        form: Form,
        messages: impl IntoIterator<Item = &'static MessageInfo>,
        inter_byte_timeout: Duration,
    ) -> Self {
        Self {
            form,
            messages: messages.into_iter().collect(),
            inter_byte_timeout,
            buffer: Vec::new(),
            reported: 0,
            noise: Vec::new(),
            last_byte: SimTime::ZERO,
        }
    }

    /// Takes one byte; returns whatever it completes.
    pub fn push(&mut self, now: SimTime, byte: u8) -> Vec<Decoded> {
        let mut found = Vec::new();
        self.last_byte = now;
        self.buffer.push(byte);
        self.scan(&mut found);
        found
    }

    /// Time at which the bytes held so far are given up, unless more come.
    #[must_use]
    pub fn deadline(&self) -> Option<SimTime> {
        (!self.buffer.is_empty() || !self.noise.is_empty())
            .then(|| self.last_byte + self.inter_byte_timeout)
    }

    /// Returns what is held if its deadline is `now` or earlier.
    pub fn expire(&mut self, now: SimTime) -> Vec<Decoded> {
        let mut found = Vec::new();
        if self.deadline().is_none_or(|deadline| deadline > now) {
            return found;
        }
        // Every round takes at least one byte off a buffer shorter than a frame.
        while !self.buffer.is_empty() {
            if self.reported == 0 {
                self.flush_noise(&mut found);
                found.push(Decoded::Partial(self.buffer.clone()));
                self.reported = self.buffer.len();
            }
            self.skip(1, &mut found);
            self.scan(&mut found);
        }
        self.flush_noise(&mut found);
        found
    }

    /// Forgets everything held, as a reset does.
    pub fn clear(&mut self) {
        self.buffer.clear();
        self.noise.clear();
        self.reported = 0;
    }

    /// Takes frames and noise off the buffer until it holds a possible beginning only.
    fn scan(&mut self, found: &mut Vec<Decoded>) {
        loop {
            let messages = || self.messages.iter().copied();
            let part = |at: usize| match self.form.part(&self.buffer[at..], messages()) {
                Part::Noise(_) => None,
                part => Some((at, part)),
            };
            let part = (0..self.buffer.len()).find_map(part);
            self.skip(part.map_or(self.buffer.len(), |(at, _)| at), found);
            match part {
                None | Some((_, Part::Begun | Part::Noise(_))) => return,
                Some((_, Part::Frame(length))) => {
                    self.flush_noise(found);
                    self.reported = self.reported.saturating_sub(length);
                    found.push(Decoded::Frame(self.buffer.drain(..length).collect()));
                }
                Some((_, Part::Wrong(length))) => {
                    if self.reported == 0 {
                        self.flush_noise(found);
                        found.push(Decoded::Wrong(self.buffer[..length].to_vec()));
                        self.reported = length;
                    }
                    self.skip(1, found);
                }
            }
        }
    }

    /// Drops `count` bytes from the front; those that no report has covered are noise.
    fn skip(&mut self, count: usize, found: &mut Vec<Decoded>) {
        let silent = count.min(self.reported);
        self.reported -= silent;
        self.noise.extend_from_slice(&self.buffer[silent..count]);
        self.buffer.drain(..count);
        if self.noise.len() >= NOISE_RUN {
            self.flush_noise(found);
        }
    }

    fn flush_noise(&mut self, found: &mut Vec<Decoded>) {
        if !self.noise.is_empty() {
            found.push(Decoded::Noise(std::mem::take(&mut self.noise)));
        }
    }
}
