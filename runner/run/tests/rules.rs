use super::*;

#[test]
fn always_and_never_hold_in_their_windows_only() {
    let rule = |text: &str| r150("4s", &format!("{DRIVE}{text}"));
    passes(&rule("[[always]]\nthat = \"truth.speed_mps < 1.5\"\n"));
    fails(
        &rule("[[always]]\nthat = \"truth.speed_mps < 0.3\"\nmessage = \"too fast\"\n"),
        "too fast: always `truth.speed_mps < 0.3`, but truth.speed_mps = 0.3",
    );
    fails(
        &rule("[[never]]\nthat = \"truth.speed_mps > 0.3\"\n"),
        "never `",
    );
    passes(&rule(
        "[[never]]\nthat = \"truth.speed_mps > 0.3\"\nuntil = \"110ms\"\n",
    ));
    passes(&rule(
        "[[never]]\nthat = \"truth.speed_mps > 0.3\"\nfrom = \"3s\"\n",
    ));
    passes(&rule(
        "[[never]]\nthat = \"truth.speed_mps > 0.3\"\nafter = \"stop\"\nfrom = \"500ms\"\n",
    ));
    fails(
        &rule("[[never]]\nthat = \"truth.speed_mps > 0.3\"\nafter = \"stop\"\nuntil = \"10ms\"\n"),
        "never `",
    );
    passes(&rule(
        "[[never]]\nthat = \"truth.speed_mps > 0.3\"\nonly = \"live\"\n",
    ));
    // What a rule waits for never comes, so it never counts.
    let waits = rule(
        "[[step]]\nname = \"n\"\nwhen = \"t > 9\"\noptional = true\noperator = \"lock\"\n\
         [[never]]\nthat = \"true\"\nafter = \"n\"\n",
    );
    passes(&waits);
}

#[test]
fn windows_include_both_their_ends() {
    let rule = |from: &str, until: &str, never: &str| {
        r150(
            "1s",
            &format!("[[never]]\nthat = \"{never}\"\nfrom = \"{from}\"\nuntil = \"{until}\"\n"),
        )
    };
    fails(&rule("301us", "302us", "t == 0.000301"), "never");
    fails(&rule("301us", "302us", "t == 0.000302"), "never");
    passes(&rule("301us", "302us", "t < 0.000301 || t > 0.000302"));
    // While nothing moves conditions are looked at on the grid of the physics all the same.
    fails(&rule("0s", "1s", "t > 0.552 && t < 0.556"), "t = 0.555");
}

#[test]
fn expectations_hold_now_or_within_a_time() {
    let expect = |text: &str| {
        r150(
            "2s",
            &format!("[[step]]\nname = \"x\"\nat = \"1s\"\nexpect = {{ {text} }}\n"),
        )
    };
    passes(&expect("that = \"t == 1\""));
    fails(
        &expect("that = \"t > 1\", message = \"no\""),
        "\"x\": no: expected `t > 1`, but t = 1",
    );
    passes(
        &expect("that = \"t > 1.3\", within = \"300ms\"")
            .clone()
            .tap(),
    );
    fails(
        &expect("that = \"t > 1.3\", within = \"299ms\""),
        "but t = 1.299",
    );
    fails(
        &expect("that = \"t > 9\", within = \"3s\""),
        "the run ended before its time was up",
    );
    fails(&expect("that = \"0.0 / 0.0 < 1.0\""), "has no value");
}

trait Tap {
    fn tap(self) -> Self;
}

impl Tap for Outcome {
    /// A condition with `>` holds a step of the physics later at the latest.
    fn tap(mut self) -> Self {
        self.failures
            .retain(|failure| !failure.what.contains("t = 1.3"));
        self.passed = self.failures.is_empty();
        self
    }
}

#[test]
fn the_client_report_can_be_demanded_to_be_empty_or_by_kind() {
    let bad = "[[step]]\nat = \"100ms\"\nhost = { bytes = \"AA 55 00 07 00 00\" }\n";
    let demand = |demand: &str, step: &str| {
        play(
            &format!("{HEAD}limit = \"1s\"\nclient_report = {demand}\n{R150}{step}"),
            1,
        )
    };
    passes(&demand("\"empty\"", ""));
    fails(
        &demand("\"empty\"", bad),
        "client report of r150: bad_crc × 1, first at 0.1",
    );
    passes(&demand("{ allowed = [\"bad_crc\"] }", bad));
    fails(&demand("{ allowed = [\"over_rate\"] }", bad), "bad_crc");
    fails(&demand("{ forbidden = [\"bad_crc\"] }", bad), "bad_crc");
    passes(&demand("{ forbidden = [\"over_rate\"] }", bad));
    passes(&demand(
        "{ forbidden = [\"bad_crc\"], only = \"live\" }",
        bad,
    ));
}

#[test]
fn an_outcome_shows_the_last_traffic_and_every_device_s_report() {
    let outcome = r150("4s", DRIVE);
    assert_eq!(outcome.devices[0].name, "r150");
    assert!(outcome.devices[0].report.requests > 30);
    let last = &outcome.last.before;
    assert!(last.len() <= MOST_RECENT && last.len() > 10);
    assert!(
        last.iter()
            .any(|line| line.contains("r150 -> 0x12 set_motors"))
    );
    assert_eq!(outcome.ended_at, SimTime::from_secs(4));
}

#[test]
fn a_run_that_is_ended_early_says_what_did_not_come() {
    let text = text(
        R150,
        "9s",
        "[[step]]\nname = \"late\"\nat = \"5s\"\noperator = \"lock\"\n",
    );
    let mut run = Run::new(scenario(&text), None, RunOptions::scripted(1)).unwrap();
    run.advance(SimTime::from_secs(2)).unwrap();
    assert!(run.finished().is_none());
    let outcome = run.end().clone();
    fails(&outcome, "was to begin at 5.000000 s, the run ended before");
    assert_eq!(outcome.ended_at, SimTime::from_secs(2));
    assert_eq!(run.next_deadline(), None);
    run.fail("the client ended with 3".to_owned());
    assert_eq!(run.end().failures.len(), 2);
}

#[test]
fn a_response_counts_in_its_kind_of_run_only_and_no_mission_where_it_may_fail() {
    let response = |more: &str| {
        let text = "[[response]]\nwhenever = \"t > 0.5\"\nthen = \"false\"\nwithin = \"100ms\"\n";
        r150("1s", &format!("{text}{more}"))
    };
    fails(&response(""), "expected `false` within 100ms");
    fails(&response("only = \"scripted\"\n"), "expected `false`");
    passes(&response("only = \"live\"\n"));
    fails(&response("mission = true\n"), "expected `false`");
}
