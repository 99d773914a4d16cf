//! Speech of a scripted client with a device: commands by name, replies by their fields.

use rigsim_settings::{ReadError, SimTime};
use schemars::{Schema, SchemaGenerator};
use toml::Spanned;
use toml::de::DeValue;

use super::DeviceSettings;
pub use crate::message::{Field, Fields};

/// Commands and replies of a device, for scripted clients.
#[derive(Clone, Copy)]
pub struct HostSpec {
    /// Reads a command as a file has it.
    pub read: fn(&Spanned<DeValue<'_>>, &dyn DeviceSettings) -> Result<Message, ReadError>,
    /// The forms of commands in files: alternatives, each with its name as the only key.
    pub schema: fn(&mut SchemaGenerator) -> Vec<Schema>,
    /// Finds replies among the bytes of a link.
    pub reader: fn(link: usize, &dyn DeviceSettings) -> Box<dyn ReplyReader>,
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

/// Finds replies among bytes.
pub trait ReplyReader: Send {
    /// Takes a byte that came at `now`; gives the replies that it ends.
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Reply>;
}

/// A reply.
#[derive(Debug, Clone, PartialEq)]
pub struct Reply {
    /// The command that it answers, if it says so.
    pub command: Option<u8>,
    /// Fields by name.
    pub fields: Fields,
}
