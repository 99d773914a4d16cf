//! The descriptors of programs: what they lead to, and whether they are ready.

use std::io;
use std::net::SocketAddr;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{FileType, OFlags, Stat};
use rustix::process::PidfdGetfdFlags;

use crate::traced::sys::Tid;
use crate::traced::tracer::Tracer;
use crate::traced::tree::{Process, Thread, path_of};
use crate::traced::wait::Wait;

/// A descriptor that leads outside, and is waited for.
pub(crate) struct Outside {
    file: OwnedFd,
    flags: PollFlags,
    /// Name of it, for people.
    pub(crate) name: String,
}

/// File that a descriptor leads to.
pub(crate) struct Descriptor {
    /// Our own descriptor of the same file.
    pub(crate) file: OwnedFd,
    pub(crate) stat: Stat,
}

impl Descriptor {
    /// Never waits: files, and devices without end.
    pub(crate) fn never_waits(&self) -> bool {
        match FileType::from_raw_mode(self.stat.st_mode) {
            FileType::RegularFile | FileType::Directory | FileType::BlockDevice => true,
            // /dev/mem, null, zero, full and the like.
            FileType::CharacterDevice => rustix::fs::major(self.stat.st_rdev) == 1,
            _ => false,
        }
    }

    /// `/dev/random` or `/dev/urandom`.
    pub(crate) fn is_random(&self) -> bool {
        let device = self.stat.st_rdev;
        FileType::from_raw_mode(self.stat.st_mode).is_char_device()
            && rustix::fs::major(device) == 1
            && matches!(rustix::fs::minor(device), 8 | 9)
    }

    /// Its device and inode, which nothing else has.
    pub(crate) fn inode(&self) -> (u64, u64) {
        (self.stat.st_dev, self.stat.st_ino)
    }

    pub(crate) fn is_pipe(&self) -> bool {
        FileType::from_raw_mode(self.stat.st_mode).is_fifo()
    }

    pub(crate) fn is_socket(&self) -> bool {
        FileType::from_raw_mode(self.stat.st_mode).is_socket()
    }

    /// An event counter, a timer, and others that have no file of their own.
    pub(crate) fn is_anonymous(&self) -> bool {
        FileType::from_raw_mode(self.stat.st_mode) == FileType::Unknown
    }

    /// Calls on it return at once.
    pub(crate) fn is_nonblocking(&self) -> bool {
        rustix::fs::fcntl_getfl(&self.file).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    /// Tells whether one of these is said of it, or an error.
    pub(crate) fn is_ready(&self, flags: PollFlags) -> bool {
        is_any_ready(&mut [PollFd::new(&self.file, flags)])
    }

    /// A pipe takes so many bytes without waiting.
    pub(crate) fn has_room(&self, bytes: usize) -> bool {
        if !self.is_ready(PollFlags::OUT) {
            return false;
        }
        if bytes <= rustix::pipe::PIPE_BUF || !self.is_pipe() {
            return true;
        }
        let size = rustix::pipe::fcntl_getpipe_size(&self.file).unwrap_or(0);
        let full = rustix::io::ioctl_fionread(&self.file).unwrap_or(0);
        let full = usize::try_from(full).unwrap_or(usize::MAX);
        // More than it ever takes goes in pieces.
        full == 0 || size.saturating_sub(full) >= bytes
    }
}

fn is_any_ready(polls: &mut [PollFd<'_>]) -> bool {
    rustix::event::poll(polls, Some(&Timespec::default())).is_ok_and(|count| count > 0)
}

/// Waits until one of them is ready; whether one is.
pub(crate) fn wait(all: &[Outside], most: Duration) -> io::Result<bool> {
    let mut polls: Vec<PollFd<'_>> = all
        .iter()
        .map(|one| PollFd::new(&one.file, one.flags))
        .collect();
    let most = Timespec::try_from(most).map_err(io::Error::other)?;
    match rustix::event::poll(&mut polls, Some(&most)) {
        Ok(count) => Ok(count > 0),
        Err(rustix::io::Errno::INTR) => Ok(false),
        Err(error) => Err(error.into()),
    }
}

impl Tracer<'_> {
    /// Finds what a descriptor of a process leads to; `None` if there is none.
    pub(crate) fn descriptor(&self, process: Tid, fd: i32) -> Option<Descriptor> {
        let file = duplicate(self.processes.get(&process)?, fd)?;
        let stat = rustix::fs::fstat(&file).ok()?;
        Some(Descriptor { file, stat })
    }

    /// The port that a descriptor leads to.
    pub(crate) fn port_of(&self, descriptor: &Descriptor) -> Option<usize> {
        if !FileType::from_raw_mode(descriptor.stat.st_mode).is_char_device() {
            return None;
        }
        let device = descriptor.stat.st_rdev;
        self.ports.iter().position(|port| port.is_device(device))
    }

    /// Tells whether one of these descriptors is ready, or none at all.
    pub(crate) fn is_one_ready(&self, process: Tid, set: &[(i32, PollFlags)]) -> bool {
        let Some(owner) = self.processes.get(&process) else {
            return true;
        };
        let mut files = Vec::with_capacity(set.len());
        for (fd, flags) in set {
            match duplicate(owner, *fd) {
                Some(file) => files.push((file, *flags)),
                // The system says what is wrong with it.
                None => return true,
            }
        }
        let polls = files.iter().map(|(file, flags)| PollFd::new(file, *flags));
        let mut polls: Vec<PollFd<'_>> = polls.collect();
        is_any_ready(&mut polls)
    }

    /// Tells whether a process of the run has a port open.
    pub(crate) fn holds_port(&self, index: usize) -> bool {
        let Some(port) = self.ports.get(index) else {
            return false;
        };
        self.processes.keys().any(|pid| {
            files_of(*pid)
                .any(|path| std::fs::metadata(path).is_ok_and(|file| port.is_device(file.rdev())))
        })
    }

    /// Lists what is waited for that nobody of the run can bring about.
    pub(crate) fn outside_waits(&self) -> Vec<Outside> {
        let mut all = Vec::new();
        for thread in self.threads.values() {
            let Some(hold) = thread.hold() else { continue };
            match &hold.wait {
                Wait::Descriptor { fd, flags, .. } => {
                    self.add_outside(thread, *fd, *flags, &mut all)
                }
                Wait::Poll { set, .. } => {
                    for (fd, flags) in set {
                        self.add_outside(thread, *fd, *flags, &mut all);
                    }
                }
                _ => {}
            }
        }
        all
    }

    fn add_outside(&self, thread: &Thread, fd: i32, flags: PollFlags, all: &mut Vec<Outside>) {
        let process = thread.process;
        let Some(descriptor) = self.descriptor(process, fd) else {
            return;
        };
        if descriptor.is_anonymous() {
            for (fd, flags) in members_of_epoll(process, fd) {
                // One epoll in another is looked at as one descriptor.
                if let Some(name) = self.outside_name(process, fd)
                    && let Some(member) = self.descriptor(process, fd)
                {
                    all.push(Outside {
                        file: member.file,
                        flags,
                        name,
                    });
                }
            }
        } else if let Some(name) = self.outside_name(process, fd) {
            all.push(Outside {
                file: descriptor.file,
                flags,
                name,
            });
        }
    }

    /// Name of what a descriptor leads to, if that is outside.
    fn outside_name(&self, process: Tid, fd: i32) -> Option<String> {
        let descriptor = self.descriptor(process, fd)?;
        if descriptor.is_socket() {
            return self.peer(process, fd);
        }
        let kind = FileType::from_raw_mode(descriptor.stat.st_mode);
        let is_other_device = kind.is_char_device()
            && !descriptor.never_waits()
            && self.port_of(&descriptor).is_none();
        // A port whose cable has been pulled is still one, and says so at once.
        let path = path_of(process, fd)?;
        let path = path.to_string_lossy();
        let is_gone = path.ends_with(" (deleted)");
        (is_other_device && !is_gone).then(|| path.into_owned())
    }

    /// Finds who is at the other end of a socket, if that is nobody of the run.
    pub(crate) fn peer(&self, process: Tid, fd: i32) -> Option<String> {
        let descriptor = self.descriptor(process, fd)?;
        let file = &descriptor.file;
        let is_stream = rustix::net::sockopt::socket_type(file)
            .is_ok_and(|kind| kind == rustix::net::SocketType::STREAM);
        let word = if is_stream { "tcp" } else { "udp" };
        let Ok(own) = rustix::net::getsockname(file) else {
            return None;
        };
        let family = own.address_family();
        if family == rustix::net::AddressFamily::UNIX {
            let peer = rustix::net::sockopt::socket_peercred(file).ok()?;
            let pid = peer.pid.as_raw_nonzero().get();
            let is_ours = self.processes.contains_key(&pid) || pid == own_pid();
            return (!is_ours).then(|| format!("a unix socket of process {pid}"));
        }
        let own = SocketAddr::try_from(own).ok()?;
        match rustix::net::getpeername(file).ok().flatten() {
            Some(peer) => {
                let peer = SocketAddr::try_from(peer).ok()?;
                let is_ours =
                    peer.ip().to_canonical().is_loopback() && self.is_of_run(is_stream, peer, own);
                (!is_ours).then(|| format!("{word} {peer}"))
            }
            // Whoever listens waits for those of the run; nobody else is told of it.
            None if is_stream || own.ip().to_canonical().is_loopback() => None,
            None => Some(format!("{word} {own}")),
        }
    }

    /// Tells whether a socket of the run, or of this program, has this address and this peer, or
    /// listens there.
    fn is_of_run(&self, is_stream: bool, address: SocketAddr, peer: SocketAddr) -> bool {
        let kind = if is_stream { "tcp" } else { "udp" };
        let tables = [kind.to_owned(), format!("{kind}6")];
        let inodes: Vec<String> = tables
            .iter()
            .filter_map(|table| std::fs::read_to_string(format!("/proc/net/{table}")).ok())
            .flat_map(|text| {
                let lines: Vec<String> = text
                    .lines()
                    .skip(1)
                    .filter_map(|line| {
                        let words: Vec<&str> = line.split_whitespace().collect();
                        let port = |at: usize| {
                            let (_, port) = words.get(at)?.rsplit_once(':')?;
                            u16::from_str_radix(port, 16).ok()
                        };
                        // 0A is a socket that listens.
                        let fits = port(1)? == address.port()
                            && (port(2)? == peer.port() || words.get(3) == Some(&"0A"));
                        fits.then(|| words.get(9).map(|inode| format!("socket:[{inode}]")))?
                    })
                    .collect();
                lines
            })
            .collect();
        let mut processes = self.processes.keys().copied().chain([own_pid()]);
        processes.any(|pid| {
            files_of(pid).any(|path| {
                std::fs::read_link(path)
                    .is_ok_and(|to| inodes.iter().any(|inode| to.as_os_str() == inode.as_str()))
            })
        })
    }
}

/// Our own descriptor of what one of a process leads to. Programs may name any number.
fn duplicate(process: &Process, fd: i32) -> Option<OwnedFd> {
    if fd < 0 {
        return None;
    }
    rustix::process::pidfd_getfd(&process.handle, fd, PidfdGetfdFlags::empty()).ok()
}

fn own_pid() -> i32 {
    rustix::process::getpid().as_raw_nonzero().get()
}

/// The links to the files that a process has open.
pub(crate) fn files_of(pid: Tid) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd"));
    let entries = entries.into_iter().flatten();
    entries.filter_map(|entry| entry.ok().map(|entry| entry.path()))
}

/// Number that the system tells of a descriptor under this name.
pub(crate) fn info_of(process: Tid, fd: i32, name: &str) -> Option<i32> {
    let info = std::fs::read_to_string(format!("/proc/{process}/fdinfo/{fd}")).ok()?;
    let value = info.lines().find_map(|line| line.strip_prefix(name))?;
    value.trim().parse().ok()
}

/// Descriptors that an epoll descriptor watches.
fn members_of_epoll(process: Tid, fd: i32) -> Vec<(i32, PollFlags)> {
    let text = std::fs::read_to_string(format!("/proc/{process}/fdinfo/{fd}"));
    let text = text.unwrap_or_default();
    text.lines()
        .filter_map(|line| {
            let mut words = line.strip_prefix("tfd:")?.split_whitespace();
            let fd = words.next()?.parse().ok()?;
            let events = words.skip_while(|word| *word != "events:").nth(1)?;
            let events = u32::from_str_radix(events, 16).ok()?;
            let events = u16::try_from(events & 0xFFFF).ok()?;
            Some((fd, PollFlags::from_bits_truncate(events)))
        })
        .collect()
}
