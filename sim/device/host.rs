//! Speech of a scripted client with a device: commands by name, replies by their fields.

use rigsim_settings::{ReadError, SimTime};
use schemars::{Schema, SchemaGenerator};
use toml::Spanned;
use toml::de::DeValue;

use super::DeviceSettings;
pub use crate::message::{Field, Fields, MessageInfo, Sender};

/// Commands and replies of a device, for scripted clients.
#[derive(Clone, Copy)]
pub struct HostSpec {
    /// Reads a command as a file has it.
    pub read: fn(&Spanned<DeValue<'_>>, &dyn DeviceSettings) -> Result<Message, ReadError>,
    /// The forms of commands in files: alternatives, each with its name as the only key.
    pub schema: fn(&mut SchemaGenerator) -> Vec<Schema>,
    /// Finds the frames of one side among the bytes of a link.
    pub frames: fn(link: usize, Sender, &dyn DeviceSettings) -> Box<dyn FrameReader>,
    /// A drive that makes its settings identifiable, as TOML; empty for none.
    pub plan: &'static str,
    /// It sends by itself, so that not all it sends answers.
    pub chatters: bool,
}

/// Message of a scripted client.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Message {
    /// On which link, where the file does not say.
    pub link: usize,
    /// As they are on the wire.
    pub bytes: Vec<u8>,
    /// The command by which its reply is known, if it is.
    pub command: Option<u8>,
}

/// Finds frames among bytes.
pub trait FrameReader: Send {
    /// Takes a byte that came at `now`; returns what ends with it, or has ended before it.
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Frame>;
}

/// A frame of either side, or bytes that are none.
#[derive(Debug, Clone, PartialEq)]
pub struct Frame {
    /// As they are on the wire.
    pub bytes: Vec<u8>,
    /// The command that it is or answers, if it says so.
    pub command: Option<u8>,
    /// The command byte as it stands on the wire.
    pub command_byte: Option<u8>,
    /// The message that it is, with the bytes of its fields; `None` for what no declaration fits.
    pub message: Option<(&'static MessageInfo, Vec<u8>)>,
}

impl Frame {
    /// Bytes that are no message.
    #[must_use]
    pub fn none(bytes: Vec<u8>) -> Self {
        Self {
            bytes,
            command: None,
            command_byte: None,
            message: None,
        }
    }

    /// The fields by name.
    #[must_use]
    pub fn reply(&self) -> Option<Reply> {
        let (info, payload) = self.message.as_ref()?;
        Some(Reply {
            command: self.command,
            fields: info.fields(payload),
        })
    }

    /// It in words.
    #[must_use]
    pub fn show(&self) -> String {
        let command = self.command.map(|command| format!("0x{command:02X} "));
        let command = command.unwrap_or_default();
        match &self.message {
            Some((info, payload)) => format!("{command}{}{}", info.name, info.show(payload)),
            None => format!("{command}bytes that are no message"),
        }
    }
}

/// A reply.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// The command that it answers, if it says so.
    pub command: Option<u8>,
    /// Fields by name.
    pub fields: Fields,
}
