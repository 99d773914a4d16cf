//! The commands of the R150 IO module and their replies (manual section 4.3), each declared once.
//!
//! All multi-byte fields are little-endian (manual section 4.1).

use std::borrow::Cow;

use rigsim_physics::r150::Rail;
use serde::{Deserialize, Deserializer};

use super::codec;
use crate::message::{Message, MessageInfo};

/// Declares the commands of the module with their replies.
///
/// Requests without fields take any parameters, as the manual writes them with `xx`. A command
/// without its own reply is answered by success or failure.
macro_rules! commands {
    ($(
        $(#[doc = $text:literal])+
        $variant:ident = $id:literal $name:literal $(, $key:ident $value:literal)*
        $({ $($fields:tt)* })?
        $(->
            $(#[doc = $reply_text:literal])+
            $reply:ident $(, $reply_key:ident $reply_value:literal)* { $($reply_fields:tt)* }
        )?;
    )+) => {
        crate::messages! {
            /// Request of a client to the module.
            pub enum Request, Client, link 0 { $(
                $(#[doc = $text])+
                $variant = $id $name $(, $key $value)* $({ $($fields)* })?;
            )+ }
        }

        $($( crate::messages! {
            $(#[doc = $reply_text])+
            pub struct $reply = $id $name, Device, link 0 $(, $reply_key $reply_value)* {
                $($reply_fields)*
            }
        } )?)+

        /// Reply of the module.
        #[derive(Debug, Clone, Copy, PartialEq, Eq)]
        #[non_exhaustive]
        pub enum Reply {
            /// To every command without its own reply, and to those that are refused.
            Bool {
                /// The command answered.
                command: u8,
                /// 1 success, 0 failure.
                success: bool,
            },
            $($( #[doc = concat!("To ", $name, ".")] $reply($reply), )?)+
        }

        /// Replies by command.
        pub static REPLIES: &[MessageInfo] = &[$( commands!(@reply $id $name $(, $reply)?) ),+];

        /// Command bytes.
        #[expect(non_upper_case_globals, reason = "they are named as their commands")]
        pub mod code { $(
            #[doc = concat!("Byte of ", $name, ".")]
            pub const $variant: u8 = $id;
        )+ }

        /// What the words of a command and of its reply begin with.
        pub(super) fn label(command: u8) -> Cow<'static, str> {
            match command {
                $( $id => concat!(stringify!($id), " ", $name).into(), )+
                _ => format!("0x{command:02X} ?").into(),
            }
        }

        impl Reply {
            /// The command byte, that of the request.
            #[must_use]
            pub fn command(&self) -> u8 {
                match self {
                    Self::Bool { command, .. } => *command,
                    $($( Self::$reply(_) => commands!(@id $id $reply), )?)+
                }
            }

            /// The parameter bytes.
            #[must_use]
            pub fn parameters(&self) -> Vec<u8> {
                match self {
                    Self::Bool { success, .. } => Success { success: *success }.payload(),
                    $($( Self::$reply(reply) => reply.payload(), )?)+
                }
            }
        }
    };
    (@reply $id:literal $name:literal) => {
        MessageInfo { id: $id, name: $name, ..SUCCESS }
    };
    (@reply $id:literal $name:literal, $reply:ident) => {
        <$reply as Message>::INFOS[0]
    };
    (@id $id:literal $reply:ident) => { $id };
}

crate::messages! {
    /// Success or failure of a command.
    pub struct Success = 0 "success", Device, link 0 {
        /// Success; failure otherwise.
        success: bool, flags &[("reported.success", "the last answer to a command was success")];
    }
}

const SUCCESS: MessageInfo = Success::INFOS[0];

/// Declares something of each rail, by its bit (4.3.1); the other bits are reserved.
macro_rules! each_rail {
    ($declare:ident) => {
        $declare! {
            V12A "v12a" "the 12 V output A";
            V12B "v12b" "the 12 V output B";
            V12C "v12c" "the 12 V output C";
            V12D "v12d" "the 12 V output D";
            V48 "v48" "the 48 V output";
            V5 "v5" "the 5 V output";
        }
    };
}
pub(crate) use each_rail;

macro_rules! rail_names {
    ($($rail:ident $name:literal $output:literal;)+) => {
        const RAILS: &[&str] = &[$(Rail::$rail.as_str()),+];
        const ASKED: &[(&str, &str)] = &[$(
            (concat!("client.asked_", $name), concat!($output, " was asked for")),
        )+];
        const REPORTED_ON: &[(&str, &str)] = &[$(
            (concat!("reported.", $name, "_on"), concat!($output, " is on, by the last reply")),
        )+];
        // The 12 V outputs are the first four; no reply has the current of the 5 V outputs.
        const CURRENTS: &[&str] = &[$(concat!("reported.", $name, "_a")),+];
    };
}
each_rail!(rail_names);

/// Declares something of each bit of `sysStatus` (manual section 4.3.5), the lowest first.
macro_rules! each_status_bit {
    ($declare:ident) => {
        $declare! {
            0 OVERCURRENT_AB "overcurrent_ab" "overcurrent of the 12 V outputs A and B is latched";
            1 OVERCURRENT_CD "overcurrent_cd" "overcurrent of the 12 V outputs C and D is latched";
            2 OVERCURRENT_48V "overcurrent_48v" "overcurrent of the 48 V output is latched";
            3 OVERCURRENT_5V "overcurrent_5v" "overcurrent of the 5 V outputs is latched";
            4 OVER_TEMPERATURE_AB "over_temperature_ab" "the 12 V supply of A and B is too hot";
            5 OVER_TEMPERATURE_CD "over_temperature_cd" "the 12 V supply of C and D is too hot";
            6 POWER_MODULE_FAULT "power_module_fault" "the power module reports a fault";
        }
    };
}
pub(crate) use each_status_bit;

macro_rules! status_bits {
    ($($bit:literal $constant:ident $name:literal $text:literal;)+) => {
        /// Bits of `sysStatus`.
        pub mod sys_status {
            $(
                #[doc = concat!("Set if ", $text, ".")]
                pub const $constant: u32 = 1 << $bit;
            )+
            /// Their names, the lowest bit first.
            pub(super) const NAMES: &[&str] = &[$($name),+];
            pub(super) const REPORTED: &[(&str, &str)] = &[$(
                (concat!("reported.", $name), concat!($text, ", by the last reply")),
            )+];
        }
    };
}
each_status_bit!(status_bits);

/// Outputs by their bits.
const OUTPUTS: &[&str] = &["a", "b", "c", "d"];
/// Who controls outputs.
const MODES: &[&str] = &["rs232", "app"];

commands! {
    /// Switches these rails on and the others off, 电源控制 (4.3.1).
    PowerControl = 0x02 "power_control" {
        /// Rails to switch on; the others go off. The manual names the field status.
        #[serde(deserialize_with = "rails")]
        #[schemars(with = "Vec<Rail>")]
        on: u32, bits RAILS, flags ASKED;
    };

    /// Sets the four PWM outputs, 四路 PWM 输出控制 (4.3.2).
    SetPwmOutputs = 0x03 "set_pwm_outputs" {
        /// Duty of A–D, 0–1000.
        duty: [u16; 4], unit "0.1 %",
            named &["client.pwm_a", "client.pwm_b", "client.pwm_c", "client.pwm_d"];
    };

    /// Asks for the duty of the four PWM outputs (4.3.3).
    GetPwmOutputs = 0x04 "get_pwm_outputs" ->
    /// Duty of the four PWM outputs (4.3.3).
    PwmOutputs {
        /// Duty of A–D.
        duty: [u16; 4], unit "0.1 %";
    };

    /// Asks for the four PWM inputs (4.3.4).
    GetPwmInputs = 0x05 "get_pwm_inputs" ->
    /// The four PWM inputs (4.3.4).
    PwmInputs {
        /// Frequency of A–D, 0 or 10–20000; the manual names it capPeriod.
        frequency_hz: [u32; 4], unit "Hz";
        /// Duty of A–D.
        duty: [u16; 4], unit "0.1 %";
    };

    /// Asks for system info, 系统信息 (4.3.5).
    SystemInfo = 0x06 "system_info" ->
    /// Supplies, rails, errors and modes (4.3.5).
    SystemInfo, length 76, age "reported.info_age_s" {
        /// Voltage of the 12 V outputs A–D.
        voltage_12v: [u32; 4], unit "V", per 1000;
        /// Voltage of the main supply.
        voltage_48v: u32, unit "V", per 1000, named &["reported.supply_v"];
        /// Current of the 12 V outputs A–D.
        current_12v: [i32; 4], unit "A", per 1000, named CURRENTS.split_at(4).0;
        /// Current of the 48 V output.
        current_48v: i32, unit "A", per 1000, named &[CURRENTS[4]];
        /// Temperature of the 12 V supplies AB and CD.
        temp_12v: [i32; 2], unit "degC", per 10,
            named &["reported.temperature_ab_c", "reported.temperature_cd_c"];
        /// Status bits of the protections and the power module.
        sys_status: u32, bits sys_status::NAMES, named &["reported.sys_status"],
            flags sys_status::REPORTED;
        /// Who controls the rails.
        power_ctrl_mode: u8, values MODES;
        /// Who controls the PWM outputs.
        pwm_ctrl_mode: u8, values MODES;
        /// Rails that are on.
        power_status: u8, bits RAILS, flags REPORTED_ON;
        /// PWM outputs whose duty is above 0.
        pwm_status: u8, bits OUTPUTS;
    };

    /// Says that the client is there, 心跳包 (4.3.6).
    Heartbeat = 0x07 "heartbeat";

    /// Asks for the versions, 版本号 (4.3.7).
    Version = 0xF0 "version" ->
    /// Versions (4.3.7); the most significant byte is the major one.
    Version {
        /// Hardware version word.
        hardware: u32, hex true;
        /// Software version word.
        software: u32, hex true;
    };

    /// Sets the motors' PWM, positive forward, 设置电机 PWM (4.3.8).
    SetMotors = 0x12 "set_motors", motion true {
        /// Right motor, −1000 to 1000.
        right: i16, unit "0.1 %", named &["client.motor_right"];
        /// Left motor, −1000 to 1000.
        left: i16, unit "0.1 %", named &["client.motor_left"];
    } ->
    /// Speeds of the motors' shafts, and the charge (4.3.8).
    Motors, length 8, age "reported.motors_age_s" {
        /// Speed of the right motor's shaft.
        right_rpm: i16, unit "r/min", named &["reported.right_rpm"];
        /// Speed of the left motor's shaft.
        left_rpm: i16, unit "r/min", named &["reported.left_rpm"];
        /// Remaining charge.
        soc: u16, unit "%", per 10, named &["reported.soc_percent"];
    };
}

/// Reads names of rails as bits.
pub(super) fn rails<'de, D: Deserializer<'de>, B: From<u8>>(
    deserializer: D,
) -> Result<B, D::Error> {
    let rails = Vec::<Rail>::deserialize(deserializer)?;
    let bits = rails.iter().fold(0, |bits, rail| bits | 1 << rail.index());
    Ok(B::from(bits))
}

/// The name of a command byte.
#[must_use]
pub fn name(command: u8) -> Option<&'static str> {
    Request::info_of(command).map(|info| info.name)
}

/// Reason for which a frame with a right CRC is not a request.
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
        let info = Self::info_of(command).ok_or(Refusal::UnknownCommand(command))?;
        let takes_any = info.fields.is_empty();
        let mut rest = if takes_any { &[] } else { parameters };
        let (wanted, found) = (info.length, rest.len());
        let fits = found == wanted;
        let read = fits.then(|| Self::take(command, &mut rest)).flatten();
        read.ok_or(Refusal::WrongLength {
            command,
            wanted,
            found,
        })
    }

    /// The command byte.
    #[must_use]
    pub fn command(&self) -> u8 {
        self.info().id
    }

    /// The whole frame as a client sends it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        codec::encode(self.command(), &self.payload())
    }
}

impl Reply {
    /// The declaration.
    #[must_use]
    pub fn info(&self) -> &'static MessageInfo {
        let is_bool = matches!(self, Self::Bool { .. });
        let known = REPLIES.iter().find(|info| info.id == self.command());
        // What is refused is answered by success or failure, whatever its reply is otherwise.
        known
            .filter(|info| !is_bool || info.fields == SUCCESS.fields)
            .unwrap_or(&Success::INFOS[0])
    }

    /// The whole frame as the module sends it.
    #[must_use]
    pub fn encode(&self) -> Vec<u8> {
        codec::encode(self.command(), &self.parameters())
    }
}
