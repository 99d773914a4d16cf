//! What happens in the R150 that a developer wants to know.

use std::fmt;
use std::time::Duration;

use sim_settings::show_duration;

use super::codec::Decoded;
use super::command::{Refusal, Request, name};
use super::control::POWER_BITS;
use super::protection::{Cause, Group};
use super::reply::Reply;
use super::vehicle::{Action, Obstacle};
use crate::event::{Hex, Level};

/// Something that happened in the module or the vehicle.
#[derive(Debug, Clone, PartialEq)]
pub enum R150Event {
    /// A request was understood.
    Request {
        /// What it asks.
        request: Request,
        /// As received.
        frame: Vec<u8>,
    },
    /// A reply began its way to the client.
    Reply {
        /// What it says.
        reply: Reply,
        /// As sent.
        frame: Vec<u8>,
    },
    /// The stream held something that is no valid frame.
    BadStream(Decoded),
    /// A frame with the right CRC is no request.
    Refused {
        /// Why.
        refusal: Refusal,
        /// As received.
        frame: Vec<u8>,
    },
    /// A request has a value that the manual does not allow.
    BadValue {
        /// Which.
        fault: ValueFault,
        /// As received.
        frame: Vec<u8>,
    },
    /// A motor command came sooner than the reply interval allows.
    OverRate {
        /// Time since the last answered one.
        after: Duration,
    },
    /// A power or PWM command was refused because the app holds control.
    AppInControl(u8),
    /// A motor command does not move the vehicle.
    NotDriving(Vec<Obstacle>),
    /// The motor watchdog stopped the motors.
    WatchdogFired {
        /// Set-point it cleared.
        right: i16,
        /// Set-point it cleared.
        left: i16,
        /// Whether that set-point was moving the vehicle.
        driving: bool,
    },
    /// The client took control of power and PWM.
    ControlTaken,
    /// The heartbeat stopped; control went back to the app.
    HeartbeatLost,
    /// A protection switched a group of outputs off.
    Tripped(Group, Cause),
    /// A tripped group may be switched on again.
    TripCleared(Group),
    /// An over-temperature report ended.
    Cooled(Group),
    /// The supply is too low, or the module is faulty.
    PowerModuleFault {
        /// Supply voltage in V.
        supply_v: f64,
    },
    /// That report ended.
    PowerModuleRecovered,
    /// The module lost its supply.
    PowerLost,
    /// The firmware restarts by itself.
    Reset {
        /// What it takes.
        boot: Duration,
    },
    /// The module has started.
    Started,
    /// Somebody pressed a button.
    Operated(Action),
    /// Replies were dropped because too many waited.
    ReplyDropped,
}

/// A value that the manual does not allow; the settings say what becomes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum ValueFault {
    /// A PWM duty above 1000.
    DutyOutOfRange([u16; 4]),
    /// A motor PWM outside ±1000.
    MotorsOutOfRange {
        /// As the client sent it.
        right: i16,
        /// As the client sent it.
        left: i16,
    },
    /// Reserved bits in a power control request.
    ReservedBits(u32),
}

impl ValueFault {
    /// What is wrong with the values of a request, if anything is.
    #[must_use]
    pub fn of(request: Request) -> Option<Self> {
        match request {
            Request::SetPwmOutputs { duty } if duty.iter().any(|duty| *duty > 1000) => {
                Some(Self::DutyOutOfRange(duty))
            }
            Request::SetMotors { right, left }
                if right.unsigned_abs() > 1000 || left.unsigned_abs() > 1000 =>
            {
                Some(Self::MotorsOutOfRange { right, left })
            }
            Request::PowerControl { status } if status & !u32::from(POWER_BITS) != 0 => {
                Some(Self::ReservedBits(status & !u32::from(POWER_BITS)))
            }
            _ => None,
        }
    }
}

impl R150Event {
    /// How much it matters.
    #[must_use]
    pub fn level(&self) -> Level {
        match self {
            Self::Request { .. } | Self::Reply { .. } => Level::Traffic,
            Self::ControlTaken
            | Self::TripCleared(_)
            | Self::Cooled(_)
            | Self::PowerModuleRecovered
            | Self::Started
            | Self::Operated(_) => Level::Notice,
            _ => Level::Warning,
        }
    }

    /// A short stable name, the same in logs, reports and documentation.
    #[must_use]
    pub fn code(&self) -> &'static str {
        match self {
            Self::Request { .. } => "request",
            Self::Reply { .. } => "reply",
            Self::BadStream(Decoded::BadCrc { .. }) => "bad_crc",
            Self::BadStream(Decoded::Partial(_)) => "partial_frame",
            Self::BadStream(_) => "noise",
            Self::Refused {
                refusal: Refusal::UnknownCommand(_),
                ..
            } => "unknown_command",
            Self::Refused {
                refusal: Refusal::WrongLength { .. },
                ..
            } => "wrong_length",
            Self::BadValue { fault, .. } => match fault {
                ValueFault::DutyOutOfRange(_) => "duty_out_of_range",
                ValueFault::MotorsOutOfRange { .. } => "motors_out_of_range",
                ValueFault::ReservedBits(_) => "reserved_bits",
            },
            Self::OverRate { .. } => "over_rate",
            Self::AppInControl(_) => "app_in_control",
            Self::NotDriving(_) => "not_driving",
            Self::WatchdogFired { .. } => "watchdog_fired",
            Self::ControlTaken => "control_taken",
            Self::HeartbeatLost => "heartbeat_lost",
            Self::Tripped(_, Cause::Overcurrent) => "overcurrent",
            Self::Tripped(_, Cause::OverTemperature) => "over_temperature",
            Self::TripCleared(_) => "trip_cleared",
            Self::Cooled(_) => "cooled",
            Self::PowerModuleFault { .. } => "power_module_fault",
            Self::PowerModuleRecovered => "power_module_recovered",
            Self::PowerLost => "power_lost",
            Self::Reset { .. } => "firmware_reset",
            Self::Started => "started",
            Self::Operated(_) => "operated",
            Self::ReplyDropped => "reply_dropped",
        }
    }

    /// Whether it is something that the client did and the protocol forbids, or that is risky.
    #[must_use]
    pub fn is_client_fault(&self) -> bool {
        matches!(
            self,
            Self::BadStream(_)
                | Self::Refused { .. }
                | Self::BadValue { .. }
                | Self::OverRate { .. }
                | Self::WatchdogFired { driving: true, .. }
                | Self::HeartbeatLost
        )
    }

    /// The bytes it is about, if it is about bytes.
    #[must_use]
    pub fn bytes(&self) -> Option<&[u8]> {
        match self {
            Self::Request { frame, .. }
            | Self::Reply { frame, .. }
            | Self::Refused { frame, .. }
            | Self::BadValue { frame, .. } => Some(frame),
            Self::BadStream(
                Decoded::BadCrc { bytes, .. } | Decoded::Partial(bytes) | Decoded::Noise(bytes),
            ) => Some(bytes),
            _ => None,
        }
    }
}

impl fmt::Display for R150Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request { request, .. } => write!(f, "{request}"),
            Self::Reply { reply, .. } => write!(f, "{reply}"),
            Self::BadStream(Decoded::BadCrc { bytes, expected }) => {
                let [low, high] = expected.to_le_bytes();
                write!(
                    f,
                    "CRC error: the frame {} should end in {low:02X} {high:02X}; no reply",
                    Hex(bytes)
                )
            }
            Self::BadStream(Decoded::Partial(bytes)) => {
                write!(f, "incomplete frame dropped after a pause: {}", Hex(bytes))
            }
            Self::BadStream(Decoded::Noise(bytes)) => {
                write!(f, "bytes outside any frame: {}", Hex(bytes))
            }
            Self::BadStream(Decoded::Frame(_)) => write!(f, "a frame"),
            Self::Refused {
                refusal: Refusal::UnknownCommand(command),
                ..
            } => {
                write!(f, "unknown command 0x{command:02X}; nothing changed")
            }
            Self::Refused {
                refusal:
                    Refusal::WrongLength {
                        command,
                        wanted,
                        found,
                    },
                ..
            } => {
                let name = name(*command).unwrap_or("?");
                write!(
                    f,
                    "0x{command:02X} {name} takes {wanted} parameter bytes, {found} came; nothing changed"
                )
            }
            Self::BadValue { fault, .. } => write!(f, "{fault}"),
            Self::OverRate { after } => write!(
                f,
                "motor command {:.3} ms after the last answered one; replies come no faster than \
                 the reply interval",
                after.as_secs_f64() * 1000.0
            ),
            Self::AppInControl(command) => {
                let name = name(*command).unwrap_or("?");
                write!(f, "0x{command:02X} {name} refused: the app holds control")
            }
            Self::NotDriving(obstacles) => {
                let words: Vec<&str> = obstacles.iter().map(|o| o.in_words()).collect();
                write!(
                    f,
                    "motor command does not move the vehicle: {}",
                    words.join(", ")
                )
            }
            Self::WatchdogFired { right, left, .. } => write!(
                f,
                "motor watchdog fired: no motor command in time, motors stopped (were right {right} left {left})"
            ),
            Self::ControlTaken => {
                write!(f, "the client took control of power and PWM (RS232 mode)")
            }
            Self::HeartbeatLost => {
                write!(
                    f,
                    "heartbeat lost: no valid frame in time, control went back to the app"
                )
            }
            Self::Tripped(group, cause) => {
                write!(f, "{group}: {cause}; its outputs are off")
            }
            Self::TripCleared(group) => write!(f, "{group} may be switched on again"),
            Self::Cooled(group) => write!(f, "{group} has cooled down"),
            Self::PowerModuleFault { supply_v } => {
                write!(
                    f,
                    "power module fault at {supply_v:.1} V supply; all outputs are off"
                )
            }
            Self::PowerModuleRecovered => write!(f, "power module fault ended"),
            Self::PowerLost => write!(f, "the module lost its supply and is silent"),
            Self::Reset { boot } => write!(
                f,
                "the module's firmware restarts; it is silent for {}",
                show_duration(*boot)
            ),
            Self::Started => write!(f, "the module has started"),
            Self::Operated(action) => write!(f, "operator: {action}"),
            Self::ReplyDropped => write!(f, "a reply was dropped: too many wait to be sent"),
        }
    }
}

impl fmt::Display for ValueFault {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::DutyOutOfRange(duty) => {
                write!(f, "PWM duty {duty:?} out of range: 0 to 1000 is allowed")
            }
            Self::MotorsOutOfRange { right, left } => write!(
                f,
                "motor PWM right {right} left {left} out of range: -1000 to 1000 is allowed"
            ),
            Self::ReservedBits(bits) => write!(f, "reserved power bits 0x{bits:08X} are set"),
        }
    }
}

impl fmt::Display for Request {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "0x{:02X} {}",
            self.command(),
            name(self.command()).unwrap_or("?")
        )?;
        match self {
            Self::PowerControl { status } => write!(f, " {}", Rails(*status)),
            Self::SetPwmOutputs { duty } => write!(f, " {duty:?}"),
            Self::SetMotors { right, left } => write!(f, " right {right} left {left}"),
            _ => Ok(()),
        }
    }
}

impl fmt::Display for Reply {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "0x{:02X} {}",
            self.command(),
            name(self.command()).unwrap_or("?")
        )?;
        match self {
            Self::Bool { success, .. } => write!(f, " {success}"),
            Self::PwmOutputs { duty } => write!(f, " {duty:?}"),
            Self::PwmInputs { frequency_hz, duty } => write!(f, " {frequency_hz:?} Hz {duty:?}"),
            Self::Version { hardware, software } => {
                write!(f, " hardware 0x{hardware:08X} software 0x{software:08X}")
            }
            Self::Motors {
                right_rpm,
                left_rpm,
                soc,
            } => write!(
                f,
                " right {right_rpm} rpm left {left_rpm} rpm soc {}.{} %",
                soc / 10,
                soc % 10
            ),
            Self::SystemInfo(info) => write!(
                f,
                " supply {} mV, on: {}, status 0x{:02X}, {} / {} mA, mode {}/{}",
                info.voltage_48v,
                Rails(u32::from(info.power_status)),
                info.sys_status,
                info.current_12v.map(|ma| ma.to_string()).join("+"),
                info.current_48v,
                info.power_ctrl_mode,
                info.pwm_ctrl_mode,
            ),
        }
    }
}

/// Names of the rails whose bits are set.
struct Rails(u32);

impl fmt::Display for Rails {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        const NAMES: [&str; 6] = ["12V-A", "12V-B", "12V-C", "12V-D", "48V", "5V"];
        let on: Vec<&str> = (0..NAMES.len())
            .filter(|bit| self.0 >> bit & 1 == 1)
            .map(|bit| NAMES[bit])
            .collect();
        if on.is_empty() {
            write!(f, "none")
        } else {
            write!(f, "{}", on.join(" "))
        }
    }
}
