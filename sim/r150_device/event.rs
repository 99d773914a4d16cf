//! What happens in the R150 that a developer wants to know.

use std::time::Duration;

use super::codec::Decoded;
use super::command::{Refusal, Request};
use super::control::{POWER_BITS, Parts};
use super::protection::{Cause, Group};
use super::reply::Reply;
use super::settings::ProtectionAction;
use super::vehicle::{Action, Obstacle};

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
        error: ValueError,
        /// As received.
        frame: Vec<u8>,
    },
    /// Motor commands came faster than they can be answered, over a second.
    OverRate {
        /// How many came within that second.
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
        /// Whether that set-point was moving the vehicle.
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
        /// Whether it switched all outputs off.
        action: ProtectionAction,
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
