//! The eight commands of the R150 IO module (manual section 4.3) as types; [`super::reply`] has
//! what it answers.
//!
//! All multi-byte fields are little-endian (manual section 4.1).

use super::codec;

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

/// The name of a command byte, as events and documentation use it.
#[must_use]
pub fn name(command: u8) -> Option<&'static str> {
    Some(match command {
        code::POWER_CONTROL => "power_control",
        code::SET_PWM_OUTPUTS => "set_pwm_outputs",
        code::GET_PWM_OUTPUTS => "get_pwm_outputs",
        code::GET_PWM_INPUTS => "get_pwm_inputs",
        code::SYSTEM_INFO => "system_info",
        code::HEARTBEAT => "heartbeat",
        code::VERSION => "version",
        code::SET_MOTORS => "set_motors",
        _ => return None,
    })
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

pub(super) fn four_u16(bytes: [u8; 8]) -> [u16; 4] {
    std::array::from_fn(|i| u16::from_le_bytes([bytes[2 * i], bytes[2 * i + 1]]))
}
