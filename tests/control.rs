//! Control of the real program over its socket, by clients that are not ours: Python's `http.client` and
//! `curl`. The scripts are in `tests/control`.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;
#[path = "control/runs.rs"]
mod runs;

use std::fs;
use std::os::unix::fs::PermissionsExt as _;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use rustix::process::Signal;
use serde_json::Value;
use tempfile::TempDir;

use harness::wire::motors;
use harness::{Finished, Sim, command, report_skipped, until};

/// A simulator that is controlled, in its own folder where it is found and leaves its trace.
struct Controlled {
    sim: Sim,
    dir: TempDir,
}

impl Controlled {
    fn start(args: &[&str]) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let port = dir.path().join("r150");
        let trace = dir.path().join("run.trace.jsonl");
        let mut command = command();
        command
            .env("XDG_RUNTIME_DIR", dir.path())
            .args(["--control", "127.0.0.1:0", "--seed", "1", "-v"])
            .arg("--trace")
            .arg(&trace);
        if !args.iter().any(|arg| ["--rig", "--listen"].contains(arg)) {
            command.arg("--pty").arg(&port);
        }
        let sim = Sim::spawn(command.args(args), port, None);
        sim.wait_ready();
        Self { sim, dir }
    }

    fn url(&self) -> String {
        let line = self.sim.wait_line(&["control on http://"]);
        line.split_whitespace().last().unwrap().to_owned()
    }

    fn ctl(&self, args: &[&str]) -> Finished {
        let mut command = command();
        command
            .env("XDG_RUNTIME_DIR", self.dir.path())
            .env_remove("SIM_CONTROL")
            .current_dir(self.dir.path())
            .arg("ctl")
            .args(args);
        Sim::spawn(&mut command, PathBuf::new(), None).wait()
    }

    #[track_caller]
    fn expect_ctl(&self, args: &[&str], wanted: &str) {
        let done = self.ctl(args);
        assert_eq!(done.code(), Some(0), "{args:?}: {}{}", done.out, done.err);
        assert!(done.out.contains(wanted), "{args:?}: {}", done.out);
    }

    /// Ends it; the recording must be the same again.
    fn finish(self) -> String {
        let trace = self.dir.path().join("run.trace.jsonl");
        let ended = self.sim.stop();
        assert_eq!(ended.code(), Some(0), "{}{}", ended.out, ended.err);
        let replayed = harness::run(&["replay", trace.to_str().unwrap()]);
        assert_eq!(replayed.code(), Some(0), "{}{}", replayed.out, replayed.err);
        assert!(replayed.out.contains("to the last byte"));
        fs::read_to_string(trace).unwrap()
    }
}

/// Whether there is a program; says that a test is skipped if not.
fn has(program: &str) -> bool {
    let found = Command::new(program).arg("--version").output().is_ok();
    if !found {
        assert!(
            program != "python3" || std::env::var_os("SIM_TEST_PYTHON").is_none(),
            "SIM_TEST_PYTHON is set, and there is no Python"
        );
        report_skipped("a test of control", &format!("there is no {program}"));
    }
    found
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/control")
}

/// Plays a script of `tests/control` against a simulator.
fn play(script: &str) {
    if !has("python3") {
        return;
    }
    let controlled = Controlled::start(&[]);
    let played = Command::new("python3")
        .arg("-B")
        .arg(folder().join(script))
        .env("SIM_CONTROL", controlled.url())
        .output()
        .unwrap();
    let said = String::from_utf8_lossy(&played.stderr);
    assert!(
        played.status.success(),
        "{said}{}",
        controlled.sim.printed()
    );
    controlled.finish();
}

#[test]
fn each_call_does_what_it_is_to() {
    play("calls.py");
}

#[test]
fn who_must_not_ask_is_refused() {
    play("refusals.py");
}

#[test]
fn floods_and_readers_that_do_not_read_keep_no_client_waiting() {
    play("floods.py");
}

#[test]
fn curl_speaks_with_it() {
    if !has("curl") {
        return;
    }
    let controlled = Controlled::start(&[]);
    let url = controlled.url();
    let (base, token) = url.split_once("/#token=").unwrap();
    let curl = |args: &[&str], path: &str| {
        let bearer = format!("Authorization: Bearer {token}");
        let done = Command::new("curl")
            .args([
                "--silent",
                "--show-error",
                "--max-time",
                "60",
                "--header",
                &bearer,
            ])
            .args(args)
            .arg(format!("{base}{path}"))
            .output()
            .unwrap();
        let text = String::from_utf8(done.stdout).unwrap();
        assert!(done.status.success(), "{args:?} {path}: {:?}", done.stderr);
        text
    };
    let json =
        |args: &[&str], path: &str| -> Value { serde_json::from_str(&curl(args, path)).unwrap() };
    let fault = r#"{"fault": {"kind": "rail-short", "rail": "12v-a"}}"#;
    assert_eq!(json(&["--data", fault], "/v1/steps")["state"], "active");
    // A long body, for which curl asks first whether it may send it.
    let long = format!(
        "{{\"name\": \"long\", \"expect\": {{\"that\": \"true{}\"}}}}",
        " ".repeat(1900)
    );
    let asking = ["--header", "Expect: 100-continue", "--data", long.as_str()];
    assert_eq!(json(&asking, "/v1/steps?wait=true")["state"], "done");
    let names = "/v1/names?names=rail.v12a_on";
    assert!(json(&[], names)["values"]["rail.v12a_on"].is_boolean());
    assert_eq!(
        json(&["--request", "DELETE"], "/v1/steps")["cleared"][0],
        "rail-short"
    );
    assert!(curl(&["--header", "Authorization: Bearer x"], "/v1/state").contains("\"error\""));
    assert!(curl(&[], "/").contains("<canvas"));
    controlled.finish();
}

#[test]
fn the_only_device_needs_no_name_in_a_shell() {
    let controlled = Controlled::start(&["--device", "mecanum"]);
    controlled.expect_ctl(&["fault", "cable-pulled"], "cable-pulled: active");
    controlled.expect_ctl(&["operator", "press", "forward"], "active");
    // The link is gone as long as the cable is pulled, and its path still names the simulator.
    let port = controlled.sim.port().to_owned();
    harness::until("the link is gone", || !port.exists());
    let name = port.file_name().unwrap().to_str().unwrap();
    controlled.expect_ctl(&["--port", name, "get", "t"], "");
    controlled.finish();
}

#[test]
fn a_shell_does_the_same() {
    let controlled = Controlled::start(&[]);
    let port = controlled.sim.port().to_str().unwrap().to_owned();
    controlled.expect_ctl(&["url"], &controlled.url());
    controlled.expect_ctl(&["fault", "rail-short", "rail=12v-a"], "rail-short: active");
    controlled.expect_ctl(
        &["fault", "bit-flips", "probability=0.01", "--for", "10ms"],
        "bit-flips: ",
    );
    controlled.expect_ctl(&["steps"], "active   rail-short");
    controlled.expect_ctl(
        &["--port", &port, "clear", "rail-short"],
        "rail-short: done",
    );
    controlled.expect_ctl(&["operator", "emergency_stop", "true"], "active");
    controlled.expect_ctl(&["clear"], "cleared: ");
    controlled.expect_ctl(&["clear"], "no step to clear");
    controlled.expect_ctl(
        &[
            "world",
            "pwm_signal",
            r#"{"input": "A", "from_output": "A"}"#,
            "--for",
            "1s",
        ],
        "active",
    );
    controlled.expect_ctl(&["get", "truth.at_rest", "truth.speed_mps"], "0.0");
    controlled.expect_ctl(&["get"], "truth.speed_mps");
    controlled.expect_ctl(&["until", "truth.at_rest", "--within", "60s"], "done");
    controlled.expect_ctl(
        &[
            "step",
            r#"{"name": "push", "fault": {"kind": "push", "turn": "1 N*m"}}"#,
        ],
        "push: active",
    );
    controlled.expect_ctl(&["pause"], "paused at");
    controlled.expect_ctl(&["advance", "20ms"], "paused at");
    // What holds already is answered at once; else it is said why nothing comes, until time goes on.
    controlled.expect_ctl(&["until", "t > 0"], "done");
    let mut waiting = command();
    waiting.env("SIM_CONTROL", controlled.url());
    waiting.args(["ctl", "until", "truth.speed_mps > 9", "--within", "10ms"]);
    let waiting = Sim::spawn(&mut waiting, PathBuf::new(), None);
    waiting.wait_error(&["time is paused at", "`sim ctl resume`"]);
    controlled.expect_ctl(&["advance", "20ms"], "paused at");
    assert_eq!(waiting.wait().code(), Some(1));
    controlled.expect_ctl(&["speed", "2"], "speed 2");
    controlled.expect_ctl(&["resume"], "running at");
    controlled.expect_ctl(&["state"], "\"devices\"");

    let late = controlled.ctl(&["until", "truth.speed_mps > 9", "--within", "10ms"]);
    late.expect_refusal(1, &["truth.speed_mps = 0"]);
    controlled
        .ctl(&["fault", "rail-shirt"])
        .expect_refusal(2, &["fault.kind", "did you mean `rail-short`?"]);
    for (args, parts) in [
        (
            &["operator", "place", "x=1", "y=2"][..],
            &["`operator.place.x`: 1 lacks a unit", "place x=1m y=2m"][..],
        ),
        (
            &["operator", "emergency_stop"],
            &["goes in (true) or out", "operator emergency_stop true"],
        ),
        (
            &["fault", "emergency_stop"],
            &["operator = { emergency_stop = true }"],
        ),
        (&["fault", "lock"], &["operator = \"lock\""]),
        (&["speed", "fast"], &["allowed: 0.01 to 100, as in 0.5"]),
        (
            &["fault", "mute", "count=1", "count=2"],
            &["count is given twice"],
        ),
        (
            &["step", r#"{"fault": {"kind": "mute", "kind": "delay"}}"#],
            &["duplicate key: `kind`"],
        ),
    ] {
        controlled.ctl(args).expect_refusal(2, parts);
    }
    controlled.expect_ctl(&["operator", "place", "x=1m", "y=2m"], "done");
    controlled
        .ctl(&["--port", "/nowhere", "pause"])
        .expect_refusal(2, &["no simulator runs that serves /nowhere"]);
    controlled.finish();
}

#[test]
fn a_pause_does_not_make_a_steady_client_too_fast() {
    const COMMANDS: u32 = 80;
    let period = Duration::from_millis(50);
    until("the client has its time", || {
        let controlled = Controlled::start(&[]);
        let mut client = controlled.sim.client();
        let mut sent = Vec::new();
        std::thread::scope(|scope| {
            scope.spawn(|| {
                for pause in [100, 700] {
                    std::thread::sleep(Duration::from_millis(800));
                    controlled.expect_ctl(&["pause"], "paused at");
                    std::thread::sleep(Duration::from_millis(pause));
                    controlled.expect_ctl(&["resume"], "running at");
                }
            });
            let start = Instant::now();
            for turn in 0..COMMANDS {
                std::thread::sleep((period * turn).saturating_sub(start.elapsed()));
                let before = Instant::now();
                client.send(&motors(300, 300));
                sent.push((before, Instant::now()));
            }
        });
        let windows = sent.windows(22).map(|sent| sent[21].0 - sent[0].1);
        let is_steady = windows.min() > Some(Duration::from_secs(1));
        let trace = controlled.finish();
        assert!(trace.contains("\"kind\":\"in\""), "{trace}");
        assert!(!is_steady || !trace.contains("over_rate"), "{trace}");
        is_steady
    });
}

#[test]
fn a_simulator_on_the_network_is_found_by_its_url() {
    let controlled = Controlled::start(&["--listen", "rfc2217://127.0.0.1:0"]);
    let line = controlled.sim.wait_line(&["on rfc2217://"]);
    let mut words = line.split_whitespace();
    let url = words.find(|word| word.starts_with("rfc2217://")).unwrap();
    controlled.expect_ctl(&["--port", url, "get", "truth.x_m"], "0.0");
    let nowhere = ["--port", "rfc2217://127.0.0.1:1", "pause"];
    controlled
        .ctl(&nowhere)
        .expect_refusal(2, &["no simulator runs that serves rfc2217://"]);
    controlled.finish();
}

#[test]
fn the_commands_of_the_guide_work() {
    let guide = fs::read_to_string(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/control.md"));
    let guide = guide.unwrap();
    let block = guide.split("```sh\n").nth(1).unwrap();
    let controlled = Controlled::start(&[]);
    let sim = Path::new(env!("CARGO_BIN_EXE_sim"));
    let path = format!("{}:/usr/bin:/bin", sim.parent().unwrap().display());
    let lines = block.lines().take_while(|line| *line != "```");
    let mut count = 0;
    for line in lines {
        let line = line.split("  #").next().unwrap();
        // It prints until its simulator ends.
        let line = line.replace("sim ctl events", "timeout 2 sim ctl events");
        let mut shell = Command::new("sh");
        shell
            .args(["-c", &line])
            .env("PATH", &path)
            .env("XDG_RUNTIME_DIR", controlled.dir.path());
        let done = Sim::spawn(&mut shell, PathBuf::new(), None).wait();
        let wanted = if line.starts_with("timeout") { 124 } else { 0 };
        assert_eq!(
            done.code(),
            Some(wanted),
            "{line}: {}{}",
            done.out,
            done.err
        );
        count += 1;
    }
    assert!(count > 6);
    controlled.finish();
}

#[test]
fn events_come_to_a_shell() {
    let controlled = Controlled::start(&[]);
    let mut events = command();
    events.env("SIM_CONTROL", controlled.url()).args([
        "ctl",
        "events",
        "--names",
        "truth.speed_mps",
        "--rate",
        "20",
    ]);
    let events = Sim::spawn(&mut events, PathBuf::new(), None);
    events.wait_line(&["\"event\":\"values\"", "truth.speed_mps"]);
    // A client that wants no more of them ends it.
    let mut first = Command::new("sh");
    first
        .args(["-c", "\"$0\" ctl events --names t | head -n 1"])
        .arg(env!("CARGO_BIN_EXE_sim"))
        .env("SIM_CONTROL", controlled.url());
    let first = Sim::spawn(&mut first, PathBuf::new(), None).wait();
    assert_eq!(first.out.lines().count(), 1, "{}{}", first.out, first.err);
    controlled.expect_ctl(&["operator", "lock"], "");
    events.wait_line(&["\"event\":\"log\"", "operated"]);
    controlled.finish();
    events.wait_line(&["\"event\":\"end\""]);
    assert_eq!(events.wait().code(), Some(0));
}

#[test]
fn who_may_look_for_it_is_its_owner_alone() {
    let controlled = Controlled::start(&[]);
    let folder = controlled.dir.path().join("sim");
    let mode = |path: &Path| fs::metadata(path).unwrap().permissions().mode() & 0o777;
    assert_eq!(mode(&folder), 0o700);
    let files: Vec<PathBuf> = fs::read_dir(&folder)
        .unwrap()
        .map(|file| file.unwrap().path())
        .filter(|file| file.extension().is_some_and(|end| end == "json"))
        .collect();
    assert_eq!(
        files.len(),
        1,
        "beside its lock, in which nothing is secret"
    );
    assert_eq!(mode(&files[0]), 0o600);
    // Others are made again, and each has another token.
    let other = Controlled::start(&[]);
    assert_ne!(
        controlled.url().split_once('#').unwrap().1,
        other.url().split_once('#').unwrap().1
    );
    // What a killed one leaves behind is found to have no owner.
    controlled.sim.signal(Signal::KILL);
    until("it is gone", || {
        controlled.ctl(&["state"]).code() == Some(2)
    });
    assert!(fs::read_dir(&folder).unwrap().next().is_none());
    // One that ends well leaves nothing.
    let folder = other.dir.path().join("sim");
    let Controlled { sim, dir } = other;
    sim.stop();
    assert!(fs::read_dir(&folder).unwrap().next().is_none());
    drop(dir);
}

#[test]
fn an_address_that_others_can_reach_is_warned_of() {
    let sim = Sim::start(&["--control", "0.0.0.0:0"]);
    sim.wait_line(&["warning", "a client that has the token"]);
    sim.stop();
    let wrong = harness::run(&["--pty", "/tmp/none", "--control", "example.org:80"]);
    wrong.expect_refusal(2, &["127.0.0.1:0"]);
}

#[test]
fn several_vehicles_and_simulators_are_kept_apart() {
    let dir = tempfile::tempdir().unwrap();
    let rig = dir.path().join("rig.toml");
    fs::write(
        &rig,
        "schema = 1\n[[device]]\nkind = \"r150\"\n[[device]]\nkind = \"mecanum\"\nname = \"my-car\"\n\
         pose = { y = \"2 m\", heading = \"33.3 deg\" }\nsettings = { odometry = { wheel_radius = \"4 cm\" } }\n",
    )
    .unwrap();
    let controlled = Controlled::start(&["--rig", rig.to_str().unwrap()]);
    controlled.expect_ctl(
        &["--device", "my-car", "fault", "blocked", "motors=all"],
        "active",
    );
    controlled.expect_ctl(&["get", "my_car.truth.y_m"], "2.0");
    controlled
        .ctl(&["get", "truth.x_m"])
        .expect_refusal(2, &["did you mean `r150.truth.x_m`"]);
    let trace = controlled.finish();
    assert!(trace.contains("\"code\":\"fault_armed\""), "{trace}");
}

/// What an embedded or served run records of control is in the trace, in words and bytes.
#[test]
fn what_was_done_is_in_the_trace() {
    let controlled = Controlled::start(&[]);
    let mut client = controlled.sim.client();
    client.send(&[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84]);
    controlled.expect_ctl(&["fault", "bit-flips", "probability=0.02"], "active");
    controlled.expect_ctl(&["pause"], "");
    controlled.expect_ctl(&["advance", "100ms"], "");
    controlled.expect_ctl(&["resume"], "");
    for _ in 0..20 {
        client.send(&[0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84]);
    }
    controlled.expect_ctl(&["operator", "emergency_stop", "true"], "");
    controlled.expect_ctl(&["clear"], "bit-flips");
    controlled.expect_ctl(&["until", "count.requests > 0", "--within", "60s"], "done");
    let trace = controlled.dir.path().join("run.trace.jsonl");
    let trace = trace.to_str().unwrap().to_owned();
    let dir = controlled.dir.path().to_owned();
    let ended = controlled.sim.stop();
    assert_eq!(ended.code(), Some(0), "{}", ended.err);
    assert!(dir.exists());
    let shown = harness::run(&["trace", &trace]);
    for part in [
        "\"bit-flips\" was added",
        "time was changed: \"pause\"",
        "\"bit-flips\" was cleared",
    ] {
        assert!(shown.out.contains(part), "no {part} in {}", shown.out);
    }
    assert_eq!(harness::run(&["replay", &trace]).code(), Some(0));
}
