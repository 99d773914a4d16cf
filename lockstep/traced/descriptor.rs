//! The descriptors of programs: what they lead to, and whether they are ready.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::net::SocketAddr;
use std::os::fd::{AsFd, AsRawFd as _, OwnedFd};
use std::rc::Rc;

use rustix::buffer::spare_capacity;
use rustix::event::{PollFd, PollFlags, Timespec, epoll};
use rustix::fs::{AtFlags, CWD, FileType, OFlags, StatxFlags, makedev, statx};

use crate::copies;
use crate::port::poll;
use crate::traced::proc::{info_of, members_of_epoll, own_pid};
use crate::traced::sys::{Tid, terminal_of};

/// Descriptors that a process has used, until it closes them; `None` for one that cannot be duplicated.
pub(crate) type Files = Rc<RefCell<BTreeMap<i32, Option<Rc<Descriptor>>>>>;

pub(crate) struct Descriptor {
    /// Our own descriptor of the same file.
    pub(crate) file: OwnedFd,
    pub(crate) status: Status,
    /// It has been opened as `/dev/tty`.
    pub(crate) is_tty: bool,
    /// Its access mode.
    mode: OFlags,
    /// Its peer, if that belongs to the run.
    pub(crate) known_peer: Cell<Option<SocketAddr>>,
    /// Process and descriptor of the run that hold its other end, if known.
    pub(crate) known_holder: Cell<Option<(Tid, i32)>>,
}

/// What a file is.
pub(crate) struct Status {
    pub(crate) kind: FileType,
    /// The device that it is, if it is one; of an open `/dev/tty`, the terminal to which that leads.
    pub(crate) device: u64,
    /// Its file system, and its number there.
    pub(crate) inode: (u64, u64),
}

impl Status {
    /// The status that its file system has cached: a query could go to a program of the run.
    pub(crate) fn of(folder: impl AsFd, path: &str) -> Option<Self> {
        let flags = AtFlags::EMPTY_PATH | AtFlags::STATX_DONT_SYNC;
        let stat = statx(folder, path, flags, StatxFlags::BASIC_STATS).ok()?;
        Some(Self {
            kind: FileType::from_raw_mode(stat.stx_mode.into()),
            device: makedev(stat.stx_rdev_major, stat.stx_rdev_minor),
            inode: (
                makedev(stat.stx_dev_major, stat.stx_dev_minor),
                stat.stx_ino,
            ),
        })
    }

    /// The same of a descriptor of a process.
    pub(crate) fn of_process(process: Tid, fd: i32) -> Option<Self> {
        Self::of(CWD, &format!("/proc/{process}/fd/{fd}"))
    }

    /// Returns whether it is `/dev/tty` with an unknown terminal.
    pub(crate) fn is_tty(&self) -> bool {
        self.kind.is_char_device() && self.device == makedev(5, 0)
    }
}

/// What a poll finds of files.
pub(crate) const EVER_READY: PollFlags = PollFlags::IN
    .union(PollFlags::RDNORM)
    .union(PollFlags::OUT)
    .union(PollFlags::WRNORM);

/// The file system of message queues, as `statfs` numbers it.
pub(crate) const QUEUES: rustix::fs::FsWord = 0x1980_0202;

impl Descriptor {
    pub(crate) fn new(file: OwnedFd) -> Option<Self> {
        let mut status = Status::of(&file, "")?;
        let is_tty = status.is_tty();
        let mode = rustix::fs::fcntl_getfl(&file).ok()? & OFlags::RWMODE;
        if is_tty {
            status.device = terminal_of(&file).unwrap_or(status.device);
        }
        Some(Self {
            file,
            status,
            is_tty,
            mode,
            known_peer: Cell::new(None),
            known_holder: Cell::new(None),
        })
    }

    /// Never waits: files, and devices without end.
    pub(crate) fn never_waits(&self) -> bool {
        match self.status.kind {
            FileType::RegularFile | FileType::Directory | FileType::BlockDevice => true,
            // /dev/mem, null, zero, full and the like.
            FileType::CharacterDevice => rustix::fs::major(self.status.device) == 1,
            _ => false,
        }
    }

    pub(crate) fn is_random(&self) -> bool {
        self.status.kind.is_char_device()
            && rustix::fs::major(self.status.device) == 1
            && matches!(rustix::fs::minor(self.status.device), 8 | 9)
    }

    /// An event counter, a timer, and others that have no file.
    pub(crate) fn is_anonymous(&self) -> bool {
        self.status.kind == FileType::Unknown
    }

    pub(crate) fn is_nonblocking(&self) -> bool {
        rustix::fs::fcntl_getfl(&self.file).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    /// Returns whether it has been opened for reading (`RDONLY`), or for writing (`WRONLY`).
    pub(crate) fn is_for(&self, mode: OFlags) -> bool {
        [mode, OFlags::RDWR].contains(&self.mode)
    }

    /// Returns whether a poll finds one of these flags or an error.
    pub(crate) fn is_ready(&self, flags: PollFlags) -> bool {
        is_any_ready(&mut [PollFd::new(&self.file, flags)])
    }

    /// Takes events of an epoll; returns their count, and their bytes as in a program's memory.
    ///
    /// # Errors
    /// When it is not an epoll.
    pub(crate) fn take_events(&self, most: usize) -> rustix::io::Result<(usize, Vec<u8>)> {
        /// The others follow the next time.
        const MOST: usize = 1024;
        let _copies = copies::none();
        let mut events: Vec<epoll::Event> = Vec::with_capacity(most.min(MOST));
        epoll::wait(
            &self.file,
            spare_capacity(&mut events),
            Some(&Timespec::default()),
        )?;
        let bytes = events.iter().flat_map(|event| {
            let epoll::Event { flags, data } = *event;
            let (flags, data) = (flags.bits().to_ne_bytes(), data.u64().to_ne_bytes());
            flags.into_iter().chain(data)
        });
        Ok((events.len(), bytes.collect()))
    }

    /// Returns whether a write of this length would wait in the kernel for room although a poll reports room: in a
    /// pipe, or in a stream socket.
    pub(crate) fn takes_parts(&self, length: u64) -> bool {
        let is_stream =
            || rustix::net::sockopt::socket_type(&self.file) == Ok(rustix::net::SocketType::STREAM);
        let most = rustix::pipe::PIPE_BUF as u64;
        length > most && (self.status.kind.is_fifo() || self.status.kind.is_socket() && is_stream())
    }

    pub(crate) fn is_unix_datagram(&self) -> bool {
        use rustix::net::{AddressFamily, SocketType, sockopt};
        sockopt::socket_type(&self.file) == Ok(SocketType::DGRAM)
            && sockopt::socket_domain(&self.file) == Ok(AddressFamily::UNIX)
    }

    /// Calls a function while the file does not block (`O_NONBLOCK`). All that have it open share that.
    ///
    /// # Errors
    /// When the system refuses it.
    pub(crate) fn without_waiting<T>(&self, make: impl FnOnce() -> T) -> rustix::io::Result<T> {
        let flags = rustix::fs::fcntl_getfl(&self.file)?;
        rustix::fs::fcntl_setfl(&self.file, flags | OFlags::NONBLOCK)?;
        let made = make();
        // What could be set can be put back.
        let _ = rustix::fs::fcntl_setfl(&self.file, flags);
        Ok(made)
    }

    /// The system's value of it under this name.
    pub(crate) fn info(&self, name: &str) -> Option<String> {
        info_of(own_pid(), self.file.as_raw_fd(), name)
    }

    /// Descriptors in an epoll, as numbers in the processes that added them.
    pub(crate) fn members(&self) -> Vec<(i32, PollFlags)> {
        match self.is_anonymous() {
            true => members_of_epoll(own_pid(), self.file.as_raw_fd()),
            false => Vec::new(),
        }
    }

    /// Its path, as the system tells it.
    pub(crate) fn path(&self) -> Option<String> {
        let path = format!("/proc/self/fd/{}", self.file.as_raw_fd());
        let path = std::fs::read_link(path).ok()?;
        Some(path.to_string_lossy().into_owned())
    }
}

pub(crate) fn is_any_ready(polls: &mut [PollFd<'_>]) -> bool {
    let _copies = copies::none();
    !polls.is_empty() && poll(polls)
}
