//! Any bytes at any time, in any pieces.

use crate::firmware::Firmware as _;
use proptest::prelude::*;

use super::super::kinematics::{Course, Movement};
use super::super::motion::{Change, Motion};
use super::super::{OperatorInput, event};
use super::*;

/// Bytes as clients, and bad ones, send them.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let motion = (any::<u8>(), 0u8..7, any::<u16>(), any::<i16>());
    let motion = motion.prop_map(|(is_reset, moving_idx, s, v)| {
        let s = s % 50;
        let request = Request::Motion {
            seq: 0,
            is_reset,
            moving_idx,
            s,
            v,
        };
        request.encode()
    });
    let mode = (0u8..3).prop_map(|mode| Request::ControlMode { seq: 0, mode }.encode());
    let line = ("[XYZABQ]-?[0-9]{0,6} ?\r?\n").prop_map(String::into_bytes);
    let junk = prop::collection::vec(any::<u8>(), 0..12);
    let piece = prop_oneof![4 => motion, 1 => mode, 4 => line, 2 => junk];
    prop::collection::vec(piece, 0..15).prop_map(|pieces| pieces.concat())
}

/// Everything that the device has said and done.
fn trace(bench: &mut Bench) -> (Vec<Vec<u8>>, Vec<(SimTime, EventKind)>) {
    let output = std::iter::from_fn(|| bench.device.poll_output());
    let output = output.map(|(_, bytes)| bytes).collect();
    (output, bench.events())
}

/// A bench after `bytes` on both links at one instant, in pieces.
fn fed(bytes: &[u8], cuts: &[usize]) -> Bench {
    let mut bench = Bench::with_ros();
    let mut cuts: Vec<usize> = cuts.iter().map(|cut| cut % (bytes.len() + 1)).collect();
    cuts.extend([0, bytes.len()]);
    cuts.sort_unstable();
    for link in Link::ALL {
        for pair in cuts.windows(2) {
            bench
                .device
                .handle_bytes(bench.now, link, &bytes[pair[0]..pair[1]]);
        }
    }
    bench
}

#[test]
fn queues_are_bounded_when_nothing_is_taken_from_them() {
    let mut bench = Bench::with_ros();
    bench.device.advance(SimTime::from_secs(1000));
    for _ in 0..5000 {
        bench.line("?\n");
    }
    let (output, events) = trace(&mut bench);
    assert!(output.len() <= 64);
    assert!(events.len() <= 1024);
}

#[test]
fn the_same_time_again_does_nothing_more() {
    let mut bench = Bench::with_ros();
    bench.go(0, 10, 500);
    bench.run_ms(500);
    trace(&mut bench);
    bench.device.sense(bench.now, &bench.readings);
    bench.device.advance(bench.now);
    assert_eq!(trace(&mut bench), (vec![], vec![]));
}

#[test]
fn every_event_has_words_and_a_code() {
    let motion = Motion {
        movement: Movement {
            course: Course::Rotate,
            negative: true,
        },
        revolutions: 1.5,
        speed_rpm: 30.0,
    };
    let started = event::motion(Change::Started(motion));
    assert_eq!(started.to_string(), "turn left 1.5 rev at 30 rpm started");
    assert_eq!(started.code().name, "motion_started");
    let mut bench = Bench::with_ros();
    bench.line("X-10\r\n");
    bench
        .device
        .handle_bytes(bench.now, Link::Main, &[0xAA, 0xBB]);
    bench.send(Request::ControlMode { seq: 7, mode: 0 });
    let words = |(_, event): (SimTime, EventKind)| event.to_string();
    let said: Vec<String> = bench.events().into_iter().map(words).collect();
    for wanted in [
        "line X-10",
        "bytes that begin no packet: AA BB",
        "control_mode seq 7 mode board",
    ] {
        assert!(said.iter().any(|said| said == wanted), "{said:?}");
    }
    bench.line("x\n");
    let (_, event) = bench.events().pop().unwrap();
    assert_eq!(
        event.to_string(),
        "line `x` ignored: one of X, Y, Z, A, B and a whole number are wanted"
    );
}

proptest! {
    #[test]
    fn bytes_that_change_a_pin_are_output(bytes in stream()) {
        let mut bench = Bench::with_ros();
        for link in Link::ALL {
            for &byte in &bytes {
                while bench.device.poll_output().is_some() || bench.device.poll_event().is_some() {}
                prop_assert!(!bench.device.has_output());
                let before = bench.device.commands();
                bench.device.handle_bytes(bench.now, link, &[byte]);
                prop_assert!(bench.device.has_output() || bench.device.commands() == before);
            }
        }
    }

    #[test]
    fn any_split_gives_the_same(bytes in stream(), cuts in prop::collection::vec(any::<usize>(), 0..10)) {
        let mut whole = fed(&bytes, &[]);
        let mut split = fed(&bytes, &cuts);
        prop_assert_eq!(whole.device.commands(), split.device.commands());
        whole.run_ms(300);
        split.run_ms(300);
        prop_assert_eq!(trace(&mut whole), trace(&mut split));
        prop_assert_eq!(whole.turned, split.turned);
    }

    #[test]
    fn anything_at_any_time_leaves_sound_pins(
        acts in prop::collection::vec((0u8..5, stream(), 0u64..200, any::<[u32; 5]>()), 0..20),
    ) {
        let mut bench = Bench::with_ros();
        for (act, bytes, wait, pulses) in acts {
            match act {
                0 => bench.device.handle_bytes(bench.now, Link::Main, &bytes),
                1 => bench.device.handle_bytes(bench.now, Link::Ros, &bytes),
                2 => bench.read(|r| r.pulses = pulses),
                3 => bench.read(|r| {
                    r.board_powered ^= pulses[0] % 4 == 0;
                    r.echoes[0] = Some(f64::from_bits(u64::from(pulses[1]) << 32));
                }),
                _ => {
                    let course = Course::ALL[usize::from(pulses[0].to_le_bytes()[0] % 5)];
                    let movement = Movement { course, negative: pulses[1] % 2 == 0 };
                    bench.device.operate(bench.now, OperatorInput::Press(movement));
                }
            }
            bench.run_ms(wait);
            let commands = bench.device.commands();
            prop_assert!((0.0..=1.0).contains(&commands.speed_voltage));
            let driven = commands.ports.iter().any(|port| !port.brake);
            prop_assert_eq!(driven, commands.speed_voltage > 0.0);
            prop_assert!(bench.device.waiting() <= 16);
            prop_assert!(bench.device.next_deadline().is_none_or(|due| due > bench.now));
        }
        for (_, event) in bench.events() {
            prop_assert!(!event.to_string().is_empty() && !event.code().name.is_empty());
            let _ = (event.level(), event.bytes(), event.is_client_error());
        }
    }

    #[test]
    fn the_pulses_of_any_motion_are_its_distance(
        moving_idx in 0u8..5, s in 0u16..40, v in 100i16..=500, negative: bool,
    ) {
        let mut bench = Bench::new();
        bench.go(moving_idx, s, if negative { -v } else { v });
        let rotations = bench.device.drive.rotations();
        bench.until(SimTime::from_secs(25));
        prop_assert!(!bench.is_driving());
        let wanted = rotations.map(|rotation| i64::from(rotation) * i64::from(s));
        prop_assert_eq!(bench.tenths(), wanted);
        let circumference_mm = 314.159_265;
        let mile = f64::from(bench.last_status().mile);
        prop_assert!((mile - f64::from(s) / 10.0 * circumference_mm).abs() <= 0.51);
    }
}
