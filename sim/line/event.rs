//! Events of a line.

use std::fmt;
use std::time::Duration;

use super::MOST_IN_FLIGHT;
use crate::event::{Code, EventKind, code};

/// Something that happened on a line.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum LineEvent {
    /// A client opened the port.
    Attached,
    /// The client closed the port or died.
    Detached,
    /// The client's speed is not the device's.
    BaudMismatch {
        /// Speed that the client has set.
        client: u32,
        /// Speed of the device.
        device: u32,
    },
    /// The client's speed is the device's again.
    BaudMatched {
        /// Speed of both.
        baud: u32,
    },
    /// The client's port echoes, edits or translates what passes.
    NotRaw,
    /// The client has set two stop bits.
    StopBits {
        /// The client's.
        client: u8,
    },
    /// The client has set the modem lines of its end, which a cable of three wires does not carry.
    ModemLines {
        /// Data terminal ready.
        dtr: bool,
        /// Request to send.
        rts: bool,
    },
    /// The client asks for a parity bit.
    Parity,
    /// The client waits for CTS before it sends.
    FlowControl,
    /// The client has set its speed to 0, which hangs up.
    HungUp,
    /// The client sent more than the line holds, and the rest was lost.
    SentTooMuch {
        /// Number of lost bytes.
        bytes: usize,
    },
    /// The system did not run the simulator for a while, during which simulated time stood still.
    SimulatorStalled {
        /// For how long.
        by: Duration,
    },
    /// The machine is too slow for the speed that was asked for.
    SimulatorTooSlow,
    /// The client has published a line that is not used.
    BadPublication {
        /// Reason.
        why: &'static str,
    },
    /// The client does not read; bytes for it were lost.
    Overrun {
        /// Number of bytes.
        bytes: u64,
    },
    /// The line was too full for a reply of the device, so that older ones gave way.
    ReplyDropped {
        /// Number of bytes that they had.
        bytes: usize,
    },
}

/// Something that happened on a line of a device.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct OnLine {
    /// Index of the link on the device.
    pub link: usize,
    /// Details.
    pub event: LineEvent,
}

impl EventKind for OnLine {
    fn code(&self) -> Code {
        match self.event {
            LineEvent::Attached => code::CLIENT_ATTACHED,
            LineEvent::Detached => code::CLIENT_DETACHED,
            LineEvent::BaudMismatch { .. } => code::BAUD_MISMATCH,
            LineEvent::BaudMatched { .. } => code::BAUD_MATCHED,
            LineEvent::NotRaw => code::LINE_NOT_RAW,
            LineEvent::StopBits { .. } => code::STOP_BITS,
            LineEvent::ModemLines { .. } => code::MODEM_LINES,
            LineEvent::Parity => code::PARITY,
            LineEvent::FlowControl => code::FLOW_CONTROL,
            LineEvent::HungUp => code::HUNG_UP,
            LineEvent::SentTooMuch { .. } => code::SENT_TOO_MUCH,
            LineEvent::SimulatorStalled { .. } => code::SIMULATOR_STALLED,
            LineEvent::SimulatorTooSlow => code::SIMULATOR_TOO_SLOW,
            LineEvent::BadPublication { .. } => code::BAD_PUBLICATION,
            LineEvent::Overrun { .. } => code::OVERRUN,
            LineEvent::ReplyDropped { .. } => code::LINE_FULL,
        }
    }

    fn link(&self) -> Option<usize> {
        Some(self.link)
    }

    fn lost_bytes(&self) -> u64 {
        match self.event {
            LineEvent::SentTooMuch { bytes } | LineEvent::ReplyDropped { bytes } => {
                u64::try_from(bytes).unwrap_or(u64::MAX)
            }
            LineEvent::Overrun { bytes } => bytes,
            _ => 0,
        }
    }
}

impl fmt::Display for OnLine {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.event.fmt(f)
    }
}

impl fmt::Display for LineEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Attached => f.write_str("client attached"),
            Self::Detached => f.write_str("client detached"),
            Self::BaudMismatch { client, device } => write!(
                f,
                "baud mismatch: the client has set {client} baud, the device runs at {device}; \
                 bytes are garbled both ways, open the port at {device} baud"
            ),
            Self::BaudMatched { baud } => write!(f, "baud mismatch ended: both run at {baud}"),
            Self::NotRaw => f.write_str(
                "the client's port is not raw: replies are echoed back as requests or changed on \
                 the way; open it raw (`stty -F PATH raw -echo`; pyserial does so by itself)",
            ),
            Self::StopBits { client } => write!(
                f,
                "the client has set {client} stop bits, the device uses 1; open the port with 1"
            ),
            Self::ModemLines { dtr, rts } => {
                let word = |set| if set { "on" } else { "off" };
                write!(
                    f,
                    "the client has set DTR {} and RTS {}",
                    word(*dtr),
                    word(*rts)
                )
            }
            Self::Parity => f.write_str(
                "the client asks for a parity bit, the device sends none: on the cable every byte \
                 would be an error; open the port without parity (8N1)",
            ),
            Self::FlowControl => f.write_str(
                "the client waits for CTS before it sends (CRTSCTS): on a cable of three wires it \
                 never comes, and not a byte goes out; open the port without RTS/CTS flow control",
            ),
            Self::HungUp => f.write_str(
                "the client has set its speed to 0, which hangs up: nothing passes until it sets \
                 another",
            ),
            Self::SentTooMuch { bytes } => write!(
                f,
                "{bytes} bytes lost: the client sent more than {MOST_IN_FLIGHT} bytes ahead"
            ),
            Self::SimulatorStalled { by } => write!(
                f,
                "the machine was busy and stalled the simulator for {} ms; simulated time stood \
                 still meanwhile",
                by.as_millis()
            ),
            Self::SimulatorTooSlow => f.write_str(
                "the machine cannot keep up: simulated time runs slower than asked for; lower \
                 --speed or take longer steps",
            ),
            Self::BadPublication { why } => {
                write!(f, "a line that the client published is not used: {why}")
            }
            Self::Overrun { bytes } => {
                write!(f, "{bytes} bytes lost: the client does not read its port")
            }
            Self::ReplyDropped { bytes } => write!(
                f,
                "{bytes} bytes of replies dropped, the oldest first: requests come faster than the line \
                 carries replies"
            ),
        }
    }
}
