//! Rules of scenario files that say more than that something always holds, as users run them.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

use std::fs;
use std::process::Command;

/// An R150 at half speed from 100 ms to 3 s, in a file of 6 s.
const DRIVE: &str = r#"
schema = 1
title = "t"
good_client = "g"
limit = "6 s"

[[device]]
kind = "r150"

[[step]]
name = "drive"
at = "100 ms"
every = "50 ms"
for = "2.9 s"
host = { send = { set_motors = { right = 500, left = 500 } } }

[[step]]
name = "stop"
after = "drive"
host = { send = { set_motors = { right = 0, left = 0 } } }
"#;

/// Plays a scenario with the scripted client: the exit code and all that is printed.
fn play_text(text: &str, flags: &[&str]) -> (Option<i32>, String) {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.toml"), text).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_sim"))
        .args(["run", "--seed", "1"])
        .args(flags)
        .arg("s.toml")
        .current_dir(folder.path())
        .output()
        .unwrap();
    let printed = [output.stdout, output.stderr].concat();
    (output.status.code(), String::from_utf8(printed).unwrap())
}

/// The drive with more in the file.
fn play(more: &str) -> (Option<i32>, String) {
    play_text(&format!("{DRIVE}{more}"), &[])
}

#[track_caller]
fn passes(more: &str) -> String {
    let (code, printed) = play(more);
    assert_eq!(code, Some(0), "{more}\n{printed}");
    printed
}

/// Fails with each of these reasons.
#[track_caller]
fn fails(more: &str, reasons: &[&str]) -> String {
    let (code, printed) = play(more);
    assert_eq!(code, Some(1), "{more}\n{printed}");
    for reason in reasons {
        assert!(printed.contains(reason), "{more}\n{printed}\n{reason}");
    }
    printed
}

/// Patches of ice that come by themselves, on which no client brakes.
const ICE: &str = r#"
[[step]]
name = "ice"
at = "1 s"
every = "700 ms"
count = 2
for = "200 ms"
fault = { kind = "ice", friction = 0.01 }
optional = true
"#;

#[test]
fn a_response_has_to_come_each_time_that_its_cause_does() {
    let response = |keys: &str| format!("{ICE}\n[[response]]\nstep = \"ice\"\n{keys}\n");
    let stops =
        "then = \"truth.at_rest\"\nwithin = \"500 ms\"\nmessage = \"it drives on over ice\"";
    let printed = fails(
        &response(stops),
        &[
            "1.500000 s: it drives on over ice: expected `truth.at_rest` within 500ms after \"ice\" \
             happened at 1.000000 s, but",
            "2.200000 s: it drives on over ice",
        ],
    );
    assert_eq!(
        printed.matches("it drives on over ice").count(),
        2,
        "{printed}"
    );
    // At the end it does stop.
    passes(&response("then = \"truth.at_rest\"\nwithin = \"3 s\""));
    passes(&response(
        "then = \"truth.speed_mps > 0.1\"\nwithin = \"100 ms\"\nuntil = \"1 s\"",
    ));
    fails(
        &response("then = \"truth.speed_mps > 0.1\"\nuntil = \"2.5 s\""),
        &["`truth.speed_mps > 0.1` had to last for 2500ms after \"ice\" happened at 1"],
    );
    let whenever = "[[response]]\nwhenever = \"client.motor_right == 0 && t > 1\"\n\
                    then = \"truth.at_rest\"\n";
    passes(&format!("{whenever}within = \"1 s\"\n"));
    fails(
        &format!("{whenever}within = \"10 ms\"\n"),
        &["within 10ms after `client.motor_right == 0 && t > 1` began at 3"],
    );
    // What ends before its time is up is not judged.
    passes("[[response]]\nwhenever = \"t > 5.9\"\nthen = \"false\"\nwithin = \"1 s\"\n");
}

#[test]
fn what_a_step_remembers_can_be_compared_with_later() {
    let remember = "[[step]]\nname = \"mark\"\nat = \"2 s\"\nremember = { x0 = \"truth.x_m\", \
                    fast = \"truth.speed_mps > 0.1\" }\n";
    passes(&format!(
        "{remember}[[step]]\nwhen = \"truth.x_m > saved.x0 + 0.3\"\n\
         expect = {{ that = \"t > 2 && saved.fast && truth.x_m < saved.x0 + 0.4\" }}\n"
    ));
    fails(
        &format!("{remember}[[always]]\nthat = \"truth.x_m - saved.x0 < 0.3\"\n"),
        &["always `truth.x_m - saved.x0 < 0.3`, but saved.x0 = "],
    );
    // Nothing is judged by it before, though it would not hold with 0.
    passes(&format!(
        "{remember}[[always]]\nthat = \"saved.x0 > 0.5\"\n"
    ));
}

#[test]
fn a_rule_may_be_broken_for_a_while() {
    passes("[[never]]\nthat = \"truth.speed_mps > 0.1\"\nlonger_than = \"4 s\"\n");
    fails(
        "[[never]]\nthat = \"truth.speed_mps > 0.1\"\nlonger_than = \"1 s\"\n",
        &["never `truth.speed_mps > 0.1` for longer than 1s, but truth.speed_mps"],
    );
    // What comes and goes begins again each time.
    let blinks = "abs(t - 1) < 0.2 || abs(t - 2) < 0.2";
    passes(&format!(
        "[[never]]\nthat = \"{blinks}\"\nlonger_than = \"500 ms\"\n"
    ));
    fails(
        &format!("[[never]]\nthat = \"{blinks}\"\nlonger_than = \"300 ms\"\n"),
        &["1.1"],
    );
}

/// When a fault has come and gone in a run with this seed, by the trace.
fn steps_of(more: &str, seed: &str) -> Vec<String> {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("s.toml"), format!("{DRIVE}{more}")).unwrap();
    let output = Command::new(env!("CARGO_BIN_EXE_sim"))
        .args(["run", "--output", "out", "--seed", seed, "s.toml"])
        .current_dir(folder.path())
        .output()
        .unwrap();
    assert_eq!(output.status.code(), Some(0), "{output:?}");
    let trace = fs::read_to_string(folder.path().join("out/s.trace.jsonl")).unwrap();
    let replayed = Command::new(env!("CARGO_BIN_EXE_sim"))
        .args(["replay", "out/s.trace.jsonl"])
        .current_dir(folder.path())
        .status()
        .unwrap();
    assert!(replayed.success());
    let faults = trace
        .lines()
        .filter(|line| line.contains("\"fault_armed\"") || line.contains("\"fault_cleared\""));
    let time = |line: &str| {
        let line: serde_json::Value = serde_json::from_str(line).unwrap();
        format!("{:.1}", line["t"].as_f64().unwrap() / 1e9)
    };
    faults.map(time).collect()
}

#[test]
fn times_are_drawn_from_the_stream_of_the_step() {
    let pulled = "[[step]]\nname = \"loose\"\nat = { min = \"500 ms\", max = \"1500 ms\" }\n\
                  every = { min = \"600 ms\", max = \"1200 ms\" }\ncount = 3\n\
                  for = { min = \"50 ms\", max = \"400 ms\" }\nfault = { kind = \"missing-reply\" }\n\
                  optional = true\n";
    let first = steps_of(pulled, "1");
    assert_eq!(first.len(), 6, "{first:?}");
    assert_eq!(first, steps_of(pulled, "1"));
    assert_ne!(first, steps_of(pulled, "2"));
    let other =
        "[[step]]\nname = \"other\"\nat = { min = \"1 s\", max = \"2 s\" }\noperator = \"lock\"\n";
    assert_eq!(first, steps_of(&format!("{other}{pulled}"), "1"));
}

#[test]
fn a_repetition_in_the_last_one_s_time_waits() {
    let fault = "[[step]]\nname = \"f\"\nat = \"1 s\"\nevery = \"500 ms\"\ncount = 2\nfor = \"700 ms\"\n\
                 fault = { kind = \"missing-reply\" }\noptional = true\n";
    assert_eq!(steps_of(fault, "1"), ["1.0", "1.7", "1.7", "2.4"]);
}

#[test]
fn a_step_ends_as_soon_as_a_condition_says() {
    let text = DRIVE.replace(
        "for = \"2.9 s\"",
        "for = \"2.9 s\"\nuntil = \"truth.x_m > 0.5\"",
    );
    let (code, printed) = play_text(
        &format!("{text}[[step]]\nafter = \"stop\"\nexpect = {{ that = \"truth.x_m < 0.55\" }}\n"),
        &[],
    );
    assert_eq!(code, Some(0), "{printed}");
    let mended = steps_of(
        "[[step]]\nname = \"f\"\nat = \"1 s\"\nuntil = \"t >= 1.5\"\nfault = { kind = \"missing-reply\" }\n",
        "1",
    );
    assert_eq!(mended, ["1.0", "1.5"]);
}

#[test]
fn what_never_held_says_how_near_it_came() {
    let printed = fails(
        "[[step]]\nname = \"far\"\nwhen = \"truth.x_m > 5 && t < 5\"\noperator = \"lock\"\n",
        &["`truth.x_m > 5 && t < 5` never held; it came nearest at "],
    );
    let nearest = printed.split("nearest at ").nth(1).unwrap();
    let far = nearest.split("truth.x_m = ").nth(1).unwrap();
    let far: f64 = far.split_whitespace().next().unwrap().parse().unwrap();
    assert!((1.0..4.0).contains(&far), "{printed}");
    fails(
        "[[step]]\nat = \"1 s\"\nexpect = { that = \"truth.speed_mps > 5\", within = \"4 s\" }\n",
        &[
            "expected `truth.speed_mps > 5`, but truth.speed_mps = 0",
            "nearest at ",
        ],
    );
}

#[test]
fn what_is_true_or_false_comes_no_nearer() {
    let printed = fails(
        "[[step]]\nname = \"never\"\nwhen = \"mode.locked\"\noperator = \"lock\"\n\
         [[step]]\nat = \"1 s\"\nexpect = { that = \"mode.locked\", within = \"1 s\" }\n",
        &[
            "\"never\": it never began: `mode.locked` never held\n",
            "expected `mode.locked`, but mode.locked = false\n",
        ],
    );
    assert!(!printed.contains("nearest"), "{printed}");
}

#[test]
fn a_rule_of_which_nothing_is_asked_is_named() {
    let rules = "[[response]]\nwhenever = \"truth.x_m > 50\"\nthen = \"truth.at_rest\"\n\
                 [[response]]\nwhenever = \"truth.x_m > 0.5\"\nthen = \"truth.speed_mps > 0\"\n\
                 [[response]]\nstep = \"maybe\"\nthen = \"truth.at_rest\"\n\
                 [[always]]\nthat = \"truth.at_rest\"\nfrom = \"20 s\"\n\
                 [[always]]\nthat = \"truth.at_rest\"\nafter = \"stop\"\nfrom = \"2 s\"\n\
                 [[step]]\nname = \"maybe\"\nwhen = \"t > 100\"\noptional = true\noperator = \"lock\"\n";
    let printed = passes(rules);
    let named = [
        "  not judged: always `truth.at_rest`: the run ended before\n",
        "  not judged: response `truth.at_rest`: `truth.x_m > 50` never came\n",
        "  not judged: response `truth.at_rest`: \"maybe\" never happened\n",
    ];
    assert!(named.iter().all(|line| printed.contains(line)), "{printed}");
    assert_eq!(printed.matches("not judged").count(), 3, "{printed}");
    let may = rules.replace("[[response]]\n", "[[response]]\noptional = true\n");
    assert_eq!(passes(&may).matches("not judged").count(), 1);
}

#[test]
fn each_failure_tells_what_came_before_it_and_what_was_in_effect() {
    let printed = fails(
        "[[step]]\nname = \"box\"\nat = \"1 s\"\nfor = \"2 s\"\n\
         world = { add = { box = [{ name = \"b\", at_m = [30, 0], length = \"1 m\", width = \"1 m\" }] } }\n\
         [[step]]\nname = \"push\"\nat = \"3500 ms\"\noperator = \"lock\"\n\
         [[never]]\nthat = \"t > 1.2\"\n[[never]]\nthat = \"t > 3.8\"\n",
        &[],
    );
    let (_, first) = printed.split_once("never `t > 1.2`").unwrap();
    let (first, second) = first.split_once("never `t > 3.8`").unwrap();
    let (first_has, second_has) = (
        [
            "in effect then: \"box\" (world add), from 1.000000 s on",
            "1.000000 r150  . step \"box\": world add\n",
        ],
        [
            "in effect then: \"push\" (operator lock), from 3.500000 s on",
            "3.000000 r150  . step \"box\": world add, undone\n",
            "3.500000 r150  . step \"push\": operator lock\n",
        ],
    );
    assert!(
        first_has.iter().all(|line| first.contains(line)),
        "{printed}"
    );
    assert!(
        second_has.iter().all(|line| second.contains(line)),
        "{printed}"
    );
    assert!(!second.contains("world add), from"), "{printed}");
}

#[test]
fn what_a_line_holds_back_is_no_fault_of_the_client() {
    // Twenty commands a second, which is as many as are answered.
    let held_back = |fault: &str| {
        let text = format!(
            "{DRIVE}client_is_right\n[[step]]\nname = \"f\"\nat = \"1 s\"\nfor = \"900 ms\"\nfault = {{ {fault} }}\n"
        );
        let text = text.replace("client_is_right", "").replace(
            "limit = ",
            "client_report = { forbidden = [\"over_rate\"] }\nlimit = ",
        );
        play_text(&text, &[])
    };
    for fault in [
        "kind = \"stall\"",
        "kind = \"delay\", by = \"700 ms\"",
        "kind = \"delay\", by = \"300 ms\", jitter = \"300 ms\"",
    ] {
        let (code, printed) = held_back(fault);
        assert_eq!(code, Some(0), "{fault}\n{printed}");
    }
    let fast = DRIVE
        .replace("every = \"50 ms\"", "every = \"30 ms\"")
        .replace(
            "limit = ",
            "client_report = { forbidden = [\"over_rate\"] }\nlimit = ",
        );
    let (code, printed) = play_text(&fast, &[]);
    assert_eq!(code, Some(1), "{printed}");
    assert!(printed.contains("over_rate"), "{printed}");
}

#[test]
fn a_port_whose_cable_is_out_is_opened_by_who_tries_again() {
    let pulled = "[[step]]\nat = \"1 s\"\nfor = \"1 s\"\nfault = { kind = \"cable-pulled\" }\n\
                  [[step]]\nat = \"3.5 s\"\nexpect = { that = \"client.attached\" }\n\
                  [[step]]\nat = \"1.5 s\"\nhost = { port = \"open\" }\n";
    fails(
        pulled,
        &["1.500000 s", "cannot be opened while its cable is out"],
    );
    passes(&format!("{pulled}every = \"1 s\"\ncount = 2\n"));
}

#[test]
fn an_output_has_the_same_name_everywhere() {
    for name in ["12v-a", "v12a"] {
        passes(&format!(
            "[[step]]\nat = \"200 ms\"\nhost = {{ send = {{ power_control = {{ on = [\"{name}\"] }} }} }}\n\
             [[step]]\nat = \"1 s\"\nfor = \"1 s\"\nfault = {{ kind = \"rail-short\", rail = \"{name}\" }}\n\
             [[step]]\nat = \"2.5 s\"\nexpect = {{ that = \"firmware.overcurrent_ab\" }}\n"
        ));
    }
}
