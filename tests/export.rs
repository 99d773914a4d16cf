//! Runs in other tools: exported, played again up to a time, and called by agents. `tests/tools` does it with those
//! tools.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::collections::BTreeMap;
use std::fs;

use std::io::{BufRead as _, BufReader, Read as _, Write as _};
use std::net::TcpStream;
use std::process::Stdio;

use harness::client::Client;
use harness::live::{DRIVE, Folder};
use harness::{Finished, Sim, command};
use serde_json::{Value, json};

/// The types of the blocks of a capture; both lengths of each have to be right.
fn blocks(capture: &[u8]) -> Vec<u32> {
    let number = |at: usize| u32::from_le_bytes(capture[at..at + 4].try_into().unwrap());
    let (mut at, mut kinds) = (0, Vec::new());
    while at < capture.len() {
        let length = number(at + 4) as usize;
        assert_eq!(number(at + length - 4) as usize, length, "block at {at}");
        kinds.push(number(at));
        at += length;
    }
    kinds
}

#[test]
fn a_capture_has_a_packet_for_each_frame() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let all = ["run", "--seed", "1", "--output", ".", "--export", "pcapng"];
    folder
        .sim(&[&all[..], &["drive.toml"]].concat())
        .expect_clean();
    assert!(
        !folder.file("drive.pcapng").exists(),
        "a passed run is exported only if asked"
    );
    folder
        .sim(&[&all[..], &["--export-all", "drive.toml"]].concat())
        .expect_clean();
    let capture = fs::read(folder.file("drive.pcapng")).unwrap();
    let traffic = folder.sim(&["trace", "drive.trace.jsonl"]).expect_clean();
    let frames = traffic.out.lines();
    let frames = frames.filter(|line| line.contains(" -> ") || line.contains(" <- "));
    let blocks = blocks(&capture);
    assert_eq!(blocks[..2], [0x0A0D_0D0A, 1], "a section, an interface");
    assert!(blocks[2..].iter().all(|kind| *kind == 6));
    assert_eq!(blocks.len() - 2, frames.count());

    // Exported again, it is the same, and replaces nothing else.
    let again = ["trace", "./drive.trace.jsonl", "--to", "drive.pcapng"];
    folder.sim(&again).expect_clean();
    assert!(fs::read(folder.file("drive.pcapng")).unwrap() == capture);
    fs::write(folder.file("mine.pcapng"), "mine").unwrap();
    let other = ["trace", "drive.trace.jsonl", "--to", "mine.pcapng"];
    let refused = folder.sim(&other);
    assert_eq!(refused.status.code(), Some(2), "{}", refused.err);
    assert_eq!(folder.read("mine.pcapng"), "mine");
    let unknown = ["trace", "drive.trace.jsonl", "--to", "drive.doc"];
    let refused = folder.sim(&unknown);
    refused.expect_refusal(2, &["pcapng", "a time belongs to --until"]);
}

/// Times of the packets of a capture, ns.
fn times(capture: &[u8]) -> Vec<u64> {
    let number = |at: usize| u32::from_le_bytes(capture[at..at + 4].try_into().unwrap());
    let (mut at, mut times) = (0, Vec::new());
    while at < capture.len() {
        if number(at) == 6 {
            times.push(u64::from(number(at + 12)) << 32 | u64::from(number(at + 16)));
        }
        at += number(at + 4) as usize;
    }
    times
}

/// Runs `drive.toml` of a folder, and exports it there.
fn run_exported(folder: &Folder, formats: &str) {
    let run = "run --seed 1 --output . --export-all drive.toml --export";
    let run: Vec<&str> = run.split(' ').chain([formats]).collect();
    folder.sim(&run).expect_clean();
}

#[test]
fn packets_and_bits_are_in_the_order_of_time() {
    // A recording contains a burst of bytes when the next begins.
    let file = include_str!("../scenarios/mecanum/jobs/rectangle.toml");
    let folder = Folder::with(&[("drive.toml", file)]);
    run_exported(&folder, "pcapng,vcd");
    let times = times(&fs::read(folder.file("drive.pcapng")).unwrap());
    assert!(times.len() > 10 && times.is_sorted(), "{times:?}");
    let vcd = folder.read("drive.vcd");
    let stamps = vcd.lines().filter_map(|line| line.strip_prefix('#'));
    let stamps: Vec<u64> = stamps.map(|stamp| stamp.parse().unwrap()).collect();
    assert!(stamps.is_sorted());
}

#[test]
fn what_a_client_publishes_is_exported() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let run = [
        "run",
        "--time",
        "lockstep",
        "--seed",
        "1",
        "--output",
        ".",
        "--export-all",
    ];
    let client =
        "exec 3<>\"$SIM_R150_PORT\"; sleep 0.2; echo x=1.5 y=-2 >>\"$SIM_PUBLISH\"; sleep 1";
    let formats = [
        "--export",
        "mcap,perfetto,vcd",
        "drive.toml",
        "--",
        "sh",
        "-c",
        client,
    ];
    folder.sim(&[&run[..], &formats].concat());
    let file = fs::read(folder.file("drive.mcap")).unwrap();
    let all = mcap::MessageStream::new(&file).unwrap().map(Result::unwrap);
    let own = all.filter(|message| message.channel.topic == "/client");
    let own: Vec<_> = own.map(|message| message.data.to_vec()).collect();
    let encoded = |x: f64, y: f64| [&[9][..], &x.to_le_bytes(), &[17], &y.to_le_bytes()].concat();
    assert_eq!(own.last().unwrap()[..], encoded(1.5, -2.0));
    // It is not known before.
    assert_eq!(own[0][..], encoded(f64::NAN, f64::NAN));
    let vcd = folder.read("drive.vcd");
    assert!(
        vcd.contains("module client $end") && vcd.contains("\nr1.5 ") && vcd.contains("\nr-2 ")
    );
    let trace = fs::read(folder.file("drive.perfetto-trace")).unwrap();
    let has = |text: &[u8]| trace.windows(text.len()).any(|part| part == text);
    assert!(has(b"client.x") && has(&1.5_f64.to_le_bytes()));
}

#[test]
fn a_recording_has_values_frames_and_the_scenario() {
    let comes = "[[step]]\nat = \"500 ms\"\nworld = { add = { circle = [{ at_m = [9, 9], radius = \"20 cm\" }] } }\n";
    let drive = format!("{DRIVE}{comes}");
    let folder = Folder::with(&[("drive.toml", &drive)]);
    run_exported(&folder, "mcap");
    let file = fs::read(folder.file("drive.mcap")).unwrap();
    let (mut counts, mut last) = (BTreeMap::new(), 0);
    for message in mcap::MessageStream::new(&file).unwrap() {
        let message = message.unwrap();
        let schema = message.channel.schema.clone().unwrap();
        assert_eq!(schema.encoding, "protobuf");
        let key = (message.channel.topic.clone(), schema.name.clone());
        *counts.entry(key).or_insert(0_usize) += 1;
        last = last.max(message.log_time);
    }
    let count = |topic: &str, schema: &str| counts[&(topic.to_owned(), schema.to_owned())];
    let moments = count("/r150/truth", "rigsim.r150_truth");
    assert_eq!(count("/tf", "foxglove.FrameTransform"), moments);
    assert_eq!(count("/world", "foxglove.SceneUpdate"), 2);
    let traffic = folder.sim(&["trace", "drive.trace.jsonl"]).expect_clean();
    let frames = traffic.out.lines();
    let frames = frames.filter(|line| line.contains(" -> ") || line.contains(" <- "));
    assert_eq!(count("/r150/line_0", "rigsim.Line"), frames.count());
    let summary = mcap::Summary::read(&file).unwrap().unwrap();
    let attachments = summary.attachment_indexes.iter().map(|index| &*index.name);
    assert_eq!(
        attachments.collect::<Vec<_>>(),
        ["drive.toml", "report.json"]
    );
    // Midnight, and so many times 50 ms behind it.
    let day = 86_400 * 1_000_000_000;
    assert_eq!((last % day) / 50_000_000 + 1, moments as u64);
}

/// The bytes that an end of a line says in bits of this length, ns.
fn bytes_of_bits(vcd: &str, sign: &str, bit: u64) -> Vec<u8> {
    let (mut now, mut changes) = (0, Vec::new());
    for line in vcd.lines().skip_while(|line| !line.starts_with('#')) {
        if let Some(time) = line.strip_prefix('#') {
            let time = time.parse().unwrap();
            assert!(now <= time, "time goes back to {time}");
            now = time;
        } else if let Some(level) = line.strip_suffix(sign).filter(|level| level.len() == 1) {
            changes.push((now, level == "1"));
        }
    }
    let level = |at: u64| {
        let index = changes.partition_point(|(time, _)| *time <= at);
        index == 0 || changes[index - 1].1
    };
    let (mut bytes, mut at) = (Vec::new(), 0);
    while let Some((begin, _)) = changes.iter().find(|(time, level)| *time >= at && !level) {
        let middle = |index: u64| begin + index * bit + bit / 2;
        assert!(
            !level(middle(0)) && level(middle(9)),
            "start and stop bit at {begin} ns"
        );
        bytes.push(
            (0..8)
                .map(|index| u8::from(level(middle(index + 1))) << index)
                .sum(),
        );
        at = middle(9);
    }
    bytes
}

#[test]
fn bits_on_the_lines_are_the_bytes() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    run_exported(&folder, "vcd");
    let vcd = folder.read("drive.vcd");
    let recorded = |kind: &str| -> Vec<u8> {
        let trace = harness::json_lines(&folder.read("drive.trace.jsonl"));
        let records = trace.iter().filter(|record| record["kind"] == kind);
        let hex: String = records
            .map(|record| record["bytes"].as_str().unwrap().to_owned())
            .collect();
        let pairs = hex
            .as_bytes()
            .chunks(2)
            .map(|pair| str::from_utf8(pair).unwrap());
        pairs
            .map(|pair| u8::from_str_radix(pair, 16).unwrap())
            .collect()
    };
    let bit = 1_000_000_000 / 115_200;
    assert!(recorded("host").len() > 100);
    assert_eq!(bytes_of_bits(&vcd, "!", bit), recorded("host"));
    assert_eq!(bytes_of_bits(&vcd, "\"", bit), recorded("out"));
    assert!(vcd.contains(" speed_mps $end") && vcd.contains("\nr0."));
}

#[test]
fn waits_of_a_client_are_recorded_for_perfetto_alone() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let run = |output: &str, more: &[&str]| -> Vec<Value> {
        let words = [
            "run", "--time", "lockstep", "--seed", "1", "--output", output,
        ];
        let client = "exec 3<>\"$SIM_R150_PORT\"; sleep 1; sleep 0.5";
        let client = ["drive.toml", "--", "sh", "-c", client];
        folder.sim(&[&words, more, &client].concat()).expect_clean();
        let trace = format!("{output}/drive.trace.jsonl");
        folder.sim(&["replay", &trace]).expect_clean();
        harness::json_lines(&folder.read(&trace))
    };
    let all = run("plain", &[]);
    assert!(all.iter().all(|record| record["kind"] != "wait"));
    let export = ["trace", "plain/drive.trace.jsonl", "--to"];
    let exported = folder.sim(&[&export[..], &["plain.perfetto-trace"]].concat());
    assert_eq!(exported.code(), Some(0));
    assert!(
        exported.err.contains("nothing of the client's threads"),
        "{}",
        exported.err
    );
    // Times are those of the client's clock.
    folder
        .sim(&[&export[..], &["plain.mcap"]].concat())
        .expect_clean();
    let file = fs::read(folder.file("plain.mcap")).unwrap();
    let first = mcap::MessageStream::new(&file).unwrap().next().unwrap();
    let since = first.unwrap().log_time - 1_735_689_600 * 1_000_000_000;
    assert!(since < 1_000_000_000, "2025-01-01 and {since} ns");
    let all = run("exported", &["--export", "perfetto", "--export-all"]);
    let waits = all.iter().filter(|record| record["kind"] == "wait");
    let waits = waits.map(|wait| {
        let text = |key: &str| wait[key].as_str().unwrap().to_owned();
        (wait["thread"].as_u64().unwrap(), text("name"), text("wait"))
    });
    let waits: Vec<_> = waits.collect();
    let has = |name: &str, wait: &str| {
        let all = waits.iter();
        all.filter(|one| one.1 == name && one.2 == wait).count()
    };
    assert_eq!(
        (has("sh", "for a child"), has("sleep", "for time to pass")),
        (2, 2),
        "{waits:?}"
    );
    let threads: BTreeMap<u64, &str> = waits.iter().map(|one| (one.0, &*one.2)).collect();
    assert!(
        threads.len() == 3 && threads.values().all(|last| last.is_empty()),
        "{waits:?}"
    );
    assert!(folder.file("exported/drive.perfetto-trace").exists());
}

/// Plays a drive again up to a time, and calls a program that controls it.
fn goes_on(
    folder: &Folder,
    until: &str,
    then: impl FnOnce(&Sim, &dyn Fn(&[&str]) -> Finished),
) -> Finished {
    let sim = folder.start(&["replay", "drive.trace.jsonl", "--until", until]);
    sim.wait_ready();
    let control = sim.wait_line(&["control on "]);
    let url = control.trim().trim_start_matches("control on ").to_owned();
    then(&sim, &|words| {
        folder.sim(&[&["ctl", "--url", &url], words].concat())
    });
    sim.stop()
}

#[test]
fn a_replayed_run_goes_on_live() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    folder
        .sim(&["run", "--seed", "1", "--output", ".", "drive.toml"])
        .expect_clean();
    let there = |at: &str| {
        let csv = [
            "trace",
            "drive.trace.jsonl",
            "--csv",
            "truth.x_m",
            "--every",
            "10ms",
            "--from",
            at,
        ];
        folder
            .sim(&csv)
            .expect_clean()
            .out
            .lines()
            .nth(1)
            .unwrap()
            .to_owned()
    };
    // It drives then, and does what it did, but for what is changed now.
    let ended = goes_on(&folder, "800 ms", |_, ctl| {
        let now = |name: &str| {
            ctl(&["get", name])
                .expect_clean()
                .out
                .split_whitespace()
                .last()
                .unwrap()
                .to_owned()
        };
        assert_eq!(now("t"), "0.8");
        assert_eq!(
            now("truth.x_m").parse::<f64>().unwrap(),
            there("800ms").parse::<f64>().unwrap()
        );
        ctl(&["advance", "50ms"]).expect_clean();
        assert_eq!(
            now("truth.x_m").parse::<f64>().unwrap(),
            there("850ms").parse::<f64>().unwrap()
        );
        ctl(&["operator", "emergency_stop", "true"]).expect_clean();
        ctl(&["resume"]).expect_clean();
        ctl(&["until", "truth.at_rest"]).expect_clean();
        assert!(now("truth.x_m").parse::<f64>().unwrap() < there("1500ms").parse::<f64>().unwrap());
    });
    assert_eq!(ended.code(), Some(0), "{}", ended.err);
    let ended = goes_on(&folder, "0 s", |_, ctl| {
        let state = ctl(&["state"]).expect_clean().out;
        let state: Value = serde_json::from_str(&state).unwrap();
        assert_eq!((&state["t"], &state["paused"]), (&json!(0.0), &json!(true)));
    });
    assert_eq!(ended.code(), Some(0), "{}", ended.err);
    let late = folder.sim(&["replay", "drive.trace.jsonl", "--until", "1h"]);
    late.expect_refusal(2, &["--until", "ends at"]);
}

/// What the control socket of a simulator answers.
fn get(url: &str, path: &str) -> String {
    let (place, token) = url
        .trim_start_matches("http://")
        .split_once("/#token=")
        .unwrap();
    let mut stream = TcpStream::connect(place).unwrap();
    let head = format!("GET {path} HTTP/1.1\r\nHost: {place}\r\nAuthorization: Bearer {token}");
    write!(stream, "{head}\r\nConnection: close\r\n\r\n").unwrap();
    let mut answer = String::new();
    stream.read_to_string(&mut answer).unwrap();
    answer
}

#[test]
fn a_scenario_that_is_saved_of_a_recording_is_based_on_the_file_of_that() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let run = ["run", "--seed", "1", "--output", ".", "drive.toml"];
    folder.sim(&run).expect_clean();
    let trace = folder.read("drive.trace.jsonl");
    let elsewhere = Folder::with(&[("drive.trace.jsonl", &trace)]);
    let there = fs::canonicalize(folder.file("drive.toml")).unwrap();
    for (folder, base) in [
        (&folder, there.to_str().unwrap()),
        (&elsewhere, "drive.toml"),
    ] {
        let sim = folder.start(&["replay", "drive.trace.jsonl", "--until", "1 s"]);
        let control = sim.wait_line(&["control on "]);
        let url = control.trim().trim_start_matches("control on ");
        let schema = get(url, "/v1/schema");
        let wanted = format!("base = \\\"{base}\\\"");
        assert!(
            schema.contains(&wanted),
            "{wanted}: {}",
            &schema[..schema.len().min(300)]
        );
        sim.stop();
    }
}

#[test]
fn a_client_takes_over_a_replayed_run() {
    let folder = Folder::with(&[]);
    // The client of the trace has the port open then, and the next one finds it free.
    let sim = Sim::start(&[
        "--trace",
        folder.file("drive.trace.jsonl").to_str().unwrap(),
    ]);
    let mut client = sim.client();
    client.ask(0x07, &[]);
    client.ask(0x07, &[]);
    drop((client, sim.stop().expect_clean()));
    let trace = harness::json_lines(&folder.read("drive.trace.jsonl"));
    let sent = trace
        .iter()
        .filter(|record| record["kind"] == "in")
        .nth(1)
        .unwrap();
    let until = format!("{} ns", sent["t"].as_u64().unwrap());
    let ended = goes_on(&folder, &until, |sim, ctl| {
        // The reply to the last request is over then.
        ctl(&["advance", "50ms"]).expect_clean();
        ctl(&["resume"]).expect_clean();
        let line = sim.wait_line(&["r150", " on /"]);
        let port = line
            .split(" on ")
            .nth(1)
            .unwrap()
            .split_whitespace()
            .next()
            .unwrap();
        Client::open(port.as_ref()).ask(0x07, &[]);
    });
    assert_eq!(ended.code(), Some(0), "{}", ended.err);
    assert!(ended.out.contains("client_attached 2"), "{}", ended.out);
}

/// The server for agents, whose files are in a folder.
fn server(folder: &Folder) -> std::process::Child {
    let mut command = command();
    command
        .arg("mcp")
        .current_dir(folder.path())
        .env("TMPDIR", folder.path());
    let mut server = command
        .stdin(Stdio::piped())
        .stdout(Stdio::piped())
        .spawn()
        .unwrap();
    let client = json!({"name": "test", "version": "1"});
    let params = json!({"protocolVersion": "2025-06-18", "capabilities": {}, "clientInfo": client});
    let hello = json!({"jsonrpc": "2.0", "id": 0, "method": "initialize", "params": params});
    let begun = json!({"jsonrpc": "2.0", "method": "notifications/initialized"});
    let input = server.stdin.as_mut().unwrap();
    write!(input, "{hello}\n{begun}\n").unwrap();
    server
}

/// Programs that the server for agents has started, by their working folder.
fn programs(folder: &Folder) -> usize {
    let own = fs::canonicalize(folder.path()).unwrap();
    let all = fs::read_dir("/proc").unwrap();
    let is_there = |entry: &std::io::Result<fs::DirEntry>| {
        let path = entry.as_ref().unwrap().path();
        fs::read_link(path.join("cwd")).is_ok_and(|folder| folder == own)
    };
    all.filter(is_there).count()
}

/// A request that calls a tool.
fn call(id: u32, name: &str, arguments: Value) -> String {
    let params = json!({"name": name, "arguments": arguments});
    json!({"jsonrpc": "2.0", "id": id, "method": "tools/call", "params": params}).to_string()
}

/// Sends requests to the server for agents, and returns its answers by their ids, that to `initialize` first;
/// the input ends when so many have come.
fn answers(folder: &Folder, requests: &[String], count: usize) -> Vec<Value> {
    let mut server = server(folder);
    let mut input = server.stdin.take().unwrap();
    requests
        .iter()
        .for_each(|request| writeln!(input, "{request}").unwrap());
    let mut lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let mut read = |line: std::io::Result<String>| serde_json::from_str(&line.unwrap()).unwrap();
    let mut answers: Vec<Value> = lines.by_ref().take(count).map(&mut read).collect();
    drop(input);
    answers.extend(lines.map(read));
    assert_eq!(server.wait().unwrap().code(), Some(0));
    assert!(folder.leftovers().is_empty(), "{:?}", folder.leftovers());
    assert_eq!(programs(folder), 0);
    answers.sort_by_key(|answer| answer["id"].as_u64());
    answers
}

#[test]
fn what_agents_send_wrongly_is_answered() {
    let folder = Folder::with(&[]);
    let requests = [
        "no JSON".to_owned(),
        format!("\"{}\"", "x".repeat(3 << 20)),
        call(1, "check", json!({"files": [1]})),
        r#"{"jsonrpc": "2.0", "id": 2, "method": "resources/list"}"#.to_owned(),
        call(3, "fly", json!({})),
        call(4, "check", json!({"file": "a.toml"})),
        call(5, "check", json!({})),
        call(6, "run", json!({"files": "a.toml"})),
        call(7, "run", json!({"files": ["--help"]})),
        call(8, "stop", json!({})),
        call(9, "explain", json!({"trace": "none.jsonl"})),
        call(
            10,
            "list",
            json!({"what": "faults", "matching": "cable-pulled"}),
        ),
        call(11, "list", json!({"what": "everything"})),
        call(15, "control", json!({"words": ["state"]})),
        r#"{"jsonrpc": "2.0", "id": 16, "method": "tools/list"}"#.to_owned(),
        call(12, "list", json!({"what": "faults"})),
        call(13, "list", json!({"what": "names", "device": "r150"})),
        call(14, "list", json!({"what": "config", "device": "mecanum"})),
        call(
            17,
            "list",
            json!({"what": "config", "matching": "r150.over_rate"}),
        ),
        call(18, "list", json!({"what": "names", "matching": "no such"})),
    ];
    let answers = answers(&folder, &requests, 19);
    let errors: Vec<i64> = answers
        .iter()
        .filter_map(|answer| answer["error"]["code"].as_i64())
        .collect();
    assert_eq!(
        errors,
        [-32601, -32602],
        "what is not a request has no answer"
    );
    assert_eq!(answers[0]["result"]["protocolVersion"], "2025-06-18");
    let text = |id: usize| {
        let result = &answers[id]["result"];
        let is_wrong = id < 10 || [11, 15].contains(&id);
        assert_eq!(result["isError"], is_wrong, "{result}");
        result["content"][0]["text"].as_str().unwrap()
    };
    assert!(text(1).starts_with("`files` has to be a list of texts: Files or folders."));
    assert!(text(4).starts_with("no argument is called `file`; allowed: files\n"));
    assert!(text(5).starts_with("the argument `files` is missing: Files or folders.\n"));
    assert!(text(6).starts_with("`files` has to be a list of texts: "));
    assert!(text(11).starts_with("`what` has to be one of: devices, faults, names, config\n"));
    // A file is not a flag, and each answer says what to do next.
    assert!(
        text(7).contains("--help") && !text(7).contains("Usage"),
        "{}",
        text(7)
    );
    assert!(text(8).starts_with("no simulator was started\n\nNext: `start`"));
    assert!(text(9).contains("none.jsonl") && text(9).contains("Next: "));
    assert!(
        text(10).starts_with("### `cable-pulled`\n") && !text(10).contains("bit-flips"),
        "{}",
        text(10)
    );
    // A whole list is whole.
    let faults = harness::run(&["faults"]).expect_clean().out;
    let missing = |line: &&str| line.starts_with("### ") && !text(12).contains(&line[4..]);
    assert_eq!(faults.lines().find(missing), None);
    assert!(text(13).contains("truth.y_m\n") && !text(13).contains("left out"));
    assert!(text(14).contains("mecanum.ros_baud = \"") && !text(14).contains("left out"));
    assert!(text(12).contains("\n## Operator: `operator`\n`"));
    assert!(text(17).starts_with("# ") && text(17).contains("\nr150.over_rate = \"delay\"\n"));
    assert!(text(18).starts_with("There is nothing to show."));
    assert!(text(15).starts_with("no simulator was started\n\nNext: "));
    // The example of a scenario file is one.
    let mut tools = answers[16]["result"]["tools"].as_array().unwrap().iter();
    let check = tools.find(|tool| tool["name"] == "check").unwrap();
    let example = check["description"]
        .as_str()
        .unwrap()
        .split_once("A file:\n")
        .unwrap()
        .1;
    fs::write(folder.file("example.toml"), example).unwrap();
    folder.sim(&["check", "example.toml"]).expect_clean();
}

#[test]
fn a_simulator_that_an_agent_started_ends_with_the_server() {
    let folder = Folder::with(&[]);
    // The second takes the place of the first, and of a burst some are refused.
    let mut requests: Vec<String> = (1..=20)
        .map(|id| call(id, "start", json!({"device": "r150"})))
        .collect();
    requests.push(call(21, "stop", json!({})));
    let answers = answers(&folder, &requests, 22);
    let refused = answers
        .iter()
        .filter(|answer| answer["error"]["code"] == -32603);
    assert!(refused.count() >= 21 - 8, "{answers:?}");

    let mut server = server(&folder);
    let mut input = server.stdin.take().unwrap();
    let lines = BufReader::new(server.stdout.take().unwrap()).lines();
    let mut lines = lines.skip(1);
    let mut ask = |request: String| {
        writeln!(input, "{request}").unwrap();
        serde_json::from_str::<Value>(&lines.next().unwrap().unwrap()).unwrap()
    };
    for id in ["../../outside", "b"] {
        let start = call(0, "start", json!({"device": "r150"}));
        let answer = ask(start.replace("\"id\":0", &format!("\"id\":\"{id}\"")));
        assert_eq!(answer["result"]["isError"], false, "{answer}");
    }
    let state = ask(call(3, "control", json!({"words": ["get", "t"]})));
    assert_eq!(state["result"]["isError"], false, "{state}");
    assert_eq!(
        programs(&folder),
        3,
        "the server, a supervisor, and one simulator"
    );
    let signal = |server: &std::process::Child, signal| {
        let pid = i32::try_from(server.id()).unwrap();
        let pid = rustix::process::Pid::from_raw(pid).unwrap();
        rustix::process::kill_process(pid, signal).unwrap();
    };
    signal(&server, rustix::process::Signal::TERM);
    assert_eq!(server.wait().unwrap().code(), Some(0));
    assert_eq!(programs(&folder), 0);
    assert!(folder.leftovers().is_empty(), "{:?}", folder.leftovers());

    // Also with one that is killed.
    let mut server = self::server(&folder);
    let start = call(1, "start", json!({"device": "r150"}));
    writeln!(server.stdin.as_mut().unwrap(), "{start}").unwrap();
    let mut answers = BufReader::new(server.stdout.take().unwrap()).lines();
    assert!(answers.nth(1).unwrap().is_ok());
    assert_eq!(programs(&folder), 3);
    signal(&server, rustix::process::Signal::KILL);
    server.wait().unwrap();
    harness::until("its simulator has ended", || programs(&folder) == 0);
}
