//! Results at a path that the user has named.

use std::ffi::OsStr;
use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{Read as _, Seek as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;

use rustix::fs::{AtFlags, FileType, FlockOperation, OFlags, flock, unlinkat};
use rustix::io::Errno;

use super::Place;
use super::lock::Lock;
use crate::error::PortErrorKind;

/// Most bytes of a file already there that are searched for a mark.
const SEARCHED: u64 = 4096;

/// A file of results, or a pipe or terminal that takes them.
#[derive(Debug)]
pub struct Results {
    to: To,
    marks: &'static [&'static str],
}

#[derive(Debug)]
enum To {
    Place(Place),
    Stream(File),
}

impl Results {
    /// Finds out how results can be written to `path`. A file there is an earlier result if it is empty or
    /// one of `marks` stands near its beginning. Makes the folder that it is in.
    ///
    /// # Errors
    /// When they cannot be written, or something else is there.
    pub fn at(path: &Path, marks: &'static [&'static str]) -> Result<Self, PortErrorKind> {
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent).map_err(PortErrorKind::call("mkdir"))?;
        }
        // A link may lead to a stream as well, as /dev/stdout does.
        if let Ok(behind) = fs::metadata(path)
            && !behind.is_file()
            && !behind.is_dir()
        {
            return Ok(Self {
                to: To::Stream(open_stream(path)?),
                marks,
            });
        }
        let place = Place::of(path)?;
        let is_free = place.kind(&place.name)?.is_none();
        if !is_free && !is_earlier(&place, &place.name, marks) {
            return Err(PortErrorKind::Occupied(place.describe()));
        }
        Ok(Self {
            to: To::Place(place),
            marks,
        })
    }

    /// Returns whether they can be written only once.
    #[must_use]
    pub fn is_stream(&self) -> bool {
        matches!(self.to, To::Stream(_))
    }

    /// Writes results as a whole in place of earlier ones, whose permissions they get.
    ///
    /// # Errors
    /// When something else is there by now, or the system refuses.
    pub fn write(&self, bytes: &[u8]) -> Result<(), PortErrorKind> {
        if let (To::Place(place), Some(lock)) = (&self.to, self.put(bytes)?) {
            lock.remove(place);
        }
        Ok(())
    }

    /// Removes an earlier file.
    ///
    /// # Errors
    /// When the system refuses.
    pub fn remove(&self) -> Result<(), PortErrorKind> {
        let To::Place(place) = &self.to else {
            return Ok(());
        };
        self.remove_locked(place, &Lock::take(place)?)
    }

    fn remove_locked(&self, place: &Place, lock: &Lock) -> Result<(), PortErrorKind> {
        let removed = match is_earlier(place, &place.name, self.marks) {
            true => unlinkat(&place.dir, &place.name, AtFlags::empty())
                .map_err(|errno| place.refusal("unlink", errno)),
            false => Ok(()),
        };
        lock.remove(place);
        removed
    }

    /// Writes results as a whole. No other process can write them until they are dropped, which removes the file.
    ///
    /// # Errors
    /// When something else is there by now, another process holds it, or the system refuses.
    pub fn hold(self, bytes: &[u8]) -> Result<HeldResults, PortErrorKind> {
        let lock = self.put(bytes)?;
        let held = HeldResults {
            results: self,
            lock,
        };
        if let Some(lock) = &held.lock {
            lock.record(Path::new(""))?;
        }
        Ok(held)
    }

    /// Writes them. Returns the lock of a file, which is also removed if that fails.
    fn put(&self, bytes: &[u8]) -> Result<Option<Lock>, PortErrorKind> {
        let place = match &self.to {
            To::Place(place) => place,
            To::Stream(stream) => {
                let mut stream = stream;
                let written = stream
                    .write_all(bytes)
                    .map_err(PortErrorKind::call("write"));
                return written.map(|()| None);
            }
        };
        let lock = Lock::take(place)?;
        let mode = match place.kind(&place.name)? {
            Some((FileType::RegularFile, mode)) => Some(mode.as_raw_mode()),
            _ => None,
        };
        match place.put_file(bytes, mode, |name| is_earlier(place, name, self.marks)) {
            Ok(()) => Ok(Some(lock)),
            Err(error) => {
                lock.remove(place);
                Err(error)
            }
        }
    }

    /// Empties the file, for results that are written bit by bit. No other simulator can have it so
    /// meanwhile.
    ///
    /// # Errors
    /// When something else is there by now, or the system refuses.
    pub fn into_file(self) -> Result<File, PortErrorKind> {
        let is_stream = self.is_stream();
        let file = self.into_log()?;
        if !is_stream {
            file.set_len(0).map_err(PortErrorKind::call("ftruncate"))?;
        }
        Ok(file)
    }

    /// The same with what is in it, to which more is added.
    ///
    /// # Errors
    /// When something else is there by now, or the system refuses.
    pub fn into_log(self) -> Result<File, PortErrorKind> {
        let place = match self.to {
            To::Place(place) => place,
            To::Stream(stream) => return Ok(stream),
        };
        let flags = OFlags::RDWR | OFlags::APPEND | OFlags::CREATE;
        let file = match place.create(&place.name, flags, 0o666) {
            Ok(file) => file,
            Err(Errno::LOOP) => return Err(PortErrorKind::Occupied(place.describe())),
            Err(errno) => return Err(place.refusal("open", errno)),
        };
        // A file system without locks refuses otherwise.
        if flock(&file, FlockOperation::NonBlockingLockExclusive) == Err(Errno::WOULDBLOCK) {
            return Err(PortErrorKind::InUse(None));
        }
        if !has_mark(&file, self.marks) {
            return Err(PortErrorKind::Occupied(place.describe()));
        }
        Ok(file)
    }
}

/// Results that are there as long as this process, or this value.
#[derive(Debug)]
pub struct HeldResults {
    results: Results,
    lock: Option<Lock>,
}

impl Drop for HeldResults {
    fn drop(&mut self) {
        if let (To::Place(place), Some(lock)) = (&self.results.to, &self.lock) {
            // What cannot be removed is replaced by the next process.
            let _ = self.results.remove_locked(place, lock);
        }
    }
}

impl Place {
    /// Writes a separate file and moves it here, where there is nothing or something `replaceable`.
    pub(super) fn put_file(
        &self,
        bytes: &[u8],
        mode: Option<u32>,
        replaceable: impl Fn(&OsStr) -> bool,
    ) -> Result<(), PortErrorKind> {
        let make = |draft: &OsStr| {
            let mut file = self
                .create(draft, OFlags::WRONLY | OFlags::CREATE | OFlags::EXCL, 0o666)
                .map_err(|errno| ("open", errno))?;
            let set = mode.map_or(Ok(()), |mode| {
                file.set_permissions(Permissions::from_mode(mode))
            });
            set.and_then(|()| file.write_all(bytes))
                .map_err(|error| ("write", Errno::from_io_error(&error).unwrap_or(Errno::IO)))
        };
        self.put(make, replaceable)
    }
}

/// Returns whether an earlier result is at a name.
fn is_earlier(place: &Place, name: &OsStr, marks: &[&str]) -> bool {
    place
        .open(name, OFlags::RDONLY)
        .is_ok_and(|file| has_mark(&file, marks))
}

fn has_mark(mut file: &File, marks: &[&str]) -> bool {
    let mut begin = Vec::new();
    let is_file = file.metadata().is_ok_and(|about| about.is_file());
    let read = file
        .rewind()
        .and_then(|()| file.take(SEARCHED).read_to_end(&mut begin));
    let begin = String::from_utf8_lossy(&begin);
    let known = begin.is_empty() || marks.iter().any(|mark| begin.contains(mark));
    is_file && read.is_ok() && known
}

/// Opens a pipe or a terminal. A named pipe that no program reads is an error, since it would keep this
/// waiting for ever.
fn open_stream(path: &Path) -> Result<File, PortErrorKind> {
    let nonblocking = OFlags::NONBLOCK;
    let file = OpenOptions::new()
        .write(true)
        .custom_flags(nonblocking.bits().cast_signed())
        .open(path)
        .map_err(PortErrorKind::call("open"))?;
    let flags = rustix::fs::fcntl_getfl(&file).map_err(PortErrorKind::call("fcntl"))?;
    rustix::fs::fcntl_setfl(&file, flags - nonblocking).map_err(PortErrorKind::call("fcntl"))?;
    Ok(file)
}
