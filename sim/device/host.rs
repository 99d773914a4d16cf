//! Speech of a scripted client with a device: commands by name, replies by their fields.

use schemars::{Schema, SchemaGenerator};
use sim_settings::SimTime;
use toml::de::ValueDeserializer;

use super::DeviceSettings;

/// Commands and replies of a device, for scripted clients.
#[derive(Clone, Copy)]
pub struct HostSpec {
    /// Reads a command as a file has it.
    pub read: fn(ValueDeserializer<'_>, &dyn DeviceSettings) -> Result<Message, toml::de::Error>,
    /// The form of commands in files: alternatives, each with its name as the only key.
    pub schema: fn(&mut SchemaGenerator) -> Schema,
    /// The names of the fields that a reply to this command on a link can have; to any command
    /// where it is not known.
    pub fields: fn(link: usize, command: Option<u8>) -> Vec<&'static str>,
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

/// A reply's fields by name.
pub type Fields = Vec<(&'static str, Field)>;

/// The value of a field.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum Field {
    /// Yes or no.
    Flag(bool),
    /// A number as on the wire.
    Number(f64),
    /// Several numbers.
    List(Vec<f64>),
}

impl<T: Into<f64>> From<T> for Field {
    fn from(number: T) -> Self {
        Self::Number(number.into())
    }
}

impl Field {
    /// Several numbers.
    pub fn list<T: Into<f64>>(values: impl IntoIterator<Item = T>) -> Self {
        Self::List(values.into_iter().map(Into::into).collect())
    }
}
