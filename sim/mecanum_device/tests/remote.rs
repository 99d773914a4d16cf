//! Control mode, the remote control, and the supply.

use super::super::OperatorInput;
use super::super::kinematics::{Course, Movement};
use super::*;

const STRAFE_RIGHT: Movement = Movement {
    course: Course::Strafe,
    negative: true,
};

fn mode(bench: &mut Bench, mode: u8) {
    bench.send(Request::ControlMode { seq: 0, mode });
}

#[test]
fn in_remote_mode_the_operator_drives_and_motions_are_ignored() {
    let mut bench = Bench::with_ros();
    bench.go(0, 100, 500);
    bench.motion(0, 0, 100, 500);
    mode(&mut bench, 1);
    assert!(!bench.is_driving());
    bench.go(0, 100, 500);
    bench.line("X10\n");
    assert!(!bench.is_driving());
    bench
        .device
        .operate(bench.now, OperatorInput::Press(STRAFE_RIGHT));
    assert_eq!(bench.device.drive.rotations(), [1, -1, -1, 1]);
    assert!((bench.device.commands().speed_voltage - 0.6).abs() < 1e-12);
    bench.run_ms(2000);
    bench.device.operate(bench.now, OperatorInput::Release);
    assert!(!bench.is_driving());
    // Its wheels count as any others.
    bench.run_ms(100);
    assert_eq!(bench.last_status().axis_y, -10);
    assert_eq!(
        bench.codes(),
        [
            "motion_started",
            "motions_discarded",
            "control_mode",
            "ignored_in_remote",
            "ignored_in_remote",
            "operated",
            "operated"
        ]
    );
}

#[test]
fn back_in_board_mode_the_key_has_no_effect() {
    let mut bench = Bench::new();
    bench
        .device
        .operate(bench.now, OperatorInput::Press(STRAFE_RIGHT));
    assert!(!bench.is_driving());
    assert_eq!(bench.codes(), ["operated", "key_ignored"]);
    // A key that is held counts as soon as the mode is right.
    mode(&mut bench, 1);
    assert!(bench.is_driving());
    mode(&mut bench, 0);
    assert!(!bench.is_driving());
    bench.go(0, 10, 100);
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
    // The mode that already is changes nothing.
    mode(&mut bench, 0);
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
}

#[test]
fn without_supply_the_board_is_silent_and_forgets() {
    let mut bench = Bench::with_ros();
    bench.go(0, 100, 500);
    bench.motion(0, 0, 100, 500);
    bench.run_ms(450);
    assert_eq!(bench.statuses().len(), 4);
    bench.device.handle_bytes(bench.now, Link::Main, &[0, 9, 1]);
    bench.read(|r| r.board_powered = false);
    bench.go(0, 100, 500);
    bench.line("X10\n");
    bench.run_ms(1000);
    assert_eq!(bench.statuses(), []);
    assert_eq!(bench.device.next_deadline(), None);
    assert_eq!(bench.device.commands(), Default::default());
    assert!(bench.codes().ends_with(&["power_lost"]));
    bench.read(|r| {
        r.board_powered = true;
        // Pushed by hand meanwhile.
        r.pulses = [7; 5];
    });
    bench.until(MS(1550) - QUANTUM);
    assert_eq!(bench.statuses(), []);
    bench.until(MS(1550));
    let status = bench.last_status();
    assert_eq!((status.seq, status.axis_x, status.mile), (0, 0, 0));
    assert!(!bench.is_driving());
    assert_eq!(bench.codes(), ["started"]);
}

#[test]
fn the_remote_control_may_drive_at_another_speed() {
    let mut bench = Bench::with(false, |s| s.remote_speed = 10.0);
    mode(&mut bench, 1);
    bench
        .device
        .operate(bench.now, OperatorInput::Press(STRAFE_RIGHT));
    // Of 50 r/min.
    assert!((bench.device.commands().speed_voltage - 0.2).abs() < 1e-12);
}
