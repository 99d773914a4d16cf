use super::*;

#[test]
fn a_host_sends_by_name_or_bytes_and_compares_what_comes_back() {
    passes(&r150(
        "2s",
        "[[step]]\nname = \"a\"\nat = \"10ms\"\nhost = { send = \"heartbeat\", expect = { within = \"5ms\", reply = { success = true } } }\n\
         [[step]]\nname = \"b\"\nafter = \"a\"\nhost = { bytes = \"AA 55 00 07 C7 84\", expect = { within = \"5ms\", reply = { success = true } } }\n\
         [[step]]\nname = \"c\"\nafter = \"b\"\nhost = { bytes = \"AA 55 00 07 00 00\", expect = { within = \"50ms\", silence = true } }\n\
         [[step]]\nname = \"d\"\nafter = \"c\"\nhost = { send = { power_control = { on = [\"48v\", \"5v\"] } }, expect = { within = \"5ms\" } }\n\
         [[step]]\nname = \"e\"\nafter = \"d\"\nhost = { send = \"system_info\", expect = { within = \"20ms\", reply = { power_status = 0x30, voltage_48v = { min = 40000, max = 60000 } } } }\n\
         [[step]]\nafter = \"e\"\nexpect = { that = \"reported.v48_on && rail.v48_v > 40 && client.asked_v48\" }\n",
    ));
}

#[test]
fn a_reply_that_is_not_as_expected_fails_the_step() {
    let send = |what: &str, expect: &str| {
        r150(
            "1s",
            &format!(
                "[[step]]\nname = \"ask\"\nat = \"10ms\"\nhost = {{ {what}, expect = {{ within = \"20ms\", {expect} }} }}\n"
            ),
        )
    };
    let heartbeat = "send = \"heartbeat\"";
    fails(
        &send(heartbeat, "reply = { success = false }"),
        "\"ask\": `success` is",
    );
    fails(
        &send(heartbeat, "silence = true"),
        "wanted silence, AA came",
    );
    fails(
        &send("bytes = \"AA\"", ""),
        "wanted an answer within 20ms, none came",
    );
    fails(
        &send("send = \"system_info\"", "reply = { power_status = 1 }"),
        "`power_status` is",
    );
    let too_late = r150(
        "1s",
        "[[step]]\nat = \"990ms\"\nhost = { send = \"system_info\", expect = { within = \"1ms\" } }\n",
    );
    fails(&too_late, "none came");
}

#[test]
fn a_port_can_be_closed_and_opened_and_set_to_a_wrong_speed() {
    passes(&r150(
        "3s",
        "[[step]]\nname = \"off\"\nat = \"100ms\"\nhost = { port = \"close\" }\n\
         [[step]]\nname = \"is off\"\nafter = \"off\"\nexpect = { that = \"!client.attached\" }\n\
         [[step]]\nname = \"on\"\nat = \"500ms\"\nhost = { port = \"open\" }\n\
         [[step]]\nafter = \"on\"\nexpect = { that = \"client.attached\" }\n\
         [[step]]\nname = \"slow\"\nat = \"1s\"\nhost = { baud = 9600 }\n\
         [[step]]\nat = \"1.2s\"\nhost = { send = \"heartbeat\" }\n\
         [[step]]\nat = \"2s\"\nexpect = { that = \"count.requests == 0\" }\n",
    ));
}

#[test]
fn operators_work_the_r150() {
    passes(&r150(
        "9s",
        "[[step]]\nat = \"1s\"\nfor = \"1s\"\noperator = { press = \"forward\" }\n\
         [[step]]\nat = \"1.5s\"\nexpect = { that = \"truth.forward_mps > 0.1 && !mode.autonomous\" }\n\
         [[step]]\nat = \"3.5s\"\nexpect = { that = \"truth.speed_mps < 0.5\" }\n\
         [[step]]\nname = \"stop\"\nat = \"4s\"\nfor = \"1s\"\noperator = { emergency_stop = true }\n\
         [[step]]\nat = \"4.5s\"\nexpect = { that = \"mode.emergency_stop\" }\n\
         [[step]]\nafter = \"stop\"\nexpect = { that = \"!mode.emergency_stop && t == 5\" }\n\
         [[step]]\nat = \"6s\"\nfor = \"1s\"\noptional = true\nfault = { kind = \"payload\", mass = \"100 kg\" }\n\
         [[step]]\nat = \"6.5s\"\nexpect = { that = \"truth.mass_kg > 200\" }\n\
         [[step]]\nat = \"6.6s\"\noperator = { place = { x = \"3 m\", y = \"-2 m\" } }\n\
         [[step]]\nat = \"6.7s\"\nexpect = { that = \"abs(truth.x_m - 3) < 0.01 && abs(truth.y_m + 2) < 0.01\" }\n\
         [[step]]\nat = \"7s\"\noperator = \"lock\"\n\
         [[step]]\nat = \"7.1s\"\nexpect = { that = \"mode.locked && mode.parked\" }\n\
         [[step]]\nat = \"7.2s\"\noperator = { app_sets = { on = [\"12v-a\"] } }\n\
         [[step]]\nat = \"7.3s\"\nexpect = { that = \"rail.v12a_on\" }\n",
    ));
}

#[test]
fn a_push_lasts_as_long_as_it_is_to() {
    passes(&r150(
        "3s",
        "[[step]]\nat = \"0s\"\noperator = { emergency_stop = true }\n\
         [[step]]\nat = \"1s\"\nfor = \"500ms\"\nfault = { kind = \"push\", ahead = \"2000 N\" }\n\
         [[step]]\nat = \"1.4s\"\nexpect = { that = \"truth.speed_mps > 0.01\" }\n",
    ));
}

#[test]
fn what_is_done_to_a_vehicle_and_its_world_is_an_event() {
    let actions = "[[step]]\nname = \"p\"\nat = \"1s\"\nfor = \"1s\"\noperator = \"lock\"\n\
         [[step]]\nname = \"f\"\nat = \"1500ms\"\nworld = { pwm_signal = { input = \"A\", frequency = \"50 Hz\" } }\n\
         [[step]]\nat = \"1600ms\"\nexpect = { that = \"count.actions == 2\" }\n\
         [[step]]\nname = \"again\"\nat = \"2s\"\nevery = \"100ms\"\ncount = 3\noperator = { press = \"left\" }\n";
    let options = RunOptions {
        trace: true,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(scenario(&text(R150, "3s", actions)), None, options).unwrap();
    let mut trace = String::new();
    passes(run.play(&mut |line| trace += line).unwrap());
    let events: Vec<String> = std::iter::from_fn(|| run.poll_event())
        .filter(|event| event.kind.code().name.starts_with("action_"))
        .map(|event| format!("{} {}", event.at, event.kind))
        .collect();
    let again = |at| format!("{at} step \"again\": operator press");
    let expected = [
        "1.000000 step \"p\": operator lock".to_owned(),
        "1.500000 step \"f\": world pwm_signal".to_owned(),
        "2.000000 step \"p\": operator lock, undone".to_owned(),
        again("2.000000"),
        again("2.100000"),
        again("2.200000"),
    ];
    assert_eq!(events, expected);
    let line = r#""code":"action_reverted","text":"step \"p\": operator lock, undone""#;
    assert!(trace.contains(line), "{trace}");
    // What the world refuses was not done.
    let gone = "[[step]]\nat = \"1s\"\nworld = { remove = \"b\" }\n".repeat(2);
    let brought = "[[step]]\nat = \"1s\"\nworld = { add = { circle = [{ name = \"b\", at_m = [9, 0], radius = \"0.2 m\" }] } }\n";
    let outcome = r150("2s", &format!("{brought}{gone}"));
    fails(&outcome, "no obstacle");
    assert_eq!(outcome.devices[0].report.events["action_applied"].count, 2);
}

#[test]
fn the_world_changes() {
    passes(&r150(
        "4s",
        &format!(
            "{DRIVE}\
             [[step]]\nat = \"0s\"\nworld = {{ add = {{ wall = [{{ points_m = [[1, -2], [1, 2]], thickness = \"10 cm\" }}] }} }}\n\
             [[step]]\nat = \"0s\"\nhost = {{ send = {{ power_control = {{ on = [\"48v\"] }} }} }}\n\
             [[step]]\nat = \"500ms\"\nfor = \"1s\"\nfault = {{ kind = \"rail-load\", rail = \"48v\", power = \"100 W\" }}\n\
             [[step]]\nat = \"1s\"\nexpect = {{ that = \"rail.v48_a > 1.5 && rail.v48_a < 2.5\" }}\n\
             [[step]]\nat = \"1.6s\"\nexpect = {{ that = \"rail.v48_a == 0\" }}\n\
             [[step]]\nat = \"1s\"\nworld = {{ pwm_signal = {{ input = \"B\", frequency = \"1 kHz\", duty = \"25 %\" }} }}\n\
             [[step]]\nat = \"3.9s\"\nhost = {{ send = \"get_pwm_inputs\", expect = {{ within = \"20ms\", reply = {{ frequency_hz = [0, 1000, 0, 0] }} }} }}\n\
             [[step]]\nat = \"3.9s\"\nexpect = {{ that = \"truth.collisions > 0 && truth.x_m < 1\" }}\n"
        ),
    ));
}

#[test]
fn obstacles_come_move_and_go() {
    let person =
        "world = { add = { circle = [{ name = \"person\", at_m = [1, 0], radius = \"0.2 m\" }] } }";
    let near = "truth.x_m == 0 && sensor.front2_m < 1";
    passes(&car(
        "8s",
        &format!(
            "[[step]]\nat = \"0.9s\"\nexpect = {{ that = \"!({near})\" }}\n\
             [[step]]\nname = \"comes\"\nat = \"1s\"\nfor = \"3s\"\n{person}\n\
             [[step]]\nat = \"1.5s\"\nexpect = {{ that = \"{near}\" }}\n\
             [[step]]\nat = \"2s\"\nfor = \"500ms\"\nworld = {{ move = {{ obstacle = \"person\", x = \"-1 m\", y = \"0 m\" }} }}\n\
             [[step]]\nat = \"2.2s\"\nexpect = {{ that = \"!({near}) && sensor.rear2_m < 1\" }}\n\
             [[step]]\nat = \"2.8s\"\nexpect = {{ that = \"{near}\" }}\n\
             [[step]]\nat = \"3s\"\nfor = \"500ms\"\nworld = {{ remove = \"person\" }}\n\
             [[step]]\nat = \"3.2s\"\nexpect = {{ that = \"!({near})\" }}\n\
             [[step]]\nat = \"3.8s\"\nexpect = {{ that = \"{near}\" }}\n\
             [[step]]\nafter = \"comes\"\ndelay = \"200ms\"\nexpect = {{ that = \"!({near})\" }}\n\
             [[step]]\nat = \"5s\"\n{person}\n\
             [[step]]\nat = \"6s\"\nworld = {{ remove = \"person\" }}\n"
        ),
    ));
    let twice = format!("[[step]]\nat = \"1s\"\n{person}\n").repeat(2);
    fails(&car("3s", &twice), "an obstacle named `person` already");
}

#[test]
fn a_gate_turns_and_turns_back() {
    let gate = "name = \"gate\", at_m = [1.5, 0], length = \"0.1 m\", width = \"1.6 m\"";
    let turn = "obstacle = \"gate\", x = \"1.5 m\", y = \"0 m\", heading = \"90 deg\"";
    passes(&car(
        "4s",
        &format!(
            "[[step]]\nat = \"1s\"\nworld = {{ add = {{ box = [{{ {gate} }}] }} }}\n\
             [[step]]\nat = \"2s\"\nfor = \"1s\"\nworld = {{ move = {{ {turn} }} }}\n\
             [[step]]\nat = \"1.5s\"\nexpect = {{ that = \"sensor.front2_m > 1\" }}\n\
             [[step]]\nat = \"2.5s\"\nexpect = {{ that = \"sensor.front2_m < 1\" }}\n\
             [[step]]\nat = \"3.5s\"\nexpect = {{ that = \"sensor.front2_m > 1\" }}\n"
        ),
    ));
}

#[test]
fn an_obstacle_that_is_not_there_is_refused_with_its_line() {
    let remove = "[[step]]\nat = \"1s\"\nworld = { remove = \"gaet\" }\n";
    let scenario = scenario(&text(CAR, "3s", remove));
    let world =
        "schema = 1\n[[box]]\nname = \"gate\"\nat_m = [2, 0]\nlength = \"1 m\"\nwidth = \"1 m\"\n";
    let world = Source {
        file: "w.toml",
        text: world,
    };
    let options = RunOptions::scripted(1);
    let error = Run::new(scenario, Some(world), options).err().unwrap();
    let error = error.to_string();
    assert!(
        error.starts_with("s.toml:10:") && error.contains("did you mean `gate`?"),
        "{error}"
    );
}

#[test]
fn ice_makes_the_way_longer() {
    let stopped_at = |step: &str| {
        let mut run = Run::new(
            scenario(&text(R150, "5s", &format!("{DRIVE}{step}"))),
            None,
            RunOptions::scripted(1),
        )
        .unwrap();
        run.play(&mut |_| {}).unwrap();
        run.rig().distance_m(0)
    };
    let dry = stopped_at("");
    let ice = "[[step]]\nat = \"1.9s\"\nfault = { kind = \"ice\", friction = 0.02 }\n";
    assert!(stopped_at(ice) > dry + 0.05);
    let thawed =
        "[[step]]\nat = \"3.5s\"\nfor = \"1s\"\nfault = { kind = \"ice\", friction = 0.02 }\n";
    // Looking again whether it can stand moves a resting vehicle by less than a hair.
    assert!((stopped_at(thawed) - dry).abs() < 1e-5);
}

#[test]
fn a_host_speaks_in_the_byte_order_of_the_car() {
    // Read the other way round, 1 would be 256, and 5 to 6 tenths of a revolution would be thousands.
    let steps = "[[step]]\nname = \"pose\"\nat = \"100ms\"\nhost = { send = { set_pose = { axis_x = 1, axis_y = -2, ori = 900 } }, expect = { within = \"250ms\", reply = { axis_x = 1, axis_y = -2, ori = 900 } } }\n\
         [[step]]\nafter = \"pose\"\nexpect = { that = \"reported.axis_x == 1 && reported.axis_y == -2 && reported.ori_deg == 90\" }\n\
         [[step]]\nname = \"ahead\"\nafter = \"pose\"\nhost = { send = { motion = { moving_idx = 0, s = 5, v = 300 } }, expect = { within = \"3s\", reply = { moto_state = 0, axis_y = { min = 3, max = 4 }, mile = { min = 150, max = 180 } } } }\n\
         [[step]]\nafter = \"ahead\"\nexpect = { that = \"count.motion_done == 1 && abs(truth.x_m - 0.157) < 0.02\" }\n";
    for order in ["little", "big"] {
        let settings = format!("settings = {{ byte_order = \"{order}\" }}\n");
        passes(&car("6s", &(settings + steps)));
    }
}

#[test]
fn a_car_is_driven_on_both_links_and_by_its_remote_control() {
    passes(&car(
        "8s",
        "[[step]]\nat = \"100ms\"\nhost = { send = { motion = { moving_idx = 0, s = 10, v = 300 } } }\n\
         [[step]]\nat = \"200ms\"\nexpect = { that = \"motion.running\", within = \"100ms\" }\n\
         [[step]]\nname = \"done\"\nwhen = \"count.motion_done == 1\"\nexpect = { that = \"truth.x_m > 0.2\" }\n\
         [[step]]\nafter = \"done\"\nhost = { expect = { within = \"1s\", reply = { mile = { min = 200 } } } }\n\
         [[step]]\nname = \"line\"\nafter = \"done\"\ndelay = \"100ms\"\nhost = { send = { line = \"X-10\" }, expect = { within = \"300ms\", reply = { mileage = { min = 0 } } } }\n\
         [[step]]\nat = \"5s\"\nhost = { send = { control_mode = { mode = 1 } } }\n\
         [[step]]\nat = \"5.5s\"\nfor = \"500ms\"\noperator = { press = \"strafe-left\" }\n\
         [[step]]\nat = \"6s\"\nexpect = { that = \"mode.remote && truth.y_m > 0.01\" }\n",
    ));
}

#[test]
fn a_step_can_wait_for_a_condition_and_for_another_step() {
    passes(&r150(
        "4s",
        &format!(
            "{DRIVE}\
             [[step]]\nname = \"fast\"\nwhen = \"truth.speed_mps > 0.3\"\nexpect = {{ that = \"truth.speed_mps < 0.4\" }}\n\
             [[step]]\nafter = \"fast\"\ndelay = \"100ms\"\nexpect = {{ that = \"t > 0.2\" }}\n\
             [[step]]\nafter = \"stop\"\nexpect = {{ that = \"truth.at_rest\", within = \"1s\" }}\n"
        ),
    ));
}

#[test]
fn repetition_goes_on_for_a_time_a_count_or_without_end() {
    let beats = |more: &str, count: u32| {
        passes(&r150(
            "2s",
            &format!(
                "[[step]]\nname = \"beat\"\nat = \"100ms\"\nevery = \"100ms\"\n{more}host = {{ send = \"heartbeat\" }}\n\
                 [[step]]\nat = \"1.95s\"\nexpect = {{ that = \"count.requests == {count}\" }}\n"
            ),
        ));
    };
    beats("count = 3\n", 3);
    beats("for = \"500ms\"\n", 5);
    beats("", 19);
    beats("probability = 0\n", 0);
    beats("probability = 1\n", 19);
}

#[test]
fn chance_depends_on_the_seed_and_on_the_step_s_name_alone() {
    let heard = |seed, before: &str, name: &str| {
        let more = format!(
            "{before}[[step]]\nname = \"{name}\"\nat = \"100ms\"\nevery = \"20ms\"\nprobability = 0.5\nhost = {{ send = \"heartbeat\" }}\n"
        );
        play(&text(R150, "4s", &more), seed).devices[0]
            .report
            .requests
    };
    let other = "[[step]]\nname = \"other\"\nat = \"1s\"\nevery = \"1s\"\nprobability = 0.5\noperator = \"autonomous\"\n";
    assert_eq!(heard(1, "", "a"), heard(1, other, "a"));
    let all: std::collections::BTreeSet<u64> = (0..8).map(|seed| heard(seed, "", "a")).collect();
    assert!(all.len() > 2, "{all:?}");
    assert!(all.iter().all(|count| (60..140).contains(count)), "{all:?}");
}

#[test]
fn what_never_begins_fails_unless_it_may() {
    let never = |more: &str| {
        r150(
            "1s",
            &format!("[[step]]\nname = \"x\"\n{more}operator = \"lock\"\n"),
        )
    };
    fails(&never("when = \"t > 2\"\n"), "`t > 2` never held");
    passes(&never("when = \"t > 2\"\noptional = true\n"));
    passes(&never("when = \"t > 2\"\nonly = \"live\"\n"));
    let chained = r150(
        "1s",
        "[[step]]\nname = \"y\"\nat = \"500ms\"\nexpect = { that = \"t > 0\" }\n\
         [[step]]\nafter = \"y\"\ndelay = \"2s\"\noperator = \"lock\"\n",
    );
    fails(&chained, "or not 2s before the end");
}

#[test]
fn steps_of_one_instant_come_in_the_order_of_the_file_and_before_anything_else() {
    // The watchdog would fire at 0.6 s; the command that arrives then is in time, and the button
    // that comes first in the file is pressed first.
    let order = |first: &str, second: &str| {
        let step = |what: &str| format!("[[step]]\nat = \"500ms\"\noperator = \"{what}\"\n");
        let more = format!("{}{}", step(first), step(second));
        let mut run = Run::new(
            scenario(&text(R150, "1s", &more)),
            None,
            RunOptions::scripted(1),
        )
        .unwrap();
        run.play(&mut |_| {}).unwrap();
        let locked = run
            .rig()
            .device::<rigsim_core::r150::R150>(0)
            .unwrap()
            .device
            .vehicle()
            .locked;
        let events: Vec<_> = std::iter::from_fn(|| run.poll_event())
            .filter(|event| event.kind.code().name == "operated")
            .map(|event| (event.at, event.kind.to_string()))
            .collect();
        (locked, events)
    };
    let (locked, events) = order("lock", "unlock");
    assert!(!locked);
    let at = SimTime::from_millis(500);
    let event = |what: &str| (at, format!("operator: {what}"));
    assert_eq!(events, [event("lock"), event("unlock")]);
    assert!(order("unlock", "lock").0);
}

#[test]
fn a_command_at_the_instant_of_a_deadline_comes_before_it() {
    let text = text(
        R150,
        "2s",
        "[[step]]\nat = \"100ms\"\nhost = { send = { set_motors = { right = 300, left = 300 } } }\n\
         [[step]]\nat = \"600ms\"\nhost = { send = { set_motors = { right = 300, left = 300 } } }\n\
         [[step]]\nat = \"600ms\"\nhost = { send = { set_motors = { right = 0, left = 0 } } }\n\
         [[never]]\nthat = \"count.watchdog_fired > 0\"\nuntil = \"1s\"\n",
    );
    let options = RunOptions {
        wire: Wire::Instant,
        ..RunOptions::scripted(1)
    };
    let mut run = Run::new(scenario(&text), None, options).unwrap();
    passes(run.play(&mut |_| {}).unwrap());
}

#[test]
fn steps_that_set_one_another_off_within_an_instant_end() {
    let chain: String = (0..500)
        .map(|i| {
            let when = match i {
                0 => "at = \"100ms\"".to_owned(),
                i => format!("after = \"s{}\"", i - 1),
            };
            format!("[[step]]\nname = \"s{i}\"\n{when}\nexpect = {{ that = \"t >= 0.1\" }}\n")
        })
        .collect();
    let end = "[[step]]\nafter = \"s499\"\nexpect = { that = \"t == 0.1\" }\n";
    passes(&r150("1s", &format!("{chain}{end}")));
}

#[test]
fn a_repeated_step_is_done_when_its_time_is_over() {
    passes(&r150(
        "2s",
        "[[step]]\nname = \"a\"\nat = \"100ms\"\nevery = \"300ms\"\nfor = \"1s\"\nhost = { send = \"heartbeat\" }\n\
         [[step]]\nafter = \"a\"\nexpect = { that = \"t == 1.1 && count.requests == 4\" }\n\
         [[step]]\nname = \"b\"\nat = \"100ms\"\nevery = \"300ms\"\ncount = 2\noperator = \"autonomous\"\n\
         [[step]]\nafter = \"b\"\nexpect = { that = \"t == 0.4\" }\n",
    ));
}

#[test]
fn a_run_can_be_stopped_after_any_instant() {
    let dense = "[[step]]\nat = \"1ms\"\nevery = \"1ns\"\nhost = { send = \"heartbeat\" }\n";
    let options = RunOptions::scripted(1);
    let mut run = Run::new(scenario(&text(R150, "1s", dense)), None, options).unwrap();
    run.advance(SimTime::from_millis(1)).unwrap();
    for _ in 0..100 {
        let before = run.rig().now();
        assert!(run.step(SimTime::MAX).unwrap());
        assert_eq!(run.rig().now(), before + NANOSECOND);
    }
    let here = run.rig().now();
    assert!(
        !run.step(here).unwrap(),
        "nothing is left until the present"
    );
}
