//! The descriptors of programs: what they lead to, and whether they are ready.

use std::cell::{Cell, RefCell};
use std::collections::BTreeMap;
use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::ops::RangeInclusive;
use std::os::fd::OwnedFd;
use std::os::unix::fs::MetadataExt as _;
use std::path::PathBuf;
use std::rc::Rc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::fs::{FileType, Mode, OFlags, Stat};
use rustix::process::PidfdGetfdFlags;

use crate::traced::arch::Call;
use crate::traced::entry::{Entry, low};
use crate::traced::memory::Memory;
use crate::traced::signals::Signals;
use crate::traced::sys::Tid;
use crate::traced::tracer::{Halt, Handling, Tracer};
use crate::traced::tree::{number, path_of};
use crate::traced::wait::Wait;

/// Most descriptors of a run of which there are duplicates; beyond that all are made again.
const MOST_KEPT: usize = 64;

/// The descriptors that a process has used, until it closes them; `None` for one that cannot be known.
pub(crate) type Files = Rc<RefCell<BTreeMap<i32, Option<Rc<Descriptor>>>>>;

/// A descriptor that leads outside, and is waited for.
pub(crate) struct Outside {
    descriptor: Rc<Descriptor>,
    flags: PollFlags,
    pub(crate) name: String,
}

pub(crate) struct Descriptor {
    /// Our own descriptor of the same file.
    pub(crate) file: OwnedFd,
    pub(crate) stat: Stat,
    /// Peer of it that was found to be of the run.
    known_peer: Cell<Option<SocketAddr>>,
}

/// What a poll finds of files.
const EVER_READY: PollFlags = PollFlags::IN
    .union(PollFlags::RDNORM)
    .union(PollFlags::OUT)
    .union(PollFlags::WRNORM);

/// The file system of message queues, as `statfs` numbers it.
const QUEUES: rustix::fs::FsWord = 0x1980_0202;

impl Descriptor {
    fn new(file: OwnedFd, stat: Stat) -> Self {
        Self {
            file,
            stat,
            known_peer: Cell::new(None),
        }
    }

    pub(crate) fn kind(&self) -> FileType {
        FileType::from_raw_mode(self.stat.st_mode)
    }

    /// Never waits: files, and devices without end.
    pub(crate) fn never_waits(&self) -> bool {
        match self.kind() {
            FileType::RegularFile | FileType::Directory | FileType::BlockDevice => true,
            // /dev/mem, null, zero, full and the like.
            FileType::CharacterDevice => rustix::fs::major(self.stat.st_rdev) == 1,
            _ => false,
        }
    }

    pub(crate) fn is_random(&self) -> bool {
        let device = self.stat.st_rdev;
        self.kind().is_char_device()
            && rustix::fs::major(device) == 1
            && matches!(rustix::fs::minor(device), 8 | 9)
    }

    pub(crate) fn inode(&self) -> (u64, u64) {
        (self.stat.st_dev, self.stat.st_ino)
    }

    pub(crate) fn is_pipe(&self) -> bool {
        self.kind().is_fifo()
    }

    pub(crate) fn is_socket(&self) -> bool {
        self.kind().is_socket()
    }

    /// An event counter, a timer, and others that have no file of their own.
    pub(crate) fn is_anonymous(&self) -> bool {
        self.kind() == FileType::Unknown
    }

    pub(crate) fn is_nonblocking(&self) -> bool {
        rustix::fs::fcntl_getfl(&self.file).is_ok_and(|flags| flags.contains(OFlags::NONBLOCK))
    }

    pub(crate) fn is_for_writing(&self) -> bool {
        rustix::fs::fcntl_getfl(&self.file).is_ok_and(|flags| flags.contains(OFlags::WRONLY))
    }

    /// Returns whether one of these is said of it, or an error.
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
    !polls.is_empty()
        && rustix::event::poll(polls, Some(&Timespec::default())).is_ok_and(|count| count > 0)
}

/// Waits until one of them is ready; whether one is.
pub(crate) fn wait(all: &[Outside], most: Duration) -> io::Result<bool> {
    let mut polls: Vec<PollFd<'_>> = all
        .iter()
        .map(|one| PollFd::new(&one.descriptor.file, one.flags))
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
    pub(crate) fn descriptor(&self, process: Tid, fd: i32) -> Option<Rc<Descriptor>> {
        let owner = self.processes.get(&process)?;
        if let Some(known) = owner.files.borrow().get(&fd) {
            return known.clone();
        }
        let file = self.duplicate(process, owner.handle.as_ref()?, fd)?;
        self.keep(process, fd, Some(file))
    }

    /// Returns whether it is known what a descriptor leads to, or that it cannot be.
    pub(crate) fn is_known(&self, process: Tid, fd: i32) -> bool {
        let owner = self.processes.get(&process);
        self.descriptor(process, fd).is_some()
            || owner.is_none_or(|owner| owner.files.borrow().contains_key(&fd))
    }

    /// Keeps a duplicate of a descriptor until the process closes that.
    pub(crate) fn keep(
        &self,
        process: Tid,
        fd: i32,
        file: Option<OwnedFd>,
    ) -> Option<Rc<Descriptor>> {
        let tables = || self.processes.values().map(|process| &process.files);
        // Those that are passed cost much, and are bounded by the system.
        let kept: usize = tables().map(|files| files.borrow().len()).sum();
        if kept >= MOST_KEPT && self.passage.is_none() {
            tables().for_each(|files| files.borrow_mut().clear());
        }
        let stat = file.as_ref().and_then(|file| rustix::fs::fstat(file).ok());
        let descriptor = file
            .zip(stat)
            .map(|(file, stat)| Descriptor::new(file, stat));
        let descriptor = descriptor.map(Rc::new);
        let is_device = |one: &Rc<Descriptor>| one.kind().is_char_device();
        if descriptor.as_ref().is_some_and(is_device) {
            self.ports_used.set(true);
        }
        let files = &self.processes.get(&process)?.files;
        files.borrow_mut().insert(fd, descriptor.clone());
        descriptor
    }

    /// Our own descriptor of what one of a process leads to. Programs may name any number.
    fn duplicate(&self, process: Tid, handle: &OwnedFd, fd: i32) -> Option<OwnedFd> {
        if fd < 0 {
            return None;
        }
        if self.passage.is_none() {
            return rustix::process::pidfd_getfd(handle, fd, PidfdGetfdFlags::empty()).ok();
        }
        // What never waits need not be passed: its path says enough.
        let path = format!("/proc/{process}/fd/{fd}");
        let file = rustix::fs::open(path, OFlags::PATH | OFlags::CLOEXEC, Mode::empty()).ok()?;
        let stat = rustix::fs::fstat(&file).ok()?;
        let is_queue = rustix::fs::fstatfs(&file).is_ok_and(|one| one.f_type == QUEUES);
        let one = Descriptor::new(file, stat);
        (one.never_waits() && !is_queue && !self.lists.has(&one)).then_some(one.file)
    }

    /// Descriptors of a process are about to be closed, or to lead elsewhere.
    pub(crate) fn close(&mut self, process: Tid, fds: RangeInclusive<i32>) -> Handling {
        if let Some(process) = self.processes.get(&process) {
            let mut files = process.files.borrow_mut();
            files.retain(|fd, _| !fds.contains(fd));
        }
        self.ports_used.set(true);
        Handling::Make
    }

    pub(crate) fn port_of(&self, descriptor: &Descriptor) -> Option<usize> {
        if !descriptor.kind().is_char_device() {
            return None;
        }
        let device = descriptor.stat.st_rdev;
        self.ports.iter().position(|port| port.is_device(device))
    }

    /// What a poll of these descriptors of a thread finds of each.
    pub(crate) fn readiness(&self, tid: Tid, set: &[(i32, PollFlags)]) -> Vec<PollFlags> {
        let process = self.process_of(tid);
        let files = set.iter().map(|(fd, _)| self.descriptor(process, *fd));
        let files: Vec<Option<Rc<Descriptor>>> = files.collect();
        let mut found = vec![PollFlags::empty(); set.len()];
        let (mut polls, mut places) = (Vec::new(), Vec::new());
        for (at, ((fd, flags), file)) in set.iter().zip(&files).enumerate() {
            // A poll from outside would take an epoll's note of a signal away.
            if flags.contains(PollFlags::IN) && self.has_signal(tid, *fd) {
                found[at] = PollFlags::IN;
                continue;
            }
            match file {
                Some(file) => match self.port_of(file) {
                    Some(port) => found[at] = self.ports[port].readiness() & *flags,
                    None => {
                        polls.push(PollFd::new(&file.file, *flags));
                        places.push(at);
                    }
                },
                None if *fd < 0 && flags.is_empty() => {}
                // One that cannot be passed; else there is none.
                None if path_of(process, *fd).is_some() => found[at] = EVER_READY & *flags,
                None => found[at] = PollFlags::NVAL,
            }
        }
        if is_any_ready(&mut polls) {
            for (at, poll) in places.into_iter().zip(&polls) {
                found[at] = match poll.revents() {
                    // A duplicate of what never waits may be a path alone.
                    PollFlags::NVAL => EVER_READY & set[at].1,
                    revents => revents,
                };
            }
        }
        found
    }

    /// Returns whether a descriptor of a thread is a `signalfd`, or an epoll with one, that has a signal
    /// for it. The system would answer a poll of our duplicate for this program's own signals.
    pub(crate) fn has_signal(&self, tid: Tid, fd: i32) -> bool {
        let process = self.process_of(tid);
        if !self.has_signalfd {
            return false;
        }
        match info_of(process, fd, "sigmask:").and_then(|mask| number(&mask)) {
            Some(mask) => Signals::of(process, tid).is_some_and(|all| all.pending & mask != 0),
            None => members_of_epoll(process, fd)
                .into_iter()
                .any(|(member, _)| self.has_signal(tid, member)),
        }
    }

    /// Returns whether a process of the run has a port open.
    pub(crate) fn holds_port(&self, index: usize) -> bool {
        let port = &self.ports[index];
        self.processes.keys().any(|pid| {
            files_of(*pid)
                .any(|path| std::fs::metadata(path).is_ok_and(|file| port.is_device(file.rdev())))
        })
    }

    /// Lists what is waited for that no process of the run can bring about.
    pub(crate) fn outside_waits(&self) -> Vec<Outside> {
        let mut all = Vec::new();
        for thread in self.threads.values() {
            let set = match thread.hold().map(|hold| &hold.wait) {
                Some(Wait::Descriptor { fd, flags, .. }) => vec![(*fd, *flags)],
                Some(Wait::Poll { set, .. }) => set.clone(),
                _ => continue,
            };
            let find = |fd| self.descriptor(thread.process, fd);
            // One epoll in another is polled as one descriptor.
            let members = set.into_iter().flat_map(|(fd, flags)| match find(fd) {
                Some(one) if one.is_anonymous() => members_of_epoll(thread.process, fd),
                _ => vec![(fd, flags)],
            });
            all.extend(members.filter_map(|(fd, flags)| {
                let descriptor = find(fd)?;
                let name = self.outside_name(thread.process, fd, &descriptor)?;
                Some(Outside {
                    descriptor,
                    flags,
                    name,
                })
            }));
        }
        all
    }

    fn outside_name(&self, process: Tid, fd: i32, descriptor: &Descriptor) -> Option<String> {
        if descriptor.is_socket() {
            return self.peer(process, fd);
        }
        if !descriptor.kind().is_char_device()
            || descriptor.never_waits()
            || self.port_of(descriptor).is_some()
        {
            return None;
        }
        // A port whose cable has been pulled is still one, and says so at once.
        let path = path_of(process, fd)?;
        let path = path.to_string_lossy();
        (!path.ends_with(" (deleted)")).then(|| path.into_owned())
    }

    /// Notes a socket that sends to an address of another machine, and so may get an answer.
    pub(crate) fn note_destination(
        &mut self,
        entry: Entry,
        descriptor: &Descriptor,
    ) -> Result<(), Halt> {
        let Entry { tid, call, a, .. } = entry;
        let memory = Memory(tid);
        let (address, length) = match call {
            Call::Sendto => (a[4], low(a[5])),
            // Of several messages, the first.
            Call::Sendmsg | Call::Sendmmsg if a[1] != 0 => {
                (memory.read_u64(a[1])?, memory.read_u32(a[1] + 8)?)
            }
            _ => return Ok(()),
        };
        let mut bytes = [0; 24];
        let length = usize::try_from(length).unwrap_or(0).min(bytes.len());
        if address == 0 || !descriptor.is_socket() || length < 8 {
            return Ok(());
        }
        memory.read(address, bytes.get_mut(..length).unwrap_or_default())?;
        let [_, _, _, _, a, b, c, d, v6 @ ..] = bytes;
        let ip = match i32::from(u16::from_ne_bytes([bytes[0], bytes[1]])) {
            libc::AF_INET => IpAddr::from([a, b, c, d]),
            libc::AF_INET6 => IpAddr::from(v6).to_canonical(),
            _ => return Ok(()),
        };
        let is_group = ip.is_multicast() || ip == IpAddr::from([255; 4]) || ip.is_unspecified();
        // Only an address of this machine can be bound to.
        if !is_group && !ip.is_loopback() && UdpSocket::bind((ip, 0)).is_err() {
            self.outside_sockets.insert(descriptor.inode());
        }
        Ok(())
    }

    /// Returns the name of the other end of a socket, unless that is of the run.
    pub(crate) fn peer(&self, process: Tid, fd: i32) -> Option<String> {
        let descriptor = self.descriptor(process, fd)?;
        let file = &descriptor.file;
        let is_stream = rustix::net::sockopt::socket_type(file)
            .is_ok_and(|kind| kind == rustix::net::SocketType::STREAM);
        let word = if is_stream { "tcp" } else { "udp" };
        let own = rustix::net::getsockname(file).ok()?;
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
                // The tables of the system take long to read.
                let is_ours = descriptor.known_peer.get() == Some(peer)
                    || peer.ip().to_canonical().is_loopback()
                        && self.is_of_run(is_stream, peer, own);
                descriptor.known_peer.set(Some(peer).filter(|_| is_ours));
                (!is_ours).then(|| format!("{word} {peer}"))
            }
            // A socket that listens waits for those of the run: no other program knows of it.
            None if is_stream || own.ip().to_canonical().is_loopback() => None,
            // Who has sent to others, and to none of them alone, as groups do, may be answered by them.
            None => {
                let is_known = self.outside_sockets.contains(&descriptor.inode());
                is_known.then(|| format!("{word} {own}"))
            }
        }
    }

    /// Returns whether a socket of the run, or of this program, has this address and this peer, or
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

fn own_pid() -> i32 {
    rustix::process::getpid().as_raw_nonzero().get()
}

pub(crate) fn files_of(pid: Tid) -> impl Iterator<Item = PathBuf> {
    let entries = std::fs::read_dir(format!("/proc/{pid}/fd"));
    let entries = entries.into_iter().flatten();
    entries.filter_map(|entry| entry.ok().map(|entry| entry.path()))
}

/// The text under this name in what the system says of a descriptor.
pub(crate) fn info_of(process: Tid, fd: i32, name: &str) -> Option<String> {
    let info = std::fs::read_to_string(format!("/proc/{process}/fdinfo/{fd}")).ok()?;
    let value = info.lines().find_map(|line| line.strip_prefix(name))?;
    Some(value.trim().to_owned())
}

pub(crate) fn members_of_epoll(process: Tid, fd: i32) -> Vec<(i32, PollFlags)> {
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
