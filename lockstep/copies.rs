//! Copies of this program's descriptors in processes that it is about to start. Until exec, these copies
//! keep files open that the programs of runs have closed.

use std::io;
use std::process::{Child, Command};
use std::sync::{PoisonError, RwLock, RwLockWriteGuard};

/// Locked for writing while copies may exist.
static COPIES: RwLock<()> = RwLock::new(());

/// Waits until no copies exist; none are made while the guard is held.
#[cfg(target_arch = "x86_64")]
pub(crate) fn none() -> std::sync::RwLockReadGuard<'static, ()> {
    COPIES.read().unwrap_or_else(PoisonError::into_inner)
}

/// Keeps runs from polling files while copies exist.
pub(crate) fn some() -> RwLockWriteGuard<'static, ()> {
    COPIES.write().unwrap_or_else(PoisonError::into_inner)
}

/// Starts another program beside runs in this one, which never see their files open in it.
///
/// # Errors
/// When it cannot be started.
pub fn spawn(command: &mut Command) -> io::Result<Child> {
    let _some = some();
    command.spawn()
}
