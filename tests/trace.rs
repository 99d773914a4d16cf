//! What recordings tell: decoded traffic, values of names, and where two of them part.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use harness::live::{DRIVE, Folder};

/// A second vehicle, which no client drives, and noise on the line of the first.
const TWO: &str = r#"
[[device]]
kind = "r150"
name = "idle"
pose = { y = "5 m" }

[[step]]
name = "noise"
at = "500 ms"
for = "300 ms"
device = "first"
fault = { kind = "idle-noise", every = "20 ms" }
"#;

/// Two vehicles, of which the first drives.
fn two() -> String {
    let first = DRIVE.replace("kind = \"r150\"", "kind = \"r150\"\nname = \"first\"");
    let first = first.replace("at = \"100 ms\"", "at = \"100 ms\"\ndevice = \"first\"");
    first.replace("truth.speed", "first.truth.speed") + TWO
}

/// Plays `drive.toml` in this folder; the trace is `drive.trace.jsonl`.
fn record(folder: &Folder, output: &str, args: &[&str]) {
    let all = [&["run", "--output", output], args, &["drive.toml"]].concat();
    folder.sim(&all).expect_clean();
}

/// The times of lines of the log.
fn times(text: &str) -> Vec<f64> {
    let first = text.lines().map(|line| line.split_whitespace().next());
    first.filter_map(|word| word?.parse().ok()).collect()
}

#[test]
fn a_recording_reads_like_the_log() {
    let folder = Folder::with(&[("drive.toml", &two())]);
    record(&folder, ".", &["--seed", "1"]);
    let said = folder
        .sim(&["trace", "drive.trace.jsonl"])
        .expect_clean()
        .out;
    for part in [
        "A client drives\n  drive.toml, seed 1, the scripted client\n",
        "first -> 0x12 set_motors right 500 left 500  | AA 55 04 12 F4 01 F4 01 ",
        "first <- 0x12 set_motors right_rpm ",
        "first  . client attached [client_attached]",
        "== step \"noise\" begun",
        "[fault_armed]",
        "4.000000 == the end: passed",
    ] {
        assert!(said.contains(part), "no {part} in {said}");
    }
    assert!(times(&said).is_sorted(), "{said}");

    let part = [
        "trace",
        "drive.trace.jsonl",
        "--from",
        "0.6s",
        "--until",
        "0.9s",
    ];
    let said = folder.sim(&part).expect_clean().out;
    let times = times(&said);
    assert!(
        !times.is_empty() && times.iter().all(|t| (0.6..=0.9).contains(t)),
        "{said}"
    );
    let idle = [
        "trace",
        "drive.trace.jsonl",
        "--device",
        "idle",
        "--log-format",
        "json",
    ];
    let idle = folder.sim(&idle).expect_clean().json();
    assert!(
        idle.iter().all(|line| line["device"] != "first"),
        "{idle:?}"
    );
    assert!(idle.iter().any(|line| line["code"] == "end"), "{idle:?}");
    let refused = folder.sim(&["trace", "drive.trace.jsonl", "--device", "car"]);
    refused.expect_refusal(2, &["`car`", "first, idle"]);
}

#[test]
fn any_name_is_computed_again_though_the_recording_does_not_hold_it() {
    let folder = Folder::with(&[("drive.toml", &two())]);
    record(&folder, ".", &["--seed", "1"]);
    let names =
        "t,first.truth.x_m,first.reported.right_rpm,idle.truth.at_rest,idle.reported.info_age_s";
    let args = [
        "trace",
        "drive.trace.jsonl",
        "--every",
        "10ms",
        "--csv",
        names,
    ];
    let csv = folder.sim(&args).expect_clean().out;
    let mut lines = csv.lines();
    assert_eq!(lines.next(), Some(names));
    let rows: Vec<Vec<&str>> = lines.map(|line| line.split(',').collect()).collect();
    assert_eq!(rows.len(), 401, "every 10 ms of 4 s, and the end");
    let number = |row: usize, column: usize| rows[row][column].parse::<f64>().unwrap();
    for (row, cells) in rows.iter().enumerate() {
        assert!((number(row, 0) - row as f64 * 0.01).abs() < 1e-9);
        assert!(["true", "false"].contains(&cells[3]));
        assert_eq!(cells[4], "inf");
    }
    assert_eq!(number(0, 1), 0.0);
    assert!((1..rows.len()).all(|row| number(row, 1) >= number(row - 1, 1) - 1e-3));
    // Poses are in the recording, every 100 ms: there both are the same.
    let trace = folder.read("drive.trace.jsonl");
    let poses: Vec<serde_json::Value> = harness::json_lines(&trace)
        .into_iter()
        .filter(|line| line["kind"] == "pose" && line["device"] == 0)
        .collect();
    assert!(poses.len() > 10, "{}", poses.len());
    for pose in &poses {
        let row = pose["t"].as_u64().unwrap() / 10_000_000;
        let x = number(usize::try_from(row).unwrap(), 1);
        assert!(
            (x - pose["x"].as_f64().unwrap()).abs() < 1e-12,
            "{pose} {x}"
        );
    }
    assert!(
        rows.iter().any(|row| row[2] != "0"),
        "what was reported is known, too"
    );

    // What steps remember has no value before, and parameters have theirs.
    let remembering = two().replacen("[[device]]", "[parameters]\npwm = 300\n[[device]]", 1).replacen(
        "[[step]]",
        "[[step]]\nname = \"here\"\nat = \"1 s\"\nremember = { x0 = \"first.truth.x_m\" }\n[[step]]",
        1,
    );
    std::fs::write(folder.path().join("saved.toml"), remembering).unwrap();
    let output = ["run", "--seed", "1", "--output", ".", "saved.toml"];
    folder.sim(&output).expect_clean();
    let names = "saved.x0,param.pwm,first.truth.x_m";
    let args = [
        "trace",
        "saved.trace.jsonl",
        "--every",
        "900ms",
        "--csv",
        names,
    ];
    let csv = folder.sim(&args).expect_clean().out;
    let rows: Vec<Vec<&str>> = csv
        .lines()
        .skip(1)
        .map(|row| row.split(',').collect())
        .collect();
    assert_eq!((rows[1][0], rows[1][1]), ("", "300"), "{csv}");
    let [saved, x]: [f64; 2] = [0, 2].map(|column| rows[2][column].parse().unwrap());
    assert!(0.0 < saved && saved < x, "{csv}");

    let wrong = folder.sim(&["trace", "drive.trace.jsonl", "--csv", "first.truth.speed"]);
    wrong.expect_refusal(2, &["did you mean `first.truth.speed_mps`?"]);
}

#[test]
fn two_recordings_part_where_they_first_differ() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    record(&folder, "a", &["--seed", "1"]);
    record(&folder, "b", &["--seed", "1"]);
    let same = ["trace", "a/drive.trace.jsonl", "b/drive.trace.jsonl"];
    let said = folder.sim(&same).expect_clean().out;
    assert_eq!(said, "the same happens from the beginning to the end\n");

    // The same client with one more step at a second and a half.
    let more = "\n[[step]]\nat = \"1.5 s\"\nhost = { send = { heartbeat = {} } }\n";
    std::fs::write(folder.file("drive.toml"), DRIVE.to_owned() + more).unwrap();
    record(&folder, "c", &["--seed", "1"]);
    let other = ["trace", "a/drive.trace.jsonl", "c/drive.trace.jsonl"];
    let said = folder.sim(&other);
    assert_eq!(said.code(), Some(1), "{}", said.err);
    let said = said.out;
    let (before, rest) = said.split_once("then in a/drive.trace.jsonl:\n").unwrap();
    assert!(
        before.contains("the text of the scenario differs"),
        "{said}"
    );
    assert_eq!(
        before
            .lines()
            .filter(|line| line.contains("set_motors"))
            .count(),
        8,
        "{said}"
    );
    let (a, c) = rest.split_once("then in c/drive.trace.jsonl:\n").unwrap();
    assert!(!a.contains("heartbeat"), "{said}");
    assert!(
        c.trim_start().starts_with("1.50") && c.contains("-> 0x07 heartbeat"),
        "{said}"
    );

    // The same again a little later: that is let pass, and nothing else.
    let later = DRIVE.replace("at = \"100 ms\"", "at = \"107 ms\"");
    std::fs::write(folder.file("drive.toml"), later).unwrap();
    record(&folder, "d", &["--seed", "1"]);
    let shifted = ["trace", "a/drive.trace.jsonl", "d/drive.trace.jsonl"];
    assert_eq!(folder.sim(&shifted).code(), Some(1));
    let long = [&shifted[..], &["--within", "10ms", "--until", "150ms"]].concat();
    folder.sim(&long).expect_clean();
}

#[test]
fn what_a_real_client_did_can_be_read_too() {
    let folder = Folder::with(&[("drive.toml", DRIVE)]);
    let heartbeat =
        r#"exec 3> "$SIM_R150_PORT"; printf '\252\125\000\007\307\204' >&3; sleep 0.5; exit 3"#;
    let run = ["run", "--output", ".", "drive.toml"];
    assert_eq!(folder.with_script(&run, heartbeat).code(), Some(1));
    let said = folder
        .sim(&["trace", "drive.trace.jsonl"])
        .expect_clean()
        .out;
    for part in [
        "a real client",
        "-> 0x07 heartbeat",
        "== FAILED: ",
        "== the end: ",
    ] {
        assert!(said.contains(part), "no {part} in {said}");
    }
    let cut: Vec<String> = folder
        .read("drive.trace.jsonl")
        .lines()
        .map(str::to_owned)
        .collect();
    std::fs::write(folder.file("cut.jsonl"), cut[..cut.len() - 4].join("\n")).unwrap();
    let said = folder.sim(&["trace", "cut.jsonl"]);
    said.expect_refusal(2, &["no end"]);
    assert!(
        said.out.contains("client attached"),
        "what there is, is printed: {}",
        said.out
    );
}
