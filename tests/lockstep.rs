//! `sim run` with clients in the simulator's time.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "a test fails by panicking, and clippy takes helpers for production code; what is \
              skipped is named"
)]

mod harness;

use std::process::Command;
use std::time::Instant;

use harness::Finished;
use harness::live::{DRIVE, Folder, is_running};

/// A Python with pyserial, or a word that there is none.
fn python() -> Option<&'static str> {
    let found = Command::new("python3")
        .args(["-c", "import serial"])
        .output();
    if found.is_ok_and(|found| found.status.success()) {
        return Some("python3");
    }
    assert!(
        std::env::var_os("SIM_TEST_PYTHON").is_none(),
        "SIM_TEST_PYTHON is set, and there is no Python with pyserial"
    );
    eprintln!("skipped: there is no Python with pyserial");
    None
}

fn example(name: &str) -> String {
    format!("{}/docs/examples/{name}.py", env!("CARGO_MANIFEST_DIR"))
}

fn shipped(name: &str) -> String {
    format!("{}/scenarios/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Runs `sim run` with these arguments and a client, in lockstep.
fn run(folder: &Folder, args: &[&str], client: &[&str]) -> Finished {
    let all = [&["run", "--time", "lockstep"], args, &["--"], client].concat();
    folder.sim(&all)
}

fn folder() -> Folder {
    Folder::with(&[("drive.toml", DRIVE)])
}

/// Runs a shell script; what is printed must hold this, and the exit code be that.
#[track_caller]
fn script(args: &[&str], script: &str, code: i32, wanted: &str) -> (Folder, Finished) {
    let folder = folder();
    let ended = run(
        &folder,
        &[args, &["drive.toml"]].concat(),
        &["sh", "-c", script],
    );
    assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains(wanted), "{}{}", ended.out, ended.err);
    (folder, ended)
}

/// Holds the port open, so that the scenario begins.
const OPEN: &str = "exec 3<>\"$SIM_R150_PORT\"; ";

#[test]
fn a_run_says_whose_time_it_had() {
    let (_, ended) = script(&[], &format!("{OPEN} sleep 1"), 0, "lockstep time");
    assert!(ended.out.contains("4.0 s simulated"), "{}", ended.out);
    script(&["--dry-run"], "true", 0, "lockstep time");
}

#[test]
fn a_day_is_over_in_no_time_and_has_its_date() {
    let day = DRIVE.replace("\"4 s\"", "\"24 h\"");
    let folder = Folder::with(&[("drive.toml", &day)]);
    let begun = Instant::now();
    let client = format!("{OPEN} date -u +%FT%T; sleep 7200; date -u +%FT%T; exit 1");
    let args = ["--date", "2031-05-06 07:08:09", "drive.toml"];
    let ended = run(&folder, &args, &["sh", "-c", &client]);
    let dates = "    2031-05-06T07:08:09\n    2031-05-06T09:08:09\n";
    assert!(ended.out.contains(dates), "{}{}", ended.out, ended.err);
    assert!(begun.elapsed().as_secs() < 60);
}

#[test]
fn the_scenario_begins_when_the_client_opens_its_port() {
    let client = format!("sleep 20; {OPEN} sleep 1");
    script(&[], &client, 0, "4.0 s simulated");
    let client = format!("sleep 3000; {OPEN} sleep 1");
    script(
        &[],
        &client,
        1,
        "has opened no port within 38s of its own time",
    );
}

#[test]
fn how_a_client_ends_is_judged() {
    script(
        &[],
        &format!("{OPEN} exit 3"),
        1,
        "the client ended with exit code 3",
    );
    script(
        &[],
        &format!("{OPEN} kill -SEGV $$"),
        1,
        "the client was killed by SIGSEGV",
    );
    script(&[], "exit 0", 1, "without having opened a port");
    script(&[], "read nothing <&1", 1, "the client ");
    // Who waits for ever is over at once, at the limit; that alone is no failure.
    script(&[], &format!("{OPEN} cat <&3"), 0, "4.0 s simulated");
    let endless = format!("{OPEN} while :; do :; done");
    script(&["--timeout", "2s"], &endless, 1, "was computing, in ");
}

#[test]
fn nobody_outlives_a_run() {
    let daemon = "setsid sh -c 'trap \"\" TERM HUP INT; echo $$ >>pids; sleep 600; sleep 600' & ";
    let client = format!("{OPEN} {daemon} sleep 2; echo $$ >>pids; exit 0");
    let (folder, _) = script(&[], &client, 0, "1 passed");
    assert_eq!(folder.pids("pids").len(), 2);
    for pid in folder.pids("pids") {
        assert!(!is_running(pid), "{pid:?}");
    }
    assert_eq!(folder.ports_left(), 0);
}

#[test]
fn flags_that_make_no_sense_are_refused() {
    let folder = folder();
    let speed = run(&folder, &["--speed", "2", "drive.toml"], &["true"]);
    speed.expect_refusal(2, &["--speed is for a client with --time real"]);
    let nobody = run(&folder, &["drive.toml"], &["./nobody"]);
    nobody.expect_refusal(2, &["cannot start the client ./nobody", "No such file"]);
    let twice = folder.sim(&["run", "--twice", "drive.toml"]);
    twice.expect_refusal(2, &["--twice is for a client with --time lockstep"]);
}

#[test]
fn the_shipped_clients_pass_and_are_the_same_each_time() {
    let Some(python) = python() else { return };
    let drives = [
        ("careful_client", "r150/plain-drive.toml"),
        ("careful_client", "r150/cable-pulled.toml"),
        ("naive_client", "r150/plain-drive.toml"),
        ("careful_car_client", "mecanum/plain-rectangle.toml"),
    ];
    for (client, drive) in drives {
        let folder = folder();
        let drive = shipped(drive);
        let args = ["--twice", "--seed", "5", &drive];
        run(&folder, &args, &[python, &example(client)]).expect_clean();
    }
}

#[test]
fn what_differs_between_two_runs_is_shown() {
    let client = format!("{OPEN} echo it ran $(cat count 2>/dev/null) times; echo 1 >>count");
    let (_, ended) = script(&["--twice"], &client, 1, "the second run differs");
    assert!(ended.out.contains("it ran 1 times"), "{}", ended.out);
}
