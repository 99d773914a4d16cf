//! Commands and replies of a mecanum car, for scripted clients.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;
use sim_settings::SimTime;
use toml::de::ValueDeserializer;

use super::MecanumSettings;
use crate::device::host::{Field, Fields, Message, Reply, ReplyReader};
use crate::device::{DeviceSettings, HostSpec};
use crate::mecanum_device::ascii::Report;
use crate::mecanum_device::codec::{Decoded, Decoder, Rules};
use crate::mecanum_device::packet::{Request, Status};
use crate::mecanum_device::settings::ByteOrder;

/// Silence after which a client gives up a packet that was begun.
const PAUSE: Duration = Duration::from_millis(50);
/// Most bytes of a line.
const MOST_LINE: usize = 1024;

pub(super) const HOST: HostSpec = HostSpec {
    read,
    schema: Command::json_schema,
    fields: |link, _| {
        let fields = match link {
            0 => status_fields(&Status::default()),
            _ => line_fields(&Report::default()),
        };
        fields.into_iter().map(|(name, _)| name).collect()
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

/// A command by name and fields. Numbers are as on the wire.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Command {
    /// Mecanum car: a motion.
    Motion(MotionText),
    /// Mecanum car: says where it is.
    SetPose(SetPoseText),
    /// Mecanum car: who drives.
    ControlMode(ModeText),
    /// Mecanum car, ROS link: a line without its end, as in "X10".
    Line(String),
}

/// A motion packet.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct MotionText {
    /// Sequence number; 0 unless given.
    #[serde(default)]
    seq: u8,
    /// 1 discards what runs and waits, 0 appends; 1 unless given.
    #[serde(default = "one")]
    is_reset: u8,
    /// 0 forward, 1 rotate, 2 strafe, 3 left-front, 4 right-front.
    moving_idx: u8,
    /// Distance, 1/10 revolution.
    s: u16,
    /// Speed, 1/10 r/min, -500 to 500.
    v: i16,
}

fn one() -> u8 {
    1
}

/// A pose packet.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct SetPoseText {
    /// Sequence number; 0 unless given.
    #[serde(default)]
    seq: u8,
    /// 1/10 revolution.
    axis_x: i16,
    /// 1/10 revolution.
    axis_y: i16,
    /// 1/10 degree, counter-clockwise.
    ori: i16,
}

/// A control mode packet.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct ModeText {
    /// Sequence number; 0 unless given.
    #[serde(default)]
    seq: u8,
    /// 0 board, 1 remote control.
    mode: u8,
}

fn read(
    value: ValueDeserializer<'_>,
    settings: &dyn DeviceSettings,
) -> Result<Message, toml::de::Error> {
    let packet = match Command::deserialize(value)? {
        Command::Motion(motion) => Request::Motion {
            seq: motion.seq,
            is_reset: motion.is_reset,
            moving_idx: motion.moving_idx,
            s: motion.s,
            v: motion.v,
        },
        Command::SetPose(pose) => Request::SetPose {
            seq: pose.seq,
            axis_x: pose.axis_x,
            axis_y: pose.axis_y,
            ori: pose.ori,
        },
        Command::ControlMode(ModeText { seq, mode }) => Request::ControlMode { seq, mode },
        Command::Line(line) if line.len() > MOST_LINE => {
            let why = format!("a line has at most {MOST_LINE} bytes");
            return Err(serde::de::Error::custom(why));
        }
        Command::Line(line) => {
            return Ok(Message {
                link: 1,
                bytes: format!("{line} \n").into_bytes(),
                command: None,
            });
        }
    };
    Ok(Message {
        link: 0,
        bytes: packet.encode_in(byte_order(settings)),
        command: None,
    })
}

fn byte_order(settings: &dyn DeviceSettings) -> ByteOrder {
    let usual = || MecanumSettings::default().firmware.byte_order;
    let own = settings.get::<MecanumSettings>();
    own.map_or_else(usual, |own| own.firmware.byte_order)
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
                    fields: status_fields(&status),
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
        let report = Report::parse(&std::mem::take(&mut self.0));
        let reply = report.map(|report| Reply {
            command: None,
            fields: line_fields(&report),
        });
        reply.into_iter().collect()
    }
}

fn status_fields(status: &Status) -> Fields {
    vec![
        ("seq", status.seq.into()),
        ("v_x", status.v_x.into()),
        ("v_y", status.v_y.into()),
        ("axis_x", status.axis_x.into()),
        ("axis_y", status.axis_y.into()),
        ("ori", status.ori.into()),
        ("rfid", status.rfid.into()),
        ("magn", status.magn.into()),
        ("infra", status.infra.into()),
        ("ut_f", Field::list(status.ut_f)),
        ("ut_b", Field::list(status.ut_b)),
        ("moto_state", status.moto_state.into()),
        ("mile", status.mile.into()),
    ]
}

fn line_fields(report: &Report) -> Fields {
    #[expect(clippy::cast_precision_loss, reason = "these stay far below 2^53")]
    let number = |value: i64| Field::Number(value as f64);
    vec![
        ("speed", number(report.speed)),
        ("mileage", number(report.mileage)),
    ]
}
