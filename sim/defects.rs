//! Bugs that a device's firmware can have, the same for both devices.

use std::time::Duration;

/// Defects of a device's firmware.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Defects {
    /// It does nothing at all; its pins stay as they are.
    pub hung: bool,
    /// Time by which it answers later.
    pub slow: Duration,
    /// It no longer updates the status that it reports.
    pub stuck_status: bool,
    /// It no longer reads its sensors.
    pub frozen_sensors: bool,
    /// Its watchdog does not fire.
    pub watchdog_off: bool,
}

/// Number of times that each has had an effect so far.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct DefectCounts {
    /// Bytes not heard, packets not sent.
    pub hung: u64,
    /// Frames that were late.
    pub slow: u64,
    /// Replies with a status that was no longer true.
    pub stuck_status: u64,
    /// Readings that were not taken over and differed.
    pub frozen_sensors: u64,
    /// Times at which the watchdog should have fired.
    pub watchdog_off: u64,
}
