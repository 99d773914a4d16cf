use super::*;

/// The margin of what these words begin, and its time in milliseconds.
#[track_caller]
fn margin(outcome: &Outcome, what: &str) -> (f64, u64) {
    let found = outcome
        .margins
        .iter()
        .find(|rule| rule.what.starts_with(what));
    let found = found.unwrap_or_else(|| panic!("{what}: {:#?}", outcome.margins));
    (found.margin, found.at.as_nanos() / 1_000_000)
}

fn near(found: f64, wanted: f64) {
    assert!((found - wanted).abs() < 0.02, "{found} {wanted}");
}

#[test]
fn a_rule_has_the_smallest_distance_of_the_run_and_zero_only_if_it_was_broken() {
    let text = format!(
        "{DRIVE}[[never]]\nthat = \"truth.speed_mps > 1\"\n[[always]]\nthat = \"truth.speed_mps < 0.5\"\n\
         [[never]]\nthat = \"mode.locked\"\n[[never]]\nafter = \"never comes\"\nthat = \"t > 0\"\n\
         [[step]]\nname = \"never comes\"\nwhen = \"t > 100\"\noptional = true\n"
    );
    let outcome = r150("4s", &text);
    // Half power is about 0.7 m/s.
    let (slack, at) = margin(&outcome, "never `truth.speed_mps > 1`");
    assert!(
        (0.2..0.4).contains(&slack) && (300..2200).contains(&at),
        "{slack} {at}"
    );
    assert_eq!(margin(&outcome, "always `truth.speed_mps < 0.5`").0, 0.0);
    assert_eq!(margin(&outcome, "never `mode.locked`"), (1.0, 0));
    // What was never judged has none.
    assert_eq!(outcome.margins.len(), 3, "{:#?}", outcome.margins);
}

#[test]
fn times_count_as_a_share_of_their_limit() {
    let text = "[[step]]\nname = \"lock\"\nat = \"1s\"\nfor = \"400ms\"\noperator = \"lock\"\n\
        [[never]]\nthat = \"mode.locked\"\nlonger_than = \"1s\"\n\
        [[never]]\nthat = \"mode.autonomous && t < -1\"\nlonger_than = \"1s\"\n\
        [[response]]\nstep = \"lock\"\nthen = \"t >= 1.3\"\nwithin = \"1s\"\n\
        [[step]]\nname = \"wait\"\nat = \"0s\"\nexpect = { that = \"t >= 1.5\", within = \"2s\" }\n";
    let outcome = r150("4s", text);
    passes(&outcome);
    near(
        margin(&outcome, "never `mode.locked` for longer than 1s").0,
        0.6,
    );
    // Its time has not begun, so all of it is left, and the distance.
    assert!(margin(&outcome, "never `mode.autonomous").0 > 1.0);
    near(margin(&outcome, "response `t >= 1.3`").0, 0.7);
    near(margin(&outcome, "\"wait\": expected `t >= 1.5`").0, 0.25);
    let late = r150("4s", &text.replace("within = \"1s\"", "within = \"100ms\""));
    assert_eq!(margin(&late, "response").0, 0.0);
}

#[test]
fn scripted_live_and_replayed_runs_have_the_same_margins() {
    let text = text(
        R150,
        "3s",
        &format!(
            "{DRIVE}[[never]]\nthat = \"truth.speed_mps > 1\"\n[[always]]\nthat = \"count.command_set_motors < 60\"\n"
        ),
    );
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut scripted = Run::new(scenario(&text), None, options).unwrap();
    let mut lines = Vec::new();
    let whole = scripted
        .play(&mut |line| lines.push(line.to_owned()))
        .unwrap()
        .clone();
    assert!(
        whole.margins.len() == 2 && whole.margins[1].margin < 0.5,
        "{whole:#?}"
    );
    // The same bytes at the same times, from a client that is not the script.
    let mut live = Run::new(
        scenario(&text),
        None,
        RunOptions {
            live: true,
            ..options
        },
    )
    .unwrap();
    live.stop_at_bytes();
    let mut replay = crate::trace::Replay::begin(rigsim_core::SHIPPED, &lines[0]).unwrap();
    for line in &lines[1..] {
        if let Record::Host { t, port, bytes } = serde_json::from_str(line).unwrap() {
            let (port, at) = (PortId::from(port), SimTime::from_nanos(t));
            if live.rig().now() == SimTime::ZERO {
                live.attach(port, SimTime::ZERO).unwrap();
                live.set_line(port, ClientLine::at(115_200));
            }
            live.send(port, at, &bytes.0).unwrap();
        }
        replay.line(line).unwrap();
    }
    live.advance(SimTime::MAX).unwrap();
    assert_eq!(replay.run().finished().unwrap().margins, whole.margins);
    assert_eq!(live.end().margins, whole.margins);
}
