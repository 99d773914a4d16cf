//! The firmware of the XAG R150's IO module, and the vehicle controller beside it.
//!
//! [`R150Device`] is a state machine: bytes, measurements, button presses and time go in; reply
//! frames, pin states and events come out. It sees pins, never physics. Any bytes are legal input.
//!
//! Its driver
//! 1. never moves time back,
//! 2. calls [`R150Device::advance`] at (or after) each [`R150Device::next_deadline`]; what is due
//!    between is done in order, each at its own time,
//! 3. after any call takes all of [`R150Device::poll_output`] and [`R150Device::poll_event`],
//! 4. applies [`R150Device::commands`] to the plant, and hands what the plant then measures to
//!    [`R150Device::sense`].
//!
//! Bytes that arrive exactly at a deadline come before it.

pub mod can;
mod client_clock;
pub mod codec;
pub mod command;
pub mod control;
mod defects;
pub mod event;
pub mod group;
pub mod motors;
pub mod protection;
mod requests;
pub mod settings;
pub mod speed;
mod telemetry;
pub mod vehicle;

#[cfg(test)]
pub(crate) mod tests;

use std::collections::VecDeque;
use std::time::Duration;

use rigsim_physics::r150::{R150Commands, R150Measurements, Sides};
use rigsim_settings::SimTime;

use crate::event::EventKind;
use crate::event::code::OPERATED;
use crate::firmware::{Firmware, Shell};
use crate::noise::Noise;
use crate::scanner::Scanner;
use crate::uart;
use can::{Can, CanFailure};
use command::{Reply, SystemInfo};
use control::{Control, FULL_DUTY};
use motors::{FULL, Motors};
use protection::Protection;
use settings::R150FirmwareSettings;
use speed::Speedometer;
use vehicle::{OperatorInput, Start, Vehicle};

/// Most frames kept until they are taken; the oldest go first.
const MOST_OUTPUTS: usize = 4096;

/// Silence on the CAN after which the vehicle's controller stops the motors. The manual gives no time;
/// this is as long as the module itself waits for its client.
pub const CAN_TIMEOUT: Duration = Duration::from_millis(500);

/// What every firmware has, around the module's.
type R150Shell = Shell<Vec<u8>, SystemInfo>;

/// The IO module and the vehicle controller, without the hardware around them.
#[derive(Debug, Clone)]
pub struct R150Device {
    settings: R150FirmwareSettings,
    decoder: Scanner,
    control: Control,
    protection: Protection,
    motors: Motors,
    /// Between the module and the vehicle's controller.
    can: Can,
    vehicle: Vehicle,
    measured: R150Measurements,
    /// Of the right and the left motor.
    speeds: [Speedometer; 2],
    noise: Noise,
    /// Draws how long replies take.
    reply_time: Noise,
    /// Replies with the time at which each begins its way.
    replies: VecDeque<(SimTime, Reply)>,
    shell: R150Shell,
}

impl R150Device {
    /// A module that has just been switched on, in a vehicle as `start` says.
    ///
    /// `measured` is what its sensors read at that moment; `noise` spoils later measurements and
    /// `reply_time` spreads replies, as the settings say.
    #[must_use]
    pub fn new(
        settings: R150FirmwareSettings,
        start: Start,
        measured: R150Measurements,
        noise: Noise,
        reply_time: Noise,
    ) -> Self {
        // The decoder sees when a byte has ended, and the pause is from there to the next one's start.
        let pause = settings.inter_byte_timeout + uart::byte_time(settings.baud, 1);
        let mut device = Self {
            decoder: codec::decoder(pause),
            control: Control::new(&settings),
            protection: Protection::new(settings.protection.clone()),
            motors: Motors::default(),
            can: Can::default(),
            vehicle: Vehicle::new(start, &settings),
            measured,
            speeds: [measured.motor_turns.right, measured.motor_turns.left]
                .map(|turns| Speedometer::new(&settings, SimTime::ZERO, turns)),
            noise,
            reply_time,
            replies: VecDeque::new(),
            shell: Shell::new(MOST_OUTPUTS),
            settings,
        };
        if !measured.module_powered {
            device.emit_power_lost(SimTime::ZERO);
        } else if !device.settings.boot_time.is_zero() {
            device.shell.boot_due = Some(SimTime::ZERO + device.settings.boot_time);
        }
        device
    }

    /// Takes bytes whose last has arrived at `now`.
    pub fn handle_bytes(&mut self, now: SimTime, bytes: &[u8]) {
        self.advance_before(now);
        if !self.hears(bytes.len()) {
            return;
        }
        for &byte in bytes {
            let found = self.decoder.push(now, byte);
            self.handle(now, found);
        }
    }

    /// The machine that runs the simulator was late: what waits for the line at `now` may have been
    /// sent up to `by` before, and simulated time stood still for `stood`. The rate of the client's
    /// commands is judged by its own clock, which ran on.
    pub fn late(&mut self, now: SimTime, by: Duration, stood: Duration) {
        self.motors
            .client_clock
            .late(now, by, stood, self.settings.baud);
    }

    /// Takes what the sensors read at `now`.
    pub fn sense(&mut self, now: SimTime, measured: &R150Measurements) {
        self.advance_before(now);
        self.can.update(now, self.motors.set_point);
        if self.overlooks(measured) {
            return;
        }
        self.read_encoders(now, measured);
        let was_powered = std::mem::replace(&mut self.measured, *measured).module_powered;
        self.update_supply(now, was_powered, self.settings.boot_time);
        if self.runs() {
            let requested = self.control.outputs.power;
            let shell = &mut self.shell;
            self.protection.sense(now, measured, requested, shell);
        }
    }

    /// An operator works a button at `now`.
    pub fn operate(&mut self, now: SimTime, action: OperatorInput) {
        self.advance_before(now);
        self.shell
            .emit(now, OPERATED, format!("operator: {action}"));
        match action {
            OperatorInput::AppHolds(parts) => self.control.app_holds(parts),
            OperatorInput::AppSets(outputs) => self.control.app_sets(outputs),
            _ => self.vehicle.operate(action),
        }
        self.power_requested(now);
    }

    /// The pins that the firmware drives.
    #[must_use]
    pub fn commands(&self) -> R150Commands {
        let power = self.power_status();
        let set_point = self.heard_set_point();
        let drive = self.vehicle.drive(set_point, self.battery_empty());
        let duty = drive.map(|pwm| pwm.map(|pwm| f64::from(pwm) / f64::from(FULL)));
        let stopped = self.vehicle.emergency_stop && self.settings.emergency_stop_brakes;
        R150Commands {
            motor_duty: Sides::from(duty.unwrap_or_default()),
            propulsion_power: duty.is_some(),
            parking_brake: self.vehicle.holds(set_point) || stopped,
            tail_power: !(self.vehicle.emergency_stop && self.settings.emergency_stop_cuts_tail),
            rail_on: std::array::from_fn(|rail| power >> rail & 1 == 1),
            pwm_out_duty: self
                .pwm_outputs()
                .map(|duty| f64::from(duty) / f64::from(FULL_DUTY)),
        }
    }

    /// State of the vehicle around the module.
    #[must_use]
    pub fn vehicle(&self) -> &Vehicle {
        &self.vehicle
    }

    /// Returns who controls the outputs, and their set-points.
    #[must_use]
    pub fn control(&self) -> &Control {
        &self.control
    }

    /// The CAN to the vehicle's controller fails in this way, or works.
    pub fn set_can_failure(&mut self, now: SimTime, failure: Option<CanFailure>) {
        self.advance_before(now);
        self.can.fail(now, self.motors.set_point, failure);
    }

    /// The motor set-point as the vehicle's controller has heard it, right then left, ±1000.
    #[must_use]
    pub fn heard_set_point(&self) -> [i16; 2] {
        self.can.heard(self.motors.set_point)
    }

    /// The motor set-point in effect, right then left, ±1000.
    #[must_use]
    pub fn motor_set_point(&self) -> [i16; 2] {
        self.motors.set_point
    }

    /// The bits of `powerStatus`: rails that are on.
    #[must_use]
    pub fn power_status(&self) -> u8 {
        if self.runs() {
            self.control.outputs.power & self.protection.allowed()
        } else {
            0
        }
    }

    /// The bits of `sysStatus`.
    #[must_use]
    pub fn sys_status(&self) -> u32 {
        self.protection.sys_status()
    }

    fn pwm_outputs(&self) -> [u16; 4] {
        if self.runs() {
            self.control.outputs.pwm
        } else {
            [0; 4]
        }
    }

    fn battery_empty(&self) -> bool {
        self.settings.empty_battery_stops && self.measured.soc <= 0.0
    }

    /// The requested rails may have changed, which ends the latch of those that are off.
    fn power_requested(&mut self, now: SimTime) {
        let requested = self.control.outputs.power;
        self.protection.requested(now, requested, &mut self.shell);
    }
}

impl Firmware for R150Device {
    type Output = Vec<u8>;
    type Status = SystemInfo;
    const NAME: &'static str = "the module";

    fn shell(&self) -> &R150Shell {
        &self.shell
    }

    fn shell_mut(&mut self) -> &mut R150Shell {
        &mut self.shell
    }

    fn has_supply(&self) -> bool {
        self.measured.module_powered
    }

    fn due(&self) -> Option<SimTime> {
        if self.shell.defects.hung {
            return None;
        }
        let next = earlier(self.decoder.deadline(), self.control.deadline());
        let next = earlier(next, self.motors.watchdog_due);
        let next = earlier(next, self.motors.answer_due);
        let next = earlier(next, self.protection.deadline);
        let next = earlier(next, self.can.deadline());
        earlier(next, self.replies.front().map(|(due, _)| *due))
    }

    fn serve(&mut self, now: SimTime) {
        self.can.update(now, self.motors.set_point);
        let found = self.decoder.expire(now);
        self.handle(now, found);
        if self.control.expire(now, &self.settings) {
            let text = "heartbeat lost: no valid frame in time, control went back to the app";
            self.shell.emit(now, event::HEARTBEAT_LOST, text);
            self.power_requested(now);
        }
        if self.shell.defects.watchdog_off {
            let missed = self.motors.miss_watchdog(now);
            self.shell.counts.watchdog_off += u64::from(missed);
        } else if let Some([right, left]) = self.motors.expire(now) {
            let driving = self.vehicle.obstacles(self.battery_empty()).is_empty();
            let text = format!(
                "motor watchdog fired: no motor command in time, motors stopped (were right \
                 {right} left {left})"
            );
            let fired = EventKind::new(event::WATCHDOG_FIRED, text);
            self.shell.report(now, fired.excused(!driving));
        }
        if self.motors.take_answer(now) {
            self.send_held_reply(now);
        }
        let requested = self.control.outputs.power;
        self.protection.advance(now, requested, &mut self.shell);
        self.send_due(now);
    }

    fn start(&mut self, now: SimTime) {
        self.can.update(now, self.motors.set_point);
    }

    /// The vehicle's own state stays.
    fn forget(&mut self) {
        self.decoder.clear();
        self.control.restart(&self.settings);
        self.protection = Protection::new(self.settings.protection.clone());
        self.motors.restart();
        self.replies.clear();
    }

    fn status_to_keep(&self, _now: SimTime) -> SystemInfo {
        self.system_status()
    }

    fn mend_watchdog(&mut self, now: SimTime) {
        self.motors.mend_watchdog(now);
    }
}

/// The earlier of two times that may never come.
///
/// The rig asks for deadlines all the time, and an iterator over an array of them takes several
/// times as long.
fn earlier(one: Option<SimTime>, other: Option<SimTime>) -> Option<SimTime> {
    match (one, other) {
        (Some(one), Some(other)) => Some(one.min(other)),
        (one, other) => one.or(other),
    }
}
