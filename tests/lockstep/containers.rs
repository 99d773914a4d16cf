//! Containers, which refuse some syscalls.

use std::process::Command;

use super::harness::live::{DRIVE, Folder, drive_with};
use super::harness::python;
use super::{FORBIDDING, built, folder, has};

/// Plays a client in Python under the default profile of containers, twice; what `sim` prints.
fn contained(args: &[&str], client: &[&str]) -> Option<String> {
    let python = python()?;
    let folder = folder();
    let pulled = drive_with("{ kind = \"cable-pulled\" }", "1 s");
    std::fs::write(folder.file("pulled.toml"), pulled).unwrap();
    let tests = concat!(env!("CARGO_MANIFEST_DIR"), "/tests");
    let ended = Command::new(python)
        .arg(format!("{tests}/lockstep/container.py"))
        .args([env!("CARGO_BIN_EXE_sim"), "run", "--twice", "--seed", "3"])
        .args(args)
        .args(["pulled.toml", "--", python])
        .args(client)
        .current_dir(folder.path())
        .output()
        .unwrap();
    let printed = String::from_utf8_lossy(&ended.stdout).into_owned();
    let errors = String::from_utf8_lossy(&ended.stderr);
    assert_eq!(
        ended.status.code(),
        Some(0),
        "{client:?}: {printed}{errors}"
    );
    assert!(!printed.contains("waited for"), "{client:?}: {printed}");
    Some(printed)
}

#[test]
fn the_default_profile_of_containers_needs_no_flag() {
    for name in ["threads.py", "with_asyncio.py"] {
        let client = format!("{}/tests/clients/{name}", env!("CARGO_MANIFEST_DIR"));
        let Some(printed) = contained(&[], &[&client]) else {
            return;
        };
        let note = "not repeatable: addresses are random";
        assert_eq!(printed.matches(note).count(), 1, "{printed}");
        let printed = contained(&["--random", "real"], &[&client]).unwrap_or_default();
        assert!(!printed.contains("not repeatable"), "{printed}");
    }
}

/// Everything that can be waited for has to be passed there, and comes with the time that is left.
#[test]
fn waits_are_the_same_under_the_default_profile() {
    let code = r"
import ctypes, os, selectors, signal, socket, subprocess, threading, time
fd = os.open(os.environ['SIM_R150_PORT'], os.O_RDWR | os.O_NOCTTY)
begun = time.monotonic()
def after(seconds, do):
    threading.Thread(target=lambda: (time.sleep(seconds), do())).start()
def at(expected, what):
    now = time.monotonic() - begun
    assert abs(now - expected) < 0.001, (what, now)
reader, writer = os.pipe()
after(0.1, lambda: os.write(writer, b'x'))
assert os.read(reader, 1) == b'x'
at(0.1, 'pipe')
one, other = socket.socketpair()
after(0.1, lambda: other.send(b'y'))
epoll = selectors.DefaultSelector()
epoll.register(one, selectors.EVENT_READ)
assert epoll.select(5) and one.recv(1) == b'y'
at(0.2, 'socket')
after(0.1, lambda: os.close(writer))
assert os.read(reader, 1) == b''
at(0.3, 'end')
c = ctypes.CDLL(None)
timer = c.timerfd_create(1, 0)
times = (ctypes.c_long * 4)(0, 0, 0, 100_000_000)
assert c.timerfd_settime(timer, 0, times, None) == 0
assert os.read(timer, 8)[0] == 1
at(0.4, 'timer')
assert subprocess.run(['sleep', '0.1'], capture_output=True).returncode == 0
at(0.5, 'child')
reader, writer = os.pipe()
after(0.1, lambda: os.write(writer, b'z'))
sets, left = (ctypes.c_ulong * 16)(), (ctypes.c_long * 2)(2, 0)
sets[reader // 64] = 1 << reader % 64
assert c.select(reader + 1, sets, None, None, left) == 1
assert left[0] == 1 and left[1] == 899_950, left[:]
at(0.6, 'select')
assert c.select(reader + 1, sets, None, None, left) == 1
assert left[0] == 1 and left[1] == 899_950, left[:]
time.sleep(2)
";
    contained(&[], &["-c", code]);
}

#[test]
fn what_a_container_refuses_is_named_with_the_remedy() {
    if !has("cc", &["--version"]) {
        return;
    }
    let folder = Folder::with(&[("drive.toml", DRIVE), ("forbidding.c", FORBIDDING)]);
    let source = folder.file("forbidding.c");
    let forbidding = built(&folder, "cc", &[source.to_str().unwrap()]);
    let forbid = |call: &str| {
        let ended = Command::new(&forbidding)
            .args([call, env!("CARGO_BIN_EXE_sim"), "run", "drive.toml", "--"])
            .args(["sh", "-c", "exec 3<>$SIM_R150_PORT; echo x | cat"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let printed = String::from_utf8_lossy(&ended.stdout).into_owned();
        (ended.status.code(), printed)
    };
    for (call, name) in [
        ("101", "ptrace"),
        ("310", "process_vm_readv"),
        ("317", "seccomp"),
        // Made by the client before it becomes the program.
        ("109", "setpgid"),
    ] {
        let (code, printed) = forbid(call);
        assert_eq!(code, Some(3), "{call}: {printed}");
        let wanted = format!(
            "this system refuses {name} (Operation not permitted (os error 1)), which a container's \
             seccomp profile has to allow, so the client cannot run in the simulator's time; --time \
             real runs it in real time"
        );
        assert!(printed.contains(&wanted), "{call}: {printed}");
    }
    // personality, pidfd_open and pidfd_getfd.
    for call in ["135", "434", "438"] {
        let (code, printed) = forbid(call);
        assert_eq!(code, Some(0), "{call}: {printed}");
    }
}
