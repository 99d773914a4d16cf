//! Frames of a link: where one begins and ends, and how faults of the protocol spoil it.

/// Form of what a link carries.
#[derive(Debug, Clone, Copy)]
pub enum Form {
    /// Frames of bytes.
    Frames {
        /// Index of the byte that says how long a frame is.
        length_at: usize,
        /// Index of the identity byte of the message.
        id_at: usize,
        /// Index of the first field.
        fields_at: usize,
        /// Set if check bytes follow the last field.
        checked: bool,
    },
    /// Text up to a line feed.
    Lines,
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
