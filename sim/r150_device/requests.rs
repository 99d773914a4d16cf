//! From what the decoder found to what changes, and to the reply.

use std::time::Duration;

use rigsim_settings::SimTime;

use super::R150Device;
use super::codec;
use super::command::{PwmOutputs, Refusal, Reply, Request, Version, code, label};
use super::control::{FULL_DUTY, Parts};
use super::event;
use super::motors::FULL;
use super::settings::{
    HeartbeatBy, MotorsAnswered, MotorsRefusalReply, OutOfRange, RefusalReply, ReplyCommand,
};
use crate::event::EventKind;
use crate::event::code::{REPLY, REQUEST};
use crate::message::Message;
use crate::scanner::Decoded;

/// Most replies that may wait for their time: more than arrive at once where bytes take no time.
const MOST_REPLIES: usize = 4096;

impl R150Device {
    /// Takes what the decoder found, in order.
    pub(super) fn handle(&mut self, now: SimTime, found: Vec<Decoded>) {
        for decoded in found {
            match decoded {
                Decoded::Frame(frame) => self.frame(now, frame),
                bad => self.bad_stream(now, bad),
            }
        }
        self.send_due(now);
    }

    fn frame(&mut self, now: SimTime, frame: Vec<u8>) {
        let (command, parameters) = codec::parts(&frame).unwrap_or_default();
        match Request::parse(command, parameters) {
            Ok(request) => self.request(now, request, frame),
            Err(refusal) => self.refuse(now, refusal, frame),
        }
    }

    fn bad_stream(&mut self, now: SimTime, bad: Decoded) {
        let command = match &bad {
            Decoded::Wrong(frame) => codec::parts(frame).map(|(command, _)| command),
            _ => None,
        };
        self.shell.report(now, event::bad_stream(bad));
        if let Some(command) = command
            && self.settings.on_bad_crc == RefusalReply::False
        {
            self.refusal_reply(now, command);
        }
    }

    fn refuse(&mut self, now: SimTime, refusal: Refusal, frame: Vec<u8>) {
        let (code, text) = match refusal {
            Refusal::UnknownCommand(command) => (
                event::UNKNOWN_COMMAND,
                format!("unknown command 0x{command:02X}; nothing changed"),
            ),
            Refusal::WrongLength {
                command,
                wanted,
                found,
            } => {
                let command = label(command);
                let text = format!(
                    "{command} takes {wanted} parameter bytes, {found} came; nothing changed"
                );
                (event::WRONG_LENGTH, text)
            }
        };
        self.shell
            .report(now, EventKind::new(code, text).with(0, frame));
        if self.settings.heartbeat_by == HeartbeatBy::Frames {
            self.control.heartbeat(now, &self.settings);
        }
        let (command, choice) = match refusal {
            Refusal::UnknownCommand(command) => (command, self.settings.on_unknown_command),
            Refusal::WrongLength {
                command: code::SetMotors,
                ..
            } => return self.refuse_motors(now),
            Refusal::WrongLength { command, .. } => (command, self.settings.on_wrong_length),
        };
        if choice == RefusalReply::False {
            self.refusal_reply(now, command);
        }
    }

    /// Returns how long after its request a reply begins at least.
    fn least_delay(&self) -> Duration {
        self.settings.reply_delay + self.shell.defects.slow
    }

    fn refuse_motors(&mut self, now: SimTime) {
        if !self
            .motors
            .may_answer(now + self.least_delay(), &self.settings)
        {
            return;
        }
        match self.settings.on_motors_refused {
            MotorsRefusalReply::Silent => {}
            MotorsRefusalReply::False => self.refusal_reply(now, code::SetMotors),
            MotorsRefusalReply::Speeds => {
                let reply = self.motor_reply();
                self.reply(now, reply);
            }
        }
    }

    fn refusal_reply(&mut self, now: SimTime, command: u8) {
        let reply = Reply::Bool {
            command,
            success: false,
        };
        self.reply(now, reply);
    }

    fn request(&mut self, now: SimTime, request: Request, frame: Vec<u8>) {
        let bad = event::bad_value(request);
        let bad = bad.map(|(code, text)| EventKind::new(code, text).with(0, frame.clone()));
        let passed = event::passed(REQUEST, request.command(), request.info(), frame);
        for event in [passed].into_iter().chain(bad) {
            self.shell.report(now, event);
        }
        // A reply tells the state before its request.
        let state = match request {
            Request::SystemInfo => Some(Reply::SystemInfo(self.system_info())),
            _ => None,
        };
        let taken = self.control.request(now, request, &self.settings);
        if taken.any() {
            let parts = match taken {
                Parts::BOTH => "power and PWM",
                Parts { power: true, .. } => "power",
                _ => "PWM",
            };
            let text = format!("the client took control of {parts} (RS232 mode)");
            self.shell.emit(now, event::CONTROL_TAKEN, text);
        }
        if let Some(reply) = state.or_else(|| self.execute(now, request)) {
            self.reply(now, reply);
        }
    }

    /// Executes a request; returns the reply that is due at once.
    fn execute(&mut self, now: SimTime, request: Request) -> Option<Reply> {
        let command = request.command();
        let answered = |success| Reply::Bool { command, success };
        Some(match request {
            Request::PowerControl { on } => answered(self.set_power(now, on)?),
            Request::SetPwmOutputs { duty } => answered(self.set_pwm(now, duty)?),
            Request::GetPwmOutputs => Reply::PwmOutputs(PwmOutputs {
                duty: self.pwm_outputs(),
            }),
            Request::GetPwmInputs => self.pwm_inputs(),
            Request::SystemInfo => Reply::SystemInfo(self.system_info()),
            Request::Heartbeat => answered(true),
            Request::Version => self.version(),
            Request::SetMotors { right, left } => {
                if !self.set_motors(now, right, left) {
                    return None;
                }
                self.motor_reply()
            }
        })
    }

    fn version(&self) -> Reply {
        let order = self.settings.version_order;
        Reply::Version(Version {
            hardware: self.settings.hardware_version.word(order),
            software: self.settings.software_version.word(order),
        })
    }

    /// Says whether it succeeded, if that is answered.
    fn set_power(&mut self, now: SimTime, status: u32) -> Option<bool> {
        if !self.control.by_client.power {
            return self.refuse_for_app(now, code::PowerControl);
        }
        self.control.set_power(status.to_le_bytes()[0]);
        self.power_requested(now);
        let done = self.power_status() == self.control.outputs.power;
        Some(done || self.settings.true_when_tripped)
    }

    /// Says whether it succeeded, if that is answered.
    fn set_pwm(&mut self, now: SimTime, mut duty: [u16; 4]) -> Option<bool> {
        if !self.control.by_client.pwm {
            return self.refuse_for_app(now, code::SetPwmOutputs);
        }
        if duty.iter().any(|duty| *duty > FULL_DUTY) {
            if self.settings.on_duty_out_of_range == OutOfRange::Refuse {
                return Some(false);
            }
            duty = duty.map(|duty| duty.min(FULL_DUTY));
        }
        self.control.set_pwm(duty);
        Some(true)
    }

    fn refuse_for_app(&mut self, now: SimTime, command: u8) -> Option<bool> {
        let text = format!("{} refused: the app holds control", label(command));
        self.shell.emit(now, event::APP_IN_CONTROL, text);
        match self.settings.on_app_in_control {
            RefusalReply::Silent => None,
            RefusalReply::False => Some(false),
        }
    }

    /// Returns whether it is answered now.
    fn set_motors(&mut self, now: SimTime, right: i16, left: i16) -> bool {
        let set_point = [right, left];
        let beyond = set_point
            .iter()
            .any(|pwm| pwm.unsigned_abs() > FULL.unsigned_abs());
        if beyond && self.settings.on_motors_out_of_range == OutOfRange::Refuse {
            self.refuse_motors(now);
            return false;
        }
        let obstacles = self.vehicle.obstacles(self.battery_empty());
        let answered =
            self.settings.motors_answered == MotorsAnswered::Always || obstacles.is_empty();
        let delay = self.least_delay();
        let (answers, over_rate) =
            self.motors
                .command((now, delay), set_point, answered, &self.settings);
        if let Some(commands) = over_rate {
            let text = format!(
                "{commands} motor commands within a second, which are more than can be answered"
            );
            self.shell.emit(now, event::OVER_RATE, text);
        }
        if set_point != [0, 0] && !obstacles.is_empty() {
            let why: Vec<&str> = obstacles.iter().map(|why| why.as_str()).collect();
            let why = why.join(", ");
            let text = format!("motor command does not move the vehicle: {why}");
            self.shell.emit(now, event::NOT_DRIVING, text);
        }
        answers
    }

    fn reply(&mut self, now: SimTime, reply: Reply) {
        if self.may_reply(now) {
            let spread = self.reply_time.uniform();
            self.reply_after(now, self.settings.reply_spread.mul_f64(spread), reply);
        }
    }

    /// Sends the reply to motor commands that has waited for its time, and is ready.
    pub(super) fn send_held_reply(&mut self, now: SimTime) {
        if self.may_reply(now) {
            let reply = self.motor_reply();
            self.reply_after(now, Duration::ZERO, reply);
        }
    }

    /// Returns whether another reply may wait; else it is dropped.
    fn may_reply(&mut self, now: SimTime) -> bool {
        let has_room = self.replies.len() < MOST_REPLIES;
        if !has_room {
            let text = "a reply was dropped: too many wait to be sent";
            self.shell.emit(now, event::REPLY_DROPPED, text);
        }
        has_room
    }

    fn reply_after(&mut self, now: SimTime, spread: Duration, reply: Reply) {
        let delay = self.settings.reply_delay + spread + self.shell.slowness();
        // One never overtakes another.
        let before = self.replies.back().map_or(now, |(due, _)| *due);
        let mut due = before.max(now + delay);
        if reply.command() == code::SetMotors {
            due = self.motors.pace(due, &self.settings);
        }
        self.replies.push_back((due, reply));
    }

    /// Sends the replies whose time has come.
    pub(super) fn send_due(&mut self, now: SimTime) {
        while let Some((_, reply)) = self.replies.pop_front_if(|(due, _)| *due <= now) {
            let command = match self.settings.reply_command {
                ReplyCommand::Same => reply.command(),
                ReplyCommand::HighBit => reply.command() | 0x80,
            };
            let frame = codec::encode(command, &reply.parameters());
            self.shell.send(frame.clone());
            // One that waited behind a slower one is late.
            let passed = event::passed(REPLY, reply.command(), reply.info(), frame);
            self.shell.report(now, passed);
        }
    }
}
