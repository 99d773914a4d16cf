//! Files and folders that are there as long as the process that has made them.

use std::ffi::OsStr;
use std::fs::{self, DirBuilder};
use std::io;
use std::os::unix::ffi::OsStrExt as _;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use super::Place;
use super::lock::{Lock, SUFFIX};
use crate::error::PortErrorKind;

/// Most entries of a folder that are looked at.
const MOST_ENTRIES: usize = 2000;

/// A file or folder in a [`private_folder`], removed on drop. It is locked, so that what a killed process
/// has left is known.
#[derive(Debug)]
pub struct Held {
    path: PathBuf,
    place: Place,
    lock: Lock,
}

impl Held {
    /// Makes a file that only this user can read.
    ///
    /// # Errors
    /// When another process holds it, or the system refuses.
    pub fn file(path: &Path, bytes: &[u8]) -> Result<Self, PortErrorKind> {
        let held = Self::take(path)?;
        held.place.put_file(bytes, Some(0o600), |_| false)?;
        Ok(held)
    }

    /// Makes an empty folder.
    ///
    /// # Errors
    /// When another process holds it, or the system refuses.
    pub fn folder(path: &Path) -> Result<Self, PortErrorKind> {
        let held = Self::take(path)?;
        fs::create_dir(path).map_err(PortErrorKind::call("mkdir"))?;
        Ok(held)
    }

    fn take(path: &Path) -> Result<Self, PortErrorKind> {
        let place = Place::of(path)?;
        let lock = Lock::take(&place)?;
        remove(path).map_err(PortErrorKind::call("unlink"))?;
        Ok(Self {
            path: path.to_owned(),
            place,
            lock,
        })
    }

    /// The path that is held.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for Held {
    fn drop(&mut self) {
        // What cannot be removed is taken over by the next process.
        let _ = remove(&self.path);
        self.lock.remove(&self.place);
    }
}

/// Returns what is held in a folder, and removes what processes that were killed have left there.
///
/// # Errors
/// When the folder cannot be read.
pub fn held_in(folder: &Path) -> io::Result<Vec<PathBuf>> {
    let mut held = Vec::new();
    for entry in fs::read_dir(folder)?.take(MOST_ENTRIES) {
        let lock_name = entry?.file_name();
        let name = lock_name.as_bytes().strip_prefix(b".");
        let Some(name) = name.and_then(|name| name.strip_suffix(SUFFIX.as_bytes())) else {
            continue;
        };
        let path = folder.join(OsStr::from_bytes(name));
        let Ok(place) = Place::of(&path) else {
            continue;
        };
        match Lock::try_take(&place) {
            Ok(Some(lock)) => drop(Held { path, place, lock }),
            Ok(None) => held.push(path),
            Err(_) => {}
        }
    }
    held.sort();
    Ok(held)
}

/// Makes a folder that only this user can enter, if it is not there.
///
/// # Errors
/// When others could have a hand in it, or the system refuses.
pub fn private_folder(folder: &Path) -> io::Result<()> {
    match DirBuilder::new().mode(0o700).create(folder) {
        Err(error) if error.kind() != io::ErrorKind::AlreadyExists => return Err(error),
        _ => {}
    }
    let found = fs::symlink_metadata(folder)?;
    let ours = found.uid() == rustix::process::geteuid().as_raw();
    if found.is_dir() && ours && found.mode() & 0o077 == 0 {
        return Ok(());
    }
    let why = format!(
        "{} has to be a folder of yours that no other user can enter",
        folder.display()
    );
    Err(io::Error::new(io::ErrorKind::PermissionDenied, why))
}

fn remove(path: &Path) -> io::Result<()> {
    let removed = match fs::symlink_metadata(path) {
        Ok(found) if found.is_dir() => fs::remove_dir_all(path),
        _ => fs::remove_file(path),
    };
    match removed {
        Err(error) if error.kind() != io::ErrorKind::NotFound => Err(error),
        _ => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    #[test]
    fn what_is_held_is_found_and_the_rest_removed() {
        let dir = tempfile::tempdir().unwrap();
        let (file, folder) = (dir.path().join("file"), dir.path().join("folder"));
        let held = [
            Held::file(&file, b"text").unwrap(),
            Held::folder(&folder).unwrap(),
        ];
        assert_eq!(fs::read(held[0].path()).unwrap(), b"text");
        let mode = fs::metadata(&file).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        for path in [&file, &folder] {
            let second = Held::folder(path);
            assert!(matches!(second, Err(PortErrorKind::InUse(_))), "{second:?}");
        }
        // As killed processes leave them.
        fs::create_dir(dir.path().join("left")).unwrap();
        fs::write(dir.path().join("left/inside"), "").unwrap();
        fs::write(dir.path().join(".left.sim-lock"), "").unwrap();
        fs::write(dir.path().join("foreign"), "").unwrap();
        assert_eq!(held_in(dir.path()).unwrap(), [file, folder]);
        drop(held);
        let rest: Vec<_> = fs::read_dir(dir.path()).unwrap().collect();
        assert_eq!(rest.len(), 1, "{rest:?}");
    }

    #[test]
    fn a_folder_that_others_can_enter_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("sim");
        private_folder(&folder).unwrap();
        private_folder(&folder).unwrap();
        let link = dir.path().join("link");
        symlink(&folder, &link).unwrap();
        assert!(private_folder(&link).is_err());
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).unwrap();
        let error = private_folder(&folder).unwrap_err();
        assert!(error.to_string().contains("no other user"), "{error}");
    }
}
