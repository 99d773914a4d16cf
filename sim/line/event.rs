//! Events of a line, in words. The link is yet to be said.

use std::time::Duration;

use super::MOST_IN_FLIGHT;
use crate::event::{EventKind, code};

/// A client opened the port.
#[must_use]
pub fn attached() -> EventKind {
    EventKind::new(code::CLIENT_ATTACHED, "client attached")
}

/// The client closed the port or died.
#[must_use]
pub fn detached() -> EventKind {
    EventKind::new(code::CLIENT_DETACHED, "client detached")
}

/// The client has set another speed than the device's.
#[must_use]
pub fn baud_mismatch(client: u32, device: u32) -> EventKind {
    let text = format!(
        "baud mismatch: the client has set {client} baud, the device runs at {device}; bytes are \
         garbled both ways, open the port at {device} baud"
    );
    EventKind::new(code::BAUD_MISMATCH, text)
}

/// The client's speed is the device's again.
pub(super) fn baud_matched(baud: u32) -> EventKind {
    let text = format!("baud mismatch ended: both run at {baud}");
    EventKind::new(code::BAUD_MATCHED, text)
}

/// The client's port echoes, edits or translates what passes.
pub(super) fn not_raw() -> EventKind {
    let text = "the client's port is not raw: replies are echoed back as requests or changed on \
                the way; open it raw (`stty -F PATH raw -echo`; pyserial does so by itself)";
    EventKind::new(code::LINE_NOT_RAW, text)
}

/// The client has set so many stop bits.
pub(super) fn stop_bits(client: u8) -> EventKind {
    let text =
        format!("the client has set {client} stop bits, the device uses 1; open the port with 1");
    EventKind::new(code::STOP_BITS, text)
}

/// The client has set the modem lines of its end, which a cable of three wires does not carry.
#[must_use]
pub fn modem_lines(dtr: bool, rts: bool) -> EventKind {
    let [dtr, rts] = [dtr, rts].map(|set| if set { "on" } else { "off" });
    let text = format!("the client has set DTR {dtr} and RTS {rts}");
    EventKind::new(code::MODEM_LINES, text)
}

/// The client asks for a parity bit.
#[must_use]
pub fn parity() -> EventKind {
    let text = "the client asks for a parity bit, the device sends none: on the cable every byte \
                would be an error; open the port without parity (8N1)";
    EventKind::new(code::PARITY, text)
}

/// The client waits for CTS before it sends.
pub(super) fn flow_control() -> EventKind {
    let text = "the client waits for CTS before it sends (CRTSCTS): on a cable of three wires it \
                never comes, and not a byte goes out; open the port without RTS/CTS flow control";
    EventKind::new(code::FLOW_CONTROL, text)
}

/// The client has set its speed to 0.
pub(super) fn hung_up() -> EventKind {
    let text = "the client has set its speed to 0, which hangs up: nothing passes until it sets \
                another";
    EventKind::new(code::HUNG_UP, text)
}

/// The client sent more than the line holds, and so many bytes were lost.
pub(super) fn sent_too_much(bytes: usize) -> EventKind {
    let text =
        format!("{bytes} bytes lost: the client sent more than {MOST_IN_FLIGHT} bytes ahead");
    EventKind::new(code::SENT_TOO_MUCH, text).losing(bytes as u64)
}

/// The system did not run the simulator for so long, during which simulated time stood still.
#[must_use]
pub fn simulator_stalled(by: Duration) -> EventKind {
    let text = format!(
        "the machine was busy and stalled the simulator for {} ms; simulated time stood still \
         meanwhile",
        by.as_millis()
    );
    EventKind::new(code::SIMULATOR_STALLED, text)
}

/// The machine is too slow for the speed that was asked for.
#[must_use]
pub fn simulator_too_slow() -> EventKind {
    let text = "the machine cannot keep up: simulated time runs slower than asked for; lower \
                --speed or take longer steps";
    EventKind::new(code::SIMULATOR_TOO_SLOW, text)
}

/// The client has published a line that is not used, and why.
#[must_use]
pub fn bad_publication(why: &str) -> EventKind {
    let text = format!("a line that the client published is not used: {why}");
    EventKind::new(code::BAD_PUBLICATION, text)
}

/// The client does not read, and so many bytes for it were lost.
#[must_use]
pub fn overrun(bytes: u64) -> EventKind {
    let text = format!("{bytes} bytes lost: the client does not read its port");
    EventKind::new(code::OVERRUN, text).losing(bytes)
}

/// The line was too full for a reply of the device, so that older ones of so many bytes gave way.
pub(crate) fn reply_dropped(bytes: usize) -> EventKind {
    let text = format!(
        "{bytes} bytes of replies dropped, the oldest first: requests come faster than the line \
         carries replies"
    );
    EventKind::new(code::LINE_FULL, text).losing(bytes as u64)
}
