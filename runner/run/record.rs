//! The lines of a trace.

use std::borrow::Cow;
use std::fmt::Write as _;

use rigsim_core::event::read_hex;
use rigsim_core::line::ClientLine;
use rigsim_core::rig::PortId;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use crate::scenario::{NamedText, ScenarioText};

/// Version of the form of a trace.
pub const FORMAT: u32 = 1;
/// Most bytes of one line.
pub const MOST_BYTES: usize = 1024;

/// A line.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[expect(
    missing_docs,
    reason = "the table in the documentation of traces has them"
)]
pub enum Record {
    Header(Box<Header>),
    Time {
        client: Cow<'static, str>,
        /// Seconds since 1970.
        #[serde(default, skip_serializing_if = "Option::is_none")]
        date: Option<u64>,
    },
    Attach {
        t: u64,
        port: PortRecord,
    },
    Detach {
        t: u64,
        port: PortRecord,
    },
    Line {
        t: u64,
        port: PortRecord,
        #[serde(flatten)]
        line: ClientLine,
    },
    Late {
        t: u64,
        by: u64,
        stood: u64,
    },
    In {
        t: u64,
        port: PortRecord,
        bytes: Hexed,
    },
    Host {
        t: u64,
        port: PortRecord,
        bytes: Hexed,
    },
    Out {
        t: u64,
        dt: u64,
        port: PortRecord,
        bytes: Hexed,
    },
    Event {
        t: u64,
        device: usize,
        code: Cow<'static, str>,
        text: String,
    },
    Pose {
        t: u64,
        device: usize,
        x: f64,
        y: f64,
        heading: f64,
    },
    Add {
        t: u64,
        step: String,
        /// The step as a table of a scenario file.
        text: String,
    },
    Clear {
        t: u64,
        step: String,
    },
    Pace {
        t: u64,
        change: String,
    },
    Publish {
        t: u64,
        line: String,
    },
    Step {
        t: u64,
        step: String,
        what: Cow<'static, str>,
    },
    Wait {
        t: u64,
        thread: u64,
        name: String,
        wait: String,
    },
    Failure {
        t: u64,
        step: Option<String>,
        what: String,
    },
    End {
        t: u64,
        passed: bool,
        /// Reasons for which the run was skipped.
        #[serde(default, skip_serializing_if = "Vec::is_empty")]
        not_applicable: Vec<String>,
        /// Lines that were lost because they were not taken.
        dropped: u64,
    },
}

/// What says when a line is over, and where it was.
#[derive(Debug, Clone, Deserialize)]
pub struct Timed {
    /// Kind of the line.
    pub kind: String,
    /// Its port, if it has one.
    pub port: Option<PortRecord>,
    #[serde(default)]
    t: u64,
    #[serde(default)]
    dt: u64,
    #[serde(default)]
    bytes: Hexed,
}

impl Timed {
    /// When it is over: the time of its last byte, ns.
    #[must_use]
    pub fn over(&self) -> u64 {
        let rest = self.bytes.0.len().saturating_sub(1) as u64;
        self.t.saturating_add(rest.saturating_mul(self.dt))
    }
}

/// Everything that a second run needs.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Version of the form of the trace.
    pub format: u32,
    /// Version of the program.
    pub program: String,
    /// From which everything random was derived.
    pub seed: u64,
    /// Set if bytes took time on the lines.
    pub paced: bool,
    /// Set if clients had adapters; without, each byte passed by itself, as in former versions.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub adapters: bool,
    /// Set if a real client was there.
    pub live: bool,
    /// Set if devices were only served, and `scenario` is a rig file.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub serving: bool,
    /// What the scenario was read from.
    #[serde(flatten)]
    pub source: ScenarioText,
    /// Settings that were not as they are by default, beside those of the file.
    pub settings: String,
    /// The world file.
    pub world: Option<NamedText>,
}

/// A port: device and link.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
pub struct PortRecord(pub usize, pub usize);

impl From<PortId> for PortRecord {
    fn from(port: PortId) -> Self {
        Self(port.device, port.link)
    }
}

impl From<PortRecord> for PortId {
    fn from(PortRecord(device, link): PortRecord) -> Self {
        Self { device, link }
    }
}

/// Bytes, written in hexadecimal.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct Hexed(pub Vec<u8>);

impl Serialize for Hexed {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut text = String::with_capacity(self.0.len() * 2);
        for byte in &self.0 {
            // Writing to a string cannot fail.
            let _ = write!(text, "{byte:02X}");
        }
        serializer.serialize_str(&text)
    }
}

impl<'de> Deserialize<'de> for Hexed {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        let text = Cow::<'de, str>::deserialize(deserializer)?;
        read_hex(text.chars())
            .map(Self)
            .ok_or_else(|| serde::de::Error::custom("pairs of hexadecimal digits are wanted"))
    }
}

impl Record {
    /// The line, without its line feed.
    pub fn to_line(&self) -> Option<String> {
        let line = serde_json::to_string(self);
        debug_assert!(line.is_ok(), "every record can be written");
        line.ok()
    }
}
