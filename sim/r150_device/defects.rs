//! The firmware when it is out of order, as far as its shell does not see to that.

use rigsim_physics::r150::{R150Measurements, Sides};

use super::R150Device;
use super::command::SystemInfo;

impl R150Device {
    /// Returns whether the firmware takes no notice of what its sensors read. A supply that comes or
    /// goes it cannot overlook.
    pub(super) fn overlooks(&mut self, measured: &R150Measurements) -> bool {
        if self.measured.module_powered != measured.module_powered {
            return false;
        }
        if self.shell.defects.frozen_sensors && differ(&self.measured, measured) {
            self.shell.counts.frozen_sensors += 1;
        }
        self.shell.defects.frozen_sensors || self.shell.defects.hung
    }

    /// Puts the status in that the firmware no longer updates, if it does not.
    pub(super) fn stick(&mut self, info: SystemInfo) -> SystemInfo {
        let Some(old) = self.shell.stuck_status else {
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
        self.shell.counts.stuck_status += u64::from(stuck != info);
        stuck
    }
}

/// Returns whether a client could tell two readings apart.
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
