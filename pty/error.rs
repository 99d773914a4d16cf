//! Errors: what was being done, to which path, what is wrong and what helps.

use std::io;
use std::path::{Path, PathBuf};

/// A port could not be opened or used.
#[derive(Debug, thiserror::Error)]
#[error("cannot {action} {}: {kind}", path.display())]
pub struct PortError {
    action: &'static str,
    path: PathBuf,
    // Part of the message, so it is not a source that would be reported once more.
    kind: PortErrorKind,
}

/// Kind of an error, and what the user can do about it.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum PortErrorKind {
    /// The path has no last component, so no link can be put there.
    #[error("the path does not name a file; give one such as /tmp/r150")]
    NotAFileName,
    /// The path is longer than the system opens.
    #[error("the path is longer than 4,095 bytes, so that no client could open it")]
    TooLong,
    /// The directory that is to hold the link is missing.
    #[error("the directory {} does not exist; create it or choose another path", .0.display())]
    MissingDirectory(PathBuf),
    /// The directory that is to hold the link may not be written to.
    #[error(
        "this user may not create files in {}; choose another path or change its permissions",
        .0.display()
    )]
    NotWritable(PathBuf),
    /// Something that is not ours is in the way.
    #[error("there is already {0}, which is left alone; remove it or choose another path")]
    Occupied(String),
    /// A running simulator uses this very path.
    #[error("{} is using this path; stop it or choose another path", holder(.0))]
    InUse(Option<u32>),
    /// The node may not be given to this group.
    #[error("this user may not give it to that group; it has to be a group of the user's own")]
    ForeignGroup,
    /// The baud rate is zero, which means "hang up".
    #[error("the baud rate is 0; give a positive one such as 115200")]
    ZeroBaud,
    /// The system has no pseudo-terminal to give.
    #[error(
        "no pseudo-terminal is free; close some or raise the limit in /proc/sys/kernel/pty/max"
    )]
    NoPtyLeft,
    /// The serial device does not exist.
    #[error("there is no such serial port; check the cable and the name (ls /dev/tty*)")]
    NoSuchDevice,
    /// The serial device may not be opened by this user.
    #[error(
        "this user may not open it; on most systems joining the group dialout and logging in \
         again helps"
    )]
    NotPermitted,
    /// It is a file or a device that is not a serial port.
    #[error("it is not a serial port; those are named as /dev/ttyUSB0 (ls /dev/tty*)")]
    NotSerial,
    /// Another program holds the serial device.
    #[error("another program has it open; close that program")]
    Busy,
    /// The serial device was unplugged while in use.
    #[error("it is gone; was it unplugged?")]
    Unplugged,
    /// A system limit on watching files was reached.
    #[error(
        "too many watches on files; raise fs.inotify.max_user_instances or \
         fs.inotify.max_user_watches with sysctl"
    )]
    WatchLimit,
    /// The URL to listen at is incomplete.
    #[error("{0}")]
    BadUrl(String),
    /// Something else listens at this address.
    #[error("another program listens there; choose another port")]
    AddressInUse,
    /// The address belongs to another machine.
    #[error(
        "it is not an address of this machine; 127.0.0.1 always is, and 0.0.0.0 stands for all"
    )]
    ForeignAddress,
    /// Any other refusal of the system.
    #[error("{call} failed: {reason}")]
    System {
        /// The system call that failed.
        call: &'static str,
        /// Reason in the system's words.
        reason: io::Error,
    },
}

impl PortError {
    /// What went wrong.
    #[must_use]
    pub fn kind(&self) -> &PortErrorKind {
        &self.kind
    }

    /// The path that it is about.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }

    pub(crate) fn new(action: &'static str, path: impl Into<PathBuf>, kind: PortErrorKind) -> Self {
        Self {
            action,
            path: path.into(),
            kind,
        }
    }
}

impl PortErrorKind {
    /// Names the call that failed, for use with `map_err`.
    pub(crate) fn call<E: Into<io::Error>>(call: &'static str) -> impl FnOnce(E) -> Self {
        move |error| Self::System {
            call,
            reason: error.into(),
        }
    }
}

fn holder(pid: &Option<u32>) -> String {
    match pid {
        Some(pid) if *pid == std::process::id() => format!("this simulator itself (process {pid})"),
        Some(pid) => format!("another simulator (process {pid})"),
        None => "another simulator".to_owned(),
    }
}
