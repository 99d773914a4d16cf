//! Waits for what is outside of the run.

use std::io;
use std::net::{IpAddr, SocketAddr, UdpSocket};
use std::rc::Rc;
use std::time::Duration;

use rustix::event::{PollFd, PollFlags, Timespec};
use rustix::net::{AddressFamily, SocketAddrUnix};

use crate::traced::arch::{self, Syscall};
use crate::traced::descriptor::{Descriptor, Status};
use crate::traced::memory::Memory;
use crate::traced::proc::{
    descriptors_of, files_of, info_of, kernel_state, name_of, own_pid, syscall_of,
};
use crate::traced::sys::Tid;
use crate::traced::syscall::{Entry, Halt, call_name, int, low};
use crate::traced::tracer::Tracer;
use crate::traced::wait::{Rest, Retried, Wait};

/// A descriptor that leads outside, and is waited for.
pub(crate) struct Outside {
    descriptor: Rc<Descriptor>,
    /// Empty if no poll reports it.
    flags: PollFlags,
    pub(crate) name: String,
}

/// Waits until one of them is ready; returns whether one is.
pub(crate) fn wait(all: &[Outside], most: Duration) -> io::Result<bool> {
    let mut polls: Vec<PollFd<'_>> = all
        .iter()
        .filter(|one| !one.flags.is_empty())
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
    /// Lists what is waited for that no process of the run can bring about.
    pub(crate) fn outside_waits(&self) -> Vec<Outside> {
        let mut all = Vec::new();
        for (tid, thread) in &self.tree.threads {
            let set = match thread.block().map(|block| &block.wait) {
                Some(Wait::Poll { set, .. }) => set,
                Some(Wait::Transfer(rest)) => {
                    all.extend(match rest.flags {
                        PollFlags::OUT if rest.of.is_unix_datagram() => {
                            self.outside_receiver(*tid, rest)
                        }
                        flags => self.outside(&rest.of, flags),
                    });
                    continue;
                }
                Some(Wait::Again(retried)) => {
                    all.extend(self.outside_lock(thread.process, retried));
                    continue;
                }
                _ => continue,
            };
            for (file, flags) in self.polled_files(thread.process, set) {
                all.extend(self.outside(&file, flags));
            }
        }
        all
    }

    /// The receiver of a datagram that has no room, if it is outside of the run. No poll reports its room.
    fn outside_receiver(&self, tid: Tid, rest: &Rest) -> Option<Outside> {
        let (number, a) = rest.whole;
        let (address, length) = destination(tid, arch::call(number)?.0, a).ok()?;
        if address == 0 {
            return self.outside(&rest.of, rest.flags);
        }
        // Behind the family.
        let mut bytes = vec![0; usize::try_from(length).ok()?.min(110).checked_sub(2)?];
        Memory(tid).read(address + 2, &mut bytes).ok()?;
        let name = match *bytes.first()? {
            0 => bytes,
            _ => bytes.split(|byte| *byte == 0).next()?.to_vec(),
        };
        Some(Outside {
            descriptor: Rc::clone(&rest.of),
            flags: PollFlags::empty(),
            name: self.outside_unix(&name)?,
        })
    }

    /// Returns the name of a Unix socket, with the first byte 0 if it is abstract, unless the socket belongs to the
    /// run or does not exist.
    fn outside_unix(&self, name: &[u8]) -> Option<String> {
        let name = String::from_utf8_lossy(name).replace('\0', "@");
        let table = std::fs::read_to_string("/proc/net/unix").ok()?;
        let lines = table
            .lines()
            .filter(|line| line.ends_with(&format!(" {name}")));
        let inodes = lines.filter_map(|line| line.split_whitespace().nth(6));
        let inodes: Vec<&str> = inodes.collect();
        let is_outside = !inodes.is_empty() && !self.holds_socket(&inodes);
        is_outside.then(|| format!("a unix socket at {name}"))
    }

    /// The lock of a file that is tried again and again, while a program outside of the run has it.
    fn outside_lock(&self, process: Tid, retried: &Retried) -> Option<Outside> {
        let (number, [fd, ..]) = retried.call;
        if ![libc::SYS_flock, libc::SYS_fcntl].contains(&number) {
            return None;
        }
        let descriptor = self.descriptor(process, int(fd))?;
        let (device, inode) = descriptor.status.inode;
        let [major, minor] = [rustix::fs::major(device), rustix::fs::minor(device)];
        let place = format!("{major:02x}:{minor:02x}:{inode}");
        // As "1: FLOCK ADVISORY WRITE 123 08:01:456 0 EOF", behind "->" if it waits.
        let locks = std::fs::read_to_string("/proc/locks").ok()?;
        let is_outside = |pid: &str| {
            let pid = pid.parse();
            pid.is_ok_and(|pid| {
                !self.tree.processes.contains_key(&pid) && kernel_state(pid, pid).is_some()
            })
        };
        let mut lines = locks
            .lines()
            .map(|line| line.split_whitespace().collect::<Vec<_>>());
        let is_held = lines.any(|words| matches!(words[..], [_, _, _, _, pid, at, ..] if at == place && is_outside(pid)));
        is_held.then(|| Outside {
            name: format!("a lock of {}", descriptor.path().unwrap_or_default()),
            flags: PollFlags::empty(),
            descriptor,
        })
    }

    fn outside(&self, descriptor: &Rc<Descriptor>, flags: PollFlags) -> Option<Outside> {
        let name = self.outside_name(descriptor, flags)?;
        Some(Outside {
            descriptor: Rc::clone(descriptor),
            flags,
            name,
        })
    }

    fn outside_name(&self, descriptor: &Descriptor, flags: PollFlags) -> Option<String> {
        if descriptor.status.kind.is_socket() {
            return self.peer(descriptor);
        }
        if descriptor.status.kind.is_fifo() {
            let other = if flags.contains(PollFlags::OUT) {
                libc::O_RDONLY
            } else {
                libc::O_WRONLY
            };
            let is_held = self.is_held(descriptor, |pid, fd| {
                let mode =
                    info_of(pid, fd, "flags:").and_then(|text| i32::from_str_radix(&text, 8).ok());
                mode.is_some_and(|mode| [other, libc::O_RDWR].contains(&(mode & libc::O_ACCMODE)))
                    && Status::of_process(pid, fd)
                        .is_some_and(|one| one.inode == descriptor.status.inode)
            });
            return if is_held { None } else { descriptor.path() };
        }
        if !descriptor.status.kind.is_char_device()
            || descriptor.never_waits()
            || self.port_of(descriptor).is_some()
        {
            return None;
        }
        // A port whose cable has been pulled is still one, and says so at once.
        let path = descriptor
            .path()
            .filter(|path| !path.ends_with(" (deleted)"))?;
        let device = descriptor.status.device;
        let is_of_run = match (rustix::fs::major(device), rustix::fs::minor(device)) {
            // The master of a pseudo-terminal itself.
            (5, 2) => true,
            (136, index) => {
                let index = Some(index.to_string());
                self.is_held(descriptor, |pid, fd| {
                    info_of(pid, fd, "tty-index:") == index
                })
            }
            _ => false,
        };
        (!is_of_run).then_some(path)
    }

    /// Returns whether a process of the run has a descriptor that is the other end of one.
    fn is_held(&self, descriptor: &Descriptor, is_it: impl Fn(Tid, i32) -> bool) -> bool {
        // Checking all of them is slow.
        let known = descriptor.known_holder.get();
        let holder = known.filter(|(pid, fd)| is_it(*pid, *fd)).or_else(|| {
            let processes = self.tree.processes.keys();
            let mut all = processes.flat_map(|pid| descriptors_of(*pid).map(|fd| (*pid, fd)));
            all.find(|(pid, fd)| is_it(*pid, *fd))
        });
        descriptor.known_holder.set(holder);
        holder.is_some()
    }

    /// Notes a socket that sends to an address of another machine, and so may get an answer.
    pub(crate) fn record_destination(
        &mut self,
        entry: Entry,
        descriptor: &Descriptor,
    ) -> Result<(), Halt> {
        let Entry { tid, call, a, .. } = entry;
        let (address, length) = destination(tid, call, a)?;
        if address == 0 || !descriptor.status.kind.is_socket() {
            return Ok(());
        }
        let Some(address) = read_address(tid, address, length)? else {
            return Ok(());
        };
        let ip = address.ip();
        let is_group = ip.is_multicast() || ip == IpAddr::from([255; 4]) || ip.is_unspecified();
        // Only an address of this machine can be bound to.
        if !is_group && !ip.is_loopback() && UdpSocket::bind((ip, 0)).is_err() {
            self.descriptors
                .outside_sockets
                .insert(descriptor.status.inode);
        }
        Ok(())
    }

    /// Returns the name of the other end of a socket, unless that is of the run.
    fn peer(&self, descriptor: &Descriptor) -> Option<String> {
        let file = &descriptor.file;
        let is_stream = rustix::net::sockopt::socket_type(file)
            .is_ok_and(|kind| kind == rustix::net::SocketType::STREAM);
        let word = if is_stream { "tcp" } else { "udp" };
        let own = rustix::net::getsockname(file).ok()?;
        let family = own.address_family();
        if family == AddressFamily::UNIX {
            // Any program may send to a socket that is not connected.
            if descriptor.is_unix_datagram() {
                let peer = rustix::net::getpeername(file).ok()??;
                let peer = SocketAddrUnix::try_from(peer).ok()?;
                let name = match peer.abstract_name() {
                    Some(name) => [b"\0", name].concat(),
                    None => peer.path()?.to_bytes().to_vec(),
                };
                return self.outside_unix(&name);
            }
            let peer = rustix::net::sockopt::socket_peercred(file).ok()?;
            let pid = peer.pid.as_raw_nonzero().get();
            let is_ours = self.tree.processes.contains_key(&pid) || pid == own_pid();
            return (!is_ours).then(|| format!("a unix socket of process {pid}"));
        }
        // As for a CAN bus, or Bluetooth.
        let known = [
            AddressFamily::INET,
            AddressFamily::INET6,
            AddressFamily::NETLINK,
        ];
        if !known.contains(&family) {
            return Some(format!("a socket of address family {}", family.as_raw()));
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
            // A listening socket waits for programs of the run: no other program knows it.
            None if is_stream || own.ip().to_canonical().is_loopback() => None,
            // A socket that has sent to others without a connection, as to a group, may get answers from them.
            None => {
                let known = &self.descriptors.outside_sockets;
                let is_known = known.contains(&descriptor.status.inode);
                is_known.then(|| format!("{word} {own}"))
            }
        }
    }

    /// Returns whether a socket of the run, or of this program, has this address and this peer, or
    /// listens there.
    fn is_of_run(&self, is_stream: bool, address: SocketAddr, peer: SocketAddr) -> bool {
        let kind = if is_stream { "tcp" } else { "udp" };
        let mut inodes = Vec::new();
        for table in [kind, &format!("{kind}6")] {
            let text = std::fs::read_to_string(format!("/proc/net/{table}")).unwrap_or_default();
            for line in text.lines().skip(1) {
                let words: Vec<&str> = line.split_whitespace().collect();
                let ends_in = |at: usize, port: u16| {
                    let (_, found) = words.get(at)?.rsplit_once(':')?;
                    Some(u16::from_str_radix(found, 16) == Ok(port))
                };
                // 0A is a socket that listens.
                let is_peer = ends_in(2, peer.port()) == Some(true) || words.get(3) == Some(&"0A");
                if is_peer && ends_in(1, address.port()) == Some(true) {
                    inodes.extend(words.get(9).map(|inode| (*inode).to_owned()));
                }
            }
        }
        self.holds_socket(&inodes)
    }

    /// Returns whether a process of the run, or this program, has one of these sockets.
    fn holds_socket(&self, inodes: &[impl AsRef<str>]) -> bool {
        let names = inodes
            .iter()
            .map(|inode| format!("socket:[{}]", inode.as_ref()));
        let names: Vec<String> = names.collect();
        let mut processes = self.tree.processes.keys().copied().chain([own_pid()]);
        processes.any(|pid| {
            files_of(pid).any(|path| {
                std::fs::read_link(path)
                    .is_ok_and(|to| names.iter().any(|name| to.as_os_str() == name.as_str()))
            })
        })
    }
}

/// Where the address lies to which a syscall sends, and its length; of several messages, of the first.
fn destination(tid: Tid, call: Syscall, a: [u64; 6]) -> io::Result<(u64, u32)> {
    let memory = Memory(tid);
    Ok(match call {
        Syscall::Sendto => (a[4], low(a[5])),
        Syscall::Sendmsg | Syscall::Sendmmsg if a[1] != 0 => {
            (memory.read_u64(a[1])?, memory.read_u32(a[1] + 8)?)
        }
        _ => (0, 0),
    })
}

/// Reads an address of the internet.
fn read_address(tid: Tid, address: u64, length: u32) -> io::Result<Option<SocketAddr>> {
    let mut bytes = [0; 24];
    let length = usize::try_from(length).unwrap_or(0).min(bytes.len());
    if length < 8 {
        return Ok(None);
    }
    Memory(tid).read(address, bytes.get_mut(..length).unwrap_or_default())?;
    let [_, _, high, low, a, b, c, d, v6 @ ..] = bytes;
    let ip = match i32::from(u16::from_ne_bytes([bytes[0], bytes[1]])) {
        libc::AF_INET => IpAddr::from([a, b, c, d]),
        libc::AF_INET6 => IpAddr::from(v6).to_canonical(),
        _ => return Ok(None),
    };
    Ok(Some((ip, u16::from_be_bytes([high, low])).into()))
}

/// The address to which a thread that sleeps in the kernel connects, if it does.
pub(crate) fn connects_to(process: Tid, tid: Tid) -> Option<String> {
    let (call, a) = syscall_of(process, tid).filter(|(call, _)| *call == libc::SYS_connect)?;
    let address = read_address(tid, a[1], low(a[2])).ok().flatten();
    Some(address.map_or_else(
        || format!("{} in {}", name_of(tid), call_name(call)),
        |address| format!("tcp {address}"),
    ))
}

/// Names what a thread that sleeps in the kernel does there.
pub(crate) fn kernel_wait(process: Tid, tid: Tid) -> String {
    let call = syscall_of(process, tid).map(|(number, _)| call_name(number));
    let place = call.unwrap_or_else(|| "its own memory".to_owned());
    format!("{} in {place}", name_of(tid))
}
