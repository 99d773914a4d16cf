//! Programs.

use super::*;

#[test]
fn a_reset_switches_everything_off_and_takes_its_time() {
    let mut rig = r150();
    power(&mut rig, 0b11_1111);
    drive(&mut rig, 500, 500, 10);
    inject(&mut rig, "kind = \"reset\"\nboot = \"300ms\"");
    let device = &rig.device::<R150>(0).unwrap().device;
    assert_eq!(
        (device.power_status(), device.motor_set_point()),
        (0, [0; 2])
    );
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    run(&mut rig, MAIN, MS(300));
    let info = info(&mut rig);
    assert_eq!(info.power_status, 0);
    assert!(info.voltage_12v.iter().all(|mv| *mv <= NOISE), "{info:?}");
    let mut rig = car(false);
    roll(&mut rig, 0, 300, MS(500));
    inject(&mut rig, "kind = \"reset\"\nboot = \"300ms\"");
    // What was on its way still comes.
    run(&mut rig, MAIN, MS(10));
    assert_eq!(run(&mut rig, MAIN, MS(380)).len(), 0);
    let seen = statuses(&run(&mut rig, MAIN, MS(100)));
    assert_eq!((seen[0].seq, seen[0].axis_x), (0, 0), "all is forgotten");
}

#[test]
fn a_hung_module_drives_on_and_catches_up() {
    let mut rig = r150();
    drive(&mut rig, 500, 500, 20);
    let handle = inject(&mut rig, "kind = \"hang\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    run(&mut rig, MAIN, MS(2000));
    assert!(rig.device::<R150>(0).unwrap().truth().motion.forward_speed > 0.5);
    assert_eq!(rig.hits(handle), 6, "a heartbeat has six bytes");
    let cleared = rig.now();
    rig.clear(handle);
    rig.advance(cleared).unwrap();
    assert_eq!(
        rig.device::<R150>(0).unwrap().device.motor_set_point(),
        [0; 2]
    );
    let fired = std::iter::from_fn(|| rig.poll_event())
        .find(|event| event.kind.code().name == "watchdog_fired");
    assert_eq!(fired.unwrap().at, cleared);
}

#[test]
fn a_hung_car_is_silent_and_goes_on() {
    let mut rig = car(false);
    roll(&mut rig, 1, 300, MS(500));
    let handle = inject(&mut rig, "kind = \"hang\"");
    // What was on its way still comes.
    run(&mut rig, MAIN, MS(10));
    assert_eq!(run(&mut rig, MAIN, MS(990)), NOTHING);
    assert!(
        rig.device::<Mecanum>(0)
            .unwrap()
            .truth()
            .motion
            .yaw_rate
            .abs()
            > 0.1
    );
    assert_eq!(rig.hits(handle), 14, "ten packets, and four bytes");
    rig.clear(handle);
    let seen = statuses(&run(&mut rig, MAIN, MS(1000)));
    assert!((9..=11).contains(&seen.len()), "no burst of old packets");
}

#[test]
fn slow_firmware_answers_later() {
    let mut rig = r150();
    inject(&mut rig, "kind = \"slow-replies\"\nby = \"100ms\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    assert_eq!(run(&mut rig, MAIN, MS(80)).len(), 7);
    let mut rig = car(false);
    inject(&mut rig, "kind = \"slow-replies\"\nby = \"100ms\"");
    let seen = statuses(&run(&mut rig, MAIN, MS(2000)));
    assert!((10..=11).contains(&seen.len()), "{}", seen.len());
}

#[test]
fn what_waits_behind_a_slow_reply_is_sent_with_it() {
    let mut rig = r150();
    let slow = inject(&mut rig, "kind = \"slow-replies\"\nby = \"100ms\"");
    assert_eq!(ask(&mut rig, Request::Heartbeat), NOTHING);
    rig.clear(slow);
    assert_eq!(ask(&mut rig, Request::Version), NOTHING);
    let sent = run(&mut rig, MAIN, MS(80));
    assert_eq!((sent[3], sent[7 + 3]), (0x07, 0xF0));
    let replies = std::iter::from_fn(|| rig.poll_event());
    let replies = replies.filter(|event| event.kind.code().name == "reply");
    let at: Vec<SimTime> = replies.map(|event| event.at).collect();
    assert_eq!(at.len(), 2);
    assert_eq!(at[0], at[1]);
}

#[test]
fn stuck_status_hides_a_trip_that_really_happened() {
    let mut rig = r150();
    power(&mut rig, 0b11_1111);
    inject(&mut rig, "kind = \"stuck-status\"");
    inject(&mut rig, "kind = \"rail-short\"\nrail = \"12v-a\"");
    run(&mut rig, MAIN, MS(50));
    assert_ne!(rig.device::<R150>(0).unwrap().device.sys_status(), 0);
    let seen = info(&mut rig);
    assert_eq!((seen.sys_status, seen.power_status), (0, 0b11_1111));
    assert_eq!(seen.voltage_12v[0], 0, "what is measured is live");
}

#[test]
fn frozen_sensors_repeat_themselves() {
    let mut rig = r150();
    let before = drive(&mut rig, 600, 600, 30);
    let handle = inject(&mut rig, "kind = \"frozen-sensors\"");
    let frozen = drive(&mut rig, 0, 0, 30);
    assert!(
        (frozen[0] - before[0]).abs() < 20 && frozen[0] > 500,
        "{frozen:?}"
    );
    assert!(rig.hits(handle) > 0);
    rig.clear(handle);
    assert_eq!(drive(&mut rig, 0, 0, 5), [0, 0]);
}

#[test]
fn with_a_dead_watchdog_the_vehicle_goes_on_until_it_is_mended() {
    let mut rig = r150();
    drive(&mut rig, 500, 500, 20);
    let handle = inject(&mut rig, "kind = \"watchdog-off\"");
    run(&mut rig, MAIN, MS(2000));
    assert!(rig.device::<R150>(0).unwrap().truth().motion.forward_speed > 0.5);
    assert_eq!(rig.hits(handle), 1);
    rig.clear(handle);
    run(&mut rig, MAIN, MS(2000));
    assert_eq!(
        rig.device::<R150>(0).unwrap().truth().motion.forward_speed,
        0.0
    );
    let mut rig = car(false);
    send(&mut rig, &motion(1, 5000, 300));
    let handle = inject(&mut rig, "kind = \"watchdog-off\"");
    run(&mut rig, MAIN, MS(1000));
    assert!(
        rig.device::<Mecanum>(0)
            .unwrap()
            .truth()
            .motion
            .yaw_rate
            .abs()
            > 0.1
    );
    rig.clear(handle);
    run(&mut rig, MAIN, MS(1000));
    assert!(
        rig.device::<Mecanum>(0)
            .unwrap()
            .truth()
            .motion
            .yaw_rate
            .abs()
            < 1e-9
    );
}
