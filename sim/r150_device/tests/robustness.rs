//! Any bytes, any split, any order of calls.

use crate::firmware::Firmware as _;
use proptest::prelude::*;

use super::*;
use crate::r150_device::codec::encode;
use crate::r150_device::control::Parts;
use crate::r150_device::vehicle::{Key, OperatorInput};

fn frame() -> impl Strategy<Value = Vec<u8>> {
    let command = prop::sample::select(vec![0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x12, 0xF0, 0x99]);
    (command, prop::collection::vec(any::<u8>(), 0..10)).prop_map(|(c, p)| encode(c, &p))
}

/// Frames, torn frames and noise.
fn stream() -> impl Strategy<Value = Vec<u8>> {
    let torn = (frame(), 0usize..20).prop_map(|(mut f, at)| {
        f.truncate(at);
        f
    });
    let motors = (any::<i16>(), any::<i16>())
        .prop_map(|(right, left)| Request::SetMotors { right, left }.encode());
    let noise = prop::collection::vec(any::<u8>(), 0..20);
    prop::collection::vec(
        prop_oneof![3 => frame(), 2 => motors, 1 => torn, 1 => noise],
        0..20,
    )
    .prop_map(|parts| parts.concat())
}

#[derive(Debug, Clone)]
enum Step {
    Receive(Vec<u8>),
    Wait(u64),
    Read {
        current: f64,
        celsius: f64,
        volts: f64,
        powered: bool,
    },
    Operate(OperatorInput),
}

fn step() -> impl Strategy<Value = Step> {
    let actions = vec![
        OperatorInput::Unlock,
        OperatorInput::Lock,
        OperatorInput::ReleaseParking,
        OperatorInput::Autonomous,
        OperatorInput::Press(Key::Left),
        OperatorInput::ReleaseKey,
        OperatorInput::EmergencyStop(true),
        OperatorInput::EmergencyStop(false),
        OperatorInput::AppHolds(Parts {
            power: true,
            pwm: false,
        }),
        OperatorInput::AppHolds(Parts {
            power: false,
            pwm: false,
        }),
    ];
    prop_oneof![
        stream().prop_map(Step::Receive),
        (0u64..4_000_000_000).prop_map(Step::Wait),
        (
            any::<f64>(),
            any::<f64>(),
            0.0..60.0,
            prop::bool::weighted(0.8)
        )
            .prop_map(|(current, celsius, volts, powered)| Step::Read {
                current,
                celsius,
                volts,
                powered
            }),
        prop::sample::select(actions).prop_map(Step::Operate),
    ]
}

/// Everything that comes out, with its time.
fn output(chunks: &[(SimTime, &[u8])]) -> (Vec<u8>, Vec<EventKind>) {
    let mut bench = Bench::new();
    let mut bytes = Vec::new();
    for (at, chunk) in chunks {
        bench.device.handle_bytes(*at, chunk);
        while let Some(frame) = bench.device.poll_output() {
            bytes.extend(frame);
        }
    }
    bench.device.advance(SimTime::from_secs(100));
    (bytes, bench.events())
}

proptest! {
    #[test]
    fn any_order_of_anything_leaves_it_sane(steps in prop::collection::vec(step(), 0..30)) {
        let mut bench = Bench::new();
        for step in steps {
            match step {
                Step::Receive(bytes) => { bench.send(&bytes); }
                Step::Wait(nanos) => bench.after(Duration::from_nanos(nanos)),
                Step::Read { current, celsius, volts, powered } => bench.read(|r| {
                    r.rail_current = [current; 6];
                    r.temperature = [celsius; 2];
                    r.bus_voltage = volts;
                    r.module_powered = powered;
                }),
                Step::Operate(action) => bench.device.operate(bench.now, action),
            }
            let commands = bench.device.commands();
            prop_assert!(commands.motor_duty.right.abs() <= 1.0);
            prop_assert!(commands.motor_duty.left.abs() <= 1.0);
            prop_assert!(bench.device.power_status() & 0b1100_0000 == 0);
            // Whatever is due lies ahead.
            bench.device.advance(bench.now);
            prop_assert!(bench.device.next_deadline().is_none_or(|due| due > bench.now));
        }
    }

    #[test]
    fn any_split_at_one_instant_gives_the_same(bytes in stream(), at in 0usize..200) {
        let (head, tail) = bytes.split_at(at.min(bytes.len()));
        let now = SimTime::from_secs(1);
        prop_assert_eq!(output(&[(now, head), (now, tail)]), output(&[(now, &bytes)]));
        let single: Vec<(SimTime, &[u8])> = bytes.chunks(1).map(|byte| (now, byte)).collect();
        prop_assert_eq!(output(&single), output(&[(now, &bytes)]));
    }

    #[test]
    fn bytes_that_change_a_pin_are_output(bytes in stream()) {
        let mut bench = Bench::new();
        bench.device.advance(bench.now);
        for byte in bytes {
            while bench.device.poll_output().is_some() || bench.device.poll_event().is_some() {}
            prop_assert!(!bench.device.has_output());
            let before = bench.device.commands();
            bench.device.handle_bytes(bench.now, &[byte]);
            prop_assert!(bench.device.has_output() || bench.device.commands() == before);
        }
    }

    #[test]
    fn every_reply_is_a_valid_frame(bytes in stream()) {
        let (replies, _) = output(&[(SimTime::ZERO, &bytes)]);
        let mut decoder = codec::decoder(Duration::from_secs(1));
        let mut bad = Vec::new();
        for byte in replies {
            for decoded in decoder.push(SimTime::ZERO, byte) {
            match decoded {
                Decoded::Frame(frame) if read_reply(&frame).is_some() => {}
                other => bad.push(other),
            }
            }
        }
        prop_assert_eq!(bad, []);
        prop_assert_eq!(decoder.deadline(), None);
    }

    #[test]
    fn what_a_request_encodes_it_parses(status: u32, duty: [u16; 4], right: i16, left: i16) {
        for request in [
            Request::PowerControl { on: status },
            Request::SetPwmOutputs { duty },
            Request::SetMotors { right, left },
        ] {
            let frame = request.encode();
            let parsed = Request::parse(frame[3], &frame[4..frame.len() - 2]);
            prop_assert_eq!(parsed, Ok(request));
        }
    }
}
