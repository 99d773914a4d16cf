//! What is printed, and that printing never gets in the device's way.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs::File;
use std::io::{BufRead as _, BufReader, Read as _};
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use harness::client::Client;
use harness::process::Process;
use harness::transcript::Transcript;
use harness::wire::frame;
use harness::{Sim, command, until, with_code};
use rustix::fs::{Mode, OFlags};
use rustix::process::Signal;
use tempfile::TempDir;

/// A request, one with a wrong CRC, and another request.
fn short_session(client: &mut Client) {
    assert_eq!(client.ask(0xF0, &[]).len(), 8);
    client.send(&[0xAA, 0x55, 0x00, 0xF0, 0x00, 0x00]);
    client.expect_silence_until_heartbeat();
}

/// A command that serves on a path in its own directory.
fn serving(args: &[&str]) -> (TempDir, PathBuf, Command) {
    let dir = tempfile::tempdir().unwrap();
    let port = dir.path().join("r150");
    let mut command = command();
    command
        .arg("--pty")
        .arg(&port)
        .args(["--seed", "1"])
        .args(args);
    (dir, port, command)
}

#[test]
fn the_log_is_for_people_and_plain_when_piped() {
    let sim = Sim::start(&["--set", "r150.heartbeat_timeout=5s"]);
    short_session(&mut sim.client());
    sim.wait_line(&["[bad_crc]"]);
    let port = sim.port().to_str().unwrap().to_owned();
    let finished = sim.stop().expect_clean();
    let out = finished.out;
    assert!(!out.contains('\u{1B}'), "{out:?}");
    assert!(
        !out.contains("->"),
        "requests are printed only when asked for"
    );

    let lines: Vec<&str> = out.lines().collect();
    let ready = lines.iter().position(|line| *line == "ready").unwrap();
    let start = lines[..ready].join("\n");
    for part in [
        &port,
        "r150",
        "115200 baud",
        "wire paced",
        "start ready",
        "speed 1",
        "seed 1",
        "default but for r150.heartbeat_timeout = \"5s\"",
    ] {
        assert!(start.contains(part), "no {part} in {start}");
    }
    let summary = lines
        .iter()
        .position(|line| line.starts_with("summary"))
        .unwrap();
    let summary = lines[summary..].join("\n");
    for part in [
        "2 requests, 2 replies, 0.00 m driven",
        "bad_crc 1x, first at",
    ] {
        assert!(summary.contains(part), "no {part} in {summary}");
    }
}

#[test]
fn help_and_errors_are_plain_when_piped() {
    for args in [
        &["--help"][..],
        &["--nonsense"],
        &["--set", "nonsense=1"],
        &["config"],
    ] {
        let finished = harness::run(args);
        let all = finished.out + &finished.err;
        assert!(!all.is_empty() && !all.contains('\u{1B}'), "{all:?}");
    }
}

#[test]
fn a_random_seed_is_printed() {
    let (dir, port, _) = serving(&[]);
    let mut command = command();
    let sim = Sim::spawn(command.arg("--pty").arg(&port), port, Some(dir));
    let line = sim.wait_line(&["seed "]);
    let seed = line.split("seed ").nth(1).unwrap();
    assert!(seed.parse::<u64>().is_ok(), "{line}");
    sim.wait_ready();
    sim.stop().expect_clean();
}

#[test]
fn every_json_line_is_an_object() {
    let sim = Sim::start(&["--log-format", "json", "-v"]);
    short_session(&mut sim.client());
    let port = sim.port().to_str().unwrap().to_owned();
    sim.wait_event("client_detached");
    let finished = sim.stop().expect_clean();
    assert!(!finished.out.contains('\u{1B}'));

    let lines = finished.json();
    let codes: Vec<&str> = lines
        .iter()
        .map(|line| line["code"].as_str().unwrap())
        .collect();
    assert_eq!(codes[..2], ["start", "ready"]);
    assert_eq!(codes.last(), Some(&"summary"));
    assert_eq!(lines[0]["seed"], 1);
    assert_eq!(lines[0]["ports"][0]["path"], port.as_str());
    assert_eq!(lines[0]["starts"]["r150"], "ready");
    assert_eq!(lines[1]["ports"][0]["path"], port.as_str());
    for (code, count) in [
        ("client_attached", 1),
        ("request", 2),
        ("reply", 2),
        ("bad_crc", 1),
    ] {
        assert_eq!(
            codes.iter().filter(|found| **found == code).count(),
            count,
            "{code}"
        );
    }
    let request = with_code(&lines, "request").remove(0);
    assert_eq!(request["bytes"], "AA 55 00 F0 F7 07");
    assert_eq!(request["device"], "r150");
    assert!(request["time_s"].as_f64() > Some(0.0));
    let times: Vec<f64> = lines
        .iter()
        .filter_map(|line| line["time_s"].as_f64())
        .collect();
    assert!(times.is_sorted(), "{times:?}");
}

#[test]
fn quiet_prints_ready_and_nothing_else() {
    let sim = Sim::start(&["-q"]);
    short_session(&mut sim.client());
    assert_eq!(sim.stop().expect_clean().out, "ready\n");
}

#[test]
fn verbose_prints_requests_and_replies_in_words_and_hex() {
    let sim = Sim::start(&["-v"]);
    short_session(&mut sim.client());
    let request = sim.wait_line(&["r150 -> 0xF0 version", "| AA 55 00 F0 F7 07"]);
    let reply = sim.wait_line(&[
        "r150 <- 0xF0 version",
        "hardware",
        "| AA 55 08 F0 00 00 00 01",
    ]);
    // Its time in simulated seconds comes first.
    let time = |line: &str| {
        line.split_whitespace()
            .next()
            .unwrap()
            .parse::<f64>()
            .unwrap()
    };
    assert!(time(&request) <= time(&reply));
    let error = sim.wait_line(&["[bad_crc]"]);
    assert!(error.contains("AA 55 00 F0 00 00"), "{error}");
    sim.stop().expect_clean();
}

#[test]
fn a_warning_is_coloured_on_a_terminal_unless_colours_are_unwanted() {
    for (no_color, coloured) in [(None, true), (Some("1"), false)] {
        let (dir, port, mut command) = serving(&[]);
        let (master, terminal) = terminal();
        command.env("TERM", "xterm-256color");
        no_color.map(|value| command.env("NO_COLOR", value));
        command.stdout(terminal).stderr(Stdio::piped());
        let mut process = Process::spawn(&mut command);
        // The command holds the terminal too, and would keep it from ever hanging up.
        drop(command);
        let printed = Transcript::of(master);
        assert!(
            printed
                .find_line(|line| line.trim_end() == "ready")
                .is_some()
        );
        short_session(&mut Client::open(&port));
        let warning = printed
            .find_line(|line| line.contains("[bad_crc]"))
            .unwrap();
        assert_eq!(warning.contains('\u{1B}'), coloured, "{warning:?}");
        process.signal(Signal::INT);
        let code = process.wait().code();
        assert_eq!(code, Some(0), "{}", complaints(&mut process));
        drop(dir);
    }
}

/// What the user looks at, and what a program writes to.
fn terminal() -> (File, Stdio) {
    use rustix::pty::{OpenptFlags, grantpt, openpt, ptsname, unlockpt};
    let master = openpt(OpenptFlags::RDWR | OpenptFlags::NOCTTY | OpenptFlags::CLOEXEC).unwrap();
    grantpt(&master).unwrap();
    unlockpt(&master).unwrap();
    let name = ptsname(&master, Vec::new()).unwrap();
    let flags = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let slave = rustix::fs::open(&*name, flags, Mode::empty()).unwrap();
    (File::from(master), Stdio::from(slave))
}

/// Starts it with a pipe, waits for `ready`, and returns the pipe.
fn start_piped(command: &mut Command) -> (Process, BufReader<std::process::ChildStdout>) {
    let mut process = Process::spawn(command.stdout(Stdio::piped()).stderr(Stdio::piped()));
    let mut out = BufReader::new(process.child().stdout.take().unwrap());
    let mut line = String::new();
    while line != "ready\n" {
        line.clear();
        assert!(out.read_line(&mut line).unwrap() > 0, "it ended");
    }
    (process, out)
}

/// Ends it well, and returns its complaints.
fn complaints_at_the_end(mut process: Process, port: &Path) -> String {
    process.signal(Signal::TERM);
    let code = process.wait().code();
    let complaints = complaints(&mut process);
    assert_eq!(code, Some(0), "{complaints}");
    assert!(!port.exists());
    complaints
}

fn complaints(process: &mut Process) -> String {
    let mut complaints = String::new();
    let mut err = process.child().stderr.take().unwrap();
    err.read_to_string(&mut complaints).unwrap();
    complaints
}

/// Makes it print more lines than are read: two for each heartbeat.
fn chatter(port: &Path, heartbeats: usize) {
    let mut client = Client::open(port);
    for _ in 0..heartbeats / 50 {
        client.send(&frame(0x07, &[]).repeat(50));
        for _ in 0..50 {
            assert_eq!(client.receive(), (0x07, vec![1]));
        }
    }
}

#[test]
fn a_reader_that_has_gone_does_not_stop_the_device() {
    let (_dir, port, mut command) = serving(&["-v"]);
    let (process, out) = start_piped(&mut command);
    // As `sim ... | head -n 3` does.
    drop(out);
    let mut client = Client::open(&port);
    for _ in 0..20 {
        short_session(&mut client);
    }
    assert_eq!(complaints_at_the_end(process, &port), "");
}

#[test]
fn a_reader_that_does_not_read_stops_neither_the_device_nor_its_end() {
    let (_dir, port, mut command) = serving(&["-v", "--wire", "instant"]);
    let (process, out) = start_piped(&mut command);
    // These are more than 150 bytes, and the pipe takes 64 KiB.
    chatter(&port, 1000);
    let complaints = complaints_at_the_end(process, &port);
    assert!(complaints.contains("not printed"), "{complaints:?}");
    drop(out);
}

#[test]
fn a_slow_reader_gets_the_summary_whatever_else_was_left_out() {
    let (_dir, port, mut command) = serving(&["-v", "--wire", "instant"]);
    let (mut process, mut out) = start_piped(&mut command);
    // More lines than are kept for a reader that does not read.
    chatter(&port, 12_000);
    process.signal(Signal::TERM);
    let mut all = String::new();
    out.read_to_string(&mut all).unwrap();
    assert_eq!(process.wait().code(), Some(0));
    assert_eq!(complaints(&mut process), "");
    let summary = all.rfind("\nsummary after").expect("there is a summary");
    assert!(all[..summary].contains("lines not printed"));
    assert!(
        all[summary..].contains("12000 requests"),
        "{}",
        &all[summary..]
    );
}

#[test]
fn a_second_signal_does_not_wait_for_a_reader() {
    // It would wait for five seconds. What a busy machine may take of that is some milliseconds, but now
    // and then.
    until("it ends sooner", || {
        let (_dir, port, mut command) = serving(&["-v", "--wire", "instant"]);
        let (mut process, out) = start_piped(&mut command);
        chatter(&port, 1000);
        let start = Instant::now();
        process.signal(Signal::TERM);
        // Signals that come at once count as one; this one was taken.
        until("the port is closed", || !port.exists());
        process.signal(Signal::TERM);
        assert_eq!(process.wait().code(), Some(0));
        let took = start.elapsed();
        drop(out);
        took < Duration::from_secs(4)
    });
}
