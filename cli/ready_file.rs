//! The file that tells scripts that clients can connect.

use std::fs;
use std::path::{Path, PathBuf};

use anyhow::Context as _;

/// Exists while the simulator serves.
#[derive(Debug)]
pub(crate) struct ReadyFile {
    path: PathBuf,
}

impl ReadyFile {
    /// Writes `text` to a new file beside `path` and moves it there, so that nobody reads half.
    pub(crate) fn write(path: &Path, text: &str) -> anyhow::Result<Self> {
        let mut draft = path.as_os_str().to_owned();
        draft.push(format!(".{}", std::process::id()));
        let draft = PathBuf::from(draft);
        fs::write(&draft, text)
            .and_then(|()| fs::rename(&draft, path))
            .inspect_err(|_| drop(fs::remove_file(&draft)))
            .with_context(|| format!("cannot write the ready file {}", path.display()))?;
        Ok(Self {
            path: path.to_owned(),
        })
    }
}

impl Drop for ReadyFile {
    fn drop(&mut self) {
        // Somebody may have tidied it up already.
        let _ = fs::remove_file(&self.path);
    }
}
