//! Targets of faults, and parameters that make no sense.

use std::time::Duration;

use super::parameters::{Direction, LinkName};
use super::{
    Fault, FaultKind, FirmwareFault, MechanicalFault, ProtocolFault, SensorFault, WireFault,
};

impl Fault {
    /// Checks that its parameters make sense on any device.
    ///
    /// # Errors
    /// Says in a sentence why not.
    pub fn check(&self) -> Result<(), String> {
        if let FaultKind::Protocol(ProtocolFault::WrongLength { by: 0, .. }) = self.kind {
            return Err("`by`: 0 bytes more is the right length".to_owned());
        }
        Ok(())
    }

    /// Names its target in words.
    #[must_use]
    pub fn in_words(&self) -> String {
        if let Some(motors) = self.scope.motors {
            return format!("motors {motors}");
        }
        match &self.kind {
            FaultKind::Sensor(
                SensorFault::UltrasonicMissing { sensor }
                | SensorFault::UltrasonicStuck { sensor }
                | SensorFault::UltrasonicGhost { sensor, .. },
            ) => format!("ultrasonic {sensor}"),
            FaultKind::Mechanical(MechanicalFault::PortsSwapped { port, with }) => {
                format!("ports {port} and {with}")
            }
            other => other.info().counts.trim_end_matches('.').to_owned(),
        }
    }

    /// The link on which it acts, if it acts on one: the main one unless it says otherwise.
    #[must_use]
    pub fn link(&self) -> Option<LinkName> {
        match self.kind {
            FaultKind::Wire(_) | FaultKind::Protocol(_) => {
                Some(self.scope.link.clone().unwrap_or_default())
            }
            FaultKind::Firmware(_)
            | FaultKind::Electrical(_)
            | FaultKind::Mechanical(_)
            | FaultKind::Operator(_)
            | FaultKind::Sensor(_) => None,
        }
    }

    /// By how much bytes of a client may still be late when it has ended.
    #[must_use]
    pub fn holds_back(&self) -> Duration {
        let FaultKind::Wire(fault) = &self.kind else {
            return Duration::ZERO;
        };
        match fault {
            WireFault::Delay { by, jitter } => by.0 + jitter.0,
            // Pieces are late by as many pauses as there are before them, which only the bytes say.
            WireFault::Fragmentation { .. } => Duration::ZERO,
            WireFault::BitFlips {}
            | WireFault::DroppedBytes {}
            | WireFault::DuplicatedBytes {}
            | WireFault::InsertedBytes {}
            | WireFault::Burst { .. }
            | WireFault::Stall {}
            | WireFault::Mute {}
            | WireFault::IdleNoise { .. }
            | WireFault::CablePulled {}
            | WireFault::WrongBaud { .. } => Duration::ZERO,
        }
    }

    /// Tells whether a device may get other bytes than its client has sent, or miss some. What that
    /// looks like is not held against the client.
    #[must_use]
    pub fn disturbs_requests(&self) -> bool {
        match &self.kind {
            FaultKind::Wire(_) => self.scope.direction != Direction::ToClient,
            FaultKind::Firmware(fault) => match fault {
                FirmwareFault::Reset { .. } | FirmwareFault::Hang {} => true,
                FirmwareFault::SlowReplies { .. }
                | FirmwareFault::StuckStatus {}
                | FirmwareFault::FrozenSensors {}
                | FirmwareFault::WatchdogOff {} => false,
            },
            FaultKind::Protocol(_)
            | FaultKind::Electrical(_)
            | FaultKind::Mechanical(_)
            | FaultKind::Operator(_)
            | FaultKind::Sensor(_) => false,
        }
    }
}
