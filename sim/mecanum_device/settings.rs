//! Every number of the mecanum board's firmware, with the reason we believe it.

use std::time::Duration;

use sim_physics::mecanum::Wiring;
use sim_settings::{choices, settings};

const MS: fn(u64) -> Duration = Duration::from_millis;
const S: fn(u64) -> Duration = Duration::from_secs;

choices! {
    /// What the letters Y and Z of the ROS link mean; the article's table and its picture differ.
    pub enum AsciiLetters {
        /// Y+ strafes left, Z+ turns right.
        Table = "table",
        /// Y+ turns right, Z+ strafes left.
        Picture = "picture",
    }
}

choices! {
    /// In which axes the status packet gives the velocity.
    pub enum VelocityFrame {
        /// In those of the frame in which it gives the position.
        Odometry = "odometry",
        /// In the car's: ahead and to the left.
        Body = "body",
    }
}

choices! {
    /// When the status packet calls a side's motors running.
    pub enum MotorState {
        /// While the firmware drives one of them.
        Driven = "driven",
        /// While pulses come from one of them.
        Turning = "turning",
    }
}

choices! {
    /// What the mileage counts.
    pub enum Mileage {
        /// How far the driven wheels turn, as the distance of a motion does; turning on the spot
        /// counts too.
        Wheels = "wheels",
        /// How far the middle of the car goes.
        Path = "path",
    }
}

settings! {
    /// The mecanum board's firmware.
    pub struct MecanumFirmwareSettings {
        /// Speed of the main link.
        baud: u32 = 115_200, unit "baud", range 300..=4_000_000,
            assumed "the article gives no speed";
        /// Speed of the ROS link.
        ros_baud: u32 = 9600, unit "baud", range 300..=4_000_000,
            assumed "as on the same authors' sibling vehicle";
        /// A packet on the main link that was begun and then paused for this long is dropped.
        inter_byte_timeout: Duration = MS(50), range MS(1)..=S(60),
            assumed "the packets have no header; the article gives no way to find their beginning";
        /// Time between two status packets on the main link.
        status_period: Duration = MS(100), range MS(1)..=S(3600),
            assumed "the article gives no rate";
        /// Time between two lines on the ROS link.
        ros_report_period: Duration = MS(100), range MS(1)..=S(3600),
            assumed "the article gives no rate";
        /// How many motions may wait beside the one that runs.
        queue_length: u32 = 16, range 0..=1024,
            assumed "the article says that motions need not preempt, not how many may wait";
        /// Silence of the client after which its motions are discarded; any valid packet or line
        /// on either link ends it.
        link_timeout: Option<Duration> = None, range MS(1)..=S(3600),
            assumed "the article documents no watchdog";
        /// The motor ports of LF, RF, LR, RR, as the firmware drives them; "!" before a port
        /// drives it the other way.
        wiring: Wiring = Wiring::X_Y_E0_E1,
            documented "article, wiring table; a later line gives \"x-y-z-e0\"";
        /// Whether motor ports without a wheel hold their motor.
        unused_ports_brake: bool = true,
            assumed "SV is shared, so a motor that is not held would turn with the others";
        /// Wheel speed that the full speed voltage stands for.
        full_speed: f64 = 50.0, unit "rpm", range 0.1..=10_000.0,
            assumed "the highest speed that a motion packet can ask for";
        /// Wheel speed of motions that come over the ROS link.
        ascii_speed: f64 = 30.0, unit "rpm", range 0.0..=10_000.0,
            assumed "its lines carry no speed";
        /// What the letters Y and Z mean there.
        ascii_letters: AsciiLetters = AsciiLetters::Table,
            documented "article, table of letters; its picture says otherwise";
        /// Whether a line there discards the motions that run and wait.
        ascii_preempt: bool = true,
            assumed "its lines do not say";
        /// Wheel speed while a key of the remote control is held.
        remote_speed: f64 = 30.0, unit "rpm", range 0.0..=10_000.0,
            assumed "the article names the mode only";
        /// In which axes the status packet gives the velocity.
        velocity_frame: VelocityFrame = VelocityFrame::Odometry,
            assumed "the article names x and y axis, not whose";
        /// When the status packet calls a side's motors running.
        moto_state: MotorState = MotorState::Driven,
            assumed "the article says stop and running";
        /// Time over which the speed of a wheel is measured.
        speed_window: Duration = MS(200), range MS(1)..=S(60),
            assumed "ten pulses at full speed";
        /// Time without a pulse after which a wheel counts as standing.
        speed_timeout: Duration = S(1), range MS(1)..=S(60),
            assumed "one pulse a second is 1 rpm";
        /// The shortest distance that an ultrasonic sensor gives; nearer things read so too.
        ultrasonic_nearest: f64 = 0.02, unit "m", range 0.0..=65.0,
            assumed "common sensors begin at 20 mm";
        /// The longest distance that an ultrasonic sensor gives; no echo reads so too.
        ultrasonic_farthest: f64 = 4.5, unit "m", range 0.0..=65.0,
            assumed "common sensors end at 4500 mm";
    }
    groups {
        /// What the firmware believes about the wheels; the real ones are the plant's.
        odometry: OdometrySettings,
    }
}

settings! {
    /// What the firmware believes about the wheels.
    pub struct OdometrySettings {
        /// Encoder pulses for one revolution of a wheel.
        pulses_per_revolution: u32 = 60, range 1..=100_000,
            assumed "the article does not name the motors";
        /// Radius of a wheel.
        wheel_radius: f64 = 0.05, unit "m", range 0.001..=2.0,
            assumed "a common size, 100 mm";
        /// Half the distance between front and rear axle.
        half_wheelbase: f64 = 0.10, unit "m", range 0.001..=5.0,
            assumed "a small car";
        /// Half the distance between left and right wheels.
        half_track: f64 = 0.12, unit "m", range 0.001..=5.0,
            assumed "a small car";
        /// What the mileage counts.
        mileage: Mileage = Mileage::Wheels,
            assumed "a motion's distance, which the article names by the same word, counts so";
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_default_is_allowed_and_reads_back() {
        let text = sim_settings::show_toml(&MecanumFirmwareSettings::default());
        let mut read = MecanumFirmwareSettings {
            baud: 9600,
            wiring: Wiring::X_Y_Z_E0,
            link_timeout: Some(S(1)),
            ..MecanumFirmwareSettings::default()
        };
        sim_settings::load_toml(&text, "defaults", &mut read).unwrap();
        assert_eq!(read, MecanumFirmwareSettings::default());
    }
}
