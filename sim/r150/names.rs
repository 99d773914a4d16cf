//! Names of conditions about an R150.

use sim_physics::r150::{R150Health, R150Measurements, R150Truth, Rail};
use sim_settings::SimTime;

use super::R150;
use crate::device::names::as_number;
use crate::device::{NameInfo, Observer, View};
use crate::event::EventKind;
use crate::r150_device::command::{Reply, Request};
use crate::r150_device::system_info::{SystemInfo, sys_status};
use crate::r150_device::vehicle::Vehicle;
use crate::r150_device::{R150Device, R150Event};

/// Notes of an R150's events.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Noted {
    /// As the client last sent them.
    motors: [i16; 2],
    power: u32,
    duty: [u16; 4],
    /// As the module last said.
    motors_reply: Option<(SimTime, [i16; 2], u16)>,
    info: Option<(SimTime, SystemInfo)>,
    last_bool: bool,
}

impl Observer for Noted {
    fn note(&mut self, at: SimTime, event: &dyn EventKind) -> bool {
        match event.get() {
            Some(R150Event::Request { request, .. }) => match *request {
                Request::SetMotors { right, left } => {
                    self.motors = [right, left];
                    return true;
                }
                Request::PowerControl { status } => self.power = status,
                Request::SetPwmOutputs { duty } => self.duty = duty,
                // No name tells of the others.
                _ => {}
            },
            Some(R150Event::Reply { reply, .. }) => match *reply {
                Reply::Motors {
                    right_rpm,
                    left_rpm,
                    soc,
                } => self.motors_reply = Some((at, [right_rpm, left_rpm], soc)),
                Reply::SystemInfo(info) => self.info = Some((at, info)),
                Reply::Bool { success, .. } => self.last_bool = success,
                _ => {}
            },
            _ => {}
        }
        false
    }
}

fn noted(view: &View<'_>) -> Noted {
    view.noted().copied().unwrap_or_default()
}

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

fn rail_on<const BIT: usize>(view: &View<'_>) -> bool {
    r150(view).is_some_and(|r150| r150.device().power_status() >> BIT & 1 == 1)
}

fn rail_v<const RAIL: usize>(view: &View<'_>) -> f64 {
    plant(view, |measured| measured.rail_voltage[RAIL])
}

fn rail_a<const RAIL: usize>(view: &View<'_>) -> f64 {
    plant(view, |measured| measured.rail_current[RAIL])
}

fn asked<const BIT: usize>(view: &View<'_>) -> bool {
    noted(view).power >> BIT & 1 == 1
}

fn info(view: &View<'_>, get: impl FnOnce(&SystemInfo) -> f64) -> f64 {
    noted(view).info.map_or(0.0, |(_, info)| get(&info))
}

fn told_sys(view: &View<'_>, bit: u32) -> bool {
    let info = noted(view).info;
    info.is_some_and(|(_, info)| info.sys_status & bit != 0)
}

fn told_on<const BIT: usize>(view: &View<'_>) -> bool {
    let info = noted(view).info;
    info.is_some_and(|(_, info)| info.power_status >> BIT & 1 == 1)
}

const A: usize = Rail::V12A.index();
const B: usize = Rail::V12B.index();
const C: usize = Rail::V12C.index();
const D: usize = Rail::V12D.index();
const V48: usize = Rail::V48.index();
const V5: usize = Rail::V5.index();

#[rustfmt::skip] // One line a name: a table to read.
pub(super) static NAMES: &[NameInfo] = &[
    NameInfo::number("truth.wheel_right_rad_s", "rad/s", "true speed of the right wheels", |v| truth(v, |t| t.wheel_speed.right)),
    NameInfo::number("truth.wheel_left_rad_s", "rad/s", "true speed of the left wheels", |v| truth(v, |t| t.wheel_speed.left)),
    NameInfo::number("truth.motor_right_a", "A", "current through the right motor", |v| truth(v, |t| t.motor_current.right)),
    NameInfo::number("truth.motor_left_a", "A", "current through the left motor", |v| truth(v, |t| t.motor_current.left)),
    NameInfo::number("truth.battery_v", "V", "voltage at the battery's terminals", |v| truth(v, |t| t.battery_voltage)),
    NameInfo::number("truth.battery_a", "A", "current out of the battery, negative while charging", |v| truth(v, |t| t.battery_current)),
    NameInfo::number("truth.soc_percent", "%", "true state of charge", |v| truth(v, |t| t.soc * 100.0)),
    NameInfo::number("truth.charge_drawn_ah", "A·h", "charge drawn so far", |v| truth(v, |t| t.charge_drawn)),
    NameInfo::number("truth.temperature_ab_c", "degC", "temperature of the 12 V converters A and B", |v| plant(v, |m| m.temperature[0])),
    NameInfo::number("truth.temperature_cd_c", "degC", "temperature of the 12 V converters C and D", |v| plant(v, |m| m.temperature[1])),
    NameInfo::flag("truth.fuse_motor_right_blown", "the fuse of the right motor has blown", |v| health(v, |h| h.fuse_blown[0])),
    NameInfo::flag("truth.fuse_motor_left_blown", "the fuse of the left motor has blown", |v| health(v, |h| h.fuse_blown[1])),
    NameInfo::flag("truth.fuse_tail_blown", "the fuse of the tail supply, which feeds the module, has blown", |v| health(v, |h| h.fuse_blown[2])),
    NameInfo::flag("truth.fuse_small_modules_blown", "the fuse of the small modules has blown", |v| health(v, |h| h.fuse_blown[3])),
    NameInfo::flag("truth.motor_right_derated", "heat limits the right motor's current", |v| health(v, |h| h.derated.right)),
    NameInfo::flag("truth.motor_left_derated", "heat limits the left motor's current", |v| health(v, |h| h.derated.left)),
    NameInfo::number("truth.motor_right_c", "degC", "temperature of the right motor", |v| truth(v, |t| t.motor_celsius.right)),
    NameInfo::number("truth.motor_left_c", "degC", "temperature of the left motor", |v| truth(v, |t| t.motor_celsius.left)),
    NameInfo::number("truth.driver_right_c", "degC", "temperature of the right motor's driver", |v| truth(v, |t| t.driver_celsius.right)),
    NameInfo::number("truth.driver_left_c", "degC", "temperature of the left motor's driver", |v| truth(v, |t| t.driver_celsius.left)),
    NameInfo::flag("truth.tipping", "a wheel would lift: the vehicle would tip over", |v| health(v, |h| h.tipping)),
    NameInfo::flag("truth.module_powered", "the IO module has a supply", |v| r150(v).is_some_and(|r| r.plant().measurements().module_powered)),
    NameInfo::flag("rail.v12a_on", "the 12 V output A is switched on", rail_on::<A>),
    NameInfo::flag("rail.v12b_on", "the 12 V output B is switched on", rail_on::<B>),
    NameInfo::flag("rail.v12c_on", "the 12 V output C is switched on", rail_on::<C>),
    NameInfo::flag("rail.v12d_on", "the 12 V output D is switched on", rail_on::<D>),
    NameInfo::flag("rail.v48_on", "the 48 V output is switched on", rail_on::<V48>),
    NameInfo::flag("rail.v5_on", "the 5 V output is switched on", rail_on::<V5>),
    NameInfo::number("rail.v12a_v", "V", "voltage at the 12 V output A", rail_v::<A>),
    NameInfo::number("rail.v12b_v", "V", "voltage at the 12 V output B", rail_v::<B>),
    NameInfo::number("rail.v12c_v", "V", "voltage at the 12 V output C", rail_v::<C>),
    NameInfo::number("rail.v12d_v", "V", "voltage at the 12 V output D", rail_v::<D>),
    NameInfo::number("rail.v48_v", "V", "voltage at the 48 V output", rail_v::<V48>),
    NameInfo::number("rail.v5_v", "V", "voltage at the 5 V output", rail_v::<V5>),
    NameInfo::number("rail.v12a_a", "A", "current out of the 12 V output A", rail_a::<A>),
    NameInfo::number("rail.v12b_a", "A", "current out of the 12 V output B", rail_a::<B>),
    NameInfo::number("rail.v12c_a", "A", "current out of the 12 V output C", rail_a::<C>),
    NameInfo::number("rail.v12d_a", "A", "current out of the 12 V output D", rail_a::<D>),
    NameInfo::number("rail.v48_a", "A", "current out of the 48 V output", rail_a::<V48>),
    NameInfo::number("rail.v5_a", "A", "current out of the 5 V output", rail_a::<V5>),
    NameInfo::flag("mode.locked", "the remote control has locked the vehicle", |v| vehicle(v, |v| v.locked)),
    NameInfo::flag("mode.parked", "the parking brake is on", |v| vehicle(v, |v| v.parked)),
    NameInfo::flag("mode.autonomous", "the vehicle is in autonomous mode", |v| vehicle(v, |v| v.autonomous)),
    NameInfo::flag("mode.emergency_stop", "the emergency stop is in", |v| vehicle(v, |v| v.emergency_stop)),
    NameInfo::flag("mode.client_has_power", "the client controls the power outputs, not the app", |v| r150(v).is_some_and(|r| r.device().control().by_client.power)),
    NameInfo::flag("mode.client_has_pwm", "the client controls the PWM outputs, not the app", |v| r150(v).is_some_and(|r| r.device().control().by_client.pwm)),
    NameInfo::number("firmware.motor_right", "0.1 %", "motor set-point in effect, right, after watchdog and limits", |v| device(v, |d| f64::from(d.motor_set_point()[0]))),
    NameInfo::number("firmware.motor_left", "0.1 %", "motor set-point in effect, left, after watchdog and limits", |v| device(v, |d| f64::from(d.motor_set_point()[1]))),
    NameInfo::flag("firmware.overcurrent_ab", "overcurrent of the 12 V outputs A and B is latched", |v| sys(v, sys_status::OVERCURRENT_AB)),
    NameInfo::flag("firmware.overcurrent_cd", "overcurrent of the 12 V outputs C and D is latched", |v| sys(v, sys_status::OVERCURRENT_CD)),
    NameInfo::flag("firmware.overcurrent_48v", "overcurrent of the 48 V output is latched", |v| sys(v, sys_status::OVERCURRENT_48V)),
    NameInfo::flag("firmware.overcurrent_5v", "overcurrent of the 5 V outputs is latched", |v| sys(v, sys_status::OVERCURRENT_5V)),
    NameInfo::flag("firmware.over_temperature_ab", "the 12 V supply of A and B is too hot", |v| sys(v, sys_status::OVER_TEMPERATURE_AB)),
    NameInfo::flag("firmware.over_temperature_cd", "the 12 V supply of C and D is too hot", |v| sys(v, sys_status::OVER_TEMPERATURE_CD)),
    NameInfo::flag("firmware.power_module_fault", "the power module reports a fault", |v| sys(v, sys_status::POWER_MODULE_FAULT)),
    NameInfo::number("reported.motors_age_s", "s", "time since the last reply to a motor command began its way; infinite before", |v| v.age_s(noted(v).motors_reply.map(|(at, ..)| at))),
    NameInfo::number("reported.right_rpm", "r/min", "right speed in that reply; 0 before", |v| noted(v).motors_reply.map_or(0.0, |(_, [right, _], _)| f64::from(right))),
    NameInfo::number("reported.left_rpm", "r/min", "left speed in that reply; 0 before", |v| noted(v).motors_reply.map_or(0.0, |(_, [_, left], _)| f64::from(left))),
    NameInfo::number("reported.soc_percent", "%", "state of charge in that reply; 0 before", |v| noted(v).motors_reply.map_or(0.0, |(_, _, soc)| f64::from(soc) / 10.0)),
    NameInfo::number("reported.info_age_s", "s", "time since the last system info began its way; infinite before", |v| v.age_s(noted(v).info.map(|(at, _)| at))),
    NameInfo::number("reported.supply_v", "V", "voltage48v in that system info; 0 before", |v| info(v, |i| f64::from(i.voltage_48v) / 1000.0)),
    NameInfo::number("reported.v48_a", "A", "current48v in that system info", |v| info(v, |i| f64::from(i.current_48v) / 1000.0)),
    NameInfo::number("reported.v12a_a", "A", "current12v of A in that system info", |v| info(v, |i| f64::from(i.current_12v[0]) / 1000.0)),
    NameInfo::number("reported.v12b_a", "A", "current12v of B in that system info", |v| info(v, |i| f64::from(i.current_12v[1]) / 1000.0)),
    NameInfo::number("reported.v12c_a", "A", "current12v of C in that system info", |v| info(v, |i| f64::from(i.current_12v[2]) / 1000.0)),
    NameInfo::number("reported.v12d_a", "A", "current12v of D in that system info", |v| info(v, |i| f64::from(i.current_12v[3]) / 1000.0)),
    NameInfo::number("reported.temperature_ab_c", "degC", "temperature of A and B in that system info", |v| info(v, |i| f64::from(i.temp_12v[0]) / 10.0)),
    NameInfo::number("reported.temperature_cd_c", "degC", "temperature of C and D in that system info", |v| info(v, |i| f64::from(i.temp_12v[1]) / 10.0)),
    NameInfo::number("reported.sys_status", "", "sysStatus in that system info", |v| info(v, |i| f64::from(i.sys_status))),
    NameInfo::flag("reported.overcurrent_ab", "that bit of sysStatus", |v| told_sys(v, sys_status::OVERCURRENT_AB)),
    NameInfo::flag("reported.overcurrent_cd", "that bit of sysStatus", |v| told_sys(v, sys_status::OVERCURRENT_CD)),
    NameInfo::flag("reported.overcurrent_48v", "that bit of sysStatus", |v| told_sys(v, sys_status::OVERCURRENT_48V)),
    NameInfo::flag("reported.overcurrent_5v", "that bit of sysStatus", |v| told_sys(v, sys_status::OVERCURRENT_5V)),
    NameInfo::flag("reported.over_temperature_ab", "that bit of sysStatus", |v| told_sys(v, sys_status::OVER_TEMPERATURE_AB)),
    NameInfo::flag("reported.over_temperature_cd", "that bit of sysStatus", |v| told_sys(v, sys_status::OVER_TEMPERATURE_CD)),
    NameInfo::flag("reported.power_module_fault", "that bit of sysStatus", |v| told_sys(v, sys_status::POWER_MODULE_FAULT)),
    NameInfo::flag("reported.v12a_on", "that bit of powerStatus", told_on::<A>),
    NameInfo::flag("reported.v12b_on", "that bit of powerStatus", told_on::<B>),
    NameInfo::flag("reported.v12c_on", "that bit of powerStatus", told_on::<C>),
    NameInfo::flag("reported.v12d_on", "that bit of powerStatus", told_on::<D>),
    NameInfo::flag("reported.v48_on", "that bit of powerStatus", told_on::<V48>),
    NameInfo::flag("reported.v5_on", "that bit of powerStatus", told_on::<V5>),
    NameInfo::flag("reported.success", "the last reply of success or failure was success", |v| noted(v).last_bool),
    NameInfo::flag("client.attached", "a client has the port open", |v| v.observed.attached > 0),
    NameInfo::number("client.last_request_age_s", "s", "time since the last valid request arrived; infinite before", |v| v.age_s(v.observed.last_request)),
    NameInfo::number("client.last_motor_command_age_s", "s", "time since the last motor command arrived; infinite before", |v| v.age_s(v.observed.last_motion.map(|(at, _)| at))),
    NameInfo::number("client.travel_since_motor_command_m", "m", "path driven since the last motor command arrived; 0 before", |v| v.travel_since_motion_m()),
    NameInfo::number("client.motor_commands", "", "motor commands so far", |v| as_number(v.observed.motion_requests)),
    NameInfo::number("client.motor_right", "0.1 %", "right PWM of the last motor command; 0 before", |v| f64::from(noted(v).motors[0])),
    NameInfo::number("client.motor_left", "0.1 %", "left PWM of the last motor command; 0 before", |v| f64::from(noted(v).motors[1])),
    NameInfo::flag("client.asked_v12a", "the last power control wanted the 12 V output A on", asked::<A>),
    NameInfo::flag("client.asked_v12b", "the last power control wanted the 12 V output B on", asked::<B>),
    NameInfo::flag("client.asked_v12c", "the last power control wanted the 12 V output C on", asked::<C>),
    NameInfo::flag("client.asked_v12d", "the last power control wanted the 12 V output D on", asked::<D>),
    NameInfo::flag("client.asked_v48", "the last power control wanted the 48 V output on", asked::<V48>),
    NameInfo::flag("client.asked_v5", "the last power control wanted the 5 V output on", asked::<V5>),
    NameInfo::number("client.pwm_a", "0.1 %", "duty of PWM output A that the client last set", |v| f64::from(noted(v).duty[0])),
    NameInfo::number("client.pwm_b", "0.1 %", "duty of PWM output B that the client last set", |v| f64::from(noted(v).duty[1])),
    NameInfo::number("client.pwm_c", "0.1 %", "duty of PWM output C that the client last set", |v| f64::from(noted(v).duty[2])),
    NameInfo::number("client.pwm_d", "0.1 %", "duty of PWM output D that the client last set", |v| f64::from(noted(v).duty[3])),
    NameInfo::count("count.requests", "request", "valid requests"),
    NameInfo::count("count.replies", "reply", "replies"),
    NameInfo::count("count.bad_crc", "bad_crc", "frames with a wrong CRC"),
    NameInfo::count("count.partial_frame", "partial_frame", "frames that were not finished"),
    NameInfo::count("count.noise", "noise", "runs of bytes outside any frame"),
    NameInfo::count("count.unknown_command", "unknown_command", "frames with an unknown command"),
    NameInfo::count("count.wrong_length", "wrong_length", "frames with a wrong number of parameter bytes"),
    NameInfo::count("count.fuse_blown", "fuse_blown", "fuses that blew"),
    NameInfo::count("count.motor_hot", "motor_hot", "times that heat limited a motor"),
    NameInfo::count("count.tipping", "tipping", "times that a wheel would have lifted"),
    NameInfo::count("count.over_rate", "over_rate", "seconds in which motor commands came too fast"),
    NameInfo::count("count.app_in_control", "app_in_control", "commands refused because the app holds control"),
    NameInfo::count("count.not_driving", "not_driving", "motor commands that did not move the vehicle"),
    NameInfo::count("count.watchdog_fired", "watchdog_fired", "times that the motor watchdog stopped the motors"),
    NameInfo::count("count.heartbeat_lost", "heartbeat_lost", "times that the heartbeat was lost"),
    NameInfo::count("count.control_taken", "control_taken", "times that the client took control"),
    NameInfo::count("count.overcurrent", "overcurrent", "overcurrent trips"),
    NameInfo::count("count.over_temperature", "over_temperature", "over-temperature trips"),
    NameInfo::count("count.power_lost", "power_lost", "times that the module lost its supply"),
    NameInfo::count("count.firmware_reset", "firmware_reset", "times that the firmware restarted by itself"),
];
