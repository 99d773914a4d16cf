//! Motions: preemption, the queue, targets, clamping, and the link timeout.

use super::super::event::{MOTIONS_DISCARDED, SPEED_CLAMPED};
use super::*;

#[test]
fn a_motion_ends_at_the_pulse_that_completes_its_distance() {
    let mut bench = Bench::new();
    bench.go(0, 5, 500);
    // 30 pulses at 50 a second.
    bench.until(MS(599));
    assert!(bench.is_driving());
    bench.until(MS(600));
    assert!(!bench.is_driving());
    assert_eq!(bench.device.commands().speed_voltage, 0.0);
    let events = bench.events();
    let done = events
        .iter()
        .find(|(_, event)| event.code().name == "motion_done");
    assert_eq!(done.unwrap().0, MS(600));
}

#[test]
fn each_wheel_stops_by_itself() {
    let mut bench = Bench::new();
    bench.go(0, 5, 500);
    bench.stuck[1] = true;
    bench.until(MS(700));
    assert_eq!(bench.device.drive.rotations(), [0, 1, 0, 0]);
    assert_eq!(bench.last_status().moto_state, 0b10);
    bench.stuck[1] = false;
    bench.run_ms(600);
    assert_eq!(bench.tenths(), [5; 4]);
    assert!(!bench.is_driving());
}

#[test]
fn motions_that_do_not_preempt_follow_one_another() {
    let mut bench = Bench::new();
    for moving_idx in [0, 2, 0] {
        bench.motion(0, moving_idx, 2, 500);
    }
    assert_eq!(bench.device.waiting(), 2);
    bench.run_ms(1000);
    assert_eq!(bench.tenths(), [2, 6, 6, 2]);
    assert_eq!(
        bench.codes(),
        [
            "motion_started",
            "motion_done",
            "motion_started",
            "motion_done",
            "motion_started",
            "motion_done"
        ]
    );
}

#[test]
fn a_square_ends_where_it_began() {
    let mut bench = Bench::new();
    for (moving_idx, v) in [(0, 400), (2, 400), (0, -400), (2, -400)] {
        bench.motion(0, moving_idx, 10, v);
    }
    bench.run_ms(6500);
    assert!(!bench.is_driving());
    let status = bench.last_status();
    assert_eq!((status.axis_x, status.axis_y, status.ori), (0, 0, 0));
    // Four revolutions of 314.16 mm.
    assert_eq!(status.mile, 1257);
}

#[test]
fn preemption_discards_what_runs_and_waits() {
    let mut bench = Bench::new();
    for _ in 0..3 {
        bench.motion(0, 0, 10, 500);
    }
    bench.run_ms(100);
    bench.events();
    bench.go(2, 1, 500);
    assert_eq!(bench.device.waiting(), 0);
    assert_eq!(bench.device.drive.rotations(), [-1, 1, 1, -1]);
    let words = "3 motions discarded: another preempts";
    let discarded = EventKind::new(MOTIONS_DISCARDED, words);
    assert!(bench.events().contains(&(MS(100), discarded)));
    bench.run_ms(1000);
    assert!(!bench.is_driving());
}

#[test]
fn no_distance_or_no_speed_is_a_stop_when_it_preempts() {
    for (s, v) in [(0, 300), (10, 0), (0, 0)] {
        let mut bench = Bench::new();
        bench.go(0, 1000, 500);
        bench.motion(0, 0, 1000, 500);
        bench.go(1, s, v);
        assert!(!bench.is_driving());
        assert_eq!(bench.device.waiting(), 0);
    }
}

#[test]
fn no_distance_or_no_speed_ends_at_once_when_its_turn_comes() {
    let mut bench = Bench::new();
    bench.motion(0, 0, 1, 500);
    bench.motion(0, 1, 0, 500);
    bench.motion(0, 1, 10, 0);
    bench.motion(0, 0, 1, 500);
    bench.run_ms(300);
    assert_eq!(bench.tenths(), [2; 4]);
    assert!(!bench.is_driving());
}

#[test]
fn sixteen_wait_and_one_more_is_refused() {
    let mut bench = Bench::new();
    for _ in 0..17 {
        bench.motion(0, 0, 1, 500);
    }
    assert_eq!(bench.codes(), ["motion_started"]);
    bench.motion(0, 0, 1, 500);
    assert_eq!(bench.codes(), ["queue_full"]);
    assert_eq!(bench.device.waiting(), 16);
    bench.run_ms(3000);
    assert_eq!(bench.tenths(), [17; 4]);
}

#[test]
fn speeds_beyond_500_are_clamped_and_reported() {
    for (v, reported) in [(500, false), (501, true), (-500, false), (i16::MIN, true)] {
        let mut bench = Bench::new();
        bench.go(0, 10, v);
        assert_eq!(bench.device.commands().speed_voltage, 1.0);
        let words = format!("speed {v} clamped: -500 to 500 is allowed");
        let clamped = EventKind::new(SPEED_CLAMPED, words).on(Link::Main.index());
        let events = bench.events();
        assert_eq!(events.contains(&(MS(0), clamped)), reported, "{v}");
        let sign = if v < 0 { -1 } else { 1 };
        assert_eq!(bench.device.drive.rotations(), [sign; 4]);
    }
}

#[test]
fn the_speed_voltage_is_the_share_of_the_full_speed() {
    let mut bench = Bench::with(false, |s| s.full_speed = 100.0);
    bench.go(0, 10, -500);
    assert_eq!(bench.device.commands().speed_voltage, 0.5);
    let mut bench = Bench::with(false, |s| s.full_speed = 10.0);
    bench.go(0, 10, 500);
    assert_eq!(bench.device.commands().speed_voltage, 1.0);
}

#[test]
fn fields_out_of_range_are_reported() {
    let mut bench = Bench::new();
    bench.go(0, 10, 100);
    bench.events();
    bench.go(5, 10, 100);
    // Not even the preemption of a motion that does not exist counts.
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
    bench.send(Request::ControlMode { seq: 0, mode: 2 });
    assert!(!bench.device.is_remote());
    bench.motion(2, 1, 10, 100);
    assert_eq!(bench.device.drive.rotations(), [1, -1, 1, -1]);
    let events = bench.events();
    let wrong = events.iter().filter(|(_, event)| event.is_client_error());
    let wrong: Vec<_> = wrong
        .map(|(_, event)| (event.code().name, event.to_string()))
        .collect();
    let wanted = [
        (
            "bad_moving_idx",
            "moving_idx 5 ignored with its packet: 0 to 4 is allowed",
        ),
        (
            "bad_control_type",
            "control type 2 ignored with its packet: 0 and 1 are allowed",
        ),
        (
            "bad_is_reset",
            "is_reset 2 taken for 1: 0 and 1 are allowed",
        ),
    ];
    assert_eq!(wrong, wanted.map(|(code, words)| (code, words.to_owned())));
    assert_eq!(events.last().unwrap().1.code().name, "motion_started");
}

#[test]
fn a_partial_packet_is_dropped_at_the_timeout() {
    let request = Request::Motion {
        seq: 0,
        is_reset: 1,
        moving_idx: 0,
        s: 10,
        v: 100,
    };
    let bytes = request.encode();
    let (head, tail) = bytes.split_at(8);
    for (gap, drives) in [
        (Duration::from_millis(50), true),
        (Duration::from_millis(50) + QUANTUM, false),
    ] {
        let mut bench = Bench::new();
        bench.device.handle_bytes(bench.now, Link::Main, head);
        bench
            .device
            .handle_bytes(SimTime::ZERO + gap, Link::Main, tail);
        assert_eq!(bench.is_driving(), drives);
        let dropped = (MS(50), "partial_packet");
        let events = bench.events();
        let reported = events.iter().any(|(at, e)| (*at, e.code().name) == dropped);
        assert_eq!(reported, !drives);
    }
}

#[test]
fn without_a_link_timeout_silence_changes_nothing() {
    let mut bench = Bench::new();
    bench.go(0, u16::MAX, 1);
    bench.until(SimTime::from_secs(60));
    assert!(bench.is_driving());
}

#[test]
fn a_link_timeout_stops_the_motors_after_that_silence() {
    let mut bench = Bench::with(true, |s| s.link_timeout = Some(Duration::from_millis(300)));
    bench.go(0, 1000, 100);
    bench.motion(0, 0, 1000, 100);
    bench.until(MS(200));
    // Junk is not a sign of life, a valid line on the other link is.
    bench.device.handle_bytes(bench.now, Link::Main, &[0xFF]);
    bench.until(MS(300) - QUANTUM);
    assert!(bench.is_driving());
    bench.until(MS(300));
    assert!(!bench.is_driving());
    assert_eq!(bench.device.waiting(), 0);
    assert!(bench.codes().contains(&"link_timeout"));
    bench.line("X10\n");
    bench.run_ms(250);
    bench.send(Request::SetPose {
        seq: 0,
        axis_x: 0,
        axis_y: 0,
        ori: 0,
    });
    bench.run_ms(299);
    assert!(bench.is_driving());
    // A packet at the deadline comes before it.
    let deadline = MS(300 + 250 + 300);
    bench.now = deadline;
    bench.send(Request::ControlMode { seq: 0, mode: 0 });
    bench.device.advance(deadline);
    assert!(bench.is_driving());
    assert_eq!(bench.device.waiting(), 0);
}

#[test]
fn a_car_that_stands_has_no_link_deadline() {
    let mut bench = Bench::with(false, |s| {
        s.link_timeout = Some(Duration::from_millis(30));
    });
    bench.go(0, 0, 0);
    assert_eq!(bench.device.next_deadline(), Some(MS(100)));
    bench.run_ms(200);
    assert_eq!(bench.codes(), [] as [&str; 0]);
}
