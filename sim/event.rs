//! What is told to whoever watches: the log, the client report, scenarios.

mod code;

use std::borrow::Cow;
use std::fmt;

use sim_settings::SimTime;

use crate::fault::FaultPhase;
use crate::line::LineEvent;
use crate::mecanum_device::{Link, MecanumEvent};
use crate::r150_device::R150Event;

pub use code::{Blame, Code};

/// How much an event matters to somebody who writes a client.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// Ordinary requests and replies; shown when asked for.
    Traffic,
    /// Worth knowing.
    Notice,
    /// Something is wrong, or a command had no effect.
    Warning,
}

impl Level {
    /// Lower-case name.
    #[must_use]
    pub fn word(self) -> &'static str {
        match self {
            Self::Traffic => "traffic",
            Self::Notice => "notice",
            Self::Warning => "warning",
        }
    }
}

/// Something that happened, when and where.
#[derive(Debug, Clone, PartialEq)]
pub struct Event {
    /// When.
    pub at: SimTime,
    /// Index of the device in the rig.
    pub device: usize,
    /// What.
    pub kind: EventKind,
}

/// What happened, by who says so.
#[derive(Debug, Clone, PartialEq)]
pub enum EventKind {
    /// On one of the device's serial lines.
    Line {
        /// Index of the link on the device.
        link: usize,
        /// What.
        event: LineEvent,
    },
    /// Something went wrong on purpose, or may from now on.
    Fault {
        /// What whoever armed it calls it.
        name: String,
        /// Its id in the catalogue.
        id: &'static str,
        /// What becomes of it.
        phase: FaultPhase,
    },
    /// In an R150.
    R150(R150Event),
    /// In a mecanum car.
    Mecanum(MecanumEvent),
}

impl EventKind {
    /// How much it matters.
    #[must_use]
    pub fn level(&self) -> Level {
        match self {
            Self::Line { event, .. } => event.level(),
            Self::Fault { .. } => Level::Notice,
            Self::R150(event) => event.level(),
            Self::Mecanum(event) => event.level(),
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
            Self::Line { event, .. } => event.which(),
            Self::Fault { phase, .. } => match phase {
                FaultPhase::Armed => Code::FaultArmed,
                FaultPhase::Triggered { .. } => Code::FaultTriggered,
                FaultPhase::Cleared => Code::FaultCleared,
            },
            Self::R150(event) => event.which(),
            Self::Mecanum(event) => event.which(),
        }
    }

    /// Whether it is something that the client did and the protocol forbids, or that is risky.
    #[must_use]
    pub fn is_client_fault(&self) -> bool {
        match self {
            Self::Line { event, .. } => event.is_client_fault(),
            Self::Fault { .. } => false,
            Self::R150(event) => event.is_client_fault(),
            Self::Mecanum(event) => event.is_client_fault(),
        }
    }

    /// Index of the link that it is about, if it is about one.
    #[must_use]
    pub fn link(&self) -> Option<usize> {
        match self {
            Self::Line { link, .. } => Some(*link),
            Self::Fault { .. } => None,
            Self::R150(event) => event.bytes().map(|_| 0),
            Self::Mecanum(event) => event.link().map(Link::index),
        }
    }

    /// What it is to whoever counts.
    #[must_use]
    pub fn role(&self) -> Role {
        match self {
            Self::Line {
                event: LineEvent::Attached,
                ..
            } => Role::Attached,
            Self::Line {
                event: LineEvent::Detached,
                ..
            } => Role::Detached,
            Self::R150(R150Event::Request { .. })
            | Self::Mecanum(MecanumEvent::Request(..) | MecanumEvent::Command(_)) => Role::Request,
            Self::R150(R150Event::Reply { .. })
            | Self::Mecanum(MecanumEvent::Status(..) | MecanumEvent::Report(_)) => Role::Reply,
            Self::R150(R150Event::HeartbeatLost) => Role::HeartbeatLost,
            _ => Role::Other,
        }
    }

    /// How many bytes were lost.
    #[must_use]
    pub fn lost_bytes(&self) -> u64 {
        match self {
            Self::Line { event, .. } => event.lost_bytes(),
            _ => 0,
        }
    }

    /// The bytes it is about, if it is about bytes.
    #[must_use]
    pub fn bytes(&self) -> Option<Cow<'_, [u8]>> {
        match self {
            Self::Line { .. } | Self::Fault { .. } => None,
            Self::R150(event) => event.bytes().map(Cow::Borrowed),
            Self::Mecanum(event) => event.bytes().map(Cow::Owned),
        }
    }
}

impl fmt::Display for EventKind {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Line { event, .. } => event.fmt(f),
            Self::Fault { name, id, phase } => {
                // A name that says nothing new is not said twice.
                if name == id {
                    write!(f, "fault {id} ")?;
                } else {
                    write!(f, "fault {name} ({id}) ")?;
                }
                match phase {
                    FaultPhase::Armed => f.write_str("armed"),
                    FaultPhase::Triggered { what } => write!(f, "triggered: {what}"),
                    FaultPhase::Cleared => f.write_str("cleared"),
                }
            }
            Self::R150(event) => event.fmt(f),
            Self::Mecanum(event) => event.fmt(f),
        }
    }
}

/// What an event is to whoever counts.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Role {
    /// A client came.
    Attached,
    /// A client left.
    Detached,
    /// Something valid came from a client.
    Request,
    /// Something went to a client.
    Reply,
    /// A client was silent for too long.
    HeartbeatLost,
    /// Anything else.
    Other,
}

/// Bytes as spaced upper-case hexadecimal: `AA 55 00`.
#[derive(Debug, Clone, Copy)]
pub struct Hex<'a>(pub &'a [u8]);

impl fmt::Display for Hex<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, byte) in self.0.iter().enumerate() {
            let space = if index == 0 { "" } else { " " };
            write!(f, "{space}{byte:02X}")?;
        }
        Ok(())
    }
}
