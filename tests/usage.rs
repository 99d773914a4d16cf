//! Flags, settings, and what is said about wrong ones.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::path::{Path, PathBuf};

use harness::{Sim, run};
use tempfile::TempDir;

/// A settings file, and where it is.
fn file(text: &str) -> (TempDir, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("r150.toml");
    fs::write(&path, text).unwrap();
    (dir, path)
}

fn config(args: &[&str]) -> String {
    run(&[&["config"], args].concat()).expect_clean().out
}

fn config_of(path: &Path) -> String {
    config(&["--config", path.to_str().unwrap()])
}

#[test]
fn wrong_flags_are_refused_with_advice() {
    run(&[]).expect_refusal(2, &["--pty PATH", "sim --pty /tmp/r150"]);
    let both = ["--pty", "/tmp/never-made", "--serial", "/dev/ttyUSB0"];
    run(&both).expect_refusal(2, &["--pty", "--serial", "cannot be used with"]);
    run(&["--ptty", "/tmp/never-made"]).expect_refusal(2, &["'--ptty'", "--pty"]);
    run(&["-v", "-q"]).expect_refusal(2, &["cannot be used with"]);
    for (flag, wrong, allowed) in [
        ("--start", "asleep", "ready, locked"),
        ("--wire", "fast", "paced, instant"),
        ("--log-format", "xml", "text, json"),
        ("--device", "r151", "r150"),
        ("--speed", "0", "0.01 to 100"),
        ("--speed", "NaN", "0.01 to 100"),
        ("--seed", "-1", "--seed"),
    ] {
        let flag_and_value = format!("{flag}={wrong}");
        run(&["--pty", "/tmp/never-made", &flag_and_value]).expect_refusal(2, &[wrong, allowed]);
    }
    assert!(!Path::new("/tmp/never-made").exists());
    // As when the variable that names the client is empty.
    run(&["run", "scenarios/r150", "--"]).expect_refusal(2, &["no client stands behind `--`"]);
}

#[test]
fn a_number_without_its_unit_is_refused_wherever_it_stands() {
    let why = "3 lacks a unit, as in \"3 deg\"";
    run(&["config", "--set", "world.slope=3"]).expect_refusal(2, &["--set world.slope=3", why]);
    let (_dir, path) = file("world.slope = 3");
    run(&["config", "--config", path.to_str().unwrap()])
        .expect_refusal(2, &["r150.toml:1:15", why]);
    let (_dir, path) = file(
        "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"1 s\"\nparameters = { slope = \"1 deg\" }\n\
         settings = { world.slope = \"${slope}\" }\ndevice = [{ kind = \"r150\" }]\n",
    );
    let path = path.to_str().unwrap();
    run(&["check", "--param", "slope=2deg", path]).expect_clean();
    run(&["check", "--param", "slope=3", path]).expect_refusal(2, &["--param slope=3", why]);
}

#[test]
fn a_signal_while_files_are_read_is_no_verdict() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("never-written.toml");
    rustix::fs::mknodat(
        rustix::fs::CWD,
        &path,
        rustix::fs::FileType::Fifo,
        rustix::fs::Mode::RWXU,
        0,
    )
    .unwrap();
    let mut command = harness::command();
    let sim = Sim::spawn(command.arg("run").arg(&path), PathBuf::new(), None);
    harness::until("the signal would be caught", || {
        let status = fs::read_to_string(format!("/proc/{}/status", sim.pid())).unwrap();
        let caught = status.lines().find_map(|line| line.strip_prefix("SigCgt:"));
        let caught = u64::from_str_radix(caught.unwrap().trim(), 16).unwrap();
        caught & 1 << 1 != 0
    });
    sim.signal(rustix::process::Signal::INT);
    assert_eq!(sim.wait().code(), Some(3));
}

#[test]
fn a_former_flag_or_subcommand_is_an_error_that_says_the_new_one() {
    use rigsim_runner::renamed::{Kind, RENAMED};
    let mut tried = 0;
    for renamed in RENAMED {
        let words = match renamed.kind {
            Kind::Flag(command) => [command, renamed.old],
            Kind::Ctl => ["ctl", renamed.old],
            Kind::Setting => {
                let set = format!("{}=1", renamed.old);
                let set = ["config", "--set", &set];
                run(&set).expect_refusal(2, &["--set", &renamed.to_string()]);
                continue;
            }
            _ => continue,
        };
        run(&words).expect_refusal(2, &[&renamed.to_string()]);
        tried += 1;
    }
    assert!(tried > 0);
    run(&["run", "--max-hold-up=3s", "x.toml"]).expect_refusal(2, &["is now `--max-stall`"]);
}

#[test]
fn help_teaches() {
    let help = run(&["--help"]).expect_clean().out;
    for part in [
        "sim --pty /tmp/r150",
        "sim --serial /dev/ttyUSB0",
        "Exit codes:",
        "--ready-file",
        "config",
    ] {
        assert!(help.contains(part), "no {part} in {help}");
    }
    let commands = help.split_once("Commands:\n").unwrap().1;
    let commands = commands.split_once("Options:").unwrap().0;
    let mut count = 0;
    for line in commands.lines() {
        // Further lines about a command are indented by more.
        let line = line.strip_prefix("  ").unwrap_or_default();
        let name = line.split(' ').next().unwrap_or_default();
        if !name.is_empty() && name != "help" {
            let help = run(&[name, "--help"]).expect_clean().out;
            let example = format!("\n  sim {name} ");
            assert!(help.contains(&example), "no example in {help}");
            count += 1;
        }
    }
    assert!(count >= 9);
    assert!(run(&["--version"]).expect_clean().out.starts_with("sim "));
}

#[test]
fn a_wrong_setting_is_named_with_what_is_allowed() {
    let pty = ["--pty", "/tmp/never-made", "--set"];
    let set = |text: &'static str| run(&[&pty[..], &[text]].concat());
    set("r150.hartbeat_timeout=5s").expect_refusal(
        2,
        &[
            "`r150.hartbeat_timeout`",
            "did you mean `r150.heartbeat_timeout`?",
        ],
    );
    set("r150.heartbeat_timeout=5h").expect_refusal(
        2,
        &[
            "--set r150.heartbeat_timeout=5h",
            "`r150.heartbeat_timeout`",
            "allowed:",
            "1ms",
        ],
    );
    set("r150.over_rate=shout").expect_refusal(
        2,
        &["`r150.over_rate`", "\"silent\", \"answer\", \"delay\""],
    );
    set("r150.battery=1").expect_refusal(2, &["`r150.battery` is a group"]);
    set("r150.baud").expect_refusal(2, &["KEY=VALUE"]);
}

#[test]
fn a_wrong_settings_file_is_named_with_line_and_column() {
    let text = "[r150]\nheartbeat_timeout = \"4s\"\n  hartbeat = 1\nbaud = 7\n";
    let (_dir, path) = file(text);
    let shown = path.to_str().unwrap();
    let unknown = format!("{shown}:3:3: no setting is named `r150.hartbeat`");
    let range = format!("{shown}:4:8: `r150.baud`");
    // Every mistake is reported at once.
    let says = [&unknown[..], &range, "allowed:", "300"];
    run(&["config", "--config", shown]).expect_refusal(2, &says);
    run(&["--pty", "/tmp/never-made", "--config", shown]).expect_refusal(2, &says);

    fs::write(&path, "[r150\n").unwrap();
    let says = format!("{shown}:1:");
    run(&["config", "--config", shown]).expect_refusal(2, &[&says, "unclosed table"]);

    // It has no end.
    run(&["config", "--config", "/dev/zero"]).expect_refusal(2, &["/dev/zero", "too long"]);

    fs::remove_file(&path).unwrap();
    let says = ["cannot read the settings file", shown];
    run(&["config", "--config", shown]).expect_refusal(2, &says);
    run(&["--pty", "/tmp/never-made", "--config", shown]).expect_refusal(2, &says);
}

#[test]
fn printed_settings_load_back() {
    let changes = [
        "--set",
        "r150.heartbeat_timeout=5s",
        "--set",
        "world.slope=10deg",
    ];
    let printed = config(&changes);
    assert!(printed.contains("heartbeat_timeout = \"5s\""), "{printed}");
    assert!(printed.contains("# default: \"3s\""), "{printed}");
    let (_dir, path) = file(&printed);
    assert_eq!(config_of(&path), printed);

    // A flag has the last word.
    let both = [
        "--config",
        path.to_str().unwrap(),
        "--set",
        "r150.heartbeat_timeout=7s",
    ];
    assert!(config(&both).contains("heartbeat_timeout = \"7s\""));
    fs::write(&path, config(&[])).unwrap();
    assert_eq!(config_of(&path), config(&[]));
}

#[test]
fn each_setting_says_whether_it_is_documented_or_assumed() {
    let mut settings = 0;
    let mut comment = Vec::new();
    for line in config(&[]).lines() {
        if let Some(text) = line.strip_prefix("# ") {
            comment.push(text.to_owned());
        } else if line.contains(" = ") {
            let marks =
                |text: &&String| text.starts_with("documented: ") || text.starts_with("assumed: ");
            assert_eq!(
                comment.iter().filter(marks).count(),
                1,
                "{line}: {comment:?}"
            );
            assert!(
                comment.iter().any(|text| text.starts_with("allowed: ")),
                "{line}"
            );
            settings += 1;
            comment.clear();
        } else {
            comment.clear();
        }
    }
    assert!(settings > 30, "{settings}");
}

#[test]
fn settings_take_effect_and_are_announced() {
    let (_dir, path) = file("r150.hardware_version = \"1.2.3.4\"\n");
    let config = path.to_str().unwrap();
    let sim = Sim::start(&["--config", config, "--set", "r150.software_version=5.6.7.8"]);
    assert_eq!(sim.client().ask(0xF0, &[]), [4, 3, 2, 1, 8, 7, 6, 5]);
    let settings = sim.wait_line(&["settings:"]);
    for part in [
        "r150.hardware_version = \"1.2.3.4\"",
        "r150.software_version",
    ] {
        assert!(settings.contains(part), "{settings}");
    }
    sim.stop().expect_clean();
}
