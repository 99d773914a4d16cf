//! The file that tells scripts that clients can connect.

use std::path::Path;

use anyhow::{Context as _, anyhow};
use rigsim_pty::paths::{HeldResults, Results};

use crate::visible;

/// Exists while the simulator serves.
#[derive(Debug)]
pub(crate) struct ReadyFile {
    _held: HeldResults,
}

impl ReadyFile {
    /// Writes `text` to `path`, in place of one that a killed simulator has left. Its folder must be there,
    /// as for a port.
    pub(crate) fn write(path: &Path, text: &str) -> anyhow::Result<Self> {
        let cannot = || format!("cannot write the ready file {}", visible::name(path));
        let folder = path.parent().filter(|folder| *folder != Path::new(""));
        if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
            let why = anyhow!("there is no directory {}", visible::name(folder));
            return Err(why.context(cannot()));
        }
        let file = Results::at(path, &["\"code\":\"ready\""]).with_context(cannot)?;
        let held = file.hold(text.as_bytes()).with_context(cannot)?;
        Ok(Self { _held: held })
    }
}
