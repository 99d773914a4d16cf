//! What the board tells its clients: the status packet and the report line.

use sim_physics::mecanum::Wheel;
use sim_settings::SimTime;

use super::MecanumDevice;
use super::ascii::Report;
use super::packet::Status;
use super::settings::{MotorState, VelocityFrame};

impl MecanumDevice {
    /// What a status packet at `now` would say.
    #[must_use]
    pub fn status(&self, now: SimTime) -> Status {
        let measured = &self.measured;
        let odometry = self.drive.odometry();
        let [x, y] = odometry.position();
        let body = self.drive.velocity_rpm(now);
        let [v_x, v_y] = match self.settings.velocity_frame {
            VelocityFrame::Odometry => odometry.to_frame(body),
            VelocityFrame::Body => body,
        };
        let [f0, f1, f2, f3, b0, b1, b2, b3] = measured.echoes.map(|echo| self.distance_mm(echo));
        Status {
            seq: self.seq,
            v_x: wrap_i16(v_x * 10.0),
            v_y: wrap_i16(v_y * 10.0),
            axis_x: wrap_i16(x * 10.0),
            axis_y: wrap_i16(y * 10.0),
            ori: wrap_i16(odometry.heading().to_degrees() * 10.0),
            rfid: measured.tag,
            // The ROS link takes the UART of the magnetic sensor.
            magn: if self.ros_configured {
                0
            } else {
                measured.magnetic_bar
            },
            infra: u8::from(measured.obstacle_ahead),
            ut_f: [f0, f1, f2, f3],
            ut_b: [b0, b1, b2, b3],
            moto_state: self.stuck_status.unwrap_or_else(|| self.motor_state(now)),
            mile: wrap_i16(odometry.mileage_m() * 1000.0).cast_unsigned(),
        }
    }

    /// What a report line at `now` would say.
    #[must_use]
    pub fn report(&self, now: SimTime) -> Report {
        Report {
            speed: whole(self.drive.speed_rpm(now) / 60.0 * 100.0),
            mileage: whole(self.drive.odometry().mileage() * 100.0),
        }
    }

    pub(super) fn motor_state(&self, now: SimTime) -> u8 {
        let running = match self.settings.moto_state {
            MotorState::Driven => self.drive.rotations().map(|rotation| rotation != 0),
            MotorState::Turning => self.drive.turning(now),
        };
        Wheel::ALL.into_iter().fold(0, |bits, wheel| {
            let side = if wheel.is_left() { 0 } else { 1 };
            bits | u8::from(running[wheel.index()]) << side
        })
    }

    fn distance_mm(&self, echo: Option<f64>) -> u16 {
        let farthest = self.settings.ultrasonic_farthest;
        let distance = echo
            .unwrap_or(farthest)
            .max(self.settings.ultrasonic_nearest);
        // Distances are below 65.535 m, so nothing wraps here.
        wrap_i16(distance.min(farthest) * 1000.0).cast_unsigned()
    }
}

/// Rounds to the nearest integer, saturating; what is not a number is 0.
#[expect(
    clippy::cast_possible_truncation,
    reason = "a cast from a float saturates, as the documentation says"
)]
pub(super) fn whole(value: f64) -> i64 {
    value.round() as i64
}

/// Rounds to the nearest integer and keeps the low 16 bits, as a field that overflows does.
pub(super) fn wrap_i16(value: f64) -> i16 {
    let [low, high, ..] = whole(value).to_le_bytes();
    i16::from_le_bytes([low, high])
}
