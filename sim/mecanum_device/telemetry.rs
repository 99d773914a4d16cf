//! Messages of the board to its clients: the status packet and the report line.

use rigsim_physics::mecanum::Wheel;
use rigsim_settings::SimTime;

use super::ascii::{REPORTS, Report};
use super::packet::Status;
use super::settings::{
    AsciiMileage, AsciiSpeedSign, HeadingRange, MagnBits, MotorState, NoEcho, Overflow, StatusSeq,
    VelocityFrame,
};
use super::{Link, MecanumDevice};
use crate::event::EventKind;
use crate::event::code::REPLY;
use crate::message::Message;
use crate::rounding::round;

/// The longest distance that an ultrasonic sensor gives, m: common ones end at 4500 mm.
const ULTRASONIC_FARTHEST: f64 = 4.5;
/// The shortest one: common ones begin at 20 mm.
const ULTRASONIC_NEAREST: f64 = 0.02;

impl MecanumDevice {
    /// Begins to send what is sent periodically.
    pub(super) fn schedule(&mut self, now: SimTime) {
        self.status_due = Some(now + self.settings.status_period);
        self.report_due = self
            .ros_configured
            .then(|| now + self.settings.ros_report_period);
    }

    /// Sends what is due by `now`.
    pub(super) fn send_due(&mut self, now: SimTime) {
        if let Some(due) = self.status_due.filter(|due| *due <= now) {
            let period = self.settings.status_period + self.shell.slowness();
            self.status_due = Some(due + period);
            self.send_status(now);
        }
        if let Some(due) = self.report_due.filter(|due| *due <= now) {
            let period = self.settings.ros_report_period + self.shell.slowness();
            self.report_due = Some(due + period);
            self.send_report(now);
        }
    }

    pub(super) fn send_status(&mut self, now: SimTime) {
        self.count_stuck_status(now);
        let status = self.status(now);
        self.seq = self.seq.wrapping_add(1);
        let order = self.settings.byte_order;
        let bytes = status.encode_in(order);
        self.shell.send((Link::Main, bytes.clone()));
        let info = status.info();
        let event = EventKind::new(REPLY, info.name).saying(info, status.payload(), bytes);
        self.shell.report(now, event);
    }

    pub(super) fn send_report(&mut self, now: SimTime) {
        let line = self.report(now).encode();
        self.shell.send((Link::Ros, line.clone()));
        let event = EventKind::new(REPLY, "line").saying(&REPORTS[0], line.clone(), line);
        self.shell.report(now, event);
    }

    /// Returns the status packet of `now`.
    #[must_use]
    pub fn status(&self, now: SimTime) -> Status {
        let measured = &self.measured;
        let odometry = &self.drive.odometry;
        let [x, y] = odometry.position;
        let body = self.drive.velocity_rpm(now);
        let [v_x, v_y] = match self.settings.velocity_frame {
            VelocityFrame::Odometry => odometry.to_frame(body),
            VelocityFrame::Body => body,
        };
        let [f0, f1, f2, f3, b0, b1, b2, b3] = measured.echoes.map(|echo| self.distance_mm(echo));
        Status {
            seq: match self.settings.status_seq {
                StatusSeq::Count => self.seq,
                StatusSeq::Echo => self.heard_seq,
            },
            v_x: self.signed(v_x * 10.0),
            v_y: self.signed(v_y * 10.0),
            axis_x: self.signed(x * 10.0),
            axis_y: self.signed(y * 10.0),
            ori: self.signed(self.heading_degrees() * 10.0),
            rfid: match measured.tag {
                0 if self.settings.rfid_hold => self.last_tag,
                tag => tag,
            },
            magn: self.magnetic_bar(),
            infra: u8::from(measured.obstacle_ahead),
            ut_f: [f0, f1, f2, f3],
            ut_b: [b0, b1, b2, b3],
            moto_state: self
                .shell
                .stuck_status
                .unwrap_or_else(|| self.motor_state(now)),
            mile: self.unsigned(odometry.mileage_m() * 1000.0),
        }
    }

    /// Returns the report line of `now`.
    #[must_use]
    pub fn report(&self, now: SimTime) -> Report {
        let speed = self.drive.speed_rpm(now) / 60.0;
        let speed = match self.settings.ascii_speed_sign {
            AsciiSpeedSign::Motion => speed,
            AsciiSpeedSign::None => speed.abs(),
        };
        let odometry = &self.drive.odometry;
        let mileage = match self.settings.ascii_mileage {
            AsciiMileage::Total => odometry.mileage,
            AsciiMileage::Signed => odometry.net_mileage,
            AsciiMileage::Motion => odometry.motion_mileage(),
        };
        Report {
            speed: round(speed * 100.0),
            mileage: round(mileage * 100.0),
        }
    }

    fn heading_degrees(&self) -> f64 {
        let degrees = self.drive.odometry.heading().to_degrees();
        match self.settings.heading_range {
            HeadingRange::FullTurns => degrees,
            // To a tenth first, so that what rounds to −180.0° is 180.0°.
            HeadingRange::HalfTurn => {
                let tenths = (degrees * 10.0).round();
                (1800.0 - (1800.0 - tenths).rem_euclid(3600.0)) / 10.0
            }
        }
    }

    fn magnetic_bar(&self) -> u16 {
        // The ROS link takes the UART of the magnetic sensor.
        if self.ros_configured {
            return 0;
        }
        let bar = self.measured.magnetic_bar;
        match self.settings.magn_bits {
            MagnBits::FromLeft => bar,
            MagnBits::FromRight => bar.reverse_bits(),
            MagnBits::Any => u16::from(bar != 0),
        }
    }

    pub(super) fn motor_state(&self, now: SimTime) -> u8 {
        let running = match self.settings.moto_state {
            MotorState::Driven => self.drive.driven(),
            MotorState::Turning => self.drive.turning(now),
        };
        Wheel::ALL.into_iter().fold(0, |bits, wheel| {
            let side = if wheel.is_left() { 0 } else { 1 };
            bits | u8::from(running[wheel.index()]) << side
        })
    }

    fn distance_mm(&self, echo: Option<f64>) -> u16 {
        let Some(echo) = echo.filter(|echo| *echo <= ULTRASONIC_FARTHEST) else {
            return match self.settings.ultrasonic_no_echo {
                NoEcho::Farthest => round(ULTRASONIC_FARTHEST * 1000.0),
                NoEcho::Zero => 0,
                NoEcho::Max => u16::MAX,
            };
        };
        round(echo.max(ULTRASONIC_NEAREST) * 1000.0)
    }

    fn signed(&self, value: f64) -> i16 {
        match self.settings.overflow {
            Overflow::Wrap => low_bits(value).cast_signed(),
            Overflow::Saturate => round(value),
        }
    }

    fn unsigned(&self, value: f64) -> u16 {
        match self.settings.overflow {
            Overflow::Wrap => low_bits(value),
            Overflow::Saturate => round(value),
        }
    }
}

/// The low 16 bits, as a field that overflows keeps them.
fn low_bits(value: f64) -> u16 {
    let [low, high, ..] = round::<i64>(value).to_le_bytes();
    u16::from_le_bytes([low, high])
}
