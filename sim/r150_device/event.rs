//! Events in the R150 that a developer wants to know of.

use std::time::Duration;

use super::command::{Refusal, Reply, Request};
use super::control::{POWER_BITS, Parts};
use super::group::{Cause, Group};
use super::settings::ProtectionAction;
use super::vehicle::{Obstacle, OperatorInput};
use crate::scanner::Decoded;

/// Something that happened in the module or the vehicle.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum R150Event {
    /// A request was understood.
    Request {
        /// Request in it.
        request: Request,
        /// As received.
        frame: Vec<u8>,
    },
    /// A reply began its way to the client.
    Reply {
        /// Reply in it.
        reply: Reply,
        /// As sent.
        frame: Vec<u8>,
    },
    /// The stream held something that is no valid frame.
    BadStream(Decoded),
    /// A frame with the right CRC is no request.
    Refused {
        /// Reason.
        refusal: Refusal,
        /// As received.
        frame: Vec<u8>,
    },
    /// A request has a value that the manual does not allow.
    BadValue {
        /// Error.
        error: ValueError,
        /// As received.
        frame: Vec<u8>,
    },
    /// Motor commands came faster than they can be answered, over a second.
    OverRate {
        /// Number of commands that came within that second.
        commands: usize,
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
        /// Set if that set-point was moving the vehicle.
        driving: bool,
    },
    /// The client took control.
    ControlTaken(Parts),
    /// The heartbeat stopped; control went back to the app.
    HeartbeatLost,
    /// A protection switched a group of outputs off, or reports it only.
    Tripped(Group, Cause, ProtectionAction),
    /// A group that was switched off may be switched on again, or an overload that was reported
    /// only has ended.
    TripCleared(Group, ProtectionAction),
    /// An over-temperature report ended.
    Cooled(Group),
    /// The supply is too low, or the module is faulty.
    PowerModuleFault {
        /// Supply voltage in V.
        supply_v: f64,
        /// Action on the outputs: all off, or none.
        action: ProtectionAction,
    },
    /// That report ended.
    PowerModuleRecovered,
    /// The module lost its supply.
    PowerLost,
    /// The firmware restarts by itself.
    Reset {
        /// Time that it takes.
        boot: Duration,
    },
    /// The module has started.
    Started,
    /// An operator pressed a button.
    Operated(OperatorInput),
    /// Replies were dropped because too many waited.
    ReplyDropped,
}

/// A value that the manual does not allow; the settings say what becomes of it.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum ValueError {
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

impl ValueError {
    /// Finds the error in the values of a request, if there is any.
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
            Request::PowerControl { on } if on & !u32::from(POWER_BITS) != 0 => {
                Some(Self::ReservedBits(on & !u32::from(POWER_BITS)))
            }
            _ => None,
        }
    }
}
