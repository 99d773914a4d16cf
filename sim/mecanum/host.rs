//! Commands and replies of a mecanum car, for scripted clients.

use std::time::Duration;

use rigsim_settings::{ReadError, SimTime};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::MecanumSettings;
use crate::device::host::{Frame, FrameReader, Message, Sender};
use crate::device::{DeviceSettings, HostSpec, typed};
use crate::mecanum_device::ascii::{REPORTS, Report};
use crate::mecanum_device::codec::{Decoded, Decoder, encode, reorder};
use crate::mecanum_device::packet::{Request, Status};
use crate::mecanum_device::settings::ByteOrder;

/// Silence after which a client gives up a packet that was begun.
const PAUSE: Duration = Duration::from_millis(50);
/// Most bytes of a line.
const MOST_LINE: usize = 1024;

pub(super) const HOST: HostSpec = HostSpec {
    read,
    schema: |generator| {
        vec![
            Request::json_schema(generator),
            LineCommand::json_schema(generator),
        ]
    },
    frames: |link, sender, settings| {
        let order = byte_order(settings);
        match (link, sender) {
            (0, Sender::Client) => Box::new(Packets::<Request>(Decoder::new(PAUSE, order), order)),
            (0, Sender::Device) => Box::new(Packets::<Status>(Decoder::new(PAUSE, order), order)),
            _ => Box::new(Lines(Vec::new(), sender)),
        }
    },
    plan: "",
    chatters: true,
};

/// A line, which no packet is.
#[derive(Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum LineCommand {
    /// ROS link: a line without its end, as in "X10".
    Line(#[schemars(extend("examples" = ["X10", "Y-200", "Z500", "A90", "B-90"]))] String),
}

fn read(value: &Spanned<DeValue<'_>>, settings: &dyn DeviceSettings) -> Result<Message, ReadError> {
    let is_line = matches!(value.get_ref(), DeValue::Table(table) if table.contains_key("line"));
    if !is_line {
        let bytes = rigsim_settings::read::<Request>(value)?.encode_in(byte_order(settings));
        return Ok(Message {
            link: 0,
            bytes,
            command: None,
        });
    }
    let LineCommand::Line(line) = rigsim_settings::read(value)?;
    if line.len() > MOST_LINE {
        let why = format!("a line has at most {MOST_LINE} bytes");
        return Err(serde::de::Error::custom(why));
    }
    Ok(Message {
        link: 1,
        bytes: format!("{line} \n").into_bytes(),
        command: None,
    })
}

fn byte_order(settings: &dyn DeviceSettings) -> ByteOrder {
    typed::<MecanumSettings>(settings).firmware.byte_order
}

struct Packets<P>(Decoder<P>, ByteOrder);

impl<P: crate::message::Message + Send> FrameReader for Packets<P> {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Frame> {
        let mut found = Vec::new();
        let order = self.1;
        let mut take = |decoded| {
            found.push(match decoded {
                Decoded::Packet(packet) => {
                    let packet: P = packet;
                    let mut bytes = encode(&packet);
                    reorder::<P>(&mut bytes, order);
                    Frame {
                        bytes,
                        command: None,
                        command_byte: None,
                        message: Some((packet.info(), packet.payload())),
                    }
                }
                Decoded::Partial(bytes) | Decoded::Noise(bytes) => Frame::none(bytes),
            });
        };
        self.0.expire(now, &mut take);
        self.0.push(now, byte, &mut take);
        found
    }
}

struct Lines(Vec<u8>, Sender);

impl FrameReader for Lines {
    fn push(&mut self, _now: SimTime, byte: u8) -> Vec<Frame> {
        if self.0.len() < MOST_LINE {
            self.0.push(byte);
        }
        if byte != b'\n' {
            return Vec::new();
        }
        let bytes = std::mem::take(&mut self.0);
        let report = Report::parse(&bytes).filter(|_| self.1 == Sender::Device);
        vec![Frame {
            command: None,
            command_byte: None,
            message: report.map(|_| (&REPORTS[0], bytes.clone())),
            bytes,
        }]
    }
}
