//! The folder of a run's ports, which has the same name each time: a client that prints where its
//! port is prints the same each time.

use std::hash::Hasher as _;
use std::path::PathBuf;

use anyhow::Context as _;
use rigsim_pty::PortErrorKind;
use rigsim_pty::paths::{Held, held_in, private_folder};

use super::case::Case;

/// Most runs of the same that may go on at the same time.
const MOST: u32 = 1000;

/// Removes what runs that were killed have left.
pub(crate) fn sweep() {
    // In the way of no run.
    let _ = all().and_then(|all| Ok(held_in(&all)?));
}

/// Makes the folder for the ports of a case.
pub(crate) fn take(case: &Case<'_>) -> anyhow::Result<Held> {
    let all = all()?;
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
        match Held::folder(&all.join(&name)) {
            Err(PortErrorKind::InUse(_)) => {}
            held => return held.context("cannot make a folder for the ports"),
        }
    }
    anyhow::bail!("{MOST} runs of {} go on already", case.name())
}

fn all() -> anyhow::Result<PathBuf> {
    let user = rustix::process::geteuid().as_raw();
    let all = std::env::temp_dir().join(format!("sim-{user}"));
    private_folder(&all)
        .with_context(|| format!("cannot make the folder {} for the ports", all.display()))?;
    Ok(all)
}
