//! Hardware of the R150, and people.

use super::*;
use crate::r150_device::vehicle::{Key, OperatorInput};

const AB: u32 = 1;

fn seen_status(fault: &str) -> (SystemInfo, SystemInfo) {
    let mut rig = r150();
    power(&mut rig, 0b11_1111);
    let handle = inject(&mut rig, fault);
    run(&mut rig, MAIN, MS(500));
    let during = info(&mut rig);
    rig.clear(handle);
    run(&mut rig, MAIN, MS(500));
    // Off and on again ends the latch of whatever has tripped.
    power(&mut rig, 0);
    power(&mut rig, 0b11_1111);
    (during, info(&mut rig))
}

#[test]
fn a_load_that_is_too_much_trips_and_one_that_is_not_shows_as_current() {
    let load = "kind = \"rail-load\"\nrail = \"12v-a\"\n";
    let (during, after) = seen_status(&format!("{load}power = \"400 W\""));
    assert_eq!((during.sys_status, during.power_status), (AB, 0b11_1100));
    assert_eq!((after.sys_status, after.power_status), (0, 0b11_1111));
    for draws in ["power = \"24 W\"", "resistance = \"6 ohm\""] {
        let (during, after) = seen_status(&format!("{load}{draws}"));
        assert!((1900..2100).contains(&during.current_12v[0]), "{during:?}");
        assert!((400..430).contains(&after.current_12v[0]), "{after:?}");
    }
}

#[test]
fn a_short_on_any_output_trips_it_and_an_open_one_draws_nothing() {
    for (rail, bit) in [
        ("12v-a", 0),
        ("12v-b", 0),
        ("12v-c", 1),
        ("12v-d", 1),
        ("48v", 2),
        ("5v", 3),
    ] {
        let (during, after) = seen_status(&format!("kind = \"rail-short\"\nrail = \"{rail}\""));
        assert_eq!(during.sys_status, 1 << bit, "{rail}");
        assert_eq!((after.sys_status, after.power_status), (0, 0b11_1111));
    }
    let (during, _) = seen_status("kind = \"rail-load\"\nrail = \"48v\"\npower = \"0 W\"");
    assert_eq!(during.power_status, 0b11_1111);
    assert!(during.current_48v.unsigned_abs() <= NOISE, "{during:?}");
}

#[test]
fn a_fault_lies_over_a_load_that_changes_meanwhile() {
    let mut rig = r150();
    power(&mut rig, 0b11_1111);
    let short = inject(
        &mut rig,
        "kind = \"rail-load\"\nrail = \"48v\"\npower = \"0 W\"",
    );
    rig.with_device(0, |r150: &mut R150, _, _| {
        r150.plant.set_load(Rail::V48, Load::Power(100.0));
    });
    assert!(info(&mut rig).current_48v.unsigned_abs() <= NOISE);
    rig.clear(short);
    assert!(info(&mut rig).current_48v > 1900);
}

#[test]
fn the_supply_sags_and_the_module_gives_up() {
    let (during, after) = seen_status("kind = \"supply-sag\"\nby = \"5 V\"");
    assert!((after.voltage_48v - during.voltage_48v).abs_diff(5000) < 300);
    assert_eq!(during.sys_status, 0);
    let (during, after) = seen_status("kind = \"supply-sag\"\nby = \"15 V\"");
    assert_eq!((during.sys_status, during.power_status), (1 << 6, 0));
    assert_eq!(after.sys_status, 0);
}

#[test]
fn a_supply_that_breaks_down_under_the_load_comes_and_goes_with_the_steps_and_no_faster() {
    let mut rig = r150();
    rig.detach(MAIN, SimTime::ZERO).unwrap();
    inject(
        &mut rig,
        "kind = \"supply-sag\"\nby = \"12 V\"\nresistance = \"10 ohm\"",
    );
    // The key is held down however often the module starts again.
    rig.with_device(0, |r150: &mut R150, _, now| {
        r150.device.operate(now, OperatorInput::Press(Key::Forward))
    });
    let steps = 200;
    rig.advance(SimTime::ZERO + rig.world().step_length() * steps)
        .unwrap();
    let events: Vec<Event> = std::iter::from_fn(|| rig.poll_event()).collect();
    let count = |code| events.iter().filter(|e| e.kind.code().name == code).count();
    let most = usize::try_from(steps).unwrap() + 2;
    for code in ["power_lost", "started"] {
        assert!((2..=most).contains(&count(code)), "{} {code}", count(code));
    }
}

#[test]
fn heat_a_module_fault_and_an_empty_battery_show_in_the_status() {
    let (during, after) = seen_status("kind = \"over-temperature\"\npair = \"ab\"");
    assert_eq!((during.temp_12v[0], during.sys_status), (950, 1 << 4));
    assert_eq!(during.power_status, 0b11_1100);
    assert!(
        after.temp_12v[0] < 300 && after.sys_status == 0,
        "{after:?}"
    );
    let (during, after) = seen_status("kind = \"power-module-fault\"");
    assert_eq!((during.sys_status, during.power_status), (1 << 6, 0));
    assert_eq!((after.sys_status, after.power_status), (0, 0b11_1111));
    let (during, after) = seen_status("kind = \"charge-drop\"\nby = \"30 %\"");
    assert!(during.voltage_48v + 1500 < after.voltage_48v);
}

#[test]
fn an_empty_battery_stops_the_motors() {
    let mut rig = r150();
    let soc = |rig: &mut Rig| match replies(
        rig,
        Request::SetMotors {
            right: 500,
            left: 500,
        },
    )[..]
    {
        [Reply::Motors(motors)] => motors.soc,
        ref other => panic!("{other:?}"),
    };
    drive(&mut rig, 500, 500, 20);
    let handle = inject(&mut rig, "kind = \"charge-drop\"\nby = \"100 %\"");
    assert_eq!(drive(&mut rig, 500, 500, 40), [0, 0]);
    run(&mut rig, MAIN, MS(50));
    assert_eq!(soc(&mut rig), 0);
    rig.clear(handle);
    run(&mut rig, MAIN, MS(50));
    assert!(soc(&mut rig) > 790);
    assert!(drive(&mut rig, 500, 500, 20)[0] > 300);
}

#[test]
fn a_blown_fuse_stops_a_side_or_silences_the_module() {
    let mut rig = r150();
    let handle = inject(&mut rig, "kind = \"fuse-blown\"\nfuse = \"motor-left\"");
    let dragged = drive(&mut rig, 500, 500, 20);
    let truth = rig.device::<R150>(0).unwrap().truth();
    assert!(truth.motor_current.left == 0.0 && truth.motor_current.right > 1.0);
    rig.clear(handle);
    let whole = drive(&mut rig, 500, 500, 20);
    assert!(dragged[1] + 10 < whole[1], "{dragged:?} {whole:?}");
    let handle = inject(&mut rig, "kind = \"fuse-blown\"\nfuse = \"tail\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    rig.clear(handle);
    assert_eq!(replies(&mut rig, Request::Heartbeat).len(), 1);
}

#[test]
fn sides_that_are_blocked_dragged_free_or_braked() {
    let speeds = |fault: &str| {
        let mut rig = r150();
        drive(&mut rig, 0, 0, 2);
        let handle = inject(&mut rig, fault);
        let during = drive(&mut rig, 400, 400, 20);
        assert!(rig.hits(handle) > 0, "{fault}");
        rig.clear(handle);
        let after = drive(&mut rig, 400, 400, 20);
        assert!(
            after[0] > 450 && after[0].abs_diff(after[1]) < 30,
            "{fault} {after:?}"
        );
        during
    };
    let sound = speeds("kind = \"payload\"\nmass = \"0 kg\"");
    assert_eq!(speeds("kind = \"blocked\"\nmotors = \"left\"")[1], 0);
    let [_, left] = speeds("kind = \"dragging\"\nmotors = \"left\"\ntorque = \"150 N*m\"");
    assert!(left + 40 < sound[1], "{left} {sound:?}");
    let [_, left] = speeds("kind = \"free-wheeling\"\nmotors = \"left\"");
    assert!(left + 10 < sound[1], "{left} {sound:?}");
    let [right, left] = speeds("kind = \"wired-backwards\"\nmotors = \"left\"");
    assert!(left < -200 && right > 200, "{left} {right}");
    let [right, left] = speeds("kind = \"brake-stuck-on\"");
    assert!(
        right < sound[0] / 2 && left < sound[1] / 2,
        "{left} {right}"
    );
}

#[test]
fn encoders_that_lie() {
    let mut rig = r150();
    drive(&mut rig, 400, 400, 20);
    let handle = inject(&mut rig, "kind = \"encoder-lost\"\nmotors = \"right\"");
    let [right, left] = drive(&mut rig, 400, 400, 10);
    assert!(right == 0 && left > 400);
    rig.clear(handle);
    let handle = inject(&mut rig, "kind = \"encoder-stuck\"\nmotors = \"right\"");
    let [right, left] = drive(&mut rig, 0, 0, 30);
    assert!(right > 400 && left == 0, "{right} {left}");
    rig.clear(handle);
    assert_eq!(drive(&mut rig, 0, 0, 5), [0, 0]);
    let handle = inject(&mut rig, "kind = \"encoder-noisy\"\nmotors = \"right\"");
    let noisy: Vec<[i16; 2]> = (0..10).map(|_| drive(&mut rig, 0, 0, 3)).collect();
    assert!(noisy.iter().any(|[right, _]| right.abs() > 10), "{noisy:?}");
    assert!(noisy.iter().all(|[_, left]| *left == 0));
    rig.clear(handle);
    assert_eq!(drive(&mut rig, 0, 0, 5), [0, 0]);
}

#[test]
fn swapped_sides_turn_the_other_way_and_look_right() {
    let turn = |swapped: bool| {
        let mut rig = r150();
        if swapped {
            inject(&mut rig, "kind = \"sides-swapped\"");
        }
        let speeds = drive(&mut rig, 500, -500, 30);
        (
            speeds,
            rig.device::<R150>(0).unwrap().truth().motion.yaw_rate,
        )
    };
    let ((speeds, rate), (swapped, wrong)) = (turn(false), turn(true));
    assert!(rate > 0.3 && wrong < -0.3, "{rate} {wrong}");
    assert!(speeds[0].abs_diff(swapped[0]) < 20 && speeds[1].abs_diff(swapped[1]) < 20);
}

#[test]
fn a_vehicle_that_cannot_hear_goes_on_and_stops_and_one_that_hears_late_follows_late() {
    let mut rig = r150();
    drive(&mut rig, 500, 500, 30);
    let speed = |rig: &Rig| rig.motion(0).unwrap().forward_speed;
    let before = speed(&rig);
    let handle = inject(&mut rig, "kind = \"can-failing\"");
    // The module answers, and the vehicle does not slow down; after half a second it stops.
    drive(&mut rig, 0, 0, 8);
    assert!(speed(&rig) > 0.9 * before);
    let speeds = drive(&mut rig, 500, 500, 20);
    assert!(speeds.iter().all(|rpm| rpm.abs() < 5), "{speeds:?}");
    rig.clear(handle);
    drive(&mut rig, 500, 500, 20);
    assert!(speed(&rig) > 0.9 * before);
    inject(&mut rig, "kind = \"can-failing\"\ndelay = \"400 ms\"");
    drive(&mut rig, 0, 0, 7);
    assert!(speed(&rig) > 0.9 * before);
    drive(&mut rig, 0, 0, 10);
    assert!(speed(&rig) < 0.1);
}

#[test]
fn ice_payload_and_push_change_how_it_moves() {
    let far = |fault: &str| {
        let mut rig = r150();
        inject(&mut rig, fault);
        drive(&mut rig, 800, 800, 20);
        rig.distance_m(0)
    };
    let plain = far("kind = \"payload\"\nmass = \"0 kg\"");
    assert!(far("kind = \"ice\"\nfriction = 0.03") < 0.7 * plain);
    assert!(far("kind = \"payload\"\nmass = \"500 kg\"") < 0.97 * plain);
    assert!(far("kind = \"push\"\nahead = \"300 N\"") > 1.005 * plain);
}

#[test]
fn with_a_brake_that_does_not_hold_a_parked_vehicle_can_be_pushed() {
    let pushed = |broken: bool| {
        let mut rig = r150();
        inject(&mut rig, "operator = \"park\"");
        inject(&mut rig, "kind = \"fuse-blown\"\nfuse = \"motor-left\"");
        inject(&mut rig, "kind = \"fuse-blown\"\nfuse = \"motor-right\"");
        if broken {
            inject(&mut rig, "kind = \"brake-stuck-open\"");
        }
        inject(&mut rig, "kind = \"push\"\nahead = \"500 N\"");
        run(&mut rig, MAIN, MS(3000));
        rig.distance_m(0)
    };
    assert!(pushed(false) < 0.05);
    assert!(pushed(true) > 0.3);
}

#[test]
fn operators_stop_it_and_give_it_back() {
    for fault in [
        "operator = { emergency_stop = true }",
        "operator = \"take_over\"",
        "operator = \"lock\"",
        "operator = \"park\"",
    ] {
        let mut rig = r150();
        drive(&mut rig, 500, 500, 20);
        let (one, other) = (inject(&mut rig, fault), inject(&mut rig, fault));
        assert_eq!((rig.hits(one), rig.hits(other)), (1, 0));
        run(&mut rig, MAIN, MS(3000));
        drive(&mut rig, 500, 500, 40);
        let stopped = rig.distance_m(0);
        drive(&mut rig, 500, 500, 10);
        assert!(rig.distance_m(0) < stopped + 0.05, "{fault}");
        rig.clear(one);
        drive(&mut rig, 500, 500, 10);
        assert!(
            rig.distance_m(0) < stopped + 0.1,
            "{fault}: the other holds"
        );
        rig.clear(other);
        drive(&mut rig, 500, 500, 20);
        assert!(rig.distance_m(0) > stopped + 0.2, "{fault}");
    }
}

#[test]
fn a_key_that_is_held_drives_it() {
    let mut rig = r150();
    let handle = inject(&mut rig, "operator = { press = \"backward\" }");
    run(&mut rig, MAIN, MS(1000));
    assert!(rig.device::<R150>(0).unwrap().truth().motion.forward_speed < -0.1);
    rig.clear(handle);
    run(&mut rig, MAIN, MS(1000));
    assert_eq!(
        rig.device::<R150>(0).unwrap().truth().motion.forward_speed,
        0.0
    );
}

#[test]
fn the_app_refuses_the_client_what_it_holds() {
    let mut rig = r150();
    power(&mut rig, 0b11_1111);
    let half = inject(&mut rig, "operator = { app_holds = { power = true } }");
    let whole = inject(
        &mut rig,
        "operator = { app_holds = { power = true, pwm = true } }",
    );
    let refused = Reply::Bool {
        command: 2,
        success: false,
    };
    assert_eq!(power(&mut rig, 1), [refused]);
    let seen = info(&mut rig);
    assert_eq!((seen.power_ctrl_mode, seen.pwm_ctrl_mode), (1, 1));
    assert_eq!(seen.power_status, 0);
    rig.clear(whole);
    let seen = info(&mut rig);
    assert_eq!((seen.power_ctrl_mode, seen.pwm_ctrl_mode), (1, 1));
    let duty = Request::SetPwmOutputs { duty: [0; 4] };
    ask(&mut rig, duty);
    let seen = info(&mut rig);
    assert_eq!((seen.power_ctrl_mode, seen.pwm_ctrl_mode), (1, 0));
    rig.clear(half);
    assert_ne!(power(&mut rig, 1), [refused]);
    assert_eq!(info(&mut rig).power_ctrl_mode, 0);
}

/// However the buttons are set to work, what an operator did is undone.
#[test]
fn operators_undo_what_the_settings_let_their_buttons_do() {
    let mut rig = r150_with(1, |s| {
        s.firmware.emergency_stop_locks = true;
    });
    for fault in [
        "operator = { emergency_stop = true }",
        "operator = \"take_over\"",
        "operator = \"lock\"",
        "operator = \"park\"",
    ] {
        let handle = inject(&mut rig, fault);
        run(&mut rig, MAIN, MS(100));
        rig.clear(handle);
        let vehicle = rig.device::<R150>(0).unwrap().device.vehicle();
        let left = vehicle.obstacles(false);
        assert_eq!(left, [], "{fault}");
        // Nothing drives of itself.
        let duty = rig.device::<R150>(0).unwrap().device.commands().motor_duty;
        assert_eq!([duty.right, duty.left], [0.0, 0.0], "{fault}");
    }
}

#[test]
fn the_app_still_holds_what_it_holds_when_the_module_has_restarted() {
    let mut rig = r150();
    let refused = Reply::Bool {
        command: 2,
        success: false,
    };
    let held = inject(
        &mut rig,
        "operator = { app_holds = { power = true, pwm = true } }",
    );
    inject(&mut rig, "kind = \"reset\"\nboot = \"100 ms\"");
    run(&mut rig, MAIN, MS(200));
    assert_eq!(power(&mut rig, 1), [refused]);
    rig.clear(held);
    assert_ne!(power(&mut rig, 1), [refused]);
}
