//! Events in the mecanum car that a developer wants to know of.

use std::time::Duration;

use super::OperatorInput;
use super::ascii::{self, LineError};
use super::kinematics::Movement;
use super::motion::{Change, Motion};
use super::packet::{Request, Status};
use super::settings::{ByteOrder, OverSpeed};
use crate::scanner::Decoded;

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

/// Treatment of a value that the protocol does not know.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Handling {
    /// The packet was ignored.
    Ignored,
    /// It was taken for this value.
    TakenFor(u8),
}

/// Reason for which motions were discarded.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Discard {
    /// Another one preempted them.
    Preempted,
    /// The control mode changed.
    ControlMode,
    /// The link timed out after this silence.
    LinkTimeout(Duration),
}

/// Something that happened on the board.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
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
    BadStream(Decoded),
    /// A line on the ROS link is no command, or not a good one.
    BadLine {
        /// Error of it.
        error: LineError,
        /// The line without its end.
        bytes: Vec<u8>,
    },
    /// A speed was outside ±500.
    SpeedOutOfRange {
        /// As the client sent it, 1/10 r/min.
        v: i16,
        /// Treatment of it.
        handling: OverSpeed,
    },
    /// A field of a request has a value that the protocol does not know.
    BadField {
        /// Field.
        field: Field,
        /// Value in it.
        value: u8,
        /// Treatment of it.
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
        /// Number of motions.
        count: usize,
        /// Reason.
        why: Discard,
    },
    /// The control mode changed.
    ControlMode {
        /// The remote control drives; the board otherwise.
        remote: bool,
    },
    /// An operator pressed a button.
    Operated(OperatorInput),
    /// A key has no effect because the board drives.
    KeyIgnored(Movement),
    /// The board lost its supply.
    PowerLost,
    /// The firmware restarts by itself.
    Reset {
        /// Time that it takes.
        boot: Duration,
    },
    /// The board has started.
    Started,
}
