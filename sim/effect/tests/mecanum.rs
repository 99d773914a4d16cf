//! Hardware and sensors of the car.

use super::*;

fn truth(rig: &Rig) -> rigsim_physics::mecanum::MecanumTruth {
    rig.device::<Mecanum>(0).unwrap().truth()
}

#[test]
fn without_supply_it_is_silent_and_forgets() {
    let mut rig = car(false);
    assert!(roll(&mut rig, 0, 300, MS(1000)).axis_x > 0);
    let handle = inject(&mut rig, "kind = \"supply-lost\"");
    // What was on its way still comes.
    run(&mut rig, MAIN, MS(10));
    assert_eq!(run(&mut rig, MAIN, MS(1000)), NOTHING);
    rig.clear(handle);
    let seen = statuses(&run(&mut rig, MAIN, MS(500)));
    assert_eq!((seen[0].seq, seen[0].axis_x), (0, 0));
}

#[test]
fn wheels_that_do_not_do_what_they_should() {
    let wheel = |fault: &str| {
        let mut rig = car(false);
        let handle = inject(&mut rig, fault);
        roll(&mut rig, 0, 300, MS(1000));
        assert!(rig.hits(handle) > 0, "{fault}");
        let speed = truth(&rig).wheel_speed[0];
        rig.clear(handle);
        send(&mut rig, &motion(0, 5000, -300));
        run(&mut rig, MAIN, MS(300));
        let after = truth(&rig).wheel_speed;
        assert!(
            (after[0] / after[1] - 1.0).abs() < 0.1,
            "{fault}: {after:?}"
        );
        speed
    };
    let sound = wheel("kind = \"payload\"\nmass = \"0 kg\"");
    assert!(sound > 2.0);
    let front = "motors = \"left-front\"";
    assert!(wheel(&format!("kind = \"blocked\"\n{front}")).abs() < 1e-9);
    let dragged = wheel(&format!(
        "kind = \"dragging\"\n{front}\ntorque = \"500 N*m\""
    ));
    assert!(dragged < 0.8 * sound, "{dragged} {sound}");
    assert!(wheel(&format!("kind = \"wired-backwards\"\n{front}")) < -2.0);
    assert!(wheel(&format!("kind = \"brake-stuck-on\"\n{front}")).abs() < 0.1 * sound);
}

#[test]
fn a_free_wheel_is_dragged_along() {
    let mut rig = car(false);
    inject(&mut rig, "kind = \"free-wheeling\"\nmotors = \"all\"");
    roll(&mut rig, 0, 300, MS(1000));
    assert!(rig.distance_m(0) < 0.01);
}

#[test]
fn encoders_that_lie() {
    let mut rig = car(false);
    let handle = inject(&mut rig, "kind = \"encoder-lost\"\nmotors = \"all\"");
    let seen = roll(&mut rig, 0, 300, MS(1000));
    assert_eq!((seen.axis_x, seen.v_x), (0, 0));
    assert!(rig.distance_m(0) > 0.05);
    rig.clear(handle);
    let handle = inject(&mut rig, "kind = \"encoder-stuck\"\nmotors = \"all\"");
    let seen = roll(&mut rig, 0, -300, MS(1000));
    assert_eq!(seen.axis_x, 0);
    rig.clear(handle);
    assert!(status(&mut rig).axis_x < -3, "they come all at once");
    let before = status(&mut rig).mile;
    let handle = inject(&mut rig, "kind = \"encoder-noisy\"\nmotors = \"left\"");
    run(&mut rig, MAIN, MS(3000));
    let after = status(&mut rig).mile;
    assert!(after > before, "it stands and thinks that it rolls");
    assert!(rig.hits(handle) > 10);
}

#[test]
fn swapped_ports_move_it_otherwise_and_do_not_make_the_counters_jump() {
    let mut rig = car(false);
    roll(&mut rig, 1, 200, MS(500));
    run(&mut rig, MAIN, MS(1000));
    let before = status(&mut rig).mile;
    let handle = inject(
        &mut rig,
        "kind = \"ports-swapped\"\nport = \"x\"\nwith = \"y\"",
    );
    assert_eq!(status(&mut rig).mile, before);
    let heading = truth(&rig).motion.pose.heading;
    roll(&mut rig, 1, 200, MS(800));
    let turned = truth(&rig).motion.pose.heading - heading;
    rig.clear(handle);
    run(&mut rig, MAIN, MS(1000));
    let heading = truth(&rig).motion.pose.heading;
    roll(&mut rig, 1, 200, MS(800));
    let whole = truth(&rig).motion.pose.heading - heading;
    assert!(turned.abs() < 0.5 * whole.abs(), "{turned} {whole}");
}

#[test]
fn ports_that_are_swapped_more_than_once_are_where_that_leads() {
    use rigsim_physics::mecanum::{Port, Wheel};
    let mut rig = car(false);
    let swap = |rig: &mut Rig, port: &str, with: &str| {
        let text = format!("kind = \"ports-swapped\"\nport = \"{port}\"\nwith = \"{with}\"");
        inject(rig, &text)
    };
    let ports = |rig: &Rig| {
        let swaps = rig.device::<Mecanum>(0).unwrap().plant.faults().swaps;
        [Wheel::LeftFront, Wheel::RightFront].map(|wheel| swaps.port(wheel))
    };
    swap(&mut rig, "x", "y");
    let second = swap(&mut rig, "y", "z");
    assert_eq!(ports(&rig), [Port::Z, Port::X]);
    rig.clear(second);
    assert_eq!(ports(&rig), [Port::Y, Port::X]);
    swap(&mut rig, "x", "y");
    assert_eq!(ports(&rig), [Port::X, Port::Y]);
}

#[test]
fn ice_payload_and_push_change_how_it_moves() {
    let far = |fault: &str| {
        let mut rig = car(false);
        inject(&mut rig, fault);
        roll(&mut rig, 0, 450, MS(800));
        rig.distance_m(0)
    };
    let plain = far("kind = \"payload\"\nmass = \"0 kg\"");
    assert!(far("kind = \"ice\"\nfriction = 0.01") < 0.8 * plain);
    assert!(far("kind = \"payload\"\nmass = \"60 kg\"") < 0.999 * plain);
    assert!(far("kind = \"push\"\nahead = \"-300 N\"") != plain);
}

#[test]
fn a_brake_that_does_not_hold() {
    let pushed = |broken: bool| {
        let mut rig = car(false);
        if broken {
            inject(&mut rig, "kind = \"brake-stuck-open\"");
        }
        inject(&mut rig, "kind = \"push\"\nahead = \"15 N\"");
        run(&mut rig, MAIN, MS(1500));
        rig.distance_m(0)
    };
    assert!(pushed(false) < 0.01, "{}", pushed(false));
    assert!(pushed(true) > 0.05, "{}", pushed(true));
}

#[test]
fn ultrasonic_sensors_that_miss_stick_or_see_ghosts() {
    let mut rig = car(false);
    let plain = status(&mut rig);
    assert!(plain.ut_f[1] < 1500, "{plain:?}");
    let handle = inject(
        &mut rig,
        "kind = \"ultrasonic-missing\"\nsensor = \"front-2\"",
    );
    let seen = status(&mut rig);
    assert_eq!((seen.ut_f[1], seen.ut_f[2]), (4500, plain.ut_f[2]));
    rig.clear(handle);
    let handle = inject(
        &mut rig,
        "kind = \"ultrasonic-ghost\"\nsensor = \"rear\"\ndistance = \"0.25 m\"",
    );
    let seen = status(&mut rig);
    assert_eq!((seen.ut_b, seen.ut_f), ([250; 4], plain.ut_f));
    rig.clear(handle);
    let handle = inject(&mut rig, "kind = \"ultrasonic-stuck\"\nsensor = \"front\"");
    assert_eq!(rig.hits(handle), 0);
    assert_eq!(roll(&mut rig, 0, 300, MS(1000)).ut_f, plain.ut_f);
    assert!(rig.hits(handle) > 0);
    rig.clear(handle);
    assert!(status(&mut rig).ut_f[1] + 50 < plain.ut_f[1]);
}

#[test]
fn tag_strip_and_infrared() {
    let mut rig = car(false);
    let plain = status(&mut rig);
    assert!(plain.rfid == 77 && plain.magn != 0 && plain.infra == 0);
    let misread = inject(&mut rig, "kind = \"tag-misread\"\nreads_as = 78");
    let lost = inject(&mut rig, "kind = \"strip-lost\"");
    let stuck = inject(&mut rig, "kind = \"infrared-stuck\"");
    let seen = status(&mut rig);
    assert_eq!((seen.rfid, seen.magn, seen.infra), (78, 0, 1));
    for handle in [misread, lost, stuck] {
        assert_eq!(rig.hits(handle), 1);
        rig.clear(handle);
    }
    let seen = status(&mut rig);
    assert_eq!(
        (seen.rfid, seen.magn, seen.infra),
        (plain.rfid, plain.magn, plain.infra)
    );
}
