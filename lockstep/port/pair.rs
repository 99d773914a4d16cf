//! Both ends of a pseudo-terminal, and what its settings mean.

use std::cell::OnceCell;
use std::io;
use std::mem::MaybeUninit;
use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use rigsim_settings::ClientLine;
use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::inotify::{self, CreateFlags, ReadFlags, WatchFlags};
use rustix::fs::{CWD, Mode, OFlags};
use rustix::io::retry_on_intr;
use rustix::termios::{
    Action, LocalModes, OptionalActions, OutputModes, QueueSelector, SpecialCodeIndex, Termios,
};

/// Most bytes that a client can read at once, the kernel's limit for terminals.
pub(crate) const MOST_READ: usize = 4095;
/// Limit of the time of a hang-up through the kernel. It takes microseconds unless the machine is overloaded.
const PATIENCE: Duration = Duration::from_secs(60);

/// Rule for the end of a read.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) struct ReadRule {
    /// Bytes that it waits for, `VMIN`; `None` if it waits for a line.
    pub(crate) least: Option<usize>,
    pub(crate) patience: Option<Duration>,
}

impl ReadRule {
    /// A read waits for any bytes.
    pub(crate) const ANY: Self = Self {
        least: Some(1),
        patience: None,
    };

    /// A read returns at once, whatever is there.
    pub(crate) fn never_waits(self) -> bool {
        self.least == Some(0) && self.patience.is_none()
    }
}

/// Both ends. Our own descriptor of the client's end shows what the client sees.
pub(crate) struct Pair {
    master: OwnedFd,
    defaults: Termios,
    pub(crate) slave: OwnedFd,
    pub(crate) device: u64,
    pub(crate) watch: OwnedFd,
    /// Cached settings, until the client changes them.
    pub(crate) settings: OnceCell<(Termios, ClientLine)>,
}

/// Returns whether any of these is ready.
pub(crate) fn poll(polls: &mut [PollFd<'_>]) -> bool {
    rustix::event::poll(polls, Some(&Timespec::default())).is_ok_and(|count| count > 0)
}

/// Takes what is there; `None` if that fails.
fn read(from: &OwnedFd, most: usize) -> Option<Vec<u8>> {
    let mut bytes = vec![0; most];
    let count = retry_on_intr(|| rustix::io::read(from, &mut bytes[..])).ok()?;
    bytes.truncate(count);
    Some(bytes)
}

impl Pair {
    pub(crate) fn open(baud: u32) -> io::Result<(Self, PathBuf)> {
        let setup = rigsim_pty::PtySetup::raw(baud);
        let (master, node, defaults) =
            rigsim_pty::open_terminal(&setup).map_err(io::Error::other)?;
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC | OFlags::NONBLOCK;
        let slave = rustix::fs::openat(CWD, &node, flags, Mode::empty())?;
        let device = rustix::fs::fstat(&slave)?.st_rdev;
        let watch = inotify::init(CreateFlags::NONBLOCK | CreateFlags::CLOEXEC)?;
        let events = WatchFlags::OPEN | WatchFlags::CLOSE_WRITE | WatchFlags::CLOSE_NOWRITE;
        inotify::add_watch(&watch, &node, events)?;
        let pair = Self {
            master,
            defaults,
            slave,
            device,
            watch,
            settings: OnceCell::new(),
        };
        Ok((pair, node))
    }

    pub(crate) fn settings(&self) -> io::Result<&(Termios, ClientLine)> {
        if let Some(known) = self.settings.get() {
            return Ok(known);
        }
        let line = rigsim_pty::line_of(&self.slave)?;
        let termios = rustix::termios::tcgetattr(&self.slave)?;
        Ok(self.settings.get_or_init(|| (termios, line)))
    }

    pub(crate) fn is_raw(&self) -> bool {
        self.settings().is_ok_and(|(_, line)| line.raw)
    }

    pub(crate) fn read_rule(&self) -> ReadRule {
        let Ok((termios, _)) = self.settings() else {
            return ReadRule::ANY;
        };
        let has_lines = termios.local_modes.contains(LocalModes::ICANON);
        let [least, tenths] = [SpecialCodeIndex::VMIN, SpecialCodeIndex::VTIME]
            .map(|index| termios.special_codes[index]);
        let patience = Duration::from_millis(100 * u64::from(tenths));
        ReadRule {
            least: (!has_lines).then_some(least.into()),
            patience: (!has_lines && tenths > 0).then_some(patience),
        }
    }

    /// Bytes that a terminal makes of those that are written to it.
    pub(crate) fn cooked(&self, bytes: &[u8]) -> Vec<u8> {
        let modes = self.settings().map(|(termios, _)| termios.output_modes);
        let modes = modes.unwrap_or(OutputModes::empty());
        let has = |mode| modes.contains(OutputModes::OPOST | mode);
        let cooked = bytes.iter().flat_map(|&byte| match byte {
            b'\n' if has(OutputModes::ONLCR) => [Some(b'\r'), Some(byte)],
            b'\r' if has(OutputModes::OCRNL) => [Some(b'\n'), None],
            // As the kernel has it, letters of Latin-1.
            b'a'..=b'z' | 0xDF..=0xF6 | 0xF8.. if has(OutputModes::OLCUC) => {
                [Some(byte - 0x20), None]
            }
            _ => [Some(byte), None],
        });
        cooked.flatten().collect()
    }

    /// Opens (`true`) and closes (`false`) by clients since the last query.
    pub(crate) fn changes(&self) -> Vec<bool> {
        let mut changes = Vec::new();
        let mut buffer = [MaybeUninit::uninit(); 2048];
        let mut reader = inotify::Reader::new(&self.watch, &mut buffer);
        while let Ok(event) = reader.next() {
            let closed = ReadFlags::CLOSE_WRITE | ReadFlags::CLOSE_NOWRITE;
            if event.events().contains(ReadFlags::OPEN) {
                changes.push(true);
            } else if event.events().intersects(closed) {
                changes.push(false);
            }
        }
        changes
    }

    /// Stops or starts the client's output. It cannot fail on a terminal that is there.
    pub(crate) fn flow(&self, action: Action) {
        let _ = rustix::termios::tcflow(&self.slave, action);
    }

    /// Makes the terminal, which is stopped, send a signal (`O_ASYNC`) when it is started.
    pub(crate) fn want_room(&self) {
        // The terminal takes nothing, but remembers who has tried.
        let _ = rustix::io::write(&self.slave, &[0]);
    }

    /// Takes the unread bytes back. It cannot fail on a terminal that is there.
    pub(crate) fn flush(&self) {
        let _ = rustix::termios::tcflush(&self.slave, QueueSelector::IFlush);
    }

    /// Returns whether the client's output goes on.
    pub(crate) fn has_room(&self) -> bool {
        poll(&mut [PollFd::new(&self.slave, PollFlags::OUT)])
    }

    /// Bytes that the terminal itself has sent.
    pub(crate) fn echo(&self) -> Vec<u8> {
        read(&self.master, MOST_READ).unwrap_or_default()
    }

    /// Restores the terminal's initial settings. It cannot fail on a terminal that is there.
    pub(crate) fn restore(&self) {
        let _ = rustix::termios::tcsetattr(&self.slave, OptionalActions::Now, &self.defaults);
        let _ = rigsim_pty::restore_end(&self.slave);
    }

    /// Writes to the client's end, which has room for what goes there at once.
    pub(crate) fn write(&self, mut bytes: &[u8]) -> io::Result<()> {
        while !bytes.is_empty() {
            // The tick of the tracer interrupts it now and then.
            let count = retry_on_intr(|| rustix::io::write(&self.master, bytes))?;
            bytes = bytes.get(count..).unwrap_or_default();
        }
        Ok(())
    }

    /// Takes what the terminal has made of all that was written: lines, or bytes.
    pub(crate) fn edited(&self, has_lines: bool) -> io::Result<Vec<Vec<u8>>> {
        let mut parts = Vec::new();
        // A poll that finds nothing waits until the terminal has processed what was written. A read that does not
        // wait takes what is there, for any VMIN.
        while poll(&mut [PollFd::new(&self.slave, PollFlags::IN)]) || !has_lines {
            match read(&self.slave, MOST_READ) {
                Some(bytes) if has_lines || !bytes.is_empty() => parts.push(bytes),
                _ => break,
            }
        }
        Ok(parts)
    }

    /// Returns whether one of these bytes is a signal (`ISIG`), which throws away what has not been read.
    pub(crate) fn discards(&self, termios: &Termios, bytes: &[u8]) -> bool {
        let codes = [
            SpecialCodeIndex::VINTR,
            SpecialCodeIndex::VQUIT,
            SpecialCodeIndex::VSUSP,
        ]
        .map(|code| termios.special_codes[code]);
        let modes = termios.local_modes;
        // Zero is none.
        modes.contains(LocalModes::ISIG)
            && !modes.contains(LocalModes::NOFLSH)
            && bytes.iter().any(|byte| *byte != 0 && codes.contains(byte))
    }

    /// Writes this many placeholder bytes, for which the terminal neither waits for a line nor sends an echo.
    pub(crate) fn sign(&self, termios: &Termios, count: usize) -> io::Result<()> {
        let set = |termios: &Termios| {
            rustix::termios::tcsetattr(&self.slave, OptionalActions::Now, termios)
        };
        let mut plain = termios.clone();
        plain.local_modes = LocalModes::empty();
        let is_plain = !termios
            .local_modes
            .intersects(LocalModes::ICANON | LocalModes::ECHO);
        if !is_plain {
            set(&plain)?;
        }
        self.write(&vec![0; count])?;
        poll(&mut [PollFd::new(&self.slave, PollFlags::IN)]);
        if !is_plain {
            set(termios)?;
        }
        Ok(())
    }

    /// Closes the master and returns the other end once it is hung up for its clients. Before that a read there
    /// fails; after that it finds the end. A process that another thread of this program starts has the master
    /// open as well, until it calls exec.
    pub(crate) fn hang_up(self) -> io::Result<OwnedFd> {
        drop(self.master);
        let begun = Instant::now();
        while begun.elapsed() < PATIENCE {
            let mut slave = [PollFd::new(&self.slave, PollFlags::IN)];
            if poll(&mut slave) && slave[0].revents().contains(PollFlags::ERR) {
                return Ok(self.slave);
            }
            std::thread::yield_now();
        }
        Err(io::Error::other(
            "the client does not find that its cable has been pulled: another process has the other \
             end of its pseudo-terminal open",
        ))
    }
}
