//! The adapter of a client's computer: when bytes pass between the line and the client's driver.

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_settings::{SimTime, words};
use schemars::JsonSchema;
use serde::Deserialize;

words! {
    /// Adapter between a client's computer and the line.
    #[derive(Default, Deserialize, JsonSchema)]
    #[serde(rename_all = "kebab-case")]
    pub enum Adapter {
        /// A UART of the kind 16550A: it interrupts when it holds 8 bytes, or when nothing has come
        /// for as long as four bytes take. What is sent goes out at once.
        Uart = "uart",
        /// USB at full speed: bytes pass both ways at the beginning of each frame of 1 ms.
        #[default]
        Usb = "usb",
        /// USB as FTDI's: what arrives is held back until there are 62 bytes, or until the latency
        /// timer ends, 16 ms after the last packet.
        Ftdi = "ftdi",
        /// None: each byte passes by itself.
        Bytes = "bytes",
    }
}

/// Bytes that the transmitter of a UART holds beside the one that is going out, as the common 16550A
/// does. What waits here still goes out when a client leaves.
pub const UART_FIFO: usize = 16;
/// The same of an FT232R.
const FTDI_FIFO: usize = 128;
const FRAME: Duration = Duration::from_millis(1);
const LATENCY: Duration = Duration::from_millis(16);
/// Data bytes in a packet of 64, of which two are the status.
const FTDI_PACKET: usize = 62;
/// Linux's choice for a 16550A, of 1, 4, 8 and 14.
const UART_TRIGGER: usize = 8;
const UART_SILENCE: u32 = 4;

impl Adapter {
    /// Time from which a byte that is there at `at` can pass.
    pub(crate) fn passes(self, at: SimTime) -> SimTime {
        match self {
            Self::Uart | Self::Bytes => at,
            Self::Usb | Self::Ftdi => SimTime::ZERO + up_to(at.since(SimTime::ZERO), FRAME),
        }
    }

    /// Number of bytes for the line that it holds beside the one that is going out.
    pub(crate) fn buffer(self) -> usize {
        match self {
            Self::Uart | Self::Bytes => UART_FIFO,
            Self::Usb | Self::Ftdi => FTDI_FIFO,
        }
    }
}

/// Bytes that an adapter has heard. Those that it has passed on come first.
#[derive(Debug, Clone, Default)]
pub(crate) struct Inbox {
    bytes: VecDeque<u8>,
    passed: usize,
    /// Time at which the others pass if nothing follows.
    due: Option<SimTime>,
    /// Time at which bytes last passed.
    packet: SimTime,
}

impl Inbox {
    /// A byte has arrived; `byte_time` is what one takes.
    pub(crate) fn hear(&mut self, adapter: Adapter, at: SimTime, byte: u8, byte_time: Duration) {
        self.pass(|due| due < at);
        self.bytes.push_back(byte);
        let held = self.bytes.len() - self.passed;
        self.due = Some(match (adapter, self.due) {
            (Adapter::Uart, _) if held < UART_TRIGGER => at + byte_time * UART_SILENCE,
            (Adapter::Ftdi, Some(due)) if held < FTDI_PACKET => due,
            (Adapter::Ftdi, None) => self.packet + up_to(at.since(self.packet), LATENCY),
            (Adapter::Usb, Some(due)) => due,
            _ => adapter.passes(at),
        });
    }

    /// Adds to `bytes` what the client can read at `now`.
    pub(crate) fn take(&mut self, now: SimTime, bytes: &mut Vec<u8>) {
        self.pass(|due| due <= now);
        bytes.extend(self.bytes.drain(..std::mem::take(&mut self.passed)));
    }

    /// Time at which what it holds passes if nothing follows.
    pub(crate) fn due(&self) -> Option<SimTime> {
        self.due
    }

    /// Loses what it holds.
    pub(crate) fn clear(&mut self) {
        self.bytes.clear();
        (self.passed, self.due) = (0, None);
    }

    fn pass(&mut self, is_due: impl Fn(SimTime) -> bool) {
        if let Some(due) = self.due.take_if(|due| is_due(*due)) {
            self.passed = self.bytes.len();
            self.packet = due;
        }
    }
}

/// The first multiple of `step` that is not shorter.
fn up_to(span: Duration, step: Duration) -> Duration {
    let rest = span.as_nanos() % step.as_nanos();
    match u64::try_from(rest) {
        Ok(rest) if rest > 0 => span.saturating_add(step - Duration::from_nanos(rest)),
        _ => span,
    }
}

#[cfg(test)]
mod tests;
