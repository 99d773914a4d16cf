//! Running a test once more in its own process, not as root.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;

/// The user and group called nobody, which own nothing.
const NOBODY: u32 = 65_534;

/// A command that runs one ignored test of this binary. Root becomes nobody;
/// other users are unprivileged already. `dir` is where the test may work.
pub fn rerun(test: &str, dir: &Path) -> Command {
    // The build directory may be one that nobody may not enter. Another
    // process makes the copy: were it open for writing here, a process that
    // another test is just starting could inherit it, and a file that is open
    // for writing cannot be run.
    let binary = dir.join("test-binary");
    let copy = Command::new("cp")
        .arg(std::env::current_exe().unwrap())
        .arg(&binary)
        .status();
    assert!(copy.unwrap().success(), "the test binary can be copied");
    fs::set_permissions(&binary, fs::Permissions::from_mode(0o755)).unwrap();
    let mut command = Command::new(&binary);
    command
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env("SIM_TEST_DIR", dir);
    command.current_dir("/");
    if rustix::process::geteuid().is_root() {
        command.uid(NOBODY).gid(NOBODY);
    }
    command
}

/// The directory that the parent has prepared.
pub fn dir() -> PathBuf {
    std::env::var_os("SIM_TEST_DIR")
        .expect("the test is run by another one")
        .into()
}
