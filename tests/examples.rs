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
        assert!(tested || name == "square", "{name} is not tested");
        count += 1;
    }
    assert_eq!(count, EXAMPLES.len() + 1);
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

#[test]
fn the_square_is_a_second_job_for_all_faults() {
    let Some(python) = python() else { return };
    let folder = Folder::with(&[]);
    let square = example("square.toml");
    let square = square.to_str().unwrap();
    let faults = root().join("scenarios/r150/faults");
    let faults = faults.to_str().unwrap();
    let play = |what: &[&str], client: &str| {
        let client = example(client);
        let client = ["--", python, client.to_str().unwrap()];
        let base = ["run", "--seed", "1", "--time", "lockstep"];
        folder.sim(&[&base, what, &client].concat())
    };
    let within = ["--job", square, faults];
    let careful = play(&within, "careful_square.py");
    assert_eq!(careful.code(), Some(0), "{}", careful.out);
    assert!(
        careful.out.contains("27 passed, 0 failed"),
        "{}",
        careful.out
    );
    let plain = play(&[square], "naive_square.py");
    assert_eq!(plain.code(), Some(0), "{}", plain.out);
    let naive = play(&within, "naive_square.py");
    assert_eq!(naive.code(), Some(1), "{}", naive.out);
    for file in [
        "bytes-lost",
        "cable-pulled",
        "camera-shorted",
        "emergency-stop",
        "line-mute",
        "replies-missing",
        "vehicle-deaf",
        "wheel-blocked",
    ] {
        let failed = naive.out.lines().any(|line| {
            line.starts_with("FAILED") && line.contains(&format!("/faults/{file}.toml"))
        });
        assert!(failed, "it passes {file}:\n{}", naive.out);
    }
}
