//! Events of an R150: what they are called, and what they say.

use std::borrow::Cow;
use std::fmt;

use rigsim_settings::show_duration;

use crate::event::{Code, EventKind, Hex, code};
use crate::message::{Message, MessageInfo};
use crate::r150_device::codec;
use crate::r150_device::command::{Refusal, name};
use crate::r150_device::control::Parts;
use crate::r150_device::group::Cause;
use crate::r150_device::settings::ProtectionAction;
use crate::r150_device::{R150Event, ValueError};
use crate::scanner::Decoded;

crate::codes! {
    /// A whole frame with a wrong CRC.
    BAD_CRC = "bad_crc", Warning, ClientUnlessDisturbed;
    /// A frame was begun and not finished.
    PARTIAL_FRAME = "partial_frame", Warning, ClientUnlessDisturbed;
    /// A frame with an unknown command.
    UNKNOWN_COMMAND = "unknown_command", Warning, ClientUnlessDisturbed;
    /// A frame with the wrong number of parameters.
    WRONG_LENGTH = "wrong_length", Warning, ClientUnlessDisturbed;
    /// A PWM duty above 1000.
    DUTY_OUT_OF_RANGE = "duty_out_of_range", Warning, ClientUnlessDisturbed;
    /// A motor PWM beyond 1000.
    MOTORS_OUT_OF_RANGE = "motors_out_of_range", Warning, ClientUnlessDisturbed;
    /// Reserved bits in a power control request.
    RESERVED_BITS = "reserved_bits", Warning, ClientUnlessDisturbed;
    /// Motor commands came faster than they can be answered.
    OVER_RATE = "over_rate", Warning, ClientUnlessHeldBack;
    /// A command was refused because the app holds control.
    APP_IN_CONTROL = "app_in_control", Warning, NoParty;
    /// A motor command does not move the vehicle.
    NOT_DRIVING = "not_driving", Warning, NoParty;
    /// The motor watchdog stopped the motors; attributed to the client if the vehicle was driving.
    WATCHDOG_FIRED = "watchdog_fired", Warning, ClientUnlessDisturbedOrLate;
    /// The client took control.
    CONTROL_TAKEN = "control_taken", Notice, NoParty;
    /// The heartbeat stopped.
    HEARTBEAT_LOST = "heartbeat_lost", HeartbeatLost, ClientUnlessDisturbedOrLate;
    /// A protection switched outputs off for their current.
    OVERCURRENT = "overcurrent", Warning, NoParty;
    /// A protection switched outputs off for their temperature.
    OVER_TEMPERATURE = "over_temperature", Warning, NoParty;
    /// Outputs may be switched on again.
    TRIP_CLEARED = "trip_cleared", Notice, NoParty;
    /// Outputs have cooled down.
    COOLED = "cooled", Notice, NoParty;
    /// The power module reports a fault.
    POWER_MODULE_FAULT = "power_module_fault", Warning, NoParty;
    /// It no longer does.
    POWER_MODULE_RECOVERED = "power_module_recovered", Notice, NoParty;
    /// Too many replies waited.
    REPLY_DROPPED = "reply_dropped", Warning, NoParty;
    /// A fuse blew.
    FUSE_BLOWN = "fuse_blown", Damage, NoParty;
    /// A motor driver allows less current, or none, because of heat.
    MOTOR_HOT = "motor_hot", Damage, NoParty;
    /// It allows as much as ever.
    MOTOR_COOLED = "motor_cooled", Notice, NoParty;
}

impl EventKind for R150Event {
    fn code(&self) -> Code {
        match self {
            Self::Request { .. } => code::REQUEST,
            Self::Reply { .. } => code::REPLY,
            Self::BadStream(Decoded::Wrong(_)) => BAD_CRC,
            Self::BadStream(Decoded::Partial(_)) => PARTIAL_FRAME,
            Self::BadStream(_) => code::NOISE,
            Self::Refused {
                refusal: Refusal::UnknownCommand(_),
                ..
            } => UNKNOWN_COMMAND,
            Self::Refused {
                refusal: Refusal::WrongLength { .. },
                ..
            } => WRONG_LENGTH,
            Self::BadValue { error, .. } => match error {
                ValueError::DutyOutOfRange(_) => DUTY_OUT_OF_RANGE,
                ValueError::MotorsOutOfRange { .. } => MOTORS_OUT_OF_RANGE,
                ValueError::ReservedBits(_) => RESERVED_BITS,
            },
            Self::OverRate { .. } => OVER_RATE,
            Self::AppInControl(_) => APP_IN_CONTROL,
            Self::NotDriving(_) => NOT_DRIVING,
            Self::WatchdogFired { .. } => WATCHDOG_FIRED,
            Self::ControlTaken(_) => CONTROL_TAKEN,
            Self::HeartbeatLost => HEARTBEAT_LOST,
            Self::Tripped(_, Cause::Overcurrent, _) => OVERCURRENT,
            Self::Tripped(_, Cause::OverTemperature, _) => OVER_TEMPERATURE,
            Self::TripCleared(..) => TRIP_CLEARED,
            Self::Cooled(_) => COOLED,
            Self::PowerModuleFault { .. } => POWER_MODULE_FAULT,
            Self::PowerModuleRecovered => POWER_MODULE_RECOVERED,
            Self::PowerLost => code::POWER_LOST,
            Self::Reset { .. } => code::FIRMWARE_RESET,
            Self::Started => code::STARTED,
            Self::Operated(_) => code::OPERATED,
            Self::ReplyDropped => REPLY_DROPPED,
        }
    }

    fn link(&self) -> Option<usize> {
        self.bytes().map(|_| 0)
    }

    fn bytes(&self) -> Option<Cow<'_, [u8]>> {
        match self {
            Self::Request { frame, .. }
            | Self::Reply { frame, .. }
            | Self::Refused { frame, .. }
            | Self::BadValue { frame, .. }
            | Self::BadStream(
                Decoded::Frame(frame)
                | Decoded::Wrong(frame)
                | Decoded::Partial(frame)
                | Decoded::Noise(frame),
            ) => Some(frame.into()),
            _ => None,
        }
    }

    fn message(&self) -> Option<(&'static MessageInfo, Cow<'_, [u8]>)> {
        let (info, frame) = match self {
            Self::Request { request, frame } => (request.info(), frame),
            Self::Reply { reply, frame } => (reply.info(), frame),
            _ => return None,
        };
        Some((info, codec::parts(frame)?.1.into()))
    }

    fn is_client_error(&self) -> bool {
        let idle = matches!(self, Self::WatchdogFired { driving: false, .. });
        self.code().may_be_client_error() && !idle
    }
}

impl fmt::Display for R150Event {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Request { request, .. } => write!(f, "{request}"),
            Self::Reply { reply, .. } => write!(f, "{reply}"),
            Self::BadStream(Decoded::Wrong(bytes)) => {
                let [low, high] = codec::expected(bytes).to_le_bytes();
                write!(
                    f,
                    "CRC error: the frame {} should end in {low:02X} {high:02X}; nothing changed",
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
            Self::BadValue { error, .. } => write!(f, "{error}"),
            Self::OverRate { commands } => write!(
                f,
                "{commands} motor commands within a second, which are more than can be answered"
            ),
            Self::AppInControl(command) => {
                let name = name(*command).unwrap_or("?");
                write!(f, "0x{command:02X} {name} refused: the app holds control")
            }
            Self::NotDriving(obstacles) => {
                let words: Vec<&str> = obstacles.iter().map(|o| o.as_str()).collect();
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
            Self::ControlTaken(Parts { power, pwm }) => {
                let parts = match (power, pwm) {
                    (true, true) => "power and PWM",
                    (true, false) => "power",
                    _ => "PWM",
                };
                write!(f, "the client took control of {parts} (RS232 mode)")
            }
            Self::HeartbeatLost => {
                write!(
                    f,
                    "heartbeat lost: no valid frame in time, control went back to the app"
                )
            }
            Self::Tripped(group, cause, ProtectionAction::SwitchOff) => {
                write!(f, "{group}: {cause}; its outputs are off")
            }
            Self::Tripped(group, cause, ProtectionAction::Report) => {
                write!(f, "{group}: {cause}; its outputs stay as they are")
            }
            Self::TripCleared(group, ProtectionAction::SwitchOff) => {
                write!(f, "{group} may be switched on again")
            }
            Self::TripCleared(group, ProtectionAction::Report) => {
                write!(f, "{group} is within its limits again")
            }
            Self::Cooled(group) => write!(f, "{group} has cooled down"),
            Self::PowerModuleFault { supply_v, action } => {
                let outputs = match action {
                    ProtectionAction::SwitchOff => "all outputs are off",
                    ProtectionAction::Report => "the outputs stay as they are",
                };
                write!(f, "power module fault at {supply_v:.1} V supply; {outputs}")
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

impl fmt::Display for ValueError {
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
