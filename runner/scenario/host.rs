//! What the scripted client does and expects.

use std::time::Duration;

use sim_core::mecanum_device::ascii;
use sim_core::mecanum_device::packet::{Request as Packet, Status};
use sim_core::r150_device::command::{Request, code};
use sim_core::r150_device::reply::Reply;
use sim_core::rig::PortId;
use toml::Value;

use super::document::{CommandText, HostText, PortText, PowerText, ReplyText};
use super::problems::Problems;
use crate::Kind;
use crate::fault::{LinkName, RailName};
use crate::rig_file::DevicePlan;
use crate::suggest::or_allowed;

/// Most bytes that a step sends or expects.
const MOST_BYTES: usize = 1024;

/// What the scripted client does at a port.
#[derive(Debug, Clone)]
pub(crate) struct HostAction {
    pub port: PortId,
    pub does: HostDoes,
    pub expect: Option<ReplyWanted>,
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum HostDoes {
    Send(Vec<u8>),
    Open,
    Close,
    Baud(u32),
    /// Only expects.
    Nothing,
}

/// What has to come back, and by when.
#[derive(Debug, Clone)]
pub(crate) struct ReplyWanted {
    pub within: Duration,
    /// The reply's command byte, where it is known.
    pub command: Option<u8>,
    pub wanted: Wanted,
}

#[derive(Debug, Clone)]
pub(crate) enum Wanted {
    /// Any answer.
    Any,
    Fields(Vec<(String, FieldWanted)>),
    Bytes(Vec<u8>),
    Silence,
}

/// What a field has to be.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum FieldWanted {
    Exactly(Field),
    Between(f64, f64),
}

/// The value of a field.
#[derive(Debug, Clone, PartialEq)]
pub(crate) enum Field {
    Flag(bool),
    Number(f64),
    List(Vec<f64>),
}

/// A reply's fields by name.
pub(crate) type Fields = Vec<(&'static str, Field)>;

/// Whether a reply is as wanted; if not, which field is not.
pub(crate) fn matches_fields(
    fields: &Fields,
    wanted: &[(String, FieldWanted)],
) -> Result<(), String> {
    for (name, wanted) in wanted {
        let found = fields.iter().find(|(known, _)| known == name);
        let fits = match (found.map(|(_, field)| field), wanted) {
            (Some(field), FieldWanted::Exactly(exact)) => field == exact,
            (Some(Field::Number(number)), FieldWanted::Between(low, high)) => {
                (low..=high).contains(&number)
            }
            _ => false,
        };
        if !fits {
            return Err(match found {
                Some((_, field)) => format!("`{name}` is {field:?}, wanted {wanted:?}"),
                None => format!("it has no `{name}`"),
            });
        }
    }
    Ok(())
}

/// The fields of an R150's reply.
pub(crate) fn r150_fields(reply: &Reply) -> Fields {
    let list = |values: &[f64]| Field::List(values.to_vec());
    let four = |values: [u16; 4]| list(&values.map(f64::from));
    match *reply {
        Reply::Bool { success, .. } => vec![("success", Field::Flag(success))],
        Reply::PwmOutputs { duty } => vec![("duty", four(duty))],
        Reply::PwmInputs { frequency_hz, duty } => vec![
            ("frequency_hz", list(&frequency_hz.map(f64::from))),
            ("duty", four(duty)),
        ],
        Reply::SystemInfo(info) => vec![
            ("voltage_12v", list(&info.voltage_12v.map(f64::from))),
            ("voltage_48v", Field::Number(info.voltage_48v.into())),
            ("current_12v", list(&info.current_12v.map(f64::from))),
            ("current_48v", Field::Number(info.current_48v.into())),
            ("temp_12v", list(&info.temp_12v.map(f64::from))),
            ("sys_status", Field::Number(info.sys_status.into())),
            (
                "power_ctrl_mode",
                Field::Number(info.power_ctrl_mode.into()),
            ),
            ("pwm_ctrl_mode", Field::Number(info.pwm_ctrl_mode.into())),
            ("power_status", Field::Number(info.power_status.into())),
            ("pwm_status", Field::Number(info.pwm_status.into())),
        ],
        Reply::Version { hardware, software } => vec![
            ("hardware", Field::Number(hardware.into())),
            ("software", Field::Number(software.into())),
        ],
        Reply::Motors {
            right_rpm,
            left_rpm,
            soc,
        } => vec![
            ("right_rpm", Field::Number(right_rpm.into())),
            ("left_rpm", Field::Number(left_rpm.into())),
            ("soc", Field::Number(soc.into())),
        ],
    }
}

/// The fields of a car's status packet.
pub(crate) fn status_fields(status: &Status) -> Fields {
    let four = |values: [u16; 4]| Field::List(values.map(f64::from).to_vec());
    vec![
        ("seq", Field::Number(status.seq.into())),
        ("v_x", Field::Number(status.v_x.into())),
        ("v_y", Field::Number(status.v_y.into())),
        ("axis_x", Field::Number(status.axis_x.into())),
        ("axis_y", Field::Number(status.axis_y.into())),
        ("ori", Field::Number(status.ori.into())),
        ("rfid", Field::Number(status.rfid.into())),
        ("magn", Field::Number(status.magn.into())),
        ("infra", Field::Number(status.infra.into())),
        ("ut_f", four(status.ut_f)),
        ("ut_b", four(status.ut_b)),
        ("moto_state", Field::Number(status.moto_state.into())),
        ("mile", Field::Number(status.mile.into())),
    ]
}

/// The fields of a line of the ROS link.
pub(crate) fn line_fields(report: &ascii::Report) -> Fields {
    #[expect(clippy::cast_precision_loss, reason = "these stay far below 2^53")]
    let number = |value: i64| Field::Number(value as f64);
    vec![
        ("speed", number(report.speed)),
        ("mileage", number(report.mileage)),
    ]
}

/// Names that a reply to this command can have; of any command where it is not known.
fn field_names(kind: Kind, link: usize, command: Option<u8>) -> Vec<&'static str> {
    let fields = match (kind, link) {
        (Kind::Mecanum, 0) => status_fields(&Status::default()),
        (Kind::Mecanum, _) => line_fields(&ascii::Report::default()),
        (Kind::R150, _) => {
            let all = [
                code::POWER_CONTROL,
                code::SET_PWM_OUTPUTS,
                code::GET_PWM_OUTPUTS,
                code::GET_PWM_INPUTS,
                code::SYSTEM_INFO,
                code::HEARTBEAT,
                code::VERSION,
                code::SET_MOTORS,
            ];
            let asked = all
                .into_iter()
                .filter(|code| command.is_none_or(|command| command == *code));
            // Of each command the one length that its reply has parses.
            asked
                .filter_map(|code| {
                    (0..=255).find_map(|length| Reply::parse(code, &vec![0; length]).ok())
                })
                .flat_map(|reply| r150_fields(&reply))
                .collect()
        }
    };
    fields.into_iter().map(|(name, _)| name).collect()
}

impl HostAction {
    pub(super) fn read(
        text: &HostText,
        at: std::ops::Range<usize>,
        device: usize,
        plan: &DevicePlan,
        problems: &mut Problems<'_>,
    ) -> Option<Self> {
        let link = match (text.link, &text.send) {
            (Some(LinkName::Ros), _) | (None, Some(CommandText::Line(_))) => 1,
            _ => 0,
        };
        if link >= plan.links().len() {
            let why = "this device has no ROS link; a mecanum car has one with `ros = true`";
            problems.add(at, why);
            return None;
        }
        let mut does = Vec::new();
        let mut command = None;
        if let Some(send) = &text.send {
            let (bytes, code) = problems.take(at.clone(), encode(send, plan, link))?;
            command = code;
            does.push(HostDoes::Send(bytes));
        }
        if let Some(bytes) = &text.bytes {
            let bytes = problems.take(bytes.span(), read_hex(bytes.get_ref()))?;
            does.push(HostDoes::Send(bytes));
        }
        does.extend(text.port.map(|port| match port {
            PortText::Open => HostDoes::Open,
            PortText::Close => HostDoes::Close,
        }));
        does.extend(text.baud.map(HostDoes::Baud));
        let expect = match &text.expect {
            Some(expect) => Some(ReplyWanted::read(
                expect, plan.kind, link, command, problems,
            )?),
            None => None,
        };
        if does.len() > 1 || (does.is_empty() && expect.is_none()) {
            let why = "exactly one of `send`, `bytes`, `port` and `baud` says what to do; \
                       without any, `expect` has to be there";
            problems.add(at, why);
            return None;
        }
        Some(Self {
            port: PortId { device, link },
            does: does.pop().unwrap_or(HostDoes::Nothing),
            expect,
        })
    }
}

impl ReplyWanted {
    fn read(
        text: &ReplyText,
        kind: Kind,
        link: usize,
        command: Option<u8>,
        problems: &mut Problems<'_>,
    ) -> Option<Self> {
        let wanted = match (&text.reply, &text.bytes, text.silence) {
            (None, None, false) => Wanted::Any,
            (None, None, true) => Wanted::Silence,
            (None, Some(bytes), false) => {
                Wanted::Bytes(problems.take(bytes.span(), read_hex(bytes.get_ref()))?)
            }
            (Some(reply), None, false) => {
                let names = field_names(kind, link, command);
                let mut fields = Vec::new();
                for (name, value) in reply.get_ref() {
                    let field = if names.contains(&name.as_str()) {
                        read_field(value).map_err(|why| format!("`{name}`: {why}"))
                    } else {
                        let allowed = or_allowed(name, &names);
                        Err(format!("that reply has no field `{name}`; {allowed}"))
                    };
                    fields.push((name.clone(), problems.take(reply.span(), field)?));
                }
                Wanted::Fields(fields)
            }
            _ => {
                let why = "only one of `reply`, `bytes` and `silence` can be expected";
                problems.add(text.within.span(), why);
                return None;
            }
        };
        Some(Self {
            within: text.within.get_ref().0,
            command,
            wanted,
        })
    }
}

fn read_field(value: &Value) -> Result<FieldWanted, String> {
    let allowed = "allowed: a number, true, false, a list of numbers, or { min = …, max = … }";
    #[expect(clippy::cast_precision_loss, reason = "fields have at most 32 bits")]
    let number = |value: &Value| match value {
        Value::Integer(whole) => Some(*whole as f64),
        Value::Float(number) => Some(*number),
        _ => None,
    };
    let exactly = |field| Ok(FieldWanted::Exactly(field));
    match value {
        Value::Boolean(flag) => exactly(Field::Flag(*flag)),
        Value::Array(values) => {
            let numbers: Option<Vec<f64>> = values.iter().map(number).collect();
            exactly(Field::List(numbers.ok_or(allowed)?))
        }
        Value::Table(range) => {
            if let Some(unknown) = range.keys().find(|key| *key != "min" && *key != "max") {
                return Err(format!("`{unknown}` is not known; {allowed}"));
            }
            let end = |key: &str, without: f64| match range.get(key) {
                Some(value) => number(value).ok_or(allowed),
                None => Ok(without),
            };
            let low = end("min", f64::NEG_INFINITY)?;
            Ok(FieldWanted::Between(low, end("max", f64::INFINITY)?))
        }
        other => exactly(Field::Number(number(other).ok_or(allowed)?)),
    }
}

/// A command's bytes as this device reads them, and the command byte of its reply.
fn encode(
    send: &CommandText,
    plan: &DevicePlan,
    link: usize,
) -> Result<(Vec<u8>, Option<u8>), String> {
    let order = plan.settings.mecanum.firmware.byte_order;
    let r150 = |request: Request| Ok((request.encode(), Some(request.command())));
    let packet = |packet: Packet| Ok((packet.encode_in(order), None));
    match (plan.kind, link, send) {
        (Kind::R150, _, CommandText::PowerControl(power)) => r150(Request::PowerControl {
            status: status(power)?,
        }),
        (Kind::R150, _, CommandText::SetPwmOutputs(duty)) => {
            r150(Request::SetPwmOutputs { duty: duty.duty })
        }
        (Kind::R150, _, CommandText::SetMotors(motors)) => r150(Request::SetMotors {
            right: motors.right,
            left: motors.left,
        }),
        (Kind::R150, _, CommandText::GetPwmOutputs) => r150(Request::GetPwmOutputs),
        (Kind::R150, _, CommandText::GetPwmInputs) => r150(Request::GetPwmInputs),
        (Kind::R150, _, CommandText::SystemInfo) => r150(Request::SystemInfo),
        (Kind::R150, _, CommandText::Heartbeat) => r150(Request::Heartbeat),
        (Kind::R150, _, CommandText::Version) => r150(Request::Version),
        (Kind::Mecanum, 0, CommandText::Motion(motion)) => packet(Packet::Motion {
            seq: motion.seq,
            is_reset: motion.is_reset,
            moving_idx: motion.moving_idx,
            s: motion.s,
            v: motion.v,
        }),
        (Kind::Mecanum, 0, CommandText::SetPose(pose)) => packet(Packet::SetPose {
            seq: pose.seq,
            axis_x: pose.axis_x,
            axis_y: pose.axis_y,
            ori: pose.ori,
        }),
        (Kind::Mecanum, 0, CommandText::ControlMode(mode)) => packet(Packet::ControlMode {
            seq: mode.seq,
            mode: mode.mode,
        }),
        (Kind::Mecanum, 1, CommandText::Line(line)) if line.len() <= MOST_BYTES => {
            Ok((format!("{line} \n").into_bytes(), None))
        }
        (Kind::R150, ..) => Err("an R150 has no such command".to_owned()),
        (Kind::Mecanum, 0, _) => Err("a mecanum car's main link has motion, set_pose and \
                                      control_mode"
            .to_owned()),
        (Kind::Mecanum, ..) => Err(format!(
            "the ROS link has `line`, of at most {MOST_BYTES} bytes"
        )),
    }
}

fn status(power: &PowerText) -> Result<u32, String> {
    match (&power.on, power.status) {
        (Some(on), None) => Ok(bits(on).into()),
        (None, Some(status)) => Ok(status),
        _ => Err("`power_control` has either `on` or `status`".to_owned()),
    }
}

/// The bits of rails.
pub(super) fn bits(rails: &[RailName]) -> u8 {
    rails
        .iter()
        .fold(0, |bits, rail| bits | 1 << rail.rail().index())
}

fn read_hex(text: &str) -> Result<Vec<u8>, String> {
    let digits: Vec<char> = text.chars().filter(|c| !c.is_whitespace()).collect();
    let wrong = || "bytes are pairs of hexadecimal digits, as in \"AA 55 00 07\"".to_owned();
    if digits.is_empty() || digits.len() % 2 == 1 {
        return Err(wrong());
    }
    if digits.len() > 2 * MOST_BYTES {
        let count = digits.len() / 2;
        return Err(format!(
            "{count} bytes are too many; at most {MOST_BYTES} are allowed"
        ));
    }
    let byte = |pair: &[char]| {
        let pair: String = pair.iter().collect();
        // A sign would be read as part of a number.
        let digits = pair.chars().all(|c| c.is_ascii_hexdigit());
        digits.then(|| u8::from_str_radix(&pair, 16).ok()).flatten()
    };
    digits
        .chunks(2)
        .map(byte)
        .collect::<Option<_>>()
        .ok_or_else(wrong)
}
