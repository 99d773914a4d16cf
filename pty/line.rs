//! Line settings: what the client asked of the line, and how ours is prepared.

use std::fmt;

use rustix::fd::AsFd;
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, LocalModes, OptionalActions, OutputModes, SpecialCodeIndex, Termios,
    tcgetattr, tcsetattr,
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
    /// Parity. Linux refuses any on a pseudo-terminal.
    pub parity: Parity,
    /// Stop bits, 1 or 2.
    pub stop_bits: u8,
    /// Whether bytes pass untouched. A client that leaves this off has its
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
    /// Reads the client's settings through the master's end.
    pub(crate) fn of(master: impl AsFd) -> Result<Self, Errno> {
        Ok(Self::from_termios(&tcgetattr(master)?))
    }

    fn from_termios(termios: &Termios) -> Self {
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
            (false, _) => Parity::None,
            (true, false) => Parity::Even,
            (true, true) => Parity::Odd,
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

/// Makes the client's end raw, 8N1, at `baud`, and discards what waits there
/// for the client.
///
/// A fresh pseudo-terminal echoes and edits lines, and so does one that a
/// client has left that way: whoever opens it next with plain `cat` would
/// have its replies echoed back into the device.
pub(crate) fn set_raw_and_flush(master: impl AsFd, baud: u32) -> Result<(), Errno> {
    let raw = made_raw(&tcgetattr(&master)?, baud)?;
    tcsetattr(master, OptionalActions::Flush, &raw)
}

/// The same after a client has left, unless nothing has to be changed or
/// `is_taken` by the next one already.
///
/// Settings can only be written all at once, so that writing them undoes
/// what a client changes at the same time. Hence they are not written
/// without need, and whether they may be is asked at the last moment.
pub(crate) fn restore_raw(
    master: impl AsFd,
    baud: u32,
    is_taken: impl FnOnce() -> Result<bool, Errno>,
) -> Result<(), Errno> {
    let left = tcgetattr(&master)?;
    let raw = made_raw(&left, baud)?;
    if is_same(&left, &raw) || is_taken()? {
        return Ok(());
    }
    tcsetattr(master, OptionalActions::Flush, &raw)
}

fn is_same(one: &Termios, other: &Termios) -> bool {
    let code = |termios: &Termios, index| termios.special_codes[index];
    one.input_modes == other.input_modes
        && one.output_modes == other.output_modes
        && one.local_modes == other.local_modes
        && one.control_modes == other.control_modes
        && one.input_speed() == other.input_speed()
        && one.output_speed() == other.output_speed()
        && [SpecialCodeIndex::VMIN, SpecialCodeIndex::VTIME]
            .into_iter()
            .all(|index| code(one, index) == code(other, index))
}

fn made_raw(termios: &Termios, baud: u32) -> Result<Termios, Errno> {
    let mut termios = termios.clone();
    termios.input_modes = InputModes::empty();
    termios.output_modes = OutputModes::empty();
    termios.local_modes = LocalModes::empty();
    // Everything but the speed, which `set_speed` writes below.
    termios.control_modes.remove(
        ControlModes::CSIZE
            | ControlModes::PARENB
            | ControlModes::PARODD
            | ControlModes::CSTOPB
            | ControlModes::CRTSCTS
            | ControlModes::CMSPAR,
    );
    termios
        .control_modes
        .insert(ControlModes::CS8 | ControlModes::CREAD | ControlModes::CLOCAL);
    termios.special_codes[SpecialCodeIndex::VMIN] = 1;
    termios.special_codes[SpecialCodeIndex::VTIME] = 0;
    termios.set_speed(baud)?;
    Ok(termios)
}

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
