//! The kernel's side of a pseudo-terminal: a master that we hold, a node
//! under `/dev/pts` that clients open.
//!
//! Facts about Linux that this module rests on, each with a test:
//!
//! - With no client the master reads `EIO` and polls as hung up. A fresh pair
//!   does not, until its node has been opened and closed once.
//! - `TCOFLUSH` on the master empties what is on the way to the client but
//!   not what has arrived and waits to be read; setting the attributes with
//!   `TCSAFLUSH`, also on the master, empties the latter.
//! - `TIOCEXCL` outlives the client that set it. The flag belongs to the
//!   client's end: `TIOCNXCL` on the master does not reach it, a descriptor
//!   opened with `O_PATH` takes no ioctl, and every way of opening the node,
//!   `TIOCGPTPEER` included, gives `EBUSY` to all but root. Holding a
//!   descriptor of our own would reach it, but also hide every hang-up.

use std::ffi::OsString;
use std::os::unix::ffi::OsStringExt as _;
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec, poll};
use rustix::fd::{AsFd, BorrowedFd, OwnedFd};
use rustix::fs::{Mode, OFlags};
use rustix::io::{Errno, retry_on_intr};
use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
use rustix::termios::{OptionalActions, QueueSelector, ioctl_tiocnxcl, tcflush};
use rustix::termios::{tcgetattr, tcsetattr};

use crate::error::PortErrorKind;
use crate::line::{restore_raw, set_raw_and_flush};

/// A pair whose client end is raw at the device's baud.
#[derive(Debug)]
pub(crate) struct Pair {
    master: OwnedFd,
    slave: PathBuf,
    baud: u32,
}

/// Whether the next client may open the node.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Access {
    /// It may.
    Open,
    /// A flag that only root can clear keeps everybody out.
    Locked,
}

impl Pair {
    /// Opens a fresh pair. It looks exactly like one whose client has left.
    pub(crate) fn open(baud: u32) -> Result<Self, PortErrorKind> {
        if baud == 0 {
            return Err(PortErrorKind::ZeroBaud);
        }
        let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC)
            .map_err(|errno| match errno {
                Errno::AGAIN | Errno::NOSPC => PortErrorKind::NoPtyLeft,
                errno => PortErrorKind::call("posix_openpt")(errno),
            })?;
        let flags = rustix::fs::fcntl_getfl(&master).map_err(PortErrorKind::call("fcntl"))?;
        rustix::fs::fcntl_setfl(&master, flags | OFlags::NONBLOCK)
            .map_err(PortErrorKind::call("fcntl"))?;
        grantpt(&master).map_err(PortErrorKind::call("grantpt"))?;
        // Settings come before the lock is taken off, so that no client can
        // ever see an echoing terminal.
        set_raw_and_flush(&master, baud).map_err(PortErrorKind::call("tcsetattr"))?;
        unlockpt(&master).map_err(PortErrorKind::call("unlockpt"))?;
        let name = ptsname(&master, Vec::new()).map_err(PortErrorKind::call("ptsname"))?;
        let slave = PathBuf::from(OsString::from_vec(name.into_bytes()));
        let pair = Self {
            master,
            slave,
            baud,
        };
        pair.clear_exclusive()?;
        Ok(pair)
    }

    /// The node that clients open.
    pub(crate) fn slave(&self) -> &Path {
        &self.slave
    }

    /// Whether a client has the node open or has left bytes behind.
    pub(crate) fn has_client(&self) -> Result<bool, Errno> {
        let flags = self.poll_flags()?;
        Ok(!flags.contains(PollFlags::HUP) || flags.contains(PollFlags::IN))
    }

    /// Whether nobody has the node open.
    pub(crate) fn is_hung_up(&self) -> Result<bool, Errno> {
        Ok(self.poll_flags()?.contains(PollFlags::HUP))
    }

    /// Whether there is anything to read.
    pub(crate) fn has_bytes(&self) -> Result<bool, Errno> {
        Ok(self.poll_flags()?.contains(PollFlags::IN))
    }

    /// Waits so long until nobody has the node open.
    pub(crate) fn await_hang_up(&self, longest: Duration) -> Result<(), Errno> {
        self.poll(PollFlags::empty(), longest).map(drop)
    }

    fn poll_flags(&self) -> Result<PollFlags, Errno> {
        self.poll(PollFlags::IN, Duration::ZERO)
    }

    fn poll(&self, wanted: PollFlags, longest: Duration) -> Result<PollFlags, Errno> {
        let mut fds = [PollFd::new(&self.master, wanted)];
        let longest = Timespec::try_from(longest).ok();
        retry_on_intr(|| poll(&mut fds, longest.as_ref()))?;
        Ok(fds[0].revents())
    }

    /// Takes back what is on the way to the client that has left, and gives
    /// the line the device's own settings again. What has arrived for it is
    /// for [`Self::clear_exclusive`] or [`Self::flush_output`].
    ///
    /// A next client that is there already keeps whatever it has set.
    pub(crate) fn reset(&self) -> Result<(), Errno> {
        tcflush(&self.master, QueueSelector::OFlush)?;
        restore_raw(&self.master, self.baud, || Ok(!self.is_hung_up()?))
    }

    /// Takes back every byte that was not read, but keeps the settings, for
    /// a client who may be making its own right now.
    ///
    /// A descriptor of the client's end, held for a moment, can do that
    /// without a word about settings. Where a client keeps us out, they are
    /// written as they were just read, and what it changes in between is
    /// undone.
    pub(crate) fn flush_output(&self) -> Result<(), PortErrorKind> {
        // In this order: nothing can arrive at the client's end once nothing
        // is on the way to it.
        tcflush(&self.master, QueueSelector::OFlush).map_err(PortErrorKind::call("tcflush"))?;
        if let Some(slave) = self.look_in()? {
            return tcflush(slave, QueueSelector::IFlush).map_err(PortErrorKind::call("tcflush"));
        }
        tcgetattr(&self.master)
            .and_then(|termios| tcsetattr(&self.master, OptionalActions::Flush, &termios))
            .map_err(PortErrorKind::call("tcsetattr"))
    }

    /// Clears the exclusive flag by way of a descriptor held for a moment,
    /// which root may open and anybody else if the flag is not set at all;
    /// and takes back what waits at the client's end.
    pub(crate) fn clear_exclusive(&self) -> Result<Access, PortErrorKind> {
        let Some(slave) = self.look_in()? else {
            return Ok(Access::Locked);
        };
        ioctl_tiocnxcl(&slave).map_err(PortErrorKind::call("TIOCNXCL"))?;
        tcflush(slave, QueueSelector::IFlush).map_err(PortErrorKind::call("tcflush"))?;
        Ok(Access::Open)
    }

    /// A descriptor of the client's end, unless it is locked.
    ///
    /// It only reads, so that its closing is told apart from a client's by
    /// whoever watches the node.
    fn look_in(&self) -> Result<Option<OwnedFd>, PortErrorKind> {
        let flags = OFlags::RDONLY | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        match retry_on_intr(|| rustix::fs::open(&self.slave, flags, Mode::empty())) {
            Ok(slave) => Ok(Some(slave)),
            Err(Errno::BUSY) => Ok(None),
            Err(errno) => Err(PortErrorKind::call("open")(errno)),
        }
    }
}

impl AsFd for Pair {
    fn as_fd(&self) -> BorrowedFd<'_> {
        self.master.as_fd()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A client's end as the system opens it.
    fn client_of(pair: &Pair) -> OwnedFd {
        let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::NONBLOCK | OFlags::CLOEXEC;
        rustix::fs::open(pair.slave(), flags, Mode::empty()).expect("the node can be opened")
    }

    fn set_speed(client: &OwnedFd, baud: u32) {
        let mut termios = tcgetattr(client).expect("there are settings");
        termios.set_speed(baud).expect("a speed");
        tcsetattr(client, OptionalActions::Now, &termios).expect("the settings are taken");
    }

    fn speed(pair: &Pair) -> u32 {
        tcgetattr(&pair.master)
            .expect("there are settings")
            .output_speed()
    }

    #[test]
    fn a_client_that_has_come_before_the_reset_keeps_its_settings() {
        let pair = Pair::open(115_200).expect("a pair");
        let former = client_of(&pair);
        set_speed(&former, 9_600);
        drop(former);
        let client = client_of(&pair);
        set_speed(&client, 57_600);
        pair.reset().expect("the reset");
        assert_eq!(speed(&pair), 57_600);
        drop(client);
        pair.reset().expect("the reset");
        assert_eq!(speed(&pair), 115_200);
    }

    #[test]
    fn what_waits_for_a_client_is_taken_back_without_its_settings() {
        let pair = Pair::open(115_200).expect("a pair");
        let client = client_of(&pair);
        set_speed(&client, 57_600);
        let mut buf = [0; 8];
        for flush in [
            Pair::flush_output as fn(&Pair) -> Result<(), PortErrorKind>,
            |pair| pair.clear_exclusive().map(drop),
        ] {
            assert_eq!(rustix::io::write(&pair.master, b"reply"), Ok(5));
            flush(&pair).expect("the flush");
            assert_eq!(rustix::io::read(&client, &mut buf), Err(Errno::AGAIN));
            assert_eq!(speed(&pair), 57_600);
        }
    }
}
