//! The folder of a run's ports, which has the same name each time: a client that prints where its
//! port is prints the same each time.

use std::fs::{self, DirBuilder, File};
use std::hash::Hasher as _;
use std::io;
use std::os::unix::fs::{DirBuilderExt as _, MetadataExt as _};
use std::path::{Path, PathBuf};

use anyhow::Context as _;
use rustix::fs::FlockOperation;

use super::case::Case;

/// Most runs of the same that may go on at the same time.
const MOST: u32 = 1000;

/// A folder, removed on drop. It is locked, so that what a killed run has left is known as such.
pub(crate) struct Folder {
    pub(crate) path: PathBuf,
    /// Beside it, and never removed by others while it is held.
    lock: (PathBuf, File),
}

impl Folder {
    /// The folder for the ports of a case.
    pub(crate) fn take(case: &Case<'_>) -> anyhow::Result<Self> {
        let user = rustix::process::geteuid().as_raw();
        let all = std::env::temp_dir().join(format!("sim-{user}"));
        make(&all, user)
            .with_context(|| format!("cannot make the folder {} for the ports", all.display()))?;
        let mut name = std::hash::DefaultHasher::new();
        name.write(case.name().as_bytes());
        name.write_u64(case.seed);
        let name = format!(
            "{}-{:08x}",
            case.loaded.stem().to_string_lossy(),
            name.finish() & 0xFFFF_FFFF
        );
        for number in 1..=MOST {
            let name = match number {
                1 => name.clone(),
                _ => format!("{name}-{number}"),
            };
            let folder = Self::at(&all, &name);
            let folder = folder.context("cannot make a folder for the ports")?;
            if let Some(folder) = folder {
                return Ok(folder);
            }
        }
        anyhow::bail!("{MOST} runs of {} go on already", case.name())
    }

    /// That folder, unless another run has it.
    fn at(all: &Path, name: &str) -> io::Result<Option<Self>> {
        let lock_path = all.join(format!("{name}.lock"));
        let lock = File::options()
            .create(true)
            .truncate(false)
            .write(true)
            .open(&lock_path)?;
        if rustix::fs::flock(&lock, FlockOperation::NonBlockingLockExclusive).is_err() {
            return Ok(None);
        }
        // Somebody may have removed it after it was opened and before it was locked.
        let (held, there) = (lock.metadata()?, fs::metadata(&lock_path));
        if there.is_err() || there.is_ok_and(|there| there.ino() != held.ino()) {
            return Ok(None);
        }
        let path = all.join(name);
        match fs::remove_dir_all(&path) {
            Err(error) if error.kind() != io::ErrorKind::NotFound => return Err(error),
            _ => {}
        }
        fs::create_dir(&path)?;
        Ok(Some(Self {
            path,
            lock: (lock_path, lock),
        }))
    }
}

impl Drop for Folder {
    fn drop(&mut self) {
        // Whatever cannot be removed is taken over by the next run of the same.
        let _ = fs::remove_dir_all(&self.path);
        let _ = fs::remove_file(&self.lock.0);
    }
}

/// Makes a folder that is this user's alone, or finds it.
fn make(path: &Path, user: u32) -> anyhow::Result<()> {
    match DirBuilder::new().mode(0o700).create(path) {
        Err(error) if error.kind() == io::ErrorKind::AlreadyExists => {}
        made => made?,
    }
    let found = fs::symlink_metadata(path)?;
    anyhow::ensure!(
        found.is_dir() && found.uid() == user,
        "it belongs to somebody else"
    );
    Ok(())
}
