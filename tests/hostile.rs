//! Files, names and clients that are as bad as they can be: none of them costs another's result.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::path::{Path, PathBuf};

use rustix::process::Signal;

use harness::{Sim, command};

/// A scenario of an hour with these steps.
fn scenario(title: &str, steps: &str) -> String {
    format!(
        "schema = 1\ntitle = \"{title}\"\ngood_client = \"Any.\"\nlimit = \"1 h\"\n\n\
         [[device]]\nkind = \"r150\"\n\n{steps}"
    )
}

const HEARTBEATS: &str = r#"
[[step]]
at = "0 s"
every = "1 ns"
host = { send = "heartbeat" }
"#;

const BOXES: &str = r#"
[[step]]
at = "0 s"
world = { add = { box = [{ at_m = [3, 0], length = "1 m", width = "1 m", name = "box" }] } }

[[step]]
at = "0 s"
every = "1 us"
world = { move = { obstacle = "box", x = "3 m", y = "0 m" } }

[[step]]
at = "0 s"
count = 3000
every = "1 ns"
world = { add = { box = [{ at_m = [3, 0], length = "1 m", width = "1 m" }] } }
"#;

/// Runs the binary in a folder.
fn start(folder: &Path, args: &[&str]) -> Sim {
    Sim::spawn(
        command().current_dir(folder).args(args),
        PathBuf::new(),
        None,
    )
}

#[test]
fn the_time_allowed_and_signals_hold_in_files_that_have_something_every_nanosecond() {
    let folder = tempfile::tempdir().unwrap();
    let folder = folder.path();
    fs::write(folder.join("beats.toml"), scenario("Beats", HEARTBEATS)).unwrap();
    fs::write(folder.join("boxes.toml"), scenario("Boxes", BOXES)).unwrap();
    let client = ["--", "sh", "-c", "exec 3<>$SIM_R150_PORT; sleep 0.1"];
    for file in ["beats.toml", "boxes.toml"] {
        for client in [&[] as &[&str], &client] {
            let ended = start(
                folder,
                &[&["run", "--timeout", "1s", file], client].concat(),
            )
            .wait();
            assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
            let why = "still going on after the 1s of real time";
            assert!(ended.out.contains(why), "{}", ended.out);
        }
        let sim = start(folder, &["run", "--output", "out", file]);
        harness::until("it has begun", || {
            folder
                .join(format!("out/{}", file.replace(".toml", ".trace.jsonl")))
                .exists()
        });
        sim.signal(Signal::INT);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
        assert!(ended.out.contains("1 broken off"), "{}", ended.out);
        fs::remove_dir_all(folder.join("out")).unwrap();
    }
}
