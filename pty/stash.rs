//! Bytes taken out of the kernel before the caller asked for them.

use rustix::fd::AsFd;
use rustix::io::{Errno, retry_on_intr};

/// More than Linux keeps for a pseudo-terminal in one direction, which is
/// about 20 kB; only a bound for the case that somebody goes on writing.
const MOST: usize = 1 << 16;

/// A queue of bytes that have been read too early.
#[derive(Debug, Default)]
pub(crate) struct Stash {
    bytes: Vec<u8>,
    taken: usize,
}

impl Stash {
    pub(crate) fn is_empty(&self) -> bool {
        self.taken == self.bytes.len()
    }

    pub(crate) fn push(&mut self, bytes: &[u8]) {
        self.bytes.extend_from_slice(bytes);
    }

    /// Adds everything that can be read right now.
    pub(crate) fn fill_from(&mut self, fd: impl AsFd) -> Result<(), Errno> {
        let mut buf = [0; 4096];
        while self.bytes.len() < MOST {
            match retry_on_intr(|| rustix::io::read(&fd, &mut buf)) {
                // The end, in either of its forms, is for the next read.
                Ok(0) | Err(Errno::AGAIN | Errno::IO) => break,
                Ok(n) => self.push(&buf[..n]),
                Err(errno) => return Err(errno),
            }
        }
        Ok(())
    }

    /// Moves what fits to the start of `buf`.
    pub(crate) fn take(&mut self, buf: &mut [u8]) -> usize {
        let rest = &self.bytes[self.taken..];
        let count = rest.len().min(buf.len());
        buf[..count].copy_from_slice(&rest[..count]);
        self.taken += count;
        if self.is_empty() {
            *self = Self::default();
        }
        count
    }
}
