//! A socket for descriptors of programs, where the system refuses to duplicate them from outside.

use std::io::{self, IoSliceMut};
use std::mem::MaybeUninit;
use std::os::fd::{AsRawFd as _, OwnedFd};
use std::rc::Rc;

use rustix::net::{
    AddressFamily, RecvAncillaryBuffer, RecvAncillaryMessage, RecvFlags, SocketAddrUnix,
    SocketFlags, SocketType, bind, getsockname, recvmsg, socket_with,
};
use rustix::process::{PidfdFlags, PidfdGetfdFlags, getpid, pidfd_getfd, pidfd_open};

/// A socket to which programs send their descriptors.
pub(crate) struct Passage {
    socket: OwnedFd,
    /// Its abstract name, without the null before it.
    name: Vec<u8>,
}

impl Passage {
    /// Returns one if the system refuses `pidfd_getfd`, as the usual profile of containers does.
    pub(crate) fn if_needed() -> io::Result<Option<Rc<Self>>> {
        let this = pidfd_open(getpid(), PidfdFlags::empty());
        let copy = |one: OwnedFd| pidfd_getfd(&one, one.as_raw_fd(), PidfdGetfdFlags::empty());
        if this.and_then(copy).is_ok() {
            return Ok(None);
        }
        let flags = SocketFlags::CLOEXEC | SocketFlags::NONBLOCK;
        let socket = socket_with(AddressFamily::UNIX, SocketType::DGRAM, flags, None)?;
        // The system chooses a name.
        bind(&socket, &SocketAddrUnix::new_unnamed())?;
        let address = SocketAddrUnix::try_from(getsockname(&socket)?)?;
        let name = address.abstract_name().unwrap_or_default().to_vec();
        Ok(Some(Rc::new(Self { socket, name })))
    }

    /// A message for `sendmsg` that passes a descriptor, as it lies at this address.
    pub(crate) fn message(&self, place: u64, fd: i32) -> Vec<u8> {
        const PART: u64 = 56;
        const CONTROL: u64 = PART + 16;
        const ADDRESS: u64 = CONTROL + 24;
        let [level, kind, fd] = [libc::SOL_SOCKET, libc::SCM_RIGHTS, fd].map(i32::unsigned_abs);
        let header = [
            place + ADDRESS,
            3 + self.name.len() as u64,
            place + PART,
            1,
            place + CONTROL,
            24,
            0,
        ];
        // One byte, whichever it is.
        let part = [place, 1];
        let control = [20, u64::from(level) | u64::from(kind) << 32, u64::from(fd)];
        let words = header.into_iter().chain(part).chain(control);
        let mut bytes: Vec<u8> = words.flat_map(u64::to_ne_bytes).collect();
        // The family, and a null before the name.
        bytes.extend([1, 0, 0]);
        bytes.extend(&self.name);
        bytes
    }

    pub(crate) fn receive(&self) -> Option<OwnedFd> {
        let mut space = [MaybeUninit::uninit(); rustix::cmsg_space!(ScmRights(1))];
        let mut control = RecvAncillaryBuffer::new(&mut space);
        let mut byte = [0];
        let parts = &mut [IoSliceMut::new(&mut byte)];
        recvmsg(&self.socket, parts, &mut control, RecvFlags::CMSG_CLOEXEC).ok()?;
        control.drain().find_map(|message| match message {
            RecvAncillaryMessage::ScmRights(mut files) => files.next(),
            _ => None,
        })
    }
}
