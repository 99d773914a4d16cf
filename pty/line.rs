//! Line settings: what the client asked of the line, and how ours is prepared.

use std::fmt;

use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, LocalModes, OutputModes, SpecialCodeIndex, Termios,
};

/// The settings that a client gave its end of a pseudo-terminal.
///
/// A pseudo-terminal carries bytes whatever the settings are, so it is the
/// caller who compares them with the device's own and garbles the line where
/// a real one would.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineSettings {
    /// Bits per second, any value, not only the standard ones.
    pub baud: u32,
    /// Data bits. Linux forces a pseudo-terminal to 8.
    pub data_bits: u8,
    /// Parity. On a pseudo-terminal Linux strips even parity from the settings without a trace, and
    /// leaves one of odd parity.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
    /// Set if the client waits for CTS before it sends. A pseudo-terminal takes no notice.
    pub rts_cts: bool,
    /// Set if bytes pass untouched. A client that leaves this off has its
    /// input echoed, edited by line or translated, and loses binary data.
    pub raw: bool,
}

/// The parity bit of each byte.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Parity {
    /// No parity bit.
    None,
    /// An even number of ones.
    Even,
    /// An odd number of ones.
    Odd,
}

impl LineSettings {
    pub(crate) fn from_termios(termios: &Termios) -> Self {
        let control = termios.control_modes;
        let size = control & ControlModes::CSIZE;
        // CS5 is the empty pattern, hence what remains.
        let data_bits = match size {
            ControlModes::CS8 => 8,
            ControlModes::CS7 => 7,
            ControlModes::CS6 => 6,
            _ => 5,
        };
        let parity = match (
            control.contains(ControlModes::PARENB),
            control.contains(ControlModes::PARODD),
        ) {
            (false, false) => Parity::None,
            (true, false) => Parity::Even,
            (_, true) => Parity::Odd,
        };
        let translating = InputModes::ISTRIP
            | InputModes::INLCR
            | InputModes::IGNCR
            | InputModes::ICRNL
            | InputModes::IXON;
        let interpreting = LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
        Self {
            baud: termios.output_speed(),
            data_bits,
            parity,
            stop_bits: if control.contains(ControlModes::CSTOPB) {
                2
            } else {
                1
            },
            rts_cts: control.contains(ControlModes::CRTSCTS),
            raw: !termios.input_modes.intersects(translating)
                && !termios.output_modes.contains(OutputModes::OPOST)
                && !termios.local_modes.intersects(interpreting),
        }
    }
}

impl fmt::Display for LineSettings {
    /// Writes the usual short form, such as `115200 8N1`.
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let parity = match self.parity {
            Parity::None => 'N',
            Parity::Even => 'E',
            Parity::Odd => 'O',
        };
        write!(
            f,
            "{} {}{parity}{}",
            self.baud, self.data_bits, self.stop_bits
        )
    }
}

/// Settings of a port until a client sets it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Defaults {
    /// Raw, 8N1, at the device's speed. A fresh pseudo-terminal echoes and edits lines, and so does
    /// one that a client has left that way: whoever opened it next with plain `cat` would have its
    /// replies echoed back into the device.
    #[default]
    Raw,
    /// As Linux sets a serial port: 9600 baud, with echo, editing and translation.
    Kernel,
}

impl Defaults {
    /// The settings, made of those of a fresh pseudo-terminal.
    pub(crate) fn at(self, fresh: &Termios, baud: u32) -> Result<Termios, Errno> {
        let mut termios = fresh.clone();
        match self {
            Self::Raw => {
                termios.input_modes = InputModes::empty();
                termios.output_modes = OutputModes::empty();
                termios.local_modes = LocalModes::empty();
                termios.control_modes |= ControlModes::CLOCAL;
                termios.special_codes[SpecialCodeIndex::VMIN] = 1;
                termios.special_codes[SpecialCodeIndex::VTIME] = 0;
                termios.set_speed(baud)?;
            }
            Self::Kernel => {
                termios.control_modes |= ControlModes::CLOCAL | ControlModes::HUPCL;
                termios.set_speed(9_600)?;
            }
        }
        Ok(termios)
    }
}

/// Tells whether both are the same in all that a client can set.
pub(crate) fn is_same(one: &Termios, other: &Termios) -> bool {
    one.input_modes == other.input_modes
        && one.output_modes == other.output_modes
        && one.local_modes == other.local_modes
        && one.control_modes == other.control_modes
        && one.input_speed() == other.input_speed()
        && one.output_speed() == other.output_speed()
        && SPECIAL_CODES
            .into_iter()
            .all(|index| one.special_codes[index] == other.special_codes[index])
}

const SPECIAL_CODES: [SpecialCodeIndex; 17] = [
    SpecialCodeIndex::VINTR,
    SpecialCodeIndex::VQUIT,
    SpecialCodeIndex::VERASE,
    SpecialCodeIndex::VKILL,
    SpecialCodeIndex::VEOF,
    SpecialCodeIndex::VTIME,
    SpecialCodeIndex::VMIN,
    SpecialCodeIndex::VSWTC,
    SpecialCodeIndex::VSTART,
    SpecialCodeIndex::VSTOP,
    SpecialCodeIndex::VSUSP,
    SpecialCodeIndex::VEOL,
    SpecialCodeIndex::VREPRINT,
    SpecialCodeIndex::VDISCARD,
    SpecialCodeIndex::VWERASE,
    SpecialCodeIndex::VLNEXT,
    SpecialCodeIndex::VEOL2,
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn settings_are_written_as_on_a_data_sheet() {
        let mut line = LineSettings {
            baud: 115_200,
            data_bits: 8,
            parity: Parity::None,
            stop_bits: 1,
            rts_cts: false,
            raw: true,
        };
        assert_eq!(line.to_string(), "115200 8N1");
        line = LineSettings {
            data_bits: 7,
            parity: Parity::Even,
            stop_bits: 2,
            ..line
        };
        assert_eq!(line.to_string(), "115200 7E2");
    }
}
