//! Events of an R150 that a developer wants to know of.

use super::codec;
use super::command::{Request, label};
use super::control::POWER_BITS;
use crate::event::{Code, EventKind, Hex, code};
use crate::message::MessageInfo;
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
    OVER_RATE = "over_rate", Warning, ClientUnlessLatelyDisturbed;
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
    /// The power module no longer reports a fault.
    POWER_MODULE_RECOVERED = "power_module_recovered", Notice, NoParty;
    /// Too many replies waited.
    REPLY_DROPPED = "reply_dropped", Warning, NoParty;
    /// A fuse blew.
    FUSE_BLOWN = "fuse_blown", Damage, NoParty;
    /// A motor driver allows less current, or none, because of heat.
    MOTOR_HOT = "motor_hot", Damage, NoParty;
    /// A motor driver allows its full current again.
    MOTOR_COOLED = "motor_cooled", Notice, NoParty;
}

/// A request or reply, in a frame.
pub(crate) fn passed(
    code: Code,
    command: u8,
    message: &'static MessageInfo,
    frame: Vec<u8>,
) -> EventKind {
    let fields = codec::parts(&frame).map_or_else(Vec::new, |(_, fields)| fields.to_vec());
    EventKind::new(code, label(command)).saying(message, fields, frame)
}

/// The stream held something that is not a valid frame.
pub(super) fn bad_stream(found: Decoded) -> EventKind {
    match found {
        Decoded::Wrong(frame) => {
            let [low, high] = codec::expected(&frame).to_le_bytes();
            let text = format!(
                "CRC error: the frame {} should end in {low:02X} {high:02X}; nothing changed",
                Hex(&frame)
            );
            EventKind::new(BAD_CRC, text).with(0, frame)
        }
        Decoded::Partial(bytes) => {
            let text = "incomplete frame dropped after a pause:";
            EventKind::new(PARTIAL_FRAME, text).showing(0, bytes)
        }
        Decoded::Noise(bytes) | Decoded::Frame(bytes) => {
            EventKind::new(code::NOISE, "bytes outside any frame:").showing(0, bytes)
        }
    }
}

/// Finds a value in a request that the manual does not allow; the settings say what becomes of it.
pub(super) fn bad_value(request: Request) -> Option<(Code, String)> {
    let reserved = !u32::from(POWER_BITS);
    Some(match request {
        Request::SetPwmOutputs { duty } if duty.iter().any(|duty| *duty > 1000) => (
            DUTY_OUT_OF_RANGE,
            format!("PWM duty {duty:?} out of range: 0 to 1000 is allowed"),
        ),
        Request::SetMotors { right, left }
            if right.unsigned_abs() > 1000 || left.unsigned_abs() > 1000 =>
        {
            let text = format!(
                "motor PWM right {right} left {left} out of range: -1000 to 1000 is allowed"
            );
            (MOTORS_OUT_OF_RANGE, text)
        }
        Request::PowerControl { on } if on & reserved != 0 => (
            RESERVED_BITS,
            format!("reserved power bits 0x{:08X} are set", on & reserved),
        ),
        _ => return None,
    })
}
