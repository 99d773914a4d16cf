//! The ten movements of the article's picture, from packet to port to wheel.

use rigsim_physics::mecanum::{MecanumCommands, PlugSwaps, Port, PortCommand, Wheel};

use super::super::kinematics::{Course, Movement, body_speed};
use super::super::settings::AsciiLetters;
use super::*;

/// Letter of the picture, sign, name, `moving_idx` and rotation of LF, RF, LR, RR.
const TABLE: [(char, bool, &str, u8, [i8; 4]); 10] = [
    ('X', false, "forward", 0, [1, 1, 1, 1]),
    ('X', true, "backward", 0, [-1, -1, -1, -1]),
    ('Y', false, "turn right", 1, [1, -1, 1, -1]),
    ('Y', true, "turn left", 1, [-1, 1, -1, 1]),
    ('Z', false, "strafe left", 2, [-1, 1, 1, -1]),
    ('Z', true, "strafe right", 2, [1, -1, -1, 1]),
    ('A', false, "left front", 3, [0, 1, 1, 0]),
    ('A', true, "right rear", 3, [0, -1, -1, 0]),
    ('B', false, "right front", 4, [1, 0, 0, 1]),
    ('B', true, "left rear", 4, [-1, 0, 0, -1]),
];

fn port(commands: &MecanumCommands, port: Port) -> PortCommand {
    commands.ports[port.index()]
}

/// FR and BK of one port for a wheel that rolls so, where FR was not touched before.
fn pins(rotation: i8) -> PortCommand {
    PortCommand {
        reverse: rotation < 0,
        brake: rotation == 0,
    }
}

#[test]
fn the_kinematics_give_the_table() {
    for (_, negative, name, index, rotations) in TABLE {
        let course = Course::ALL[usize::from(index)];
        let movement = Movement { course, negative };
        assert_eq!(movement.rotations(), rotations, "{name}");
        assert_eq!(movement.to_string(), name);
    }
}

#[test]
fn every_movement_drives_the_ports_of_its_wheels() {
    let ports = [Port::X, Port::Y, Port::E0, Port::E1];
    for (_, negative, name, index, rotations) in TABLE {
        let mut bench = Bench::new();
        bench.go(index, 10, if negative { -300 } else { 300 });
        let commands = bench.device.commands();
        for wheel in 0..4 {
            let found = port(&commands, ports[wheel]);
            assert_eq!(found, pins(rotations[wheel]), "{name}");
        }
        assert_eq!(port(&commands, Port::Z), pins(0), "{name}");
        assert!((commands.speed_voltage - 0.6).abs() < 1e-12);
        // A revolution at 30 r/min takes two seconds.
        bench.run_ms(2100);
        let wanted = rotations.map(|rotation| 10 * i64::from(rotation));
        assert_eq!(bench.tenths(), wanted, "{name}");
        assert!(!bench.is_driving());
    }
}

#[test]
fn every_movement_by_the_pictures_letters_and_the_tables() {
    for (letter, negative, name, _, rotations) in TABLE {
        let sign = if negative { "-" } else { "" };
        let mut bench = Bench::with(true, |s| s.ascii_letters = AsciiLetters::Picture);
        bench.line(&format!("{letter}{sign}10 \n"));
        assert_eq!(bench.device.drive.rotations(), rotations, "{name}");
        // The table exchanges Y and Z.
        let letter = match letter {
            'Y' => 'Z',
            'Z' => 'Y',
            same => same,
        };
        let mut bench = Bench::with_ros();
        bench.line(&format!("{letter}{sign}10 \n"));
        assert_eq!(bench.device.drive.rotations(), rotations, "{name}");
    }
}

#[test]
fn every_movement_moves_the_dead_reckoning_its_way() {
    for (_, negative, name, index, rotations) in TABLE {
        let mut bench = Bench::new();
        bench.go(index, 100, if negative { -500 } else { 500 });
        bench.run_ms(13_000);
        let status = bench.last_status();
        let [ahead, left, turn] = body_speed(rotations.map(f64::from), 0.22);
        let close = |found: i16, wanted: f64| (f64::from(found) - wanted).abs() <= 0.5;
        assert!(close(status.axis_x, 100.0 * ahead), "{name} {status:?}");
        assert!(close(status.axis_y, 100.0 * left), "{name} {status:?}");
        // Ten revolutions of 0.1 π m each.
        let degrees = (turn * std::f64::consts::PI).to_degrees();
        let tenths = crate::rounding::round::<i64>(degrees * 10.0);
        assert_eq!(i64::from(status.ori), tenths, "{name} {status:?}");
    }
}

#[test]
fn a_miswired_car_goes_elsewhere_and_its_odometry_does_not_know() {
    let straight = PlugSwaps::default();
    for (plugs, reversed, wheels) in [
        // The front motors swapped: a strafe becomes a turn.
        (straight.and(Port::X, Port::Y), None, [10, -10, 10, -10]),
        // One motor the wrong way round.
        (straight, Some(Wheel::RightFront), [-10, -10, 10, -10]),
    ] {
        let mut bench = Bench::new();
        (bench.plugs, bench.reversed) = (plugs, reversed);
        bench.go(2, 10, 300);
        bench.run_ms(2100);
        assert_eq!(bench.tenths(), wheels, "{plugs:?}");
        let status = bench.last_status();
        let believed = (status.axis_x, status.axis_y, status.ori);
        assert_eq!(believed, (0, 10, 0), "{plugs:?}");
    }
}

#[test]
fn a_motor_at_a_port_that_is_not_driven_holds_and_one_that_is_missed_never_arrives() {
    // The firmware expects the article's table, the motors are plugged in by its later line: LR is
    // at a port that only holds, RR gets what is meant for LR, and E1's wheel never counts.
    let mut bench = Bench::new();
    bench.plugs = PlugSwaps::default()
        .and(Port::E0, Port::Z)
        .and(Port::E1, Port::E0);
    bench.go(2, 10, 300);
    bench.run_ms(3000);
    assert_eq!(bench.tenths(), [-10, 10, 0, 10]);
    assert_eq!(bench.device.drive.rotations(), [0, 0, 0, -1]);
}

#[test]
fn unused_ports_hold() {
    let mut bench = Bench::new();
    bench.go(0, 10, 300);
    assert!(port(&bench.device.commands(), Port::Z).brake);
}

#[test]
fn a_stopped_wheel_keeps_its_direction_pin() {
    let mut bench = Bench::new();
    bench.go(0, 1, -300);
    bench.run_ms(500);
    let commands = bench.device.commands();
    assert_eq!(commands.speed_voltage, 0.0);
    for wheel in Wheel::ALL {
        let pins = port(&commands, wheel.port());
        assert!(pins.reverse && pins.brake);
    }
}
