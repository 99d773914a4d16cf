//! Requests of clients, and what becomes of them.

use rigsim_settings::SimTime;

use super::ascii::{Command, Letter, Line};
use super::codec;
use super::event;
use super::kinematics::{Course, Movement};
use super::motion::Motion;
use super::packet::Request;
use super::settings::{
    Acknowledge, AsciiLetters, ModeChange, OrdersWithRos, OverSpeed, PositiveStrafe, PositiveTurn,
};
use super::{Link, MAX_SPEED, MecanumDevice};
use crate::event::code::REQUEST;
use crate::event::{Code, EventKind};
use crate::message::Message;
use crate::scanner::Decoded;

impl MecanumDevice {
    /// Handles what the decoder of the main link has found.
    pub(super) fn handle(&mut self, now: SimTime, found: Vec<Decoded>) {
        for decoded in found {
            if let Decoded::Frame(packet) = &decoded
                && let Some(request) = codec::parse(packet, self.settings.byte_order)
            {
                self.request(now, request, packet.clone());
            } else {
                self.shell.report(now, event::bad_stream(decoded));
            }
        }
    }

    fn request(&mut self, now: SimTime, request: Request, packet: Vec<u8>) {
        self.heard_seq = request.seq();
        self.hear(now);
        let info = request.info();
        let event = EventKind::new(REQUEST, info.name).saying(info, request.payload(), packet);
        self.shell.report(now, event);
        match request {
            Request::Motion {
                is_reset,
                moving_idx,
                s,
                v,
                ..
            } => self.motion_packet(now, is_reset, moving_idx, s, v),
            Request::SetPose {
                axis_x,
                axis_y,
                ori,
                ..
            } => {
                let position = [axis_x, axis_y].map(|axis| f64::from(axis) / 10.0);
                let heading = (f64::from(ori) / 10.0).to_radians();
                self.drive.odometry.set_pose(position, heading);
            }
            Request::ControlMode { mode, .. } => self.control_mode_packet(now, mode),
        }
        if self.settings.acknowledge == Acknowledge::Status {
            self.send_status(now);
        }
    }

    fn motion_packet(&mut self, now: SimTime, is_reset: u8, moving_idx: u8, s: u16, v: i16) {
        let Some(&course) = Course::ALL.get(usize::from(moving_idx)) else {
            let text =
                format!("moving_idx {moving_idx} ignored with its packet: 0 to 4 is allowed");
            self.emit_on_main(now, event::BAD_MOVING_IDX, text);
            return;
        };
        // As C takes any number but 0 for true.
        let preempt = is_reset != 0;
        if is_reset > 1 {
            let text = format!("is_reset {is_reset} taken for 1: 0 and 1 are allowed");
            self.emit_on_main(now, event::BAD_IS_RESET, text);
        }
        let Some(speed) = self.speed_in_range(now, v) else {
            return;
        };
        let motion = Motion {
            movement: self.movement(course, v < 0),
            revolutions: f64::from(s) / 10.0,
            speed_rpm: f64::from(speed) / 10.0,
        };
        if self.ros_configured && self.settings.orders_with_ros == OrdersWithRos::RosOnly {
            let text = format!("{motion} ignored: the ROS link drives");
            self.emit_on_main(now, event::IGNORED_FOR_ROS, text);
            return;
        }
        self.order(now, motion, preempt);
    }

    /// The size of a speed, 1/10 r/min; `None` if its motion is to be ignored.
    fn speed_in_range(&mut self, now: SimTime, v: i16) -> Option<u16> {
        let speed = v.unsigned_abs();
        let most = MAX_SPEED.unsigned_abs();
        if speed <= most {
            return Some(speed);
        }
        let (code, made_of_it, taken) = match self.settings.over_speed {
            OverSpeed::Clamp => (event::SPEED_CLAMPED, "clamped", Some(most)),
            OverSpeed::Obey => (event::SPEED_OUT_OF_RANGE, "taken as it is", Some(speed)),
            OverSpeed::Ignore => (event::SPEED_OUT_OF_RANGE, "ignored with its motion", None),
        };
        let text = format!("speed {v} {made_of_it}: -{MAX_SPEED} to {MAX_SPEED} is allowed");
        self.emit_on_main(now, code, text);
        taken
    }

    fn control_mode_packet(&mut self, now: SimTime, mode: u8) {
        if mode > 1 {
            let text = format!("control type {mode} ignored with its packet: 0 and 1 are allowed");
            self.emit_on_main(now, event::BAD_CONTROL_TYPE, text);
        } else {
            self.control_mode(now, mode == 1);
        }
    }

    /// Handles what has come on the ROS link.
    pub(super) fn line(&mut self, now: SimTime, line: Line) {
        match line {
            Line::Command(command) => {
                self.hear(now);
                let line = command.encode();
                let event = EventKind::new(REQUEST, "line");
                let event = event.saying(command.info(), line.clone(), line);
                self.shell.report(now, event);
                self.command(now, command);
            }
            Line::Bad { error, bytes } => self.shell.report(now, event::bad_line(error, bytes)),
        }
    }

    fn command(&mut self, now: SimTime, command: Command) {
        let course = course(command.letter, self.settings.ascii_letters);
        let motion = Motion {
            movement: self.movement(course, command.tenths < 0),
            revolutions: f64::from(command.tenths.unsigned_abs()) * self.settings.ascii_unit,
            speed_rpm: self.settings.ascii_speed,
        };
        self.order(now, motion, self.settings.ascii_preempt);
        if self.settings.acknowledge == Acknowledge::Status {
            self.send_report(now);
        }
    }

    /// The movement that a course with a sign means.
    fn movement(&self, course: Course, negative: bool) -> Movement {
        let turned = match course {
            Course::Rotate => self.settings.positive_turn == PositiveTurn::Left,
            Course::Strafe => self.settings.positive_strafe == PositiveStrafe::Right,
            Course::Ahead | Course::LeftFront | Course::RightFront => false,
        };
        let negative = negative != turned;
        Movement { course, negative }
    }

    fn order(&mut self, now: SimTime, motion: Motion, preempt: bool) {
        if self.drive.remote {
            let text = format!("{motion} ignored: the remote control drives");
            self.shell.emit(now, event::IGNORED_IN_REMOTE, text);
            return;
        }
        if preempt {
            let count = self.drive.motions.preempt(motion);
            self.discarded(now, count, event::MOTIONS_DISCARDED, "another preempts");
        } else if let Some(lost) = self.drive.motions.append(motion) {
            let text = format!("{lost} lost: too many motions wait");
            self.shell.emit(now, event::QUEUE_FULL, text);
        }
        self.start_due(now);
    }

    /// Starts what may start.
    pub(super) fn start_due(&mut self, now: SimTime) {
        let shell = &mut self.shell;
        self.drive.start_due(now, &mut |change| {
            shell.report(now, event::motion(change));
        });
    }

    fn control_mode(&mut self, now: SimTime, remote: bool) {
        if remote == self.drive.remote {
            return;
        }
        if remote && self.settings.mode_change == ModeChange::Discard {
            let why = "the control mode changed";
            self.discard(now, event::MOTIONS_DISCARDED, why);
        }
        let text = match remote {
            true => "the remote control drives",
            false => "the board drives",
        };
        self.shell.emit(now, event::CONTROL_MODE, text);
        if !remote {
            // The silence of a client counts from when its motions drive again.
            self.hear(now);
        }
        let shell = &mut self.shell;
        self.drive.set_remote(now, remote, &mut |change| {
            shell.report(now, event::motion(change));
        });
    }

    /// Discards all motions.
    pub(super) fn discard(&mut self, now: SimTime, code: Code, why: &str) {
        let count = self.drive.discard(now);
        self.discarded(now, count, code, why);
    }

    fn discarded(&mut self, now: SimTime, count: usize, code: Code, why: &str) {
        if count > 0 {
            let motions = if count == 1 { "motion" } else { "motions" };
            let text = format!("{count} {motions} discarded: {why}");
            self.shell.emit(now, code, text);
        }
    }

    /// Reports an event on the main link.
    fn emit_on_main(&mut self, now: SimTime, code: Code, text: String) {
        let event = EventKind::new(code, text).on(Link::Main.index());
        self.shell.report(now, event);
    }
}

/// Meaning of a letter; the article's table and its picture disagree on two.
fn course(letter: Letter, meaning: AsciiLetters) -> Course {
    match (letter, meaning) {
        (Letter::X, _) => Course::Ahead,
        (Letter::Y, AsciiLetters::Table) | (Letter::Z, AsciiLetters::Picture) => Course::Strafe,
        (Letter::Y, AsciiLetters::Picture) | (Letter::Z, AsciiLetters::Table) => Course::Rotate,
        (Letter::A, _) => Course::LeftFront,
        (Letter::B, _) => Course::RightFront,
    }
}
