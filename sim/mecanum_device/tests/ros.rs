//! The ROS link: lines in and out.

use super::*;

fn reports(bench: &mut Bench) -> Vec<String> {
    let lines = bench.output(Link::Ros);
    let lines = lines.into_iter();
    lines.map(|line| String::from_utf8(line).unwrap()).collect()
}

#[test]
fn x10_is_one_revolution_forward() {
    let mut bench = Bench::with_ros();
    bench.line("X10 \n");
    // At 30 r/min, half a revolution a second.
    bench.run_ms(1000);
    assert_eq!(reports(&mut bench).last().unwrap(), "V50 S50 \n");
    bench.run_ms(1500);
    assert_eq!(bench.tenths(), [10; 4]);
    assert!(!bench.is_driving());
    assert_eq!(reports(&mut bench).last().unwrap(), "V0 S100 \n");
}

#[test]
fn a_line_comes_every_100_ms_on_its_own_link() {
    let mut bench = Bench::with(true, |s| s.ros_report_period = Duration::from_millis(250));
    bench.until(MS(250) - QUANTUM);
    assert_eq!(reports(&mut bench), [] as [&str; 0]);
    bench.until(MS(250));
    assert_eq!(reports(&mut bench), ["V0 S0 \n"]);
    let mut bench = Bench::with_ros();
    bench.run_ms(1000);
    assert_eq!(reports(&mut bench).len(), 10);
}

#[test]
fn the_speed_has_the_sign_of_the_motion_and_the_mileage_has_none() {
    let mut bench = Bench::with_ros();
    bench.line("A-10\n");
    bench.run_ms(1000);
    assert_eq!(reports(&mut bench).last().unwrap(), "V-50 S50 \n");
    bench.line("Z10\n");
    bench.run_ms(2200);
    assert_eq!(reports(&mut bench).last().unwrap(), "V0 S150 \n");
}

#[test]
fn a_line_preempts_unless_configured_otherwise() {
    let mut bench = Bench::with_ros();
    bench.line("X1000\n");
    bench.line("B-5\n");
    assert_eq!(bench.device.drive.rotations(), [-1, 0, 0, -1]);
    bench.line("X0\n");
    assert!(!bench.is_driving());
    let mut bench = Bench::with(true, |s| s.ascii_preempt = false);
    bench.line("X1000\n");
    bench.line("B-5\n");
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
    assert_eq!(bench.device.waiting(), 1);
}

#[test]
fn both_links_command_the_same_wheels() {
    let mut bench = Bench::with_ros();
    bench.line("X1000\n");
    bench.motion(0, 2, 10, 100);
    assert_eq!(bench.device.waiting(), 1);
    bench.go(1, 10, 100);
    assert_eq!(bench.device.drive.rotations(), [1, -1, 1, -1]);
    bench.line("X10\n");
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
}

#[test]
fn the_speed_is_a_setting() {
    let mut bench = Bench::with(true, |s| s.ascii_speed = 12.5);
    bench.line("X-10\n");
    assert_eq!(bench.device.commands().speed_voltage, 0.25);
}

#[test]
fn bad_lines_are_reported_and_change_nothing() {
    let mut bench = Bench::with_ros();
    bench.line("X10\n");
    bench.events();
    bench.line("Q5\nX99999\n");
    bench.line("X00000000000000000000000000000001000000\n");
    assert_eq!(bench.codes(), ["bad_line", "bad_number", "line_too_long"]);
    assert_eq!(bench.device.drive.rotations(), [1; 4]);
    bench.line("Q\u{FF}\n");
    let event = bench.events().pop().unwrap().1;
    assert!(event.is_client_error());
    assert_eq!(event.bytes().unwrap(), "Q\u{FF}".as_bytes());
    assert_eq!(event.code().name, "bad_line");
}
