//! Faults of the firmware: which bugs it has, and how often they have shown.

use crate::defects::{DefectCounts, Defects};
use crate::fault::Fault;

/// Adds what a fault does to what is wrong already.
pub(super) fn add(defects: &mut Defects, fault: &Fault) {
    match fault {
        Fault::Hang {} => defects.hung = true,
        Fault::SlowReplies { by } => defects.slow = defects.slow.saturating_add(by.0),
        Fault::StuckStatus {} => defects.stuck_status = true,
        Fault::FrozenSensors {} => defects.frozen_sensors = true,
        Fault::WatchdogOff {} => defects.watchdog_off = true,
        _ => {}
    }
}

/// Counts how often a fault has shown, and says in words what did.
pub(super) fn count(counts: &DefectCounts, fault: &Fault) -> Option<(u64, &'static str)> {
    Some(match fault {
        Fault::Hang {} => (counts.hung, "a byte not heard, or a packet not sent"),
        Fault::SlowReplies { .. } => (counts.slow, "a frame"),
        Fault::StuckStatus {} => (counts.stuck_status, "a reply with old status"),
        Fault::FrozenSensors {} => (counts.frozen_sensors, "a reading not taken over"),
        Fault::WatchdogOff {} => (counts.watchdog_off, "motors that should have stopped"),
        _ => return None,
    })
}
