//! The symbolic link under which clients find a pseudo-terminal.
//!
//! Beside `NAME` lies `.NAME.sim-lock`, which the simulator that serves the
//! link holds locked (`flock`) from before it looks at `NAME` until after it
//! has removed it. The system drops the lock when the process dies, however
//! it dies, so that a live simulator is never mistaken for a dead one nor the
//! other way round, even when the number of its pseudo-terminal is in use by
//! somebody else by now. In the file stand the process and where the link
//! points, which is how the link of a killed simulator is known again.
//!
//! Against everybody who knows nothing of the lock, each step is one that
//! cannot overwrite: a new link is made with `symlink`, which fails if there
//! is anything; a stale link is exchanged for the new one, and exchanged back
//! if what came out is not what had been judged stale.

use std::ffi::{OsStr, OsString};
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

use rustix::fd::OwnedFd;
use rustix::fs::{
    AtFlags, CWD, FileType, Mode, OFlags, RenameFlags, openat, readlinkat, renameat_with, statat,
    symlinkat, unlinkat,
};
use rustix::io::Errno;

use crate::error::PortErrorKind;
use crate::lock::Lock;

/// Most looks when others make and remove files at the path.
const MAX_ATTEMPTS: usize = 8;

/// So long a path cannot be opened, `PATH_MAX` with the zero byte at its end.
const LONGEST_PATH: usize = 4096;

/// A published link, removed on drop if it is still ours.
#[derive(Debug)]
pub(crate) struct Symlink {
    path: PathBuf,
    place: Place,
    target: PathBuf,
    // Dropped, and with it released, after the link is removed.
    lock: Lock,
}

/// A name in a directory that is held open, so that it stays the same one
/// whatever becomes of the path.
#[derive(Debug)]
pub(crate) struct Place {
    pub(crate) dir: OwnedFd,
    pub(crate) dir_path: PathBuf,
    pub(crate) name: OsString,
}

impl Symlink {
    /// Publishes a link at `path` to `target`, a node that we hold.
    pub(crate) fn publish(path: &Path, target: &Path) -> Result<Self, PortErrorKind> {
        let place = Place::of(path)?;
        let mut lock = Lock::take(&place)?;
        let recorded = lock.recorded_target();
        lock.record(target)?;
        // Only what a simulator has recorded is a simulator's, wherever else a link may lead.
        let made = place.make(target, |found| recorded.as_deref() == Some(found));
        if let Err(kind) = made {
            // All is left as it was found.
            match recorded {
                Some(recorded) => lock.record(&recorded)?,
                None => lock.remove(&place),
            }
            return Err(kind);
        }
        Ok(Self {
            path: path.to_owned(),
            place,
            target: target.to_owned(),
            lock,
        })
    }

    /// The path that clients open.
    pub(crate) fn path(&self) -> &Path {
        &self.path
    }

    /// Turns the link to another node, so that clients see either the one or
    /// the other.
    pub(crate) fn turn_to(&mut self, target: &Path) -> Result<(), PortErrorKind> {
        self.lock.record(target)?;
        self.place.make(target, |found| found == self.target)?;
        target.clone_into(&mut self.target);
        Ok(())
    }
}

impl Drop for Symlink {
    fn drop(&mut self) {
        if self
            .place
            .read_link()
            .is_ok_and(|found| found == self.target)
        {
            // Nobody is left to be told if this fails.
            let _ = unlinkat(&self.place.dir, &self.place.name, AtFlags::empty());
        }
        self.lock.remove(&self.place);
    }
}

impl Place {
    fn of(path: &Path) -> Result<Self, PortErrorKind> {
        let name = path
            .file_name()
            .filter(|_| !path.as_os_str().as_bytes().ends_with(b"/"))
            .ok_or(PortErrorKind::NotAFileName)?
            .to_owned();
        // The link can be made in a directory that is open; a client has to name it all.
        if path.as_os_str().len() >= LONGEST_PATH {
            return Err(PortErrorKind::TooLong);
        }
        let dir_path = match path.parent() {
            Some(parent) if parent != Path::new("") => parent.to_owned(),
            _ => PathBuf::from("."),
        };
        let flags = OFlags::PATH | OFlags::DIRECTORY | OFlags::CLOEXEC;
        let dir = openat(CWD, &dir_path, flags, Mode::empty()).map_err(|errno| match errno {
            Errno::NOENT | Errno::NOTDIR => PortErrorKind::MissingDirectory(dir_path.clone()),
            Errno::ACCESS => PortErrorKind::NotWritable(dir_path.clone()),
            errno => PortErrorKind::call("open")(errno),
        })?;
        Ok(Self {
            dir,
            dir_path,
            name,
        })
    }

    /// The hidden name beside ours that ends in `suffix`.
    pub(crate) fn beside(&self, suffix: &str) -> OsString {
        let mut name = OsString::from(".");
        name.push(&self.name);
        name.push(suffix);
        name
    }

    /// Says what a failure to make a file in the directory means.
    pub(crate) fn refusal(&self, call: &'static str, errno: Errno) -> PortErrorKind {
        match errno {
            Errno::ACCESS | Errno::PERM | Errno::ROFS => {
                PortErrorKind::NotWritable(self.dir_path.clone())
            }
            Errno::NOENT => PortErrorKind::MissingDirectory(self.dir_path.clone()),
            errno => PortErrorKind::call(call)(errno),
        }
    }

    fn read_link(&self) -> Result<PathBuf, Errno> {
        self.read_link_at(&self.name)
    }

    fn read_link_at(&self, name: &OsStr) -> Result<PathBuf, Errno> {
        let target = readlinkat(&self.dir, name, Vec::new())?;
        Ok(PathBuf::from(OsString::from_vec(target.into_bytes())))
    }

    /// Puts a link to `target` at our name, where there is nothing or a link
    /// to something `replaceable`.
    fn make(
        &self,
        target: &Path,
        replaceable: impl Fn(&Path) -> bool,
    ) -> Result<(), PortErrorKind> {
        for _ in 0..MAX_ATTEMPTS {
            match symlinkat(target, &self.dir, &self.name) {
                Ok(()) => return Ok(()),
                Err(Errno::EXIST) => {}
                Err(errno) => return Err(self.refusal("symlink", errno)),
            }
            match self.read_link() {
                Ok(found) if replaceable(&found) => {
                    if self.exchange(target, &found)? {
                        return Ok(());
                    }
                }
                // Removed since; the name is free now.
                Err(Errno::NOENT) => {}
                Ok(_) | Err(Errno::INVAL) => break,
                Err(errno) => return Err(self.refusal("readlink", errno)),
            }
        }
        Err(PortErrorKind::Occupied(self.describe()))
    }

    /// Swaps the link to `stale` for one to `target`. Gives `false`, having
    /// changed nothing, if something else was there by then.
    fn exchange(&self, target: &Path, stale: &Path) -> Result<bool, PortErrorKind> {
        let fresh = self.beside(".sim-new");
        // Left by a simulator that was killed right here; the lock keeps any
        // other from working with it.
        if self.read_link_at(&fresh).is_ok() {
            let _ = unlinkat(&self.dir, &fresh, AtFlags::empty());
        }
        symlinkat(target, &self.dir, &fresh).map_err(|errno| self.refusal("symlink", errno))?;
        let swap = || {
            renameat_with(
                &self.dir,
                &fresh,
                &self.dir,
                &self.name,
                RenameFlags::EXCHANGE,
            )
        };
        let swapped = match swap() {
            Ok(()) => true,
            Err(Errno::NOENT) => false,
            Err(errno) => {
                let _ = unlinkat(&self.dir, &fresh, AtFlags::empty());
                return Err(match errno {
                    Errno::INVAL | Errno::NOSYS | Errno::NOTSUP => PortErrorKind::CannotReplace,
                    errno => self.refusal("renameat2", errno),
                });
            }
        };
        let right = swapped && self.read_link_at(&fresh).is_ok_and(|found| found == stale);
        if swapped && !right {
            swap().map_err(PortErrorKind::call("renameat2"))?;
        }
        unlinkat(&self.dir, &fresh, AtFlags::empty()).map_err(PortErrorKind::call("unlink"))?;
        Ok(right)
    }

    /// Says what is at our name, for the one who has to remove it.
    fn describe(&self) -> String {
        if let Ok(target) = self.read_link() {
            return format!("a symbolic link to {}", target.display());
        }
        let stat = statat(&self.dir, &self.name, AtFlags::SYMLINK_NOFOLLOW);
        let kind = stat.map(|stat| FileType::from_raw_mode(stat.st_mode));
        match kind {
            Ok(FileType::RegularFile) => "a regular file",
            Ok(FileType::Directory) => "a directory",
            Ok(FileType::Socket) => "a socket",
            Ok(FileType::Fifo) => "a named pipe",
            Ok(FileType::CharacterDevice | FileType::BlockDevice) => "a device",
            _ => "something that keeps changing",
        }
        .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_exchange_that_meets_something_else_changes_nothing() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r150");
        let place = Place::of(&path).unwrap();
        let (fresh, stale) = (Path::new("/fresh"), Path::new("/stale"));

        assert!(
            !place.exchange(fresh, stale).unwrap(),
            "there is nothing to replace"
        );

        // What came in between the look and the exchange.
        std::fs::write(&path, "precious").unwrap();
        assert!(!place.exchange(fresh, stale).unwrap());
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");

        std::fs::remove_file(&path).unwrap();
        std::os::unix::fs::symlink(stale, &path).unwrap();
        std::os::unix::fs::symlink("/left/by/a/killed/one", dir.path().join(".r150.sim-new"))
            .unwrap();
        assert!(place.exchange(fresh, stale).unwrap());
        assert_eq!(place.read_link().unwrap(), fresh);
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
