//! The lock file beside a link: who serves it, and where it points.

use std::ffi::OsString;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

use rustix::fd::OwnedFd;
use rustix::fs::{
    AtFlags, FileType, FlockOperation, Mode, OFlags, flock, fstat, ftruncate, openat, statat,
    unlinkat,
};
use rustix::io::{Errno, pread, pwrite};

use crate::error::PortErrorKind;
use crate::symlink::Place;

const SUFFIX: &str = ".sim-lock";

/// Most times that the lock file is opened anew when its holder removes it meanwhile.
const MAX_ATTEMPTS: usize = 8;

/// A held lock. Dropping it, like the death of the process, releases it and
/// leaves the record behind; [`remove`](Self::remove) leaves nothing.
#[derive(Debug)]
pub(crate) struct Lock {
    file: OwnedFd,
}

impl Lock {
    /// Takes the lock of a place, or says which process holds it.
    pub(crate) fn take(place: &Place) -> Result<Self, PortErrorKind> {
        let name = place.beside(SUFFIX);
        for _ in 0..MAX_ATTEMPTS {
            let Some(lock) = Self::open(place, &name)? else {
                continue;
            };
            match flock(&lock.file, FlockOperation::NonBlockingLockExclusive) {
                Ok(()) => {}
                Err(Errno::WOULDBLOCK) => return Err(PortErrorKind::InUse(lock.holder())),
                Err(errno) => return Err(PortErrorKind::call("flock")(errno)),
            }
            // The former holder may have removed the file between our opening
            // and our locking it; then the next one will not find it.
            let ours = fstat(&lock.file).map_err(PortErrorKind::call("fstat"))?;
            match statat(&place.dir, &name, AtFlags::SYMLINK_NOFOLLOW) {
                Ok(found) if (found.st_dev, found.st_ino) == (ours.st_dev, ours.st_ino) => {
                    return Ok(lock);
                }
                _ => {}
            }
        }
        Err(PortErrorKind::InUse(None))
    }

    /// Opens the lock file, or gives nothing if it came or went meanwhile.
    fn open(place: &Place, name: &OsString) -> Result<Option<Self>, PortErrorKind> {
        let flags = OFlags::RDWR | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        // Not with CREATE alone: in a sticky directory like /tmp the system
        // refuses that for a file of another user.
        let create = flags | OFlags::CREATE | OFlags::EXCL;
        let file = match openat(&place.dir, name, flags, Mode::empty()) {
            Err(Errno::NOENT) => openat(&place.dir, name, create, Mode::from_raw_mode(0o644)),
            // Another user's: it can still be seen whether that one is alive.
            Err(Errno::ACCESS) => return Self::inquire(place, name),
            opened => opened,
        };
        let file = match file {
            Ok(file) => file,
            Err(Errno::EXIST) => return Ok(None),
            Err(Errno::LOOP | Errno::ISDIR | Errno::NXIO) => {
                return Err(Self::not_a_lock(name));
            }
            Err(errno) => return Err(place.refusal("open", errno)),
        };
        let stat = fstat(&file).map_err(PortErrorKind::call("fstat"))?;
        if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
            return Err(Self::not_a_lock(name));
        }
        Ok(Some(Self { file }))
    }

    fn inquire(place: &Place, name: &OsString) -> Result<Option<Self>, PortErrorKind> {
        let flags = OFlags::RDONLY | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        let refused = || place.refusal("open", Errno::ACCESS);
        let file = openat(&place.dir, name, flags, Mode::empty()).map_err(|_| refused())?;
        let lock = Self { file };
        match flock(&lock.file, FlockOperation::NonBlockingLockExclusive) {
            Err(Errno::WOULDBLOCK) => Err(PortErrorKind::InUse(lock.holder())),
            _ => Err(PortErrorKind::Occupied(format!(
                "the lock file {} of another user",
                Path::new(name).display()
            ))),
        }
    }

    fn not_a_lock(name: &OsString) -> PortErrorKind {
        let name = Path::new(name).display();
        PortErrorKind::Occupied(format!(
            "something other than a lock file at {name} beside it"
        ))
    }

    /// Target of the last holder's link, if it left a record.
    pub(crate) fn recorded_target(&self) -> Option<PathBuf> {
        let record = self.read();
        let mut lines = record.split(|byte| *byte == b'\n');
        let target = lines.nth(1).filter(|line| !line.is_empty())?;
        // A record cut short has no line end and is worth nothing.
        lines.next()?;
        Some(PathBuf::from(OsString::from_vec(target.to_vec())))
    }

    /// Records this process and where its link is about to point.
    pub(crate) fn record(&mut self, target: &Path) -> Result<(), PortErrorKind> {
        let mut record = format!("{}\n", std::process::id()).into_bytes();
        record.extend_from_slice(target.as_os_str().as_bytes());
        record.push(b'\n');
        ftruncate(&self.file, 0).map_err(PortErrorKind::call("ftruncate"))?;
        pwrite(&self.file, &record, 0).map_err(PortErrorKind::call("write"))?;
        Ok(())
    }

    /// Removes the file while it is still locked. It is released on drop.
    pub(crate) fn remove(&self, place: &Place) {
        // Nobody is left to be told if this fails, and a file that stays is
        // taken over by the next simulator.
        let _ = unlinkat(&place.dir, place.beside(SUFFIX), AtFlags::empty());
    }

    fn holder(&self) -> Option<u32> {
        let record = self.read();
        let line = record.split(|byte| *byte == b'\n').next()?;
        std::str::from_utf8(line).ok()?.parse().ok()
    }

    fn read(&self) -> Vec<u8> {
        let mut record = vec![0; 4096];
        let len = pread(&self.file, &mut record[..], 0).unwrap_or(0);
        record.truncate(len);
        record
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lock_with(record: &[u8]) -> Lock {
        let mut file = tempfile::tempfile().unwrap();
        std::io::Write::write_all(&mut file, record).unwrap();
        Lock { file: file.into() }
    }

    #[test]
    fn a_record_is_read_back() {
        let mut lock = lock_with(b"a longer one that was there before\n");
        lock.record(Path::new("/dev/pts/12")).unwrap();
        assert_eq!(lock.recorded_target().unwrap(), Path::new("/dev/pts/12"));
        assert_eq!(lock.holder(), Some(std::process::id()));
    }

    #[test]
    fn a_record_cut_short_is_worth_nothing() {
        for record in [&b""[..], b"123", b"123\n", b"123\n\n", b"123\n/dev/pts/1"] {
            assert_eq!(lock_with(record).recorded_target(), None, "{record:?}");
        }
    }
}
