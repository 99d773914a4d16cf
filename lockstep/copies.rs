//! Copies of this program's descriptors in processes that it is about to start. Until such a process has
//! become another program, they keep files open that the programs of runs have closed.

use std::io;
use std::process::{Child, Command};
use std::sync::{PoisonError, RwLock, RwLockWriteGuard};

/// Locked for writing while there may be such copies.
static COPIES: RwLock<()> = RwLock::new(());

/// Waits until there are none, and keeps it so.
#[cfg(target_arch = "x86_64")]
pub(crate) fn none() -> std::sync::RwLockReadGuard<'static, ()> {
    COPIES.read().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps runs from polling files while there are copies.
pub(crate) fn some() -> RwLockWriteGuard<'static, ()> {
    COPIES.write().unwrap_or_else(PoisonError::into_inner)
}

/// Starts another program while there may be runs in this one: for them, it never has their files open.
///
/// # Errors
/// When it cannot be started.
pub fn spawn(command: &mut Command) -> io::Result<Child> {
    let _some = some();
    command.spawn()
}
