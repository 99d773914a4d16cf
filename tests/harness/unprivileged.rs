//! Running a test once more in its own process, not as root, to which exclusive ports and
//! file permissions mean nothing.

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::Command;

/// Names the copy of the program that such a test may execute.
pub const BINARY: &str = "SIM_TEST_BINARY";
/// The user and group that own nothing.
const NOBODY: u32 = 65_534;

/// A command that runs one ignored test of this binary. Root becomes that user; any other is
/// unprivileged already.
pub fn rerun(test: &str, dir: &Path) -> Command {
    let sim = copy_of_sim(dir);
    // The build directory may be one that this user may not enter.
    let binary = copy(&std::env::current_exe().unwrap(), &dir.join("test-binary"));
    let mut command = Command::new(binary);
    command
        .args(["--exact", test, "--ignored", "--nocapture"])
        .env(BINARY, sim)
        .current_dir("/");
    if rustix::process::geteuid().is_root() {
        command.uid(NOBODY).gid(NOBODY);
    }
    command
}

/// Whether this process was started by [`rerun`] and not by a user who runs ignored tests.
pub fn is_rerun() -> bool {
    std::env::var_os(BINARY).is_some()
}

/// A copy of the program in `dir` that every user may execute.
pub fn copy_of_sim(dir: &Path) -> std::path::PathBuf {
    fs::set_permissions(dir, fs::Permissions::from_mode(0o755)).unwrap();
    copy(Path::new(env!("CARGO_BIN_EXE_sim")), &dir.join("sim"))
}

/// Copies a program in another process: were the copy open for writing in this one, a process that
/// another test is just starting could inherit it, and a file open for writing cannot be run.
fn copy(from: &Path, to: &Path) -> std::path::PathBuf {
    let status = Command::new("cp").arg(from).arg(to).status();
    assert!(status.unwrap().success(), "the program can be copied");
    fs::set_permissions(to, fs::Permissions::from_mode(0o755)).unwrap();
    to.to_owned()
}
