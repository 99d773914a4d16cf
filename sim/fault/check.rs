//! Which faults a device can have.

use super::Fault;
use super::parameters::LinkName;
use crate::device_kind::DeviceKind;
use crate::r150_device::command;

impl Fault {
    /// Whether a device of this kind can have it, with these parameters.
    ///
    /// # Errors
    /// Says in a sentence why not.
    pub fn check(&self, kind: DeviceKind) -> Result<(), String> {
        let id = self.id();
        let Some(able) = self.info().devices.first() else {
            return Err(format!("no device can have `{id}`"));
        };
        if !self.info().devices.contains(&kind) {
            return Err(match self {
                Self::BadCrc { .. } => {
                    format!("a {kind} cannot have `{id}`: its packets have no checksum")
                }
                Self::SidesSwapped { .. } => {
                    format!("a {kind} cannot have `{id}`; use `ports-swapped`")
                }
                Self::RemoteControlTakesOver { .. } => format!(
                    "a {kind} cannot have `{id}`: only its client can switch it to the remote \
                     control"
                ),
                _ => format!("a {kind} cannot have `{id}`; only a {able} can"),
            });
        }
        if kind == DeviceKind::R150 && self.link() == Some(LinkName::Ros) {
            return Err("an R150 has no ROS link".to_owned());
        }
        self.check_command(kind)?;
        self.check_parameters(kind)
    }

    /// A filter that can never match would be a fault that never triggers.
    fn check_command(&self, kind: DeviceKind) -> Result<(), String> {
        let Some(command) = self.command() else {
            return Ok(());
        };
        match kind {
            DeviceKind::R150 if command::name(command).is_none() => Err(format!(
                "`command`: the R150 has no command 0x{command:02X}; it has 0x02, 0x03, 0x04, \
                 0x05, 0x06, 0x07, 0x12 and 0xF0"
            )),
            DeviceKind::Mecanum if self.link() == Some(LinkName::Ros) => {
                Err("`command`: the lines of the ROS link have none".to_owned())
            }
            DeviceKind::Mecanum if command != 0 => Err(format!(
                "`command`: the car sends packets of type 0 only, not {command}"
            )),
            _ => Ok(()),
        }
    }

    fn check_parameters(&self, kind: DeviceKind) -> Result<(), String> {
        if let Some(motors) = self.motors()
            && kind == DeviceKind::R150
            && motors.is_wheel()
        {
            return Err(format!(
                "`motors`: the wheels of one side of an R150 are geared together; \"{motors}\" \
                 must be \"left\", \"right\" or \"all\""
            ));
        }
        match self {
            Self::RailLoad {
                power,
                resistance,
                current,
                ..
            } => {
                let given = [power.is_some(), resistance.is_some(), current.is_some()];
                if given.iter().filter(|given| **given).count() != 1 {
                    return Err(
                        "`rail-load` takes one of `power`, `resistance` and `current`".to_owned(),
                    );
                }
            }
            Self::PortsSwapped { port, with } if port == with => {
                return Err(format!("`ports-swapped`: both ports are \"{port}\""));
            }
            Self::WrongLength { by: 0, .. } => {
                return Err("`by`: 0 bytes more is the right length".to_owned());
            }
            Self::AppTakesControl {
                power: false,
                pwm: false,
            } => return Err("`app-takes-control` takes power, PWM or both".to_owned()),
            _ => {}
        }
        Ok(())
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

    fn command(&self) -> Option<u8> {
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
    pub(super) fn motors(&self) -> Option<super::parameters::Motors> {
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
}
