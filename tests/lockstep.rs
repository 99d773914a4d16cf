//! `sim run` with clients in the simulator's time.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    clippy::print_stderr,
    reason = "a test fails by panicking, and clippy takes helpers for production code; what is \
              skipped is named"
)]

#[path = "lockstep/containers.rs"]
mod containers;
mod harness;
#[path = "lockstep/languages.rs"]
mod languages;

use std::process::Command;
use std::time::Instant;

use harness::live::{DRIVE, Folder, is_running};
use harness::{Finished, python, until};
use rigsim_core::SHIPPED;
use rigsim_runner::trace::Replay;
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

/// Opens the port, stands for two seconds, and publishes where it believes to be ten times a second; once,
/// after a second, so far off.
const BELIEVES: &str = r#"
import os, sys, time
port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY)
with open(os.environ["SIM_PUBLISH"], "a", buffering=1) as published:
    for turn in range(20):
        time.sleep(0.1)
        x = float(sys.argv[1]) if turn == 9 else 0.25
        print(f"x={x} heading=1.5 doubt={turn}", file=published)
        if turn == 3:
            print("what?", file=published)
"#;

const KNOWS: &str = r#"
schema = 1
title = "A client knows where it is"
good_client = "Believes to be within half a metre of where it is."
limit = "3 s"

[[device]]
kind = "r150"

[[always]]
that = "abs(client.x - truth.x_m) < 0.5"
"#;

#[test]
fn what_a_client_believes_is_judged_by_the_truth_in_both_kinds_of_time() {
    if python().is_none() {
        return;
    }
    for time in ["lockstep", "real"] {
        for (x, code) in [("-0.4", 0), ("0.75", 1)] {
            let folder = Folder::with(&[("knows.toml", KNOWS), ("client.py", BELIEVES)]);
            let args = [
                "--seed",
                "1",
                "--timeout",
                "1h",
                "--output",
                "out",
                "--report",
                "report.html",
            ];
            let client = ["knows.toml", "--", "python3", "-B", "client.py", x];
            let ended = folder.sim(&[&["run", "--time", time], &args[..], &client].concat());
            assert_eq!(
                ended.code(),
                Some(code),
                "{time} {x}: {}{}",
                ended.out,
                ended.err
            );
            let report = folder.read("out/knows.report.json");
            let report: serde_json::Value = serde_json::from_str(&report).unwrap();
            if code == 1 {
                assert!(ended.out.contains("client.x = 0.75"), "{}", ended.out);
                let at = report["failures"][0]["time_s"].as_f64().unwrap();
                match time {
                    "lockstep" => assert!((at - 1.0).abs() < 0.01, "{at}"),
                    _ => assert!(at >= 0.9, "{at}"),
                }
                // What passed has no plots.
                let page = folder.read("report.html");
                assert!(page.contains("client.doubt"), "{time}");
            }
            let trace = "out/knows.trace.jsonl";
            assert!(folder.read(trace).contains("bad_publication"), "{time}");
            assert_eq!(folder.sim(&["replay", trace]).code(), Some(0));
            let text = folder.read(trace);
            let mut lines = text.lines();
            let mut replay = Replay::begin(SHIPPED, lines.next().unwrap()).unwrap();
            lines.for_each(|line| replay.line(line).unwrap());
            let margins = &replay.run().finished().unwrap().margins;
            let margins = serde_json::to_string(margins).unwrap();
            let margins: serde_json::Value = serde_json::from_str(&margins).unwrap();
            assert_eq!(margins[0]["margin"] == 0.0, code == 1, "{time} {margins}");
            assert_eq!(report["margins"], margins, "{time}");
            let table = folder.sim(&[
                "trace",
                trace,
                "--csv",
                "t,client.heading",
                "--every",
                "500ms",
            ]);
            assert!(table.out.contains(",1.5\n"), "{}{}", table.out, table.err);
        }
    }
}

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
    let dates = "     0.000000 2031-05-06T07:08:09\n     7200.000050 2031-05-06T09:08:09\n";
    assert!(ended.out.contains(dates), "{}{}", ended.out, ended.err);
    assert!(begun.elapsed().as_secs() < 60);
}

#[test]
fn the_scenario_begins_when_the_client_opens_its_port() {
    let client = format!("sleep 20; {OPEN} sleep 1");
    script(&[], &client, 0, "4.0 s simulated");
    let client = format!("sleep 3000; {OPEN} sleep 1");
    script(&[], &client, 3, "has opened no port within 38s of its time");
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
fn a_client_at_a_wrong_speed_is_reported() {
    let client = format!(
        "{OPEN} stty raw -echo 9600 <&3; printf '\\252\\125\\000\\360' >&3; sleep 1; exit 1"
    );
    script(&[], &client, 1, "the client has set 9600 baud");
}

/// Each of these settings is a reason by itself, in either time.
#[test]
fn a_port_that_is_not_raw_is_an_event_in_both_times() {
    let Some(python) = python() else { return };
    let code = "import os, termios, time\n\
        flags = ((0, 'ICRNL'), (0, 'INLCR'), (0, 'IGNCR'), (0, 'IXON'), (0, 'ISTRIP'), (1, 'OPOST'), \
            (3, 'ICANON'), (3, 'ECHO'), (3, 'ISIG'))\n\
        for index, flag in ((0, None), *flags):\n  \
            fd = os.open(os.environ['SIM_R150_PORT'], os.O_RDWR | os.O_NOCTTY)\n  \
            raw = termios.tcgetattr(fd)\n  \
            if flag: raw[index] |= getattr(termios, flag)\n  \
            termios.tcsetattr(fd, termios.TCSANOW, raw)\n  \
            os.write(fd, bytes.fromhex('aa550008f00755')); time.sleep(0.1)\n  \
            os.close(fd); time.sleep(0.2)";
    for time in ["lockstep", "real"] {
        let folder = folder();
        let args = [
            &["run", "--time", time][..],
            &["--output", "out", "drive.toml", "--"],
        ];
        let play = || {
            folder.sim(&[&args.concat()[..], &[python, "-c", code]].concat());
            folder.read("out/drive.trace.jsonl")
        };
        // What a client does while the simulator is stalled comes at once: that is played again.
        let count = |trace: &str| trace.matches("\"line_not_raw\"").count();
        let is_stalled = |trace: &str| trace.contains("\"simulator_stalled\"");
        let mut trace = play();
        for _ in 0..4 {
            if count(&trace) == 9 || !is_stalled(&trace) {
                break;
            }
            trace = play();
        }
        assert_eq!(count(&trace), 9, "{time}: {trace}");
    }
}

/// Outputs A and B are set to bytes that the terminal takes for itself when they are asked for.
#[test]
fn a_port_with_flow_control_or_translation_is_the_same_in_both_times() {
    let Some(python) = python() else { return };
    let code = r#"
import os, select, termios, time
fd = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY | os.O_NONBLOCK)
raw = termios.tcgetattr(fd)
def crc(data):
    value = 0xFFFF
    for byte in data:
        value ^= byte
        for _ in range(8): value = value >> 1 ^ (0x8408 if value & 1 else 0)
    return (value ^ 0xFFFF).to_bytes(2, "little")
def outputs(*duties):
    data = b"\3" + b"".join(duty.to_bytes(2, "little") for duty in duties)
    return b"\xaa\x55\x08" + data + crc(data)
ask = b"\xaa\x55\0\4" + crc(b"\4")
def set(index, flags):
    settings = list(raw)
    settings[index] |= flags
    termios.tcsetattr(fd, termios.TCSANOW, settings)
def answer(*requests):
    for request in requests:
        os.write(fd, request)
        time.sleep(0.3)
    return os.read(fd, 99).hex()
def writable(): return bool(select.select([], [fd], [], 0)[1])
answer(outputs(0x13, 0x12, 0, 0))
set(0, termios.IXON)
print("stopped", answer(ask), writable())
try: os.write(fd, ask)
except BlockingIOError: print("full")
set(0, 0)
print("raw", writable(), answer(ask))
set(0, termios.IXON)
print("started", answer(ask + outputs(0x11, 0x12, 0, 0) + ask), writable())
set(0, 0)
answer(outputs(0x13, 0x12, 0, 0))
set(0, termios.IXON | termios.IXANY)
print("any", answer(ask), writable())
for flag, come in (termios.OCRNL, (10, 97, 225)), (termios.OLCUC, (13, 65, 193)):
    # With a checksum that is not translated.
    rests = (outputs(*come, last)[-4:] for last in range(200))
    rest = next(rest for rest in rests if not any(b in b"\r\n" or 97 <= b <= 122 or b > 222 for b in rest))
    set(1, termios.OPOST | flag)
    os.write(fd, outputs(13, 97, 225, 0)[:-4] + rest)
    time.sleep(0.3)
    set(1, 0)
    print("translated", answer(ask)[:36])
"#;
    let play = |time| {
        let quiet = DRIVE[..DRIVE.find("[[step]]").unwrap()].replace("\"4 s\"", "\"8 s\"");
        let folder = Folder::with(&[("drive.toml", &quiet)]);
        let args = ["run", "--time", time, "--output", "out", "drive.toml", "--"];
        let ended = folder.sim(&[&args[..], &[python, "-c", code]].concat());
        let output = folder.read("out/drive.client.log");
        assert!(
            output.contains("translated"),
            "{time}: {output}{}",
            ended.out
        );
        output
    };
    assert_eq!(play("lockstep"), play("real"));
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
    script(&[], "exit 0", 3, "without having opened a port");
    script(&[], "read nothing <&1", 3, "the client ");
    // A client that waits for ever is over at once, at the limit; that alone is not a failure.
    script(&[], &format!("{OPEN} cat <&3"), 0, "4.0 s simulated");
    let endless = format!("{OPEN} while :; do :; done");
    script(&["--timeout", "2s"], &endless, 1, "was computing, in ");
}

/// A failure names what may explain it, and how it comes again.
#[test]
fn a_failure_names_what_was_left_behind() {
    let client = format!("{OPEN} sleep 100 & sleep 1; exit 3");
    let (_, ended) = script(&["--schedule", "random"], &client, 1, "exit code 3");
    for wanted in ["left behind: sleep still ran", " --schedule random "] {
        assert!(ended.out.contains(wanted), "{wanted}: {}", ended.out);
    }
}

#[test]
fn no_process_outlives_a_run() {
    let daemon = "setsid sh -c 'trap \"\" TERM HUP INT; echo $$ >>pids; sleep 600; sleep 600' & ";
    let client = format!("{OPEN} {daemon} sleep 2; echo $$ >>pids; exit 0");
    let (folder, _) = script(&[], &client, 0, "1 passed");
    assert_eq!(folder.pids("pids").len(), 2);
    for pid in folder.pids("pids") {
        assert!(!is_running(pid), "{pid:?}");
    }
    assert!(folder.leftovers().is_empty());
}

#[test]
fn no_process_outlives_a_simulator_that_is_killed() {
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
        until("no process is left", || {
            !pids.iter().any(|pid| is_running(*pid))
        });
    }
}

/// Two devices, each for its own client.
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

/// In their own processes, which have one parent.
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

/// Four threads on one port, with a reader that asks how much there is before each read.
#[test]
fn threads_share_a_port() {
    let Some(python) = python() else { return };
    let client = concat!(env!("CARGO_MANIFEST_DIR"), "/tests/clients/four_threads.py");
    let long = DRIVE.replace("\"4 s\"", "\"20 s\"");
    let folder = Folder::with(&[("drive.toml", &long)]);
    let args = ["--twice", "--output", "out", "drive.toml"];
    run(&folder, &args, &[python, client, "15"]).expect_clean();
    let output = folder.read("out/drive.client.log");
    assert!(output.contains(" bytes in "), "{output}");
}

/// Each run writes down what the simulator holds then, and as much output as is ever shown.
#[test]
fn nothing_piles_up_over_hundreds_of_runs() {
    let client = format!(
        "{OPEN} sim=/proc/$PPID; set -- $sim/fd/*; \
         echo $# $(cat $sim/task/*/children) $(grep VmRSS $sim/status) >>levels; cat much"
    );
    let folder = Folder::with(&[("drive.toml", DRIVE), ("much", &"x".repeat(1 << 16))]);
    let args = ["-j", "1", "--repeat", "500", "drive.toml"];
    run(&folder, &args, &["sh", "-c", &client]).expect_clean();
    let levels = folder.read("levels");
    let level = |line: &str| {
        let words: Vec<&str> = line.split(' ').collect();
        let memory: u64 = words[words.len() - 2].parse().unwrap();
        // A word for each process.
        ((words[0].to_owned(), words.len()), memory)
    };
    let levels: Vec<_> = levels.lines().map(level).collect();
    assert_eq!(levels.len(), 500);
    let (early, late) = (&levels[20], &levels[499]);
    assert_eq!(early.0, late.0, "descriptors and processes");
    // The outputs alone would be 32 MB; much less may be the allocator's.
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
fn flags_that_make_no_sense_are_refused() {
    let folder = folder();
    let speed = run(&folder, &["--speed", "2", "drive.toml"], &["true"]);
    speed.expect_refusal(2, &["--speed is for a client with --time real"]);
    let missing = run(&folder, &["drive.toml"], &["./missing"]);
    missing.expect_refusal(2, &["cannot start the client ./missing", "No such file"]);
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

/// Nothing of the scenario needs it any more.
#[test]
fn a_client_that_waits_for_itself_for_ever_fails() {
    if python().is_none() {
        return;
    }
    let code = "import os, threading; os.open(os.environ['SIM_R150_PORT'], os.O_RDWR | os.O_NOCTTY); \
                lock = threading.Lock(); lock.acquire(); lock.acquire()";
    let listens =
        "import os; os.read(os.open(os.environ['SIM_R150_PORT'], os.O_RDWR | os.O_NOCTTY), 9)";
    let fault = r#"{ kind = "bit-flips", probability = 0.5, direction = "to-client" }"#;
    let trouble = harness::live::drive_with(fault, "3500 ms");
    let folder = Folder::with(&[("drive.toml", DRIVE), ("trouble.toml", &trouble)]);
    let waits = "the client waited for what never comes: python3 waited for another thread";
    for (file, code, verdict, wanted) in [
        ("trouble.toml", code, 1, waits),
        ("drive.toml", code, 0, "passed"),
        ("trouble.toml", listens, 0, "not applicable"),
    ] {
        let ended = run(&folder, &[file], &["python3", "-c", code]);
        assert_eq!(ended.code(), Some(verdict), "{}{}", ended.out, ended.err);
        assert!(ended.out.contains(wanted), "{}{}", ended.out, ended.err);
    }
}

#[test]
fn what_a_client_throws_away_of_its_output_is_counted() {
    let writes = format!("{OPEN}echo first; echo second >/dev/stderr; sleep 1");
    let lost = "output: 6 bytes of it are lost: the client has emptied the file";
    script(&["--output", "out"], &writes, 0, lost);
    script(&[], &writes, 0, lost);
    let (_, ended) = script(
        &[],
        &format!("{OPEN}echo first; echo second >&2; sleep 1"),
        0,
        "",
    );
    assert!(!ended.out.contains("lost"), "{}", ended.out);
}
