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

/// Those for the user's own clients.
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
    let page = fs::read_to_string(root().join("docs/jobs.md")).unwrap();
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
        assert!(page.contains(&link), "no {link} in docs/jobs.md");
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
    let words = ["passed ", "FAILED ", "skipped ", "ERROR ", "aborted "];
    let verdict = |line: &&str| words.iter().any(|word| line.starts_with(word));
    let lines: Vec<String> = printed.lines().filter(verdict).map(str::to_owned).collect();
    let failed = lines.iter().any(|line| line.starts_with("FAILED"));
    assert_eq!(played.status.code(), Some(i32::from(failed)), "{printed}");
    lines
}

fn all_pass(verdicts: &[String], count: usize) {
    assert_eq!(verdicts.len(), count, "{verdicts:#?}");
    let passed = verdicts.iter().all(|line| line.starts_with("passed "));
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

/// The careful clients pass every file for their vehicle, or give no occasion for what it is about; so does
/// one with another job, but for the files of the first job.
#[test]
fn careful_clients_pass_or_skip_every_file_of_their_device() {
    let Some(python) = python() else { return };
    for (folders, client, most_skipped) in [
        (
            &["r150", "r150/faults", "r150/jobs"][..],
            "careful_client.py",
            8,
        ),
        (&["r150"], "careful_square.py", 8),
        (
            &["mecanum", "mecanum/faults", "mecanum/jobs"],
            "careful_car_client.py",
            2,
        ),
    ] {
        let folders = folders
            .iter()
            .map(|name| root().join("scenarios").join(name));
        let files: Vec<String> = folders.flat_map(|folder| files(&folder)).collect();
        let names: Vec<&str> = files.iter().map(String::as_str).collect();
        let verdicts = verdicts(python, &names, client);
        let count = |word: &str| {
            verdicts
                .iter()
                .filter(|line| line.starts_with(word))
                .count()
        };
        let (passed, skipped) = (count("passed "), count("skipped "));
        assert_eq!(passed + skipped, files.len(), "{client}: {verdicts:#?}");
        assert!(skipped <= most_skipped, "{client}: {verdicts:#?}");
    }
}

#[test]
fn a_client_is_judged_by_what_it_causes_and_not_by_how_another_would_do_it() {
    let Some(python) = python() else { return };
    let files = ["front-sensors-deaf", "ghost-echo", "main-link-cut"]
        .map(|name| format!("scenarios/mecanum/{name}.toml"));
    let names: Vec<&str> = files.iter().map(String::as_str).collect();
    let client = root().join("tests/clients/goes_around.py");
    all_pass(&verdicts(python, &names, client.to_str().unwrap()), 3);
}

/// The scenario files in a folder.
fn files(folder: &Path) -> Vec<String> {
    let entries = fs::read_dir(folder).unwrap();
    let paths = entries.map(|entry| entry.unwrap().path());
    let files = paths.filter(|path| path.extension().is_some_and(|ending| ending == "toml"));
    files
        .map(|path| path.to_str().unwrap().to_owned())
        .collect()
}
