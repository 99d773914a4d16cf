//! Frames, packets and lines of the devices, as far as they are spoilt.

use super::parameters::WrongLength;
use crate::device_kind::DeviceKind;
use crate::mecanum_device::Link;
use crate::mecanum_device::packet::Status;
use crate::r150_device::codec::{self, OVERHEAD};
use crate::r150_device::reply::Reply;

/// What a link carries.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Form {
    /// Header, length, command, parameters, CRC.
    R150,
    /// Type, length, fields.
    Packet,
    /// Text up to a line feed.
    Line,
}

impl Form {
    pub(super) fn of(kind: DeviceKind, link: usize) -> Self {
        match kind {
            DeviceKind::R150 => Self::R150,
            DeviceKind::Mecanum if link == Link::Ros.index() => Self::Line,
            DeviceKind::Mecanum => Self::Packet,
        }
    }

    /// The command or type; a setting may have the module answer with its highest bit set.
    pub(super) fn is_command(self, frame: &[u8], command: u8) -> bool {
        match self {
            Self::R150 => frame
                .get(3)
                .is_some_and(|byte| *byte == command || *byte == command | 0x80),
            Self::Packet => frame.first() == Some(&command),
            Self::Line => false,
        }
    }

    /// In words, for events.
    pub(super) fn name(self, frame: &[u8]) -> String {
        match (self, frame.get(3)) {
            (Self::R150, Some(command)) => format!("the reply to 0x{:02X}", command),
            (Self::Packet, Some(_)) => format!("status packet {}", frame[2]),
            (Self::Line, Some(_)) => "a report line".to_owned(),
            (_, None) => "a frame".to_owned(),
        }
    }

    /// Another CRC than the right one.
    pub(super) fn spoil_crc(self, mut frame: Vec<u8>) -> Vec<u8> {
        if let Some(last) = frame.last_mut() {
            *last ^= 0xFF;
        }
        frame
    }

    /// Another command, type or letter.
    pub(super) fn with_command(self, mut frame: Vec<u8>, with: Option<u8>) -> Vec<u8> {
        match self {
            Self::R150 => match r150_parts(&frame) {
                Some((command, parameters)) => {
                    codec::encode(with.unwrap_or(command ^ 1), parameters)
                }
                None => frame,
            },
            Self::Packet | Self::Line => {
                if let Some(first) = frame.first_mut() {
                    *first = with.unwrap_or(*first ^ 1);
                }
                frame
            }
        }
    }

    /// So many bytes more or fewer, or a length field that says so.
    pub(super) fn with_length(self, mut frame: Vec<u8>, by: i8, what: WrongLength) -> Vec<u8> {
        let at = match self {
            Self::R150 => 2,
            Self::Packet => 1,
            // A line has no length field.
            Self::Line => return resized(frame, by, 1),
        };
        if what == WrongLength::Field {
            if let Some(length) = frame.get_mut(at) {
                *length = length.wrapping_add_signed(by);
            }
            return frame;
        }
        if self == Self::R150 {
            return match r150_parts(&frame) {
                Some((command, parameters)) => {
                    let mut parameters = resized(parameters.to_vec(), by, 0);
                    parameters.truncate(usize::from(u8::MAX));
                    codec::encode(command, &parameters)
                }
                None => frame,
            };
        }
        let mut frame = resized(frame, by, 0);
        let length = u8::try_from(frame.len()).unwrap_or(u8::MAX);
        if let Some(field) = frame.get_mut(at) {
            *field = length;
        }
        frame
    }

    /// Something well-formed that the device might send.
    pub(super) fn unasked(self) -> Vec<u8> {
        match self {
            Self::R150 => Reply::Bool {
                command: crate::r150_device::command::code::HEARTBEAT,
                success: true,
            }
            .encode(),
            Self::Packet => Status::default().encode(),
            Self::Line => b"V0 S0 \n".to_vec(),
        }
    }
}

fn r150_parts(frame: &[u8]) -> Option<(u8, &[u8])> {
    let end = frame.len().checked_sub(OVERHEAD)?;
    Some((*frame.get(3)?, frame.get(4..4 + end)?))
}

/// Zeros added or bytes taken away before the last `kept`.
fn resized(mut bytes: Vec<u8>, by: i8, kept: usize) -> Vec<u8> {
    let tail = bytes.split_off(bytes.len().saturating_sub(kept));
    let length = bytes.len().saturating_add_signed(isize::from(by));
    bytes.resize(length, 0);
    bytes.extend(tail);
    bytes
}
