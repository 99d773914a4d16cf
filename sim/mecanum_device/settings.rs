//! Every choice about the mecanum board's firmware, with the reason we believe it.

mod choices;

use std::time::Duration;

use rigsim_settings::settings;

use crate::uart::Adapter;

pub use choices::*;

const MS: fn(u64) -> Duration = Duration::from_millis;
const S: fn(u64) -> Duration = Duration::from_secs;

settings! {
    /// The mecanum board's firmware.
    pub struct MecanumFirmwareSettings {
        /// Speed of the main link.
        baud: u32 = 115_200, unit "baud", range 300..=4_000_000,
            assumed "the article gives no speed";
        /// Adapter of the computer on the main link, which passes bytes in groups.
        adapter: Adapter = Adapter::Usb,
            assumed "most computers have no serial port but one on USB; its frames begin at whole milliseconds";
        /// Speed of the ROS link.
        ros_baud: u32 = 9600, unit "baud", range 300..=4_000_000,
            assumed "as on the same authors' sibling vehicle";
        /// Adapter of the computer on the ROS link.
        ros_adapter: Adapter = Adapter::Usb,
            assumed "as on the main link";
        /// Order of the bytes in a field of the main link, both ways.
        byte_order: ByteOrder = ByteOrder::Little,
            assumed "the article gives none; the board's STM32 keeps numbers so";
        /// A packet on the main link that was begun and then paused for this long is dropped.
        inter_byte_timeout: Duration = MS(50), range MS(1)..=S(60),
            assumed "the packets have no header; the article gives no way to find their beginning";
        /// Answer to a valid packet or line.
        acknowledge: Acknowledge = Acknowledge::Nothing,
            assumed "the article gives no answer but the status";
        /// Time between two status packets on the main link.
        status_period: Duration = MS(100), range MS(1)..=S(3600),
            assumed "the article gives no rate";
        /// Meaning of a status packet's sequence number.
        status_seq: StatusSeq = StatusSeq::Count,
            assumed "the article does not say what it counts";
        /// Time between two lines on the ROS link.
        ros_report_period: Duration = MS(100), range MS(1)..=S(3600),
            assumed "the article gives no rate";
        /// Links whose motions count while the ROS link is configured.
        orders_with_ros: OrdersWithRos = OrdersWithRos::BothLinks,
            assumed "the article takes only the magnetic sensor away then";
        /// Motions that a preempting one discards.
        preempt: Preempt = Preempt::All,
            assumed "a stop then stops the car, whatever waits";
        /// Number of motions that may wait beside the one that runs.
        queue_length: u32 = 16, range 0..=1024,
            assumed "the article says that motions need not preempt, not how many may wait";
        /// Time for which the wheels are held between a motion that has ended and one that waits.
        motion_pause: Duration = MS(100), range Duration::ZERO..=S(60),
            assumed "pulses without a sign can only be counted from a stand";
        /// Meaning of a motion without distance.
        zero_distance: ZeroDistance = ZeroDistance::End,
            assumed "it has been driven already";
        /// Meaning of a motion without speed.
        zero_speed: ZeroSpeed = ZeroSpeed::End,
            assumed "a motion that cannot end would block the queue";
        /// Meaning of a speed beyond ±500.
        over_speed: OverSpeed = OverSpeed::Clamp,
            assumed "the article gives the range, not what happens beyond it";
        /// Direction in which a positive speed turns the car.
        positive_turn: PositiveTurn = PositiveTurn::Right,
            assumed "the picture of the wheels is taken to hold for packets; their table gives no sign";
        /// Direction in which a positive speed strafes.
        positive_strafe: PositiveStrafe = PositiveStrafe::Left,
            assumed "the picture of the wheels is taken to hold for packets; their table gives no sign";
        /// Driver when the board starts.
        start_mode: StartMode = StartMode::Board,
            assumed "the first of the two modes";
        /// Fate of motions when the control mode changes.
        mode_change: ModeChange = ModeChange::Discard,
            assumed "the previous driver stops driving";
        /// Silence of the client after which its motions are discarded; any valid packet or line on
        /// either link ends it.
        link_timeout: Option<Duration> = None, range MS(1)..=S(3600),
            assumed "the article documents no watchdog";
        /// State of BK while no wheel is driven; one that stands while others turn is always held.
        idle_wheels: IdleWheels = IdleWheels::Hold,
            assumed "a car that has arrived should stay";
        /// Time in which a wheel at full speed comes to a stand when it is driven the other way, in
        /// proportion from less. Until then pulses count the old way.
        reversing_time: Duration = MS(200), range Duration::ZERO..=S(60),
            assumed "the ramp of the motors, which the same authors published for another vehicle";
        /// Time in which a wheel at full speed comes to a stand when it is held.
        braking_time: Duration = MS(30), range Duration::ZERO..=S(60),
            assumed "a brake stops a wheel before the car";
        /// Wheel speed that the full speed voltage stands for.
        full_speed: f64 = 50.0, unit "rpm", range 0.1..=10_000.0,
            assumed "the highest speed that a motion packet can ask for";
        /// Wheel speed of motions that come over the ROS link.
        ascii_speed: f64 = 30.0, unit "rpm", range 0.0..=10_000.0,
            assumed "its lines carry no speed";
        /// Revolutions of a wheel that 1 stands for on the ROS link.
        ascii_unit: f64 = 0.1, range 0.001..=10.0,
            assumed "the article's example: X10 is one revolution";
        /// Meaning of the letters Y and Z on the ROS link.
        ascii_letters: AsciiLetters = AsciiLetters::Table,
            documented "article, table of letters; its picture says otherwise";
        /// Discards the running and the waiting motions when a line arrives on the ROS link.
        ascii_preempt: bool = true,
            assumed "its lines do not say";
        /// The sign of V in a report line.
        ascii_speed_sign: AsciiSpeedSign = AsciiSpeedSign::Motion,
            assumed "the article names a speed, and motions have a sign";
        /// Distance that S in a report line counts.
        ascii_mileage: AsciiMileage = AsciiMileage::Total,
            assumed "the article calls it the mileage, as it does the status packet's";
        /// Wheel speed while a key of the remote control is held.
        remote_speed: f64 = 30.0, unit "rpm", range 0.0..=10_000.0,
            assumed "the article names the mode only";
        /// In which axes the status packet gives the velocity.
        velocity_frame: VelocityFrame = VelocityFrame::Odometry,
            assumed "the article names x and y axis, not whose";
        /// Reading of a velocity, position, heading or mileage beyond its field.
        overflow: Overflow = Overflow::Wrap,
            assumed "as a C assignment to the narrower type does";
        /// Range of the heading in the status packet.
        heading_range: HeadingRange = HeadingRange::FullTurns,
            assumed "the article gives no range";
        /// Time for which the status packet calls a side's motors running.
        moto_state: MotorState = MotorState::Driven,
            assumed "the article says stop and running";
        /// Meaning of the bits of `magn`.
        magn_bits: MagnBits = MagnBits::FromLeft,
            assumed "the same authors' published firmware has 16 channels";
        /// Keeps the number of a tag in `rfid` after it has left the reader.
        rfid_hold: bool = false,
            assumed "the article does not say how long it stands";
        /// Reading of an ultrasonic sensor without an echo.
        ultrasonic_no_echo: NoEcho = NoEcho::Farthest,
            assumed "a client that looks for obstacles then sees none";
    }
    groups {
        /// Belief of the firmware about the wheels; the real ones are the plant's.
        odometry: OdometrySettings,
    }

    /// Belief of the firmware about the wheels.
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
        /// Sets the mileage to 0 when the pose is set.
        set_pose_clears_mileage: bool = false,
            assumed "the article calls it the total mileage, and sets coordinates only";
        /// Distance that the mileage counts.
        mileage: Mileage = Mileage::Wheels,
            assumed "a motion's distance, which the article names by the same word, counts so";
    }
}

#[cfg(test)]
mod tests;
