//! Events of a mecanum car: what they are called, and what they say.

use std::borrow::Cow;
use std::fmt;

use rigsim_settings::show_duration;

use crate::event::{Code, EventKind, Hex, code};
use crate::mecanum_device::ascii::{HIGHEST, LOWEST, LineError, REPORTS};
use crate::mecanum_device::motion::Change;
use crate::mecanum_device::settings::OverSpeed;
use crate::mecanum_device::{Discard, Field, Handling, Link, MAX_SPEED, MecanumEvent};
use crate::message::{Message, MessageInfo};
use crate::scanner::Decoded;

crate::codes! {
    /// A packet was begun and not finished.
    PARTIAL_PACKET = "partial_packet", Warning, ClientUnlessDisturbed;
    /// A line that is no command.
    BAD_LINE = "bad_line", Warning, ClientUnlessDisturbed;
    /// A line with a number out of range.
    BAD_NUMBER = "bad_number", Warning, ClientUnlessDisturbed;
    /// A line without an end.
    LINE_TOO_LONG = "line_too_long", Warning, ClientUnlessDisturbed;
    /// A speed out of range.
    SPEED_CLAMPED = "speed_clamped", Warning, ClientUnlessDisturbed;
    /// A speed out of range that was not clamped.
    SPEED_OUT_OF_RANGE = "speed_out_of_range", Warning, ClientUnlessDisturbed;
    /// `is_reset` is neither 0 nor 1.
    BAD_IS_RESET = "bad_is_reset", Warning, ClientUnlessDisturbed;
    /// `moving_idx` is unknown.
    BAD_MOVING_IDX = "bad_moving_idx", Warning, ClientUnlessDisturbed;
    /// The control type is unknown.
    BAD_CONTROL_TYPE = "bad_control_type", Warning, ClientUnlessDisturbed;
    /// A motion was refused because too many wait.
    QUEUE_FULL = "queue_full", Warning, ClientUnlessLate;
    /// A motion was ignored because the remote control drives.
    IGNORED_IN_REMOTE = "ignored_in_remote", Warning, Client;
    /// A motion was ignored because the other link drives.
    IGNORED_FOR_ROS = "ignored_for_ros", Warning, Client;
    /// A motion began.
    MOTION_STARTED = "motion_started", Notice, NoParty;
    /// A motion came to its end.
    MOTION_DONE = "motion_done", Notice, NoParty;
    /// The link timed out.
    LINK_TIMEOUT = "link_timeout", Warning, ClientUnlessDisturbedOrLate;
    /// Motions were discarded.
    MOTIONS_DISCARDED = "motions_discarded", Notice, NoParty;
    /// Change of who drives.
    CONTROL_MODE = "control_mode", Notice, NoParty;
    /// A key that does nothing now.
    KEY_IGNORED = "key_ignored", Warning, NoParty;
}

impl EventKind for MecanumEvent {
    fn link(&self) -> Option<usize> {
        match self {
            Self::Request(..)
            | Self::Status(..)
            | Self::BadStream(_)
            | Self::SpeedOutOfRange { .. }
            | Self::IgnoredForRos(_)
            | Self::BadField { .. } => Some(Link::Main.index()),
            Self::Command(_) | Self::Report(_) | Self::BadLine { .. } => Some(Link::Ros.index()),
            _ => None,
        }
    }

    fn code(&self) -> Code {
        match self {
            Self::Request(..) | Self::Command(_) => code::REQUEST,
            Self::Status(..) | Self::Report(_) => code::REPLY,
            Self::BadStream(Decoded::Partial(_)) => PARTIAL_PACKET,
            Self::BadStream(_) => code::NOISE,
            Self::BadLine { error, .. } => match error {
                LineError::Malformed => BAD_LINE,
                LineError::OutOfRange => BAD_NUMBER,
                LineError::TooLong => LINE_TOO_LONG,
            },
            Self::SpeedOutOfRange {
                handling: OverSpeed::Clamp,
                ..
            } => SPEED_CLAMPED,
            Self::SpeedOutOfRange { .. } => SPEED_OUT_OF_RANGE,
            Self::BadField { field, .. } => match field {
                Field::IsReset => BAD_IS_RESET,
                Field::MovingIdx => BAD_MOVING_IDX,
                Field::ControlType => BAD_CONTROL_TYPE,
            },
            Self::QueueFull(_) => QUEUE_FULL,
            Self::IgnoredInRemote(_) => IGNORED_IN_REMOTE,
            Self::IgnoredForRos(_) => IGNORED_FOR_ROS,
            Self::Motion(Change::Started(_)) => MOTION_STARTED,
            Self::Motion(Change::Done(_)) => MOTION_DONE,
            Self::Discarded {
                why: Discard::LinkTimeout(_),
                ..
            } => LINK_TIMEOUT,
            Self::Discarded { .. } => MOTIONS_DISCARDED,
            Self::ControlMode { .. } => CONTROL_MODE,
            Self::Operated(_) => code::OPERATED,
            Self::KeyIgnored(_) => KEY_IGNORED,
            Self::PowerLost => code::POWER_LOST,
            Self::Reset { .. } => code::FIRMWARE_RESET,
            Self::Started => code::STARTED,
        }
    }

    fn message(&self) -> Option<(&'static MessageInfo, Cow<'_, [u8]>)> {
        Some(match self {
            Self::Request(request, _) => (request.info(), request.payload().into()),
            Self::Command(command) => (command.info(), command.encode().into()),
            Self::Status(status, _) => (status.info(), status.payload().into()),
            Self::Report(report) => (&REPORTS[0], report.encode().into()),
            _ => return None,
        })
    }

    fn bytes(&self) -> Option<Cow<'_, [u8]>> {
        match self {
            Self::Request(request, order) => Some(request.encode_in(*order).into()),
            Self::Command(command) => Some(command.encode().into()),
            Self::Status(status, order) => Some(status.encode_in(*order).into()),
            Self::Report(report) => Some(report.encode().into()),
            Self::BadStream(
                Decoded::Frame(bytes)
                | Decoded::Wrong(bytes)
                | Decoded::Partial(bytes)
                | Decoded::Noise(bytes),
            )
            | Self::BadLine { bytes, .. } => Some(bytes.into()),
            _ => None,
        }
    }
}

impl fmt::Display for MecanumEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request(request, _) => request.fmt(f),
            Self::Command(command) => write!(f, "line {command}"),
            Self::Status(status, _) => status.fmt(f),
            Self::Report(report) => write!(f, "line {report}"),
            Self::BadStream(Decoded::Partial(bytes)) => {
                write!(f, "incomplete packet dropped after a pause: {}", Hex(bytes))
            }
            Self::BadStream(
                Decoded::Noise(bytes) | Decoded::Frame(bytes) | Decoded::Wrong(bytes),
            ) => {
                write!(f, "bytes that begin no packet: {}", Hex(bytes))
            }
            Self::BadLine { error, bytes } => {
                write!(f, "line `{}` ignored: ", bytes.escape_ascii())?;
                match error {
                    LineError::Malformed => {
                        f.write_str("one of X, Y, Z, A, B and a whole number are wanted")
                    }
                    LineError::OutOfRange => write!(f, "{LOWEST} to {HIGHEST} is allowed"),
                    LineError::TooLong => write!(f, "{} bytes are allowed", bytes.len()),
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
