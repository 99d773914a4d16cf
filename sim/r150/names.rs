//! Names of conditions about an R150.

use rigsim_physics::r150::{FuseId, Pair, R150Health, R150Measurements, R150Truth, Rail};

use super::R150;
use crate::device::names::as_number;
use crate::device::{NameInfo, View};
use crate::r150_device::R150Device;
use crate::r150_device::command::sys_status;
use crate::r150_device::vehicle::Vehicle;

fn r150<'a>(view: &View<'a>) -> Option<&'a R150> {
    view.device.get()
}

fn truth(view: &View<'_>, get: impl FnOnce(R150Truth) -> f64) -> f64 {
    r150(view).map_or(0.0, |r150| get(r150.truth()))
}

fn health(view: &View<'_>, is: impl FnOnce(R150Health) -> bool) -> bool {
    r150(view).is_some_and(|r150| is(r150.plant().health()))
}

fn plant(view: &View<'_>, get: impl FnOnce(R150Measurements) -> f64) -> f64 {
    r150(view).map_or(0.0, |r150| get(r150.plant().measurements()))
}

fn device(view: &View<'_>, get: impl FnOnce(&R150Device) -> f64) -> f64 {
    r150(view).map_or(0.0, |r150| get(r150.device()))
}

fn vehicle(view: &View<'_>, is: impl FnOnce(&Vehicle) -> bool) -> bool {
    r150(view).is_some_and(|r150| is(r150.device().vehicle()))
}

fn sys(view: &View<'_>, bit: u32) -> bool {
    r150(view).is_some_and(|r150| r150.device().sys_status() & bit != 0)
}

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::number("truth.wheel_right_rad_s", "rad/s", "true speed of the right wheels", |v| truth(v, |t| t.wheel_speed.right)),
    NameInfo::number("truth.wheel_left_rad_s", "rad/s", "true speed of the left wheels", |v| truth(v, |t| t.wheel_speed.left)),
    NameInfo::number("truth.motor_right_a", "A", "current through the right motor", |v| truth(v, |t| t.motor_current.right)),
    NameInfo::number("truth.motor_left_a", "A", "current through the left motor", |v| truth(v, |t| t.motor_current.left)),
    NameInfo::number("truth.battery_v", "V", "voltage at the battery's terminals", |v| truth(v, |t| t.battery_voltage)),
    NameInfo::number("truth.battery_a", "A", "current out of the battery, negative while charging", |v| truth(v, |t| t.battery_current)),
    NameInfo::number("truth.soc_percent", "%", "true state of charge", |v| truth(v, |t| t.soc * 100.0)),
    NameInfo::number("truth.temperature_ab_c", "degC", "temperature of the 12 V converters A and B", |v| plant(v, |m| m.temperature[Pair::Ab.index()])),
    NameInfo::number("truth.temperature_cd_c", "degC", "temperature of the 12 V converters C and D", |v| plant(v, |m| m.temperature[Pair::Cd.index()])),
    NameInfo::flag("truth.fuse_motor_right_blown", "the fuse of the right motor has blown", |v| health(v, |h| h.fuse_blown[FuseId::MotorRight.index()])),
    NameInfo::flag("truth.fuse_motor_left_blown", "the fuse of the left motor has blown", |v| health(v, |h| h.fuse_blown[FuseId::MotorLeft.index()])),
    NameInfo::flag("truth.fuse_tail_blown", "the fuse of the tail supply, which feeds the module, has blown", |v| health(v, |h| h.fuse_blown[FuseId::Tail.index()])),
    NameInfo::flag("truth.motor_right_derated", "heat limits the right motor's current", |v| health(v, |h| h.derated.right)),
    NameInfo::flag("truth.motor_left_derated", "heat limits the left motor's current", |v| health(v, |h| h.derated.left)),
    NameInfo::number("truth.motor_right_c", "degC", "temperature of the right motor", |v| truth(v, |t| t.motor_celsius.right)),
    NameInfo::number("truth.motor_left_c", "degC", "temperature of the left motor", |v| truth(v, |t| t.motor_celsius.left)),
    NameInfo::flag("truth.tipping", "a wheel would lift: the vehicle would tip over", |v| health(v, |h| h.tipping)),
    NameInfo::flag("truth.module_powered", "the IO module has a supply", |v| r150(v).is_some_and(|r| r.plant().measurements().module_powered)),
    NameInfo::flag("mode.locked", "the remote control has locked the vehicle", |v| vehicle(v, |v| v.locked)),
    NameInfo::flag("mode.parked", "the parking brake is on", |v| vehicle(v, |v| v.parked)),
    NameInfo::flag("mode.autonomous", "the vehicle is in autonomous mode", |v| vehicle(v, |v| v.autonomous)),
    NameInfo::flag("mode.emergency_stop", "the emergency stop is in", |v| vehicle(v, |v| v.emergency_stop)),
    NameInfo::flag("mode.client_has_power", "the client controls the power outputs, not the app", |v| r150(v).is_some_and(|r| r.device().control().by_client.power)),
    NameInfo::number("firmware.motor_right", "0.1 %", "motor set-point in effect, right, after watchdog and limits", |v| device(v, |d| f64::from(d.motor_set_point()[0]))),
    NameInfo::number("firmware.motor_left", "0.1 %", "motor set-point in effect, left, after watchdog and limits", |v| device(v, |d| f64::from(d.motor_set_point()[1]))),
    NameInfo::flag("firmware.overcurrent_ab", "overcurrent of the 12 V outputs A and B is latched", |v| sys(v, sys_status::OVERCURRENT_AB)),
    NameInfo::flag("firmware.overcurrent_cd", "overcurrent of the 12 V outputs C and D is latched", |v| sys(v, sys_status::OVERCURRENT_CD)),
    NameInfo::flag("firmware.overcurrent_48v", "overcurrent of the 48 V output is latched", |v| sys(v, sys_status::OVERCURRENT_48V)),
    NameInfo::flag("firmware.overcurrent_5v", "overcurrent of the 5 V outputs is latched", |v| sys(v, sys_status::OVERCURRENT_5V)),
    NameInfo::flag("firmware.over_temperature_ab", "the 12 V supply of A and B is too hot", |v| sys(v, sys_status::OVER_TEMPERATURE_AB)),
    NameInfo::flag("firmware.over_temperature_cd", "the 12 V supply of C and D is too hot", |v| sys(v, sys_status::OVER_TEMPERATURE_CD)),
    NameInfo::flag("firmware.power_module_fault", "the power module reports a fault", |v| sys(v, sys_status::POWER_MODULE_FAULT)),
    NameInfo::number("client.last_motor_command_age_s", "s", "time since the last motor command arrived; infinite before", |v| v.age_s(v.counters.last_motion.map(|(at, _)| at))),
    NameInfo::number("client.travel_since_motor_command_m", "m", "path driven since the last motor command arrived; 0 before", |v| v.travel_since_motion_m()),
    NameInfo::number("client.motor_commands", "", "motor commands so far", |v| as_number(v.counters.motion_requests)),
];

/// Declares what conditions can say of each output.
macro_rules! rails {
    ($($rail:ident $name:literal $output:literal;)+) => {
        pub(super) static RAILS: &[NameInfo] = &[
            $( NameInfo::flag(concat!("rail.", $name, "_on"), concat!($output, " is switched on"), |v| {
                r150(v).is_some_and(|r150| r150.device().power_status() >> Rail::$rail.index() & 1 == 1)
            }), )+
            $( NameInfo::number(concat!("rail.", $name, "_v"), "V", concat!("voltage at ", $output), |v| {
                plant(v, |measured| measured.rail_voltage[Rail::$rail.index()])
            }), )+
            $( NameInfo::number(concat!("rail.", $name, "_a"), "A", concat!("current out of ", $output), |v| {
                plant(v, |measured| measured.rail_current[Rail::$rail.index()])
            }), )+
        ];
    };
}

rails! {
    V12A "v12a" "the 12 V output A";
    V12B "v12b" "the 12 V output B";
    V12C "v12c" "the 12 V output C";
    V12D "v12d" "the 12 V output D";
    V48 "v48" "the 48 V output";
    V5 "v5" "the 5 V output";
}
