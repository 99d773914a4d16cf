//! One thing that a client, an operator, the hardware or the world does to a running rig.
//!
//! Numbers are taken modulo what there is, so that any value is an operation and a shorter sequence
//! stays a sequence, so that proptest can shrink it and libFuzzer can splice it.

use std::time::Duration;

use rigsim_runner::DevicePlan;

use crate::choice::Choice;

/// Something that is done.
#[derive(Debug, Clone, PartialEq, arbitrary::Arbitrary)]
pub enum Operation {
    /// A client sends.
    Send {
        /// On which port.
        port: u8,
        /// Message.
        message: Message,
    },
    /// Time passes.
    Wait(Wait),
    /// Time passes from event to event, so many times.
    Follow(u8),
    /// A client reads what has arrived.
    Read {
        /// On which port.
        port: u8,
    },
    /// A client opens a port.
    Attach {
        /// Index of the port.
        port: u8,
    },
    /// A client closes a port or dies.
    Detach {
        /// Index of the port.
        port: u8,
    },
    /// A client sets its end of the line.
    SetLine {
        /// On which port.
        port: u8,
        /// At which of some speeds; at the device's own if even.
        speed: u8,
        /// With two stop bits.
        two_stop_bits: bool,
        /// With echo and editing.
        cooked: bool,
    },
    /// Something breaks, or a person or the world does something.
    Apply {
        /// To which device.
        device: u8,
        /// Under which of a few names.
        name: u8,
        /// What.
        effect: Choice,
    },
    /// An effect ends.
    Clear {
        /// Index among those that were applied, ended already or not.
        which: u8,
    },
    /// The machine that runs the simulator is late.
    Late {
        /// By how much, ms.
        by: u8,
        /// For how long simulated time stood still, ms.
        stood: u8,
    },
}

/// Time that passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
pub enum Wait {
    /// In the order of a bit.
    Nanoseconds(u16),
    /// In the order of a byte or a frame.
    Microseconds(u16),
    /// In the order of a step of the physics and of the timeouts.
    Milliseconds(u8),
    /// In the order of the watchdogs.
    Tenths(u8),
    /// Up to a time at which something is due, and so much before or after it, ns.
    UntilDue(i8),
}

impl Wait {
    /// Length, when something is due in `due`.
    #[must_use]
    pub fn span(self, due: Duration) -> Duration {
        match self {
            Self::Nanoseconds(count) => Duration::from_nanos(count.into()),
            Self::Microseconds(count) => Duration::from_micros(count.into()),
            Self::Milliseconds(count) => Duration::from_millis(count.into()),
            Self::Tenths(count) => Duration::from_millis(100 * u64::from(count)),
            Self::UntilDue(off) if off < 0 => {
                due.saturating_sub(Duration::from_nanos(off.unsigned_abs().into()))
            }
            Self::UntilDue(off) => due + Duration::from_nanos(off.unsigned_abs().into()),
        }
    }
}

/// Message of a client.
#[derive(Debug, Clone, PartialEq, Eq, arbitrary::Arbitrary)]
pub enum Message {
    /// A command that the device knows.
    Command(Choice),
    /// One in the form of the link, with something wrong in it.
    Spoilt {
        /// The command as it should be.
        command: Choice,
        /// Byte by which it is known; the right one if `None`.
        with: Option<u8>,
        /// Bytes more or fewer.
        by: i8,
    },
    /// The beginning of a command.
    Torn {
        /// The whole command.
        command: Choice,
        /// Length of the beginning.
        length: u8,
    },
    /// Any bytes.
    Bytes(Vec<u8>),
    /// One byte over and over, up to what the line holds and more.
    Flood {
        /// Index of the byte.
        byte: u8,
        /// Times 20.
        count: u8,
    },
}

/// Most bytes of one message.
const MOST_BYTES: usize = 300;

impl Message {
    /// On a link of a device.
    #[must_use]
    pub fn bytes(&self, plan: &DevicePlan, link: usize) -> Vec<u8> {
        let framing = &plan.device.links[link].framing;
        let whole = |command: &Choice| {
            let settings = plan.own_settings();
            let message = settings.map(|settings| command.command(plan.device, link, settings));
            match message {
                Some(Ok(message)) => message.bytes,
                // Values that do not go together are not a command.
                _ => Vec::new(),
            }
        };
        match self {
            Self::Command(command) => whole(command),
            Self::Spoilt { command, with, by } => {
                let spoilt = match with {
                    Some(_) => framing.with_command(whole(command), *with),
                    None => whole(command),
                };
                framing.with_length(spoilt, *by)
            }
            Self::Torn { command, length } => {
                let mut bytes = whole(command);
                bytes.truncate(usize::from(*length) % (bytes.len() + 1));
                bytes
            }
            Self::Bytes(bytes) => bytes[..bytes.len().min(MOST_BYTES)].to_vec(),
            Self::Flood { byte, count } => vec![*byte; 20 * usize::from(*count)],
        }
    }
}
