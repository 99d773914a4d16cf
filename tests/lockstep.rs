//! `sim run` with clients in the simulator's time.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "a test fails by panicking, and clippy takes helpers for production code; what is \
              skipped is named"
)]

mod harness;
#[path = "lockstep/languages.rs"]
mod languages;

use std::process::Command;
use std::time::Instant;

use harness::live::{DRIVE, Folder, is_running};
use harness::{Finished, python, until};
use rustix::process::Signal;

fn example(name: &str) -> String {
    format!("{}/docs/examples/{name}.py", env!("CARGO_MANIFEST_DIR"))
}

fn shipped(name: &str) -> String {
    format!("{}/scenarios/{name}", env!("CARGO_MANIFEST_DIR"))
}

/// Runs `sim run` with these arguments and a client, in lockstep.
fn run(folder: &Folder, args: &[&str], client: &[&str]) -> Finished {
    let all = [&["run", "--time", "lockstep"], args, &["--"], client].concat();
    folder.sim(&all)
}

fn folder() -> Folder {
    Folder::with(&[("drive.toml", DRIVE)])
}

/// Runs a shell script; what is printed must hold this, and the exit code be that.
#[track_caller]
fn script(args: &[&str], script: &str, code: i32, wanted: &str) -> (Folder, Finished) {
    let folder = folder();
    let ended = run(
        &folder,
        &[args, &["drive.toml"]].concat(),
        &["sh", "-c", script],
    );
    assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains(wanted), "{}{}", ended.out, ended.err);
    (folder, ended)
}

/// Holds the port open, so that the scenario begins.
const OPEN: &str = "exec 3<>\"$SIM_R150_PORT\"; ";

#[test]
fn a_run_says_whose_time_it_had() {
    let (_, ended) = script(&[], &format!("{OPEN} sleep 1"), 0, "lockstep time");
    assert!(ended.out.contains("4.0 s simulated"), "{}", ended.out);
    script(&["--dry-run"], "true", 0, "lockstep time");
}

#[test]
fn a_day_is_over_in_no_time_and_has_its_date() {
    let day = DRIVE.replace("\"4 s\"", "\"24 h\"");
    let folder = Folder::with(&[("drive.toml", &day)]);
    let begun = Instant::now();
    let client = format!("{OPEN} date -u +%FT%T; sleep 7200; date -u +%FT%T; exit 1");
    let args = ["--date", "2031-05-06 07:08:09", "drive.toml"];
    let ended = run(&folder, &args, &["sh", "-c", &client]);
    let dates = "    2031-05-06T07:08:09\n    2031-05-06T09:08:09\n";
    assert!(ended.out.contains(dates), "{}{}", ended.out, ended.err);
    assert!(begun.elapsed().as_secs() < 60);
}

#[test]
fn the_scenario_begins_when_the_client_opens_its_port() {
    let client = format!("sleep 20; {OPEN} sleep 1");
    script(&[], &client, 0, "4.0 s simulated");
    let client = format!("sleep 3000; {OPEN} sleep 1");
    script(
        &[],
        &client,
        1,
        "has opened no port within 38s of its own time",
    );
}

/// Also where nothing but its bytes happens.
#[test]
fn a_client_has_its_bytes_when_they_arrive_whether_they_are_recorded_or_not() {
    let quiet = &DRIVE[..DRIVE.find("[[step]]").unwrap()];
    let client = format!(
        "{OPEN} stty raw -echo <&3; for i in 1 2 3; do \
         printf '\\252\\125\\000\\360\\367\\007' >&3; head -c 14 <&3 | od -An -tx1; date +%N; done; exit 1"
    );
    let args = ["--seed", "1", "drive.toml", "--output", "out"];
    let said = [&args[..3], &args].map(|args| {
        let folder = Folder::with(&[("drive.toml", quiet)]);
        let ended = run(&folder, args, &["sh", "-c", &client]);
        assert!(ended.out.contains("aa 55 08 f0"), "{}", ended.out);
        let said = ended.out.lines().filter(|line| line.starts_with("    "));
        said.map(str::to_owned).collect::<Vec<_>>()
    });
    assert_eq!(said[0], said[1]);
}

#[test]
fn a_client_at_a_wrong_speed_is_told_of_it() {
    let client = format!(
        "{OPEN} stty raw -echo 9600 <&3; printf '\\252\\125\\000\\360' >&3; sleep 1; exit 1"
    );
    script(&[], &client, 1, "the client has set 9600 baud");
}

#[test]
fn how_a_client_ends_is_judged() {
    script(
        &[],
        &format!("{OPEN} exit 3"),
        1,
        "the client ended with exit code 3",
    );
    script(
        &[],
        &format!("{OPEN} kill -SEGV $$"),
        1,
        "the client was killed by SIGSEGV",
    );
    script(&[], "exit 0", 1, "without having opened a port");
    script(&[], "read nothing <&1", 1, "the client ");
    // Who waits for ever is over at once, at the limit; that alone is no failure.
    script(&[], &format!("{OPEN} cat <&3"), 0, "4.0 s simulated");
    let endless = format!("{OPEN} while :; do :; done");
    script(&["--timeout", "2s"], &endless, 1, "was computing, in ");
}

#[test]
fn nobody_outlives_a_run() {
    let daemon = "setsid sh -c 'trap \"\" TERM HUP INT; echo $$ >>pids; sleep 600; sleep 600' & ";
    let client = format!("{OPEN} {daemon} sleep 2; echo $$ >>pids; exit 0");
    let (folder, _) = script(&[], &client, 0, "1 passed");
    assert_eq!(folder.pids("pids").len(), 2);
    for pid in folder.pids("pids") {
        assert!(!is_running(pid), "{pid:?}");
    }
    assert_eq!(folder.ports_left(), 0);
}

#[test]
fn nobody_outlives_a_simulator_that_is_killed() {
    let daemon = "setsid sh -c 'trap \"\" TERM HUP INT; echo $$ >>pids; sleep 3000' & sleep 0.1; ";
    let client = format!("{OPEN} {daemon} {daemon} {daemon} echo $$ >>pids; while :; do :; done");
    // While it is being started, between its processes, and while it computes.
    for count in 0..=4 {
        let folder = folder();
        let args = ["run", "--time", "lockstep", "drive.toml", "--", "sh", "-c"];
        let sim = folder.start(&[&args[..], &[&client]].concat());
        let written = || std::fs::read_to_string(folder.file("pids")).unwrap_or_default();
        until("so many processes are there", || {
            written().lines().count() >= count
        });
        sim.signal(Signal::KILL);
        sim.wait();
        let pids = match written().is_empty() {
            true => Vec::new(),
            false => folder.pids("pids"),
        };
        until("nobody is left", || {
            !pids.iter().any(|pid| is_running(*pid))
        });
    }
}

/// Two devices, each for a client of its own.
const BOTH: &str = r#"
schema = 1
title = "Two clients drive at a time"
good_client = "Two clients: one drives the R150 ahead, the other the car around a rectangle."
limit = "40 s"

[[device]]
kind = "r150"

[[device]]
kind = "mecanum"
name = "car"
ros = true
pose = { x = "0 m", y = "5 m", heading = "0 deg" }

[[step]]
name = "both are on their way"
at = "0 s"
expect = { that = "r150.truth.speed_mps > 0.3 && car.truth.speed_mps > 0.1", within = "10 s" }

[[step]]
name = "both arrive"
after = "both are on their way"
expect = { that = "r150.truth.distance_m > 2.4 && r150.truth.at_rest && car.count.motion_done == 4", within = "30 s" }
"#;

/// In processes of their own, which have one parent.
#[test]
fn several_clients_drive_at_a_time() {
    let Some(python) = python() else { return };
    let clients = ["careful_client", "careful_car_client"].map(example);
    let [drives, goes_round] = &clients;
    let shell = "\"$1\" \"$2\" & one=$!; \"$1\" \"$3\" & wait $! && wait $one";
    let parent = "import subprocess, sys; children = [subprocess.Popen([sys.executable, client]) \
                  for client in sys.argv[1:]]; sys.exit(max(child.wait(100) for child in children))";
    let starters: [&[&str]; 2] = [
        &["sh", "-c", shell, "sh", python, drives, goes_round],
        &[python, "-c", parent, drives, goes_round],
    ];
    for starter in starters {
        let folder = Folder::with(&[("both.toml", BOTH)]);
        run(&folder, &["--twice", "--seed", "5", "both.toml"], starter).expect_clean();
    }
}

/// Each run writes down what the simulator holds then, and as much output as is ever shown.
#[test]
fn nothing_piles_up_over_a_thousand_runs() {
    let client = format!(
        "{OPEN} sim=/proc/$PPID; set -- $sim/fd/*; \
         echo $# $(cat $sim/task/*/children) $(grep VmRSS $sim/status) >>levels; cat much"
    );
    let folder = Folder::with(&[("drive.toml", DRIVE), ("much", &"x".repeat(1 << 16))]);
    let args = ["-j", "1", "--repeat", "1000", "drive.toml"];
    run(&folder, &args, &["sh", "-c", &client]).expect_clean();
    let levels = folder.read("levels");
    let level = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let memory: u64 = words[words.len() - 2].parse().unwrap();
        // A word for each process.
        ((words[0].to_owned(), words.len()), memory)
    };
    let levels: Vec<_> = levels.lines().map(level).collect();
    assert_eq!(levels.len(), 1000);
    let (early, late) = (&levels[20], &levels[999]);
    assert_eq!(early.0, late.0, "descriptors and processes");
    // The outputs alone would be 64 MB; much less may be the allocator's.
    assert!(late.1 < early.1 + 4000, "memory: {early:?}, {late:?} kB");
}

/// Whether a program is there; if not, it is named.
fn has(program: &str, arguments: &[&str]) -> bool {
    let there = Command::new(program).args(arguments).output();
    let there = there.is_ok_and(|output| output.status.success());
    if !there {
        eprintln!(
            "skipped: {program} {} does not work here",
            arguments.join(" ")
        );
    }
    there
}

/// Compiles a client into the folder.
fn built(folder: &Folder, compiler: &str, arguments: &[&str]) -> String {
    let binary = folder.file("client");
    let output = Command::new(compiler)
        .args(arguments)
        .arg("-o")
        .arg(&binary)
        .output()
        .unwrap();
    let errors = String::from_utf8_lossy(&output.stderr).into_owned();
    assert!(output.status.success(), "{errors}");
    binary.to_str().unwrap().to_owned()
}

/// A program in C that runs another for which a call fails as it does where it is forbidden.
const FORBIDDING: &str = r#"
#include <errno.h>
#include <linux/filter.h>
#include <linux/seccomp.h>
#include <stddef.h>
#include <stdlib.h>
#include <sys/prctl.h>
#include <unistd.h>
int main(int argc, char **argv) {
  struct sock_filter filter[] = {
    BPF_STMT(BPF_LD | BPF_W | BPF_ABS, offsetof(struct seccomp_data, nr)),
    BPF_JUMP(BPF_JMP | BPF_JEQ | BPF_K, atoi(argv[1]), 0, 1),
    BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ERRNO | EPERM),
    BPF_STMT(BPF_RET | BPF_K, SECCOMP_RET_ALLOW),
  };
  struct sock_fprog program = {4, filter};
  if (prctl(PR_SET_NO_NEW_PRIVS, 1, 0, 0, 0)) return 98;
  if (prctl(PR_SET_SECCOMP, SECCOMP_MODE_FILTER, &program)) return 99;
  execv(argv[2], argv + 2); return 97;
}
"#;

#[test]
fn where_tracing_is_forbidden_real_time_is_named() {
    if !has("cc", &["--version"]) {
        return;
    }
    let folder = Folder::with(&[("drive.toml", DRIVE), ("forbidding.c", FORBIDDING)]);
    let source = folder.file("forbidding.c");
    let forbidding = built(&folder, "cc", &[source.to_str().unwrap()]);
    let sim = env!("CARGO_BIN_EXE_sim");
    // ptrace, seccomp, personality.
    for call in ["101", "317", "135"] {
        let ended = Command::new(&forbidding)
            .args([call, sim, "run", "drive.toml", "--", "true"])
            .current_dir(folder.path())
            .output()
            .unwrap();
        let told = String::from_utf8_lossy(&ended.stdout);
        assert_eq!(ended.status.code(), Some(3), "{call}: {told}");
        let wanted = "(Operation not permitted (os error 1)), so the client cannot run in the \
                      simulator's time; --time real runs it in real time";
        assert!(told.contains(wanted), "{call}: {told}");
    }
}

#[test]
fn flags_that_make_no_sense_are_refused() {
    let folder = folder();
    let speed = run(&folder, &["--speed", "2", "drive.toml"], &["true"]);
    speed.expect_refusal(2, &["--speed is for a client with --time real"]);
    let nobody = run(&folder, &["drive.toml"], &["./nobody"]);
    nobody.expect_refusal(2, &["cannot start the client ./nobody", "No such file"]);
    let twice = folder.sim(&["run", "--twice", "drive.toml"]);
    twice.expect_refusal(2, &["--twice is for a client with --time lockstep"]);
}

#[test]
fn the_shipped_clients_pass_and_are_the_same_each_time() {
    let Some(python) = python() else { return };
    let drives = [
        ("careful_client", "r150/jobs/camera-drive.toml"),
        ("careful_client", "r150/faults/cable-pulled.toml"),
        ("naive_client", "r150/jobs/camera-drive.toml"),
        ("careful_car_client", "mecanum/jobs/rectangle.toml"),
    ];
    for (client, drive) in drives {
        let folder = folder();
        let drive = shipped(drive);
        let args = ["--twice", "--seed", "5", &drive];
        run(&folder, &args, &[python, &example(client)]).expect_clean();
    }
}

#[test]
fn modem_lines_that_a_client_sets_appear_as_events() {
    let Some(python) = python() else { return };
    let code = "import os, serial; p = serial.Serial(os.environ['SIM_R150_PORT'], 115200); \
                assert p.cts and p.dsr and p.cd; p.dtr = False; exit(p.cts - 1)";
    let folder = folder();
    let args = ["--output", "out", "drive.toml"];
    run(&folder, &args, &[python, "-c", code]).expect_clean();
    let trace = folder.read("out/drive.trace.jsonl");
    assert!(
        trace.contains("the client has set DTR off and RTS on"),
        "{trace}"
    );
}

#[test]
fn what_differs_between_two_runs_is_shown() {
    let client = format!("{OPEN} echo it ran $(cat count 2>/dev/null) times; echo 1 >>count");
    let (_, ended) = script(&["--twice"], &client, 1, "the second run differs");
    assert!(ended.out.contains("it ran 1 times"), "{}", ended.out);
}
