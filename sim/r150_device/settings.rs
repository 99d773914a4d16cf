//! Every number of the R150's firmware, with the reason we believe it.

mod choices;
mod version;

use std::time::Duration;

use rigsim_settings::settings;

use crate::uart::Adapter;

pub use choices::*;
pub use version::Version;

const MS: fn(u64) -> Duration = Duration::from_millis;
const S: fn(u64) -> Duration = Duration::from_secs;

settings! {
    /// The IO module's firmware.
    pub struct R150FirmwareSettings {
        /// Speed of the RS-232 line.
        baud: u32 = 115_200, unit "baud", range 300..=4_000_000,
            documented "manual 4.1";
        /// Adapter of the client's computer, which passes bytes in groups.
        adapter: Adapter = Adapter::Usb,
            assumed "most computers have no serial port but one on USB; its frames begin at whole milliseconds";
        /// A frame that was begun and then paused for this long is dropped.
        inter_byte_timeout: Duration = MS(20), range MS(1)..=S(60),
            assumed "the manual gives no timeout within a frame";
        /// Time from the end of a request to the beginning of its reply.
        reply_delay: Duration = Duration::ZERO, range Duration::ZERO..=S(60),
            assumed "the manual gives no processing time";
        /// Up to how much longer a reply takes, by chance and evenly spread.
        reply_spread: Duration = Duration::from_micros(200), range Duration::ZERO..=S(60),
            assumed "a main loop that looks for requests some thousand times a second";
        /// Time from the coming of the module's supply until it answers.
        boot_time: Duration = Duration::ZERO, range Duration::ZERO..=S(3600),
            assumed "the manual gives no start-up time";
        /// Command byte of a reply.
        reply_command: ReplyCommand = ReplyCommand::Same,
            assumed "the manual shows no whole reply";
        /// Answer to a whole frame with a wrong CRC.
        on_bad_crc: RefusalReply = RefusalReply::Silent,
            assumed "the manual says nothing about errors on the line";
        /// Answer to a frame with the right CRC and an unknown command.
        on_unknown_command: RefusalReply = RefusalReply::Silent,
            assumed "the manual says nothing about unknown commands";
        /// Answer to 0x02 and 0x03 with a wrong number of parameter bytes.
        on_wrong_length: RefusalReply = RefusalReply::False,
            assumed "their reply is a boolean that means success";
        /// Treatment of a PWM duty above 1000.
        on_duty_out_of_range: OutOfRange = OutOfRange::Refuse,
            assumed "the manual gives the range, not what happens beyond it";
        /// Treatment of a motor PWM beyond -1000 to 1000.
        on_motors_out_of_range: OutOfRange = OutOfRange::Clamp,
            assumed "the manual gives the range, not what happens beyond it";
        /// Answer to 0x12 with a wrong number of parameter bytes, and with a PWM out of range if
        /// that is refused.
        on_motors_refused: MotorsRefusalReply = MotorsRefusalReply::Silent,
            assumed "its reply has no room for a failure";
        /// In which states of the vehicle 0x12 is answered.
        motors_answered: MotorsAnswered = MotorsAnswered::Always,
            assumed "the manual says when it drives, not when it is answered";
        /// Meaning of `voltage12v` in the system info.
        voltage_12v: Voltage12v = Voltage12v::Output,
            assumed "the manual calls it the voltage of the outputs";
        /// Meaning of `voltage48v` in the system info.
        voltage_48v: Voltage48v = Voltage48v::Supply,
            assumed "the manual calls it the voltage of the main supply";
        /// Meaning of `current48v` in the system info.
        current_48v: Current48v = Current48v::Output,
            assumed "the manual calls it the current of the main supply, beside those of the outputs";
        /// Answers 0x02 with `true` although a protection keeps a rail off that it switches on.
        true_when_tripped: bool = true,
            assumed "the command itself was carried out";
        /// Silence after which the client has lost control of power and PWM.
        heartbeat_timeout: Duration = S(3), range MS(1)..=S(3600),
            documented "manual 4.3.6";
        /// Meaning of a heartbeat.
        heartbeat_by: HeartbeatBy = HeartbeatBy::Requests,
            assumed "the manual says that other commands count, not whether wrong ones do";
        /// Control of power and PWM until the client takes them; the heartbeat runs from the
        /// client's first.
        control_at_power_on: ControlMode = ControlMode::App,
            assumed "the manual names both modes, not the one it starts in";
        /// Request by which the client takes control.
        control_taken_by: ControlTakenBy = ControlTakenBy::OwnCommand,
            assumed "the manual names the modes, not what changes them; a client that only looks \
                     then sees the app's control";
        /// Answer to 0x02 and 0x03 while the app insists on control of what they set.
        on_app_in_control: RefusalReply = RefusalReply::False,
            assumed "their reply is a boolean that means success";
        /// State of the outputs when the heartbeat is lost.
        on_heartbeat_loss: OnHeartbeatLoss = OnHeartbeatLoss::App,
            assumed "the manual names the timeout, not its effect";
        /// State of the outputs when the client takes control.
        on_takeover: OnTakeover = OnTakeover::Keep,
            assumed "a client that comes back does not know what it finds";
        /// Time without a motor command after which the motors stop by themselves.
        motor_watchdog: Duration = MS(500), range MS(1)..=S(3600),
            documented "manual 4.3.8";
        /// Shortest time between two replies to motor commands, 50 ms being 20 Hz.
        motor_reply_interval: Duration = MS(50), range Duration::ZERO..=S(60),
            documented "manual 4.3.8: fastest reply rate 20 Hz";
        /// Treatment of a motor command that comes sooner.
        over_rate: OverRate = OverRate::Delay,
            assumed "a limit on replies is not a limit on commands";
        /// Hardware version that 0xF0 reports.
        hardware_version: Version = Version([1, 0, 0, 0]),
            assumed "placeholder for your module's own";
        /// Software version that 0xF0 reports.
        software_version: Version = Version([1, 0, 0, 0]),
            assumed "placeholder for your module's own";
        /// Order of the bytes of both versions.
        version_order: VersionOrder = VersionOrder::MajorHigh,
            assumed "the manual lists major, minor, region, build without saying which comes first";
        /// Applies the parking brake when the vehicle is locked.
        locking_parks: bool = true,
            assumed "the manual says how the brake is released, not how it is applied";
        /// Applies the parking brake at the emergency stop.
        emergency_stop_brakes: bool = true,
            assumed "the manual says only that it cuts propulsion power";
        /// Locks the vehicle at the emergency stop, so that it must be unlocked again.
        emergency_stop_locks: bool = false,
            assumed "the manual says only that it cuts propulsion power";
        /// Cuts the tail supply, on which the module hangs, at the emergency stop.
        emergency_stop_cuts_tail: bool = false,
            assumed "the manual's sentence about it is garbled; the module then keeps answering";
        /// 0x12 drives only while the parking brake is released; else it releases the brake
        /// for as long as it drives.
        driving_needs_release: bool = true,
            assumed "the manual mentions the release only for pushing by hand";
        /// Stops the motors when the battery is empty.
        empty_battery_stops: bool = true,
            assumed "the manual reports the charge and says nothing about its end";
        /// Time constant of the filter of the motor speeds that 0x12 reports.
        speed_filter: Duration = MS(20), range Duration::ZERO..=S(60),
            assumed "a filter of first order, as such firmware has";
    }
    groups {
        /// Random errors of readings.
        noise: NoiseSettings,
        /// The module's protections.
        protection: ProtectionSettings,
    }

    /// Random errors of what 0x06 and 0x12 report: one standard deviation of white noise, before the
    /// reading is rounded to the step of its field. 0 turns it off.
    pub struct NoiseSettings {
        /// Random error of every voltage.
        voltage: f64 = 0.01, unit "V", range 0.0..=10.0,
            assumed "a step of a converter with 12 bits over 60 V is 15 mV, and a module averages some";
        /// Random error of every current, also of one that is 0.
        current: f64 = 0.01, unit "A", range 0.0..=10.0,
            assumed "a step of a converter with 12 bits over 50 A is 12 mA, and a module averages some";
        /// Random error of every temperature.
        temperature: f64 = 0.1, unit "K", range 0.0..=50.0,
            assumed "a thermistor at the same converter";
        /// Random error of the speed of a turning motor. One that stands reads 0.
        speed: f64 = 1.0, unit "rpm", range 0.0..=1000.0,
            assumed "a clock of the module that is off by 10 us over a window of 20 ms at full speed";
    }

    /// Protections by which the module switches outputs off.
    pub struct ProtectionSettings {
        /// State of a rail after a protection has switched it off.
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
        /// Time for which a 12 V pair may stay above its threshold.
        delay_12v: Duration = MS(200), range Duration::ZERO..=S(60),
            assumed "the manual gives no time";
        /// Time for which the 48 V output may stay above its threshold.
        delay_48v: Duration = MS(100), range Duration::ZERO..=S(60),
            assumed "the manual gives no time";
        /// Reaction of the module to an overloaded 12 V pair.
        on_overcurrent_12v: ProtectionAction = ProtectionAction::SwitchOff,
            assumed "the manual names the bit; it promises protection for 48 V and 5 V";
        /// Reaction of the module to a 12 V pair that is too hot.
        on_over_temperature: ProtectionAction = ProtectionAction::SwitchOff,
            assumed "the manual names the bit, not what follows";
        /// Reaction of the module to a power module fault; it concerns all outputs.
        on_power_module_fault: ProtectionAction = ProtectionAction::SwitchOff,
            assumed "the manual names the bit, not what follows";
        /// Temperature above which a 12 V pair reports over-temperature.
        over_temperature: f64 = 85.0, unit "degC", range -40.0..=200.0,
            assumed "the manual names the bit, not the temperature";
        /// Supply voltage below which the module reports a power module fault.
        undervoltage: f64 = 39.0, unit "V", range 0.0..=100.0,
            assumed "3 V a cell; the manual names the bit, not its cause";
    }
}
