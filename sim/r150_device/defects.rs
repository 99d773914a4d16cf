//! The firmware when it is out of order: resets, hangs and other bugs.

use std::time::Duration;

use sim_physics::r150::{R150Measurements, Sides};
use sim_settings::SimTime;

use super::R150Device;
use super::event::R150Event;
use super::system_info::SystemInfo;
use crate::defects::{DefectCounts, Defects};

impl R150Device {
    /// Replaces all that is wrong with the firmware.
    pub fn set_defects(&mut self, now: SimTime, defects: Defects) {
        self.advance_before(now);
        if self.defects.watchdog_off && !defects.watchdog_off {
            self.motors.mend_watchdog(now);
        }
        if !defects.stuck_status {
            self.stuck_status = None;
        } else if self.stuck_status.is_none() {
            self.stuck_status = Some(self.system_status());
        }
        self.defects = defects;
    }

    /// Number of times that each defect has had an effect.
    #[must_use]
    pub fn defect_counts(&self) -> &DefectCounts {
        &self.defect_counts
    }

    /// The firmware restarts, and is up after `boot`; says whether it ran.
    pub fn reset(&mut self, now: SimTime, boot: Duration) -> bool {
        self.advance_before(now);
        if !self.measured.module_powered {
            return false;
        }
        self.forget();
        self.boot_due = Some(now + boot);
        self.event(now, R150Event::Reset { boot });
        true
    }

    /// Tells whether the firmware has a supply and is up.
    pub(super) fn runs(&self) -> bool {
        self.measured.module_powered && self.boot_due.is_none()
    }

    pub(super) fn boot(&mut self, now: SimTime) {
        if self.boot_due.take_if(|due| *due <= now).is_some() {
            self.event(now, R150Event::Started);
        }
    }

    /// Tells whether the firmware takes bytes that have arrived.
    pub(super) fn hears(&mut self, bytes: usize) -> bool {
        if self.defects.hung && self.runs() {
            self.defect_counts.hung += bytes as u64;
        }
        self.runs() && !self.defects.hung
    }

    /// Tells whether the firmware takes no notice of what its sensors read. A supply that comes or
    /// goes it cannot overlook.
    pub(super) fn overlooks(&mut self, measured: &R150Measurements) -> bool {
        if self.measured.module_powered != measured.module_powered {
            return false;
        }
        if self.defects.frozen_sensors && differ(&self.measured, measured) {
            self.defect_counts.frozen_sensors += 1;
        }
        self.defects.frozen_sensors || self.defects.hung
    }

    /// Returns the time by which the next reply is late.
    pub(super) fn slowness(&mut self) -> Duration {
        self.defect_counts.slow += u64::from(!self.defects.slow.is_zero());
        self.defects.slow
    }

    /// Puts the status in that the firmware no longer updates, if it does not.
    pub(super) fn stick(&mut self, info: SystemInfo) -> SystemInfo {
        let Some(old) = self.stuck_status else {
            return info;
        };
        let stuck = SystemInfo {
            sys_status: old.sys_status,
            power_ctrl_mode: old.power_ctrl_mode,
            pwm_ctrl_mode: old.pwm_ctrl_mode,
            power_status: old.power_status,
            pwm_status: old.pwm_status,
            ..info
        };
        self.defect_counts.stuck_status += u64::from(stuck != info);
        stuck
    }
}

/// Tells whether a client could tell two readings apart.
fn differ(one: &R150Measurements, other: &R150Measurements) -> bool {
    let apart = |one: &[f64], other: &[f64], by: f64| {
        let mut pairs = one.iter().zip(other);
        pairs.any(|(one, other)| (one - other).abs() >= by)
    };
    let rpm = |sides: Sides<f64>| [sides.right, sides.left];
    apart(&rpm(one.motor_rpm), &rpm(other.motor_rpm), 1.0)
        || apart(&[one.soc], &[other.soc], 0.001)
        || apart(&[one.bus_voltage], &[other.bus_voltage], 0.1)
        || apart(&one.rail_voltage, &other.rail_voltage, 0.1)
        || apart(&one.rail_current, &other.rail_current, 0.1)
        || apart(&[one.converter_12v], &[other.converter_12v], 0.1)
        || apart(&[one.supply_current], &[other.supply_current], 0.1)
        || apart(&one.temperature, &other.temperature, 0.5)
        || one.pwm_in != other.pwm_in
        || one.power_module_fault != other.power_module_fault
}
