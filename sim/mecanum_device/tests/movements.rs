//! The ten movements of the article's picture, from packet to port to wheel, for both wirings.

use proptest::prelude::*;
use rigsim_physics::mecanum::{MecanumCommands, Port, PortCommand, Wheel, Wiring};
use rigsim_settings::{SettingValue, Value};

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

const WIRINGS: [(&str, [Port; 4], Port); 2] = [
    ("x-y-e0-e1", [Port::X, Port::Y, Port::E0, Port::E1], Port::Z),
    ("x-y-z-e0", [Port::X, Port::Y, Port::Z, Port::E0], Port::E1),
];

fn wiring(text: &str) -> Wiring {
    Wiring::read(&Value::Text(text.to_owned()), "").unwrap()
}

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
        let course = Course::from_index(index).unwrap();
        let movement = Movement { course, negative };
        assert_eq!(movement.rotations(), rotations, "{name}");
        assert_eq!(movement.to_string(), name);
    }
}

#[test]
fn every_movement_drives_the_ports_of_its_wheels() {
    for (text, ports, unused) in WIRINGS {
        for (_, negative, name, index, rotations) in TABLE {
            let mut bench = Bench::with(false, |s| s.wiring = wiring(text));
            bench.go(index, 10, if negative { -300 } else { 300 });
            let commands = bench.device.commands();
            for wheel in 0..4 {
                let found = port(&commands, ports[wheel]);
                assert_eq!(found, pins(rotations[wheel]), "{name} on {text}");
            }
            assert_eq!(port(&commands, unused), pins(0), "{name} on {text}");
            assert!((commands.speed_voltage - 0.6).abs() < 1e-12);
            // A revolution at 30 r/min takes two seconds.
            bench.run_ms(2100);
            let wanted = rotations.map(|rotation| 10 * i64::from(rotation));
            assert_eq!(bench.tenths(), wanted, "{name} on {text}");
            assert!(!bench.is_driving());
        }
    }
}

#[test]
fn every_movement_by_the_pictures_letters_and_the_tables() {
    for (letter, negative, name, _, rotations) in TABLE {
        let sign = if negative { "-" } else { "" };
        let mut bench = Bench::with(true, |s| s.ascii_letters = AsciiLetters::Picture);
        bench.line(&format!("{letter}{sign}10 \n"));
        assert_eq!(bench.device.rotations(), rotations, "{name}");
        // The table exchanges Y and Z.
        let letter = match letter {
            'Y' => 'Z',
            'Z' => 'Y',
            same => same,
        };
        let mut bench = Bench::with_ros();
        bench.line(&format!("{letter}{sign}10 \n"));
        assert_eq!(bench.device.rotations(), rotations, "{name}");
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
        let tenths = super::super::motion::whole(degrees * 10.0);
        assert_eq!(i64::from(status.ori), tenths, "{name} {status:?}");
    }
}

#[test]
fn a_polarity_turns_fr_round_for_its_wheel_alone() {
    let mut bench = Bench::with(false, |s| s.wiring = wiring("x-!y-e0-e1"));
    bench.go(0, 10, 300);
    let reversed: Vec<bool> = bench
        .device
        .commands()
        .ports
        .iter()
        .map(|port| port.reverse)
        .collect();
    assert_eq!(reversed, [false, true, false, false, false]);
    // Where the motor is plugged in so, the car goes straight.
    bench.run_ms(3000);
    assert_eq!(bench.tenths(), [10; 4]);
}

#[test]
fn a_miswired_car_goes_elsewhere_and_its_odometry_does_not_know() {
    for (plugs, wheels) in [
        // The front motors swapped: a strafe becomes a turn.
        ("y-x-e0-e1", [10, -10, 10, -10]),
        // One motor the wrong way round.
        ("x-!y-e0-e1", [-10, -10, 10, -10]),
    ] {
        let mut bench = Bench::new();
        bench.plugs = wiring(plugs);
        bench.go(2, 10, 300);
        bench.run_ms(2100);
        assert_eq!(bench.tenths(), wheels, "{plugs}");
        let status = bench.last_status();
        let believed = (status.axis_x, status.axis_y, status.ori);
        assert_eq!(believed, (0, 10, 0), "{plugs}");
    }
}

#[test]
fn a_motor_at_a_port_that_is_not_driven_holds_and_one_that_is_missed_never_arrives() {
    // The firmware expects the article's table, the motors are plugged in by its later line: LR is
    // at a port that only holds, RR gets what is meant for LR, and E1's wheel never counts.
    let mut bench = Bench::new();
    bench.plugs = Wiring::new([Port::X, Port::Y, Port::Z, Port::E0], [false; 4]).unwrap();
    bench.go(2, 10, 300);
    bench.run_ms(3000);
    assert_eq!(bench.tenths(), [-10, 10, 0, 10]);
    assert_eq!(bench.device.rotations(), [0, 0, 0, -1]);
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
        let pins = port(&commands, Wiring::X_Y_E0_E1.port(wheel));
        assert!(pins.reverse && pins.brake);
    }
}

proptest! {
    #[test]
    fn any_wiring_that_the_motors_follow_drives_the_table(
        ports in Just(Port::ALL.to_vec()).prop_shuffle(),
        reversed: [bool; 4],
        row in 0usize..10,
    ) {
        let ports = [ports[0], ports[1], ports[2], ports[3]];
        let wiring = Wiring::new(ports, reversed).unwrap();
        let (_, negative, _, index, rotations) = TABLE[row];
        let mut bench = Bench::with(false, |s| s.wiring = wiring);
        bench.go(index, 10, if negative { -1 } else { 1 });
        let commands = bench.device.commands();
        let found = Wheel::ALL.map(|wheel| rotation(wiring.command(&commands, wheel)));
        prop_assert_eq!(found, rotations);
    }
}
