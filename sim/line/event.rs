//! Events of a line.

use std::borrow::Cow;
use std::time::Duration;

use super::MOST_IN_FLIGHT;
use crate::event::{EventKind, code};

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

impl LineEvent {
    /// Returns it as an event on the device's link with this index.
    #[must_use]
    pub fn on(self, link: usize) -> EventKind {
        let lost = match self {
            Self::SentTooMuch { bytes } | Self::ReplyDropped { bytes } => bytes as u64,
            Self::Overrun { bytes } => bytes,
            _ => 0,
        };
        let (code, text): (_, Cow<'static, str>) = match self {
            Self::Attached => (code::CLIENT_ATTACHED, "client attached".into()),
            Self::Detached => (code::CLIENT_DETACHED, "client detached".into()),
            Self::BaudMismatch { client, device } => (
                code::BAUD_MISMATCH,
                format!(
                    "baud mismatch: the client has set {client} baud, the device runs at {device}; \
                     bytes are garbled both ways, open the port at {device} baud"
                )
                .into(),
            ),
            Self::BaudMatched { baud } => (
                code::BAUD_MATCHED,
                format!("baud mismatch ended: both run at {baud}").into(),
            ),
            Self::NotRaw => (
                code::LINE_NOT_RAW,
                "the client's port is not raw: replies are echoed back as requests or changed on \
                 the way; open it raw (`stty -F PATH raw -echo`; pyserial does so by itself)"
                    .into(),
            ),
            Self::StopBits { client } => (
                code::STOP_BITS,
                format!(
                    "the client has set {client} stop bits, the device uses 1; open the port with 1"
                )
                .into(),
            ),
            Self::ModemLines { dtr, rts } => {
                let [dtr, rts] = [dtr, rts].map(|set| if set { "on" } else { "off" });
                (
                    code::MODEM_LINES,
                    format!("the client has set DTR {dtr} and RTS {rts}").into(),
                )
            }
            Self::Parity => (
                code::PARITY,
                "the client asks for a parity bit, the device sends none: on the cable every byte \
                 would be an error; open the port without parity (8N1)"
                    .into(),
            ),
            Self::FlowControl => (
                code::FLOW_CONTROL,
                "the client waits for CTS before it sends (CRTSCTS): on a cable of three wires it \
                 never comes, and not a byte goes out; open the port without RTS/CTS flow control"
                    .into(),
            ),
            Self::HungUp => (
                code::HUNG_UP,
                "the client has set its speed to 0, which hangs up: nothing passes until it sets \
                 another"
                    .into(),
            ),
            Self::SentTooMuch { bytes } => (
                code::SENT_TOO_MUCH,
                format!(
                    "{bytes} bytes lost: the client sent more than {MOST_IN_FLIGHT} bytes ahead"
                )
                .into(),
            ),
            Self::SimulatorStalled { by } => (
                code::SIMULATOR_STALLED,
                format!(
                    "the machine was busy and stalled the simulator for {} ms; simulated time \
                     stood still meanwhile",
                    by.as_millis()
                )
                .into(),
            ),
            Self::SimulatorTooSlow => (
                code::SIMULATOR_TOO_SLOW,
                "the machine cannot keep up: simulated time runs slower than asked for; lower \
                 --speed or take longer steps"
                    .into(),
            ),
            Self::BadPublication { why } => (
                code::BAD_PUBLICATION,
                format!("a line that the client published is not used: {why}").into(),
            ),
            Self::Overrun { bytes } => (
                code::OVERRUN,
                format!("{bytes} bytes lost: the client does not read its port").into(),
            ),
            Self::ReplyDropped { bytes } => (
                code::LINE_FULL,
                format!(
                    "{bytes} bytes of replies dropped, the oldest first: requests come faster than \
                     the line carries replies"
                )
                .into(),
            ),
        };
        EventKind::new(code, text).on(link).losing(lost)
    }
}
