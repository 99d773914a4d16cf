//! Faults of the firmware: which bugs it has, and how often they have shown.

use crate::defects::{DefectCounts, Defects};
use crate::fault::FirmwareFault;

/// Adds what a fault does to what is wrong already.
pub(super) fn add(defects: &mut Defects, fault: &FirmwareFault) {
    match fault {
        // Done at once.
        FirmwareFault::Reset { .. } => {}
        FirmwareFault::Hang {} => defects.hung = true,
        FirmwareFault::SlowReplies { by } => defects.slow = defects.slow.saturating_add(by.0),
        FirmwareFault::StuckStatus {} => defects.stuck_status = true,
        FirmwareFault::FrozenSensors {} => defects.frozen_sensors = true,
        FirmwareFault::WatchdogOff {} => defects.watchdog_off = true,
    }
}

/// Counts how often a fault has shown, and says in words what did.
pub(super) fn count(counts: &DefectCounts, fault: &FirmwareFault) -> (u64, &'static str) {
    match fault {
        FirmwareFault::Reset { .. } => (0, ""),
        FirmwareFault::Hang {} => (counts.hung, "a byte not heard, or a packet not sent"),
        FirmwareFault::SlowReplies { .. } => (counts.slow, "a frame"),
        FirmwareFault::StuckStatus {} => (counts.stuck_status, "a reply with old status"),
        FirmwareFault::FrozenSensors {} => (counts.frozen_sensors, "a reading not taken over"),
        FirmwareFault::WatchdogOff {} => (counts.watchdog_off, "motors that should have stopped"),
    }
}
