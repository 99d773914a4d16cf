//! Commands and replies of an R150, for scripted clients.

use std::time::Duration;

use schemars::JsonSchema;
use serde::Deserialize;
use sim_settings::SimTime;
use toml::de::ValueDeserializer;

use crate::device::host::{Field, Fields, Message, Reply as Found, ReplyReader};
use crate::device::{DeviceSettings, HostSpec};
use crate::fault::parameters::RailName;
use crate::r150_device::codec::{Decoded, Decoder, Frame};
use crate::r150_device::command::{COMMANDS, Reply, Request};
use crate::r150_device::settings::Resync;

/// Silence after which a client gives up a frame that was begun.
const PAUSE: Duration = Duration::from_millis(50);

pub(super) const HOST: HostSpec = HostSpec {
    read,
    schema: Command::json_schema,
    fields: |_, command| field_names(command),
    reader: |_, _| Box::new(Reader(Decoder::new(PAUSE, Resync::SecondByte))),
    chatters: false,
};

/// A command by name and fields. Numbers are as on the wire.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
enum Command {
    /// R150: switch these rails on and the others off.
    PowerControl(PowerText),
    /// R150: duty of the four PWM outputs.
    SetPwmOutputs(DutyText),
    /// R150.
    GetPwmOutputs,
    /// R150.
    GetPwmInputs,
    /// R150.
    SystemInfo,
    /// R150.
    Heartbeat,
    /// R150.
    Version,
    /// R150: motor PWM.
    SetMotors(MotorsText),
}

/// Which rails are to be on: names, or the bits themselves.
#[derive(Debug, Clone, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct PowerText {
    /// Names of rails.
    on: Option<Vec<RailName>>,
    /// The bits as on the wire.
    status: Option<u32>,
}

/// Duties of A to D.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct DutyText {
    /// 0.1 %.
    duty: [u16; 4],
}

/// Motor PWM, 0.1 %, positive forward.
#[derive(Debug, Clone, Copy, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
struct MotorsText {
    /// Right motor.
    right: i16,
    /// Left motor.
    left: i16,
}

fn read(
    value: ValueDeserializer<'_>,
    _settings: &dyn DeviceSettings,
) -> Result<Message, toml::de::Error> {
    let request = match Command::deserialize(value)? {
        Command::PowerControl(power) => Request::PowerControl {
            status: match (&power.on, power.status) {
                (Some(on), None) => super::bits(on).into(),
                (None, Some(status)) => status,
                _ => {
                    let why = "`power_control` has either `on` or `status`";
                    return Err(serde::de::Error::custom(why));
                }
            },
        },
        Command::SetPwmOutputs(DutyText { duty }) => Request::SetPwmOutputs { duty },
        Command::SetMotors(MotorsText { right, left }) => Request::SetMotors { right, left },
        Command::GetPwmOutputs => Request::GetPwmOutputs,
        Command::GetPwmInputs => Request::GetPwmInputs,
        Command::SystemInfo => Request::SystemInfo,
        Command::Heartbeat => Request::Heartbeat,
        Command::Version => Request::Version,
    };
    Ok(Message {
        link: 0,
        bytes: request.encode(),
        command: Some(request.command()),
    })
}

struct Reader(Decoder);

impl ReplyReader for Reader {
    fn push(&mut self, now: SimTime, byte: u8) -> Vec<Found> {
        let mut found = Vec::new();
        self.0.expire(now, &mut |_| {});
        self.0.push(now, byte, &mut |decoded| {
            if let Decoded::Frame(frame) = decoded {
                found.extend(read_frame(&frame));
            }
        });
        found
    }
}

/// A reply; some modules set the command's high bit in it.
fn read_frame(frame: &Frame) -> Option<Found> {
    let plain = [frame.command, frame.command & 0x7F];
    plain.into_iter().find_map(|command| {
        let reply = Reply::parse(command, &frame.parameters).ok()?;
        Some(Found {
            command: Some(command),
            fields: fields(&reply),
        })
    })
}

fn fields(reply: &Reply) -> Fields {
    match *reply {
        Reply::Bool { success, .. } => vec![("success", Field::Flag(success))],
        Reply::PwmOutputs { duty } => vec![("duty", Field::list(duty))],
        Reply::PwmInputs { frequency_hz, duty } => vec![
            ("frequency_hz", Field::list(frequency_hz)),
            ("duty", Field::list(duty)),
        ],
        Reply::SystemInfo(info) => vec![
            ("voltage_12v", Field::list(info.voltage_12v)),
            ("voltage_48v", info.voltage_48v.into()),
            ("current_12v", Field::list(info.current_12v)),
            ("current_48v", info.current_48v.into()),
            ("temp_12v", Field::list(info.temp_12v)),
            ("sys_status", info.sys_status.into()),
            ("power_ctrl_mode", info.power_ctrl_mode.into()),
            ("pwm_ctrl_mode", info.pwm_ctrl_mode.into()),
            ("power_status", info.power_status.into()),
            ("pwm_status", info.pwm_status.into()),
        ],
        Reply::Version { hardware, software } => {
            vec![("hardware", hardware.into()), ("software", software.into())]
        }
        Reply::Motors {
            right_rpm,
            left_rpm,
            soc,
        } => vec![
            ("right_rpm", right_rpm.into()),
            ("left_rpm", left_rpm.into()),
            ("soc", soc.into()),
        ],
    }
}

/// Names that a reply to this command can have; to any command where it is not known.
fn field_names(command: Option<u8>) -> Vec<&'static str> {
    let all = COMMANDS.iter().map(|(code, _)| *code);
    let asked = all.filter(|code| command.is_none_or(|command| command == *code));
    // Of each command the one length that its reply has parses.
    asked
        .filter_map(|code| (0..=255).find_map(|length| Reply::parse(code, &vec![0; length]).ok()))
        .flat_map(|reply| fields(&reply))
        .map(|(name, _)| name)
        .collect()
}
