use super::*;
use crate::trace::{Record, Replay, ReplayError};
use proptest::prelude::*;
use rigsim_core::r150_device::command::Request;

const PORT: PortId = PortId { device: 0, link: 0 };

/// The trace of a scripted run.
fn trace(text: &str, seed: u64) -> Vec<String> {
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(seed)
    };
    let mut run = Run::new(scenario(text), None, options).unwrap();
    let mut lines = Vec::new();
    run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    lines
}

fn replay(lines: &[String]) -> Result<(), ReplayError> {
    Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str))
}

/// A live run whose client sends these at these times, and is asked for its bytes at odd times; the
/// lines of its trace.
fn live(text: &str, wire: Wire, sent: &[(u64, Vec<u8>)]) -> Vec<String> {
    let (mut run, _) = live_run(text, wire, true, sent);
    std::iter::from_fn(|| run.poll_trace()).collect()
}

/// The same run when it is over, and what its client has got.
fn live_run(text: &str, wire: Wire, trace: bool, sent: &[(u64, Vec<u8>)]) -> (Run, Vec<u8>) {
    let options = RunOptions {
        seed: 5,
        wire,
        live: true,
        trace,
    };
    let mut run = Run::new(scenario(text), None, options).unwrap();
    run.attach(PORT, SimTime::from_millis(1)).unwrap();
    run.set_line(PORT, ClientLine::at(115_200));
    let mut got = Vec::new();
    for (at, bytes) in sent {
        let at = SimTime::from_nanos(*at);
        run.advance(at - Duration::from_nanos(777)).unwrap();
        run.read(PORT, &mut got);
        run.advance(at).unwrap();
        run.send(PORT, at, bytes).unwrap();
    }
    run.advance(run.rig().now() + Duration::from_millis(20))
        .unwrap();
    run.read(PORT, &mut got);
    run.detach(PORT, run.rig().now()).unwrap();
    run.advance(SimTime::MAX).unwrap();
    assert!(run.finished().is_some());
    (run, got)
}

#[test]
fn a_scripted_run_is_the_same_again_and_from_its_trace() {
    let text = text(
        R150,
        "4s",
        &format!("{DRIVE}[[always]]\nthat = \"truth.speed_mps < 1.5\"\n"),
    );
    let lines = trace(&text, 1);
    assert_eq!(lines, trace(&text, 1));
    replay(&lines).unwrap();
    for kind in ["header", "host", "out", "event", "pose", "step", "end"] {
        let wanted = format!("{{\"kind\":\"{kind}\"");
        assert!(lines.iter().any(|line| line.starts_with(&wanted)), "{kind}");
    }
}

#[test]
fn lines_of_bytes_say_when_each_arrived() {
    let text = text(
        R150,
        "1s",
        "[settings]\nr150.reply_spread = \"0s\"\nr150.adapter = \"bytes\"\n[[step]]\nat = \"0s\"\nhost = { send = \"heartbeat\" }\n",
    );
    let out: Vec<Record> = trace(&text, 1)
        .iter()
        .map(|line| serde_json::from_str(line).unwrap())
        .filter(|record| matches!(record, Record::Out { .. }))
        .collect();
    let [Record::Out { t, dt, bytes, .. }] = &out[..] else {
        panic!("{out:?}")
    };
    // Six bytes there, then one of the reply.
    assert_eq!((*t, *dt), (7 * 86_806, 86_806));
    assert_eq!(bytes.0, [0xAA, 0x55, 1, 7, 1, 0xC6, 0x53]);
}

#[test]
fn a_flipped_byte_a_lost_line_and_another_seed_are_found() {
    let text = format!(
        "{HEAD}limit = \"3s\"\n{R150}{DRIVE}[[step]]\nat = \"1s\"\nevery = \"100ms\"\nhost = {{ send = \"system_info\" }}\n"
    );
    let lines = trace(&text, 1);
    replay(&lines).unwrap();
    let at = lines
        .iter()
        .position(|line| line.contains("\"out\""))
        .unwrap();
    let mut flipped = lines.clone();
    flipped[at] = flipped[at].replacen("AA55", "AA54", 1);
    let Err(ReplayError::Differs(difference)) = replay(&flipped) else {
        panic!("a flipped byte")
    };
    assert_eq!(difference.offset, 1);
    assert_eq!(difference.recorded.unwrap().1, 0x54);
    assert_eq!(difference.found.unwrap().1, 0x55);
    assert!(difference.to_string().contains("byte 1 differs: 54 at"));
    let mut lost = lines.clone();
    lost.remove(at);
    assert!(matches!(replay(&lost), Err(ReplayError::Differs(_))));
    let mut reseeded = lines.clone();
    reseeded[0] = reseeded[0].replace("\"seed\":1", "\"seed\":2");
    assert!(matches!(replay(&reseeded), Err(ReplayError::Differs(_))));
    let cut = &lines[..lines.len() - 1];
    assert!(replay(cut).unwrap_err().to_string().contains("has no end"));
    assert!(replay(&[]).is_err());
    assert!(
        replay(&lines[1..])
            .unwrap_err()
            .to_string()
            .contains("header")
    );
}

#[test]
fn a_run_that_the_machine_stalled_is_the_same_again() {
    let options = RunOptions {
        live: true,
        trace: true,
        ..RunOptions::scripted(1)
    };
    // It tells by its replies which commands it takes for too soon.
    let settings = "[settings]\nr150.over_rate = \"ignore\"\n";
    let mut run = Run::new(scenario(&text(R150, "2s", settings)), None, options).unwrap();
    run.attach(PORT, SimTime::from_millis(1)).unwrap();
    let drive = Request::SetMotors { right: 9, left: 9 }.encode();
    // 50 Hz, but by the client's clock 20 Hz while the simulator is late.
    let late_at = SimTime::from_millis(500);
    for at in (20..1500).step_by(20).map(SimTime::from_millis) {
        if at == late_at {
            run.late(Duration::from_secs(2), Duration::from_secs(2));
        }
        run.send(PORT, at, &drive).unwrap();
    }
    run.advance(SimTime::MAX).unwrap();
    run.late(Duration::from_secs(1), Duration::from_secs(1));
    let lines: Vec<String> = std::iter::from_fn(|| run.poll_trace()).collect();
    replay(&lines).unwrap();
    let times = |code: &str| -> Vec<u64> {
        let records = lines.iter().map(|line| serde_json::from_str(line).unwrap());
        let times = records.filter_map(|record| match record {
            Record::Event { t, code: found, .. } if found == code => Some(t),
            _ => None,
        });
        times.collect()
    };
    let too_soon = times("over_rate");
    // What waits for the line then may be two seconds old, for as long as a line of 115200 baud
    // needs for what a port holds.
    let drained = late_at + Duration::from_millis(355);
    let [before, after] = [late_at, drained].map(SimTime::as_nanos);
    assert!(too_soon.iter().all(|t| *t < before || *t > after));
    assert!(too_soon.iter().any(|t| *t < before) && too_soon.iter().any(|t| *t > after));
    let late: Vec<_> = lines.iter().filter(|l| l.contains("\"late\"")).collect();
    assert_eq!(late.len(), 1, "{late:?}");
    // Without that line the second run attributes the burst to the client, too.
    let without: Vec<String> = lines
        .iter()
        .filter(|line| !line.contains("\"late\""))
        .cloned()
        .collect();
    assert!(matches!(replay(&without), Err(ReplayError::Differs(_))));
}

#[test]
fn what_no_recording_has_is_refused_in_words() {
    let text = text(R150, "2s", "");
    let version = Request::Version.encode();
    let lines = live(
        &text,
        Wire::Paced,
        &[(10_000_000, version.clone()), (500_000_000, version)],
    );
    replay(&lines).unwrap();
    let last = lines.len() - 1;
    let with = |at: usize, line: &str| {
        let mut spoilt = lines.clone();
        spoilt.insert(at, line.to_owned());
        replay(&spoilt).unwrap_err().to_string()
    };
    let bytes = "AA".repeat(1025);
    let ports = [
        r#"{"kind":"attach","t":600000000,"port":[1,0]}"#,
        r#"{"kind":"detach","t":600000000,"port":[0,1]}"#,
        r#"{"kind":"in","t":600000000,"port":[0,18446744073709551615],"bytes":"AA"}"#,
        r#"{"kind":"line","t":600000000,"port":[7,0],"baud":1,"stop_bits":1,"raw":true}"#,
        r#"{"kind":"out","t":600000000,"dt":1,"port":[7,0],"bytes":"AA"}"#,
    ];
    for line in ports {
        assert!(
            with(last, line).contains("the scenario has no device"),
            "{line}"
        );
    }
    let back = r#"{"kind":"in","t":400000000,"port":[0,0],"bytes":"AA"}"#;
    assert!(with(last, back).contains("back in time"));
    assert!(with(last + 1, &lines[last]).contains("behind the end"));
    // Which is where the error of a client stands that ends with one.
    let failure = r#"{"kind":"failure","t":2000000000,"step":null,"what":"w"}"#.to_owned();
    replay(&[&lines[..], &[failure]].concat()).unwrap();
    let long = format!(r#"{{"kind":"out","t":1,"dt":1,"port":[0,0],"bytes":"{bytes}"}}"#);
    assert!(with(1, &long).contains("more than 1024 bytes"));
    let unknown = format!(r#"{{"kind":"{}"}}"#, "x".repeat(1_000_000));
    assert!(with(1, &unknown).len() < 1000);
}

#[test]
fn devices_that_are_only_served_cost_no_looks_and_have_no_end() {
    let rig = scenario(&text(R150, "1s", "")).rig.clone();
    let options = RunOptions {
        live: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(Arc::new(Scenario::serving(rig)), None, options).unwrap();
    run.advance(SimTime::from_secs(5)).unwrap();
    assert_eq!(run.next_deadline(), run.rig().next_deadline());
    // At rest, slow states advance ten times a second.
    let due = run.next_deadline().unwrap().since(run.rig().now());
    assert!(due > Duration::from_millis(90), "{due:?}");
    run.advance(SimTime::from_secs(100_000)).unwrap();
    assert!(run.finished().is_none());
    assert!(run.end().passed);
}

#[test]
fn what_comes_after_the_end_of_a_run_is_no_part_of_it() {
    let options = RunOptions {
        live: true,
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(scenario(&text(R150, "1s", "")), None, options).unwrap();
    run.advance(SimTime::from_secs(2)).unwrap();
    let late = SimTime::from_secs(3);
    run.set_line(PORT, ClientLine::at(9600));
    run.attach(PORT, late).unwrap();
    run.send(PORT, late, &[0xAA]).unwrap();
    run.detach(PORT, late).unwrap();
    run.advance(late).unwrap();
    let lines: Vec<String> = std::iter::from_fn(|| run.poll_trace()).collect();
    assert!(lines.last().unwrap().contains("\"end\""), "{lines:?}");
    replay(&lines).unwrap();
}

#[test]
fn a_recording_of_a_version_without_adapters_replays_byte_by_byte() {
    let sent = [(10_300_000, Request::Version.encode())];
    let lines = live(&text(R150, "1s", ""), Wire::Bare, &sent);
    assert!(!lines[0].contains("adapters"), "{}", lines[0]);
    replay(&lines).unwrap();
    let mut other = lines.clone();
    other[0] = lines[0].replace("\"paced\":true", "\"paced\":true,\"adapters\":true");
    let Err(ReplayError::Differs(_)) = replay(&other) else {
        panic!("through an adapter its bytes come at other times")
    };
}

#[test]
fn neither_side_of_a_comparison_grows_without_bound() {
    // A car that talks by itself and a recording that has nothing of it; and one that has ever more.
    let lines = live(&text(CAR, "2s", ""), Wire::Paced, &[]);
    let header = lines[0].replace("2s", "100000 s");
    let mut silent = Replay::begin(rigsim_core::SHIPPED, &header).unwrap();
    let attach = lines.iter().find(|line| line.contains("attach"));
    silent.line(attach.unwrap()).unwrap();
    let end = r#"{"kind":"end","t":100000000000000,"passed":true,"dropped":0}"#;
    let Err(ReplayError::Differs(difference)) = silent.line(end) else {
        panic!("the recording lacks all bytes")
    };
    assert_eq!(difference.recorded, None);
    let mut talks = Replay::begin(rigsim_core::SHIPPED, &header).unwrap();
    let bytes = "00".repeat(1024);
    let out = format!(r#"{{"kind":"out","t":0,"dt":0,"port":[0,1],"bytes":"{bytes}"}}"#);
    assert!((0..100).any(|_| talks.line(&out).is_err()));
}

#[test]
fn base_settings_travel_in_the_header() {
    let text = text(
        R150,
        "2s",
        "[[step]]\nat = \"1s\"\nhost = { send = \"version\" }\n",
    );
    let mut base = SimSettings::new(rigsim_core::SHIPPED);
    rigsim_settings::load_toml(
        "r150.software_version = \"9.8.7.6\"\nr150.reply_delay = \"3ms\"",
        "flags",
        &mut base,
    )
    .unwrap();
    let source = Source {
        file: "s.toml",
        text: &text,
    };
    let scenario = Arc::new(Scenario::parse(source, &base).unwrap());
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(scenario, None, options).unwrap();
    let mut lines = Vec::new();
    run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    assert!(lines[0].contains("9.8.7.6"));
    replay(&lines).unwrap();
}

#[test]
fn a_live_run_leaves_the_script_out_and_is_repeated_from_its_trace() {
    let text = text(
        R150,
        "3s",
        "[[step]]\nat = \"1s\"\nevery = \"1s\"\nhost = { send = { power_control = { on = [\"5v\"] } } }\n\
         [[step]]\nat = \"1s\"\noperator = \"lock\"\n",
    );
    let motors = Request::SetMotors {
        right: 400,
        left: 400,
    };
    let sent: Vec<(u64, Vec<u8>)> = (0..40)
        .map(|i| (10_000_000 + i * 50_000_000, motors.encode()))
        .collect();
    let lines = live(&text, Wire::Paced, &sent);
    assert!(!lines.iter().any(|line| line.contains("\"host\"")));
    assert!(lines.iter().filter(|line| line.contains("\"in\"")).count() == 40);
    assert!(lines.iter().any(|line| line.contains("\"detach\"")));
    replay(&lines).unwrap();
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(16))]

    #[test]
    fn two_runs_are_the_same_for_any_seed(seed: u64) {
            let chance = "[[step]]\nname = \"ask\"\nat = \"1s\"\nevery = \"70ms\"\nprobability = 0.5\nhost = { send = \"system_info\" }\n";
        let text = format!("{HEAD}limit = \"3s\"\n{R150}{DRIVE}{chance}");
        let lines = trace(&text, seed);
        prop_assert_eq!(&lines, &trace(&text, seed));
        replay(&lines).unwrap();
    }

    /// Whatever a client sends and whenever, on a paced wire or an instant one, a recorded run is
    /// the same again.
    #[test]
    fn any_live_run_is_repeated_from_its_trace(
        instant: bool,
        sent in prop::collection::vec((0u64..200_000_000, prop_oneof![
            3 => (any::<i16>(), any::<i16>())
                .prop_map(|(right, left)| Request::SetMotors { right, left }.encode()),
            1 => Just(Request::SystemInfo.encode()),
            1 => prop::collection::vec(any::<u8>(), 0..20),
        ]), 0..20),
    ) {
        let text = text(
            R150,
            "4s",
            "[[step]]\nat = \"1s\"\noperator = \"lock\"\n\
             [[step]]\nwhen = \"truth.speed_mps > 0.2\"\noptional = true\noperator = { emergency_stop = true }\n\
             [[always]]\nthat = \"t < 100\"\n",
        );
        let mut at = 2_000_000;
        let sent: Vec<_> = sent
            .into_iter()
            .map(|(pause, bytes)| {
                at += pause;
                // Often on the grid of the physics, where ties are.
                (if pause % 2 == 0 { at / 5_000_000 * 5_000_000 } else { at }, bytes)
            })
            .collect();
        let wire = if instant { Wire::Instant } else { Wire::Paced };
        let (mut traced, got) = live_run(&text, wire, true, &sent);
        let lines: Vec<String> = std::iter::from_fn(|| traced.poll_trace()).collect();
        replay(&lines).unwrap();
        // A run that writes every byte into a trace sees no more than one that does not.
        let (mut plain, got_without) = live_run(&text, wire, false, &sent);
        prop_assert_eq!(got, got_without);
        prop_assert_eq!(traced.end(), plain.end());
        let events = |run: &mut Run| std::iter::from_fn(|| run.poll_event()).collect::<Vec<_>>();
        prop_assert_eq!(events(&mut traced), events(&mut plain));
    }
}
