//! Frames of a link: where one begins and ends, and how faults of the protocol spoil it.

use crate::message::{MessageInfo, Sender};

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
    /// So many bytes that begin no frame.
    Noise(usize),
    /// Part of a frame, or nothing.
    Begun,
}

impl Form {
    /// Reads the front of a stream of this sender's messages. Bytes are a frame if their check bytes
    /// are right, or if one of the messages has this identity and length.
    pub fn part(
        &self,
        bytes: &[u8],
        sender: Sender,
        messages: impl IntoIterator<Item = &'static MessageInfo>,
    ) -> Part {
        let Self::Frames {
            header,
            length_at,
            uncounted,
            id_at,
            fields_at,
            check,
        } = *self
        else {
            let end = bytes.iter().position(|byte| *byte == b'\n');
            return end.map_or(Part::Begun, |end| Part::Frame(end + 1));
        };
        if header
            .iter()
            .zip(bytes)
            .any(|(wanted, byte)| wanted != byte)
        {
            return Part::Noise(1);
        }
        let (Some(length), Some(id)) = (bytes.get(length_at), bytes.get(id_at)) else {
            return Part::Begun;
        };
        let (length, id) = (usize::from(*length) + uncounted, *id);
        let tail = if check.is_some() { 2 } else { 0 };
        let is_known = |info: &MessageInfo| {
            info.sender == sender && info.id == id && fields_at + info.length + tail == length
        };
        let is_known = messages.into_iter().any(is_known);
        if !is_known && check.is_none() {
            return Part::Noise(1);
        }
        let Some(frame) = bytes.get(..length) else {
            return Part::Begun;
        };
        let is_right = check.is_some_and(|check| {
            let body = frame.get(id_at..length.saturating_sub(tail));
            body.is_some_and(|body| frame.ends_with(&check(body).to_le_bytes()))
        });
        match is_known || is_right {
            true => Part::Frame(length),
            false => Part::Noise(1),
        }
    }
}

/// Frames of a link, and how faults of the protocol spoil them.
pub trait Framing: Sync {
    /// Returns whether a frame is one of this command or type.
    fn is_command(&self, frame: &[u8], command: u8) -> bool;

    /// A frame in words, for events.
    fn name(&self, frame: &[u8]) -> String;

    /// Another command or type: this one, or one that differs by a bit.
    fn with_command(&self, frame: Vec<u8>, with: Option<u8>) -> Vec<u8>;

    /// So many bytes more or fewer, and all else as it should be then.
    fn with_length(&self, frame: Vec<u8>, by: i8) -> Vec<u8>;

    /// Returns where a frame has what.
    fn form(&self) -> Form;

    /// Where a frame says how long it is, if it does.
    fn length_at(&self) -> Option<usize> {
        match self.form() {
            Form::Frames { length_at, .. } => Some(length_at),
            Form::Lines => None,
        }
    }

    /// Something well-formed that the device might send.
    fn unasked(&self) -> Vec<u8>;
}

/// Text up to a line feed.
#[derive(Debug, Clone, Copy)]
pub struct TextLines {
    /// A line in words, for events.
    pub name: &'static str,
    /// A line that the device might send.
    pub unasked: &'static [u8],
}

impl Framing for TextLines {
    fn is_command(&self, _frame: &[u8], _command: u8) -> bool {
        false
    }

    fn name(&self, _frame: &[u8]) -> String {
        self.name.to_owned()
    }

    fn with_command(&self, frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
        with_first(frame, with)
    }

    fn with_length(&self, frame: Vec<u8>, by: i8) -> Vec<u8> {
        resized(frame, by, 1)
    }

    fn form(&self) -> Form {
        Form::Lines
    }

    fn unasked(&self) -> Vec<u8> {
        self.unasked.to_vec()
    }
}

/// Another first byte: this one, or one that differs by a bit.
pub(crate) fn with_first(mut frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
    if let Some(first) = frame.first_mut() {
        *first = with.unwrap_or(*first ^ 1);
    }
    frame
}

/// Zeros added or bytes taken away before the last `kept`.
pub(crate) fn resized(mut bytes: Vec<u8>, by: i8, kept: usize) -> Vec<u8> {
    let tail = bytes.split_off(bytes.len().saturating_sub(kept));
    let length = bytes.len().saturating_add_signed(isize::from(by));
    bytes.resize(length, 0);
    bytes.extend(tail);
    bytes
}
