//! Packets and lines of a mecanum car, as far as faults spoil them.

use crate::device::{Form, Framing, resized, with_first};
use crate::mecanum_device::packet::Status;

/// Type, length, fields.
pub(super) struct Packets;

impl Framing for Packets {
    fn is_command(&self, frame: &[u8], command: u8) -> bool {
        frame.first() == Some(&command)
    }

    fn name(&self, frame: &[u8]) -> String {
        match frame.get(2) {
            Some(number) => format!("status packet {number}"),
            None => "a frame".to_owned(),
        }
    }

    fn with_command(&self, frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
        with_first(frame, with)
    }

    fn with_length(&self, frame: Vec<u8>, by: i8) -> Vec<u8> {
        let mut frame = resized(frame, by, 0);
        let length = u8::try_from(frame.len()).unwrap_or(u8::MAX);
        if let Some(field) = frame.get_mut(1) {
            *field = length;
        }
        frame
    }

    fn form(&self) -> Form {
        Form::Frames {
            length_at: 1,
            id_at: 0,
            fields_at: 2,
            checked: false,
        }
    }

    fn unasked(&self) -> Vec<u8> {
        Status::default().encode()
    }
}
