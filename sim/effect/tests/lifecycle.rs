//! Every fault is armed, acts, and ends without a trace.

use rigsim_physics::faults::MotorFaults;
use rigsim_physics::mecanum::{MecanumFaults, Wheel};
use rigsim_physics::r150::{R150Faults, Side};

use super::*;
use crate::r150_device::vehicle::OperatorInput;

/// A drive on which every fault of an R150 has something to act on; it begins with the rails on.
fn exercise_r150(rig: &mut Rig, watchdog: bool) {
    drive(rig, 300, 200, 10);
    power(rig, 0b01_1111);
    ask(rig, Request::SystemInfo);
    drive(rig, 500, 100, 10);
    if watchdog {
        run(rig, MAIN, MS(700));
    }
    rig.with_device(0, |r150: &mut R150, _, now| {
        r150.device.operate(now, OperatorInput::Park)
    });
    run(rig, MAIN, MS(50));
}

fn settled(rig: &Rig) -> bool {
    let plant = &rig.device::<R150>(0).unwrap().plant;
    *plant.faults() == R150Faults::default()
        && Side::ALL
            .iter()
            .all(|side| plant.side_faults(*side) == MotorFaults::default())
}

/// Motors answer, 0x06 answers, the heartbeat answers, with nothing between.
fn is_sound(rig: &mut Rig) {
    run(rig, MAIN, MS(1500));
    for request in [
        Request::Heartbeat,
        Request::SystemInfo,
        Request::Version,
        Request::SetMotors { right: 0, left: 0 },
    ] {
        let seen = replies(rig, request);
        assert_eq!(seen.len(), 1, "{request:?}: {seen:?}");
        assert_eq!(seen[0].command(), request.command());
        run(rig, MAIN, MS(50));
    }
}

#[test]
fn on_the_r150() {
    for info in faults() {
        if !has(&crate::r150::R150_SPEC, info) {
            continue;
        }
        let mut rig = r150();
        power(&mut rig, 0b11_1111);
        drive(&mut rig, 300, 300, 10);
        let handle = rig.inject(0, info.id, &sample(info.id)).unwrap();
        let now = rig.now();
        // What the client hears meanwhile is the business of the other tests.
        for step in 0..10_i16 {
            let at = now + MS(50) * u32::try_from(step).unwrap();
            let right = 100 * (step % 5);
            let request = Request::SetMotors { right, left: 200 };
            rig.client_sends(MAIN, at, &request.encode()).unwrap();
            let request = Request::PowerControl { on: 0b01_1111 };
            rig.client_sends(MAIN, at, &request.encode()).unwrap();
            rig.client_sends(MAIN, at, &Request::SystemInfo.encode())
                .unwrap();
        }
        run(&mut rig, MAIN, MS(700));
        rig.with_device(0, |r150: &mut R150, _, now| {
            if info.id == "brake-stuck-open" {
                r150.device.operate(now, OperatorInput::Park);
            }
        });
        run(&mut rig, MAIN, MS(100));
        let hits = rig.hits(handle);
        assert!(hits > 0, "{} never acted", info.id);
        rig.clear(handle);
        let reported = phases(&mut rig);
        assert_eq!(
            words(&reported),
            ["armed", "triggered", "cleared"],
            "{}",
            info.id
        );
        let hits = rig.hits(handle);
        assert!(settled(&rig), "{} left a trace", info.id);
        is_sound(&mut rig);
        let vehicle = rig.device::<R150>(0).unwrap().device.vehicle().clone();
        assert!(!vehicle.locked && !vehicle.emergency_stop, "{}", info.id);
        assert!(vehicle.autonomous, "{}", info.id);
        if info.id != "brake-stuck-open" {
            assert!(!vehicle.parked, "{}", info.id);
            let before = rig.distance_m(0);
            drive(&mut rig, 300, 300, 20);
            assert!(rig.distance_m(0) > before + 0.1, "{}", info.id);
        }
        assert_eq!(rig.hits(handle), hits, "{} goes on", info.id);
        rig.clear(handle);
        assert_eq!(phases(&mut rig), []);
    }
}

#[test]
fn on_the_car() {
    for info in faults() {
        if !has(&crate::mecanum::MECANUM_SPEC, info) {
            continue;
        }
        let mut rig = car(false);
        run(&mut rig, MAIN, MS(300));
        let handle = rig.inject(0, info.id, &sample(info.id)).unwrap();
        for v in [200, 300] {
            let now = rig.now();
            rig.client_sends(MAIN, now, &motion(0, 3, v)).unwrap();
            run(&mut rig, MAIN, MS(300));
        }
        // Long enough for the link to time out.
        send(&mut rig, &motion(1, 100, 200));
        run(&mut rig, MAIN, MS(700));
        assert!(rig.hits(handle) > 0, "{} never acted", info.id);
        rig.clear(handle);
        let reported = phases(&mut rig);
        assert_eq!(
            words(&reported),
            ["armed", "triggered", "cleared"],
            "{}",
            info.id
        );
        run(&mut rig, MAIN, MS(1500));
        let plant = &rig.device::<Mecanum>(0).unwrap().plant;
        assert_eq!(*plant.faults(), MecanumFaults::default(), "{}", info.id);
        for wheel in Wheel::ALL {
            assert_eq!(plant.wheel_faults(wheel), MotorFaults::default());
        }
        let seen = statuses(&run(&mut rig, MAIN, MS(1000)));
        assert!((9..=11).contains(&seen.len()), "{} {}", info.id, seen.len());
        let before = rig.distance_m(0);
        roll(&mut rig, 0, -200, MS(600));
        assert!(rig.distance_m(0) > before + 0.03, "{}", info.id);
    }
}

#[test]
fn a_long_drive_under_a_fault_that_finds_nothing_does_not_trigger() {
    let mut rig = r150();
    let handle = rig.inject(0, "short", &sample("rail-short")).unwrap();
    let held = rig.inject(0, "brake", &sample("brake-stuck-open")).unwrap();
    drive(&mut rig, 300, 300, 40);
    assert_eq!(rig.hits(handle), 0);
    assert_eq!(rig.hits(held), 0);
    exercise_r150(&mut rig, true);
    assert!(rig.hits(handle) > 0);
    assert!(rig.hits(held) > 0);
}

#[test]
fn events_name_the_fault_and_what_it_hit() {
    let mut rig = r150();
    let handle = rig.inject(0, "drop one", "kind = \"mute\"").unwrap();
    ask(&mut rig, Request::Heartbeat);
    rig.clear(handle);
    let reported: Vec<Event> = std::iter::from_fn(|| rig.poll_event())
        .filter(|event| event.kind.fault().is_some())
        .collect();
    let lines: Vec<String> = reported
        .iter()
        .map(|event| event.kind.to_string())
        .collect();
    assert_eq!(
        lines,
        [
            "fault drop one (mute) armed",
            "fault drop one (mute) triggered: a byte 0xAA to the client",
            "fault drop one (mute) cleared",
        ]
    );
    let codes: Vec<&str> = reported
        .iter()
        .map(|event| event.kind.code().name)
        .collect();
    assert_eq!(codes, ["fault_armed", "fault_triggered", "fault_cleared"]);
}
