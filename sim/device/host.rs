//! Speech of a scripted client with a device: commands by name, replies by their fields.

use std::time::Duration;

use rigsim_settings::{ReadError, SimTime};
use schemars::{Schema, SchemaGenerator};
use toml::Spanned;
use toml::de::DeValue;

use super::{DeviceSettings, DeviceSpec};
use crate::event::{Code, EventKind};
pub use crate::message::{Field, Fields, MessageInfo, Sender};
use crate::scanner::{Decoded, Form, Scanner};

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
    /// A command that asks for standstill whatever runs, as TOML; empty for none.
    pub stop: &'static str,
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

/// Silence after which a client gives up a frame that was begun.
const PAUSE: Duration = Duration::from_millis(50);

/// Finds frames of a form that are messages of a device or of its clients on a link; `swapped` says
/// that numbers have their most significant byte first.
#[must_use]
pub fn frames(
    form: Form,
    (device, link): (&DeviceSpec, usize),
    sender: Sender,
    swapped: bool,
) -> Box<dyn FrameReader> {
    let messages = device.all_messages();
    let messages: Vec<_> = messages
        .filter(|info| info.link == link && info.sender == sender)
        .collect();
    let pause = match form {
        Form::Frames { .. } => PAUSE,
        // It may be typed.
        Form::Lines => Duration::MAX,
    };
    Box::new(Frames {
        form,
        scanner: Scanner::new(form, messages.iter().copied(), pause),
        messages,
        swapped,
    })
}

struct Frames {
    form: Form,
    messages: Vec<&'static MessageInfo>,
    scanner: Scanner,
    swapped: bool,
}

impl FrameReader for Frames {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Frame> {
        let mut found = self.scanner.expire(now);
        found.extend(self.scanner.push(now, byte));
        let frame = |decoded| match decoded {
            Decoded::Frame(bytes) => self.frame(bytes),
            Decoded::Wrong(bytes) => Frame {
                command: self.command(&bytes),
                ..Frame::none(bytes)
            },
            Decoded::Partial(bytes) | Decoded::Noise(bytes) => Frame::none(bytes),
        };
        found.into_iter().map(frame).collect()
    }
}

impl Frames {
    /// The command byte of a frame that says so.
    fn command(&self, bytes: &[u8]) -> Option<u8> {
        match self.form {
            Form::Frames { id_at, answers, .. } => answers.and(bytes.get(id_at).copied()),
            Form::Lines => None,
        }
    }

    fn frame(&self, bytes: Vec<u8>) -> Frame {
        let Form::Frames {
            id_at,
            answers,
            fields_at,
            check,
            ..
        } = self.form
        else {
            let mut lines = self.messages.iter();
            let is_it = |info: &&&MessageInfo| info.values(&bytes).count() == info.fields.len();
            let message = lines.find(is_it).map(|info| (*info, bytes.clone()));
            return Frame {
                message,
                ..Frame::none(bytes)
            };
        };
        let tail = if check.is_some() { 2 } else { 0 };
        let mut payload = bytes[fields_at..bytes.len() - tail].to_vec();
        let find = |id: u8| {
            // What takes no parameters takes any.
            let fits = |info: &&&MessageInfo| {
                let takes_any = info.sender == Sender::Client && info.fields.is_empty();
                info.id == id && (takes_any || info.length == payload.len())
            };
            self.messages.iter().find(fits).copied()
        };
        let id = bytes[id_at];
        let plain = id & !answers.unwrap_or(0);
        let found = find(id).or_else(|| find(plain));
        if let Some(info) = found.filter(|_| self.swapped) {
            info.swap_bytes(&mut payload);
        }
        Frame {
            command: answers.map(|_| found.map_or(id, |info| info.id)),
            command_byte: answers.map(|_| id),
            message: found.map(|info| (info, payload)),
            bytes,
        }
    }
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
    /// Bytes that are not a message.
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
        let fields = self.message.as_ref();
        let fields = fields.map(|(info, payload)| info.show(payload).to_string());
        format!("{}{}", self.name(), fields.unwrap_or_default())
    }

    /// Command and name.
    fn name(&self) -> String {
        let command = self.command.map(|command| format!("0x{command:02X} "));
        let name = self.message.as_ref().map(|(info, _)| info.name);
        let name = name.unwrap_or("bytes that are not a message");
        format!("{}{name}", command.unwrap_or_default())
    }

    /// It as an event of a link.
    #[must_use]
    pub fn event(self, code: Code, link: usize) -> EventKind {
        let event = EventKind::new(code, self.name());
        match self.message {
            Some((info, payload)) => event.saying(info, payload, self.bytes),
            None => event.with(link, self.bytes),
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
