//! The firmware when it is out of order: resets, hangs and other bugs.

use std::time::Duration;

use sim_physics::mecanum::MecanumMeasurements;
use sim_settings::SimTime;

use super::MecanumDevice;
use super::event::MecanumEvent;
use super::locomotion::Locomotion;
use crate::defects::{DefectCounts, Defects};

impl MecanumDevice {
    /// Replaces all that is wrong with the firmware.
    pub fn set_defects(&mut self, now: SimTime, defects: Defects) {
        self.advance_before(now);
        if !defects.watchdog_off {
            self.missed_timeout = false;
        }
        if !defects.stuck_status {
            self.stuck_status = None;
        } else if self.stuck_status.is_none() {
            self.stuck_status = Some(self.motor_state(now));
        }
        self.defects = defects;
    }

    /// Number of times that each defect has had an effect.
    #[must_use]
    pub fn defect_counts(&self) -> &DefectCounts {
        &self.defect_counts
    }

    /// Tells whether the settings give it a link timeout, which is its only watchdog.
    #[must_use]
    pub fn has_watchdog(&self) -> bool {
        self.settings.link_timeout.is_some()
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    pub fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.advance_before(now);
        if !self.measured.board_powered {
            return false;
        }
        self.forget();
        self.boot_due = Some(now + boot);
        self.event(now, MecanumEvent::Reset { boot });
        true
    }

    /// Tells whether the firmware has a supply, is up, and does not hang.
    pub(super) fn works(&self) -> bool {
        self.measured.board_powered && self.boot_due.is_none() && !self.defects.hung
    }

    pub(super) fn boot(&mut self, now: SimTime) {
        if self.boot_due.take_if(|due| *due <= now).is_some() {
            self.drive = Locomotion::new(&self.settings, &self.measured);
            self.schedule(now);
            self.event(now, MecanumEvent::Started);
        }
    }

    /// Tells whether the firmware takes bytes that have arrived.
    pub(super) fn hears(&mut self, bytes: usize) -> bool {
        if self.defects.hung && self.measured.board_powered {
            self.defect_counts.hung += bytes as u64;
        }
        self.works()
    }

    /// Lets the time of packets pass without sending them.
    pub(super) fn miss_packets(&mut self, now: SimTime) {
        let periods = [self.settings.status_period, self.settings.ros_report_period];
        for (due, period) in [&mut self.status_due, &mut self.report_due]
            .into_iter()
            .zip(periods)
        {
            if due.is_some_and(|due| due <= now) {
                *due = Some(now + period);
                self.defect_counts.hung += 1;
            }
        }
    }

    /// Readings of which the firmware takes notice. Pulses are counted by the hardware, and a supply that
    /// comes or goes cannot be overlooked.
    pub(super) fn overlook(&mut self, measured: &MecanumMeasurements) -> MecanumMeasurements {
        if !self.defects.frozen_sensors || self.measured.board_powered != measured.board_powered {
            return *measured;
        }
        let seen = MecanumMeasurements {
            pulses: measured.pulses,
            ..self.measured
        };
        self.defect_counts.frozen_sensors += u64::from(seen != *measured);
        seen
    }

    /// Returns the time by which the next packet or line is late.
    pub(super) fn slowness(&mut self) -> Duration {
        self.defect_counts.slow += u64::from(!self.defects.slow.is_zero());
        self.defects.slow
    }

    pub(super) fn note_stuck_status(&mut self, now: SimTime) {
        let old = self
            .stuck_status
            .is_some_and(|stuck| stuck != self.motor_state(now));
        self.defect_counts.stuck_status += u64::from(old);
    }
}
