//! The memory of a client's thread.

use std::io;

use crate::traced::sys::{self, Parts, Tid};

#[derive(Debug, Clone, Copy)]
pub(crate) struct Memory(pub(crate) Tid);

fn fault() -> io::Error {
    io::Error::from_raw_os_error(libc::EFAULT)
}

impl Memory {
    pub(crate) fn read(self, address: u64, bytes: &mut [u8]) -> io::Result<()> {
        self.read_all(&[(address, bytes.len() as u64)], bytes)
    }

    pub(crate) fn write(self, address: u64, bytes: &[u8]) -> io::Result<()> {
        self.write_all(&[(address, bytes.len() as u64)], bytes)
    }

    /// Reads several parts, one behind the other.
    pub(crate) fn read_all(self, parts: &Parts, bytes: &mut [u8]) -> io::Result<()> {
        if bytes.is_empty() || sys::read_memory(self.0, parts, bytes)? == bytes.len() {
            Ok(())
        } else {
            Err(fault())
        }
    }

    pub(crate) fn write_all(self, parts: &Parts, bytes: &[u8]) -> io::Result<()> {
        if bytes.is_empty() || sys::write_memory(self.0, parts, bytes)? == bytes.len() {
            Ok(())
        } else {
            Err(fault())
        }
    }

    pub(crate) fn read_u32(self, address: u64) -> io::Result<u32> {
        let mut bytes = [0; 4];
        self.read(address, &mut bytes)?;
        Ok(u32::from_ne_bytes(bytes))
    }

    pub(crate) fn read_u64(self, address: u64) -> io::Result<u64> {
        let mut bytes = [0; 8];
        self.read(address, &mut bytes)?;
        Ok(u64::from_ne_bytes(bytes))
    }

    /// Two numbers of 64 bits, as in `timespec`, `timeval` and `iovec`.
    pub(crate) fn read_pair(self, address: u64) -> io::Result<(i64, i64)> {
        let mut bytes = [0; 16];
        self.read(address, &mut bytes)?;
        let (first, second) = bytes.split_at(8);
        let number = |part: &[u8]| part.try_into().map(i64::from_ne_bytes).unwrap_or_default();
        Ok((number(first), number(second)))
    }

    /// The parts of a read or write: where each is, and how long.
    pub(crate) fn read_parts(self, address: u64, count: u64) -> io::Result<Vec<(u64, u64)>> {
        const MOST: usize = 1024;
        let count = usize::try_from(count).unwrap_or(MOST).min(MOST);
        let mut words = vec![[0; 8]; 2 * count];
        self.read(address, words.as_flattened_mut())?;
        let words = words.chunks_exact(2).map(|pair| (pair[0], pair[1]));
        Ok(words
            .map(|(base, length)| (u64::from_ne_bytes(base), u64::from_ne_bytes(length)))
            .collect())
    }

    /// Writes these bytes into the parts of a read, as far as there is room; returns how many.
    pub(crate) fn write_parts(self, parts: &Parts, bytes: &[u8]) -> io::Result<usize> {
        let mut left = bytes.len() as u64;
        let filled = parts.iter().map(|(address, length)| {
            let length = left.min(*length);
            left -= length;
            (*address, length)
        });
        let filled: Vec<(u64, u64)> = filled.collect();
        let bytes = &bytes[..bytes.len() - usize::try_from(left).unwrap_or_default()];
        self.write_all(&filled, bytes)?;
        Ok(bytes.len())
    }

    pub(crate) fn write_pair(self, address: u64, first: i64, second: i64) -> io::Result<()> {
        let mut bytes = [0; 16];
        bytes[..8].copy_from_slice(&first.to_ne_bytes());
        bytes[8..].copy_from_slice(&second.to_ne_bytes());
        self.write(address, &bytes)
    }
}

/// The length of all parts of a read or write.
pub(crate) fn whole_length(parts: &Parts) -> u64 {
    let add = |sum: u64, part: &(u64, u64)| sum.saturating_add(part.1);
    parts.iter().fold(0, add)
}
