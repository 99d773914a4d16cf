//! The file that tells scripts that clients can connect.

use std::path::Path;

use anyhow::{Context as _, anyhow};
use rigsim_pty::paths::{HeldResults, Results};

use crate::visible;

/// Writes `text` to `path`, in place of a ready file that a killed simulator has left. It is there as long as
/// what is returned. Its folder must be there, as for a port.
pub(crate) fn hold(path: &Path, text: &str) -> anyhow::Result<HeldResults> {
    let cannot = || format!("cannot write the ready file {}", visible::name(path));
    let folder = path.parent().filter(|folder| *folder != Path::new(""));
    if let Some(folder) = folder.filter(|folder| !folder.is_dir()) {
        let why = anyhow!("there is no directory {}", visible::name(folder));
        return Err(why.context(cannot()));
    }
    let file = Results::at(path, &["\"code\":\"ready\""]).with_context(cannot)?;
    file.hold(text.as_bytes()).with_context(cannot)
}
