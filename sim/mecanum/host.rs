//! Commands and replies of a mecanum car, for scripted clients.

use std::time::Duration;

use rigsim_settings::{ReadError, SimTime};
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::MecanumSettings;
use crate::device::host::{Message, Reply, ReplyReader};
use crate::device::{DeviceSettings, HostSpec, typed};
use crate::mecanum_device::ascii::{REPORTS, Report};
use crate::mecanum_device::codec::{Decoded, Decoder, Rules};
use crate::mecanum_device::packet::{Request, Status};
use crate::mecanum_device::settings::ByteOrder;
use crate::message::Message as _;

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
    reader: |link, settings| match link {
        0 => Box::new(Packets(Decoder::by(Rules {
            order: byte_order(settings),
            ..Rules::new(PAUSE)
        }))),
        _ => Box::new(Lines(Vec::new())),
    },
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

struct Packets(Decoder<Status>);

impl ReplyReader for Packets {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Reply> {
        let mut found = Vec::new();
        self.0.expire(now, &mut |_| {});
        self.0.push(now, byte, &mut |decoded| {
            if let Decoded::Packet(status) = decoded {
                found.push(Reply {
                    command: None,
                    fields: status.info().fields(&status.payload()),
                });
            }
        });
        found
    }
}

struct Lines(Vec<u8>);

impl ReplyReader for Lines {
    fn push(&mut self, _now: SimTime, byte: u8) -> Vec<Reply> {
        if byte != b'\n' {
            if self.0.len() < MOST_LINE {
                self.0.push(byte);
            }
            return Vec::new();
        }
        let line = std::mem::take(&mut self.0);
        let reply = Report::parse(&line).map(|_| Reply {
            command: None,
            fields: REPORTS[0].fields(&line),
        });
        reply.into_iter().collect()
    }
}
