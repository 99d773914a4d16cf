//! Every number of the R150's firmware, with the reason we believe it.

use std::fmt;
use std::time::Duration;

use sim_settings::{Bounds, SettingValue, Value, choices, settings};

const MS: fn(u64) -> Duration = Duration::from_millis;
const S: fn(u64) -> Duration = Duration::from_secs;

choices! {
    /// What happens to a motor command that comes sooner than the reply interval allows.
    pub enum OverRate {
        /// It takes effect and gets no reply.
        Silent = "silent",
        /// It takes effect and is answered like any other.
        Answer = "answer",
        /// It takes effect and is answered when the interval has passed.
        Delay = "delay",
    }
}

choices! {
    /// What the outputs do when the client's heartbeat stops.
    pub enum OnHeartbeatLoss {
        /// They follow the app's set-points, which are all off unless the app set them.
        App = "app",
        /// They stay as they are.
        Hold = "hold",
        /// They switch off.
        Off = "off",
    }
}

choices! {
    /// What a rail does after a protection has switched it off.
    pub enum OvercurrentRecovery {
        /// It stays off until the client commands it off; the next "on" tries again.
        Latch = "latch",
        /// It tries again by itself after the retry period.
        Retry = "retry",
    }
}

choices! {
    /// Which command byte a reply carries.
    pub enum ReplyCommand {
        /// That of the request.
        Same = "same",
        /// That of the request with the highest bit set.
        HighBit = "high-bit",
    }
}

choices! {
    /// Where the decoder goes on after a frame that is not valid.
    pub enum Resync {
        /// At that frame's second byte, so that a valid frame inside it is found.
        SecondByte = "second-byte",
        /// Behind that frame.
        NextFrame = "next-frame",
    }
}

choices! {
    /// What a request that the module does not understand gets.
    pub enum RefusalReply {
        /// No reply.
        Silent = "silent",
        /// The reply `false`, one parameter byte 0.
        False = "false",
    }
}

choices! {
    /// What happens to a value that is out of its range.
    pub enum OutOfRange {
        /// The command changes nothing; where the command has a boolean reply, it is `false`.
        Refuse = "refuse",
        /// The nearest allowed value is taken.
        Clamp = "clamp",
    }
}

choices! {
    /// What happens to bits that have no meaning.
    pub enum ReservedBits {
        /// The others are obeyed.
        Ignore = "ignore",
        /// The command changes nothing and is answered `false`.
        Refuse = "refuse",
    }
}

choices! {
    /// Order of the bytes of a version word.
    pub enum VersionOrder {
        /// The major version is the most significant byte, so it is sent last.
        MajorHigh = "major-high",
        /// The major version is the least significant byte, so it is sent first.
        MajorLow = "major-low",
    }
}

choices! {
    /// What `voltage48v` measures.
    pub enum Voltage48v {
        /// The supply bus, whether or not the 48 V output is on.
        Supply = "supply",
        /// The 48 V output, 0 when it is off.
        Output = "output",
    }
}

choices! {
    /// What the outputs do when the client takes control.
    pub enum OnTakeover {
        /// They stay as the app had them.
        Keep = "keep",
        /// They return to what the client had set when it lost control.
        Restore = "restore",
    }
}

/// A version word: major, minor, region and build, a byte each.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Version(pub [u8; 4]);

impl Version {
    /// The version word.
    #[must_use]
    pub fn word(self, order: VersionOrder) -> u32 {
        match order {
            VersionOrder::MajorHigh => u32::from_be_bytes(self.0),
            VersionOrder::MajorLow => u32::from_le_bytes(self.0),
        }
    }
}

impl fmt::Display for Version {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let [major, minor, region, build] = self.0;
        write!(f, "{major}.{minor}.{region}.{build}")
    }
}

impl SettingValue for Version {
    type Bound = Self;

    fn read(value: &Value, _unit: &str) -> Result<Self, String> {
        let wrong = || format!("{value} is not a version");
        let Value::Text(text) = value else {
            return Err(wrong());
        };
        let parts: Vec<u8> = text
            .split('.')
            .map(str::parse)
            .collect::<Result<_, _>>()
            .map_err(|_| wrong())?;
        parts.try_into().map(Self).map_err(|_| wrong())
    }

    fn show(&self, _unit: &str) -> String {
        format!("\"{self}\"")
    }

    fn within(&self, bounds: &Bounds<Self>) -> bool {
        bounds.contains(self)
    }

    fn allowed(_unit: &str, _bounds: Option<&Bounds<Self>>) -> String {
        "\"major.minor.region.build\", each 0 to 255".to_owned()
    }
}

settings! {
    /// The IO module's firmware.
    pub struct R150FirmwareSettings {
        /// Speed of the RS-232 line.
        baud: u32 = 115_200, unit "baud", range 300..=4_000_000,
            documented "manual 4.1";
        /// A frame that was begun and then paused for this long is dropped.
        inter_byte_timeout: Duration = MS(20), range MS(1)..=S(60),
            assumed "the manual gives no timeout within a frame";
        /// Time from the end of a request to the beginning of its reply.
        reply_delay: Duration = Duration::ZERO, range Duration::ZERO..=S(60),
            assumed "the manual gives no processing time";
        /// Which command byte a reply carries.
        reply_command: ReplyCommand = ReplyCommand::Same,
            assumed "the manual shows no whole reply";
        /// Where the decoder goes on after a frame with a wrong CRC or a torn one.
        resync: Resync = Resync::SecondByte,
            assumed "the manual says nothing about errors on the line";
        /// What a frame with the right CRC and an unknown command gets.
        on_unknown_command: RefusalReply = RefusalReply::Silent,
            assumed "the manual says nothing about unknown commands";
        /// What 0x02 and 0x03 with a wrong number of parameter bytes get; 0x12 gets no reply.
        on_wrong_length: RefusalReply = RefusalReply::False,
            assumed "their reply is a boolean that means success";
        /// What happens to a PWM duty above 1000.
        on_duty_out_of_range: OutOfRange = OutOfRange::Refuse,
            assumed "the manual gives the range, not what happens beyond it";
        /// What happens to a motor PWM beyond -1000 to 1000; refused, it feeds no watchdog and gets
        /// no reply.
        on_motors_out_of_range: OutOfRange = OutOfRange::Clamp,
            assumed "the manual gives the range, not what happens beyond it";
        /// What happens to reserved bits of a power control request.
        reserved_power_bits: ReservedBits = ReservedBits::Ignore,
            assumed "the manual calls them reserved";
        /// What `voltage48v` in the system info measures.
        voltage_48v: Voltage48v = Voltage48v::Supply,
            assumed "the manual calls it the voltage of the main supply";
        /// Whether 0x02 answers `true` when a protection keeps a rail off that it switches on.
        true_when_tripped: bool = true,
            assumed "the command itself was carried out";
        /// Silence after which the client has lost control of power and PWM.
        heartbeat_timeout: Duration = S(3), range MS(1)..=S(3600),
            documented "manual 4.3.6";
        /// What the outputs do then.
        on_heartbeat_loss: OnHeartbeatLoss = OnHeartbeatLoss::App,
            assumed "the manual names the timeout, not its effect";
        /// What the outputs do when the client takes control, which any valid frame does.
        on_takeover: OnTakeover = OnTakeover::Keep,
            assumed "a client that comes back does not know what it finds";
        /// Time without a motor command after which the motors stop by themselves.
        motor_watchdog: Duration = MS(500), range MS(1)..=S(3600),
            documented "manual 4.3.8";
        /// Shortest time between two replies to motor commands, 50 ms being 20 Hz.
        motor_reply_interval: Duration = MS(50), range Duration::ZERO..=S(60),
            documented "manual 4.3.8: fastest reply rate 20 Hz";
        /// What happens to a motor command that comes sooner.
        over_rate: OverRate = OverRate::Silent,
            assumed "the manual gives the rate, not what happens above it";
        /// Hardware version that 0xF0 reports.
        hardware_version: Version = Version([1, 0, 0, 0]),
            assumed "placeholder for your module's own";
        /// Software version that 0xF0 reports.
        software_version: Version = Version([1, 0, 0, 0]),
            assumed "placeholder for your module's own";
        /// Order of the bytes of both.
        version_order: VersionOrder = VersionOrder::MajorHigh,
            assumed "the manual lists major, minor, region, build without saying which comes first";
        /// Whether locking the vehicle also applies the parking brake.
        locking_parks: bool = true,
            assumed "the manual says how the brake is released, not how it is applied";
        /// PWM of both motors while the remote control's forward or backward key is held, and
        /// of each motor, in opposite directions, while a turn key is held.
        remote_pwm: u32 = 500, unit "", range 0..=1000,
            assumed "the manual does not say how fast the remote control drives";
        /// Whether the emergency stop also applies the parking brake.
        emergency_stop_brakes: bool = true,
            assumed "the manual says only that it cuts propulsion power";
        /// Random relative error, one standard deviation, of the voltages and currents that 0x06
        /// reports.
        measurement_noise: f64 = 0.0, unit "%", range 0.0..=50.0,
            assumed "the manual gives no accuracy; 0 makes replies easy to compare";
    }
    groups {
        /// The module's protections.
        protection: ProtectionSettings,
    }
}

settings! {
    /// When the module switches outputs off to protect itself.
    pub struct ProtectionSettings {
        /// What a rail does after a protection has switched it off.
        overcurrent_recovery: OvercurrentRecovery = OvercurrentRecovery::Latch,
            assumed "the manual does not say how a trip ends";
        /// Time until a tripped rail tries again, when the recovery is "retry".
        retry_period: Duration = S(5), range MS(10)..=S(3600),
            assumed "the manual does not say how a trip ends";
        /// Power limit of each 12 V pair, A+B and C+D.
        limit_12v: f64 = 250.0, unit "W", range 1.0..=10_000.0,
            documented "manual section 3b";
        /// Power limit of the 48 V output.
        limit_48v: f64 = 2000.0, unit "W", range 1.0..=100_000.0,
            documented "manual section 3a";
        /// Current limit of the 5 V outputs together.
        limit_5v: f64 = 2.0, unit "A", range 0.01..=100.0,
            documented "manual section 3, note c";
        /// Part of its limit above which a 12 V pair trips.
        threshold_12v: f64 = 110.0, unit "%", range 1.0..=1000.0,
            assumed "the manual gives no threshold";
        /// Part of its limit above which the 48 V output trips.
        threshold_48v: f64 = 125.0, unit "%", range 1.0..=1000.0,
            assumed "the manual says only that it is set fairly high (note b)";
        /// How long a 12 V pair may stay above its threshold.
        delay_12v: Duration = MS(200), range Duration::ZERO..=S(60),
            assumed "the manual gives no time";
        /// How long the 48 V output may stay above its threshold.
        delay_48v: Duration = MS(100), range Duration::ZERO..=S(60),
            assumed "the manual gives no time";
        /// How long the 5 V outputs may stay above their limit.
        delay_5v: Duration = MS(100), range Duration::ZERO..=S(60),
            assumed "the manual gives no time";
        /// Voltage by which the limit of a 12 V pair becomes a current.
        nominal_12v: f64 = 12.0, unit "V", range 1.0..=100.0,
            documented "manual section 3b";
        /// Voltage by which the limit of the 48 V output becomes a current.
        nominal_48v: f64 = 48.0, unit "V", range 1.0..=100.0,
            documented "manual section 3a";
        /// Multiple of its limit, as a current, above which any rail trips almost at once; a short
        /// pulls the voltage down, so power would not tell.
        short_multiple: f64 = 3.0, unit "", range 1.0..=1000.0,
            assumed "the manual promises short-circuit protection without figures";
        /// How long a rail may stay above that multiple.
        short_delay: Duration = MS(1), range Duration::ZERO..=S(60),
            assumed "the manual promises short-circuit protection without figures";
        /// Temperature above which a 12 V pair reports over-temperature and switches off.
        over_temperature: f64 = 85.0, unit "degC", range -40.0..=200.0,
            assumed "the manual names the bit, not the temperature";
        /// Temperature below which that report ends.
        over_temperature_clear: f64 = 75.0, unit "degC", range -40.0..=200.0,
            assumed "the manual names the bit, not the temperature";
        /// Supply voltage below which the module reports a power module fault and switches its
        /// outputs off.
        undervoltage: f64 = 39.0, unit "V", range 0.0..=100.0,
            assumed "3 V a cell; the manual names the bit, not its cause";
        /// How long the supply may stay below that voltage.
        undervoltage_delay: Duration = MS(5), range Duration::ZERO..=S(60),
            assumed "longer than a short circuit takes to trip, which pulls the supply down too";
        /// Supply voltage above which that report ends.
        undervoltage_clear: f64 = 41.0, unit "V", range 0.0..=100.0,
            assumed "some hysteresis, so that the bit does not flutter";
    }
}
