//! The firmware when it is out of order, as far as its shell does not see to that.

use rigsim_physics::mecanum::MecanumMeasurements;
use rigsim_settings::SimTime;

use super::MecanumDevice;
use crate::firmware::Firmware;

impl MecanumDevice {
    /// Returns whether the settings give it a link timeout, which is its only watchdog.
    #[must_use]
    pub fn has_watchdog(&self) -> bool {
        self.settings.link_timeout.is_some()
    }

    /// Returns whether the firmware has a supply, is up, and does not hang.
    pub(super) fn works(&self) -> bool {
        self.runs() && !self.shell.defects.hung
    }

    /// Passes over the times of packets without sending them.
    pub(super) fn miss_packets(&mut self, now: SimTime) {
        let periods = [self.settings.status_period, self.settings.ros_report_period];
        for (due, period) in [&mut self.status_due, &mut self.report_due]
            .into_iter()
            .zip(periods)
        {
            if due.is_some_and(|due| due <= now) {
                *due = Some(now + period);
                self.shell.counts.hung += 1;
            }
        }
    }

    /// Readings of which the firmware takes notice. Pulses are counted by the hardware, and a supply that
    /// comes or goes cannot be overlooked.
    pub(super) fn overlook(&mut self, measured: &MecanumMeasurements) -> MecanumMeasurements {
        if !self.shell.defects.frozen_sensors
            || self.measured.board_powered != measured.board_powered
        {
            return *measured;
        }
        let seen = MecanumMeasurements {
            pulses: measured.pulses,
            ..self.measured
        };
        self.shell.counts.frozen_sensors += u64::from(seen != *measured);
        seen
    }

    pub(super) fn count_stuck_status(&mut self, now: SimTime) {
        let old = self
            .shell
            .stuck_status
            .is_some_and(|stuck| stuck != self.motor_state(now));
        self.shell.counts.stuck_status += u64::from(old);
    }
}
