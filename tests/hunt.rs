//! `sim hunt`: searching for faults that break a client.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use harness::live::Folder;
use harness::{Finished, command};
use serde_json::Value;

/// A client in a shell cannot speak, so this one is in Python's standard library alone: it asks the
/// vehicle to drive for two seconds, goes on after what it does not understand, and never looks at
/// whether the vehicle is locked.
const CLIENT: &str = r#"
import os, struct, time, termios, tty

def crc(data):
    crc = 0xFFFF
    for byte in data:
        crc ^= byte
        for _ in range(8):
            crc = crc >> 1 ^ (0x8408 if crc & 1 else 0)
    return struct.pack("<H", crc ^ 0xFFFF)

port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY)
tty.setraw(port)
speed = termios.tcgetattr(port)
speed[4] = speed[5] = termios.B115200
termios.tcsetattr(port, termios.TCSANOW, speed)
for tick in range(40):
    duty = 300 if tick < 20 else 0
    body = b"\x12" + struct.pack("<hh", duty, duty)
    os.write(port, b"\xAA\x55\x04" + body + crc(body))
    time.sleep(0.1)
"#;

const JOB: &str = r#"
schema = 1
title = "Two seconds ahead"
good_client = "Drives, and stops."
limit = "5 s"
nominal_duration = "4 s"

[[device]]
kind = "r150"

[[step]]
name = "drive"
at = "0 s"
every = "100 ms"
for = "2 s"
host = { send = { set_motors = { right = 300, left = 300 } } }
"#;

const CAR: &str = r#"
schema = 1
title = "A car that stands"
good_client = "Waits."
limit = "2 s"

[[device]]
kind = "mecanum"
"#;

const RULES: &str = r#"
[[never]]
that = "mode.locked && firmware.motor_right != 0"
longer_than = "500 ms"
message = "it drives although it is locked"

[[never]]
that = "truth.battery_v < 45"
message = "no client can help that"
"#;

fn folder() -> Folder {
    Folder::with(&[
        ("job.toml", JOB),
        ("rules.toml", RULES),
        ("client.py", CLIENT),
    ])
}

fn write(folder: &Folder, name: &str, text: &str) {
    std::fs::write(folder.path().join(name), text).unwrap();
}

/// What `hunt.json` in a folder says of the only job.
fn job(folder: &Folder, output: &str) -> Value {
    let text = folder.read(&format!("{output}/hunt.json"));
    let results: Value = serde_json::from_str(&text).unwrap();
    results["jobs"][0].clone()
}

fn hunt(folder: &Folder, more: &[&str]) -> Finished {
    hunt_in(folder, "job.toml", more)
}

fn hunt_in(folder: &Folder, job: &str, more: &[&str]) -> Finished {
    hunt_by(folder, job, "rules.toml", more)
}

fn hunt_by(folder: &Folder, job: &str, rules: &str, more: &[&str]) -> Finished {
    let shrink = ["--shrink-runs", "40"];
    let shrink = if more.contains(&shrink[0]) {
        &[]
    } else {
        &shrink[..]
    };
    let all = [&["hunt", job, "--rules", rules], shrink].concat();
    let output = command()
        .args([&all, more, &["--", "python3", "client.py"]].concat())
        .current_dir(folder.path())
        .output()
        .unwrap();
    let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
    Finished {
        status: output.status,
        out: text(output.stdout),
        err: text(output.stderr),
    }
}

#[test]
fn a_bug_is_found_made_small_written_and_the_same_for_every_number_of_threads() {
    let folder = folder();
    let kinds = ["--faults", "lock,torn-reply", "--runs", "24"];
    let one = hunt(
        &folder,
        &[&kinds[..], &["--output", "one", "-j", "1"]].concat(),
    );
    assert_eq!(one.code(), Some(1), "{}", one.err);
    let text = folder.read("one/hunt.json");
    let report: Value = serde_json::from_str(&text).unwrap();
    let job = &report["jobs"][0];
    assert_eq!(job["runs"], 24, "{text}");
    let found = &job["findings"][0];
    let file = found["file"].as_str().unwrap();
    assert!(found["rule"].as_str().unwrap().contains("locked"), "{text}");
    assert_eq!(found["faults"].as_array().unwrap().len(), 1, "{text}");
    let written = folder.read(&format!("one/{file}"));
    for part in [
        "# Found by sim hunt in run ",
        "# Fails also where \"hunted 1\" begins up to ",
        "It breaks: it drives although it is locked: never `mode.locked && firmware.motor_right != 0` for longer than 500ms.",
        "base = \"../job.toml\"",
        "operator = \"lock\"",
    ] {
        assert!(written.contains(part), "{part}\n{written}");
    }
    // The results say of every schedule what came of it.
    let failed = job["tried"].as_array().unwrap().iter();
    let failed = failed
        .filter(|one| one["margin"] == 0.0)
        .collect::<Vec<_>>();
    assert!(!failed.is_empty(), "{text}");
    for one in failed {
        let kinds = one["kinds"].as_array().unwrap();
        assert!(kinds.contains(&"lock".into()), "{one}");
        assert!(
            one["broken"][0].as_str().unwrap().contains("locked"),
            "{one}"
        );
        let nearer = one["nearer"].as_object().unwrap();
        assert!(nearer.keys().any(|rule| rule.contains("locked")), "{one}");
        assert!(one["error"].is_null(), "{one}");
    }
    assert_eq!(job["margins"].as_object().unwrap().len(), 2, "{text}");
    // Of the two further rules it has only the one that is broken.
    assert!(!written.contains("no client can help"), "{written}");
    // The whole finding is printed once, and its rule also where it is found.
    let faults = format!("{}\n", found["faults"][0].as_str().unwrap());
    let all = one.err + &one.out;
    for (part, times) in [(&*faults, 1), ("it drives although it is locked", 2)] {
        assert_eq!(all.matches(part).count(), times, "{part}\n{all}");
    }
    assert!(!all.contains('#'), "{all}");
    // It fails again as an ordinary file, and only because of the fault.
    let again = folder.sim(&["run", &format!("one/{file}"), "--", "python3", "client.py"]);
    assert_eq!(again.code(), Some(1), "{}", again.err);
    let eight = hunt(
        &folder,
        &[&kinds[..], &["--output", "eight", "-j", "8"]].concat(),
    );
    assert_eq!(eight.code(), Some(1));
    assert_eq!(text, folder.read("eight/hunt.json"));
    // A client that was mended is not answered for by a hunt that is over.
    assert!(!folder.path().join("one/journal.jsonl").exists());
}

#[test]
fn rules_whose_messages_begin_alike_are_two_rules() {
    let folder = folder();
    let rule = |side: &str| {
        format!(
            "[[never]]\nthat = \"mode.locked && firmware.motor_{side} != 0\"\nlonger_than = \"500 ms\"\n\
             message = \"it is locked, but it drives, by the {side} motor\"\n"
        )
    };
    write(&folder, "two.toml", &(rule("right") + &rule("left")));
    let few = ["--faults", "lock", "--runs", "12", "--shrink-runs", "4"];
    let found = hunt_by(&folder, "job.toml", "two.toml", &few);
    assert_eq!(found.code(), Some(1), "{}", found.err);
    for side in ["right", "left"] {
        let rule = format!("found: it is locked, but it drives, by the {side} motor: never `mode");
        assert_eq!(found.out.matches(&rule).count(), 1, "{}", found.out);
    }
}

#[test]
fn a_client_that_only_waits_has_moments_until_the_end() {
    let folder = folder();
    let waits = CLIENT.replace("range(40)", "range(1)") + "while True:\n    time.sleep(0.5)\n";
    write(&folder, "client.py", &waits);
    let few = ["--faults", "lock", "--runs", "2", "--output", "out"];
    let ended = hunt(&folder, &few);
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    let job = job(&folder, "out");
    let last = job["moments"].as_array().unwrap().last().unwrap();
    assert!(last["at_ms"].as_u64().unwrap() > 400, "{last}");
}

/// A client that speaks until the port is gone, and what it does then is in a separate module. It aborts the
/// hunt at a start of which the number is in a file, and computes until the hunt has seen the signal.
const ABORTING: &str = r#"
import os, signal, time, ends

if os.path.exists("abort"):
    left = int(open("abort").read()) - 1
    open("abort", "w").write(str(left))
    if left == 0:
        os.remove("abort")
        os.kill(int(open("pid").read()), signal.SIGINT)
        while True:
            pass

port = os.open(os.environ["SIM_R150_PORT"], os.O_RDWR | os.O_NOCTTY)
for tick in range(20):
    try:
        os.write(port, b"\xAA")
    except OSError:
        ends.end()
    time.sleep(0.1)
"#;

#[test]
fn a_hunt_that_was_aborted_goes_on_unless_the_client_has_changed() {
    let folder = Folder::with(&[
        ("job.toml", JOB),
        ("client.py", ABORTING),
        ("ends.py", "def end():\n    raise SystemExit(0)\n"),
        ("rules.toml", RULES),
    ]);
    let kinds = [
        "--faults",
        "cable-pulled",
        "--stages",
        "single",
        "--runs",
        "8",
        "-j",
        "1",
    ];
    let play = |output| {
        let all = [&["hunt", "job.toml", "--output", output], &kinds[..]].concat();
        // A device among its words is not a file of the client.
        let client = ["--", "python3", "client.py", "/dev/zero"];
        let script = "echo $$ > pid; exec \"$@\"";
        let sim = command().get_program().to_owned();
        let mut shell = std::process::Command::new("sh");
        shell
            .args(["-c", script, "sh"])
            .arg(sim)
            .args(all)
            .args(client);
        let output = shell.current_dir(folder.path()).output().unwrap();
        let err = String::from_utf8(output.stderr).unwrap();
        (output.status.code(), err)
    };
    let lines = || folder.read("out/journal.jsonl").lines().count();
    assert_eq!(
        play("whole"),
        (
            Some(0),
            "job.toml: 1 kind of faults at 2 moments, 0 rules judged\n  only the client's end is judged, and the job's \
             client_report if it has one; --rules adds rules, of which those with `mission = true` do not count\n"
                .to_owned()
        )
    );
    // In the third run, which looks for the moments.
    write(&folder, "abort", "3");
    let (code, err) = play("early");
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("a signal ended it"), "{err}");
    assert!(!err.contains("moment"), "{err}");
    write(&folder, "abort", "9");
    let (code, err) = play("out");
    assert_eq!(code, Some(3), "{err}");
    assert!(err.contains("the same command resumes it"), "{err}");
    assert_eq!(lines(), 6);
    assert_eq!(folder.read("out/hunt.json"), "{\n  \"jobs\": []\n}\n");
    // What it does when the port is gone cannot be seen in the run without faults.
    write(&folder, "ends.py", "def end():\n    raise SystemExit(3)\n");
    let (code, err) = play("out");
    assert_eq!(code, Some(2), "{err}");
    assert!(err.contains("the client has changed"), "{err}");
    write(&folder, "abort", "9");
    assert_eq!(play("out").0, Some(3));
    assert_eq!(lines(), 6);
    // Cut within a line.
    let journal = folder.read("out/journal.jsonl");
    write(&folder, "out/journal.jsonl", &journal[..journal.len() - 20]);
    let (code, err) = play("out");
    assert_eq!(code, Some(1), "{err}");
    assert_eq!(play("new").0, Some(1));
    assert_eq!(folder.read("out/hunt.json"), folder.read("new/hunt.json"));
    assert_ne!(folder.read("out/hunt.json"), folder.read("whole/hunt.json"));
}

#[test]
fn what_was_seen_once_is_no_finding() {
    // When the port is gone it crashes once, and never again.
    const END: &str = r"
def end():
    if os.path.exists('once'):
        raise SystemExit(0)
    open('once', 'w')
    os.abort()

port = ";
    let folder = folder();
    let client = ABORTING.replace("time, ends", "time");
    let client = client.replace("ends.end", "end");
    write(&folder, "client.py", &client.replace("port = ", END));
    let faults = ["--faults", "cable-pulled", "--stages", "single"];
    let more = ["--runs", "8", "--fail-fast", "-j", "1", "--output", "out"];
    let ended = hunt(&folder, &[&faults[..], &more].concat());
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    for part in ["seen once, not repeatable: the client ", "nothing found"] {
        assert!(ended.out.contains(part), "{part}\n{}", ended.out);
    }
    // It is no reason to end the search.
    let text = folder.read("out/hunt.json");
    let report: Value = serde_json::from_str(&text).unwrap();
    let job = &report["jobs"][0];
    assert!(
        job["runs"].as_u64() > job["findings"][0]["run"].as_u64(),
        "{text}"
    );
}

#[test]
fn files_of_others_stay() {
    let folder = folder();
    let hunt = |more: &[&str]| {
        let all = ["--faults", "lock", "--runs", "64", "--fail-fast"];
        hunt(
            &folder,
            &[&all[..], &["--set", "r150.over_rate=silent"], more].concat(),
        )
    };
    write(&folder, "page.html", "mine");
    let page = hunt(&["--report", "page.html"]);
    page.expect_refusal(2, &["page.html", "did not create"]);
    assert!(!folder.path().join("hunt").exists());
    std::fs::create_dir(folder.path().join("hunt")).unwrap();
    let link = folder.path().join("hunt/hunt.json");
    std::os::unix::fs::symlink("../page.html", &link).unwrap();
    hunt(&[]).expect_refusal(2, &["hunt.json", "symbolic link"]);
    std::fs::remove_file(link).unwrap();
    write(&folder, "hunt/journal.jsonl", "");
    let journal = std::fs::File::open(folder.path().join("hunt/journal.jsonl")).unwrap();
    journal.lock().unwrap();
    let earlier = "{\n  \"jobs\": [\n    {\n      \"findings\": []}]}";
    write(&folder, "hunt/hunt.json", earlier);
    hunt(&[]).expect_refusal(2, &["journal.jsonl", "another simulator is using"]);
    assert_eq!(folder.read("hunt/hunt.json"), earlier);
    drop(journal);
    let name = "hunt/it-drives-although-it-is-locked";
    let [first, second] = [1, 2].map(|number| format!("{name}-{number}.toml"));
    write(&folder, &first, "mine");
    let found = hunt(&["--shrink-runs", "5"]);
    assert_eq!(found.code(), Some(1), "{}", found.err);
    assert_eq!(folder.read(&first), "mine");
    let again = format!(
        "# Play it again: sim run --seed 1 --set 'r150.over_rate=silent' {second} -- python3 client.py\n"
    );
    let written = folder.read(&second);
    assert!(
        written.contains("in 5 runs; the budget of --shrink-runs ended"),
        "{written}"
    );
    assert!(written.contains(&again), "{again}\n{written}");
    // One of an earlier hunt is replaced, and so is its journal.
    write(&folder, "hunt/journal.jsonl", "{\"hunt\":\"0\"}\n");
    let other = hunt(&[]);
    assert_eq!(other.code(), Some(1));
    for part in [
        "journal.jsonl is of another hunt",
        "in the place of an earlier hunt's",
    ] {
        assert!(other.err.contains(part), "{part}\n{}", other.err);
    }
    assert!(folder.read(&second).contains(&again));
    assert!(!folder.path().join(format!("{name}-3.toml")).exists());
    assert_eq!(folder.read("page.html"), "mine");
}

#[test]
fn what_no_client_can_help_is_counted_and_not_written() {
    let folder = folder();
    let response = r#"
[[response]]
whenever = "truth.battery_v < 45"
then = "truth.battery_v > 90"
within = "100 ms"
message = "no client makes volts"
"#;
    write(&folder, "sag.toml", &(RULES.to_owned() + response));
    let more = ["--faults", "supply-sag", "--runs", "12", "--output", "out"];
    let sag = hunt_by(&folder, "job.toml", "sag.toml", &more);
    // A sag of 10 V leaves less than 45 V, whatever a client does.
    assert_eq!(sag.code(), Some(0), "{}", sag.err);
    let unavoidable = sag.out.lines().find(|line| line.starts_with("unavoidable"));
    assert!(
        unavoidable.is_some_and(|line| line.contains("no client can help that")),
        "{}",
        sag.out
    );
    assert!(sag.out.contains("nothing found"), "{}", sag.out);
    // However often, and whenever it began.
    assert_eq!(
        sag.out.matches("no client makes volts").count(),
        1,
        "{}",
        sag.out
    );
    assert!(!sag.out.contains("began at"), "{}", sag.out);
    let harmless = [
        "--faults",
        "frozen-sensors,press",
        "--runs",
        "12",
        "--output",
        "harmless",
    ];
    let frozen = hunt(&folder, &harmless);
    assert_eq!(frozen.code(), Some(0), "{}", frozen.err);
    assert!(frozen.out.contains("fewer than "), "{}", frozen.out);
    let tried = folder.read("harmless/hunt.json");
    assert!(tried.contains(r#"press (\"forward\") for"#), "{tried}");
}

/// Of two faults the first does nothing that matters, and the second leaves no client the time to stop.
#[test]
fn a_harmless_fault_before_one_that_no_client_can_help_changes_nothing() {
    let folder = folder();
    write(
        &folder,
        "moving.toml",
        "[[never]]\nthat = \"mode.locked && truth.speed_mps > 0.1\"\nmessage = \"locked and moving\"\n",
    );
    let faults = ["--faults", "lock,frozen-sensors", "--stages", "random"];
    let most = ["--seed", "1", "--runs", "60", "--output", "out"];
    let more = [&faults[..], &most].concat();
    let ended = hunt_by(&folder, "job.toml", "moving.toml", &more);
    assert!(!ended.err.contains("found in run"), "{}", ended.err);
    assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains("unavoidable"), "{}", ended.out);
    // What is not the client's says nothing about how rare its failures are.
    let random = &job(&folder, "out")["stages"]["random"];
    assert_eq!(random["failed"], 0, "{random}");
    let others = random["unavoidable"].as_u64().unwrap();
    assert!((1..59).contains(&others), "{random}");
    assert_eq!(random["runs"].as_u64().unwrap() - others, 36, "{random}");
    let words = format!(
        ", {others} with a failure that is not the client's, the others without failure: fewer than 8 %"
    );
    assert!(ended.out.contains(&words), "{words}\n{}", ended.out);
}

/// The single faults of a hunt, run by run.
fn faults(job: &Value) -> Vec<Vec<String>> {
    let tried = job["tried"].as_array().unwrap().iter();
    let words = |one: &Value| serde_json::from_value(one["faults"].clone()).unwrap();
    tried.map(words).collect()
}

#[test]
fn of_two_faults_in_a_run_those_are_found_that_break_the_rule_alone() {
    let folder = folder();
    write(
        &folder,
        "client.py",
        &CLIENT.replace("tick < 20", "tick < 36"),
    );
    write(
        &folder,
        "stopped.toml",
        "[[never]]\nthat = \"(mode.locked || mode.parked) && firmware.motor_right != 0\"\n\
         longer_than = \"200 ms\"\nmessage = \"it asks for speed\"\n",
    );
    let kinds = ["--faults", "lock,park,torn-reply", "--stages", "single"];
    let more = ["--runs", "24", "--output", "out", "--report", "page.html"];
    let ended = hunt_by(
        &folder,
        "job.toml",
        "stopped.toml",
        &[&kinds[..], &more].concat(),
    );
    assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
    let job = job(&folder, "out");
    let found = job["findings"].as_array().unwrap().iter();
    let mut found: Vec<Vec<String>> = found
        .map(|one| serde_json::from_value(one["faults"].clone()).unwrap())
        .collect();
    found.sort_unstable();
    let kind = |faults: &Vec<String>| faults[0].split(' ').next().unwrap().to_owned();
    assert_eq!(
        found.iter().map(kind).collect::<Vec<_>>(),
        ["lock", "park"],
        "{found:?}"
    );
    assert!(found.iter().all(|faults| faults.len() == 1), "{found:?}");
    // A fault has its own margin, whatever was played with it.
    let (mut innocent, mut guilty) = (0, 0);
    for one in job["tried"].as_array().unwrap() {
        let [kinds, hit, alone] = ["kinds", "hit", "alone"].map(|key| one[key].as_array().unwrap());
        assert_eq!(hit.len(), kinds.len(), "{one}");
        let has_broken = !one["broken"].as_array().unwrap().is_empty();
        let is_pair = kinds.len() == 2;
        // Where both are known to break it, they are not played alone.
        assert!(alone.is_empty() || is_pair && has_broken, "{one}");
        let has_doubt = alone.is_empty() && is_pair && has_broken;
        assert!(!has_doubt || !kinds.contains(&"torn-reply".into()), "{one}");
        guilty += alone.iter().filter(|margin| **margin == 0.0).count();
        for (kind, margin) in kinds
            .iter()
            .zip(alone)
            .filter(|(kind, _)| **kind == "torn-reply")
        {
            assert_ne!(*margin, 0.0, "{kind} {one}");
            innocent += 1;
        }
    }
    assert!(innocent > 0 && guilty > 1, "{innocent} {guilty} {job:#}");
    let page = folder.read("page.html");
    let row = |kind: &str| {
        let begin = format!("<tr><td>{kind}</td>");
        let row = page.split(&begin).nth(1).expect(&page);
        row.split("</tr>").next().unwrap().to_owned()
    };
    assert!(
        row("lock").contains(">0.00<") && row("park").contains(">0.00<"),
        "{page}"
    );
    assert!(
        !row("torn-reply").contains(">0.00<"),
        "{}",
        row("torn-reply")
    );
}

#[test]
fn a_fault_that_came_after_the_client_had_ended_is_played_before_others() {
    let folder = folder();
    let send = "\ndef send(port, data):\n    try:\n        os.write(port, data)\n    \
                except OSError:\n        raise SystemExit(0)\n\nport = ";
    let client = CLIENT
        .replace("os.write(", "send(")
        .replace("\nport = ", send);
    write(&folder, "client.py", &client);
    let kinds = [
        "--faults",
        "cable-pulled,frozen-sensors",
        "--stages",
        "single",
    ];
    let hunt = |more: &[&str], output| {
        let more = [&kinds[..], more, &["--runs", "24", "--output", output]].concat();
        let ended = hunt(&folder, &more);
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
        job(&folder, output)
    };
    let job = hunt(&[], "out");
    let runs = faults(&job);
    let mut again = 0;
    for (run, all) in runs.iter().enumerate() {
        for (place, fault) in all.iter().enumerate() {
            if runs[..run].iter().any(|before| before.contains(fault)) {
                again += 1;
                assert_eq!(place, 0, "{all:?}");
            }
        }
    }
    assert!(again > 0, "{runs:#?}");
    // Nothing is late where each is by itself.
    let runs = faults(&hunt(&["--max-faults", "1"], "single"));
    let all: std::collections::BTreeSet<_> = runs.iter().flatten().collect();
    assert!(runs.iter().all(|all| all.len() == 1), "{runs:#?}");
    assert_eq!(all.len(), runs.len(), "{runs:#?}");
}

#[test]
fn a_hunt_whose_runs_have_no_verdict_says_so() {
    let folder = folder();
    write(&folder, "starts", "");
    // Three times without faults, and never again.
    let gone = "open('starts', 'a').write('x')\n\
                if os.path.getsize('starts') > 3:\n    raise SystemExit('no serial port here')\nport = ";
    write(&folder, "client.py", &CLIENT.replace("port = ", gone));
    let ended = hunt(
        &folder,
        &["--faults", "lock", "--runs", "4", "--output", "out"],
    );
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    let why = "no run of the search has a verdict: the client could not";
    assert!(ended.out.contains(why), "{}", ended.out);
    assert!(!ended.out.contains("nothing found"), "{}", ended.out);
}

/// What a client does that gives up after some replies that are not like the first.
const GIVES_UP: &str = r#"
import select, sys
first, bad = None, 0
for tick in range(30):
    os.write(port, b"\xAA\x55\x00\xF0" + crc(b"\xF0"))
    time.sleep(0.1)
    ready, _, _ = select.select([port], [], [], 0)
    reply = os.read(port, 4096) if ready else b""
    first = first or reply
    bad = 0 if reply == first else bad + 1
    if bad > PATIENCE:
        sys.exit(3)
"#;

#[test]
fn an_exit_code_counts_where_no_fault_lasts() {
    const RULE: &str = "the client ended with exit code 3";
    let folder = folder();
    let gives_up = |patience, kinds| {
        let begin = CLIENT.split("for tick").next().unwrap();
        let client = begin.to_owned() + &GIVES_UP.replace("PATIENCE", patience);
        write(&folder, "client.py", &client);
        let more = ["--runs", "16", "--stages", "single", "--output", patience];
        let done = hunt(&folder, &[&["--faults", kinds], &more[..]].concat());
        let report = folder.read(&format!("{patience}/hunt.json"));
        let report: Value = serde_json::from_str(&report).unwrap();
        (done, report["jobs"][0].clone())
    };
    // One flipped bit is enough, which ends by itself.
    let (hasty, job) = gives_up("0", "burst,bit-flips");
    assert_eq!(hasty.code(), Some(1), "{}{}", hasty.err, hasty.out);
    assert_eq!(job["findings"].as_array().unwrap().len(), 1, "{job:#}");
    let found = &job["findings"][0];
    assert_eq!(found["rule"], RULE);
    let faults = found["faults"][0].as_str().unwrap();
    assert!(
        faults.starts_with("bit-flips (probability = 1.0, count = 1), "),
        "{faults}"
    );
    let written = folder.read("0/the-client-ended-with-exit-code-3-1.toml");
    assert!(!written.contains("\nfor = "), "{written}");
    // A patient one ends only where the line stays mute, as it may.
    let (patient, job) = gives_up("5", "mute");
    assert_eq!(patient.code(), Some(0), "{}{}", patient.err, patient.out);
    assert!(job["unavoidable"][RULE].as_u64() > Some(0), "{job:#}");
    assert!(
        patient
            .out
            .contains("the client gave up where a fault lasts, "),
        "{}",
        patient.out
    );
    assert!(!patient.out.contains("for any client"), "{}", patient.out);
}

#[test]
fn several_jobs_are_searched_and_a_reference_is_played_too() {
    let careful = CLIENT.replace("tick < 20", "tick < 4");
    let folder = Folder::with(&[
        ("job.toml", JOB),
        ("other.toml", JOB),
        ("rules.toml", RULES),
        ("client.py", CLIENT),
        ("careful.py", &careful),
    ]);
    let lock = ["other.toml", "--faults", "lock", "--runs", "64"];
    let with = |reference, output| {
        let more = [
            "--reference",
            reference,
            "--output",
            output,
            "--report",
            "page.html",
        ];
        hunt(&folder, &[&lock[..], &more].concat())
    };
    let both = with("python3 careful.py", "both");
    assert_eq!(both.code(), Some(1), "{}", both.err);
    let report: Value = serde_json::from_str(&folder.read("both/hunt.json")).unwrap();
    for (index, job) in report["jobs"].as_array().unwrap().iter().enumerate() {
        let found = &job["findings"][0];
        let file = found["file"].as_str().unwrap();
        assert!(
            folder
                .path()
                .join(format!("both/job-{}/{file}", index + 1))
                .exists()
        );
    }
    assert_eq!(report["jobs"].as_array().unwrap().len(), 2);
    // The page has the map, and each finding as a report of a run shows it.
    let page = folder.read("page.html");
    assert!(page.contains("<svg") && page.contains("lock"), "{page}");
    for part in [
        "Found by sim hunt in run ",
        "-1.toml -- python3 client.py",
        "seeds from 1 on",
    ] {
        assert!(page.contains(part), "{part}\n{page}");
    }
    assert!(
        !page.contains("hunt-") && !page.contains("A schedule of a hunt"),
        "{page}"
    );
    // What a client that is trusted cannot help is attributed to no client.
    let same = with("python3 client.py", "same");
    assert_eq!(same.code(), Some(0), "{}", same.out);
    assert!(same.out.contains("unavoidable"), "{}", same.out);
    // One that cannot do the job tells nothing.
    with("nosuchcmd", "none")
        .expect_refusal(2, &["--reference", "could not be played", "exit code 127"]);
    let misspelt = with("python3 missing.py", "none");
    misspelt.expect_refusal(2, &["--reference", "exit code 2"]);
    assert!(!folder.path().join("none").exists());
    // The first finding is enough.
    let more = ["--fail-fast", "--output", "fast"];
    let fast = hunt(&folder, &[&lock[..], &more].concat());
    assert_eq!(fast.code(), Some(1), "{}", fast.err);
    assert!(folder.path().join("fast/job-1").exists());
    assert!(!folder.path().join("fast/job-2").exists());
}

#[test]
fn a_fault_that_a_device_cannot_have_is_left_out() {
    let folder = folder();
    write(&folder, "car.toml", CAR);
    write(
        &folder,
        "rules.toml",
        "[[never]]\nthat = \"truth.speed_mps > 9\"\n",
    );
    write(
        &folder,
        "client.py",
        "import os, time\nos.open(os.environ['SIM_MECANUM_PORT'], os.O_RDWR)\ntime.sleep(1)\n",
    );
    // Its `link_timeout` is off, so it has no watchdog.
    let more = ["--faults", "watchdog-off", "--runs", "4"];
    let none = hunt_in(&folder, "car.toml", &more);
    none.expect_refusal(2, &["none of these kinds of faults"]);
    let other = [
        "--faults",
        "watchdog-off,reset",
        "--runs",
        "4",
        "--stages",
        "single",
    ];
    let reset = hunt_in(&folder, "car.toml", &other);
    assert_eq!(reset.code(), Some(0), "{}", reset.err);
    assert!(
        reset.out.contains("4 single faults of 1 kind at"),
        "{}",
        reset.out
    );
}

#[test]
fn what_cannot_be_searched_is_refused() {
    let folder = folder();
    let strict = "[[never]]\nthat = \"truth.distance_m > 0.1\"\nmessage = \"it drives\"\n";
    write(&folder, "strict.toml", strict);
    let fails = hunt(&folder, &["--rules", "strict.toml"]);
    fails.expect_refusal(2, &["the client fails in the job as it is", "it drives"]);
    let unknown = hunt(&folder, &["--faults", "gremlins"]);
    unknown.expect_refusal(2, &["no fault or action gremlins", "sim faults"]);
    hunt(&folder, &["--faults", "lock,,mute"])
        .expect_refusal(2, &["a value is required", "--faults"]);
    let misspelt = hunt(&folder, &["--faults", "lock,supply-sags"]);
    misspelt.expect_refusal(2, &["did you mean supply-sag?"]);
    write(&folder, "none.toml", "title = \"None\"\n");
    let none = hunt(&folder, &["--rules", "none.toml"]);
    none.expect_refusal(2, &["none.toml", "no rule itself"]);
    let step = r#"
[[step]]
name = "hunted 1"
at = "1 s"
fault = { kind = "mute" }
"#;
    write(&folder, "found.toml", &(JOB.to_owned() + step));
    hunt_in(&folder, "found.toml", &[]).expect_refusal(2, &["found.toml", "hunted 1", "rename it"]);
    let rules = "[[never]]\nthat = \"truth.nosuch > 1\"\nsince = 3\n";
    write(&folder, "misspelt.toml", rules);
    let misspelt = hunt(&folder, &["--rules", "misspelt.toml"]);
    misspelt.expect_refusal(
        2,
        &[
            "misspelt.toml: `never.that`: no name",
            "misspelt.toml: `never.since`",
        ],
    );
    assert!(!misspelt.err.contains("hunt-"), "{}", misspelt.err);
    let second = hunt(&folder, &["--stages", "further"]);
    second.expect_refusal(2, &["add single or random"]);
    write(&folder, "once", "");
    let counts = "\nopen('once', 'a').write('x')\n";
    let client = CLIENT.replace("range(40)", "range(39 + len(open('once').read()))") + counts;
    write(&folder, "client.py", &client);
    let differs = hunt(&folder, &[]);
    differs.expect_refusal(
        2,
        &["`sim run --twice --seed 1 job.toml -- python3 client.py`"],
    );
    write(
        &folder,
        "client.py",
        "raise SystemExit('no serial port here')\n",
    );
    let again = "sim run --seed 1 job.toml -- python3 client.py";
    let none = hunt(&folder, &[]);
    none.expect_refusal(
        3,
        &[
            "job.toml: the client could not",
            "no serial port here",
            again,
        ],
    );
    assert!(!folder.path().join("hunt").exists());
}
