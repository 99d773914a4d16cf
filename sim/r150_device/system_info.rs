//! System info of the R150 IO module (manual section 4.3.5).

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

    pub(super) fn to_bytes(self) -> Vec<u8> {
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

    pub(super) fn from_bytes(bytes: &[u8; Self::LENGTH]) -> Self {
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
