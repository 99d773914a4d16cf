//! Scenarios in simulated time, as users run them: verdicts, exit codes, errors, traces.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

/// Half speed for a second and a half, then silence; the watchdog must stop the vehicle.
const WATCHDOG: &str = r#"
schema = 1
title = "The watchdog stops a silent client's vehicle"
good_client = "Sends a stop before it falls silent."
limit = "4 s"
seed = 5

[[device]]
kind = "r150"

[[step]]
name = "drive"
at = "100 ms"
every = "60 ms"
for = "1.5 s"
host = { send = { set_motors = { right = 500, left = 500 } } }

[[step]]
after = "drive"
expect = { that = "truth.at_rest", within = "1.9 s" }

[[always]]
that = "truth.speed_mps < LIMIT"
"#;

fn sim(folder: &Path, args: &[&str]) -> Output {
    Command::new(env!("CARGO_BIN_EXE_sim"))
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap()
}

fn text(bytes: &[u8]) -> String {
    String::from_utf8(bytes.to_vec()).unwrap()
}

/// A folder with a scenario that passes and one that fails.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    fs::write(
        folder.path().join("a-passes.toml"),
        WATCHDOG.replace("LIMIT", "1.0"),
    )
    .unwrap();
    fs::write(
        folder.path().join("b-fails.toml"),
        WATCHDOG.replace("LIMIT", "0.5"),
    )
    .unwrap();
    folder
}

#[test]
fn exit_codes_tell_passed_failed_and_wrong_apart() {
    let folder = folder();
    let folder = folder.path();
    let passed = sim(folder, &["run", "a-passes.toml"]);
    assert_eq!(passed.status.code(), Some(0), "{passed:?}");
    assert!(text(&passed.stdout).contains("1 passed, 0 failed, 0 skipped"));

    let failed = sim(folder, &["run", "."]);
    assert_eq!(failed.status.code(), Some(1), "{failed:?}");
    let said = text(&failed.stdout);
    assert!(said.contains("1 passed, 1 failed, 0 skipped"), "{said}");
    assert!(said.contains("truth.speed_mps < 0.5"), "{said}");
    assert!(said.contains("again: sim run --seed 5 "), "{said}");

    assert_eq!(sim(folder, &["run", "missing.toml"]).status.code(), Some(2));
    assert_eq!(
        sim(folder, &["run", ".", "--filter", "nothing"])
            .status
            .code(),
        Some(2)
    );
    assert_eq!(sim(folder, &["run"]).status.code(), Some(2));
}

#[test]
fn a_misspelt_name_is_an_error_with_its_place_before_anything_is_played() {
    let folder = folder();
    let wrong = WATCHDOG
        .replace("truth.at_rest", "truth.at_wrest")
        .replace("LIMIT", "1.0");
    fs::write(folder.path().join("c.toml"), wrong).unwrap();
    for command in ["run", "check"] {
        let output = sim(folder.path(), &[command, "."]);
        assert_eq!(output.status.code(), Some(2), "{output:?}");
        assert_eq!(text(&output.stdout), "");
        let said = text(&output.stderr);
        assert!(said.contains("c.toml:20:19"), "{said}");
        assert!(said.contains("did you mean `truth.at_rest`?"), "{said}");
    }
    let output = sim(folder.path(), &["check", "a-passes.toml"]);
    assert_eq!(output.status.code(), Some(0), "{output:?}");
}

#[test]
fn a_trace_replays_to_the_last_byte_and_a_changed_one_does_not() {
    let folder = folder();
    let folder = folder.path();
    let run = || {
        assert_eq!(
            sim(folder, &["run", "a-passes.toml", "--output", "out"])
                .status
                .code(),
            Some(0)
        );
        fs::read_to_string(folder.join("out/a-passes.trace.jsonl")).unwrap()
    };
    let trace = run();
    assert_eq!(trace, run(), "a second run writes the same trace");
    let replayed = sim(folder, &["replay", "out/a-passes.trace.jsonl"]);
    assert_eq!(replayed.status.code(), Some(0), "{replayed:?}");

    // One digit of what the device has answered.
    let at = trace.find("\"kind\":\"out\"").unwrap();
    let at = at
        + trace[at..]
            .find("aa55")
            .or_else(|| trace[at..].find("AA55"))
            .unwrap();
    let mut changed = trace;
    changed.replace_range(at + 3..at + 4, "4");
    fs::write(folder.join("changed.jsonl"), changed).unwrap();
    let replayed = sim(folder, &["replay", "changed.jsonl"]);
    assert_eq!(replayed.status.code(), Some(1), "{replayed:?}");
    assert!(text(&replayed.stdout).contains("FAILED"), "{replayed:?}");
}

#[test]
fn each_repeat_after_the_first_plays_another_vehicle_of_the_make() {
    const RUNS: usize = 20;
    let folder = folder();
    let folder = folder.path();
    let report = |number: usize| -> serde_json::Value {
        let path = folder.join(format!("out/a-passes-{number}.report.json"));
        serde_json::from_str(&fs::read_to_string(path).unwrap()).unwrap()
    };
    // Nothing but the vehicle decides how far this drive goes: no step has a chance.
    let distances = |more: &[&str]| -> Vec<String> {
        let repeat = ["run", "--repeat", "20", "--output", "out", "a-passes.toml"];
        let played = sim(folder, &[&repeat, more].concat());
        assert_eq!(played.status.code(), Some(0), "{played:?}");
        let distance = |number| report(number)["devices"][0]["distance_m"].to_string();
        (1..=RUNS).map(distance).collect()
    };
    let named = distances(&["--set", "world.tolerances=by-name"]);
    assert!(named.iter().all(|one| *one == named[0]), "{named:?}");
    let seeds = distances(&["--set", "world.tolerances=by-seed"]);
    assert_ne!(seeds[0], named[0]);
    let usual = distances(&[]);
    assert_eq!(usual[0], named[0], "the first run has the named vehicle");
    assert_eq!(usual[1..], seeds[1..]);
    let different: std::collections::BTreeSet<_> = usual.iter().collect();
    assert_eq!(different.len(), RUNS, "{usual:?}");

    // What a run prints brings the same vehicle back, and so does its trace.
    let replayed = sim(folder, &["replay", "out/a-passes-7.trace.jsonl"]);
    assert_eq!(replayed.status.code(), Some(0), "{replayed:?}");
    let again = report(7)["command"].as_str().unwrap().to_owned();
    let words = again.split(' ').skip(1);
    let words: Vec<&str> = words.map(|word| word.trim_matches('\'')).collect();
    let once = sim(folder, &[&words[..], &["--output", "once"]].concat());
    assert_eq!(once.status.code(), Some(0), "{again}: {once:?}");
    let once = fs::read_to_string(folder.join("once/a-passes.report.json")).unwrap();
    let once: serde_json::Value = serde_json::from_str(&once).unwrap();
    assert_eq!(once["devices"][0]["distance_m"].to_string(), usual[6]);
}

#[test]
fn faults_and_names_are_listed_for_each_device() {
    let here = Path::new(".");
    let faults = text(&sim(here, &["faults", "--device", "r150"]).stdout);
    assert!(
        faults.contains("bit-flips") && faults.contains("The client sees:"),
        "{faults}"
    );
    let names = text(&sim(here, &["names", "--device", "mecanum"]).stdout);
    assert!(names.contains("truth.speed_mps"), "{names}");
}

#[test]
fn the_printed_command_shows_the_same_failure() {
    let folder = folder();
    // Chance decides how it fails, so only the same seed gives the same.
    let chancy = WATCHDOG.replace("LIMIT", "0.5").replace("seed = 5", "")
        + "[[step]]\nname = \"noise\"\nat = \"0 s\"\n\
           fault = { kind = \"bit-flips\", probability = 0.05, direction = \"to-device\" }\n";
    let name = "with a space.toml";
    fs::write(folder.path().join(name), chancy).unwrap();
    let first = sim(folder.path(), &["run", name]);
    assert_eq!(first.status.code(), Some(1), "{first:?}");
    let said = text(&first.stdout);
    let again = said
        .lines()
        .find_map(|line| line.trim().strip_prefix("again: "))
        .unwrap();
    let programs = Path::new(env!("CARGO_BIN_EXE_sim")).parent().unwrap();
    let path = format!("{}:{}", programs.display(), std::env::var("PATH").unwrap());
    let second = Command::new("sh")
        .args(["-c", again])
        .env("PATH", path)
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(text(&second.stdout), said);
}

#[test]
fn the_whole_library_passes_and_is_the_same_to_the_last_byte_twice() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let play = || {
        let out = tempfile::tempdir().unwrap();
        let path = out.path().to_str().unwrap();
        let args = [
            "run",
            "--seed",
            "1",
            "-j",
            "2",
            "--output",
            path,
            "scenarios",
        ];
        let played = sim(root, &args);
        assert_eq!(played.status.code(), Some(0), "{}", text(&played.stdout));
        let mut traces: Vec<(String, Vec<u8>)> = fs::read_dir(out.path())
            .unwrap()
            .map(|entry| entry.unwrap().path())
            .filter(|path| path.extension().is_some_and(|end| end == "jsonl"))
            .map(|path| {
                (
                    path.file_name().unwrap().to_string_lossy().into_owned(),
                    path,
                )
            })
            .map(|(name, path)| (name, fs::read(path).unwrap()))
            .collect();
        traces.sort();
        (text(&played.stdout), traces)
    };
    let (said, traces) = play();
    let (said_again, traces_again) = play();
    assert_eq!(said, said_again);
    assert!(traces.len() >= 10);
    for ((name, trace), (name_again, again)) in traces.iter().zip(&traces_again) {
        assert_eq!(name, name_again);
        assert!(trace == again, "{name} differs");
    }
    assert_eq!(traces.len(), traces_again.len());
}

/// The drive of [`WATCHDOG`] under a fault that goes on while it fails, if it does.
fn under_fault(limit: &str, fault: &str) -> String {
    WATCHDOG.replace("LIMIT", limit) + "\n[[step]]\nname = \"trouble\"\n" + fault
}

#[test]
fn a_failure_tells_what_came_before_it_and_what_was_armed_then() {
    let folder = tempfile::tempdir().unwrap();
    let twice = "at = \"400 ms\"\nfor = \"3 s\"\nfault = { kind = \"reply-twice\" }\n";
    // It has gone half a metre after about a second, while it drives.
    let scenario =
        under_fault("1.0", twice).replace("truth.speed_mps < 1.0", "truth.distance_m < 0.5");
    fs::write(folder.path().join("far.toml"), scenario).unwrap();
    let failed = sim(folder.path(), &["run", "--output", ".", "far.toml"]);
    assert_eq!(failed.status.code(), Some(1), "{failed:?}");
    let said = text(&failed.stdout);
    assert!(
        said.contains("armed then: \"trouble\" (reply-twice), from 0.400000 s on"),
        "{said}"
    );
    let report = fs::read_to_string(folder.path().join("far.report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    assert_eq!(report["armed"].as_array().unwrap().len(), 1);
    let failed_at = report["failures"][0]["time_s"].as_f64().unwrap();
    let (_, after) = said.split_once("the last that happened before:").unwrap();
    let (after, _) = after.split_once("\n  client report: ").unwrap();
    let times: Vec<f64> = after
        .lines()
        .filter_map(|line| line.split_whitespace().next()?.parse().ok())
        .collect();
    assert!(
        !times.is_empty() && times.iter().all(|at| *at <= failed_at),
        "{said}"
    );
    assert!(!after.contains("watchdog fired"), "that came later: {said}");
}

#[test]
fn a_pass_tells_what_it_was_worth() {
    let folder = tempfile::tempdir().unwrap();
    // Six times armed, of which those behind the drive find no reply to spoil.
    let campaign = "at = \"200 ms\"\nevery = \"500 ms\"\nfor = \"200 ms\"\ncount = 6\n\
                    fault = { kind = \"bad-crc\" }\n";
    fs::write(
        folder.path().join("campaign.toml"),
        under_fault("1.0", campaign),
    )
    .unwrap();
    fs::write(
        folder.path().join("plain.toml"),
        WATCHDOG.replace("LIMIT", "1.0"),
    )
    .unwrap();
    let passed = sim(
        folder.path(),
        &["run", "--output", ".", "campaign.toml", "plain.toml"],
    );
    assert_eq!(passed.status.code(), Some(0), "{passed:?}");
    let said = text(&passed.stdout);
    assert!(
        said.contains("(4.0 s simulated), 3 of 6 faults hit, 25 requests, "),
        "{said}"
    );
    assert!(said.contains("(4.0 s simulated), 25 requests, "), "{said}");
    let report = fs::read_to_string(folder.path().join("campaign.report.json")).unwrap();
    let report: serde_json::Value = serde_json::from_str(&report).unwrap();
    let fault = &report["faults"][0];
    assert_eq!(
        (&fault["armed"], &fault["hit"]),
        (&6.into(), &3.into()),
        "{fault}"
    );
    assert!(fault["hits"].as_u64().unwrap() > 3, "{fault}");
    assert!(
        report["devices"][0]["distance_m"].as_f64().unwrap() > 0.5,
        "{report}"
    );
}
