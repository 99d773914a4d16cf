//! Campaigns: shards, results that are resumed, and what `sim merge` makes of them.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::io::{Read as _, Write as _};
use std::os::unix::fs::symlink;
use std::os::unix::process::ExitStatusExt as _;
use std::path::{Path, PathBuf};
use std::process::{Command, Output, Stdio};
use std::time::{Duration, UNIX_EPOCH};

use flate2::Compression;
use flate2::read::MultiGzDecoder;
use flate2::write::GzEncoder;
use harness::{command, until};
use rustix::process::{Pid, Signal, kill_process};
use serde_json::Value;
use tempfile::TempDir;

const AHEAD: &str = r#"
schema = 1
title = "Ahead"
good_client = "Drives slowly."
limit = "2 s"
[parameters]
pwm = 300
[[device]]
kind = "r150"
[[step]]
at = "100 ms"
every = "100 ms"
for = "1.5 s"
host = { send = { set_motors = { right = "${pwm}", left = "${pwm}" } } }
[[always]]
that = "truth.speed_mps < 0.6"
message = "too fast"
"#;

const REST: &str = r#"
schema = 1
title = "At rest"
good_client = "Does nothing."
limit = "500 ms"
[[device]]
kind = "r150"
[[never]]
that = "truth.speed_mps > 0.1"
"#;

/// A folder with the two scenarios, one of them with two values of its parameter: 3 times 10 cases, of
/// which 10 fail.
struct Campaign(TempDir);

/// Variables of engines that the tests themselves may run under.
const ENGINES: [&str; 9] = [
    "CI_NODE_INDEX",
    "CIRCLE_NODE_INDEX",
    "BUILDKITE_PARALLEL_JOB",
    "TEST_SHARD_INDEX",
    "JOB_COMPLETION_INDEX",
    "AWS_BATCH_JOB_ARRAY_INDEX",
    "PARALLEL_SEQ",
    "SLURM_ARRAY_TASK_ID",
    "SGE_TASK_ID",
];

impl Campaign {
    fn new() -> Self {
        let folder = tempfile::tempdir().unwrap();
        fs::create_dir(folder.path().join("files")).unwrap();
        fs::write(folder.path().join("files/ahead.toml"), AHEAD).unwrap();
        fs::write(folder.path().join("files/rest.toml"), REST).unwrap();
        Self(folder)
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn command(&self, words: &[&str]) -> Command {
        let mut command = command();
        command.current_dir(self.0.path()).args(words);
        for name in ENGINES {
            command.env_remove(name);
        }
        command
    }

    fn sim(&self, words: &[&str]) -> Output {
        self.command(words).output().unwrap()
    }

    /// Plays a shard with its results in `folder`.
    fn play(&self, shard: &str, folder: &str, more: &[&str]) -> Output {
        let mut words = vec!["run", "--repeat", "10", "--param", "pwm=300,900"];
        words.extend(["--shard", shard, "--results", folder]);
        words.extend(more);
        words.push("files");
        self.sim(&words)
    }

    /// Merges a folder, and returns the exit code, what was printed, and the three files.
    fn merge(&self, folder: &str, more: &[&str]) -> (i32, String, [Vec<u8>; 3]) {
        let names = ["m.xml", "m.html", "m.json"];
        for name in names {
            let _ = fs::remove_file(self.path(name));
        }
        let mut words = vec![
            "merge", folder, "--junit", names[0], "--report", names[1], "--json", names[2],
        ];
        words.extend(more);
        let output = self.sim(&words);
        let files = names.map(|name| fs::read(self.path(name)).unwrap_or_default());
        (code(&output), text(&output), files)
    }

    fn results(&self, folder: &str) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.path(folder)).unwrap();
        let mut paths: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
        paths.retain(|path| path.is_file());
        paths.sort();
        paths
    }
}

fn code(output: &Output) -> i32 {
    output.status.code().unwrap_or(-1)
}

fn text(output: &Output) -> String {
    String::from_utf8_lossy(&output.stdout).into_owned() + &String::from_utf8_lossy(&output.stderr)
}

/// The lines of a file of results, as far as they can be read.
fn lines(path: &Path) -> Vec<Value> {
    let mut text = String::new();
    let _ = MultiGzDecoder::new(fs::File::open(path).unwrap()).read_to_string(&mut text);
    text.lines()
        .filter_map(|line| serde_json::from_str(line).ok())
        .collect()
}

fn write_lines(path: &Path, lines: &[Value]) {
    let mut member = GzEncoder::new(fs::File::create(path).unwrap(), Compression::fast());
    for line in lines {
        writeln!(member, "{line}").unwrap();
    }
    member.finish().unwrap();
}

#[test]
fn shards_give_what_one_machine_gives_to_the_byte() {
    let campaign = Campaign::new();
    assert_eq!(code(&campaign.play("1/1", "one", &[])), 1);
    let (exit, printed, one) = campaign.merge("one", &[]);
    assert_eq!(exit, 1, "{printed}");
    assert!(
        printed.contains("20 passed, 10 failed, 0 skipped"),
        "{printed}"
    );
    let failed = "FAILED  too fast: always `truth.speed_mps < 0.6`: failed in 10 of 30 cases\n  \
                  case: files/ahead.toml pwm=900 #1: ";
    assert!(printed.contains(failed), "{printed}");

    // More shards than some have cases for; the order does not matter.
    for shard in (1..=40).rev() {
        let output = campaign.play(&format!("{shard}/40"), "many", &["--exit", "complete"]);
        assert_eq!(code(&output), 0, "{}", text(&output));
        assert!(text(&output).contains(&format!("shard {shard}/40")));
    }
    let attempts = campaign.results("many");
    let played: usize = attempts.iter().map(|path| lines(path).len() - 1).sum();
    assert_eq!((attempts.len(), played), (40, 30));
    let (_, printed, many) = campaign.merge("many", &[]);
    assert_eq!(many, one, "{printed}");

    // Each failure can be seen again by the command that is printed.
    let document: Value = serde_json::from_slice(&one[2]).unwrap();
    for number in [0, 2] {
        let first = &document["findings"][0]["cases"][number];
        let again = first["command"].as_str().unwrap();
        // Quoted for a shell.
        let sim = command().get_program().to_str().unwrap().to_owned();
        let mut shell = Command::new("sh");
        shell.current_dir(campaign.0.path()).arg("-c");
        let output = shell.arg(again.replacen("sim", &sim, 1)).output().unwrap();
        assert_eq!(code(&output), 1);
        // The same to the last digit.
        let reason = first["reason"].as_str().unwrap();
        assert!(
            text(&output).contains(reason),
            "{reason}: {}",
            text(&output)
        );
    }
    // The traces of the first three are there.
    let traces = fs::read_dir(campaign.path("one/traces")).unwrap().count();
    assert_eq!(traces, 3);
    let precious = campaign.path("precious");
    fs::write(&precious, "precious").unwrap();
    fs::create_dir_all(campaign.path("linked/traces")).unwrap();
    for trace in fs::read_dir(campaign.path("one/traces")).unwrap() {
        let trace = trace.unwrap();
        let path = trace.path();
        assert_eq!(code(&campaign.sim(&["replay", path.to_str().unwrap()])), 0);
        let link = campaign.path("linked/traces").join(trace.file_name());
        symlink(&precious, link).unwrap();
    }
    // None goes where a link leads.
    let output = campaign.play("1/1", "linked", &[]);
    assert_eq!(code(&output), 3, "{}", text(&output));
    assert!(text(&output).contains("cannot keep the trace"));
    assert_eq!(fs::read(&precious).unwrap(), b"precious");
}

#[test]
fn a_shard_that_died_is_named_and_never_green() {
    let campaign = Campaign::new();
    for shard in [1, 3] {
        campaign.play(&format!("{shard}/3"), "out", &[]);
    }
    let (exit, printed, files) = campaign.merge("out", &[]);
    assert_eq!(exit, 3, "{printed}");
    assert!(
        printed.contains("MISSING results of shard 2/3: missing in ")
            && printed.contains("  case: files/"),
        "{printed}"
    );
    assert!(files.iter().all(Vec::is_empty));
    assert!(
        !campaign.path("m.xml").exists(),
        "an empty file is no report"
    );

    let (exit, printed, files) = campaign.merge("out", &["--partial"]);
    assert_eq!(exit, 3, "{printed}");
    assert!(printed.contains(" missing"), "{printed}");
    for file in files {
        let file = String::from_utf8_lossy(&file).to_lowercase();
        assert!(file.contains("missing"), "{file}");
    }
    campaign.play("2/3", "out", &[]);
    assert_eq!(campaign.merge("out", &[]).0, 1);
}

#[test]
fn what_a_killed_shard_wrote_is_not_played_again() {
    let campaign = Campaign::new();
    campaign.play("1/1", "whole", &[]);
    let whole = campaign.merge("whole", &[]);
    let results = campaign.results("whole").remove(0);
    let all = lines(&results);

    // As after SIGKILL: a part of the file, and the tear within a line.
    fs::create_dir(campaign.path("torn")).unwrap();
    let torn = campaign.path("torn").join(results.file_name().unwrap());
    let bytes = fs::read(&results).unwrap();
    fs::write(&torn, &bytes[..bytes.len() * 2 / 3]).unwrap();
    let known = lines(&torn).len() - 1;
    assert!(known > 0 && known < 30, "{known}");
    let (exit, printed, _) = campaign.merge("torn", &[]);
    assert_eq!(exit, 3);
    assert!(printed.contains("has no end"), "{printed}");

    let output = campaign.play("1/1", "torn", &["--junit", "junit.xml"]);
    // The file of the shard has all of its cases, also those of the first attempt.
    let junit = fs::read_to_string(campaign.path("junit.xml")).unwrap();
    assert_eq!(junit.matches("<testcase ").count(), 30);
    assert_eq!(junit.matches("<failure ").count(), 10);
    assert!(
        text(&output).contains(&format!("{known} cases have a verdict already")),
        "{}",
        text(&output)
    );
    let attempts = campaign.results("torn");
    assert_eq!(attempts.len(), 2);
    assert_eq!(lines(&attempts[1]).len() - 1, 30 - known);
    assert_eq!(fs::read(&torn).unwrap().len(), bytes.len() * 2 / 3);
    // As if the clock had jumped back between the attempts: dates count for nothing.
    for (path, seconds) in attempts.iter().zip([4_000_000_000, 0]) {
        let file = fs::File::options().write(true).open(path).unwrap();
        file.set_modified(UNIX_EPOCH + Duration::from_secs(seconds))
            .unwrap();
    }
    assert_eq!(campaign.merge("torn", &[]), whole);

    // Nothing is left to be played, and an attempt that finds that out harms nothing.
    // What failed then still fails.
    let output = campaign.play("1/1", "torn", &[]);
    let printed = text(&output);
    assert!(printed.contains("30 cases have a verdict already"));
    assert!(
        printed.contains("20 passed, 10 failed, 0 skipped"),
        "{printed}"
    );
    assert_eq!(code(&output), 1);
    assert_eq!(campaign.merge("torn", &[]), whole);
    assert_eq!(all.len(), 31);
}

#[test]
fn signals_end_a_shard_and_keep_what_is_known() {
    let campaign = Campaign::new();
    let words = [
        "run",
        "--repeat",
        "100000",
        "--results",
        "out",
        "-j",
        "1",
        "--junit",
        "results.xml",
        "files",
    ];
    for (signal, exit) in [(Signal::TERM, Some(3)), (Signal::KILL, None)] {
        let mut child = campaign
            .command(&words)
            .stdout(Stdio::null())
            .stderr(Stdio::null())
            .spawn()
            .unwrap();
        let attempt = if signal == Signal::TERM { 0 } else { 1 };
        until("results are written", || {
            campaign.path("out").exists()
                && campaign
                    .results("out")
                    .get(attempt)
                    .is_some_and(|path| lines(path).len() > 1)
        });
        kill_process(Pid::from_child(&child), signal).unwrap();
        assert_eq!(child.wait().unwrap().code(), exit);
        if signal == Signal::TERM {
            let junit = std::fs::read_to_string(campaign.path("results.xml")).unwrap();
            let is_wrong = junit.contains("<error message=\"the run ended before ");
            assert!(is_wrong, "{junit}");
        }
    }
    let (exit, printed, _) = campaign.merge("out", &["--partial"]);
    assert_eq!(exit, 3);
    assert!(printed.contains(" missing"), "{printed}");
}

/// While it reads, prepares, and between two cases.
#[test]
fn a_signal_ends_a_run_at_any_time() {
    let campaign = Campaign::new();
    let words = ["run", "--repeat", "100000", "-j", "1", "files/rest.toml"];
    for step in 0..20 {
        let mut command = campaign.command(&words);
        let mut child = command.stdout(Stdio::null()).spawn().unwrap();
        std::thread::sleep(Duration::from_millis(10 * step));
        kill_process(Pid::from_child(&child), Signal::TERM).unwrap();
        let ended = child.wait().unwrap();
        // Before it has begun, the system ends it.
        let is_early = ended.signal() == Some(Signal::TERM.as_raw());
        assert!(is_early || ended.code() == Some(3), "{step}: {ended}");
    }
}

#[test]
fn results_of_two_plans_never_mix() {
    let campaign = Campaign::new();
    campaign.play("1/2", "out", &[]);
    for (other, what) in [
        (
            &["--set", "r150.over_rate=silent"][..],
            "r150.over_rate=silent' --param 'pwm=300' files/ahead.toml\" and ",
        ),
        (
            &["--seed", "7"],
            "`files` `files/ahead.toml pwm=300` `seed`: 7 and 1",
        ),
    ] {
        let output = campaign.play("2/2", "out", other);
        assert_eq!(code(&output), 2, "{}", text(&output));
        assert!(
            text(&output).contains("is of another plan than this run"),
            "{}",
            text(&output)
        );
        assert!(text(&output).contains(what), "{}", text(&output));
    }
    let output = campaign.play("2/3", "out", &[]);
    assert!(
        text(&output).contains("`shards`: 3 and 2"),
        "{}",
        text(&output)
    );
    // A client that has changed is another client.
    let script = campaign.path("client.sh");
    let client = |folder: &str, shard: &str| {
        let client = ["--", "sh", script.to_str().unwrap()];
        let mut words = vec![
            "run",
            "--repeat",
            "2",
            "--shard",
            shard,
            "--results",
            folder,
            "files",
        ];
        words.extend(client);
        campaign.sim(&words)
    };
    fs::write(&script, ": >\"$SIM_R150_PORT\"\n").unwrap();
    client("live", "1/2");
    fs::write(&script, "exec 3<>\"$SIM_R150_PORT\"\n").unwrap();
    let output = client("live", "2/2");
    assert!(
        text(&output).contains("`client_files`: "),
        "{}",
        text(&output)
    );

    campaign.play("2/2", "other", &["--seed", "7"]);
    let output = campaign.sim(&["merge", "out", "other"]);
    assert_eq!(code(&output), 3);
    assert!(
        text(&output).contains("of another plan than"),
        "{}",
        text(&output)
    );
}

#[test]
fn what_was_played_twice_counts_once_and_shows_what_differs() {
    let campaign = Campaign::new();
    for shard in ["1/2", "2/2"] {
        campaign.play(shard, "out", &[]);
    }
    let whole = campaign.merge("out", &[]);
    let results = campaign.results("out");
    let again = campaign.path("out/shard-1-of-2.attempt-7.jsonl.gz");

    // The same, but for the real time that it took.
    let mut all = lines(&results[0]);
    all[1]["took_s"] = 99.into();
    write_lines(&again, &all);
    assert_eq!(campaign.merge("out", &[]), whole);

    // An error of the machine gives way to a verdict, whichever comes first.
    for name in [
        "shard-1-of-2.attempt-0.jsonl.gz",
        "shard-1-of-2.attempt-8.jsonl.gz",
    ] {
        let mut failed = all[..2].to_vec();
        failed[1]["verdict"] = "error".into();
        failed[1]["signature"] = "the machine stalled".into();
        write_lines(&campaign.path("out").join(name), &failed);
        assert_eq!(campaign.merge("out", &[]), whole);
    }

    // Two traces of one case.
    let mut differs = all.clone();
    differs.truncate(2);
    differs[1]["trace"] = "0123456789abcdef0123456789abcdef".into();
    write_lines(&again, &differs);
    let (exit, printed, files) = campaign.merge("out", &[]);
    assert_eq!(exit, 1);
    assert!(printed.contains("1 not repeatable"), "{printed}");
    for shown in [printed.as_bytes(), &files[0], &files[1], &files[2]] {
        let shown = String::from_utf8_lossy(shown);
        assert!(shown.contains("traces ") && shown.contains("0123456789abcdef"));
        assert!(shown.contains(all[1]["trace"].as_str().unwrap().get(..16).unwrap()));
    }

    // A case of another shard, as when every shard plays all, and one beyond the plan.
    let mut foreign = all.clone();
    foreign[0]["shard"] = 2.into();
    write_lines(&again, &foreign);
    let (exit, printed, _) = campaign.merge("out", &[]);
    assert!(
        exit == 3 && printed.contains("is not a case of shard 2"),
        "{printed}"
    );
    let mut beyond = all;
    beyond[1]["case"] = 30.into();
    write_lines(&again, &beyond);
    let (exit, printed, _) = campaign.merge("out", &[]);
    assert!(
        exit == 3 && printed.contains("is not a case of shard 1"),
        "{printed}"
    );
}

#[test]
fn the_engine_says_which_shard_it_is() {
    let campaign = Campaign::new();
    let words = [
        "run",
        "--repeat",
        "10",
        "--param",
        "pwm=300,900",
        "--shard",
        "auto",
        "--results",
        "out",
        "files",
    ];
    for index in 0..3 {
        let mut command = campaign.command(&words);
        command
            .env("JOB_COMPLETION_INDEX", index.to_string())
            .env("SIM_SHARDS", "3");
        let output = command.output().unwrap();
        let expected = format!("shard {}/3, as Kubernetes says: ", index + 1);
        assert!(text(&output).contains(&expected), "{}", text(&output));
    }
    assert_eq!(campaign.merge("out", &[]).0, 1);
    let output = campaign.sim(&words);
    assert_eq!(code(&output), 2);
    assert!(
        text(&output).contains("none of CI_NODE_INDEX"),
        "{}",
        text(&output)
    );
}

#[test]
fn outputs_of_a_merge_are_refused_before_any_is_written_and_are_of_no_other() {
    let campaign = Campaign::new();
    campaign.play("1/2", "out", &[]);
    for other in ["same.xml", "./same.xml"] {
        let output = campaign.sim(&["merge", "out", "--junit", "same.xml", "--report", other]);
        assert_eq!(code(&output), 2);
        let why = "--junit and --report name the same file";
        assert!(text(&output).contains(why), "{}", text(&output));
        assert!(!campaign.path("same.xml").exists());
    }
    // What is not an output is found before the first is written.
    fs::write(campaign.path("precious"), "precious").unwrap();
    let output = campaign.sim(&["merge", "out", "--junit", "new.xml", "--json", "precious"]);
    assert_eq!(code(&output), 2, "{}", text(&output));
    assert!(!campaign.path("new.xml").exists());
    // A merge that refuses leaves no results of an earlier one.
    let words = ["merge", "out", "--junit", "new.xml"];
    campaign.sim(&[&words[..], &["--partial"]].concat());
    assert!(campaign.path("new.xml").metadata().unwrap().len() > 0);
    assert_eq!(code(&campaign.sim(&words)), 3);
    assert!(!campaign.path("new.xml").exists());
}

#[test]
fn what_is_no_file_of_results_is_refused() {
    let campaign = Campaign::new();
    campaign.play("1/1", "out", &[]);
    let odd = campaign.path("out/shard-1-of-1.attempt-9.jsonl.gz");
    for bytes in [&b"not gzip at all"[..], b"", b"\x1f\x8b\x08"] {
        fs::write(&odd, bytes).unwrap();
        // Nothing is missing.
        assert_eq!(campaign.merge("out", &[]).0, 1);
    }
    write_lines(&odd, &[serde_json::json!({ "some": "other file" })]);
    let (exit, printed, _) = campaign.merge("out", &[]);
    assert_eq!(exit, 3, "{printed}");
    assert!(printed.contains("no header"), "{printed}");
    let output = campaign.sim(&["merge", "files"]);
    assert_eq!(code(&output), 3);
    assert!(text(&output).contains("files has no results of one campaign"));
}
