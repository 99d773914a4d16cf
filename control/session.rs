//! Finding a running simulator by its port.
//!
//! Each writes a file that only its owner can read into a folder that only its owner can enter:
//! `$XDG_RUNTIME_DIR/sim`, or `/tmp/sim-control-UID` where that is not set. In it is the URL with
//! the token, and which ports are served. The simulator holds a lock on the file while it runs, so
//! that what a killed one has left is told apart and removed.

use std::fs::{self, DirBuilder, File, OpenOptions, TryLockError};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _, OpenOptionsExt as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use serde::{Deserialize, Serialize};

/// No file of ours is longer.
const MOST_BYTES: u64 = 1 << 16;
/// Most files that are looked at.
const MOST_FILES: usize = 1000;

/// A running simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub struct Session {
    /// Its process.
    pub pid: u32,
    /// URL at which it is controlled, with the token.
    pub url: String,
    /// The paths of its ports.
    pub ports: Vec<PathBuf>,
}

/// The file of a session, which goes when this is dropped.
#[derive(Debug)]
pub struct SessionFile {
    path: PathBuf,
    _locked: File,
}

impl Session {
    /// Writes its file.
    ///
    /// # Errors
    /// When the folder is not ours alone, or cannot be written.
    pub fn publish(&self) -> io::Result<SessionFile> {
        self.publish_in(&folder())
    }

    fn publish_in(&self, folder: &Path) -> io::Result<SessionFile> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        own(folder)?;
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = folder.join(format!("{}-{count}.json", self.pid));
        let draft = folder.join(format!("{}-{count}.draft", self.pid));
        // Left by a process that had the same number.
        let _ = fs::remove_file(&draft);
        let mut file = OpenOptions::new()
            .write(true)
            .create_new(true)
            .mode(0o600)
            .open(&draft)?;
        let written = file
            .lock()
            .and_then(|()| serde_json::to_writer(&file, self).map_err(io::Error::other))
            .and_then(|()| file.write_all(b"\n"))
            .and_then(|()| fs::rename(&draft, &path));
        if let Err(error) = written {
            let _ = fs::remove_file(&draft);
            return Err(error);
        }
        Ok(SessionFile {
            path,
            _locked: file,
        })
    }

    /// All that run, of this user.
    ///
    /// # Errors
    /// When the folder is not ours alone, or cannot be read.
    pub fn running() -> io::Result<Vec<Self>> {
        Self::running_in(&folder())
    }

    fn running_in(folder: &Path) -> io::Result<Vec<Self>> {
        if !folder.exists() {
            return Ok(Vec::new());
        }
        own(folder)?;
        let mut paths: Vec<PathBuf> = fs::read_dir(folder)?
            .filter_map(|entry| Some(entry.ok()?.path()))
            .filter(|path| path.extension().is_some_and(|ending| ending == "json"))
            .take(MOST_FILES)
            .collect();
        paths.sort();
        Ok(paths.iter().filter_map(|path| read(path)).collect())
    }

    /// Tells whether this is one of its ports, by its own name or another.
    #[must_use]
    pub fn serves(&self, port: &Path) -> bool {
        let real = |path: &Path| fs::canonicalize(path).ok();
        let wanted = real(port);
        self.ports
            .iter()
            .any(|own| own == port || (wanted.is_some() && real(own) == wanted))
    }
}

impl SessionFile {
    /// Path of it.
    #[must_use]
    pub fn path(&self) -> &Path {
        &self.path
    }
}

impl Drop for SessionFile {
    fn drop(&mut self) {
        let _ = fs::remove_file(&self.path);
    }
}

/// Where the files are.
fn folder() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    match runtime.filter(|path| path.is_absolute()) {
        Some(path) => path.join("sim"),
        None => PathBuf::from(format!(
            "/tmp/sim-control-{}",
            rustix::process::geteuid().as_raw()
        )),
    }
}

/// Makes the folder if it is not there, and refuses it if others could have a hand in it.
fn own(folder: &Path) -> io::Result<()> {
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
        "{} has to be a folder of yours that nobody else can enter",
        folder.display()
    );
    Err(io::Error::new(io::ErrorKind::PermissionDenied, why))
}

/// The session in a file, if its simulator runs; otherwise the file is removed.
fn read(path: &Path) -> Option<Session> {
    let file = File::open(path).ok()?;
    match file.try_lock_shared() {
        Err(TryLockError::WouldBlock) => {}
        Err(TryLockError::Error(_)) => return None,
        Ok(()) => {
            let _ = fs::remove_file(path);
            return None;
        }
    }
    let mut text = String::new();
    file.take(MOST_BYTES).read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::{PermissionsExt as _, symlink};

    fn session(port: &Path) -> Session {
        Session {
            pid: std::process::id(),
            url: "http://127.0.0.1:1/#token=x".to_owned(),
            ports: vec![port.to_owned()],
        }
    }

    #[test]
    fn a_session_is_found_while_it_runs_and_by_any_name_of_its_port() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("sim");
        assert_eq!(Session::running_in(&folder).unwrap(), []);
        let (port, link) = (dir.path().join("port"), dir.path().join("link"));
        fs::write(&port, "").unwrap();
        symlink(&port, &link).unwrap();
        let own = session(&link);
        let file = own.publish_in(&folder).unwrap();
        let mode = fs::metadata(file.path()).unwrap().permissions().mode();
        assert_eq!(mode & 0o777, 0o600);
        assert_eq!(
            Session::running_in(&folder).unwrap(),
            std::slice::from_ref(&own)
        );
        assert!(own.serves(&port) && own.serves(&link));
        assert!(!own.serves(dir.path()) && !own.serves(&dir.path().join("gone")));
        drop(file);
        assert_eq!(Session::running_in(&folder).unwrap(), []);
    }

    #[test]
    fn what_a_killed_simulator_has_left_is_removed() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("sim");
        own(&folder).unwrap();
        let left = folder.join("1-0.json");
        fs::write(&left, serde_json::to_string(&session(&left)).unwrap()).unwrap();
        assert_eq!(Session::running_in(&folder).unwrap(), []);
        assert!(!left.exists());
    }

    #[test]
    fn a_folder_that_others_can_enter_is_refused() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("sim");
        fs::create_dir(&folder).unwrap();
        fs::set_permissions(&folder, fs::Permissions::from_mode(0o755)).unwrap();
        let error = session(&folder).publish_in(&folder).unwrap_err();
        assert!(error.to_string().contains("nobody else"), "{error}");
        assert!(Session::running_in(&folder).is_err());
        let link = dir.path().join("link");
        symlink(&folder, &link).unwrap();
        assert!(session(&folder).publish_in(&link).is_err());
    }
}
