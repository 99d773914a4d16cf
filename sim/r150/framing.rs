//! Frames of an R150, as far as faults spoil them.

use crate::device::{Form, Framing, resized};
use crate::r150_device::codec::{self, COMMAND_AT};
use crate::r150_device::command::{Reply, code};

/// Header, length, command, parameters, CRC.
pub(super) struct Frames;

impl Framing for Frames {
    /// A setting may have the module answer with the command's highest bit set.
    fn is_command(&self, frame: &[u8], command: u8) -> bool {
        let byte = frame.get(COMMAND_AT);
        byte.is_some_and(|byte| *byte == command || *byte == command | 0x80)
    }

    fn name(&self, frame: &[u8]) -> String {
        match frame.get(COMMAND_AT) {
            Some(command) => format!("the reply to 0x{command:02X}"),
            None => "a frame".to_owned(),
        }
    }

    fn with_command(&self, frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
        match parts(&frame) {
            Some((command, parameters)) => codec::encode(with.unwrap_or(command ^ 1), parameters),
            None => frame,
        }
    }

    fn with_length(&self, frame: Vec<u8>, by: i8) -> Vec<u8> {
        match parts(&frame) {
            Some((command, parameters)) => {
                let mut parameters = resized(parameters.to_vec(), by, 0);
                parameters.truncate(usize::from(u8::MAX));
                codec::encode(command, &parameters)
            }
            None => frame,
        }
    }

    fn form(&self) -> Form {
        Form::Frames {
            length_at: 2,
            id_at: COMMAND_AT,
            fields_at: COMMAND_AT + 1,
            checked: true,
        }
    }

    fn unasked(&self) -> Vec<u8> {
        let command = code::Heartbeat;
        let success = true;
        Reply::Bool { command, success }.encode()
    }
}

fn parts(frame: &[u8]) -> Option<(u8, &[u8])> {
    Some((*frame.get(COMMAND_AT)?, codec::parameters(frame)?))
}
