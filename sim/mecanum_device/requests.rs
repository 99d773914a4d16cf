//! Requests of clients, and what becomes of them.

use rigsim_settings::SimTime;

use super::ascii::{Command, Letter, Line};
use super::codec;
use super::event::{Discard, Field, Handling, MecanumEvent};
use super::kinematics::{Course, Movement};
use super::motion::Motion;
use super::packet::Request;
use super::settings::{
    Acknowledge, AsciiLetters, ModeChange, OrdersWithRos, OverSpeed, PositiveStrafe, PositiveTurn,
};
use super::{MAX_SPEED, MecanumDevice};
use crate::scanner::Decoded;

impl MecanumDevice {
    /// Handles what the decoder of the main link has found.
    pub(super) fn handle(&mut self, now: SimTime, found: Vec<Decoded>) {
        for decoded in found {
            let request = match &decoded {
                Decoded::Frame(packet) => codec::parse(packet, self.settings.byte_order),
                _ => None,
            };
            match request {
                Some(request) => self.request(now, request),
                None => self.event(now, MecanumEvent::BadStream(decoded)),
            }
        }
    }

    fn request(&mut self, now: SimTime, request: Request) {
        self.heard_seq = request.seq();
        self.hear(now);
        let order = self.settings.byte_order;
        self.event(now, MecanumEvent::Request(request, order));
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
        let Some(course) = Course::from_index(moving_idx) else {
            self.bad_field(now, Field::MovingIdx, moving_idx, Handling::Ignored);
            return;
        };
        // As C takes any number but 0 for true.
        let preempt = is_reset != 0;
        if is_reset > 1 {
            self.bad_field(now, Field::IsReset, is_reset, Handling::TakenFor(1));
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
            self.event(now, MecanumEvent::IgnoredForRos(motion));
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
        let handling = self.settings.over_speed;
        self.event(now, MecanumEvent::SpeedOutOfRange { v, handling });
        match handling {
            OverSpeed::Clamp => Some(most),
            OverSpeed::Obey => Some(speed),
            OverSpeed::Ignore => None,
        }
    }

    fn control_mode_packet(&mut self, now: SimTime, mode: u8) {
        if mode > 1 {
            self.bad_field(now, Field::ControlType, mode, Handling::Ignored);
        } else {
            self.control_mode(now, mode == 1);
        }
    }

    /// Handles what has come on the ROS link.
    pub(super) fn line(&mut self, now: SimTime, line: Line) {
        match line {
            Line::Command(command) => {
                self.hear(now);
                self.event(now, MecanumEvent::Command(command));
                self.command(now, command);
            }
            Line::Bad { error, bytes } => self.event(now, MecanumEvent::BadLine { error, bytes }),
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
            self.event(now, MecanumEvent::IgnoredInRemote(motion));
            return;
        }
        if preempt {
            let count = self.drive.motions.preempt(motion);
            self.discarded(now, count, Discard::Preempted);
        } else if let Some(lost) = self.drive.motions.append(motion) {
            self.event(now, MecanumEvent::QueueFull(lost));
        }
        self.go_on(now);
    }

    /// Starts what may start.
    pub(super) fn go_on(&mut self, now: SimTime) {
        let shell = &mut self.shell;
        self.drive.go_on(now, &mut |change| {
            shell.report(now, MecanumEvent::Motion(change));
        });
    }

    fn control_mode(&mut self, now: SimTime, remote: bool) {
        if remote == self.drive.remote {
            return;
        }
        if remote && self.settings.mode_change == ModeChange::Discard {
            self.discard(now, Discard::ControlMode);
        }
        self.event(now, MecanumEvent::ControlMode { remote });
        if !remote {
            // The silence of a client counts from when its motions drive again.
            self.hear(now);
        }
        let shell = &mut self.shell;
        self.drive.set_remote(now, remote, &mut |change| {
            shell.report(now, MecanumEvent::Motion(change));
        });
    }

    /// Discards all motions.
    pub(super) fn discard(&mut self, now: SimTime, why: Discard) {
        let count = self.drive.discard(now);
        self.discarded(now, count, why);
    }

    fn discarded(&mut self, now: SimTime, count: usize, why: Discard) {
        if count > 0 {
            self.event(now, MecanumEvent::Discarded { count, why });
        }
    }

    fn bad_field(&mut self, now: SimTime, field: Field, value: u8, handling: Handling) {
        let event = MecanumEvent::BadField {
            field,
            value,
            handling,
        };
        self.event(now, event);
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
