//! What a fault is about.

use super::Fault;
use super::parameters::{Direction, LinkName, Motors};

impl Fault {
    /// Whether its parameters make sense on any device.
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

    /// What it acts on, in words.
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

    /// The link on which it acts, if it acts on one.
    #[must_use]
    pub fn link(&self) -> Option<LinkName> {
        Some(match self {
            Self::BitFlips { link, .. }
            | Self::DroppedBytes { link, .. }
            | Self::DuplicatedBytes { link, .. }
            | Self::InsertedBytes { link, .. }
            | Self::Burst { link, .. }
            | Self::Delay { link, .. }
            | Self::Fragmentation { link, .. }
            | Self::Stall { link, .. }
            | Self::Mute { link, .. }
            | Self::WrongBaud { link, .. }
            | Self::IdleNoise { link, .. }
            | Self::CablePulled { link }
            | Self::WrongCommand { link, .. }
            | Self::WrongLength { link, .. }
            | Self::TornReply { link, .. }
            | Self::LateReply { link, .. }
            | Self::ReplyTwice { link, .. }
            | Self::MissingReply { link, .. }
            | Self::PreviousReply { link, .. }
            | Self::UnsolicitedFrame { link, .. } => *link,
            Self::BadCrc { .. } => LinkName::Main,
            _ => return None,
        })
    }

    /// The command to whose replies it keeps, if it keeps to one.
    #[must_use]
    pub fn command(&self) -> Option<u8> {
        match self {
            Self::BadCrc { command, .. }
            | Self::WrongCommand { command, .. }
            | Self::WrongLength { command, .. }
            | Self::TornReply { command, .. }
            | Self::LateReply { command, .. }
            | Self::ReplyTwice { command, .. }
            | Self::MissingReply { command, .. }
            | Self::PreviousReply { command, .. } => *command,
            _ => None,
        }
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

    /// Whether a device may get other bytes than its client has sent, or miss some. What that looks
    /// like is not held against the client.
    #[must_use]
    pub fn disturbs_requests(&self) -> bool {
        let reaches_device = |direction: &Direction| *direction != Direction::ToClient;
        match self {
            Self::BitFlips { direction, .. }
            | Self::DroppedBytes { direction, .. }
            | Self::DuplicatedBytes { direction, .. }
            | Self::InsertedBytes { direction, .. }
            | Self::Burst { direction, .. }
            | Self::Delay { direction, .. }
            | Self::Fragmentation { direction, .. }
            | Self::Stall { direction, .. }
            | Self::Mute { direction, .. }
            | Self::IdleNoise { direction, .. } => reaches_device(direction),
            Self::WrongBaud { .. }
            | Self::CablePulled { .. }
            | Self::Reset { .. }
            | Self::Hang { .. } => true,
            _ => false,
        }
    }
}
