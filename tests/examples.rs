//! The scenarios and clients of `docs/examples/`: each is short, is in the documentation, passes, and finds
//! what it is there for.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::path::{Path, PathBuf};

use harness::live::Folder;
use harness::python;

/// Each with a change that makes its client, or its vehicle, do the wrong thing, and what is said then.
const EXAMPLES: [(&str, &str, &str, &str); 8] = [
    (
        "ice",
        "kind = \"r150\"",
        "kind = \"r150\", settings = { motor_watchdog = \"1 s\" }",
        "the watchdog did not stop the motors",
    ),
    (
        "loose-cable",
        "every = \"500 ms\", host = { port = \"open\" }",
        "every = \"20 s\", host = { port = \"open\" }",
        "it does not find its way back",
    ),
    (
        "low-battery",
        ", until = \"reported.motors_age_s < 1 && reported.soc_percent < 10\"",
        "",
        "it drives on, or rolls back",
    ),
    (
        "meeting",
        "front_mm < 500",
        "front_mm < 50",
        "they ran into each other",
    ),
    (
        "person",
        "front_mm < 400",
        "front_mm < 400 && t > 6",
        "it ran into the person",
    ),
    (
        "rail-48v",
        ", until = \"reported.overcurrent_48v\"",
        "",
        "it drives on without its 48 V",
    ),
    (
        "restart",
        "!reported.v12a_on",
        "t > 12",
        "it drives on without its output",
    ),
    (
        "wrong-speed",
        "baud = 115200",
        "baud = 57600",
        "it never found the speed",
    ),
];

/// Those for clients of their own.
const JOBS: [&str; 2] = ["square", "there-and-back"];

/// However long a busy machine takes.
const LOCKSTEP: [&str; 7] = [
    "run",
    "--seed",
    "1",
    "--time",
    "lockstep",
    "--timeout",
    "1h",
];

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

fn example(name: &str) -> PathBuf {
    root().join("docs/examples").join(name)
}

fn text(name: &str) -> String {
    fs::read_to_string(example(&format!("{name}.toml"))).unwrap()
}

#[test]
fn each_is_short_and_in_the_documentation() {
    let scenarios = fs::read_to_string(root().join("docs/scenarios.md")).unwrap();
    let mut count = 0;
    for entry in fs::read_dir(root().join("docs/examples")).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_none_or(|ending| ending != "toml") {
            continue;
        }
        let name = path.file_stem().unwrap().to_str().unwrap();
        let lines = text(name).lines().count();
        assert!(lines <= 20, "{name} has {lines} lines");
        let link = format!("(examples/{name}.toml)");
        assert!(scenarios.contains(&link), "no {link} in docs/scenarios.md");
        let tested = EXAMPLES.iter().any(|(tested, ..)| *tested == name);
        assert!(tested || JOBS.contains(&name), "{name} is not tested");
        count += 1;
    }
    assert_eq!(count, EXAMPLES.len() + JOBS.len());
}

#[test]
fn each_passes_as_it_is_and_fails_who_does_it_wrong() {
    for (name, right, wrong, message) in EXAMPLES {
        let text = text(name);
        assert_eq!(text.matches(right).count(), 1, "{name}: {right}");
        let changed = text.replace(right, wrong);
        let folder = Folder::with(&[("right.toml", &*text), ("wrong.toml", &*changed)]);
        let passed = folder.sim(&["run", "--seed", "1", "--repeat", "3", "right.toml"]);
        assert_eq!(passed.code(), Some(0), "{name}: {}", passed.out);
        let failed = folder.sim(&["run", "--seed", "1", "wrong.toml"]);
        assert_eq!(
            failed.code(),
            Some(1),
            "{name}: {}{}",
            failed.out,
            failed.err
        );
        assert!(failed.out.contains(message), "{name}: {}", failed.out);
    }
}

/// Verdicts of a client of the examples in the simulator's time, which takes what it takes.
fn verdicts(python: &str, what: &[&str], client: &str) -> Vec<String> {
    let mut command = harness::command();
    command.args(LOCKSTEP).args(what);
    command
        .args(["--", python])
        .arg(example(client))
        .current_dir(root());
    let played = command.output().unwrap();
    let printed = String::from_utf8(played.stdout).unwrap();
    let verdict = |line: &&str| line.starts_with("ok ") || line.starts_with("FAILED ");
    let lines: Vec<String> = printed.lines().filter(verdict).map(str::to_owned).collect();
    let failed = lines.iter().any(|line| line.starts_with("FAILED"));
    assert_eq!(played.status.code(), Some(i32::from(failed)), "{printed}");
    lines
}

fn all_pass(verdicts: &[String], count: usize) {
    assert_eq!(verdicts.len(), count, "{verdicts:#?}");
    let passed = verdicts.iter().all(|line| line.starts_with("ok "));
    assert!(passed, "{verdicts:#?}");
}

#[test]
fn a_careful_client_passes_all_faults_in_a_second_job() {
    let Some(python) = python() else { return };
    let square = [
        "--job",
        "docs/examples/square.toml",
        "scenarios/r150/faults",
    ];
    all_pass(&verdicts(python, &square, "careful_square.py"), 27);
    all_pass(&verdicts(python, &square[1..2], "careful_square.py"), 1);
    let there = [
        "--job",
        "docs/examples/there-and-back.toml",
        "scenarios/mecanum/faults",
    ];
    all_pass(&verdicts(python, &there, "careful_there_and_back.py"), 11);
    all_pass(
        &verdicts(python, &there[1..2], "careful_there_and_back.py"),
        1,
    );
}

#[test]
fn a_naive_client_fails_where_it_should_in_a_second_job() {
    let Some(python) = python() else { return };
    let job = "docs/examples/square.toml";
    all_pass(&verdicts(python, &[job], "naive_square.py"), 1);
    let faults = [
        "scenarios/r150/faults/bytes-lost.toml",
        "scenarios/r150/faults/cable-pulled.toml",
        "scenarios/r150/faults/camera-shorted.toml",
        "scenarios/r150/faults/emergency-stop.toml",
        "scenarios/r150/faults/line-mute.toml",
        "scenarios/r150/faults/replies-missing.toml",
        "scenarios/r150/faults/vehicle-deaf.toml",
        "scenarios/r150/faults/wheel-blocked.toml",
    ];
    let all = verdicts(
        python,
        &[&["--job", job], &faults[..]].concat(),
        "naive_square.py",
    );
    assert_eq!(all.len(), faults.len(), "{all:#?}");
    assert!(
        all.iter().all(|line| line.starts_with("FAILED ")),
        "{all:#?}"
    );
}

/// Of files that are no drives, too, nothing that presumes their scripts is said of a client with a job of
/// its own: only that something never happened.
#[test]
fn a_client_with_another_job_breaks_no_rule_of_other_files() {
    let Some(python) = python() else { return };
    let mut files: Vec<PathBuf> = fs::read_dir(root().join("scenarios/r150"))
        .unwrap()
        .map(|entry| entry.unwrap().path())
        // The convoy has two vehicles of other names.
        .filter(|path| path.is_file() && !path.ends_with("convoy.toml"))
        .collect();
    files.sort();
    let mut command = harness::command();
    command.args(LOCKSTEP).args(&files);
    command
        .args(["--", python])
        .arg(example("careful_square.py"));
    let printed = String::from_utf8(command.output().unwrap().stdout).unwrap();
    let verdicts = printed
        .lines()
        .filter(|line| line.starts_with("ok ") || line.starts_with("FAILED "));
    assert_eq!(verdicts.count(), files.len(), "{printed}");
    let failure = |line: &&str| {
        let what = line.strip_prefix("  ");
        what.is_some_and(|what| what.starts_with(|first: char| first.is_ascii_digit()))
    };
    for line in printed.lines().filter(failure) {
        let nothing =
            line.contains(": it never began: ") || line.contains(" and never hit anything; ");
        assert!(nothing, "{line}\n{printed}");
    }
}
