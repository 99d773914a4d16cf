//! The lock file beside a path: who has it, and where its link points.

use std::ffi::OsStr;
use std::fs::File;
use std::io::{Read as _, Seek as _, Write as _};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};
use std::time::Duration;

use rustix::fs::{AtFlags, FileType, FlockOperation, OFlags, flock, fstat, statat, unlinkat};
use rustix::io::Errno;

use super::{MAX_ATTEMPTS, Place};
use crate::error::PortErrorKind;

pub(super) const SUFFIX: &str = ".sim-lock";

/// Time between two attempts: a process that only looks for what a killed one has left holds it for a moment.
const PAUSE: Duration = Duration::from_millis(1);

/// Most bytes of a lock file that are read.
const MOST_BYTES: u64 = 4096;

/// A held lock (`flock`). Dropping it, like the death of the process, releases it and leaves the record
/// behind; [`remove`](Self::remove) leaves nothing. So a live simulator is never mistaken for a dead one.
#[derive(Debug)]
pub(super) struct Lock {
    file: File,
}

impl Lock {
    /// Takes the lock of a place, or says which process holds it.
    pub(super) fn take(place: &Place) -> Result<Self, PortErrorKind> {
        for attempt in 0..MAX_ATTEMPTS {
            if attempt > 0 {
                std::thread::sleep(PAUSE);
            }
            if let Some(lock) = Self::try_take(place)? {
                return Ok(lock);
            }
        }
        let holder = place.open(&place.beside(SUFFIX), OFlags::RDONLY).ok();
        Err(PortErrorKind::InUse(
            holder.and_then(|file| Self { file }.holder()),
        ))
    }

    /// Takes the lock, unless another process holds it or has removed the file meanwhile.
    pub(super) fn try_take(place: &Place) -> Result<Option<Self>, PortErrorKind> {
        let name = place.beside(SUFFIX);
        let Some(lock) = Self::open(place, &name)? else {
            return Ok(None);
        };
        match flock(&lock.file, FlockOperation::NonBlockingLockExclusive) {
            Ok(()) => {}
            Err(Errno::WOULDBLOCK) => return Ok(None),
            Err(errno) => return Err(PortErrorKind::call("flock")(errno)),
        }
        // The former holder may have removed the file after it was opened here; then the next one will
        // not find it.
        let held = fstat(&lock.file).map_err(PortErrorKind::call("fstat"))?;
        let found = statat(&place.dir, &name, AtFlags::SYMLINK_NOFOLLOW);
        let is_there =
            found.is_ok_and(|found| (found.st_dev, found.st_ino) == (held.st_dev, held.st_ino));
        if is_there
            && rustix::fs::fcntl_getfl(&lock.file).is_ok_and(|flags| !flags.contains(OFlags::RDWR))
        {
            let name = Path::new(&name).display();
            let what = format!("the lock file {name} of another user");
            return Err(PortErrorKind::Occupied(what));
        }
        Ok(is_there.then_some(lock))
    }

    /// Opens the lock file, or returns nothing if it came or went meanwhile.
    fn open(place: &Place, name: &OsStr) -> Result<Option<Self>, PortErrorKind> {
        // Not with CREATE alone: in a sticky directory like /tmp the system
        // refuses that for a file of another user.
        let create = OFlags::RDWR | OFlags::CREATE | OFlags::EXCL;
        let file = match place.open(name, OFlags::RDWR) {
            Err(Errno::NOENT) => place.create(name, create, 0o644),
            // Another user's: it can still be seen whether that one is alive.
            Err(Errno::ACCESS) => place.open(name, OFlags::RDONLY),
            opened => opened,
        };
        let file = match file {
            Ok(file) => file,
            Err(Errno::EXIST) => return Ok(None),
            Err(Errno::LOOP | Errno::ISDIR | Errno::NXIO) => return Err(not_a_lock(name)),
            Err(errno) => return Err(place.refusal("open", errno)),
        };
        let stat = fstat(&file).map_err(PortErrorKind::call("fstat"))?;
        if FileType::from_raw_mode(stat.st_mode) != FileType::RegularFile {
            return Err(not_a_lock(name));
        }
        Ok(Some(Self { file }))
    }

    /// Target of the last holder's link, if it left a record.
    pub(super) fn recorded_target(&self) -> Option<PathBuf> {
        let record = self.read();
        let mut lines = record.split(|byte| *byte == b'\n');
        let target = lines.nth(1).filter(|line| !line.is_empty())?;
        // A record cut short has no line end and is worth nothing.
        lines.next()?;
        Some(PathBuf::from(std::ffi::OsString::from_vec(target.to_vec())))
    }

    /// Records this process and where its link is about to point.
    pub(super) fn record(&self, target: &Path) -> Result<(), PortErrorKind> {
        let mut record = format!("{}\n", std::process::id()).into_bytes();
        record.extend_from_slice(target.as_os_str().as_bytes());
        record.push(b'\n');
        let mut file = &self.file;
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| file.write_all(&record))
            .map_err(PortErrorKind::call("write"))
    }

    /// Removes the file while it is still locked. It is released on drop.
    pub(super) fn remove(&self, place: &Place) {
        // A file that stays is taken over by the next simulator.
        let _ = unlinkat(&place.dir, place.beside(SUFFIX), AtFlags::empty());
    }

    fn holder(&self) -> Option<u32> {
        let record = self.read();
        let line = record.split(|byte| *byte == b'\n').next()?;
        std::str::from_utf8(line).ok()?.parse().ok()
    }

    fn read(&self) -> Vec<u8> {
        let (mut file, mut record) = (&self.file, Vec::new());
        let read = file
            .rewind()
            .and_then(|()| file.take(MOST_BYTES).read_to_end(&mut record));
        read.map_or_else(|_| Vec::new(), |_| record)
    }
}

fn not_a_lock(name: &OsStr) -> PortErrorKind {
    let name = Path::new(name).display();
    PortErrorKind::Occupied(format!(
        "something other than a lock file at {name} beside it"
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn lock_with(record: &[u8]) -> Lock {
        let mut file = tempfile::tempfile().unwrap();
        file.write_all(record).unwrap();
        Lock { file }
    }

    #[test]
    fn a_record_is_read_back() {
        let lock = lock_with(b"a longer one that was there before\n");
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
