//! How clients of `sim run` end, and that no process is left behind.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::path::PathBuf;

use quick_junit::Report;
use rustix::process::{Pid, Signal, kill_process};

use harness::live::{DRIVE, Folder, is_running};
use harness::{Sim, until};

/// Holds the port open, so that time begins.
const OPEN: &str = "exec 3<>\"$SIM_R150_PORT\"; ";
/// Goes into its own session, ignores what can be ignored, and writes down who it is; so does
/// its child, whose parent then ends.
const DAEMONS: &str = "setsid sh -c 'trap \"\" TERM HUP INT; echo $$ >>pids; \
    sh -c \"echo \\$\\$ >>pids; sleep 600\" & sleep 600; sleep 600' & ";

fn folder() -> Folder {
    let names = ["drive.toml", "other.toml", "third.toml"];
    Folder::with(&names.map(|name| (name, DRIVE)))
}

#[track_caller]
fn fails(folder: &Folder, args: &[&str], script: &str, reason: &str) -> String {
    ends_with(1, folder, args, script, reason)
}

#[track_caller]
fn ends_with(code: i32, folder: &Folder, args: &[&str], script: &str, reason: &str) -> String {
    let ended = folder.with_script(args, script);
    assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains(reason), "{}", ended.out);
    assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());
    ended.out
}

fn wait_for_pids(folder: &Folder, count: usize) {
    until("the client has written down who it is", || {
        fs::read_to_string(folder.file("pids")).is_ok_and(|pids| pids.lines().count() >= count)
    });
}

#[track_caller]
fn no_process_is_left(folder: &Folder) {
    let pids = folder.pids("pids");
    assert!(!pids.is_empty());
    for pid in pids {
        until("all have ended", || !is_running(pid));
    }
}

#[test]
fn an_exit_code_other_than_zero_fails_and_the_output_is_shown() {
    let script = format!("{OPEN} echo to stdout; echo to stderr >&2; exit 3");
    let args = ["run", "drive.toml"];
    let said = fails(
        &folder(),
        &args,
        &script,
        "the client ended with exit code 3",
    );
    assert!(said.contains("to stdout\n    to stderr"), "{said}");
    assert!(said.contains("again: sim run --seed "), "{said}");
    let flags = " --time real --max-stall 1h drive.toml -- sh -c ";
    assert!(said.contains(flags), "{said}");
}

#[test]
fn a_crash_fails() {
    let script = format!("{OPEN} kill -SEGV $$");
    let args = ["run", "drive.toml"];
    fails(
        &folder(),
        &args,
        &script,
        "the client was killed by SIGSEGV",
    );
}

#[test]
fn a_client_that_never_opens_a_port_could_not_be_played() {
    for time in ["lockstep", "real"] {
        for (script, end) in [("exit 0", 0), ("echo no such module; exit 7", 7)] {
            let folder = folder();
            let args = ["run", "--time", time, "--junit", "r.xml", "drive.toml"];
            let ended = folder.with_script(&args, script);
            assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
            let said = ended.out;
            let why = format!("it ended with exit code {end} without having opened a port");
            assert!(said.contains(&why), "{said}");
            assert!(said.starts_with("ERROR   drive.toml: "), "{said}");
            assert_eq!(said.contains("no such module"), end == 7, "{said}");
            assert!(!said.contains("never began"), "{said}");
            let junit = Report::deserialize_from_str(&folder.read("r.xml")).unwrap();
            assert_eq!((junit.failures, junit.errors), (0, 1));
        }
    }
}

#[test]
fn a_client_that_hangs_before_it_opens_a_port_is_ended() {
    let script = "echo $$ >>pids; sleep 600";
    let folder = folder();
    let args = ["run", "--timeout", "1s", "drive.toml"];
    ends_with(3, &folder, &args, script, "still running after the 1s");
    no_process_is_left(&folder);
}

#[test]
fn a_client_that_outlives_the_scenario_is_ended_without_an_error() {
    let folder = folder();
    let script = format!("{OPEN} echo $$ >>pids; sleep 600");
    let args = ["run", "--speed", "8", "drive.toml"];
    folder.with_script(&args, &script).expect_clean();
    no_process_is_left(&folder);
}

#[test]
fn a_process_that_ignores_sigterm_or_has_its_own_session_is_ended() {
    let folder = folder();
    let script = format!("trap '' TERM; {OPEN} {DAEMONS} echo $$ >>pids; sleep 600; sleep 600");
    let args = ["run", "--speed", "8", "drive.toml"];
    folder.with_script(&args, &script).expect_clean();
    assert_eq!(folder.pids("pids").len(), 3);
    no_process_is_left(&folder);
}

#[test]
fn what_a_client_leaves_running_is_ended_with_it() {
    let folder = folder();
    // It goes only when the others have written down who they are.
    let wait = "while [ \"$(wc -l <pids)\" != 2 ]; do sleep 0.02; done 2>/dev/null; ";
    let script = format!("{OPEN} {DAEMONS} {wait} exit 0");
    folder
        .with_script(&["run", "drive.toml"], &script)
        .expect_clean();
    no_process_is_left(&folder);
}

fn two_running(folder: &Folder) -> Sim {
    let script = format!("{OPEN} {DAEMONS} echo $$ >>pids; sleep 600");
    let args = [
        "run",
        "-j",
        "2",
        "--junit",
        "junit.xml",
        "drive.toml",
        "other.toml",
        "third.toml",
        "--",
        "sh",
        "-c",
        &script,
    ];
    let sim = folder.start(&args);
    wait_for_pids(folder, 6);
    sim
}

#[test]
fn ctrl_c_breaks_off_and_still_writes_the_results() {
    let folder = folder();
    let ended = two_running(&folder).stop();
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains("1 skipped, 2 aborted"), "{}", ended.out);
    no_process_is_left(&folder);
    assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());
    let junit = Report::deserialize_from_str(&folder.read("junit.xml")).unwrap();
    assert_eq!((junit.tests, junit.errors), (3, 2));
}

#[test]
fn a_killed_simulator_leaves_no_process_behind() {
    let folder = folder();
    let sim = two_running(&folder);
    sim.signal(Signal::KILL);
    sim.wait();
    no_process_is_left(&folder);
}

#[test]
fn the_next_run_removes_what_a_killed_one_has_left() {
    let folder = folder();
    let script = format!("{OPEN} echo $$ >>pids; sleep 600");
    let run = ["run", "--report", "report.html", "drive.toml"];
    let sim = folder.start(&[&run[..], &["--", "sh", "-c", &script]].concat());
    wait_for_pids(&folder, 1);
    sim.signal(Signal::KILL);
    sim.wait();
    no_process_is_left(&folder);
    assert!(!folder.leftovers().is_empty());
    folder.sim(&run).expect_clean();
    assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());
}

#[test]
fn a_second_signal_loses_nothing() {
    let folder = folder();
    let sim = two_running(&folder);
    sim.signal(Signal::TERM);
    sim.signal(Signal::TERM);
    let ended = sim.wait();
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    no_process_is_left(&folder);
    assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());
    let junit = Report::deserialize_from_str(&folder.read("junit.xml")).unwrap();
    assert_eq!((junit.tests, junit.errors), (3, 2));
}

/// Signals the process that looks after the client whose id was written down.
fn signal_supervisor(folder: &Folder, signal: Signal) {
    wait_for_pids(folder, 3);
    // The client itself writes last.
    let client = *folder.pids("pids").last().unwrap();
    let stat = fs::read_to_string(format!("/proc/{}/stat", client.as_raw_nonzero())).unwrap();
    let parent = stat.rsplit(')').next().unwrap().split_whitespace().nth(1);
    let parent = Pid::from_raw(parent.unwrap().parse().unwrap()).unwrap();
    kill_process(parent, signal).unwrap();
}

#[test]
fn no_process_is_left_when_the_supervisor_of_the_client_is_killed() {
    let wait = "while [ \"$(wc -l <pids)\" != 2 ]; do sleep 0.02; done 2>/dev/null; ";
    let script = format!("trap '' TERM; {OPEN} {DAEMONS} {wait} echo $$ >>pids; sleep 600");
    let args = ["run", "drive.toml", "--", "sh", "-c", &script];
    for (signal, code) in [(Signal::KILL, 3), (Signal::TERM, 1)] {
        let folder = folder();
        let sim = folder.start(&args);
        signal_supervisor(&folder, signal);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
        no_process_is_left(&folder);
        assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());
    }
}

/// The client leaves at once, and there is a day to go.
fn long() -> Folder {
    Folder::with(&[("long.toml", &DRIVE.replace("\"4 s\"", "\"24 h\""))])
}

#[test]
fn what_is_broken_off_after_the_client_has_left_has_not_passed() {
    let folder = long();
    let script = format!("{OPEN} echo $$ >>pids");
    let sim = folder.start(&[
        "run",
        "--timeout",
        "20 min",
        "long.toml",
        "--",
        "sh",
        "-c",
        &script,
    ]);
    wait_for_pids(&folder, 1);
    no_process_is_left(&folder);
    let ended = sim.stop();
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains("1 aborted"), "{}", ended.out);
}

#[test]
fn the_time_allowed_holds_after_the_client_has_left_too() {
    let folder = long();
    let args = ["run", "--timeout", "500ms", "--output", "out", "long.toml"];
    ends_with(3, &folder, &args, OPEN, "still running after the 500ms");
    // What was recorded of it can be played again.
    folder
        .sim(&["replay", "out/long.trace.jsonl"])
        .expect_clean();
}

#[test]
fn a_client_that_does_not_exist_is_a_mistake_of_the_caller() {
    let folder = folder();
    let args = [
        "run",
        "--junit",
        "junit.xml",
        "drive.toml",
        "--",
        "./missing",
    ];
    let ended = folder.sim(&args);
    ended.expect_refusal(2, &["cannot start the client ./missing", "No such file"]);
    let junit = Report::deserialize_from_str(&folder.read("junit.xml")).unwrap();
    assert_eq!((junit.tests, junit.errors), (1, 1));
}

#[test]
fn devices_that_a_client_could_not_tell_apart_are_refused() {
    let second = "[[device]]\nkind = \"r150\"\nname = \"R150\"\npose = { x = \"9 m\" }\n\n[[step]]";
    let first = "kind = \"r150\"\nname = \"r150\"";
    let two = DRIVE
        .replacen("kind = \"r150\"", first, 1)
        .replacen("[[step]]", second, 1)
        .replace("at = \"100 ms\"", "at = \"100 ms\"\ndevice = \"r150\"")
        .replace("truth.speed_mps", "true || 0.0");
    let folder = Folder::with(&[("two.toml", &two)]);
    let ended = folder.with_script(&["run", "two.toml"], "exit 0");
    ended.expect_refusal(2, &["two.toml", "$SIM_R150_PORT"]);
}

#[test]
fn a_client_that_floods_its_output_is_shown_by_its_end() {
    let script = format!("{OPEN} seq 1 200000; echo the end; exit 1");
    let args = ["run", "drive.toml"];
    let said = fails(&folder(), &args, &script, " the end\n");
    assert!(said.len() < 10_000, "{} bytes", said.len());
}
