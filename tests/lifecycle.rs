//! The link, the ready file, and the end.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::os::unix::fs::symlink;
use std::path::Path;

use harness::client::Client;
use harness::{Finished, Sim, command, report_skipped, run, until};
use rustix::process::Signal;
use serde_json::Value;

/// Names of everything in a directory, hidden files included.
fn names(dir: &Path) -> Vec<String> {
    let entries = fs::read_dir(dir).unwrap();
    let name = |entry: std::io::Result<fs::DirEntry>| entry.unwrap().file_name();
    entries
        .map(|entry| name(entry).into_string().unwrap())
        .collect()
}

fn serve(path: &Path) -> Finished {
    run(&["--pty", path.to_str().unwrap()])
}

#[test]
fn a_signal_ends_it_well_and_nothing_is_left() {
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        if signal == Signal::HUP && hangup_is_ignored() {
            report_skipped(
                "SIGHUP",
                "it is ignored here, as under nohup, and so by the simulator",
            );
            continue;
        }
        // Once while no client is there, and once in the middle of a session.
        for with_client in [false, true] {
            let dir = tempfile::tempdir().unwrap();
            let port = dir.path().join("r150");
            let ready = dir.path().join("ready");
            let sim = Sim::start_at(&port, &["--ready-file", ready.to_str().unwrap()]);
            assert!(fs::read_link(&port).unwrap().starts_with("/dev/pts"));
            let client = with_client.then(|| {
                let mut client = sim.client();
                assert_eq!(client.ask(0xF0, &[]).len(), 8);
                client
            });
            sim.signal(signal);
            let finished = sim.wait().expect_clean();
            assert!(finished.out.contains("summary after"), "{}", finished.out);
            assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
            drop(client);
        }
    }
}

/// Whether this process ignores `SIGHUP`, which its children inherit.
fn hangup_is_ignored() -> bool {
    let status = fs::read_to_string("/proc/self/status").unwrap();
    let mask = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    u64::from_str_radix(mask.unwrap().trim(), 16).unwrap() & 1 == 1
}

#[test]
fn what_is_in_the_way_is_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150");

    fs::write(&path, "precious").unwrap();
    let advice = "left alone; remove it or choose another path";
    serve(&path).expect_refusal(3, &[path.to_str().unwrap(), "a regular file", advice]);
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    fs::remove_file(&path).unwrap();

    fs::create_dir(&path).unwrap();
    serve(&path).expect_refusal(3, &["a directory", advice]);
    assert!(path.is_dir());
    fs::remove_dir(&path).unwrap();

    // Another program's link, whether it leads anywhere or not.
    for target in ["/dev/null", "/no/such/file"] {
        symlink(target, &path).unwrap();
        serve(&path).expect_refusal(3, &["a symbolic link to", target, advice]);
        assert_eq!(fs::read_link(&path).unwrap(), Path::new(target));
        fs::remove_file(&path).unwrap();
    }
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}

#[test]
fn a_path_that_cannot_be_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let missing = dir.path().join("missing");
    let says = [missing.to_str().unwrap(), "does not exist; create it"];
    serve(&missing.join("r150")).expect_refusal(3, &says);
    run(&["--serial", missing.to_str().unwrap()]).expect_refusal(3, &["no such serial port"]);
}

#[test]
fn a_second_simulator_on_the_same_path_is_refused() {
    let sim = Sim::start(&[]);
    let holder = format!("process {}", sim.pid());
    serve(sim.port()).expect_refusal(3, &["another simulator", &holder, "choose another path"]);
    assert_eq!(
        sim.client().ask(0xF0, &[]).len(),
        8,
        "the first is unharmed"
    );
    sim.stop().expect_clean();
}

#[test]
fn the_link_of_a_killed_simulator_is_replaced() {
    let dir = tempfile::tempdir().unwrap();
    let port = dir.path().join("r150");
    for _ in 0..3 {
        let sim = Sim::start_at(&port, &[]);
        sim.signal(Signal::KILL);
        assert_eq!(sim.wait().code(), None);
        assert!(fs::symlink_metadata(&port).is_ok(), "the link is left");
    }
    let sim = Sim::start_at(&port, &[]);
    assert_eq!(sim.client().ask(0xF0, &[]).len(), 8);
    sim.stop().expect_clean();
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}

#[test]
fn the_ready_file_is_there_while_clients_can_connect() {
    let dir = tempfile::tempdir().unwrap();
    let (port, ready) = (dir.path().join("r150"), dir.path().join("ready.json"));
    for _ in 0..10 {
        let mut command = command();
        command
            .arg("--pty")
            .arg(&port)
            .arg("--ready-file")
            .arg(&ready);
        let sim = Sim::spawn(command.args(["--seed", "7"]), port.clone(), None);
        // The file and nothing else says when to connect.
        until("the ready file is there", || ready.exists());
        let text = fs::read_to_string(&ready).unwrap();
        let mut client = Client::over(Client::try_open(&port, 115_200).unwrap());
        assert_eq!(client.ask(0xF0, &[]).len(), 8);

        let content: Value = serde_json::from_str(&text).unwrap();
        assert_eq!(content["pid"], sim.pid());
        assert_eq!(content["seed"], 7);
        assert_eq!(content["ports"][0]["device"], "r150");
        assert_eq!(content["ports"][0]["path"], port.to_str().unwrap());
        sim.stop().expect_clean();
        assert!(!ready.exists());
    }
}

#[test]
fn there_is_no_ready_file_when_no_client_can_connect() {
    let dir = tempfile::tempdir().unwrap();
    let (port, ready) = (dir.path().join("r150"), dir.path().join("ready"));
    fs::write(&port, "").unwrap();
    let (port, file) = (port.to_str().unwrap(), ready.to_str().unwrap());
    run(&["--pty", port, "--ready-file", file]).expect_refusal(3, &[port]);
    assert!(!ready.exists());

    // One that cannot be written is a mistake in the flags, and nothing is served.
    fs::remove_file(port).unwrap();
    run(&["--pty", port, "--ready-file", "/sys/kernel/ready"])
        .expect_refusal(2, &["ready file /sys/kernel/ready"]);
    // No folder is made, as none is for a port.
    let nowhere = dir.path().join("nowhere/ready");
    let nowhere = nowhere.to_str().unwrap();
    run(&["--pty", port, "--ready-file", nowhere]).expect_refusal(2, &["there is no directory"]);
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}

#[test]
fn a_ready_file_replaces_nothing_but_its_like() {
    let dir = tempfile::tempdir().unwrap();
    let (port, ready) = (dir.path().join("r150"), dir.path().join("ready"));
    fs::write(&ready, "precious").unwrap();
    let (port, file) = (port.to_str().unwrap(), ready.to_str().unwrap());
    run(&["--pty", port, "--ready-file", file]).expect_refusal(2, &[file, "left alone"]);
    assert_eq!(fs::read_to_string(&ready).unwrap(), "precious");
    assert_eq!(names(dir.path()), ["ready"]);

    // One that a killed simulator has left is replaced.
    fs::remove_file(&ready).unwrap();
    let sim = Sim::start_at(Path::new(port), &["--ready-file", file]);
    sim.signal(Signal::KILL);
    sim.wait();
    assert!(ready.exists());
    let sim = Sim::start_at(Path::new(port), &["--ready-file", file]);
    // One of a simulator that runs is left alone.
    let other = format!("{port}-2");
    run(&["--pty", &other, "--ready-file", file]).expect_refusal(2, &["another simulator", file]);
    assert!(
        fs::read_to_string(&ready)
            .unwrap()
            .contains(&sim.pid().to_string())
    );
    sim.stop().expect_clean();
    assert!(names(dir.path()).is_empty(), "{:?}", names(dir.path()));
}
