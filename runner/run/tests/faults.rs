use super::*;

const ON: &str = "[[step]]\nat = \"100ms\"\nhost = { send = { power_control = { on = [\"48v\"] } } }\n\
    [[step]]\nat = \"200ms\"\nevery = \"1s\"\nhost = { send = \"system_info\" }\n";

fn fault(timing: &str, fault: &str, more: &str) -> Outcome {
    r150(
        "8s",
        &format!("{ON}[[step]]\nname = \"f\"\n{timing}fault = {{ {fault} }}\n{more}"),
    )
}

#[test]
fn a_fault_begins_hits_and_ends() {
    let outcome = fault(
        "at = \"1s\"\nfor = \"2s\"\n",
        "kind = \"missing-reply\"",
        "[[step]]\nat = \"2s\"\nhost = { send = \"heartbeat\", expect = { within = \"100ms\", silence = true } }\n\
         [[step]]\nafter = \"f\"\ndelay = \"100ms\"\nhost = { send = \"heartbeat\", expect = { within = \"100ms\", reply = { success = true } } }\n",
    );
    passes(&outcome);
    let [record] = &outcome.faults[..] else {
        panic!("{outcome:#?}")
    };
    assert_eq!(
        (record.step.as_str(), record.id, record.armed),
        ("f", "missing-reply", 1)
    );
    assert!(record.hits >= 2);
    let codes: Vec<&str> = outcome.devices[0].report.events.keys().copied().collect();
    for code in ["fault_armed", "fault_triggered", "fault_cleared"] {
        assert!(codes.contains(&code), "{codes:?}");
    }
}

#[test]
fn a_fault_ends_by_its_condition_or_stays() {
    let ends = |until: &str, within: &str, silent: bool| {
        let expect = if silent {
            "silence = true"
        } else {
            "reply = { success = true }"
        };
        passes(&fault(
            &format!("at = \"1s\"\n{until}"),
            "kind = \"missing-reply\"",
            &format!(
                "[[step]]\nat = \"{within}\"\nhost = {{ send = \"heartbeat\", expect = {{ within = \"100ms\", {expect} }} }}\n"
            ),
        ));
    };
    let until = "until = \"t >= 2.95\"\n";
    ends("", "6s", true);
    ends(until, "2800ms", true);
    ends(until, "3s", false);
}

#[test]
fn a_fault_that_never_hits_fails_the_run_unless_it_may() {
    let timing = "at = \"1s\"\nfor = \"10ms\"\n";
    let never = fault(timing, "kind = \"missing-reply\"", "");
    fails(
        &never,
        "\"f\": the fault missing-reply was there from 1.000000 s on and never hit anything",
    );
    assert_eq!(never.faults[0].hits, 0);
    passes(&fault(
        &format!("{timing}optional = true\n"),
        "kind = \"missing-reply\"",
        "",
    ));
    // One that chance never brings is not missed.
    passes(&fault(
        "at = \"1s\"\nprobability = 0\n",
        "kind = \"missing-reply\"",
        "",
    ));
}

#[test]
fn a_fault_comes_and_goes_as_often_as_it_is_to() {
    let outcome = fault(
        "at = \"1s\"\nevery = \"1s\"\nfor = \"500ms\"\ncount = 4\n",
        "kind = \"missing-reply\"",
        "[[step]]\nafter = \"f\"\nexpect = { that = \"t == 4.5\" }\n",
    );
    passes(&outcome);
    assert_eq!((outcome.faults[0].armed, outcome.faults[0].hits), (4, 4));
}

#[test]
fn what_goes_on_is_reported_with_the_time_since_which_it_does() {
    let last = "[[step]]\nat = \"3.2s\"\nexpect = { that = \"truth.x_m > 1\" }\n";
    let repeated = |more: &str, what: &str| {
        let step = "[[step]]\nname = \"again\"\nat = \"1s\"\nevery = \"1s\"\n";
        let outcome = r150("4s", &format!("{step}{more}{what}\n{last}"));
        let context = &outcome.failures[0].context;
        [context.armed.clone(), context.in_effect.clone()].concat()
    };
    let ice = "fault = { kind = \"ice\" }\noptional = true";
    let load = "operator = { app_holds = { pwm = true } }";
    for (what, called) in [(ice, "ice"), (load, "operator app_holds")] {
        let since = |since| [format!("\"again\" ({called}), from {since} s on")];
        assert_eq!(repeated("for = \"500ms\"\n", what), since("3.000000"));
        // Without an end, the first time goes on.
        assert_eq!(repeated("", what), since("1.000000"));
    }
}

#[test]
fn a_fault_that_the_device_cannot_have_is_refused_with_its_line() {
    let refused = |device: &str, fault: &str| {
        let text = text(
            device,
            "1s",
            &format!("[[step]]\nat = \"1s\"\nfault = {{ {fault} }}\n"),
        );
        let source = Source {
            file: "s.toml",
            text: &text,
        };
        Scenario::parse(source, &SimSettings::new(rigsim_core::SHIPPED))
            .unwrap_err()
            .to_string()
    };
    let strip = refused(R150, "kind = \"strip-lost\"");
    assert!(
        strip.starts_with("s.toml:9:18: `step.fault.kind`: an R150 cannot have `strip-lost`"),
        "{strip}"
    );
    assert!(refused(R150, "kind = \"bit-flip\"").contains("did you mean `bit-flips`?"));
    assert!(
        refused(R150, "kind = \"mute\", dirction = \"both\"").contains("did you mean `direction`?")
    );
    let car = "[[device]]\nkind = \"mecanum\"\n";
    assert!(refused(car, "kind = \"mute\", link = \"ros\"").contains("`ros = true`"));
}

#[test]
fn a_disturbed_line_is_not_attributed_to_the_client() {
    let spoilt = |direction: &str| {
        let outcome = fault(
            "at = \"1s\"\nfor = \"4s\"\n",
            &format!("kind = \"bit-flips\", probability = 0.2, direction = \"{direction}\""),
            "[[step]]\nat = \"1s\"\nevery = \"50ms\"\nfor = \"3s\"\nhost = { send = \"heartbeat\" }\n\
             [[step]]\nat = \"7s\"\nexpect = { that = \"count.bad_crc > 5\" }\n",
        );
        passes(&outcome);
        let report = &outcome.devices[0].report;
        (
            report.events.contains_key("bad_crc"),
            report.client_errors().count(),
        )
    };
    assert_eq!(spoilt("to-device"), (false, 0));
}

#[test]
fn a_mode_that_a_spoilt_request_may_have_left_is_not_attributed_to_the_client() {
    let motion = |at: &str| {
        format!(
            "[[step]]\nat = \"{at}\"\nhost = {{ send = {{ motion = {{ moving_idx = 0, s = 10, v = 100 }} }} }}\n"
        )
    };
    let outcome = car(
        "5s",
        &format!(
            "[[step]]\nat = \"500ms\"\nhost = {{ send = {{ control_mode = {{ mode = 1 }} }} }}\n\
             [[step]]\nat = \"1s\"\nfor = \"1s\"\noptional = true\n\
             fault = {{ kind = \"bit-flips\", probability = 0.001 }}\n{}{}{}\
             [[step]]\nat = \"4.5s\"\nexpect = {{ that = \"count.ignored_in_remote == 3\" }}\n",
            motion("1.5s"),
            motion("2.9s"),
            motion("4s"),
        ),
    );
    let mut failures = outcome.failures.iter().map(ToString::to_string);
    assert!(!failures.any(|failure| failure.contains("expected")));
    assert_eq!(
        outcome.devices[0].report.events["ignored_in_remote"].count,
        1
    );
}

#[test]
fn a_run_with_every_kind_of_chance_is_repeated_from_its_trace() {
    let more = "[[step]]\nname = \"noise\"\nat = \"1s\"\nevery = \"1s\"\nfor = \"400ms\"\nprobability = 0.7\noptional = true\nfault = { kind = \"bit-flips\", probability = 0.1 }\n";
    let text = text(R150, "6s", &format!("{ON}{DRIVE}{more}"));
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(3)
    };
    let mut run = Run::new(scenario(&text), None, options).unwrap();
    let mut lines = Vec::new();
    run.play(&mut |line| lines.push(line.to_owned())).unwrap();
    crate::trace::Replay::all(rigsim_core::SHIPPED, lines.iter().map(String::as_str)).unwrap();
}
