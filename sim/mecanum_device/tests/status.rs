//! The status packet: when it comes, and every field.

use super::super::settings::{MotorState, VelocityFrame};
use super::*;

/// The fields of the motion: velocity and pose.
fn motion_fields(status: &Status) -> [i16; 5] {
    let Status {
        v_x,
        v_y,
        axis_x,
        axis_y,
        ori,
        ..
    } = *status;
    [v_x, v_y, axis_x, axis_y, ori]
}

#[test]
fn it_comes_every_100_ms_and_its_numbers_wrap() {
    let mut bench = Bench::new();
    bench.until(MS(100) - QUANTUM);
    assert_eq!(bench.statuses(), []);
    assert_eq!(bench.device.next_deadline(), Some(MS(100)));
    bench.until(MS(100));
    let first = bench.output(Link::Main);
    assert_eq!(first.len(), 1);
    assert_eq!(first[0].len(), 39);
    for number in 1..=300u64 {
        bench.until(MS(100 * (number + 1)));
        let statuses = bench.statuses();
        assert_eq!(statuses.len(), 1);
        assert_eq!(u64::from(statuses[0].seq), number % 256);
    }
}

#[test]
fn without_the_ros_link_nothing_is_sent_there_and_nothing_taken() {
    let mut bench = Bench::new();
    bench.line("X10\n");
    bench.run_ms(1000);
    assert_eq!(bench.output(Link::Ros), [] as [Vec<u8>; 0]);
    assert_eq!(bench.codes(), [] as [&str; 0]);
}

#[test]
fn sensors_go_to_their_fields() {
    let mut bench = Bench::new();
    bench.read(|r| {
        r.echoes = [
            Some(0.5),
            None,
            Some(0.001),
            Some(9.0),
            Some(4.5),
            Some(0.02),
            Some(1.2344),
            Some(0.0),
        ];
        r.obstacle_ahead = true;
        r.tag = 0xDEAD_BEEF;
        r.magnetic_bar = 0x8001;
    });
    bench.run_ms(100);
    let status = bench.last_status();
    assert_eq!(status.ut_f, [500, 4500, 20, 4500]);
    assert_eq!(status.ut_b, [4500, 20, 1234, 20]);
    assert_eq!(status.infra, 1);
    assert_eq!(status.rfid, 0xDEAD_BEEF);
    assert_eq!(status.magn, 0x8001);
    assert_eq!(status.moto_state, 0);
}

#[test]
fn a_measurement_at_the_deadline_is_in_the_packet() {
    let mut bench = Bench::new();
    bench.device.advance(MS(100) - QUANTUM);
    bench.readings.tag = 9;
    bench.device.sense(MS(100), &bench.readings);
    bench.device.advance(MS(100));
    assert_eq!(bench.last_status().rfid, 9);
}

#[test]
fn the_ros_link_takes_the_magnetic_sensors_uart() {
    let mut bench = Bench::with_ros();
    bench.read(|r| r.magnetic_bar = 0xFFFF);
    bench.run_ms(100);
    assert_eq!(bench.last_status().magn, 0);
}

#[test]
fn speed_and_position_come_from_pulses() {
    let mut bench = Bench::new();
    bench.go(0, 1000, 500);
    bench.run_ms(1200);
    assert_eq!(motion_fields(&bench.last_status()), [500, 0, 10, 0, 0]);
    bench.go(2, 1000, -250);
    bench.run_ms(2000);
    let [v_x, v_y, axis_x, axis_y, ori] = motion_fields(&bench.last_status());
    // 25 pulses a second for two seconds are 50 of the 60 of a revolution.
    assert_eq!([v_x, v_y, axis_x, axis_y, ori], [0, -250, 10, -8, 0]);
    bench.go(0, 0, 0);
    bench.run_ms(100);
    assert_eq!(motion_fields(&bench.last_status())[..2], [0, 0]);
}

#[test]
fn a_wheel_that_does_not_turn_is_seen() {
    let mut bench = Bench::new();
    bench.stuck = [true; 4];
    bench.go(0, 1000, 500);
    bench.run_ms(2000);
    let status = bench.last_status();
    assert_eq!(motion_fields(&status), [0; 5]);
    assert_eq!(status.moto_state, 0b11);
    let mut bench = Bench::with(false, |s| s.moto_state = MotorState::Turning);
    bench.stuck = [true, false, true, false];
    bench.go(0, 1000, 500);
    bench.run_ms(2000);
    assert_eq!(bench.last_status().moto_state, 0b10);
}

#[test]
fn set_pose_sets_the_frame() {
    let mut bench = Bench::new();
    bench.send(Request::SetPose {
        seq: 1,
        axis_x: 100,
        axis_y: -50,
        ori: 900,
    });
    bench.go(0, 10, 500);
    bench.run_ms(1000);
    let status = bench.last_status();
    // It heads along y now, and so does its velocity.
    assert_eq!(motion_fields(&status)[..2], [0, 500]);
    bench.run_ms(500);
    let status = bench.last_status();
    assert_eq!(motion_fields(&status), [0, 0, 100, -40, 900]);
    assert_eq!(status.mile, 314);
    // Setting it again does not touch the mileage.
    bench.send(Request::SetPose {
        seq: 2,
        axis_x: 0,
        axis_y: 0,
        ori: -1800,
    });
    bench.run_ms(100);
    let status = bench.last_status();
    assert_eq!(motion_fields(&status), [0, 0, 0, 0, -1800]);
    assert_eq!(status.mile, 314);
}

#[test]
fn the_velocity_may_be_in_the_cars_axes() {
    let mut bench = Bench::with(false, |s| s.velocity_frame = VelocityFrame::Body);
    bench.send(Request::SetPose {
        seq: 0,
        axis_x: 0,
        axis_y: 0,
        ori: 900,
    });
    bench.go(0, 10, 500);
    bench.run_ms(1000);
    assert_eq!(motion_fields(&bench.last_status())[..2], [500, 0]);
}

#[test]
fn values_beyond_their_fields_wrap() {
    let mut bench = Bench::new();
    bench.send(Request::SetPose {
        seq: 0,
        axis_x: i16::MAX,
        axis_y: 0,
        ori: 0,
    });
    bench.go(0, 1, 500);
    bench.run_ms(300);
    assert_eq!(bench.last_status().axis_x, i16::MIN);
    // 209 revolutions of 314.159 mm are 65,659 mm.
    bench.read(|r| r.pulses = r.pulses.map(|count| count.wrapping_add(12_540 - 6)));
    bench.run_ms(100);
    assert_eq!(bench.last_status().mile, 123);
    // Ten turns to the left are 36,000 tenths of a degree, which is −29,536 in 16 bits; the wheels
    // go round the arm of 0.22 m with a radius of 0.05 m.
    let mut bench = Bench::new();
    bench.go(1, 440, -500);
    bench.until(SimTime::from_secs(60));
    assert_eq!(bench.tenths(), [-440, 440, -440, 440]);
    assert_eq!(bench.last_status().ori, -29_536);
}

#[test]
fn pulses_while_the_wheels_coast_count_the_way_they_were_driven() {
    let mut bench = Bench::new();
    bench.go(0, 1, -500);
    bench.run_ms(200);
    assert!(!bench.is_driving());
    // Six pulses too many of each wheel, which is what a soft brake gives.
    bench.read(|r| r.pulses = r.pulses.map(|count| count.wrapping_add(6)));
    bench.run_ms(100);
    assert_eq!(bench.last_status().axis_x, -2);
}
