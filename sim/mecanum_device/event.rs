//! What happens in the mecanum car that a developer wants to know.

use std::fmt;
use std::time::Duration;

use sim_settings::show_duration;

use super::ascii::{self, Fault, HIGHEST, LOWEST};
use super::codec::Decoded;
use super::kinematics::Movement;
use super::motion::{Change, Motion};
use super::packet::{Request, Status};
use super::settings::{ByteOrder, OverSpeed};
use super::{Action, Link, MAX_SPEED};
use crate::event::{Code, Hex, Level};

/// A field of a request that has few legal values.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Field {
    /// `is_reset`, 0 or 1.
    IsReset,
    /// `moving_idx`, 0 to 4.
    MovingIdx,
    /// `controll_type`, 0 or 1.
    ControlType,
}

/// What was made of a value that the protocol does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Handling {
    /// The packet was ignored.
    Ignored,
    /// It was taken for this value.
    TakenFor(u8),
    /// It stopped the car.
    Stopped,
}

/// Why motions were discarded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Discard {
    /// Another one preempted them.
    Preempted,
    /// The control mode changed.
    ControlMode,
    /// The link timed out after this silence.
    LinkTimeout(Duration),
    /// A packet or line was bad, and that stops the car.
    BadOrder,
}

/// Something that happened on the board.
#[derive(Debug, Clone, PartialEq)]
pub enum MecanumEvent {
    /// A request was understood on the main link, where bytes have this order.
    Request(Request, ByteOrder),
    /// A command was understood on the ROS link.
    Command(ascii::Command),
    /// A status packet began its way to the client of the main link.
    Status(Status, ByteOrder),
    /// A report line began its way to the client of the ROS link.
    Report(ascii::Report),
    /// The main link's stream held something that is no packet.
    BadStream(Decoded<Request>),
    /// A line on the ROS link is no command, or not a good one.
    BadLine {
        /// What is wrong with it.
        fault: Fault,
        /// The line without its end.
        bytes: Vec<u8>,
        /// The command that it was taken for all the same.
        taken_for: Option<ascii::Command>,
    },
    /// A speed was outside ±500.
    SpeedOutOfRange {
        /// As the client sent it, 1/10 r/min.
        v: i16,
        /// What was made of it.
        handling: OverSpeed,
    },
    /// A field of a request has a value that the protocol does not know.
    BadField {
        /// Which.
        field: Field,
        /// What it has.
        value: u8,
        /// What was made of it.
        handling: Handling,
    },
    /// A motion was lost because too many wait.
    QueueFull(Motion),
    /// A motion was ignored because the remote control drives.
    IgnoredInRemote(Motion),
    /// A motion on the main link was ignored because the ROS link drives.
    IgnoredForRos(Motion),
    /// A motion began or ended.
    Motion(Change),
    /// Motions that ran or waited were discarded.
    Discarded {
        /// How many.
        count: usize,
        /// Why.
        why: Discard,
    },
    /// The control mode changed.
    ControlMode {
        /// The remote control drives; the board otherwise.
        remote: bool,
    },
    /// Somebody pressed a button.
    Operated(Action),
    /// A key has no effect because the board drives.
    KeyIgnored(Movement),
    /// The board lost its supply.
    PowerLost,
    /// The firmware restarts by itself.
    Reset {
        /// What it takes.
        boot: Duration,
    },
    /// The board has started.
    Started,
}

impl MecanumEvent {
    /// How much it matters.
    #[must_use]
    pub fn level(&self) -> Level {
        match self {
            Self::Request(..) | Self::Command(_) | Self::Status(..) | Self::Report(_) => {
                Level::Traffic
            }
            Self::Discarded {
                why: Discard::LinkTimeout(_),
                ..
            } => Level::Warning,
            Self::Motion(_)
            | Self::Discarded { .. }
            | Self::ControlMode { .. }
            | Self::Operated(_)
            | Self::Started => Level::Notice,
            _ => Level::Warning,
        }
    }

    /// The link that it is about, if it is about one.
    #[must_use]
    pub fn link(&self) -> Option<Link> {
        match self {
            Self::Request(..)
            | Self::Status(..)
            | Self::BadStream(_)
            | Self::SpeedOutOfRange { .. }
            | Self::IgnoredForRos(_)
            | Self::BadField { .. } => Some(Link::Main),
            Self::Command(_) | Self::Report(_) | Self::BadLine { .. } => Some(Link::Ros),
            _ => None,
        }
    }

    /// A short stable name, the same in logs, reports and documentation.
    #[must_use]
    pub fn code(&self) -> &'static str {
        self.which().word()
    }

    /// What it is called.
    #[must_use]
    pub fn which(&self) -> Code {
        match self {
            Self::Request(..) | Self::Command(_) => Code::Request,
            Self::Status(..) | Self::Report(_) => Code::Reply,
            Self::BadStream(Decoded::Partial(_)) => Code::PartialPacket,
            Self::BadStream(_) => Code::Noise,
            Self::BadLine { fault, .. } => match fault {
                Fault::Malformed | Fault::Blank => Code::BadLine,
                Fault::OutOfRange => Code::BadNumber,
                Fault::TooLong => Code::LineTooLong,
            },
            Self::SpeedOutOfRange {
                handling: OverSpeed::Clamp,
                ..
            } => Code::SpeedClamped,
            Self::SpeedOutOfRange { .. } => Code::SpeedOutOfRange,
            Self::BadField { field, .. } => match field {
                Field::IsReset => Code::BadIsReset,
                Field::MovingIdx => Code::BadMovingIdx,
                Field::ControlType => Code::BadControlType,
            },
            Self::QueueFull(_) => Code::QueueFull,
            Self::IgnoredInRemote(_) => Code::IgnoredInRemote,
            Self::IgnoredForRos(_) => Code::IgnoredForRos,
            Self::Motion(Change::Started(_)) => Code::MotionStarted,
            Self::Motion(Change::Done(_)) => Code::MotionDone,
            Self::Discarded {
                why: Discard::LinkTimeout(_),
                ..
            } => Code::LinkTimeout,
            Self::Discarded { .. } => Code::MotionsDiscarded,
            Self::ControlMode { .. } => Code::ControlMode,
            Self::Operated(_) => Code::Operated,
            Self::KeyIgnored(_) => Code::KeyIgnored,
            Self::PowerLost => Code::PowerLost,
            Self::Reset { .. } => Code::FirmwareReset,
            Self::Started => Code::Started,
        }
    }

    /// Whether it is something that the client did and the protocol forbids, or that is risky.
    #[must_use]
    pub fn is_client_fault(&self) -> bool {
        self.which().is_client_fault()
    }

    /// The bytes it is about, if it is about bytes.
    #[must_use]
    pub fn bytes(&self) -> Option<Vec<u8>> {
        match self {
            Self::Request(request, order) => Some(request.encode_in(*order)),
            Self::BadStream(Decoded::Packet(request)) => Some(request.encode()),
            Self::Command(command) => Some(command.encode()),
            Self::Status(status, order) => Some(status.encode_in(*order)),
            Self::Report(report) => Some(report.encode()),
            Self::BadStream(Decoded::Partial(bytes) | Decoded::Noise(bytes))
            | Self::BadLine { bytes, .. } => Some(bytes.clone()),
            _ => None,
        }
    }
}

impl fmt::Display for MecanumEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request(request, _) | Self::BadStream(Decoded::Packet(request)) => request.fmt(f),
            Self::Command(command) => write!(f, "line {command}"),
            Self::Status(status, _) => status.fmt(f),
            Self::Report(report) => write!(f, "line {report}"),
            Self::BadStream(Decoded::Partial(bytes)) => {
                write!(f, "incomplete packet dropped after a pause: {}", Hex(bytes))
            }
            Self::BadStream(Decoded::Noise(bytes)) => {
                write!(f, "bytes that begin no packet: {}", Hex(bytes))
            }
            Self::BadLine {
                fault,
                bytes,
                taken_for,
            } => {
                let line = bytes.escape_ascii();
                match taken_for {
                    Some(command) => write!(f, "line `{line}` taken for {command}: ")?,
                    None => write!(f, "line `{line}` ignored: ")?,
                }
                match fault {
                    Fault::Malformed => {
                        f.write_str("one of X, Y, Z, A, B and a whole number are wanted")
                    }
                    Fault::OutOfRange => write!(f, "{LOWEST} to {HIGHEST} is allowed"),
                    Fault::TooLong => write!(f, "{} bytes are allowed", bytes.len()),
                    Fault::Blank => f.write_str("there is nothing on it"),
                }
            }
            Self::SpeedOutOfRange { v, handling } => {
                let made_of_it = match handling {
                    OverSpeed::Clamp => "clamped",
                    OverSpeed::Obey => "taken as it is",
                    OverSpeed::Ignore => "ignored with its motion",
                };
                write!(
                    f,
                    "speed {v} {made_of_it}: -{MAX_SPEED} to {MAX_SPEED} is allowed"
                )
            }
            Self::BadField {
                field,
                value,
                handling,
            } => {
                let (name, allowed) = match field {
                    Field::IsReset => ("is_reset", "0 and 1 are"),
                    Field::MovingIdx => ("moving_idx", "0 to 4 is"),
                    Field::ControlType => ("control type", "0 and 1 are"),
                };
                write!(f, "{name} {value} ")?;
                match handling {
                    Handling::Ignored => f.write_str("ignored with its packet")?,
                    Handling::TakenFor(other) => write!(f, "taken for {other}")?,
                    Handling::Stopped => f.write_str("stops the car")?,
                }
                write!(f, ": {allowed} allowed")
            }
            Self::QueueFull(motion) => write!(f, "{motion} lost: too many motions wait"),
            Self::IgnoredForRos(motion) => write!(f, "{motion} ignored: the ROS link drives"),
            Self::IgnoredInRemote(motion) => {
                write!(f, "{motion} ignored: the remote control drives")
            }
            Self::Motion(Change::Started(motion)) => write!(f, "{motion} started"),
            Self::Motion(Change::Done(motion)) => write!(f, "{motion} done"),
            Self::Discarded { count, why } => {
                let motions = if *count == 1 { "motion" } else { "motions" };
                write!(f, "{count} {motions} discarded: ")?;
                match why {
                    Discard::Preempted => write!(f, "another preempts"),
                    Discard::ControlMode => write!(f, "the control mode changed"),
                    Discard::BadOrder => write!(f, "what the client sent is not known"),
                    Discard::LinkTimeout(silence) => write!(
                        f,
                        "nothing valid from the client for {:.1} ms",
                        silence.as_secs_f64() * 1000.0
                    ),
                }
            }
            Self::ControlMode { remote: true } => write!(f, "the remote control drives"),
            Self::ControlMode { remote: false } => write!(f, "the board drives"),
            Self::Operated(action) => write!(f, "operator: {action}"),
            Self::KeyIgnored(movement) => {
                write!(f, "{movement} key has no effect: the board drives")
            }
            Self::PowerLost => write!(f, "the board lost its supply and is silent"),
            Self::Reset { boot } => write!(
                f,
                "the board's firmware restarts; it is silent for {}",
                show_duration(*boot)
            ),
            Self::Started => write!(f, "the board has started"),
        }
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())?;
        match self {
            Self::Motion {
                seq,
                is_reset,
                moving_idx,
                s,
                v,
            } => write!(
                f,
                " #{seq} is_reset {is_reset} moving_idx {moving_idx} s {s} v {v}"
            ),
            Self::SetPose {
                seq,
                axis_x,
                axis_y,
                ori,
            } => write!(f, " #{seq} x {axis_x} y {axis_y} ori {ori}"),
            Self::ControlMode { seq, mode } => write!(f, " #{seq} {mode}"),
        }
    }
}

impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "status #{} v {} {} at {} {} ori {} rfid {} magn 0x{:04X} infra {} front {:?} mm \
             rear {:?} mm motors {} mile {} mm",
            self.seq,
            self.v_x,
            self.v_y,
            self.axis_x,
            self.axis_y,
            self.ori,
            self.rfid,
            self.magn,
            self.infra,
            self.ut_f,
            self.ut_b,
            self.moto_state,
            self.mile,
        )
    }
}
