//! The link: what it may replace, what it must not, and when it goes.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::fs;
use std::os::unix::fs::{FileTypeExt as _, PermissionsExt as _, symlink};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Barrier;

use common::{Client, until};
use rigsim_pty::{Event, Port, PortErrorKind, PtySetup, open_port, open_unlinked_port};
use rustix::termios::LocalModes;

const SETUP: PtySetup = PtySetup::raw(115_200);

fn refused(path: &Path) -> (PortErrorKindName, String) {
    let error = open_port(path, SETUP).expect_err("the path is refused");
    assert_eq!(error.path(), path);
    let name = match error.kind() {
        PortErrorKind::Occupied(_) => PortErrorKindName::Occupied,
        PortErrorKind::InUse(_) => PortErrorKindName::InUse,
        PortErrorKind::MissingDirectory(_) => PortErrorKindName::MissingDirectory,
        PortErrorKind::NotAFileName => PortErrorKindName::NotAFileName,
        other => panic!("unexpected {other:?}"),
    };
    (name, error.to_string())
}

#[derive(Debug, PartialEq)]
enum PortErrorKindName {
    Occupied,
    InUse,
    MissingDirectory,
    NotAFileName,
}
use PortErrorKindName::{InUse, MissingDirectory, NotAFileName, Occupied};

fn names(dir: &Path) -> Vec<PathBuf> {
    let mut names: Vec<_> = fs::read_dir(dir)
        .unwrap()
        .map(|entry| entry.unwrap().file_name().into())
        .collect();
    names.sort();
    names
}

/// Returns whether a client that opens the path is at this port.
fn leads_to(path: &Path, port: &mut Box<dyn Port>) -> bool {
    let _client = Client::open(path);
    port.read(&mut [0; 16]).unwrap() == Event::Attached
}

#[test]
fn the_link_leads_to_a_port_that_is_ready_and_goes_with_it() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let mut port = open_port(&path, PtySetup::raw(250_000)).unwrap();
    assert_eq!(port.path(), path);
    assert!(leads_to(&path, &mut port));
    assert!(fs::metadata(&path).unwrap().file_type().is_char_device());
    assert_eq!(Client::open(&path).termios().output_speed(), 250_000);
    drop(port);
    assert_eq!(names(dir.path()), [] as [PathBuf; 0]);
}

#[test]
fn a_client_that_sees_the_link_finds_a_raw_port() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    std::thread::scope(|scope| {
        let watcher = scope.spawn(|| {
            for _ in 0..20 {
                let mut client = None;
                until("there is a client end", || {
                    client = Client::try_open(&path).ok();
                    client.is_some()
                });
                let termios = client.unwrap().termios();
                assert!(!termios.local_modes.contains(LocalModes::ECHO));
                assert_eq!(termios.output_speed(), SETUP.baud);
            }
        });
        while !watcher.is_finished() {
            drop(open_port(&path, SETUP).unwrap());
        }
    });
}

#[test]
fn a_file_a_directory_and_foreign_links_are_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");

    fs::write(&path, "precious").unwrap();
    let (kind, message) = refused(&path);
    assert_eq!(kind, Occupied);
    assert!(
        message.contains("a regular file") && message.contains("remove it"),
        "{message}"
    );
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    assert_eq!(names(dir.path()), [Path::new("r150")]);
    fs::remove_file(&path).unwrap();

    fs::create_dir(&path).unwrap();
    let (kind, message) = refused(&path);
    assert_eq!(kind, Occupied);
    assert!(message.contains("a directory"), "{message}");
    fs::remove_dir(&path).unwrap();

    for target in [
        "/dev/null",
        "/nowhere/at/all",
        "/dev/pts/ptmx",
        "/dev/pts/5x",
        "precious",
    ] {
        symlink(target, &path).unwrap();
        let (kind, message) = refused(&path);
        assert_eq!(kind, Occupied);
        assert!(
            message.contains(&format!("a symbolic link to {target}")),
            "{message}"
        );
        assert_eq!(fs::read_link(&path).unwrap(), Path::new(target));
        fs::remove_file(&path).unwrap();
    }
    assert_eq!(names(dir.path()), [] as [PathBuf; 0]);
}

#[test]
fn a_link_to_another_program_s_terminal_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let terminal = open_unlinked_port(SETUP).unwrap();
    symlink(terminal.path(), &path).unwrap();
    assert_eq!(refused(&path).0, Occupied);
    assert_eq!(fs::read_link(&path).unwrap(), terminal.path());
}

#[test]
fn a_link_to_a_terminal_that_is_gone_is_replaced_if_it_is_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    symlink("/dev/pts/4294967", &path).unwrap();
    assert_eq!(refused(&path).0, Occupied);
    fs::write(dir.path().join(".r150.sim-lock"), "1\n/dev/pts/4294967\n").unwrap();
    let mut port = open_port(&path, SETUP).unwrap();
    assert!(leads_to(&path, &mut port));
    drop(port);
    assert_eq!(names(dir.path()), [] as [PathBuf; 0]);
}

#[test]
fn a_recorded_link_is_replaced_even_where_its_number_lives_again() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let terminal = open_unlinked_port(SETUP).unwrap();
    let node = terminal.path();
    symlink(node, &path).unwrap();
    fs::write(
        dir.path().join(".r150.sim-lock"),
        format!("1\n{}\n", node.display()),
    )
    .unwrap();
    let mut port = open_port(&path, SETUP).unwrap();
    assert!(leads_to(&path, &mut port));
    assert_ne!(fs::read_link(&path).unwrap(), node);
}

#[test]
fn a_second_simulator_is_refused_and_the_first_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let mut port = open_port(&path, SETUP).unwrap();
    let (kind, message) = refused(&path);
    assert_eq!(kind, InUse);
    assert!(
        message.contains(&format!("(process {})", std::process::id())),
        "{message}"
    );
    assert!(leads_to(&path, &mut port));
    // Another way to write the same path makes no difference.
    fs::create_dir(dir.path().join("sub")).unwrap();
    assert_eq!(refused(&dir.path().join("sub/../r150")).0, InUse);
    drop(port);
    drop(open_port(&path, SETUP).unwrap());
}

#[test]
fn of_many_that_start_at_once_one_wins() {
    const STARTERS: usize = 8;
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    for round in 0..30 {
        if round % 2 == 1 {
            symlink("/dev/pts/4294967", &path).unwrap();
            fs::write(dir.path().join(".r150.sim-lock"), "1\n/dev/pts/4294967\n").unwrap();
        }
        let start = Barrier::new(STARTERS);
        let end = Barrier::new(STARTERS);
        let won = std::thread::scope(|scope| {
            let starters: Vec<_> = (0..STARTERS)
                .map(|_| {
                    scope.spawn(|| {
                        start.wait();
                        let mut port = open_port(&path, SETUP);
                        end.wait();
                        match &mut port {
                            Ok(port) => {
                                assert!(leads_to(&path, port));
                            }
                            Err(error) => {
                                assert!(matches!(error.kind(), PortErrorKind::InUse(_)), "{error}");
                            }
                        }
                        port.is_ok()
                    })
                })
                .collect();
            starters
                .into_iter()
                .map(|s| usize::from(s.join().unwrap()))
                .sum::<usize>()
        });
        assert_eq!(won, 1);
        assert_eq!(names(dir.path()), [] as [PathBuf; 0]);
    }
}

#[test]
fn a_link_that_was_replaced_is_not_removed() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let port = open_port(&path, SETUP).unwrap();
    fs::remove_file(&path).unwrap();
    fs::write(&path, "precious").unwrap();
    drop(port);
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    fs::remove_file(&path).unwrap();

    let port = open_port(&path, SETUP).unwrap();
    fs::remove_file(&path).unwrap();
    symlink("/dev/null", &path).unwrap();
    drop(port);
    assert_eq!(fs::read_link(&path).unwrap(), Path::new("/dev/null"));
}

#[test]
fn paths_that_cannot_be_are_explained() {
    let dir = tempfile::tempdir().unwrap();
    let (kind, message) = refused(&dir.path().join("missing/r150"));
    assert_eq!(kind, MissingDirectory);
    assert!(
        message.contains("missing does not exist; create it"),
        "{message}"
    );

    fs::write(dir.path().join("file"), "").unwrap();
    assert_eq!(refused(&dir.path().join("file/r150")).0, MissingDirectory);
    assert_eq!(refused(Path::new("/")).0, NotAFileName);
    assert_eq!(refused(&dir.path().join("..")).0, NotAFileName);
}

/// Runs one of the ignored tests below in its own process, as a user who
/// is not root.
fn run_unprivileged(test: &str, dir: &Path) {
    let mut command = common::unprivileged::rerun(test, dir);
    let status = command.status().unwrap();
    assert!(
        status.success(),
        "{test} failed as an ordinary user: {status}"
    );
}

#[test]
fn a_directory_that_may_not_be_written_to_is_explained() {
    let dir = tempfile::tempdir().unwrap();
    let closed = dir.path().join("closed");
    fs::create_dir(&closed).unwrap();
    fs::set_permissions(&closed, fs::Permissions::from_mode(0o555)).unwrap();
    fs::set_permissions(dir.path(), fs::Permissions::from_mode(0o755)).unwrap();
    run_unprivileged("unwritable_directory", dir.path());
}

#[test]
#[ignore = "run by another test in its own process"]
fn unwritable_directory() {
    let dir = common::unprivileged::dir();
    let error = open_port(dir.join("closed/r150"), SETUP).unwrap_err();
    assert!(
        matches!(error.kind(), PortErrorKind::NotWritable(_)),
        "{error:?}"
    );
    assert!(
        error.to_string().contains("may not create files in"),
        "{error}"
    );
}

#[test]
fn a_killed_simulator_s_link_is_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");
    let mut simulator = Command::new(std::env::current_exe().unwrap())
        .args(["--exact", "simulator_to_be_killed", "--ignored"])
        .env("SIM_TEST_DIR", dir.path())
        .stdout(Stdio::null())
        .spawn()
        .unwrap();
    until("the link is there", || fs::symlink_metadata(&path).is_ok());
    let (kind, message) = refused(&path);
    assert_eq!(kind, InUse);
    assert!(
        message.contains(&format!("(process {})", simulator.id())),
        "{message}"
    );

    simulator.kill().unwrap();
    simulator.wait().unwrap();
    assert!(
        fs::symlink_metadata(&path).is_ok(),
        "no process was there to remove the link"
    );
    let mut port = open_port(&path, SETUP).unwrap();
    assert!(leads_to(&path, &mut port));
    drop(port);
    assert_eq!(names(dir.path()), [] as [PathBuf; 0]);
}

#[test]
#[ignore = "run by another test in its own process"]
fn simulator_to_be_killed() {
    let dir = common::unprivileged::dir();
    let _port = open_port(dir.join("r150"), SETUP).unwrap();
    std::thread::sleep(common::PATIENCE * 3);
}
