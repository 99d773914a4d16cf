//! Temporary folders, which are removed even if the run is killed. That of a run's ports has the same name each
//! time: a client that prints where its port is prints the same each time.

use std::path::PathBuf;

use anyhow::Context as _;
use rigsim_pty::PortErrorKind;
use rigsim_pty::paths::{Held, held_in, private_folder};

use super::case::Case;
use crate::digest::digest;

/// Most folders of the same name at a time.
const MOST: u32 = 1000;

/// Removes what runs that were killed have left.
pub(crate) fn sweep() {
    // In the way of no run.
    let _ = all().and_then(|all| Ok(held_in(&all)?));
}

/// Makes the folder for the ports of a case.
pub(crate) fn take(case: &Case<'_>) -> anyhow::Result<Held> {
    let name = [case.name().as_bytes(), &case.seed.to_ne_bytes()].concat();
    let number = digest(&name) & 0xFFFF_FFFF;
    let name = format!("{}-{number:08x}", case.loaded.stem().to_string_lossy());
    held(&name).with_context(|| format!("cannot make a folder for the ports of {}", case.name()))
}

/// Makes a folder for files that nothing needs afterwards, and removes what runs that were killed have left.
pub(crate) fn scratch() -> anyhow::Result<Held> {
    sweep();
    held(&format!("scratch-{}", std::process::id())).context("cannot make a folder for recordings")
}

/// Makes a folder of this name, with a number behind it if others go on.
fn held(name: &str) -> anyhow::Result<Held> {
    let all = all()?;
    for number in 1..=MOST {
        let name = match number {
            1 => name.to_owned(),
            _ => format!("{name}-{number}"),
        };
        match Held::folder(&all.join(&name)) {
            Err(PortErrorKind::InUse(_)) => {}
            held => return Ok(held?),
        }
    }
    anyhow::bail!("{MOST} of the same go on already")
}

fn all() -> anyhow::Result<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let all = std::env::temp_dir().join(format!("sim-{user}"));
    private_folder(&all)
        .with_context(|| format!("cannot make the folder {} for the ports", all.display()))?;
    Ok(all)
}
