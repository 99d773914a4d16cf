//! Files that are there as a whole or not at all, even if the program is killed while it writes them.

use std::fs::{self, File, OpenOptions, Permissions};
use std::io::{self, Read as _, Write as _};
use std::os::unix::fs::{OpenOptionsExt as _, PermissionsExt as _};
use std::path::Path;

use anyhow::{Context as _, anyhow};
use tempfile::NamedTempFile;

use crate::visible;

/// Most bytes of a file already there that are looked at.
const GLANCE: u64 = 4096;

/// Place for results.
pub(crate) enum Target {
    /// A file that may be replaced.
    File,
    /// A pipe or a terminal, which takes them once, at the end.
    Stream(File),
}

impl Target {
    /// Writes results to `path`, for which this was found.
    pub(crate) fn write(&self, path: &Path, bytes: &[u8]) -> io::Result<()> {
        match self {
            Self::File => write(path, bytes),
            Self::Stream(stream) => (&*stream).write_all(bytes),
        }
    }

    /// Finds out how results can be written to `path`. A file that is neither empty nor begins with
    /// one of these marks, as `what` does, is left alone. Makes the folder that it is in.
    ///
    /// # Errors
    /// When they cannot.
    pub(crate) fn find(path: &Path, what: &str, marks: &[&str]) -> anyhow::Result<Self> {
        if let Some(parent) = path.parent() {
            fs::create_dir_all(parent)
                .with_context(|| format!("cannot make the folder {}", visible::name(parent)))?;
        }
        let metadata = match fs::metadata(path) {
            Ok(metadata) => metadata,
            Err(error) if error.kind() == io::ErrorKind::NotFound => return Ok(Self::File),
            Err(error) => return Err(error.into()),
        };
        if metadata.is_dir() {
            return Err(anyhow!("it is a folder"));
        }
        if !metadata.is_file() {
            return Ok(Self::Stream(create(path)?));
        }
        let mut begin = Vec::new();
        File::open(path)?.take(GLANCE).read_to_end(&mut begin)?;
        let begin = String::from_utf8_lossy(&begin);
        if begin.is_empty() || marks.iter().any(|mark| begin.contains(mark)) {
            return Ok(Self::File);
        }
        Err(anyhow!(
            "something else than {what} is there, which is left alone; remove it or choose another \
             path"
        ))
    }
}

/// Opens a file to be written anew, or a stream. A named pipe that nobody reads is an error, since it
/// would keep this waiting for ever.
pub(crate) fn create(path: &Path) -> io::Result<File> {
    let nonblocking = rustix::fs::OFlags::NONBLOCK;
    let mut options = OpenOptions::new();
    options.write(true).create(true).truncate(true);
    let file = options
        .custom_flags(nonblocking.bits().cast_signed())
        .open(path)?;
    let flags = rustix::fs::fcntl_getfl(&file)?;
    rustix::fs::fcntl_setfl(&file, flags - nonblocking)?;
    Ok(file)
}

/// A new file beside `path`, to be moved there.
pub(crate) fn draft(path: &Path) -> io::Result<NamedTempFile> {
    let folder = match path.parent() {
        Some(parent) if !parent.as_os_str().is_empty() => parent,
        _ => Path::new("."),
    };
    tempfile::Builder::new()
        .prefix(".sim-")
        // The system takes away what the user does not want others to have.
        .permissions(Permissions::from_mode(0o666))
        .tempfile_in(folder)
}

/// Writes a file beside `path` and moves it there. A link is followed; what is there keeps its
/// permissions.
pub(crate) fn write(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let real = fs::canonicalize(path);
    let path = real.as_deref().unwrap_or(path);
    let old = fs::metadata(path).map(|metadata| metadata.permissions());
    let mut draft = draft(path)?;
    draft.write_all(bytes)?;
    if let Ok(old) = old {
        draft.as_file().set_permissions(old)?;
    }
    draft.persist(path)?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    #[test]
    fn it_replaces_a_file_behind_a_link_and_leaves_no_other() {
        let dir = tempfile::tempdir().unwrap();
        let (path, link) = (dir.path().join("file"), dir.path().join("link"));
        write(&path, b"one").unwrap();
        let mode = || fs::metadata(&path).unwrap().permissions().mode() & 0o777;
        assert_eq!(mode() & 0o400, 0o400);
        fs::set_permissions(&path, Permissions::from_mode(0o640)).unwrap();
        symlink(&path, &link).unwrap();
        write(&link, b"two").unwrap();
        assert_eq!(fs::read(&path).unwrap(), b"two");
        assert_eq!(mode(), 0o640);
        assert!(fs::symlink_metadata(&link).unwrap().is_symlink());
        assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    }
}
