//! Jobs and faults, files that are based on others, parameters and settings, as users run them.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

use std::fs;
use std::path::Path;
use std::process::Command;

use tempfile::TempDir;

/// A metre ahead, in its own file.
const JOB: &str = r#"
schema = 1
title = "A metre ahead"
good_client = "Drives a metre."
limit = "10 s"
nominal_duration = "4 s"

[parameters]
pwm = 400

[[device]]
kind = "r150"

[[step]]
name = "drive"
at = "200 ms"
every = "100 ms"
for = "3 s"
host = { send = { set_motors = { right = "${pwm}", left = "${pwm}" } } }

[[step]]
name = "stop"
after = "drive"
host = { send = { set_motors = { right = 0, left = 0 } } }

[[step]]
name = "arrive"
at = "9 s"
expect = { that = "truth.x_m > 1 && truth.at_rest", message = "it did not get there" }
mission = true

[[always]]
name = "slow"
that = "truth.speed_mps < 0.8"

[[response]]
name = "stops"
step = "stop"
then = "truth.at_rest"
within = "2 s"
"#;

/// A fault that ends the mission, at a tenth of what the job takes.
const LOCK: &str = r#"
schema = 1
title = "The operator locks the vehicle"
good_client = "Stops."
mission_may_fail = true

[[step]]
name = "lock"
at = "25 %"
operator = "lock"

[[step]]
after = "lock"
delay = "2 s"
expect = { that = "truth.at_rest && t >= 3" }
"#;

fn folder(files: &[(&str, &str)]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for (name, text) in files {
        let path = folder.path().join(name);
        fs::create_dir_all(path.parent().unwrap()).unwrap();
        fs::write(path, text).unwrap();
    }
    folder
}

fn sim(folder: &Path, args: &[&str]) -> (Option<i32>, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_sim"))
        .args(args)
        .current_dir(folder)
        .output()
        .unwrap();
    let printed = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(printed).unwrap())
}

/// `sim` with these arguments ends with this code and prints all of this.
#[track_caller]
fn prints(folder: &TempDir, args: &[&str], code: i32, wanted: &[&str]) -> String {
    let (ended, printed) = sim(folder.path(), args);
    assert_eq!(ended, Some(code), "{args:?}\n{printed}");
    for wanted in wanted {
        assert!(printed.contains(wanted), "{args:?}\n{printed}\n{wanted}");
    }
    printed
}

#[test]
fn a_fault_file_is_played_within_any_job() {
    let other = JOB
        .replace("pwm = 400", "pwm = 200")
        .replace("limit = \"10 s\"", "limit = \"12 s\"");
    let based = LOCK.replace("mission", "base = \"../job.toml\"\nmission");
    let folder = folder(&[
        ("job.toml", JOB),
        ("other.toml", &other),
        ("faults/lock.toml", LOCK),
        ("based/lock.toml", &based),
    ]);
    let passed = "The operator locks the vehicle (10.0 s simulated)";
    prints(
        &folder,
        &["run", "--job", "job.toml", "faults"],
        0,
        &[passed],
    );
    prints(&folder, &["run", "based"], 0, &[passed]);
    // Another job takes the place of the one that it is based on.
    let within = [
        "run",
        "--seed",
        "1",
        "--job",
        "other.toml",
        "--output",
        "out",
        "based",
    ];
    prints(&folder, &within, 0, &["(12.0 s simulated)"]);
    prints(
        &folder,
        &["replay", "out/based-lock.trace.jsonl"],
        0,
        &["to the last byte"],
    );
    // Where the mission may not fail, it is judged.
    let strict = LOCK.replace("mission_may_fail = true", "");
    fs::write(folder.path().join("faults/lock.toml"), strict).unwrap();
    let again = "again: sim run --seed 3 --job job.toml faults/lock.toml";
    let failing = ["run", "--seed", "3", "--job", "job.toml", "faults"];
    prints(
        &folder,
        &failing,
        1,
        &["\"arrive\": it did not get there", again],
    );
    // What is wrong with the choice of files.
    prints(
        &folder,
        &["run", "--job", "job.toml", "other.toml"],
        2,
        &["other.toml has its own devices, so it is not a fault file for --job"],
    );
    // Among fault files, they are named once and left out.
    let among = prints(
        &folder,
        &[
            "check",
            "--job",
            "job.toml",
            "job.toml",
            "other.toml",
            "faults",
        ],
        0,
        &[
            "job.toml and 1 more have their own devices, so they are not fault files for --job: left out",
            "well-formed",
        ],
    );
    assert_eq!(among.lines().count(), 2, "{among}");
    let wrong = prints(
        &folder,
        &["check", "faults", "nowhere.toml"],
        2,
        &["1 to 1000 [[device]]", "--job", "nowhere.toml"],
    );
    let is_error = |line: &str| line.starts_with("error: ");
    assert!(wrong.lines().count() > 1, "{wrong}");
    assert!(wrong.lines().all(is_error), "{wrong}");
    fs::write(
        folder.path().join("job.toml"),
        "schema = 1\nbase = \"job.toml\"\n",
    )
    .unwrap();
    prints(&folder, &["check", "job.toml"], 2, &["in a circle"]);
}

#[test]
fn a_file_changes_what_it_is_based_on_by_name() {
    let folder = folder(&[
        ("job.toml", JOB),
        (
            "longer.toml",
            "schema = 1\ntitle = \"Further\"\nbase = \"job.toml\"\n\
             [[device]]\nname = \"r150\"\nsettings = { battery.initial_soc = \"55 %\" }\n\
             [[step]]\nname = \"drive\"\nafter = \"wait\"\nfor = \"4 s\"\n\
             [[step]]\nname = \"wait\"\nat = \"1 s\"\n\
             [[step]]\nat = \"9.5 s\"\nexpect = { that = \"truth.x_m > 1.7 && truth.soc_percent < 55.1\" }\n\
             [[always]]\nname = \"slow\"\nthat = \"truth.speed_mps < 0.3\"\nuntil = \"1 s\"\n\
             [[response]]\nname = \"stops\"\nwithin = \"3 s\"\n",
        ),
        (
            "wrong.toml",
            "schema = 1\nbase = \"job.toml\"\n[[step]]\nname = \"drive\"\nevery = \"0 s\"\n[[never]]\nthat = \"x > 1\"\n",
        ),
        ("deep.toml", "schema = 1\nbase = \"wrong.toml\"\n"),
    ]);
    prints(
        &folder,
        &["run", "longer.toml"],
        0,
        &["longer.toml: Further (10.0 s simulated)"],
    );
    // Each error is reported where it stands.
    prints(
        &folder,
        &["check", "deep.toml"],
        2,
        &[
            "wrong.toml:5:9: `step.every`",
            "wrong.toml:7:8: `never.that`",
        ],
    );
}

#[test]
fn parameters_multiply_to_cases() {
    let fast = "schema = 1\nbase = \"job.toml\"\n[parameters]\nlate = \"1 s\"\n\
                [[never]]\nthat = \"param.pwm > 500 && t > 1\"\nafter = \"wait\"\n\
                [[step]]\nname = \"wait\"\nat = \"${late}\"\n";
    let folder = folder(&[("job.toml", JOB), ("fast.toml", fast)]);
    let printed = prints(
        &folder,
        &[
            "run",
            "--seed",
            "1",
            "--output",
            "out",
            "--param",
            "pwm=400,600",
            "--param",
            "late=1s,2s",
            "fast.toml",
        ],
        1,
        &[
            "passed  fast.toml pwm=400 late=1s",
            "passed  fast.toml pwm=400 late=2s",
            "FAILED  fast.toml pwm=600 late=1s",
            "FAILED  fast.toml pwm=600 late=2s",
            "again: sim run --seed 1 --param 'pwm=600' --param 'late=1s' fast.toml",
            "2 passed, 2 failed",
        ],
    );
    assert!(
        printed.contains("1.000868 s: never `param.pwm > 500"),
        "{printed}"
    );
    let report = folder.path().join("out/fast-pwm-600-late-1s.report.json");
    let report: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(report).unwrap()).unwrap();
    assert_eq!(report["parameters"]["pwm"], "600");
    prints(
        &folder,
        &["replay", "out/fast-pwm-600-late-2s.trace.jsonl"],
        0,
        &["to the last byte"],
    );
    prints(
        &folder,
        &["run", "--param", "pmw=4", "job.toml"],
        2,
        &["--param pmw: no file has a parameter"],
    );
    prints(
        &folder,
        &["run", "--param", "pwm=4", "--param", "pwm=5,6", "job.toml"],
        2,
        &["--param pwm is given twice; for a case of each value: --param pwm=4,5,6"],
    );
    let misspelt = JOB.replace("left = \"${pwm}\"", "left = \"${pmw}\"");
    fs::write(folder.path().join("job.toml"), misspelt).unwrap();
    prints(
        &folder,
        &["check", "job.toml"],
        2,
        &["no parameter is named `pmw`; allowed: pwm"],
    );
}

#[test]
fn settings_and_a_world_go_under_whatever_is_played() {
    let wall = "schema = 1\n[[box]]\nat_m = [0.9, 0.0]\nlength = \"0.2 m\"\nwidth = \"2 m\"\n";
    let folder = folder(&[
        ("job.toml", JOB),
        ("wall.toml", wall),
        ("mine.toml", "[r150]\nbattery.initial_soc = \"60 %\"\n"),
        (
            "soc.toml",
            "schema = 1\nbase = \"job.toml\"\n[[step]]\nat = \"100 ms\"\nexpect = { that = \"abs(truth.soc_percent - 60) < 0.1\" }\n",
        ),
    ]);
    prints(
        &folder,
        &["run", "--config", "mine.toml", "soc.toml"],
        0,
        &["1 passed"],
    );
    let set = [
        "run",
        "--seed",
        "1",
        "--set",
        "r150.battery.initial_soc=70%",
        "--output",
        "out",
        "soc.toml",
    ];
    let again = "again: sim run --seed 1 --set 'r150.battery.initial_soc=70%' soc.toml";
    prints(&folder, &set, 1, &["truth.soc_percent = 69.99", again]);
    prints(
        &folder,
        &["replay", "out/soc.trace.jsonl"],
        0,
        &["to the last byte"],
    );
    prints(
        &folder,
        &["run", "--world", "wall.toml", "job.toml"],
        1,
        &["it did not get there"],
    );
    prints(
        &folder,
        &["run", "--set", "r150.nonsense=1", "job.toml"],
        2,
        &["r150.nonsense"],
    );
}

#[test]
fn a_scripted_vehicle_drives_beside_a_live_one() {
    let two = JOB
        .replace("limit = \"10 s\"", "limit = \"6 s\"")
        .replace("at = \"9 s\"", "at = \"5 s\"")
        .replace("[[device]]\nkind = \"r150\"\n", "[[device]]\nkind = \"r150\"\nname = \"mine\"\n[[device]]\nkind = \"r150\"\nname = \"other\"\npose = { y = \"3 m\" }\nclient = \"script\"\n")
        .replace("host = {", "device = \"other\"\nhost = {")
        .replace("truth.", "other.truth.");
    let stands = "[[never]]\nthat = \"truth.speed_mps > 0.01\"\n";
    let folder = folder(&[("two.toml", &format!("{two}{stands}"))]);
    // The client opens its port and does nothing; the names without a device are of its vehicle.
    let client = "test -z \"$SIM_OTHER_PORT\" && exec 3<>\"$SIM_MINE_PORT\" && sleep 30";
    let real = ["--time", "real", "--max-stall", "1h"];
    for (time, word) in [
        (["--time", "lockstep"].as_slice(), "lockstep"),
        (&real, "real"),
    ] {
        let args = ["run", "--output", "out"].as_slice();
        let args = [args, time, &["two.toml", "--", "sh", "-c", client]].concat();
        prints(&folder, &args, 0, &[&format!("{word} time)"), "1 passed"]);
        let replay = ["replay", "out/two.trace.jsonl"];
        prints(&folder, &replay, 0, &["to the last byte"]);
    }
    prints(&folder, &["run", "two.toml"], 0, &["1 passed"]);
    let both = two.replace("client = \"script\"\n", "");
    fs::write(folder.path().join("two.toml"), &both).unwrap();
    let client = "exec 3<>\"$SIM_MINE_PORT\" 4<>\"$SIM_OTHER_PORT\" && sleep 30";
    let args = ["run", "two.toml", "--", "sh", "-c", client];
    prints(&folder, &args, 1, &["it did not get there"]);
    // What would never happen is an error.
    let never = both.replacen(
        "device = \"other\"\n",
        "device = \"other\"\nonly = \"live\"\n",
        1,
    );
    fs::write(folder.path().join("two.toml"), never).unwrap();
    prints(&folder, &["check", "two.toml"], 2, &["this never happens"]);
}

#[test]
fn a_client_that_opens_no_port_learns_where_they_are() {
    let folder = folder(&[("job.toml", JOB)]);
    prints(
        &folder,
        &["run", "job.toml", "--", "true"],
        3,
        &["without having opened a port", "SIM_R150_PORT"],
    );
}

#[test]
fn all_that_is_wrong_in_a_file_is_reported_at_once() {
    let wrong = r#"schema = 1
good_client = 3
limit = "2 parsecs"

[settings]
r150.nonsense = 1

[[device]]
kind = "r150"
settings = { batery.initial_soc = "5 %" }

[[step]]
at = "1 s"
evry = "2 s"
when = 5
operator = "lock"

[[step]]
at = "2 s"
operator = "lokc"

[[step]]
at = "3 s"
world = { add = { circle = { at_m = [1, 0], radius = "1 m" } } }

[[always]]
that = "truth.sped_mps < 1"

[[never]]
that = "truth.speed_mps > "

[[response]]
whenever = "truth.at_rest"
"#;
    let folder = folder(&[
        ("all/wrong.toml", wrong),
        ("all/good.toml", JOB),
        (
            "all/yard.toml",
            "schema = 1\n[[circle]]\nat_m = [1, 0]\nradius = \"1 m\"\n",
        ),
    ]);
    let printed = prints(
        &folder,
        &["check", "all"],
        2,
        &[
            "wrong.toml:1:1: missing key `title`",
            "wrong.toml:2:15: `good_client`",
            "wrong.toml:3:9: `limit`",
            "r150.nonsense",
            "batery",
            "`step.evry`: unknown key `evry`",
            "wrong.toml:15:8: `step.when`",
            "did you mean `lock`?",
            "a table is not a list, `[…]`",
            "did you mean `truth.speed_mps`?",
            "the expression is not finished",
            "missing key `then`",
            "yard.toml looks like a world file",
        ],
    );
    assert!(!printed.contains("good.toml"), "{printed}");
    fs::remove_file(folder.path().join("all/wrong.toml")).unwrap();
    prints(
        &folder,
        &["run", "all"],
        0,
        &["yard.toml looks like a world file", "1 passed"],
    );
}

#[test]
fn a_client_without_dashes_is_not_read_as_scenarios() {
    let client = "import os\nimport sys\n";
    let folder = folder(&[("job.toml", JOB), ("client.py", client), ("empty/x", "")]);
    let printed = prints(
        &folder,
        &["run", "job.toml", "python3", "client.py"],
        2,
        &["`sim run FILE -- python3 client.py`"],
    );
    assert_eq!(printed.lines().count(), 3, "{printed}");
    let nothing = &["no scenario file is in empty"];
    prints(&folder, &["check", "empty"], 2, nothing);
}

#[test]
fn errors_are_in_the_words_of_the_file() {
    let head = "schema = 1\ntitle = \"t\"\ngood_client = \"g\"\nlimit = \"5 s\"\n";
    let device = "device = [{ kind = \"r150\" }]\n";
    let step = |what: &str| format!("{head}{device}step = [{{ at = \"1 s\", {what} }}]\n");
    for (text, wanted) in [
        (
            step("host = { send = \"set_motors\" }"),
            "s.toml:6:39: `step.host.send`: a value belongs to it: `{ set_motors = … }` instead of \"set_motors\"",
        ),
        (
            step("expect = \"truth.at_rest\""),
            "\"truth.at_rest\" is not a table, `{ … }`",
        ),
        (
            step("host = { send = { set_motors = { right = \"50 %\", left = 3 } } }"),
            "\"50 %\" is not a whole number from -32768 to 32767",
        ),
        (
            format!("{head}{device}base = \"nowhere.toml\"\n"),
            "s.toml: cannot read the base nowhere.toml",
        ),
        (
            format!("{head}{device}world = \"nowhere.toml\"\n"),
            "s.toml: cannot read the world file nowhere.toml",
        ),
        (
            format!("{head}{device}limit = \"6 s\"\n"),
            "s.toml:6:1: duplicate key `limit`",
        ),
    ] {
        let folder = folder(&[("s.toml", &*text)]);
        let printed = prints(&folder, &["check", "s.toml"], 2, &[wanted]);
        assert_eq!(printed.lines().count(), 1, "{printed}");
    }
}

#[test]
fn a_client_that_falls_silent_does_not_start_again() {
    // It drives, and never sends a stop: the watchdog stops the vehicle.
    let client = "stty -F \"$SIM_R150_PORT\" raw -echo 115200; exec 3<>\"$SIM_R150_PORT\"; \
        for i in 1 2 3 4 5 6 7 8 9 10 11 12 13 14 15 16 17 18 19 20 21 22 23 24; do \
        printf '\\252\\125\\004\\022\\364\\001\\364\\001\\105\\070' >&3; sleep 0.1; done; exec sleep 60";
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let fault = root.join("scenarios/r150/faults/emergency-stop.toml");
    let folder = folder(&[]);
    let args = ["run", fault.to_str().unwrap(), "--", "sh", "-c", client];
    prints(&folder, &args, 0, &["1 passed, 0 failed"]);
}
