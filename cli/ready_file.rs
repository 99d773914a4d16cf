//! The file that tells scripts that clients can connect.

use std::fs::{self, File};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

use anyhow::{Context as _, anyhow};
use serde_json::Value;

use crate::{visible, whole_file};

/// No ready file of ours is longer.
const MOST_BYTES: u64 = 1 << 16;

/// Exists while the simulator serves.
#[derive(Debug)]
pub(crate) struct ReadyFile {
    path: PathBuf,
    text: String,
}

impl ReadyFile {
    /// Writes `text` to a new file beside `path` and moves it there, so that nobody reads half. It
    /// replaces nothing but a ready file, which a simulator that was killed has left.
    pub(crate) fn write(path: &Path, text: &str) -> anyhow::Result<Self> {
        place(path, text)
            .with_context(|| format!("cannot write the ready file {}", visible::name(path)))?;
        Ok(Self {
            path: path.to_owned(),
            text: text.to_owned(),
        })
    }
}

impl Drop for ReadyFile {
    fn drop(&mut self) {
        // Somebody may have tidied it up already, or put something else there.
        if read(&self.path).is_ok_and(|text| text == self.text) {
            let _ = fs::remove_file(&self.path);
        }
    }
}

fn place(path: &Path, text: &str) -> anyhow::Result<()> {
    let mut draft = whole_file::draft(path)?;
    draft.write_all(text.as_bytes())?;
    let draft = match draft.persist_noclobber(path) {
        Err(there) if there.error.kind() == io::ErrorKind::AlreadyExists => there.file,
        outcome => return Ok(outcome.map(drop).map_err(|refused| refused.error)?),
    };
    let ours = read(path).is_ok_and(|text| {
        serde_json::from_str(&text).is_ok_and(|value: Value| value["code"] == "ready")
    });
    if !ours {
        return Err(anyhow!(
            "something else is there, which is left alone; remove it or choose another path"
        ));
    }
    draft.persist(path).map_err(|refused| refused.error)?;
    Ok(())
}

/// The content of an ordinary file that is not too long.
fn read(path: &Path) -> io::Result<String> {
    if !fs::symlink_metadata(path)?.is_file() {
        return Err(io::ErrorKind::InvalidInput.into());
    }
    let mut text = String::new();
    File::open(path)?
        .take(MOST_BYTES)
        .read_to_string(&mut text)?;
    Ok(text)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::os::unix::fs::symlink;

    const READY: &str = "{\"code\":\"ready\",\"pid\":1}\n";

    fn count(dir: &Path) -> usize {
        fs::read_dir(dir).unwrap().count()
    }

    #[test]
    fn it_comes_and_goes_and_replaces_only_its_like() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("ready");
        drop(ReadyFile::write(&path, READY).unwrap());
        assert_eq!(count(dir.path()), 0);

        fs::write(&path, READY).unwrap();
        let file = ReadyFile::write(&path, "{\"code\":\"ready\",\"pid\":2}\n").unwrap();
        assert!(fs::read_to_string(&path).unwrap().contains('2'));
        drop(file);
        assert_eq!(count(dir.path()), 0);
    }

    #[test]
    fn what_is_not_a_ready_file_is_left_alone() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("ready");
        for precious in ["", "precious", "{\"code\":\"precious\"}", "[1]"] {
            fs::write(&path, precious).unwrap();
            let error = ReadyFile::write(&path, READY).unwrap_err();
            assert!(format!("{error:#}").contains("left alone"), "{error:#}");
            assert_eq!(fs::read_to_string(&path).unwrap(), precious);
            assert_eq!(count(dir.path()), 1);
        }
        fs::remove_file(&path).unwrap();
        let target = dir.path().join("target");
        fs::write(&target, READY).unwrap();
        symlink(&target, &path).unwrap();
        assert!(ReadyFile::write(&path, READY).is_err());
        assert_eq!(fs::read_link(&path).unwrap(), target);
    }

    #[test]
    fn what_somebody_has_put_in_its_place_is_not_removed() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("ready");
        let file = ReadyFile::write(&path, READY).unwrap();
        fs::write(&path, "precious").unwrap();
        drop(file);
        assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    }
}
