//! Paths that this program makes: links, results, files and folders. One rule holds for all of them.
//!
//! What is there is replaced only if an earlier run has made it. Nothing is written through a symbolic link.
//! Whatever appears, appears as a whole, unless it is written bit by bit.
//!
//! While something is made at `NAME`, and as long as it is in use, `.NAME.sim-lock` beside it is locked
//! (`lock.rs`). It is prepared as `.NAME.sim-new` and moved to its place in one step that cannot overwrite:
//! where something is there already, both are exchanged, and exchanged back if what came out is not what had
//! been seen before. So programs that know nothing of the lock lose nothing either.

mod held;
mod link;
mod lock;
mod results;

use std::ffi::{OsStr, OsString};
use std::fs::File;
use std::os::unix::ffi::{OsStrExt as _, OsStringExt as _};
use std::path::{Path, PathBuf};

use rustix::fd::OwnedFd;
use rustix::fs::{
    AtFlags, CWD, FileType, Mode, OFlags, RenameFlags, openat, readlinkat, renameat_with, statat,
    symlinkat, unlinkat,
};
use rustix::io::Errno;

use crate::error::PortErrorKind;
pub use held::{Held, held_in, private_folder};
pub(crate) use link::Link;
pub use results::{HeldResults, Results};

/// Most attempts when others make and remove files at the path.
const MAX_ATTEMPTS: usize = 8;

/// So long a path cannot be opened, `PATH_MAX` with the zero byte at its end.
const LONGEST_PATH: usize = 4096;

/// A name in a directory that is held open, so that it stays the same one whatever becomes of the path.
#[derive(Debug)]
struct Place {
    dir: OwnedFd,
    dir_path: PathBuf,
    name: OsString,
}

impl Place {
    fn of(path: &Path) -> Result<Self, PortErrorKind> {
        let name = path
            .file_name()
            .filter(|_| !path.as_os_str().as_bytes().ends_with(b"/"))
            .ok_or(PortErrorKind::NotAFileName)?
            .to_owned();
        // A link can be made in a directory that is open; a client has to name it all.
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
    fn beside(&self, suffix: &str) -> OsString {
        let mut name = OsString::from(".");
        name.push(&self.name);
        name.push(suffix);
        name
    }

    /// Says what a failure to make a file in the directory means.
    fn refusal(&self, call: &'static str, errno: Errno) -> PortErrorKind {
        match errno {
            Errno::ACCESS | Errno::PERM | Errno::ROFS => {
                PortErrorKind::NotWritable(self.dir_path.clone())
            }
            Errno::NOENT => PortErrorKind::MissingDirectory(self.dir_path.clone()),
            errno => PortErrorKind::call(call)(errno),
        }
    }

    fn open(&self, name: &OsStr, flags: OFlags) -> Result<File, Errno> {
        self.create(name, flags, 0)
    }

    fn create(&self, name: &OsStr, flags: OFlags, mode: u32) -> Result<File, Errno> {
        let flags = flags | OFlags::NOFOLLOW | OFlags::NONBLOCK | OFlags::CLOEXEC;
        openat(&self.dir, name, flags, Mode::from_raw_mode(mode)).map(File::from)
    }

    fn read_link(&self, name: &OsStr) -> Result<PathBuf, Errno> {
        let target = readlinkat(&self.dir, name, Vec::new())?;
        Ok(PathBuf::from(OsString::from_vec(target.into_bytes())))
    }

    /// Type of what is at a name, and its permissions; nothing if there is nothing.
    fn kind(&self, name: &OsStr) -> Result<Option<(FileType, Mode)>, PortErrorKind> {
        match statat(&self.dir, name, AtFlags::SYMLINK_NOFOLLOW) {
            Ok(stat) => Ok(Some((
                FileType::from_raw_mode(stat.st_mode),
                Mode::from_raw_mode(stat.st_mode),
            ))),
            Err(Errno::NOENT) => Ok(None),
            Err(errno) => Err(self.refusal("stat", errno)),
        }
    }

    /// Makes a link to `target` where there is nothing or something `replaceable`.
    fn link_to(
        &self,
        target: &Path,
        replaceable: impl Fn(&OsStr) -> bool,
    ) -> Result<(), PortErrorKind> {
        self.put(
            |draft| symlinkat(target, &self.dir, draft).map_err(|errno| ("symlink", errno)),
            replaceable,
        )
    }

    /// Calls `make` to make something under another name and moves it to ours, where there is nothing or
    /// something of which `replaceable` says so, under whatever name. The lock keeps other simulators away.
    fn put(
        &self,
        make: impl FnOnce(&OsStr) -> Result<(), (&'static str, Errno)>,
        replaceable: impl Fn(&OsStr) -> bool,
    ) -> Result<(), PortErrorKind> {
        let draft = self.beside(".sim-new");
        let remove = || unlinkat(&self.dir, &draft, AtFlags::empty());
        // Left by a simulator that was killed right here.
        let _ = remove();
        let made = make(&draft).map_err(|(call, errno)| self.refusal(call, errno));
        let put = made.and_then(|()| self.move_here(&draft, replaceable));
        if put.is_err() {
            let _ = remove();
        }
        put
    }

    fn move_here(
        &self,
        draft: &OsStr,
        replaceable: impl Fn(&OsStr) -> bool,
    ) -> Result<(), PortErrorKind> {
        let rename = |flags| renameat_with(&self.dir, draft, &self.dir, &self.name, flags);
        let failed = |errno| self.refusal("renameat2", errno);
        for _ in 0..MAX_ATTEMPTS {
            match rename(RenameFlags::NOREPLACE) {
                Ok(()) => return Ok(()),
                // Some file systems know no such flags. There a stranger's file can be lost that comes
                // between the look and the step.
                Err(Errno::INVAL | Errno::NOSYS | Errno::NOTSUP)
                    if replaceable(&self.name) || self.kind(&self.name)?.is_none() =>
                {
                    return rename(RenameFlags::empty()).map_err(failed);
                }
                Err(Errno::EXIST | Errno::INVAL | Errno::NOSYS | Errno::NOTSUP) => {}
                Err(errno) => return Err(failed(errno)),
            }
            if !replaceable(&self.name) {
                match self.kind(&self.name)? {
                    Some(_) => break,
                    // Removed meanwhile.
                    None => continue,
                }
            }
            match rename(RenameFlags::EXCHANGE) {
                Ok(()) if replaceable(draft) => {
                    return unlinkat(&self.dir, draft, AtFlags::empty()).map_err(failed);
                }
                Ok(()) => rename(RenameFlags::EXCHANGE).map_err(failed)?,
                Err(Errno::NOENT) => {}
                Err(errno) => return Err(failed(errno)),
            }
        }
        Err(PortErrorKind::Occupied(self.describe()))
    }

    /// Says what is at our name, for the one who has to remove it.
    fn describe(&self) -> String {
        if let Ok(target) = self.read_link(&self.name) {
            return format!("a symbolic link to {}", target.display());
        }
        let kind = self.kind(&self.name).ok().flatten();
        match kind.map(|(kind, _)| kind) {
            Some(FileType::RegularFile) => "a regular file that `sim` did not create",
            Some(FileType::Directory) => "a directory",
            Some(FileType::Socket) => "a socket",
            Some(FileType::Fifo) => "a named pipe",
            Some(FileType::CharacterDevice | FileType::BlockDevice) => "a device",
            _ => "something that keeps changing",
        }
        .to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::Cell;

    #[test]
    fn what_comes_at_the_last_moment_is_not_replaced() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("r150");
        let place = Place::of(&path).unwrap();
        let stale = Path::new("/stale");
        std::os::unix::fs::symlink(stale, &path).unwrap();
        std::os::unix::fs::symlink("/left/by/a/killed/one", dir.path().join(".r150.sim-new"))
            .unwrap();
        let looks = Cell::new(0);
        let error = place.link_to(Path::new("/fresh"), |name| {
            looks.set(looks.get() + 1);
            if looks.get() == 1 {
                std::fs::remove_file(&path).unwrap();
                std::fs::write(&path, "precious").unwrap();
                return true;
            }
            place.read_link(name).is_ok_and(|found| found == stale)
        });
        assert!(
            matches!(error, Err(PortErrorKind::Occupied(_))),
            "{error:?}"
        );
        assert_eq!(std::fs::read_to_string(&path).unwrap(), "precious");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }
}
