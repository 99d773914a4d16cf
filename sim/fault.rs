//! Faults, on purpose: bytes on the wire, frames, firmware, hardware, operators, sensors.
//!
//! A fault acts at its own level only. Electrical, mechanical, operator and sensor faults change
//! the hardware or work its buttons, and reach the client through what the firmware then measures;
//! none writes a status into a reply. Faults of the firmware are bugs in it.
//!
//! [`Rig::inject`](crate::rig::Rig::inject) arms a fault, [`Rig::clear`](crate::rig::Rig::clear)
//! ends it, and any number may be armed at once: they act in the order in which they were armed.
//! Each random one draws from streams of its own, named by the fault's name and direction, so that
//! another fault never changes what it does. Without a fault none of this runs.

mod catalogue;
mod check;
mod defaults;
mod mechanics;
pub mod parameters;

#[cfg(test)]
mod tests;

use std::borrow::Cow;
use std::fmt;

pub use catalogue::{
    ElectricalFault, FaultKind, FirmwareFault, MechanicalFault, OperatorFault, ProtocolFault,
    SensorFault, WireFault, catalogue,
};

use catalogue::Written;
pub(crate) use mechanics::MotorState;
use parameters::{Direction, LinkName, Motors, Probability};
use schemars::{JsonSchema, Schema, SchemaGenerator};
use serde::{Deserialize, Serialize};

use crate::event::{Code, EventKind, Level, Role, code};

sim_settings::words! {
    /// At what level something goes wrong, in the order of the catalogue.
    #[non_exhaustive]
    pub enum FaultLevel {
        /// Bytes on their way.
        Wire = "wire",
        /// Whole frames, packets and lines of the device.
        Protocol = "protocol",
        /// The device's program.
        Firmware = "firmware",
        /// Supply, outputs, fuses.
        Electrical = "electrical",
        /// Motors, wheels, brakes, load, ground.
        Mechanical = "mechanical",
        /// People.
        Operator = "operator",
        /// Sensors of the world.
        Sensor = "sensor",
    }
}

/// A fault of the catalogue.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct FaultInfo {
    /// Its `kind` in files.
    pub id: &'static str,
    /// Level at which it acts.
    pub level: FaultLevel,
    /// Set if every device can have it, since it is none of the device's own.
    pub everywhere: bool,
    /// Parameters that it takes.
    pub parameters: &'static [ParameterInfo],
    /// Effect that a client notices.
    pub client_sees: &'static str,
    /// Effect that counts as a trigger.
    pub counts: &'static str,
    /// Summary in a sentence.
    pub summary: &'static str,
}

/// A parameter of a fault.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct ParameterInfo {
    /// Its key in files.
    pub name: &'static str,
    /// Meaning, and the value unless given.
    pub description: &'static str,
    /// Set if it must be given.
    pub required: bool,
}

impl ParameterInfo {
    /// One that many faults have, and that may be left out.
    const fn shared(name: &'static str, description: &'static str) -> Self {
        Self {
            name,
            description,
            required: false,
        }
    }
}

/// Something that goes wrong. In files a table with the fault's id as `kind` and its parameters
/// beside it.
#[derive(Debug, Clone, PartialEq, Deserialize, Serialize)]
#[serde(from = "Written", into = "Written")]
pub struct Fault {
    /// What goes wrong.
    pub kind: FaultKind,
    /// On what it acts, and how often.
    pub scope: Scope,
}

/// Parameters that many faults take. What a fault does not take has its default.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Scope {
    /// Motors, or wheels of a car.
    pub motors: Option<Motors>,
    /// The command to whose replies it keeps.
    pub command: Option<u8>,
    /// Probability of each time.
    pub probability: Probability,
    /// Number of times that it acts at most.
    pub count: Option<u64>,
    /// Direction in which it acts.
    pub direction: Direction,
    /// The link on which it acts, if it says so.
    pub link: Option<LinkName>,
}

impl Fault {
    /// Returns the row of the catalogue.
    #[must_use]
    pub fn info(&self) -> &'static FaultInfo {
        self.kind.info()
    }

    /// Its `kind` in files.
    #[must_use]
    pub fn id(&self) -> &'static str {
        self.info().id
    }
}

impl JsonSchema for Fault {
    fn schema_name() -> Cow<'static, str> {
        "Fault".into()
    }

    fn json_schema(generator: &mut SchemaGenerator) -> Schema {
        Written::json_schema(generator)
    }
}

/// Refusal to arm a fault.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FaultError {
    /// There is no such device in the rig.
    #[error("there is no device {0}")]
    NoDevice(usize),
    /// The device cannot have it.
    #[error("{0}")]
    Impossible(String),
    /// Too many are armed.
    #[error("more than {MOST_ARMED} faults at once on one device, or {MOST_EVER} in one run")]
    TooMany,
}

/// Most faults armed at once on one device.
pub(crate) const MOST_ARMED: usize = 256;
/// Most faults armed in a run.
pub(crate) const MOST_EVER: usize = 1_000_000;

/// Stage in the life of a fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum FaultPhase {
    /// It may act from now on.
    Armed,
    /// It acted for the first time.
    Triggered {
        /// On what.
        what: String,
    },
    /// It has ended.
    Cleared,
}

/// Something became of a fault.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FaultEvent {
    /// Name from whoever armed it.
    pub name: String,
    /// Its id in the catalogue.
    pub id: &'static str,
    /// Stage that it has reached.
    pub phase: FaultPhase,
}

impl EventKind for FaultEvent {
    fn level(&self) -> Level {
        Level::Notice
    }

    fn code(&self) -> Code {
        match self.phase {
            FaultPhase::Armed => code::FAULT_ARMED,
            FaultPhase::Triggered { .. } => code::FAULT_TRIGGERED,
            FaultPhase::Cleared => code::FAULT_CLEARED,
        }
    }

    fn role(&self) -> Role {
        Role::Other
    }
}

impl fmt::Display for FaultEvent {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self { name, id, phase } = self;
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
}

/// Zeros added or bytes taken away before the last `kept`.
pub(crate) fn resized(mut bytes: Vec<u8>, by: i8, kept: usize) -> Vec<u8> {
    let tail = bytes.split_off(bytes.len().saturating_sub(kept));
    let length = bytes.len().saturating_add_signed(isize::from(by));
    bytes.resize(length, 0);
    bytes.extend(tail);
    bytes
}
