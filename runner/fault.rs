//! The faults of the catalogue, as scenarios use them.

use sim_core::device_kind::DeviceKind;
use sim_core::fault::parameters::Direction;
pub(crate) use sim_core::fault::parameters::{LinkName, RailName};
pub(crate) use sim_core::fault::{Fault, FaultHandle};

use crate::Kind;
use crate::rig_file::DevicePlan;

/// Whether a device as it is planned can have a fault.
pub(crate) fn check(fault: &Fault, plan: &DevicePlan) -> Result<(), String> {
    fault.check(match plan.kind {
        Kind::R150 => DeviceKind::R150,
        Kind::Mecanum => DeviceKind::Mecanum,
    })?;
    if fault.link() == Some(LinkName::Ros) && !plan.ros {
        return Err("this car has no ROS link; it has one with `ros = true`".to_owned());
    }
    Ok(())
}

/// Whether a device may get other bytes than its client has sent, or miss some. What that looks
/// like is not the client's fault.
pub(crate) fn disturbs_requests(fault: &Fault) -> bool {
    let reaches_device = |direction: &Direction| *direction != Direction::ToClient;
    match fault {
        Fault::BitFlips { direction, .. }
        | Fault::DroppedBytes { direction, .. }
        | Fault::DuplicatedBytes { direction, .. }
        | Fault::InsertedBytes { direction, .. }
        | Fault::Burst { direction, .. }
        | Fault::Delay { direction, .. }
        | Fault::Fragmentation { direction, .. }
        | Fault::Stall { direction, .. }
        | Fault::Mute { direction, .. }
        | Fault::IdleNoise { direction, .. } => reaches_device(direction),
        Fault::WrongBaud { .. }
        | Fault::CablePulled { .. }
        | Fault::Reset { .. }
        | Fault::Hang { .. } => true,
        _ => false,
    }
}
