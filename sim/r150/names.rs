//! Names of conditions about an R150.

use rigsim_physics::r150::Rail;

use super::R150;
use crate::device::names::as_number;
use crate::device::{NameInfo, View};
use crate::r150_device::command::{each_rail, each_status_bit, sys_status};

/// What an R150 says; the default of any other device.
fn on<T: Default>(view: &View<'_>, get: impl FnOnce(&R150) -> T) -> T {
    view.device.get().map_or_else(T::default, get)
}

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::number("truth.wheel_right_rad_s", "rad/s", "true speed of the right wheels", |v| on(v, |r| r.truth().wheel_speed.right)),
    NameInfo::number("truth.wheel_left_rad_s", "rad/s", "true speed of the left wheels", |v| on(v, |r| r.truth().wheel_speed.left)),
    NameInfo::number("truth.motor_right_a", "A", "current through the right motor", |v| on(v, |r| r.truth().motor_current.right)),
    NameInfo::number("truth.motor_left_a", "A", "current through the left motor", |v| on(v, |r| r.truth().motor_current.left)),
    NameInfo::number("truth.battery_v", "V", "voltage at the battery's terminals", |v| on(v, |r| r.truth().battery_voltage)),
    NameInfo::number("truth.battery_a", "A", "current out of the battery, negative while charging", |v| on(v, |r| r.truth().battery_current)),
    NameInfo::number("truth.soc_percent", "%", "true state of charge", |v| on(v, |r| r.truth().soc * 100.0)),
    NameInfo::flag("truth.motor_right_derated", "heat limits the right motor's current", |v| on(v, |r| r.plant.health().derated.right)),
    NameInfo::flag("truth.motor_left_derated", "heat limits the left motor's current", |v| on(v, |r| r.plant.health().derated.left)),
    NameInfo::number("truth.motor_right_c", "degC", "temperature of the right motor", |v| on(v, |r| r.truth().motor_celsius.right)),
    NameInfo::number("truth.motor_left_c", "degC", "temperature of the left motor", |v| on(v, |r| r.truth().motor_celsius.left)),
    NameInfo::flag("truth.module_powered", "the IO module has a supply", |v| on(v, |r| r.plant.measurements().module_powered)),
    NameInfo::flag("mode.locked", "the remote control has locked the vehicle", |v| on(v, |r| r.device.vehicle().locked)),
    NameInfo::flag("mode.parked", "the parking brake is on", |v| on(v, |r| r.device.vehicle().parked)),
    NameInfo::flag("mode.autonomous", "the vehicle is in autonomous mode", |v| on(v, |r| r.device.vehicle().autonomous)),
    NameInfo::flag("mode.emergency_stop", "the emergency stop is in", |v| on(v, |r| r.device.vehicle().emergency_stop)),
    NameInfo::flag("mode.client_has_power", "the client controls the power outputs, not the app", |v| on(v, |r| r.device.control().by_client.power)),
    NameInfo::number("firmware.motor_right", "0.1 %", "motor set-point in effect, right, after watchdog and limits", |v| on(v, |r| f64::from(r.device.motor_set_point()[0]))),
    NameInfo::number("firmware.motor_left", "0.1 %", "motor set-point in effect, left, after watchdog and limits", |v| on(v, |r| f64::from(r.device.motor_set_point()[1]))),
    NameInfo::number("client.last_motor_command_age_s", "s", "time since the last motor command arrived; infinite before", |v| v.age_s(v.counters.last_motion.map(|(at, _)| at))),
    NameInfo::number("client.travel_since_motor_command_m", "m", "path driven since the last motor command arrived; 0 before", |v| v.travel_since_motion_m()),
    NameInfo::number("client.motor_commands", "", "motor commands so far", |v| as_number(v.counters.motion_requests)),
];

macro_rules! status_bits {
    ($($bit:literal $constant:ident $name:literal $text:literal;)+) => {
        pub(super) static STATUS: &[NameInfo] = &[$(
            NameInfo::flag(concat!("firmware.", $name), $text, |v| {
                on(v, |r| r.device.sys_status() & sys_status::$constant != 0)
            }),
        )+];
    };
}
each_status_bit!(status_bits);

/// Declares what conditions can say of each output.
macro_rules! rails {
    ($($rail:ident $name:literal $output:literal;)+) => {
        pub(super) static RAILS: &[NameInfo] = &[
            $( NameInfo::flag(concat!("rail.", $name, "_on"), concat!($output, " is switched on"), |v| {
                on(v, |r| r.device.power_status() >> Rail::$rail.index() & 1 == 1)
            }), )+
            $( NameInfo::number(concat!("rail.", $name, "_v"), "V", concat!("voltage at ", $output), |v| {
                on(v, |r| r.plant.measurements().rail_voltage[Rail::$rail.index()])
            }), )+
            $( NameInfo::number(concat!("rail.", $name, "_a"), "A", concat!("current out of ", $output), |v| {
                on(v, |r| r.plant.measurements().rail_current[Rail::$rail.index()])
            }), )+
        ];
    };
}
each_rail!(rails);
