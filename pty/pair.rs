//! The kernel's side of a pseudo-terminal: a master that we hold, a node
//! under `/dev/pts` that clients open.
//!
//! Facts about Linux that this module rests on, each with a test:
//!
//! - With no client the master reads `EIO` and polls as hung up. A fresh pair
//!   does not, until its node has been opened and closed once.
//! - In packet mode each read begins with a byte that says whether data follow or what happened; a
//!   client's `TCOFLUSH` is reported before what it wrote afterwards. That flush empties what is on
//!   its way to the master, but not the up to 4095 bytes that have arrived and wait to be read.
//! - `TCOFLUSH` on the master empties what is on the way to the client but
//!   not what has arrived and waits to be read.
//! - What a client leaves at its end outlives it: settings, locked settings, suspended output,
//!   the line discipline, `TIOCEXCL`. The master reaches the settings alone; a descriptor of the
//!   client's end reaches all of it, but while it is open it hides every hang-up.
//! - `TIOCEXCL` keeps out all users but root, whichever way the node is opened.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::ffi::c_int;
use rustix::fs::{Gid, Mode, OFlags, fchmod, fchown};
use rustix::io::{Errno, IoSliceMut, ioctl_fionread, retry_on_intr};
use rustix::ioctl::{Getter, Opcode, Setter, ioctl};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{Action, OptionalActions, QueueSelector, Termios};
use rustix::termios::{ioctl_tiocnxcl, tcflow, tcflush, tcgetattr, tcsetattr};

use crate::error::PortErrorKind;
use crate::line::{Defaults, is_same};

/// First byte of a read of a master in packet mode, from `ioctl_tty(2)`.
const DATA: u8 = 0;
const FLUSH_READ: u8 = 1;
const FLUSH_WRITE: u8 = 2;
/// Most times to undo what clients do that come and go meanwhile.
const MOST_VISITS: u32 = 8;
/// Rounds in which bytes of clients that have left are thrown away, which are no more than the
/// system keeps.
const MOST_ROUNDS: usize = 64;

/// Setup of the client's end when no client has it open.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct PtySetup {
    /// Bits per second of the device.
    pub baud: u32,
    /// Settings until a client sets it.
    pub defaults: Defaults,
    /// Permissions of the node, such as `0o660`.
    pub mode: Option<u32>,
    /// The group that the node belongs to.
    pub group: Option<u32>,
}

impl PtySetup {
    /// Raw at `baud`, with the system's permissions.
    #[must_use]
    pub const fn raw(baud: u32) -> Self {
        Self {
            baud,
            defaults: Defaults::Raw,
            mode: None,
            group: None,
        }
    }
}

/// A pair whose client end is set up.
#[derive(Debug)]
pub(crate) struct Pair {
    master: OwnedFd,
    slave: PathBuf,
    pub(crate) setup: PtySetup,
    defaults: Termios,
}

/// Result of reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Read {
    Bytes(usize),
    /// A client does not want what waits for it any more, or has taken back what it had written and was
    /// not read.
    Flushed {
        input: bool,
        output: bool,
    },
    /// Something else has happened that does not matter here.
    Other,
    Nothing,
    HungUp,
}

/// A fresh pseudo-terminal whose client end is set up: the master, which does not block, the node that
/// clients open, and the settings of that.
///
/// # Errors
/// When the system has none, or refuses the settings.
pub fn open_terminal(setup: &PtySetup) -> Result<(OwnedFd, PathBuf, Termios), PortErrorKind> {
    if setup.baud == 0 {
        return Err(PortErrorKind::ZeroBaud);
    }
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).map_err(
        |errno| match errno {
            Errno::AGAIN | Errno::NOSPC => PortErrorKind::NoPtyLeft,
            errno => PortErrorKind::call("posix_openpt")(errno),
        },
    )?;
    let flags = rustix::fs::fcntl_getfl(&master).map_err(PortErrorKind::call("fcntl"))?;
    rustix::fs::fcntl_setfl(&master, flags | OFlags::NONBLOCK)
        .map_err(PortErrorKind::call("fcntl"))?;
    grantpt(&master).map_err(PortErrorKind::call("grantpt"))?;
    // Settings come before the lock is taken off, so that no client can
    // ever see another terminal.
    let fresh = tcgetattr(&master).map_err(PortErrorKind::call("tcgetattr"))?;
    let defaults = setup.defaults.at(&fresh, setup.baud);
    let defaults = defaults.map_err(PortErrorKind::call("tcsetattr"))?;
    retry_on_intr(|| tcsetattr(&master, OptionalActions::Flush, &defaults))
        .map_err(PortErrorKind::call("tcsetattr"))?;
    unlockpt(&master).map_err(PortErrorKind::call("unlockpt"))?;
    let name = ptsname(&master, Vec::new()).map_err(PortErrorKind::call("ptsname"))?;
    let node = PathBuf::from(OsString::from_vec(name.into_bytes()));
    Ok((master, node, defaults))
}

impl Pair {
    /// Opens a fresh pair. It looks exactly like one whose client has left.
    pub(crate) fn open(setup: PtySetup) -> Result<Self, PortErrorKind> {
        let (master, slave, defaults) = open_terminal(&setup)?;
        begin_packet_mode(&master).map_err(PortErrorKind::call("TIOCPKT"))?;
        let pair = Self {
            master,
            slave,
            setup,
            defaults,
        };
        if let Some(slave) = pair.look_in()? {
            pair.set_permissions(&slave)?;
        }
        let _ = pair.forget_happened()?;
        Ok(pair)
    }

    /// The node that clients open.
    pub(crate) fn slave(&self) -> &Path {
        &self.slave
    }

    /// Returns whether a client has the node open or has left bytes behind.
    pub(crate) fn has_client(&self) -> Result<bool, PortErrorKind> {
        let flags = self.poll()?;
        if !flags.contains(PollFlags::HUP) {
            return Ok(true);
        }
        // What is to be read may be no more than a word of what has happened.
        Ok(flags.contains(PollFlags::IN) && self.count()? > 0)
    }

    /// Returns whether no client has the node open.
    pub(crate) fn is_hung_up(&self) -> Result<bool, PortErrorKind> {
        Ok(self.poll()?.contains(PollFlags::HUP))
    }

    fn poll(&self) -> Result<PollFlags, PortErrorKind> {
        let mut fds = [PollFd::new(&self.master, PollFlags::IN | PollFlags::PRI)];
        retry_on_intr(|| poll(&mut fds, Some(&Timespec::default())))
            .map_err(PortErrorKind::call("poll"))?;
        Ok(fds[0].revents())
    }

    /// Reads what fits, or what has happened.
    pub(crate) fn read(&self, buf: &mut [u8]) -> Result<Read, PortErrorKind> {
        let mut kind = [DATA];
        let read = retry_on_intr(|| {
            let mut parts = [IoSliceMut::new(&mut kind), IoSliceMut::new(buf)];
            rustix::io::readv(&self.master, &mut parts)
        });
        match read {
            Ok(2..) if kind[0] == DATA => Ok(Read::Bytes(read.unwrap_or(1) - 1)),
            Ok(1..) if kind[0] & (FLUSH_READ | FLUSH_WRITE) != 0 => Ok(Read::Flushed {
                input: kind[0] & FLUSH_READ != 0,
                output: kind[0] & FLUSH_WRITE != 0,
            }),
            Ok(1..) if kind[0] != DATA => Ok(Read::Other),
            Ok(1..) | Err(Errno::AGAIN) => Ok(Read::Nothing),
            Ok(0) | Err(Errno::IO) => Ok(Read::HungUp),
            Err(errno) => Err(PortErrorKind::call("read")(errno)),
        }
    }

    /// Number of bytes that wait to be read for certain that were written before any flush that has
    /// not been read of; `None` if there is such a flush.
    pub(crate) fn unread(&self) -> Result<Option<usize>, PortErrorKind> {
        let count = self.count()?;
        Ok((!self.has_happened()?).then_some(count))
    }

    /// Returns whether something has happened that was not read of.
    pub(crate) fn has_happened(&self) -> Result<bool, PortErrorKind> {
        Ok(self.poll()?.contains(PollFlags::PRI))
    }

    /// Skips what has happened, as by our own hands; says what it was.
    pub(crate) fn forget_happened(&self) -> Result<Read, PortErrorKind> {
        match self.has_happened()? {
            true => self.read(&mut []),
            false => Ok(Read::Nothing),
        }
    }

    fn count(&self) -> Result<usize, PortErrorKind> {
        let count = ioctl_fionread(&self.master).map_err(PortErrorKind::call("FIONREAD"))?;
        Ok(usize::try_from(count).unwrap_or(0))
    }

    /// Throws away so many bytes of those that wait to be read.
    pub(crate) fn discard(&self, mut count: usize) -> Result<(), PortErrorKind> {
        let mut buf = [0; 4096];
        while count > 0 {
            let most = count.min(buf.len());
            match self.read(&mut buf[..most])? {
                Read::Bytes(n) => count -= n,
                Read::Flushed { .. } | Read::Other => {}
                Read::Nothing | Read::HungUp => break,
            }
        }
        Ok(())
    }

    /// Throws away what clients have left behind, as long as no client is there.
    pub(crate) fn discard_left_behind(&self) -> Result<(), PortErrorKind> {
        let left = PollFlags::HUP | PollFlags::IN;
        for _ in 0..MOST_ROUNDS {
            if !self.poll()?.contains(left) {
                break;
            }
            let count = self.count()?;
            // The client that has written what is counted has left, if none is there even now.
            if !self.is_hung_up()? {
                break;
            }
            match count {
                0 => drop(self.read(&mut [])?),
                count => self.discard(count)?,
            }
        }
        Ok(())
    }

    /// Makes the client's end as it was before any client came; says whether it is, and how often
    /// it was opened for that. The next client may come at any moment, and keeps whatever it has
    /// set.
    pub(crate) fn restore(&self) -> Result<(bool, u32), PortErrorKind> {
        self.flush_output()?;
        // A client may come and go meanwhile, and leave something again.
        for visit in 0..MOST_VISITS {
            self.restore_settings()?;
            let Some(slave) = self.look_in()? else {
                return Ok((!self.is_hung_up()?, visit));
            };
            // Settings first, since those that end suspension by XOFF do so only while nothing else
            // suspends.
            self.set_permissions(&slave)?;
            restore_end(&slave)?;
            drop(slave);
            if is_same(&self.settings()?, &self.defaults) || !self.is_hung_up()? {
                return Ok((true, visit + 1));
            }
        }
        Ok((false, MOST_VISITS))
    }

    /// Undoes of that what a next client that is there already could not mend or would suffer
    /// from; says how often it was opened for that.
    pub(crate) fn restore_for_next(&self) -> Result<u32, PortErrorKind> {
        self.flush_output()?;
        self.look_in_for_next(resume_and_empty)
    }

    /// The same, but takes nothing from a client that has been there for long.
    pub(crate) fn resume(&self) -> Result<u32, PortErrorKind> {
        self.look_in_for_next(resume)
    }

    fn look_in_for_next(
        &self,
        mend: impl FnOnce(&OwnedFd) -> Result<(), PortErrorKind>,
    ) -> Result<u32, PortErrorKind> {
        // No client that wants to talk sets this, so it is not the next one's.
        if self.settings()?.output_speed() == 0 {
            self.write_defaults()?;
        }
        match self.look_in()? {
            Some(slave) => mend(&slave).map(|()| 1),
            None => Ok(0),
        }
    }

    fn flush_output(&self) -> Result<(), PortErrorKind> {
        unless_hung_up(tcflush(&self.master, QueueSelector::OFlush))
            .map_err(PortErrorKind::call("tcflush"))
    }

    /// Settings can only be written all at once, so that writing them undoes what a client changes
    /// at the same time. So they are not written without need, and whether a client has come is
    /// asked at the last moment.
    fn restore_settings(&self) -> Result<(), PortErrorKind> {
        if is_same(&self.settings()?, &self.defaults) || !self.is_hung_up()? {
            return Ok(());
        }
        self.write_defaults()
    }

    fn write_defaults(&self) -> Result<(), PortErrorKind> {
        tcsetattr(&self.master, OptionalActions::Now, &self.defaults)
            .map_err(PortErrorKind::call("tcsetattr"))
    }

    /// The settings of the client's end.
    pub(crate) fn settings(&self) -> Result<Termios, PortErrorKind> {
        tcgetattr(&self.master).map_err(PortErrorKind::call("tcgetattr"))
    }

    fn set_permissions(&self, slave: &OwnedFd) -> Result<(), PortErrorKind> {
        if let Some(group) = self.setup.group {
            fchown(slave, None, Some(Gid::from_raw(group))).map_err(|errno| match errno {
                Errno::PERM => PortErrorKind::ForeignGroup,
                errno => PortErrorKind::call("chown")(errno),
            })?;
        }
        if let Some(mode) = self.setup.mode {
            fchmod(slave, Mode::from_raw_mode(mode)).map_err(PortErrorKind::call("chmod"))?;
        }
        Ok(())
    }

    /// A descriptor of the client's end, unless it is locked.
    ///
    /// It only reads, so that its closing differs from that of most clients for a program that
    /// watches the node.
    fn look_in(&self) -> Result<Option<OwnedFd>, PortErrorKind> {
        let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let open = || retry_on_intr(|| rustix::fs::open(&self.slave, flags, Mode::empty()));
        // It may be hung up while it is being opened.
        match open().or_else(|errno| {
            if errno == Errno::IO {
                open()
            } else {
                Err(errno)
            }
        }) {
            Ok(slave) => Ok(Some(slave)),
            Err(Errno::BUSY | Errno::IO) => Ok(None),
            Err(errno) => Err(PortErrorKind::call("open")(errno)),
        }
    }
}

impl AsFd for Pair {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}

/// Undoes what clients have left at their end, but for settings and permissions.
///
/// # Errors
/// When the system refuses it.
pub fn restore_end(slave: &OwnedFd) -> Result<(), PortErrorKind> {
    restore_line_discipline(slave).map_err(PortErrorKind::call("TIOCSETD"))?;
    unless_hung_up(ioctl_tiocnxcl(slave)).map_err(PortErrorKind::call("TIOCNXCL"))?;
    resume_and_empty(slave)
}

/// Resumes the client's output, and takes back what has arrived for it and was not read.
fn resume_and_empty(slave: &OwnedFd) -> Result<(), PortErrorKind> {
    resume(slave)?;
    unless_hung_up(tcflush(slave, QueueSelector::IFlush)).map_err(PortErrorKind::call("tcflush"))
}

fn resume(slave: &OwnedFd) -> Result<(), PortErrorKind> {
    unless_hung_up(tcflow(slave, Action::OOn)).map_err(PortErrorKind::call("tcflow"))
}

/// A privileged client may hang up all that have the node open, ourselves for once. What was to be undone is
/// looked at again at the next departure.
fn unless_hung_up(done: Result<(), Errno>) -> Result<(), Errno> {
    match done {
        Err(Errno::IO) => Ok(()),
        done => done,
    }
}

#[expect(unsafe_code, reason = "no library wraps this call")]
fn begin_packet_mode(master: &OwnedFd) -> Result<(), Errno> {
    const TIOCPKT: Opcode = 0x5420;
    // SAFETY: TIOCPKT reads one int through its argument, which lives for the call.
    unsafe { ioctl(master, Setter::<TIOCPKT, c_int>::new(1)) }
}

/// The usual line discipline again, if a client has changed it. Setting it in any case would have
/// the read of a client that has just come fail with `EAGAIN`.
#[expect(unsafe_code, reason = "no library wraps these calls")]
fn restore_line_discipline(slave: &OwnedFd) -> Result<(), Errno> {
    const TIOCSETD: Opcode = 0x5423;
    const TIOCGETD: Opcode = 0x5424;
    const N_TTY: c_int = 0;
    // SAFETY: TIOCGETD writes one int through its argument, which lives for the call.
    match unsafe { ioctl(slave, Getter::<TIOCGETD, c_int>::new()) } {
        Ok(N_TTY) | Err(Errno::IO) => return Ok(()),
        Ok(_) => {}
        Err(errno) => return Err(errno),
    }
    // It waits for what is on its way, and a signal of any kind breaks that off.
    unless_hung_up(retry_on_intr(|| {
        // SAFETY: TIOCSETD reads one int through its argument, which lives for the call.
        unsafe { ioctl(slave, Setter::<TIOCSETD, c_int>::new(N_TTY)) }
    }))
}

#[cfg(test)]
mod tests;
