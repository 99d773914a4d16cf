use super::*;
use crate::condition::Reading;
use rigsim_core::r150::R150 as R150Unit;
use rigsim_core::r150_device::vehicle::{Key, OperatorInput};

/// Steps of `text` in lines: each a time, one for how long or nothing, and what is done.
fn steps(lines: &[(&str, &str, &str)]) -> String {
    let step = |(at, lasts, what): &(&str, &str, &str)| {
        let lasts = match *lasts {
            "" => String::new(),
            lasts => format!("for = \"{lasts}\"\n"),
        };
        format!("[[step]]\nat = \"{at}\"\n{lasts}{what}\n")
    };
    lines.iter().map(step).collect()
}

fn expect(that: &str) -> String {
    format!("expect = {{ that = \"{that}\" }}")
}

/// The value of an expression in a run.
#[track_caller]
fn value(run: &Run, expression: &str) -> Reading {
    run.value(expression).unwrap()
}

/// A run of one device that goes on until it is ended.
fn served(device: &str) -> Run {
    let last = "[[step]]\nname = \"last\"\nat = \"999s\"\n";
    let text = text(device, "1000 s", last);
    Run::new(scenario(&text), None, RunOptions::scripted(1)).unwrap()
}

/// Adds steps one by one, and clears them in this order; tells what an expression is before, after
/// each was added, and after each was cleared.
#[track_caller]
fn values(run: &mut Run, expression: &str, added: &[&str], cleared: &[usize]) -> Vec<Reading> {
    let mut values = vec![value(run, expression)];
    let mut indices = Vec::new();
    for step in added {
        indices.push(run.add_step(step).unwrap());
        values.push(value(run, expression));
    }
    for place in cleared {
        run.clear_step(indices[*place]).unwrap();
        values.push(value(run, expression));
    }
    values
}

#[track_caller]
fn flags(device: &str, flag: &str, added: &[&str], cleared: &[usize], expected: &str) {
    let mut run = served(device);
    let found = values(&mut run, flag, added, cleared);
    let found: String = found
        .iter()
        .map(|value| match value {
            Reading::Flag(true) => '1',
            Reading::Flag(false) => '0',
            Reading::Number(_) => '?',
        })
        .collect();
    assert_eq!(found, expected, "{flag} {added:?} {cleared:?}");
}

#[test]
fn what_was_before_comes_back_when_a_step_ends() {
    let during = expect("truth.mass_kg == 180");
    let after = expect("truth.mass_kg == 130");
    let lines = [
        (
            "0.5s",
            "1s",
            "fault = { kind = \"payload\", mass = \"50 kg\" }\noptional = true",
        ),
        ("1s", "", during.as_str()),
        ("2s", "", after.as_str()),
    ];
    passes(&r150("3s", &steps(&lines)));

    let unlocked = expect("!mode.locked");
    let lines = [
        ("0.5s", "1s", "operator = \"unlock\""),
        ("2s", "", unlocked.as_str()),
    ];
    passes(&r150("3s", &steps(&lines)));

    let pushed_in = expect("mode.emergency_stop");
    let lines = [
        ("0.5s", "", "operator = { emergency_stop = true }"),
        ("1s", "1s", "operator = { emergency_stop = true }"),
        ("3s", "", pushed_in.as_str()),
    ];
    passes(&r150("4s", &steps(&lines)));

    let slides = expect("truth.speed_mps > 0.1");
    let lines = [
        ("0s", "", "operator = { emergency_stop = true }"),
        (
            "0.5s",
            "",
            "fault = { kind = \"push\", ahead = \"2000 N\" }",
        ),
        (
            "1s",
            "200ms",
            "fault = { kind = \"push\", left = \"50 N\" }",
        ),
        ("5s", "", slides.as_str()),
    ];
    passes(&r150("6s", &steps(&lines)));
}

#[test]
fn friction_for_a_while_gives_way_to_friction_for_good() {
    let drive = "[[step]]\nat = \"1s\"\nevery = \"50ms\"\nfor = \"2s\"\n\
        host = { send = { set_motors = { right = 1000, left = 1000 } } }\n\
        [[never]]\nthat = \"truth.speed_mps > 0.6\"\n";
    let slippery = [("100ms", "", "fault = { kind = \"ice\", friction = 0.02 }")];
    let both = [
        slippery[0],
        (
            "300ms",
            "200ms",
            "fault = { kind = \"ice\", friction = 0.3 }\noptional = true",
        ),
    ];
    passes(&r150("3s", &format!("{}{drive}", steps(&slippery))));
    passes(&r150("3s", &format!("{}{drive}", steps(&both))));
    assert!(
        !r150("3s", drive).passed,
        "it is the friction that holds it back"
    );
}

/// Whichever order they are cleared in: the latest in effect counts, and after all it is as before.
#[test]
fn clearing_brings_back_what_is_below() {
    let stop_in = "operator = { emergency_stop = true }";
    let stop_out = "operator = { emergency_stop = false }";
    let (lock, unlock) = ("operator = \"lock\"", "operator = \"unlock\"");
    let stop = "mode.emergency_stop";
    flags(R150, stop, &[stop_in, stop_out], &[0, 1], "01000");
    flags(R150, stop, &[stop_in, stop_out], &[1, 0], "01010");
    flags(R150, stop, &[stop_out], &[0], "000");
    flags(R150, stop, &[stop_out, stop_in], &[0, 1], "00110");
    flags(R150, stop, &[stop_in, stop_in], &[0, 1], "01110");
    flags(R150, "mode.locked", &[lock, unlock], &[0, 1], "01000");
    flags(R150, "mode.locked", &[lock, unlock], &[1, 0], "01010");
    flags(R150, "mode.locked", &[unlock, lock], &[0, 1], "00110");
    flags(R150, "mode.locked", &[unlock], &[0], "000");
    let locked = "[[device]]\nkind = \"r150\"\nstart = \"locked\"\n";
    flags(locked, "mode.locked", &[unlock], &[0], "101");
    flags(locked, "mode.locked", &[lock, unlock], &[0, 1], "11001");
    flags(locked, "mode.locked", &[lock], &[0], "111");
    let on = "operator = { app_sets = { on = [\"12v-a\"] } }";
    let off = "operator = { app_sets = {} }";
    flags(R150, "rail.v12a_on", &[on, off], &[1, 0], "01010");
    flags(R150, "rail.v12a_on", &[on, off], &[0, 1], "01000");
}

#[test]
fn actions_that_change_the_same_lie_over_one_another() {
    let (lock, park) = ("operator = \"lock\"", "operator = \"park\"");
    let stop_in = "operator = { emergency_stop = true }";
    let cases = [
        ("mode.emergency_stop", [stop_in, stop_in]),
        ("mode.locked", [lock, lock]),
        ("mode.parked", [lock, park]),
        ("mode.parked", [park, lock]),
    ];
    for (flag, steps) in cases {
        flags(R150, flag, &steps, &[0, 1], "01110");
        flags(R150, flag, &steps, &[1, 0], "01110");
    }
}

#[test]
fn what_the_app_and_the_remote_control_hold_goes_back_to_what_it_was() {
    let now = |run: &Run| {
        let r150 = &run.rig().device::<R150Unit>(0).unwrap().device;
        let held = r150.control().held_by_app;
        (r150.vehicle().key_input(), [held.power, held.pwm])
    };
    // The state with the first, with both, with one alone, and with none again.
    let states = |steps: [&str; 2], cleared: [usize; 2]| {
        let mut run = served(R150);
        let indices = steps.map(|step| {
            let index = run.add_step(step).unwrap();
            (index, now(&run))
        });
        let ends = cleared.map(|place| {
            run.clear_step(indices[place].0).unwrap();
            now(&run)
        });
        let autonomous = &run.rig().device::<R150Unit>(0).unwrap().device;
        assert!(autonomous.vehicle().autonomous, "{steps:?}");
        [indices[0].1, indices[1].1, ends[0], ends[1]]
    };
    let let_go = OperatorInput::ReleaseKey;
    let power = "operator = { app_holds = { power = true } }";
    let all = "operator = { app_holds = { power = true, pwm = true } }";
    let app = |held: [[bool; 2]; 4]| held.map(|held| (let_go, held));
    let (half, whole, none) = ([true, false], [true; 2], [false; 2]);
    assert_eq!(
        states([power, all], [0, 1]),
        app([half, whole, whole, none])
    );
    assert_eq!(states([power, all], [1, 0]), app([half, whole, half, none]));
    let [ahead, left] =
        ["forward", "left"].map(|key| format!("operator = {{ press = \"{key}\" }}"));
    let keys = |keys: [OperatorInput; 4]| keys.map(|key| (key, none));
    let (forward, left_key) = (
        OperatorInput::Press(Key::Forward),
        OperatorInput::Press(Key::Left),
    );
    let steps = [ahead.as_str(), &left];
    assert_eq!(
        states(steps, [0, 1]),
        keys([forward, left_key, left_key, let_go])
    );
    assert_eq!(
        states(steps, [1, 0]),
        keys([forward, left_key, forward, let_go])
    );
}

#[test]
fn of_three_loads_the_latest_in_effect_counts() {
    let load = ["20", "50", "70"].map(|watts| {
        format!("fault = {{ kind = \"rail-load\", rail = \"48v\", power = \"{watts} W\" }}")
    });
    let load: Vec<&str> = load.iter().map(String::as_str).collect();
    let orders: [([usize; 3], [f64; 3]); 6] = [
        ([0, 1, 2], [70.0, 70.0, 0.0]),
        ([0, 2, 1], [70.0, 50.0, 0.0]),
        ([1, 0, 2], [70.0, 70.0, 0.0]),
        ([1, 2, 0], [70.0, 20.0, 0.0]),
        ([2, 0, 1], [50.0, 50.0, 0.0]),
        ([2, 1, 0], [50.0, 20.0, 0.0]),
    ];
    for (order, after) in orders {
        let mut run = served(R150);
        run.add_step("operator = { app_sets = { on = [\"48v\"] } }")
            .unwrap();
        let watts = "rail.v48_a * rail.v48_v";
        let found = values(&mut run, watts, &load, &order);
        let expected = [0.0, 20.0, 50.0, 70.0].into_iter().chain(after);
        for (found, expected) in found.iter().zip(expected) {
            let Reading::Number(found) = found else {
                panic!("{found:?}");
            };
            assert!(
                (found - expected).abs() < 0.01,
                "{order:?}: {found} {expected}"
            );
        }
    }
}

#[test]
fn payloads_add_up() {
    let payload =
        ["20", "50"].map(|kg| format!("fault = {{ kind = \"payload\", mass = \"{kg} kg\" }}"));
    let payload: Vec<&str> = payload.iter().map(String::as_str).collect();
    for (order, between) in [([0, 1], 50.0), ([1, 0], 20.0)] {
        let mut run = served(R150);
        let found = values(&mut run, "truth.mass_kg", &payload, &order);
        let expected = [0.0, 20.0, 70.0, between, 0.0];
        assert_eq!(
            found,
            expected.map(|kg| Reading::Number(130.0 + kg)),
            "{order:?}"
        );
    }
}

#[test]
fn a_repeated_action_lies_there_once() {
    let mut run = served(R150);
    let repeated = "every = \"10ms\"\ncount = 3\noperator = \"lock\"";
    let index = run.add_step(repeated).unwrap();
    run.advance(SimTime::from_nanos(100_000_000)).unwrap();
    assert_eq!(value(&run, "mode.locked"), Reading::Flag(true));
    run.clear_step(index).unwrap();
    assert_eq!(value(&run, "mode.locked"), Reading::Flag(false));
}

#[test]
fn keys_and_obstacles_lie_over_one_another_too() {
    let key = |flag: &str| format!("expect = {{ that = \"{flag}\" }}");
    let (ahead, back, stands) = (
        key("truth.forward_mps > 0.05"),
        key("truth.forward_mps < -0.05"),
        key("abs(truth.forward_mps) < 0.01"),
    );
    let lines = [
        (
            "0.2s",
            "",
            "host = { send = { control_mode = { mode = 1 } } }",
        ),
        ("1s", "", "operator = { press = \"forward\" }"),
        ("2s", "1s", "operator = { press = \"backward\" }"),
        ("2.9s", "", back.as_str()),
        ("4s", "", ahead.as_str()),
        ("4.5s", "2s", "operator = { press = \"backward\" }"),
        ("5s", "", "operator = \"release\""),
        ("6.4s", "", stands.as_str()),
        ("7.5s", "", stands.as_str()),
    ];
    passes(&car("8s", &steps(&lines)));

    let (near, far) = (
        expect("sensor.front2_m < 1"),
        expect("sensor.front2_m > 1 && sensor.rear2_m > 1"),
    );
    let add =
        "world = { add = { circle = [{ name = \"person\", at_m = [1, 0], radius = \"0.2 m\" }] } }";
    let away = "world = { move = { obstacle = \"person\", x = \"9 m\", y = \"0 m\" } }";
    let lines = [
        ("1s", "", add),
        ("2s", "2s", away),
        ("3s", "2s", "world = { remove = \"person\" }"),
        ("4.5s", "", far.as_str()),
        // It was moved when it was taken away, which is over by now.
        ("5.5s", "", near.as_str()),
    ];
    passes(&car("6s", &steps(&lines)));
}
