//! Line settings: what the client asked of the line, and how ours is prepared.

use rigsim_settings::ClientLine;
use rustix::fd::AsFd;
use rustix::io::Errno;
use rustix::termios::{
    ControlModes, InputModes, LocalModes, OutputModes, SpecialCodeIndex, Termios, tcgetattr,
};

/// Returns the settings of a client's end of a pseudo-terminal; the descriptor is of either end.
///
/// A pseudo-terminal carries bytes whatever the settings are, so the caller compares them with the
/// device's own.
///
/// # Errors
/// When it is not a terminal.
pub fn line_of(terminal: impl AsFd) -> Result<ClientLine, Errno> {
    tcgetattr(terminal).map(|termios| from_termios(&termios))
}

pub(crate) fn from_termios(termios: &Termios) -> ClientLine {
    let control = termios.control_modes;
    let translating = InputModes::ISTRIP
        | InputModes::INLCR
        | InputModes::IGNCR
        | InputModes::ICRNL
        | InputModes::IUCLC
        | InputModes::IXON
        | InputModes::PARMRK;
    let interpreting = LocalModes::ICANON | LocalModes::ECHO | LocalModes::ISIG;
    ClientLine {
        baud: termios.output_speed(),
        parity: control.intersects(ControlModes::PARENB | ControlModes::PARODD),
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

/// Settings of a port until a client sets it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Defaults {
    /// Raw, 8N1, at the device's speed. A fresh pseudo-terminal echoes and edits lines, and so does
    /// one that a client has left that way: a client that opened it next with plain `cat` would have its
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

/// Returns whether both are the same in all that a client can set.
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
