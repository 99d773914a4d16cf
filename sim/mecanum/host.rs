//! Commands and replies of a mecanum car, for scripted clients.

use rigsim_settings::ReadError;
use schemars::JsonSchema;
use serde::Deserialize;
use toml::Spanned;
use toml::de::DeValue;

use super::{MECANUM_SPEC, MecanumSettings};
use crate::device::host::{Message, frames};
use crate::device::{DeviceSettings, Form, HostSpec, typed};
use crate::mecanum_device::codec;
use crate::mecanum_device::packet::Request;
use crate::mecanum_device::settings::ByteOrder;

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
        let (form, is_big) = match link {
            0 => (codec::FORM, byte_order(settings) == ByteOrder::Big),
            _ => (Form::Lines, false),
        };
        frames(form, (&MECANUM_SPEC, link), sender, is_big)
    },
    plan: include_str!("identify.toml"),
    stop: "motion = { moving_idx = 0, s = 0, v = 0 }",
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
