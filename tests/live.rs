//! Scenarios against real clients: ports, verdicts, reports, recordings.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::env;
use std::path::PathBuf;
use std::thread::sleep;
use std::time::Duration;

use quick_junit::{Report, TestCaseStatus};
use serde_json::Value;

use harness::client::Client;
use harness::live::{DRIVE, Folder, drive_with};
use harness::{json_lines, until, with_code};

const PERIOD: Duration = Duration::from_millis(60);

/// The port that `sim run` names, or `None` where a user runs ignored tests.
fn port() -> Option<PathBuf> {
    env::var_os("SIM_R150_PORT").map(PathBuf::from)
}

/// Drives for about a second, and stops.
fn drive(client: &mut Client, power: i16) {
    for _ in 0..16 {
        let power = power.to_le_bytes();
        client.send(&harness::wire::frame(0x12, &[power, power].concat()));
        sleep(PERIOD);
    }
    // The reply is to this one, whatever a busy machine did to the others.
    client.send(&harness::wire::motors(0, 0));
}

#[test]
#[ignore = "the client of other tests"]
fn a_client_that_drives() {
    let Some(port) = port() else { return };
    println!(
        "port {} seed {}",
        port.display(),
        env::var("SIM_SEED").unwrap()
    );
    drive(&mut Client::open(&port), 500);
}

#[test]
#[ignore = "the client of other tests"]
fn a_client_that_sends_garbage() {
    let Some(port) = port() else { return };
    let mut client = Client::open(&port);
    client.send(&[0xAA, 0x55, 0x00, 0x07, 0x00, 0x00]);
    drive(&mut client, 500);
}

#[test]
#[ignore = "the client of other tests"]
fn a_client_that_opens_again() {
    let Some(port) = port() else { return };
    let mut client = Client::open(&port);
    assert_eq!(client.ask(0x07, &[]), [1]);
    until("the port has hung up", || !port.exists());
    println!("hung up");
    until("the port is back", || port.exists());
    let mut client = Client::open(&port);
    assert_eq!(client.ask(0x07, &[]), [1]);
    println!("answered again");
}

#[test]
fn a_client_is_served_judged_and_recorded() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let args = [
        "run",
        "--seed",
        "7",
        "--output",
        "out",
        "--junit",
        "out/junit.xml",
        "drive.toml",
    ];
    let ended = folder
        .with_client(&args, "a_client_that_drives")
        .expect_clean();
    assert!(ended.out.contains("passed  drive.toml: A client drives"));
    assert!(ended.out.contains("1 passed, 0 failed, 0 skipped"));
    assert_eq!(folder.leftovers(), Vec::<PathBuf>::new());

    let written = folder.read("out/drive.client.log");
    assert!(written.contains("seed 7"), "{written}");
    let report: Value = serde_json::from_str(&folder.read("out/drive.report.json")).unwrap();
    assert_eq!(report["verdict"], "passed");
    assert_eq!(report["seed"], 7);
    assert_eq!(report["client"]["exit_code"], 0);
    assert_eq!(report["client"]["stopped"], false);
    assert_eq!(report["devices"][0]["requests"], 17);
    let junit = Report::deserialize_from_str(&folder.read("out/junit.xml")).unwrap();
    assert_eq!((junit.tests, junit.failures, junit.errors), (1, 0, 0));

    // The bytes of a real client, played again in simulated time.
    let trace = folder.read("out/drive.trace.jsonl");
    let again = folder.sim(&["replay", "out/drive.trace.jsonl"]);
    again.expect_clean();
    // The first byte of a reply is changed in the record.
    let changed = trace.replacen(r#""bytes":"AA55"#, r#""bytes":"AB55"#, 1);
    let changed = if changed == trace {
        trace.replacen("aa55", "ab55", 1)
    } else {
        changed
    };
    assert_ne!(changed, trace);
    std::fs::write(folder.file("changed.jsonl"), changed).unwrap();
    let again = folder.sim(&["replay", "changed.jsonl"]);
    assert_eq!(again.code(), Some(1), "{}", again.out);
}

#[test]
fn what_a_client_does_wrong_is_reported_and_can_fail_it() {
    let strict = DRIVE.replace("tags", "client_report = \"empty\"\ntags");
    let folder = Folder::with(&[("drive.toml", DRIVE), ("strict.toml", &strict)]);
    let args = ["run", "--junit", "junit.xml", "drive.toml", "strict.toml"];
    let ended = folder.with_client(&args, "a_client_that_sends_garbage");
    assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
    assert!(ended.out.contains("1 passed, 1 failed, 0 skipped"));
    assert!(ended.out.contains("client report: r150: bad_crc 1x"));
    let junit = Report::deserialize_from_str(&folder.read("junit.xml")).unwrap();
    assert_eq!((junit.tests, junit.failures, junit.errors), (2, 1, 0));
    let suite = &junit.test_suites[1];
    let is_reported = |property: &quick_junit::Property| {
        property.name.as_str() == "sim.client_report" && property.value.contains("bad_crc")
    };
    assert!(suite.properties.iter().any(is_reported));
    assert!(matches!(
        suite.test_cases[0].status,
        TestCaseStatus::NonSuccess { .. }
    ));
}

#[test]
fn several_clients_have_ports_of_their_own() {
    let files: Vec<(String, &str)> = (0..4).map(|i| (format!("{i}.toml"), DRIVE)).collect();
    let files: Vec<(&str, &str)> = files.iter().map(|(n, text)| (n.as_str(), *text)).collect();
    let folder = Folder::with(&files);
    let args = ["run", "-j", "4", "--output", "out", "."];
    let ended = folder
        .with_client(&args, "a_client_that_drives")
        .expect_clean();
    assert!(ended.out.contains("4 passed"), "{}", ended.out);
    let mut ports: Vec<String> = (0..4)
        .map(|i| folder.read(&format!("out/{i}.client.log")))
        .map(|log| {
            let line = log.lines().find(|line| line.starts_with("port ")).unwrap();
            line.split(' ').nth(1).unwrap().to_owned()
        })
        .collect();
    ports.sort();
    ports.dedup();
    assert_eq!(ports.len(), 4);
}

#[test]
fn a_pulled_cable_hangs_the_port_up_and_it_comes_back_at_its_path() {
    let pulled = drive_with(r#"{ kind = "cable-pulled" }"#, "200 ms");
    let folder = Folder::with(&[("pulled.toml", &pulled)]);
    let args = ["run", "--output", "out", "pulled.toml"];
    let ended = folder.with_client(&args, "a_client_that_opens_again");
    let written = folder.read("out/pulled.client.log");
    ended.expect_clean();
    assert!(written.contains("answered again"), "{written}");
    folder
        .sim(&["replay", "out/pulled.trace.jsonl"])
        .expect_clean();
}

#[test]
fn a_fault_that_a_live_client_never_met_is_not_applicable() {
    let fault = r#"{ kind = "bit-flips", probability = 0.5, direction = "to-client" }"#;
    let late = drive_with(fault, "3500 ms");
    let folder = Folder::with(&[("late.toml", &late)]);
    let args = ["run", "--output", "out", "--junit", "r.xml", "late.toml"];
    let ended = folder
        .with_client(&args, "a_client_that_drives")
        .expect_clean();
    assert!(
        ended.out.starts_with("skipped late.toml: "),
        "{}",
        ended.out
    );
    let why = "not applicable: \"trouble\": the fault bit-flips was there from 3.500000 s on and never hit \
               anything; a hit is: A bit was flipped.";
    assert!(ended.out.contains(why), "{}", ended.out);
    assert!(ended.out.contains("0 passed, 0 failed, 1 skipped"));
    let report: Value = serde_json::from_str(&folder.read("out/late.report.json")).unwrap();
    assert_eq!(report["verdict"], "skipped");
    let junit = Report::deserialize_from_str(&folder.read("r.xml")).unwrap();
    let status = &junit.test_suites[0].test_cases[0].status;
    let TestCaseStatus::Skipped { message, .. } = status else {
        panic!("{status:?}");
    };
    assert!(message.as_ref().unwrap().contains("never hit anything"));
    let said = folder
        .sim(&["trace", "out/late.trace.jsonl"])
        .expect_clean();
    assert!(said.out.contains("the end: skipped: "), "{}", said.out);
    // With the script, which its file can make hit, it is a mistake.
    let ended = folder.sim(&["run", "late.toml"]);
    assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
}

/// What the client makes of a vehicle that it drives too fast, and then ends badly.
#[test]
fn a_failure_says_what_was_expected_and_its_cause_comes_first() {
    let rest = "\n[[step]]\nname = \"rest\"\nat = \"3 s\"\nexpect = { that = \"truth.at_rest\" }\n\
                [[step]]\nname = \"far\"\nwhen = \"truth.x_m > 50\"\noperator = \"lock\"\n";
    let slow = DRIVE.replace("mps < 1.0", "mps < 0.1") + rest;
    let slow = slow.replace("limit =", "description = \"It is to go slowly.\"\nlimit =");
    let folder = Folder::with(&[("slow.toml", &slow)]);
    let script = "exec 3<>\"$SIM_R150_PORT\"; stty raw -echo <&3; \
                  for i in 1 2 3 4 5 6 7 8; do printf '\\252\\125\\004\\022\\364\\001\\364\\001\\105\\070' >&3; \
                  sleep 0.1; echo \"sent $i\"; done; exit 4";
    let files = ["--junit", "r.xml", "--report", "r.html", "--output", "out"];
    let args = [&["run", "--time", "lockstep"], &files[..], &["slow.toml"]].concat();
    let ended = folder.with_script(&args, script);
    assert_eq!(ended.code(), Some(1), "{}{}", ended.out, ended.err);
    let places = [
        "about: It is to go slowly.",
        "expected: Drives at half",
        " s: always `truth.speed",
        "exit code 4",
        "\"far\": it never",
        " sent 8",
    ]
    .map(|part| {
        ended
            .out
            .find(part)
            .unwrap_or_else(|| panic!("no {part} in {}", ended.out))
    });
    assert!(places.is_sorted(), "{}", ended.out);
    // The client's lines have the times of its clock, from when it opened the port.
    let sent = ended.out.lines().filter(|line| line.contains(" sent "));
    let times: Vec<f64> = sent
        .map(|line| line.split_whitespace().next().unwrap().parse().unwrap())
        .collect();
    assert_eq!(times.len(), 8, "{}", ended.out);
    for (index, time) in times.into_iter().enumerate() {
        let due = 0.1 * (index + 1) as f64 - 1e-6;
        assert!((due..due + 0.05).contains(&time), "{time} is not {due}");
    }

    let junit = Report::deserialize_from_str(&folder.read("r.xml")).unwrap();
    let status = &junit.test_suites[0].test_cases[0].status;
    let TestCaseStatus::NonSuccess {
        message,
        description,
        ..
    } = status
    else {
        panic!("{status:?}");
    };
    let message = message.as_ref().unwrap();
    assert!(
        message.contains("always `truth.speed_mps < 0.1`"),
        "{message:?}"
    );
    let description = description.as_ref().unwrap();
    assert!(
        description.starts_with("about: It is to go slowly.\nexpected: Drives at half power"),
        "{description:?}"
    );

    let report: Value = serde_json::from_str(&folder.read("out/slow.report.json")).unwrap();
    assert_eq!(report["verdict"], "failed");
    assert_eq!(
        report["good_client"],
        "Drives at half power for a second and stops."
    );
    assert_eq!(report["description"], "It is to go slowly.");
    let kinds = report["failures"].as_array().unwrap().iter();
    let kinds: Vec<&str> = kinds.map(|one| one["kind"].as_str().unwrap()).collect();
    assert_eq!(kinds, ["rule", "client"]);
    assert_eq!(report["not_applicable"].as_array().unwrap().len(), 2);

    let page = folder.read("r.html");
    for part in [
        "Drives at half power for a second",
        "It is to go slowly.",
        "badge failed",
    ] {
        assert!(page.contains(part), "no {part} in {page}");
    }
}

#[test]
fn a_job_that_the_client_never_did_is_a_failure() {
    let far = "\n[[step]]\nname = \"far\"\nwhen = \"truth.x_m > 50\"\nexpect = { that = \"truth.at_rest\" }\n";
    let push = "\n[[step]]\nname = \"lock\"\nat = \"3 s\"\noperator = \"lock\"\n";
    let files = [
        ("job.toml", DRIVE.to_owned() + far, "FAILED "),
        ("pushed.toml", DRIVE.to_owned() + far + push, "skipped"),
        (
            "mission.toml",
            DRIVE.to_owned() + push + far + "mission = true\n",
            "FAILED ",
        ),
    ];
    let texts = files
        .each_ref()
        .map(|(name, text, _)| (*name, text.as_str()));
    let folder = Folder::with(&texts);
    for (name, _, verdict) in files {
        let args = ["run", "--time", "lockstep", name];
        let ended = folder.with_script(&args, "exec 3<>\"$SIM_R150_PORT\"; sleep 1");
        assert_eq!(
            ended.code(),
            Some(i32::from(verdict == "FAILED ")),
            "{}",
            ended.out
        );
        assert!(
            ended.out.starts_with(&format!("{verdict} {name}")),
            "{}",
            ended.out
        );
        assert!(
            ended.out.contains("\"far\": it never began: "),
            "{}",
            ended.out
        );
    }
}

/// Of several vehicles for the client, one that knows the first drives it, and says nothing about the rest.
#[test]
fn a_client_that_knows_one_vehicle_skips_a_file_with_several() {
    let two = DRIVE.replacen(
        "[[device]]\nkind = \"r150\"",
        "[[device]]\nkind = \"r150\"\nname = \"one\"\n\n[[device]]\nkind = \"r150\"\nname = \"other\"\npose = { x = \"9 m\" }",
        1,
    );
    let two = two.replace("at = \"100 ms\"", "at = \"100 ms\"\ndevice = \"one\"");
    let two = two.replace("truth.speed", "one.truth.speed");
    let folder = Folder::with(&[("two.toml", &two)]);
    let args = ["run", "--time", "lockstep", "two.toml"];
    let open =
        |variables: &str| format!("for port in {variables}; do exec 3<>\"$port\"; done; sleep 1");
    let ended = folder
        .with_script(&args, &open("$SIM_R150_PORT"))
        .expect_clean();
    let why = "not applicable: the client never opened a port of \"other\"";
    assert!(ended.out.contains(why), "{}", ended.out);
    let both = open("$SIM_ONE_PORT $SIM_OTHER_PORT");
    let ended = folder.with_script(&args, &both).expect_clean();
    assert!(
        ended.out.contains("1 passed, 0 failed, 0 skipped"),
        "{}",
        ended.out
    );
    // A rule that is broken is not skipped.
    std::fs::write(folder.file("two.toml"), two.replace("< 1.0", "< 0.0")).unwrap();
    let ended = folder.with_script(&args, &open("$SIM_R150_PORT"));
    assert_eq!(ended.code(), Some(1), "{}", ended.out);
    assert!(ended.out.starts_with("FAILED  two.toml"), "{}", ended.out);
}

#[test]
fn each_time_has_its_seed_and_its_files() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let args = [
        "run",
        "--seed",
        "40",
        "--repeat",
        "3",
        "-j",
        "3",
        "--output",
        "out",
        "drive.toml",
    ];
    let ended = folder
        .with_client(&args, "a_client_that_drives")
        .expect_clean();
    for time in 0..3 {
        let seed = 40 + time;
        let line = format!("drive.toml #{}", time + 1);
        assert!(ended.out.contains(&line), "{}", ended.out);
        let written = folder.read(&format!("out/drive-{}.client.log", time + 1));
        assert!(written.contains(&format!("seed {seed}")), "{written}");
    }
}

#[test]
fn a_scenario_is_played_against_whatever_client_comes() {
    let folder = Folder::with(&[
        ("drive.toml", DRIVE),
        ("slow.toml", &DRIVE.replace("< 1.0", "< 0.1")),
    ]);
    for (file, code, verdict) in [("drive.toml", 0, "passed"), ("slow.toml", 1, "failed")] {
        let port = folder.file("r150");
        let args = [
            "--pty",
            port.to_str().unwrap(),
            "--scenario",
            file,
            "--log-format",
            "json",
            // Whatever this machine is busy with.
            "--max-stall",
            "1h",
        ];
        let sim = folder.start(&args);
        sim.wait_ready();
        // Time begins with the client, so this costs nothing of the four seconds.
        let mut client = Client::open(&port);
        drive(&mut client, 500);
        drop(client);
        let ended = sim.wait();
        assert_eq!(ended.code(), Some(code), "{}{}", ended.out, ended.err);
        let verdicts = with_code(&json_lines(&ended.out), "verdict");
        assert_eq!(verdicts.len(), 1);
        assert_eq!(verdicts[0]["verdict"], verdict);
        assert!(!port.exists());
    }
}

#[test]
fn what_breaks_is_a_line_of_the_summary_and_of_the_verdict() {
    let fuse = "{ kind = \"fuse-blown\", fuse = \"motor-right\" }";
    let folder = Folder::with(&[("fuse.toml", &drive_with(fuse, "500 ms"))]);
    let line = "damage: r150: fuse_blown 1x, first at 0.500000 s: the fuse of the right motor blew";
    let played = folder.sim(&["run", "fuse.toml"]).expect_clean().out;
    assert!(played.contains(line), "{played}");
    // The client has not driven by then, so the fault hits nothing.
    let port = folder.file("r150");
    let port = port.to_str().unwrap();
    let sim = folder.start(&["--pty", port, "--scenario", "fuse.toml"]);
    sim.wait_ready();
    let client = Client::open(port.as_ref());
    let ended = sim.wait();
    drop(client);
    assert!(
        ended.out.contains(&line.replace("r150: ", "")),
        "{}",
        ended.out
    );
}

#[test]
fn a_scenario_that_is_broken_off_has_not_passed() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let sim = folder.start(&["--scenario", "drive.toml"]);
    sim.wait_ready();
    let ended = sim.stop();
    assert_eq!(ended.code(), Some(3), "{}{}", ended.out, ended.err);
    assert!(
        ended.out.contains("aborted: A client drives"),
        "{}",
        ended.out
    );
    for why in ["a signal ended it", "without having opened a port"] {
        assert!(ended.out.contains(why), "{}", ended.out);
    }
}

#[test]
#[ignore = "the client of other tests"]
fn a_client_that_leaves_at_once() {
    let Some(port) = port() else { return };
    let mut client = Client::open(&port);
    client.send(&harness::wire::frame(0x07, &[]).repeat(2));
}

#[test]
fn what_a_client_sent_last_is_taken_and_leaving_is_no_error() {
    let strict = DRIVE.replace("tags", "client_report = \"empty\"\ntags");
    let strict = strict.replace("limit = \"4 s\"", "limit = \"9 s\"");
    let folder = Folder::with(&[("strict.toml", &strict)]);
    let args = ["run", "--output", "out", "strict.toml"];
    let ended = folder.with_client(&args, "a_client_that_leaves_at_once");
    ended.expect_clean();
    let report: Value = serde_json::from_str(&folder.read("out/strict.report.json")).unwrap();
    assert_eq!(report["devices"][0]["requests"], 2);
    assert!(folder.read("out/strict.trace.jsonl").contains("detach"));
}

#[test]
fn results_of_two_scenarios_never_share_a_file() {
    let folder = Folder::with(&[("b-c.toml", DRIVE), ("drive.toml", DRIVE)]);
    for name in ["a", "a-b"] {
        std::fs::create_dir(folder.file(name)).unwrap();
    }
    std::fs::write(folder.file("a/b-c.toml"), DRIVE).unwrap();
    std::fs::write(folder.file("a-b/c.toml"), DRIVE).unwrap();
    let ended = folder.sim(&["run", "--output", "out", "a", "a-b"]);
    ended.expect_refusal(
        2,
        &["a/b-c.toml and a-b/c.toml", "would write the same files"],
    );
    std::os::unix::fs::symlink(folder.path(), folder.file("a/loop")).unwrap();
    // A link that leads in a circle and a name that is given twice add nothing.
    let ended = folder.sim(&["run", ".", "./drive.toml"]).expect_clean();
    assert!(ended.out.contains("4 passed, 0 failed"), "{}", ended.out);
}

#[test]
fn after_the_first_failure_nothing_new_is_begun() {
    let slow = DRIVE.replace("< 1.0", "< 0.1");
    let files = [("a.toml", DRIVE), ("b.toml", &slow), ("c.toml", DRIVE)];
    let folder = Folder::with(&files);
    let ended = folder.sim(&["run", "--fail-fast", "-j", "1", "--junit", "j.xml", "."]);
    assert_eq!(ended.code(), Some(1), "{}", ended.out);
    assert!(
        ended.out.contains("1 passed, 1 failed, 1 skipped"),
        "{}",
        ended.out
    );
    let junit = Report::deserialize_from_str(&folder.read("j.xml")).unwrap();
    assert_eq!((junit.tests, junit.failures), (3, 1));

    // Thousands that were not played are one line for each file.
    let files = ["--junit", "j.xml", "--report", "r.html"];
    let words = ["run", "--fail-fast", "-j", "1", "--repeat", "1000"];
    let ended = folder.sim(&[&words[..], &files, &["b.toml", "c.toml"]].concat());
    let counts = "0 passed, 1 failed, 1999 skipped";
    assert!(ended.out.contains(counts), "{}", ended.out);
    let junit = Report::deserialize_from_str(&folder.read("j.xml")).unwrap();
    assert_eq!((junit.tests, junit.failures), (3, 1));
    let names: Vec<String> = junit
        .test_suites
        .iter()
        .map(|suite| suite.name.to_string())
        .collect();
    assert_eq!(names, ["b.toml #1", "b.toml", "c.toml"]);
    let page = folder.read("r.html");
    for shown in [
        ">1999 skipped<",
        "before 999 cases were played",
        "before 1000 cases were played",
    ] {
        assert!(page.contains(shown), "{page}");
    }
}

#[test]
fn what_would_be_played_is_shown_without_playing() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let args = [
        "run",
        "--dry-run",
        "--seed",
        "3",
        "drive.toml",
        "--",
        "./my client",
    ];
    let ended = folder.sim(&args).expect_clean();
    for part in [
        "seed 3",
        "$SIM_R150_PORT",
        "sim run --seed 3 --time real --max-stall 1h drive.toml -- './my client'",
    ] {
        assert!(ended.out.contains(part), "no {part} in {}", ended.out);
    }
    let listed = folder.sim(&["run", "--list", "."]).expect_clean();
    assert_eq!(listed.out, "./drive.toml: A client drives [drive]\n");
    let none = folder.sim(&["run", "--tag", "fly", "."]);
    none.expect_refusal(2, &["no scenario there has the tag fly"]);
    let none = folder.sim(&["run", "--filter", "fly", "."]);
    none.expect_refusal(2, &["`fly`", "nothing to run"]);
    let speed = folder.sim(&["run", "--speed", "2", "."]);
    speed.expect_refusal(2, &["--speed is for a client with --time real"]);
}
