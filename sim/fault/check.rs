//! Targets of faults, and parameters that make no sense.

use std::time::Duration;

use super::parameters::{Direction, LinkName, Motors};
use super::{Fault, FaultLevel};

impl Fault {
    /// Checks that its parameters make sense on any device.
    ///
    /// # Errors
    /// Says in a sentence why not.
    pub fn check(&self) -> Result<(), String> {
        match self {
            Self::WrongLength { by: 0, .. } => {
                Err("`by`: 0 bytes more is the right length".to_owned())
            }
            _ => Ok(()),
        }
    }

    /// Names its target in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        match (self, self.motors()) {
            (_, Some(motors)) => format!("motors {motors}"),
            (
                Self::UltrasonicMissing { sensor }
                | Self::UltrasonicStuck { sensor }
                | Self::UltrasonicGhost { sensor, .. },
                None,
            ) => format!("ultrasonic {sensor}"),
            (Self::PortsSwapped { port, with }, None) => format!("ports {port} and {with}"),
            (other, None) => other.info().counts.trim_end_matches('.').to_owned(),
        }
    }

    /// The link on which it acts, if it acts on one: the main one unless it says otherwise.
    #[must_use]
    pub fn link(&self) -> Option<LinkName> {
        let on_link = matches!(self.level(), FaultLevel::Wire | FaultLevel::Protocol);
        on_link.then(|| self.own_link().unwrap_or_default())
    }

    /// The motors or wheels that it is about, if it is about any.
    #[must_use]
    pub fn motors(&self) -> Option<Motors> {
        match self {
            Self::Blocked { motors }
            | Self::Dragging { motors, .. }
            | Self::FreeWheeling { motors }
            | Self::EncoderLost { motors }
            | Self::EncoderStuck { motors }
            | Self::EncoderNoisy { motors, .. }
            | Self::WiredBackwards { motors }
            | Self::BrakeStuckOn { motors }
            | Self::BrakeStuckOpen { motors } => Some(*motors),
            _ => None,
        }
    }

    /// By how much bytes of a client may still be late when it has ended.
    #[must_use]
    pub fn holds_back(&self) -> Duration {
        match self {
            Self::Delay { by, jitter, .. } => by.0 + jitter.0,
            _ => Duration::ZERO,
        }
    }

    /// Tells whether a device may get other bytes than its client has sent, or miss some. What that
    /// looks like is not held against the client.
    #[must_use]
    pub fn disturbs_requests(&self) -> bool {
        match self.level() {
            FaultLevel::Wire => self.direction() != Direction::ToClient,
            FaultLevel::Firmware => matches!(self, Self::Reset { .. } | Self::Hang { .. }),
            FaultLevel::Protocol
            | FaultLevel::Electrical
            | FaultLevel::Mechanical
            | FaultLevel::Operator
            | FaultLevel::Sensor => false,
        }
    }
}
