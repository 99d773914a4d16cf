//! Finding a running simulator by its port.
//!
//! Each holds a file that only its owner can read in a folder that only its owner can enter:
//! `$XDG_RUNTIME_DIR/sim`, or `/tmp/rigsim-control-UID` where that is not set. In it is the URL with
//! the token, and which ports are served.

use std::fs::{self, File};
use std::io::{self, Read as _};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

use rigsim_pty::paths::{Held, held_in, private_folder};
use serde::{Deserialize, Serialize};

/// No file of ours is longer.
const MOST_BYTES: u64 = 1 << 16;

/// A running simulator.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Session {
    /// Its process.
    pub(crate) pid: u32,
    /// URL at which it is controlled, with the token.
    pub(crate) url: String,
    /// The paths of its ports.
    pub(crate) ports: Vec<PathBuf>,
}

impl Session {
    /// Writes its file, which goes when it is dropped.
    ///
    /// # Errors
    /// When the folder is not ours alone, or cannot be written.
    pub(crate) fn publish(&self) -> anyhow::Result<Held> {
        self.publish_in(&folder())
    }

    fn publish_in(&self, folder: &Path) -> anyhow::Result<Held> {
        static COUNT: AtomicU32 = AtomicU32::new(0);
        private_folder(folder)?;
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = folder.join(format!("{}-{count}.json", self.pid));
        Ok(Held::file(&path, &serde_json::to_vec(self)?)?)
    }

    /// All that run, of this user.
    ///
    /// # Errors
    /// When the folder is not ours alone, or cannot be read.
    pub(crate) fn running() -> io::Result<Vec<Self>> {
        Self::running_in(&folder())
    }

    fn running_in(folder: &Path) -> io::Result<Vec<Self>> {
        if !folder.exists() {
            return Ok(Vec::new());
        }
        private_folder(folder)?;
        let held = held_in(folder)?;
        Ok(held.iter().filter_map(|path| read(path)).collect())
    }

    /// Returns whether this is one of its ports, by its own name or another.
    pub(crate) fn serves(&self, port: &Path) -> bool {
        let real = |path: &Path| fs::canonicalize(path).ok();
        let (absolute, wanted) = (std::path::absolute(port).ok(), real(port));
        // An address is no path, and the link of a pulled cable leads nowhere.
        self.ports.iter().any(|served| {
            served == port
                || Some(served) == absolute.as_ref()
                || wanted.is_some() && real(served) == wanted
        })
    }
}

/// Where the files are.
fn folder() -> PathBuf {
    let runtime = std::env::var_os("XDG_RUNTIME_DIR").map(PathBuf::from);
    match runtime.filter(|path| path.is_absolute()) {
        Some(path) => path.join("sim"),
        None => PathBuf::from(format!(
            "/tmp/rigsim-control-{}",
            rustix::process::geteuid().as_raw()
        )),
    }
}

fn read(path: &Path) -> Option<Session> {
    let mut text = String::new();
    let file = File::open(path).ok()?;
    file.take(MOST_BYTES).read_to_string(&mut text).ok()?;
    serde_json::from_str(&text).ok()
}

#[cfg(test)]
mod tests;
