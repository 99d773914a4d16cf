//! Events of a mecanum car that a developer wants to know of.

use super::Link;
use super::ascii::{HIGHEST, LOWEST, LineError};
use super::motion::Change;
use crate::event::{EventKind, code};
use crate::scanner::Decoded;

crate::codes! {
    /// A packet was begun and not finished.
    PARTIAL_PACKET = "partial_packet", Warning, ClientUnlessDisturbed;
    /// A line that is not a command.
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
    QUEUE_FULL = "queue_full", Warning, ClientUnlessDisturbedOrLate;
    /// A motion was ignored because the remote control drives.
    IGNORED_IN_REMOTE = "ignored_in_remote", Warning, ClientUnlessLatelyDisturbed;
    /// A motion was ignored because the other link drives.
    IGNORED_FOR_ROS = "ignored_for_ros", Warning, ClientUnlessLatelyDisturbed;
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

/// The main link's stream held something that is not a packet.
pub(super) fn bad_stream(found: Decoded) -> EventKind {
    let (code, text, bytes) = match found {
        Decoded::Partial(bytes) => (
            PARTIAL_PACKET,
            "incomplete packet dropped after a pause:",
            bytes,
        ),
        Decoded::Noise(bytes) | Decoded::Frame(bytes) | Decoded::Wrong(bytes) => {
            (code::NOISE, "bytes that begin no packet:", bytes)
        }
    };
    EventKind::new(code, text).showing(Link::Main.index(), bytes)
}

/// A line on the ROS link is not a command, or not a good one; `line` is without its end.
pub(super) fn bad_line(error: LineError, line: Vec<u8>) -> EventKind {
    let (code, why) = match error {
        LineError::Malformed => (
            BAD_LINE,
            "one of X, Y, Z, A, B and a whole number are wanted".to_owned(),
        ),
        LineError::OutOfRange => (BAD_NUMBER, format!("{LOWEST} to {HIGHEST} is allowed")),
        LineError::TooLong => (LINE_TOO_LONG, format!("{} bytes are allowed", line.len())),
    };
    let text = format!("line `{}` ignored: {why}", line.escape_ascii());
    EventKind::new(code, text).with(Link::Ros.index(), line)
}

/// A motion began or ended.
pub(super) fn motion(change: Change) -> EventKind {
    match change {
        Change::Started(motion) => EventKind::new(MOTION_STARTED, format!("{motion} started")),
        Change::Done(motion) => EventKind::new(MOTION_DONE, format!("{motion} done")),
    }
}
