//! How faults of the protocol spoil the frames of a link.

pub use crate::scanner::Form;

/// Frames of a device on a link.
#[derive(Debug, Clone, Copy)]
pub struct Framing {
    /// Where a frame has what.
    pub form: Form,
    /// A frame in words, for events.
    pub name: fn(&[u8]) -> String,
    /// Something well-formed that the device might send.
    pub unasked: fn() -> Vec<u8>,
}

impl Framing {
    /// Returns whether a frame is one of this command or type.
    #[must_use]
    pub fn is_command(&self, frame: &[u8], command: u8) -> bool {
        match self.form {
            Form::Frames { id_at, answers, .. } => frame.get(id_at).is_some_and(|id| {
                *id == command || answers.is_some_and(|bit| *id == command | bit)
            }),
            Form::Lines => false,
        }
    }

    /// Another command or type, or another letter of a line: this one, or one that differs by a bit.
    #[must_use]
    pub fn with_command(&self, mut frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
        if frame.len() < self.least() {
            return frame;
        }
        let at = match self.form {
            Form::Frames { id_at, .. } => id_at,
            Form::Lines => 0,
        };
        frame[at] = with.unwrap_or(frame[at] ^ 1);
        let tail = frame.split_off(frame.len() - self.tail());
        self.sealed(frame, tail)
    }

    /// So many bytes more or fewer, and all else as it should be then.
    #[must_use]
    pub fn with_length(&self, mut frame: Vec<u8>, by: i8) -> Vec<u8> {
        if frame.len() < self.least() {
            return frame;
        }
        let tail = frame.split_off(frame.len() - self.tail());
        let resized = frame.len().saturating_add_signed(isize::from(by));
        match self.form {
            Form::Frames {
                length_at,
                uncounted,
                fields_at,
                ..
            } => {
                let most = usize::from(u8::MAX) + uncounted - tail.len();
                frame.resize(resized.clamp(fields_at, most), 0);
                let counted = frame.len() + tail.len() - uncounted;
                frame[length_at] = u8::try_from(counted).unwrap_or(u8::MAX);
            }
            Form::Lines => frame.resize(resized, 0),
        }
        self.sealed(frame, tail)
    }

    /// Index of the byte of a frame that says how long it is, if one does.
    #[must_use]
    pub fn length_at(&self) -> Option<usize> {
        match self.form {
            Form::Frames { length_at, .. } => Some(length_at),
            Form::Lines => None,
        }
    }

    /// Bytes behind the last field.
    fn tail(&self) -> usize {
        match self.form {
            Form::Frames { check: None, .. } => 0,
            Form::Frames { .. } => 2,
            Form::Lines => 1,
        }
    }

    /// Bytes of the shortest frame.
    fn least(&self) -> usize {
        match self.form {
            Form::Frames { fields_at, .. } => fields_at + self.tail(),
            Form::Lines => self.tail(),
        }
    }

    /// A frame whose check bytes are right, with what stood in their place, if that are not these.
    fn sealed(&self, mut frame: Vec<u8>, tail: Vec<u8>) -> Vec<u8> {
        match self.form {
            Form::Frames {
                id_at,
                check: Some(check),
                ..
            } => {
                let sum = check(frame.get(id_at..).unwrap_or_default());
                frame.extend(sum.to_le_bytes());
            }
            _ => frame.extend(tail),
        }
        frame
    }
}
