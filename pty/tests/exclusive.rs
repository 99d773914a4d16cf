//! A client that is killed while it holds the port exclusively must not keep
//! all others out, whichever user runs the simulator.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::fs;
use std::io::Write as _;
use std::os::unix::fs::PermissionsExt as _;
use std::os::unix::process::CommandExt as _;
use std::path::Path;
use std::process::{Command, Stdio};

use common::{Bench, Client, unprivileged};
use rigsim_pty::{Event, PtySetup, open_port};
use rustix::io::Errno;
use rustix::termios::ioctl_tiocexcl;

/// Opens the port exclusively in another process and kills that.
fn be_killed_while_exclusive(bench: &mut Bench) {
    let client = bench.client();
    bench.expect(Event::Attached);
    ioctl_tiocexcl(&client).unwrap();
    let mut process = Command::new("sleep")
        .arg("1000")
        .stdin(Stdio::from(client.into_fd()))
        .spawn()
        .unwrap();
    bench.expect_quiet();
    process.kill().unwrap();
    process.wait().unwrap();
    bench.expect(Event::Detached);
}

#[test]
fn an_ordinary_user_s_port_can_be_opened_again() {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let status = unprivileged::rerun("exclusive_flag_without_privileges", dir.path())
        .status()
        .unwrap();
    assert!(status.success(), "failed as an ordinary user: {status}");
    assert!(
        fs::symlink_metadata(dir.path().join("r150")).is_err(),
        "the link is left"
    );
}

#[test]
#[ignore = "run by another test in its own process"]
fn exclusive_flag_without_privileges() {
    assert!(!rustix::process::geteuid().is_root());
    let path = unprivileged::dir().join("r150");
    let mut bench = Bench::new(open_port(&path, PtySetup::raw(115_200)).unwrap());
    for round in 0..5 {
        let before = fs::read_link(&path).unwrap();
        be_killed_while_exclusive(&mut bench);
        // There is no other way in than a new pair, opened before the old
        // one is given up so that the link always leads somewhere.
        assert_ne!(fs::read_link(&path).unwrap(), before, "round {round}");
        bench.expect_quiet();

        let client = Client::open(&path);
        bench.expect(Event::Attached);
        assert_eq!(client.termios().output_speed(), 115_200);
        client.send(b"ping");
        assert_eq!(bench.expect_bytes(4), b"ping");
        let _ = bench.port.write(b"pong").unwrap();
        assert_eq!(client.receive(4), b"pong");
        drop(client);
        bench.expect(Event::Detached);
        bench.expect_quiet();
    }
    // While a client that wants the port for itself is there, it has it.
    let client = bench.client();
    bench.expect(Event::Attached);
    ioctl_tiocexcl(&client).unwrap();
    assert_eq!(Client::try_open(&path).err(), Some(Errno::BUSY));
    bench.expect_quiet();
    assert_eq!(Client::try_open(&path).err(), Some(Errno::BUSY));
}

/// A link that another program has replaced meanwhile is not turned: it is an error,
/// since no client would find the new port.
#[test]
fn a_replaced_link_is_not_turned() {
    let dir = tempfile::tempdir().unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o777)).unwrap();
    let status = unprivileged::rerun("replaced_link_is_not_turned", dir.path())
        .status()
        .unwrap();
    assert!(status.success(), "failed as an ordinary user: {status}");
}

#[test]
#[ignore = "run by another test in its own process"]
fn replaced_link_is_not_turned() {
    let path = unprivileged::dir().join("r150");
    let mut port = open_port(&path, PtySetup::raw(115_200)).unwrap();
    let mut buf = [0; 16];
    let client = Client::open(&path);
    assert_eq!(port.read(&mut buf).unwrap(), Event::Attached);
    ioctl_tiocexcl(&client).unwrap();
    fs::remove_file(&path).unwrap();
    fs::write(&path, "precious").unwrap();
    drop(client);
    let error = port.read(&mut buf).unwrap_err().to_string();
    assert!(error.contains("a regular file"), "{error}");
    drop(port);
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
}

#[test]
fn root_s_port_can_be_opened_by_others_again() {
    if !rustix::process::geteuid().is_root() {
        // Past the capture of passing tests' output, so that it is seen.
        let _ = writeln!(
            std::io::stderr(),
            "SKIPPED root_s_port_can_be_opened_by_others_again: it needs root"
        );
        return;
    }
    let mut bench = Bench::unlinked();
    let node = bench.port.path().to_owned();
    fs::set_permissions(&node, fs::Permissions::from_mode(0o666)).unwrap();
    let open_unprivileged = |node: &Path| {
        let mut shell = Command::new("sh");
        shell
            .args(["-c", "exec 3<>\"$0\""])
            .arg(node)
            .uid(65_534)
            .gid(65_534);
        shell.stderr(Stdio::null()).status().unwrap().success()
    };
    let client = bench.client();
    bench.expect(Event::Attached);
    ioctl_tiocexcl(&client).unwrap();
    assert!(!open_unprivileged(&node), "the flag keeps no user out");
    drop(client);
    bench.expect(Event::Detached);
    be_killed_while_exclusive(&mut bench);
    assert_eq!(bench.port.path(), node, "root keeps the node");
    assert!(open_unprivileged(&node));
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
}
