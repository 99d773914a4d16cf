//! What becomes of a fault.

use std::fmt;

use crate::event::{Code, EventKind, code};

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
    /// Name of its step.
    pub name: String,
    /// Its id in the catalogue.
    pub id: &'static str,
    /// Stage that it has reached.
    pub phase: FaultPhase,
}

impl EventKind for FaultEvent {
    fn code(&self) -> Code {
        match self.phase {
            FaultPhase::Armed => code::FAULT_ARMED,
            FaultPhase::Triggered { .. } => code::FAULT_TRIGGERED,
            FaultPhase::Cleared => code::FAULT_CLEARED,
        }
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
