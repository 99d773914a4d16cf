//! What the article leaves open about orders, and we chose: every other choice works, too.

use super::super::OperatorInput;
use super::super::kinematics::{Course, Movement};
use super::super::settings::{
    Acknowledge, ByteOrder, IdleWheels, ModeChange, OrdersWithRos, OverSpeed, PositiveStrafe,
    PositiveTurn, Preempt, StartMode, ZeroDistance, ZeroSpeed,
};
use super::*;

fn with(change: impl FnOnce(&mut MecanumFirmwareSettings)) -> Bench {
    Bench::with(false, change)
}

fn here() -> Request {
    Request::SetPose {
        seq: 9,
        axis_x: 0,
        axis_y: 0,
        ori: 0,
    }
}

fn mode(mode: u8) -> Request {
    Request::ControlMode { seq: 0, mode }
}

#[test]
fn fields_may_be_big_endian_both_ways() {
    let mut bench = with(|s| s.byte_order = ByteOrder::Big);
    let bytes = [0, 9, 0, 1, 0, 0x00, 0x0A, 0xFE, 0x0C];
    bench.device.handle_bytes(bench.now, Link::Main, &bytes);
    let (_, event) = bench.events().swap_remove(0);
    assert_eq!(event.bytes().unwrap(), &bytes[..]);
    assert_eq!(bench.device.drive.rotations(), [-1; 4]);
    bench.run_ms(1300);
    assert_eq!(bench.tenths(), [-10; 4]);
    let packet = bench.output(Link::Main).pop().unwrap();
    // axis_x is −10, and the mileage 314 mm.
    assert_eq!(
        (&packet[7..9], &packet[37..]),
        (&[0xFF, 0xF6][..], &[1, 58][..])
    );
    let (_, event) = bench.events().pop().unwrap();
    assert_eq!(event.bytes().unwrap(), packet);
}

#[test]
fn whatever_is_valid_may_be_answered_by_a_report() {
    let mut bench = Bench::with(true, |s| s.acknowledge = Acknowledge::Status);
    bench.send(here());
    bench.line("X10\nQ\n");
    assert_eq!(bench.output(Link::Main).len(), 1);
    bench.line("X1\n");
    bench.device.handle_bytes(bench.now, Link::Main, &[0xFF]);
    assert_eq!(bench.output(Link::Ros), [b"V0 S0 \n"]);
    bench.run_ms(100);
    // The periodic one comes as before.
    assert_eq!(bench.last_status().seq, 1);
}

#[test]
fn the_ros_link_may_drive_alone() {
    for ros in [false, true] {
        let mut bench = Bench::with(ros, |s| s.orders_with_ros = OrdersWithRos::RosOnly);
        bench.go(0, 10, 100);
        assert_eq!(bench.is_driving(), !ros);
        let reported = bench.codes().contains(&"ignored_for_ros");
        assert_eq!(reported, ros);
        bench.line("Y10\n");
        assert_eq!(bench.device.drive.rotations() == [-1, 1, 1, -1], ros);
    }
}

#[test]
fn preemption_may_spare_what_waits() {
    let mut bench = with(|s| s.preempt = Preempt::Running);
    for _ in 0..3 {
        bench.motion(0, 0, 1, 500);
    }
    bench.events();
    bench.go(2, 1, 500);
    assert_eq!(bench.codes(), ["motions_discarded", "motion_started"]);
    assert_eq!(bench.device.waiting(), 2);
    bench.run_ms(1000);
    assert_eq!(bench.tenths(), [1, 3, 3, 1]);
}

#[test]
fn no_distance_may_be_endless() {
    let mut bench = with(|s| s.zero_distance = ZeroDistance::Endless);
    bench.go(0, 0, 500);
    bench.run_ms(10_000);
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
    // Then only the speed stops it.
    bench.go(0, 0, 0);
    assert!(!bench.is_driving());
}

#[test]
fn no_speed_may_wait() {
    let mut bench = with(|s| s.zero_speed = ZeroSpeed::Wait);
    bench.motion(0, 0, 10, 0);
    bench.motion(0, 0, 10, 500);
    bench.run_ms(5000);
    assert_eq!(bench.device.commands().speed_voltage, 0.0);
    assert_eq!((bench.device.waiting(), bench.tenths()), (1, [0; 4]));
    bench.go(0, 0, 0);
    assert_eq!(bench.device.running(), None);
}

#[test]
fn a_speed_beyond_500_may_be_obeyed_or_ignored() {
    for (over_speed, voltage, words) in [
        (OverSpeed::Clamp, 0.5, "clamped"),
        (OverSpeed::Obey, 0.8, "taken as it is"),
        (OverSpeed::Ignore, 0.0, "ignored with its motion"),
    ] {
        let mut bench = with(|s| {
            s.over_speed = over_speed;
            s.full_speed = 100.0;
        });
        bench.go(0, 10, -800);
        assert!((bench.device.commands().speed_voltage - voltage).abs() < 1e-12);
        let reported = format!("speed -800 {words}: -500 to 500 is allowed");
        let mut events = bench.events().into_iter();
        assert!(events.any(|(_, event)| event.to_string() == reported));
    }
}

#[test]
fn the_signs_of_turns_and_strafes_may_be_the_others() {
    let mut bench = Bench::with(true, |s| {
        s.positive_turn = PositiveTurn::Left;
        s.positive_strafe = PositiveStrafe::Right;
    });
    let mut check = |rotations: [i8; 4], act: &dyn Fn(&mut Bench)| {
        act(&mut bench);
        assert_eq!(bench.device.drive.rotations(), rotations);
    };
    check([-1, 1, -1, 1], &|bench| bench.go(1, 10, 100));
    check([1, -1, 1, -1], &|bench| bench.go(1, 10, -100));
    check([1, -1, -1, 1], &|bench| bench.go(2, 10, 100));
    check([-1, 1, -1, 1], &|bench| bench.line("Z1\n"));
    check([-1, 1, 1, -1], &|bench| bench.line("Y-1\n"));
    // The others keep theirs.
    check([1; 4], &|bench| bench.go(0, 10, 100));
    check([0, 1, 1, 0], &|bench| bench.go(3, 10, 100));
}

#[test]
fn the_remote_control_may_drive_from_the_start() {
    let mut bench = with(|s| s.start_mode = StartMode::Remote);
    for _ in 0..2 {
        assert!(bench.device.is_remote());
        bench.go(0, 10, 100);
        assert!(!bench.is_driving());
        bench.send(mode(0));
        assert!(!bench.device.is_remote());
        // It is so after every start.
        bench.read(|r| r.board_powered = false);
        bench.read(|r| r.board_powered = true);
    }
}

#[test]
fn motions_may_outlast_the_remote_control() {
    let mut bench = with(|s| s.mode_change = ModeChange::Keep);
    bench.go(0, 10, 500);
    bench.motion(0, 0, 1, 500);
    bench.run_ms(600);
    bench.send(mode(1));
    assert!(!bench.is_driving());
    let back = Movement {
        course: Course::Ahead,
        negative: true,
    };
    bench.device.operate(bench.now, OperatorInput::Press(back));
    bench.run_ms(2000);
    bench.device.operate(bench.now, OperatorInput::Release);
    assert_eq!(bench.tenths(), [-5; 4]);
    bench.send(mode(0));
    bench.run_ms(1000);
    // What the operator drove is not the motion's: 5 and 1 tenths were still to come.
    assert_eq!(bench.tenths(), [1; 4]);
    assert!(!bench.is_driving());
}

#[test]
fn silence_counts_from_when_motions_drive_again() {
    let mut bench = with(|s| {
        s.mode_change = ModeChange::Keep;
        s.link_timeout = Some(Duration::from_millis(300));
    });
    bench.go(0, 1000, 100);
    bench.send(mode(1));
    bench.run_ms(1000);
    bench.send(mode(0));
    bench.run(Duration::from_millis(300) - QUANTUM);
    assert!(bench.is_driving());
    bench.until(MS(1300));
    assert!(!bench.is_driving());
}

#[test]
fn idle_wheels_may_be_let_go_but_not_beside_others_that_turn() {
    let mut bench = with(|s| s.idle_wheels = IdleWheels::Release);
    let brakes = |bench: &Bench| {
        let commands = bench.device.commands();
        Wheel::ALL.map(|wheel| commands.ports[wheel.port().index()].brake)
    };
    assert_eq!(brakes(&bench), [false; 4]);
    bench.go(3, 1, 500);
    assert_eq!(brakes(&bench), [true, false, false, true]);
    bench.run_ms(200);
    assert_eq!(brakes(&bench), [false; 4]);
    // A port without a wheel has its own setting.
    assert!(bench.device.commands().ports[2].brake);
}

#[test]
fn the_unit_of_lines_is_a_setting() {
    let mut bench = Bench::with(true, |s| s.ascii_unit = 0.25);
    bench.line("X3\n");
    bench.run_ms(2000);
    // 45 pulses of the 60 of a revolution.
    assert!(
        bench
            .turned
            .iter()
            .all(|pulses| (pulses - 45.0).abs() < 0.01)
    );
    assert!(!bench.is_driving());
}
