//! Settings of a client's end of a serial line.

use serde::{Deserialize, Serialize};

/// Settings that a client has given its end of a serial line.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct ClientLine {
    /// Bits per second, any value; with 0 the port has hung up, and nothing passes.
    pub baud: u32,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
    /// Set if its port passes bytes on untouched, without echo, editing, translation, signals or flow
    /// control by characters.
    pub raw: bool,
    /// Set if it asks for a parity bit. No effect but a notification. On a pseudo-terminal Linux strips
    /// even parity from the settings without a trace, and leaves one of odd parity; it forces 8 data bits.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub parity: bool,
    /// Set if it waits for the line CTS before it sends. No effect but a notification.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub rts_cts: bool,
}

impl ClientLine {
    /// Returns the settings for a device that runs at `baud` with one stop bit.
    #[must_use]
    pub fn at(baud: u32) -> Self {
        Self {
            baud,
            stop_bits: 1,
            raw: true,
            parity: false,
            rts_cts: false,
        }
    }
}
