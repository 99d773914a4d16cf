//! The eight commands of the R150 IO module and their replies (manual section 4.3) as types, bytes
//! and words.
//!
//! All multi-byte fields are little-endian (manual section 4.1).

use std::fmt;

use super::codec;
use super::system_info::SystemInfo;

/// Command bytes.
pub mod code {
    /// Power control, 电源控制 (4.3.1).
    pub const POWER_CONTROL: u8 = 0x02;
    /// Set the four PWM outputs, 四路 PWM 输出控制 (4.3.2).
    pub const SET_PWM_OUTPUTS: u8 = 0x03;
    /// Get the four PWM outputs' duty (4.3.3).
    pub const GET_PWM_OUTPUTS: u8 = 0x04;
    /// Get the four PWM inputs (4.3.4).
    pub const GET_PWM_INPUTS: u8 = 0x05;
    /// System info, 系统信息 (4.3.5).
    pub const SYSTEM_INFO: u8 = 0x06;
    /// Heartbeat, 心跳包 (4.3.6).
    pub const HEARTBEAT: u8 = 0x07;
    /// Version, 版本号 (4.3.7).
    pub const VERSION: u8 = 0xF0;
    /// Set motor PWM, 设置电机 PWM (4.3.8).
    pub const SET_MOTORS: u8 = 0x12;
}

/// All command bytes and their names, as events and documentation use them.
pub const COMMANDS: [(u8, &str); 8] = [
    (code::POWER_CONTROL, "power_control"),
    (code::SET_PWM_OUTPUTS, "set_pwm_outputs"),
    (code::GET_PWM_OUTPUTS, "get_pwm_outputs"),
    (code::GET_PWM_INPUTS, "get_pwm_inputs"),
    (code::SYSTEM_INFO, "system_info"),
    (code::HEARTBEAT, "heartbeat"),
    (code::VERSION, "version"),
    (code::SET_MOTORS, "set_motors"),
];

/// The name of a command byte.
#[must_use]
pub fn name(command: u8) -> Option<&'static str> {
    let mut known = COMMANDS.iter();
    known
        .find(|(byte, _)| *byte == command)
        .map(|(_, name)| *name)
}

/// Request of a client to the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Request {
    /// 0x02: switch the rails on whose bits are set and the others off; bits 0–3 are 12 V A–D,
    /// 4 is 48 V, 5 is 5 V, the rest is reserved.
    PowerControl {
        /// One bit a rail.
        status: u32,
    },
    /// 0x03: duty of outputs A–D in 0.1 %, 0–1000.
    SetPwmOutputs {
        /// Duty in 0.1 %.
        duty: [u16; 4],
    },
    /// 0x04.
    GetPwmOutputs,
    /// 0x05.
    GetPwmInputs,
    /// 0x06.
    SystemInfo,
    /// 0x07.
    Heartbeat,
    /// 0xF0.
    Version,
    /// 0x12: motor PWM in 0.1 %, −1000 to 1000, positive forward.
    SetMotors {
        /// Right motor.
        right: i16,
        /// Left motor.
        left: i16,
    },
}

/// Reason for which a frame with a right CRC is no request.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Refusal {
    /// No command has this byte.
    UnknownCommand(u8),
    /// The command takes another number of parameter bytes.
    WrongLength {
        /// Command byte.
        command: u8,
        /// Parameter bytes it takes.
        wanted: usize,
        /// Parameter bytes it got.
        found: usize,
    },
}

impl Request {
    /// Reads a frame's command and parameters.
    ///
    /// Requests that the manual writes as `xx` take any parameters, including none.
    ///
    /// # Errors
    /// An unknown command or a length that the command does not allow.
    pub fn parse(command: u8, parameters: &[u8]) -> Result<Self, Refusal> {
        let wrong = |wanted| Refusal::WrongLength {
            command,
            wanted,
            found: parameters.len(),
        };
        Ok(match command {
            code::POWER_CONTROL => {
                let bytes = parameters.try_into().map_err(|_| wrong(4))?;
                Self::PowerControl {
                    status: u32::from_le_bytes(bytes),
                }
            }
            code::SET_PWM_OUTPUTS => {
                let bytes: [u8; 8] = parameters.try_into().map_err(|_| wrong(8))?;
                Self::SetPwmOutputs {
                    duty: four_u16(bytes),
                }
            }
            code::SET_MOTORS => {
                let [r0, r1, l0, l1] = parameters.try_into().map_err(|_| wrong(4))?;
                Self::SetMotors {
                    right: i16::from_le_bytes([r0, r1]),
                    left: i16::from_le_bytes([l0, l1]),
                }
            }
            code::GET_PWM_OUTPUTS => Self::GetPwmOutputs,
            code::GET_PWM_INPUTS => Self::GetPwmInputs,
            code::SYSTEM_INFO => Self::SystemInfo,
            code::HEARTBEAT => Self::Heartbeat,
            code::VERSION => Self::Version,
            other => return Err(Refusal::UnknownCommand(other)),
        })
    }

    /// The command byte.
    #[must_use]
    pub fn command(&self) -> u8 {
        match self {
            Self::PowerControl { .. } => code::POWER_CONTROL,
            Self::SetPwmOutputs { .. } => code::SET_PWM_OUTPUTS,
            Self::GetPwmOutputs => code::GET_PWM_OUTPUTS,
            Self::GetPwmInputs => code::GET_PWM_INPUTS,
            Self::SystemInfo => code::SYSTEM_INFO,
            Self::Heartbeat => code::HEARTBEAT,
            Self::Version => code::VERSION,
            Self::SetMotors { .. } => code::SET_MOTORS,
        }
    }

    /// The whole frame as a client sends it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        let mut parameters = Vec::new();
        match self {
            Self::PowerControl { status } => parameters.extend(status.to_le_bytes()),
            Self::SetPwmOutputs { duty } => parameters.extend(duty.map(u16::to_le_bytes).concat()),
            Self::SetMotors { right, left } => {
                parameters.extend([right.to_le_bytes(), left.to_le_bytes()].concat());
            }
            _ => {}
        }
        codec::encode(self.command(), &parameters)
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

/// Reply of the module.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
#[non_exhaustive]
pub enum Reply {
    /// To 0x02, 0x03 and 0x07: success or failure.
    Bool {
        /// The command answered.
        command: u8,
        /// 1 success, 0 failure.
        success: bool,
    },
    /// To 0x04.
    PwmOutputs {
        /// Duty of A–D, 0.1 %.
        duty: [u16; 4],
    },
    /// To 0x05.
    PwmInputs {
        /// Frequency of A–D in Hz, 0 or 10–20000; the manual names it capPeriod.
        frequency_hz: [u32; 4],
        /// Duty of A–D, 0.1 %.
        duty: [u16; 4],
    },
    /// To 0x06.
    SystemInfo(SystemInfo),
    /// To 0xF0; the most significant byte is the major version.
    Version {
        /// Hardware version word.
        hardware: u32,
        /// Software version word.
        software: u32,
    },
    /// To 0x12.
    Motors {
        /// Speed of the right motor's shaft, r/min.
        right_rpm: i16,
        /// Speed of the left motor's shaft, r/min.
        left_rpm: i16,
        /// Remaining charge, 0.1 %.
        soc: u16,
    },
}

impl Reply {
    /// The command byte, that of the request.
    #[must_use]
    pub fn command(&self) -> u8 {
        match self {
            Self::Bool { command, .. } => *command,
            Self::PwmOutputs { .. } => code::GET_PWM_OUTPUTS,
            Self::PwmInputs { .. } => code::GET_PWM_INPUTS,
            Self::SystemInfo(_) => code::SYSTEM_INFO,
            Self::Version { .. } => code::VERSION,
            Self::Motors { .. } => code::SET_MOTORS,
        }
    }

    /// The whole frame as the module sends it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        codec::encode(self.command(), &self.parameters())
    }

    /// The parameter bytes.
    #[must_use]
    pub fn parameters(&self) -> Vec<u8> {
        match self {
            Self::Bool { success, .. } => vec![u8::from(*success)],
            Self::PwmOutputs { duty } => duty.map(u16::to_le_bytes).concat(),
            Self::PwmInputs { frequency_hz, duty } => {
                let mut bytes = frequency_hz.map(u32::to_le_bytes).concat();
                bytes.extend(duty.map(u16::to_le_bytes).concat());
                bytes
            }
            Self::SystemInfo(info) => info.to_bytes(),
            Self::Version { hardware, software } => {
                [hardware.to_le_bytes(), software.to_le_bytes()].concat()
            }
            Self::Motors {
                right_rpm,
                left_rpm,
                soc,
            } => {
                let mut bytes = [right_rpm.to_le_bytes(), left_rpm.to_le_bytes()].concat();
                bytes.extend(soc.to_le_bytes());
                bytes.extend([0; 2]);
                bytes
            }
        }
    }

    /// Reads a reply's command and parameters, as a client does.
    ///
    /// # Errors
    /// An unknown command or a length that its reply does not have.
    pub fn parse(command: u8, parameters: &[u8]) -> Result<Self, Refusal> {
        let wrong = |wanted| Refusal::WrongLength {
            command,
            wanted,
            found: parameters.len(),
        };
        Ok(match command {
            code::POWER_CONTROL | code::SET_PWM_OUTPUTS | code::HEARTBEAT => {
                let [byte] = parameters.try_into().map_err(|_| wrong(1))?;
                Self::Bool {
                    command,
                    success: byte != 0,
                }
            }
            code::GET_PWM_OUTPUTS => {
                let bytes = parameters.try_into().map_err(|_| wrong(8))?;
                Self::PwmOutputs {
                    duty: four_u16(bytes),
                }
            }
            code::GET_PWM_INPUTS => {
                let bytes: &[u8; 24] = parameters.try_into().map_err(|_| wrong(24))?;
                let (words, halves) = bytes.split_at(16);
                let frequency_hz = std::array::from_fn(|i| {
                    let at = i * 4;
                    u32::from_le_bytes([words[at], words[at + 1], words[at + 2], words[at + 3]])
                });
                let halves = halves.try_into().map_err(|_| wrong(24))?;
                Self::PwmInputs {
                    frequency_hz,
                    duty: four_u16(halves),
                }
            }
            code::SYSTEM_INFO => {
                let wanted = SystemInfo::LENGTH;
                let bytes = parameters.try_into().map_err(|_| wrong(wanted))?;
                Self::SystemInfo(SystemInfo::from_bytes(bytes))
            }
            code::VERSION => {
                let [h0, h1, h2, h3, s0, s1, s2, s3] =
                    parameters.try_into().map_err(|_| wrong(8))?;
                Self::Version {
                    hardware: u32::from_le_bytes([h0, h1, h2, h3]),
                    software: u32::from_le_bytes([s0, s1, s2, s3]),
                }
            }
            code::SET_MOTORS => {
                let [r0, r1, l0, l1, s0, s1, _, _] = parameters.try_into().map_err(|_| wrong(8))?;
                Self::Motors {
                    right_rpm: i16::from_le_bytes([r0, r1]),
                    left_rpm: i16::from_le_bytes([l0, l1]),
                    soc: u16::from_le_bytes([s0, s1]),
                }
            }
            other => return Err(Refusal::UnknownCommand(other)),
        })
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

fn four_u16(bytes: [u8; 8]) -> [u16; 4] {
    std::array::from_fn(|i| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]))
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
