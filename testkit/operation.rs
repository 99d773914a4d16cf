//! One thing that a client, an operator, the hardware or the world does to a running rig.
//!
//! Numbers are taken modulo what there is, so that any value is an operation and a shorter sequence
//! stays a sequence: that is what lets proptest shrink and libFuzzer splice.

use std::time::Duration;

use sim_core::mecanum_device;
use sim_core::mecanum_device::kinematics::{Course, Movement};
use sim_core::mecanum_device::packet;
use sim_core::r150_device::codec::encode;
use sim_core::r150_device::command;
use sim_core::r150_device::control::Outputs;
use sim_core::r150_device::vehicle::{self, Key};

use crate::fault::FaultChoice;

/// Something that is done.
#[derive(Debug, Clone, PartialEq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Operation {
    /// A client sends.
    #[cfg_attr(feature = "proptest", proptest(weight = 6))]
    Send {
        /// On which port.
        port: u8,
        /// Message.
        message: Message,
    },
    /// Time passes.
    #[cfg_attr(feature = "proptest", proptest(weight = 5))]
    Wait(Wait),
    /// Time passes from event to event, so many times.
    Follow(u8),
    /// A client reads what has arrived.
    #[cfg_attr(feature = "proptest", proptest(weight = 2))]
    Read {
        /// On which port.
        port: u8,
    },
    /// A client opens a port.
    Attach {
        /// Index of the port.
        port: u8,
    },
    /// A client closes a port or dies.
    Detach {
        /// Index of the port.
        port: u8,
    },
    /// A client sets its end of the line.
    SetLine {
        /// On which port.
        port: u8,
        /// At which of some speeds; at the device's own if even.
        speed: u8,
        /// With two stop bits.
        two_stop_bits: bool,
        /// With echo and editing.
        cooked: bool,
    },
    /// Something breaks.
    #[cfg_attr(feature = "proptest", proptest(weight = 4))]
    Inject {
        /// On which device.
        device: u8,
        /// Under which of a few names.
        name: u8,
        /// Fault.
        fault: FaultChoice,
    },
    /// Something is mended.
    #[cfg_attr(feature = "proptest", proptest(weight = 2))]
    Clear {
        /// Index among those that were injected, mended already or not.
        which: u8,
    },
    /// An operator works a button.
    Operate {
        /// On which device.
        device: u8,
        /// Index of the button.
        button: u8,
    },
    /// Somebody lays hands on a vehicle.
    Handle {
        /// Index of the device.
        device: u8,
        /// Deed.
        how: Hands,
    },
    /// An obstacle appears.
    Obstacle {
        /// Place, dm; vehicles may be there.
        at: [i8; 2],
        /// Size, cm.
        size: u8,
    },
    /// The ground becomes slippery, or less so, in percent.
    Ground(u8),
    /// The machine that runs the simulator is late.
    Late {
        /// By how much, ms.
        by: u8,
        /// Time by which commands may come too soon by that, ms.
        rest: u8,
    },
}

/// Time that passes.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Wait {
    /// In the order of a bit.
    Nanoseconds(u16),
    /// In the order of a byte or a frame.
    Microseconds(u16),
    /// In the order of a step of the physics and of the timeouts.
    Milliseconds(u8),
    /// In the order of the watchdogs.
    Tenths(u8),
    /// Up to a time at which something is due, and so much before or after it, ns.
    UntilDue(i8),
}

impl Wait {
    /// Length, when something is due in `due`.
    #[must_use]
    pub fn span(self, due: Duration) -> Duration {
        match self {
            Self::Nanoseconds(count) => Duration::from_nanos(count.into()),
            Self::Microseconds(count) => Duration::from_micros(count.into()),
            Self::Milliseconds(count) => Duration::from_millis(count.into()),
            Self::Tenths(count) => Duration::from_millis(100 * u64::from(count)),
            Self::UntilDue(off) if off < 0 => {
                due.saturating_sub(Duration::from_nanos(off.unsigned_abs().into()))
            }
            Self::UntilDue(off) => due + Duration::from_nanos(off.unsigned_abs().into()),
        }
    }
}

/// Message of a client.
#[derive(Debug, Clone, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Message {
    /// Both motors of an R150.
    #[cfg_attr(feature = "proptest", proptest(weight = 3))]
    Motors {
        /// 0.1 %.
        right: i16,
        /// 0.1 %.
        left: i16,
    },
    /// The rails of an R150.
    Power(u32),
    /// A whole frame of an R150, of any command.
    #[cfg_attr(feature = "proptest", proptest(weight = 2))]
    Frame {
        /// Command, or none of them.
        command: u8,
        /// Their lengths are right or wrong.
        parameters: Vec<u8>,
    },
    /// A motion packet of the car.
    #[cfg_attr(feature = "proptest", proptest(weight = 3))]
    Motion {
        /// Preempts if odd.
        is_reset: u8,
        /// Five of them are motions.
        moving_idx: u8,
        /// 1/10 revolution.
        s: u16,
        /// 1/10 r/min.
        v: i16,
    },
    /// A set-pose packet of the car.
    SetPose([i16; 3]),
    /// A control-mode packet of the car.
    ControlMode(u8),
    /// A line of the ROS link.
    #[cfg_attr(feature = "proptest", proptest(weight = 2))]
    Line {
        /// One of the five letters, or none of them.
        letter: u8,
        /// Within the range and beyond.
        number: i32,
    },
    /// The beginning of something else that is sent.
    Torn {
        /// Length of it.
        length: u8,
        /// Of a frame, a packet or a line.
        of: u8,
    },
    /// Any bytes.
    Bytes(Vec<u8>),
    /// One byte over and over, up to what the line holds and more.
    Flood {
        /// Index of the byte.
        byte: u8,
        /// Times 20.
        count: u8,
    },
}

/// Most bytes of one message.
const MOST_BYTES: usize = 300;

impl Message {
    /// On the wire.
    #[must_use]
    pub fn bytes(&self) -> Vec<u8> {
        match self {
            Self::Motors { right, left } => command::Request::SetMotors {
                right: *right,
                left: *left,
            }
            .encode(),
            Self::Power(status) => command::Request::PowerControl { status: *status }.encode(),
            Self::Frame {
                command,
                parameters,
            } => {
                let commands = [2, 3, 4, 5, 6, 7, 0x12, 0xF0, *command];
                let command = commands[usize::from(*command) % commands.len()];
                encode(command, &parameters[..parameters.len().min(255)])
            }
            Self::Motion {
                is_reset,
                moving_idx,
                s,
                v,
            } => packet::Request::Motion {
                seq: 0,
                is_reset: is_reset % 3,
                moving_idx: moving_idx % 6,
                s: *s,
                v: *v,
            }
            .encode(),
            Self::SetPose([axis_x, axis_y, ori]) => packet::Request::SetPose {
                seq: 0,
                axis_x: *axis_x,
                axis_y: *axis_y,
                ori: *ori,
            }
            .encode(),
            Self::ControlMode(mode) => packet::Request::ControlMode {
                seq: 0,
                mode: mode % 3,
            }
            .encode(),
            Self::Line { letter, number } => {
                let letter = char::from(b"XYZABQ"[usize::from(*letter) % 6]);
                format!("{letter}{} \n", number % 40_000).into_bytes()
            }
            Self::Torn { length, of } => {
                let whole = match of % 3 {
                    0 => encode(0x06, &[0xAA; 40]),
                    1 => vec![1, 9, 0, 0, 9, 0, 2, 4, 0],
                    _ => b"X-32768 \n".to_vec(),
                };
                whole[..usize::from(*length) % (whole.len() + 1)].to_vec()
            }
            Self::Bytes(bytes) => bytes[..bytes.len().min(MOST_BYTES)].to_vec(),
            Self::Flood { byte, count } => vec![*byte; 20 * usize::from(*count)],
        }
    }
}

/// Deed of somebody's hands to a vehicle. The numbers stay in the ranges of scenario files.
#[derive(Debug, Clone, Copy, PartialEq, Eq, arbitrary::Arbitrary)]
#[cfg_attr(feature = "proptest", derive(proptest_derive::Arbitrary))]
pub enum Hands {
    /// Leans on it: ahead and left in units of 3 N, and around in units of 3 N·m.
    Push([i16; 3]),
    /// Loads it, kg.
    Payload(u8),
    /// Puts it somewhere: x and y in dm, and heading in 1/100 rad.
    Place([i16; 3]),
    /// Wires a load to one of an R150's rails, W.
    Load {
        /// Index of the rail.
        rail: u8,
        /// Power.
        watts: u16,
    },
}

/// The button of an R150.
#[must_use]
pub fn r150_button(button: u8) -> vehicle::OperatorInput {
    use vehicle::OperatorInput;
    let detail = button / 16;
    match button % 16 {
        0 => OperatorInput::Unlock,
        1 => OperatorInput::Lock,
        2 => OperatorInput::ReleaseParking,
        3 => OperatorInput::Park,
        4 | 5 => OperatorInput::Autonomous,
        6 => OperatorInput::Press(Key::Forward),
        7 => OperatorInput::Press(Key::Backward),
        8 => OperatorInput::Press(Key::Left),
        9 => OperatorInput::Press(Key::Right),
        10 => OperatorInput::ReleaseKey,
        11 => OperatorInput::EmergencyStop(true),
        12 | 13 => OperatorInput::EmergencyStop(false),
        14 => OperatorInput::AppHolds {
            power: detail & 1 == 1,
            pwm: detail & 2 == 2,
        },
        _ => OperatorInput::AppSets(Outputs {
            power: detail * 5,
            pwm: [u16::from(detail) * 70; 4],
        }),
    }
}

/// The key of a car's remote control.
#[must_use]
pub fn car_key(button: u8) -> mecanum_device::OperatorInput {
    match Course::from_index(button % 6) {
        Some(course) => mecanum_device::OperatorInput::Press(Movement {
            course,
            negative: button >= 128,
        }),
        None => mecanum_device::OperatorInput::Release,
    }
}
