//! Control of what `sim run` plays, by its own client and by others.

use std::fs;
use std::os::unix::fs::OpenOptionsExt as _;
use std::path::PathBuf;
use std::process::Command;
use std::time::Instant;

use crate::harness::live::{DRIVE, Folder};
use crate::harness::{self, Sim, command, until};
use crate::{folder, has};

/// A client that controls the simulator that plays it.
const CLIENT: &str = r#"
import os, sys, time
sys.path.insert(0, sys.argv[1])
from simulator import call, step, until
port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
begun = time.monotonic()
with open("again.toml", "w") as file:
    file.write(call("GET", "/v1/schema")["file"] + "[[step]]\nat = '1 s'\noperator = 'lock'\n")
step({"fault": {"kind": "bit-flips", "probability": 0.01, "direction": "to-client"}})
until("t > 0.5", "2 s")
step({"operator": {"emergency_stop": True}}, wait=True)
until("t > 1", "2 s")
call("DELETE", "/v1/steps")
print(call("GET", "/v1/state")["time"], round(time.monotonic() - begun, 6))
if call("GET", "/v1/state")["time"] == "lockstep":
    call("POST", "/v1/time", '"pause"', status=409)
"#;

#[test]
fn a_client_controls_the_run_that_plays_it() {
    if !has("python3") {
        return;
    }
    let scripts = folder();
    let scripts = scripts.to_str().unwrap();
    // In real time the machine may keep the client waiting.
    let drive = DRIVE.replace("\"4 s\"", "\"2 min\"");
    assert_ne!(drive, DRIVE);
    let folder = Folder::with(&[("drive.toml", &drive), ("client.py", CLIENT)]);
    let run = |time: &str, output: &str| {
        let args = [
            "run",
            "--time",
            time,
            "--seed",
            "1",
            "--control",
            "127.0.0.1:0",
            "--set",
            "r150.reply_delay=6ms",
            "--output",
            output,
        ];
        let client = ["drive.toml", "--", "python3", "-B", "client.py", scripts];
        let ended = folder.sim(&[&args[..], &client[..]].concat());
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
        assert!(!ended.out.contains("not repeatable"), "{}", ended.out);
        let trace = folder.read(&format!("{output}/drive.trace.jsonl"));
        assert!(trace.contains("\"kind\":\"add\""), "{trace}");
        let path = folder.file(&format!("{output}/drive.trace.jsonl"));
        let again = harness::run(&["replay", path.to_str().unwrap()]);
        assert_eq!(again.code(), Some(0), "{}{}", again.out, again.err);
        // What was done by hand can be added to the file that is played.
        let saved = folder.read("again.toml");
        assert!(saved.contains("base = \"/"), "{saved}");
        assert!(
            saved.contains("settings.r150.reply_delay = \"6ms\"\n"),
            "{saved}"
        );
        let path = folder.file("again.toml");
        let checked = harness::run(&["check", path.to_str().unwrap()]);
        assert_eq!(checked.code(), Some(0), "{}{}", checked.out, checked.err);
        (trace, folder.read(&format!("{output}/drive.client.log")))
    };
    run("real", "real");
    // In the simulator's time it is the same each time.
    let first = run("lockstep", "first");
    assert!(first.1.starts_with("lockstep "), "{}", first.1);
    assert_eq!(first, run("lockstep", "second"));
}

/// A client that waits for conditions while a thread of it drives.
const WAITING: &str = r#"
import os, sys, threading, time
sys.path.insert(0, sys.argv[1])
from simulator import until
port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
done = threading.Event()
def drive():
    while not done.wait(0.06):
        os.write(port, bytes.fromhex("AA55041200000000BF6D"))
driver = threading.Thread(target=drive)
driver.start()
for second in range(1, 100):
    until(f"t > {second}", "2 s")
done.set()
driver.join()
"#;

#[test]
fn waits_for_conditions_take_no_real_time() {
    if !has("python3") {
        return;
    }
    let scripts = folder();
    let long = STAND.replace("30 min", "100 s");
    let place = Folder::with(&[("stand.toml", &long), ("client.py", WAITING)]);
    let begun = Instant::now();
    let args = ["run", "--time", "lockstep", "--control", "127.0.0.1:0"];
    let client = ["stand.toml", "--", "python3", "-B", "client.py"];
    let client = [&client[..], &[scripts.to_str().unwrap()]].concat();
    let ended = place.sim(&[&args[..], &client].concat());
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    // It is a few seconds.
    assert!(begun.elapsed().as_secs() < 30, "{}", ended.out);
}

const STAND: &str = r#"
schema = 1
title = "Stand"
good_client = "Waits."
limit = "30 min"
device = [{ kind = "r150" }]
"#;
#[test]
fn what_is_expected_in_vain_fails_the_run() {
    let place = Folder::with(&[("stand.toml", STAND)]);
    let until = ["ctl", "until", "truth.speed_mps > 1", "--within", "1s"];
    let run = ["run", "--time", "lockstep", "--seed", "1"];
    let played = ["--control", "127.0.0.1:0", "stand.toml", "--"];
    let client = [env!("CARGO_BIN_EXE_sim")];
    let ended = place.sim(&[&run[..], &played, &client, &until].concat());
    assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
    for part in [
        "expected `truth.speed_mps > 1`, but truth.speed_mps = 0",
        "again: sim run --seed 1 --control 127.0.0.1:0 stand.toml -- ",
    ] {
        assert!(ended.out.contains(part), "no {part} in {}", ended.out);
    }
}

const NONBLOCK: i32 = rustix::fs::OFlags::NONBLOCK.bits().cast_signed();

/// A client that begins when its gate is opened, and then waits for time to pass.
const WAITS: &str = r#"
import os, time
port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
open("gate").read()
begun = time.monotonic()
time.sleep(0.1)
print(round(time.monotonic() - begun, 6))
"#;

const FLOODS: &str = r#"
import sys, threading
from http.client import HTTPException
sys.path.insert(0, sys.argv[1])
from simulator import call
def flood():
    answered = 0
    while True:
        try:
            call("GET", "/v1/state")
        except ConnectionRefusedError:
            return  # The simulation has ended.
        except (AssertionError, OSError, HTTPException):
            continue  # There are too many, or this is its end.
        answered += 1
        if answered == 10:
            print("flooding", flush=True)
for _ in range(8):
    threading.Thread(target=flood).start()
"#;

#[test]
fn a_flood_takes_no_simulated_time_of_a_client_in_lockstep() {
    if !has("python3") {
        return;
    }
    let place = Folder::with(&[
        ("stand.toml", STAND),
        ("client.py", WAITS),
        ("flood.py", FLOODS),
    ]);
    let gate = place.file("gate");
    let made = Command::new("mkfifo").arg(&gate).status().unwrap();
    assert!(made.success());
    let mut run = command();
    run.args(["run", "--seed", "1", "--control", "127.0.0.1:0", "--output"])
        .args(["out", "stand.toml", "--", "python3", "-B", "client.py"])
        .current_dir(place.path())
        .env("XDG_RUNTIME_DIR", place.path());
    let run = Sim::spawn(&mut run, PathBuf::new(), None);
    let mut url = String::new();
    until("it is found", || {
        let mut ctl = command();
        ctl.args(["ctl", "url"])
            .env("XDG_RUNTIME_DIR", place.path());
        let found = Sim::spawn(&mut ctl, PathBuf::new(), None).wait();
        url = found.out.trim().to_owned();
        found.code() == Some(0)
    });
    let mut flood = Command::new("python3");
    flood
        .args(["-B", "flood.py"])
        .arg(folder())
        .current_dir(place.path())
        .env("SIM_CONTROL", &url);
    let flood = Sim::spawn(&mut flood, PathBuf::new(), None);
    flood.wait_line(&["flooding"]);
    until("the client waits at its gate", || {
        let mut opened = fs::OpenOptions::new();
        opened
            .write(true)
            .custom_flags(NONBLOCK)
            .open(&gate)
            .is_ok()
    });
    let ended = run.wait();
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    // The sleep, and the slack of its timer.
    assert_eq!(place.read("out/stand.client.log").trim(), "0.10005");
    drop(flood);
}
