//! Replies of the R150 IO module (manual section 4.3) as types.

use super::codec;
use super::command::{Refusal, code, four_u16};

/// The 76 bytes of the system info reply (manual section 4.3.5).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct SystemInfo {
    /// Voltage of the 12 V outputs A–D, mV.
    pub voltage_12v: [u32; 4],
    /// Voltage of the main supply, mV.
    pub voltage_48v: u32,
    /// Current of the 12 V outputs A–D, mA.
    pub current_12v: [i32; 4],
    /// Current of the 48 V output, mA.
    pub current_48v: i32,
    /// Temperature of the 12 V supplies AB and CD, 0.1 °C.
    pub temp_12v: [i32; 2],
    /// Bits of `sysStatus`, see [`sys_status`].
    pub sys_status: u32,
    /// 0 RS232, 1 app.
    pub power_ctrl_mode: u8,
    /// 0 RS232, 1 app.
    pub pwm_ctrl_mode: u8,
    /// One bit a rail, as in the request 0x02.
    pub power_status: u8,
    /// Bits 0–3: the duty of output A–D is above 0.
    pub pwm_status: u8,
}

/// Bits of `sysStatus` (manual section 4.3.5).
pub mod sys_status {
    /// Overcurrent of the 12 V outputs A and B.
    pub const OVERCURRENT_AB: u32 = 1;
    /// Overcurrent of the 12 V outputs C and D.
    pub const OVERCURRENT_CD: u32 = 1 << 1;
    /// Overcurrent of the 48 V output.
    pub const OVERCURRENT_48V: u32 = 1 << 2;
    /// Overcurrent of the 5 V outputs.
    pub const OVERCURRENT_5V: u32 = 1 << 3;
    /// Over-temperature of the 12 V supply AB.
    pub const OVER_TEMPERATURE_AB: u32 = 1 << 4;
    /// Over-temperature of the 12 V supply CD.
    pub const OVER_TEMPERATURE_CD: u32 = 1 << 5;
    /// Power module fault.
    pub const POWER_MODULE_FAULT: u32 = 1 << 6;
}

impl SystemInfo {
    /// Parameter bytes of the reply.
    pub const LENGTH: usize = 76;

    fn to_bytes(self) -> Vec<u8> {
        let mut bytes = Vec::with_capacity(Self::LENGTH);
        bytes.extend(self.voltage_12v.map(u32::to_le_bytes).concat());
        bytes.extend(self.voltage_48v.to_le_bytes());
        bytes.extend(self.current_12v.map(i32::to_le_bytes).concat());
        bytes.extend(self.current_48v.to_le_bytes());
        bytes.extend(self.temp_12v.map(i32::to_le_bytes).concat());
        bytes.extend(self.sys_status.to_le_bytes());
        bytes.extend([
            self.power_ctrl_mode,
            self.pwm_ctrl_mode,
            self.power_status,
            self.pwm_status,
        ]);
        bytes.resize(Self::LENGTH, 0);
        bytes
    }

    fn from_bytes(bytes: &[u8; Self::LENGTH]) -> Self {
        let word = |index: usize| {
            let at = index * 4;
            u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
        };
        let signed = |index| word(index).cast_signed();
        Self {
            voltage_12v: std::array::from_fn(word),
            voltage_48v: word(4),
            current_12v: std::array::from_fn(|i| signed(5 + i)),
            current_48v: signed(9),
            temp_12v: std::array::from_fn(|i| signed(10 + i)),
            sys_status: word(12),
            power_ctrl_mode: bytes[52],
            pwm_ctrl_mode: bytes[53],
            power_status: bytes[54],
            pwm_status: bytes[55],
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
