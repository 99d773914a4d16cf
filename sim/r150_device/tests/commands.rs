//! Every command, byte by byte, and every refusal.

use super::*;
use crate::r150_device::codec::encode;
use crate::r150_device::command::{self, SystemInfo};
use crate::r150_device::settings::{
    OutOfRange, RefusalReply, ReplyCommand, Version, VersionOrder, Voltage48v,
};

/// A frame written out: command, parameters; header, length and CRC are checked by the codec's own
/// tests.
fn exchange(bench: &mut Bench, command: u8, parameters: &[u8]) -> Option<Vec<u8>> {
    bench.send(&encode(command, parameters))
}

fn answer(command: u8, parameters: &[u8]) -> Option<Vec<u8>> {
    Some(encode(command, parameters))
}

#[test]
fn power_control_0x02() {
    let mut bench = Bench::new();
    assert_eq!(
        exchange(&mut bench, 0x02, &[0b10_1001, 0, 0, 0]),
        answer(0x02, &[1])
    );
    assert_eq!(
        bench.device.commands().rail_on,
        [true, false, false, true, false, true]
    );
    assert_eq!(bench.info().power_status, 0b10_1001);
    assert_eq!(
        exchange(&mut bench, 0x02, &[0b01_0110, 0, 0, 0]),
        answer(0x02, &[1])
    );
    assert_eq!(
        bench.device.commands().rail_on,
        [false, true, true, false, true, false]
    );
}

#[test]
fn reserved_power_bits_are_ignored_and_reported() {
    let mut bench = Bench::new();
    assert_eq!(
        exchange(&mut bench, 0x02, &[0xC1, 0xFF, 0xFF, 0xFF]),
        answer(0x02, &[1])
    );
    assert_eq!(bench.info().power_status, 0b00_0001);
    assert_eq!(bench.codes(), ["reserved_bits"]);
}

#[test]
fn set_pwm_outputs_0x03_and_get_them_0x04() {
    let mut bench = Bench::new();
    // 0, 1, 500 and 1000 in 0.1 %.
    let duty = [0, 0, 1, 0, 0xF4, 0x01, 0xE8, 0x03];
    assert_eq!(exchange(&mut bench, 0x03, &duty), answer(0x03, &[1]));
    assert_eq!(exchange(&mut bench, 0x04, &[]), answer(0x04, &duty));
    assert_eq!(exchange(&mut bench, 0x04, &[1, 2, 3]), answer(0x04, &duty));
    assert_eq!(bench.device.commands().pwm_out_duty, [0.0, 0.001, 0.5, 1.0]);
    assert_eq!(bench.info().pwm_status, 0b1110);
}

#[test]
fn a_duty_above_1000_is_refused_and_changes_nothing() {
    let mut bench = Bench::new();
    let duty = [10, 0, 20, 0, 30, 0, 40, 0];
    exchange(&mut bench, 0x03, &duty);
    let too_much = [1, 0, 1, 0, 1, 0, 0xE9, 0x03];
    assert_eq!(exchange(&mut bench, 0x03, &too_much), answer(0x03, &[0]));
    assert_eq!(exchange(&mut bench, 0x04, &[]), answer(0x04, &duty));
    assert_eq!(bench.codes(), ["duty_out_of_range"]);
}

#[test]
fn get_pwm_inputs_0x05() {
    let mut bench = Bench::new();
    let mut expected = Vec::new();
    for frequency_hz in [10_u32, 20_000, 0, 1234] {
        expected.extend(frequency_hz.to_le_bytes());
    }
    for duty in [500_u16, 1000, 0, 124] {
        expected.extend(duty.to_le_bytes());
    }
    assert_eq!(exchange(&mut bench, 0x05, &[]), answer(0x05, &expected));
}

#[test]
fn system_info_0x06() {
    let mut bench = Bench::new();
    exchange(&mut bench, 0x02, &[0b11_1101, 0, 0, 0]);
    exchange(&mut bench, 0x03, &[0; 8]);
    let mut expected: Vec<u8> = Vec::new();
    for millivolts in [12_010_u32, 0, 11_980, 12_000, 51_250] {
        expected.extend(millivolts.to_le_bytes());
    }
    for milliamperes in [1500_i32, 0, 250, 3125, 7000] {
        expected.extend(milliamperes.to_le_bytes());
    }
    for tenths_celsius in [313_i32, 400] {
        expected.extend(tenths_celsius.to_le_bytes());
    }
    expected.extend([0; 4]);
    expected.extend([0, 0, 0b11_1101, 0]);
    expected.extend([0; 20]);
    assert_eq!(expected.len(), 76);
    assert_eq!(
        exchange(&mut bench, 0x06, b"anything"),
        answer(0x06, &expected)
    );
}

#[test]
fn negative_readings_keep_their_sign_and_absurd_ones_saturate() {
    let mut bench = Bench::new();
    bench.read(|r| {
        r.temperature = [-12.34, f64::NAN];
        r.rail_current[0] = -0.5;
        r.rail_voltage[0] = -3.0;
        r.motor_rpm.right = 1e9;
        r.soc = -0.1;
    });
    bench.spin();
    let info = bench.info();
    assert_eq!(info.temp_12v, [-123, 0]);
    assert_eq!(info.current_12v[0], -500);
    assert_eq!(info.voltage_12v[0], 0);
    let expected = Reply::Motors(command::Motors {
        right_rpm: i16::MAX,
        left_rpm: -700,
        soc: 0,
    });
    assert_eq!(bench.drive(0, 0), Some(expected));
}

#[test]
fn heartbeat_0x07() {
    let mut bench = Bench::new();
    assert_eq!(exchange(&mut bench, 0x07, &[]), answer(0x07, &[1]));
    assert_eq!(exchange(&mut bench, 0x07, &[0; 255]), answer(0x07, &[1]));
}

#[test]
fn version_0xf0_has_the_major_version_in_the_most_significant_byte() {
    let mut bench = Bench::with(|s| {
        s.hardware_version = Version([1, 2, 3, 4]);
        s.software_version = Version([5, 6, 7, 8]);
    });
    let expected = [4, 3, 2, 1, 8, 7, 6, 5];
    assert_eq!(exchange(&mut bench, 0xF0, &[]), answer(0xF0, &expected));
}

#[test]
fn set_motors_0x12() {
    let mut bench = Bench::new();
    bench.spin();
    let speed = [0xE9, 0x05, 0x44, 0xFD, 0x20, 0x03, 0, 0]; // 1513, -700, 800, reserved
    let forward_right_backward_left = [0xE8, 0x03, 0x18, 0xFC];
    assert_eq!(
        exchange(&mut bench, 0x12, &forward_right_backward_left),
        answer(0x12, &speed)
    );
    assert_eq!(bench.duty(), [1.0, -1.0]);
}

#[test]
fn a_motor_pwm_beyond_1000_is_clamped_and_reported() {
    for (sent, applied) in [
        (1001, 1.0),
        (i16::MAX, 1.0),
        (-1001, -1.0),
        (i16::MIN, -1.0),
    ] {
        let mut bench = Bench::new();
        assert!(bench.drive(sent, 100).is_some());
        assert_eq!(bench.duty(), [applied, 0.1]);
        assert_eq!(bench.codes(), ["motors_out_of_range"], "{sent}");
    }
    let mut bench = Bench::new();
    bench.drive(1000, -1000);
    assert_eq!(bench.codes(), [""; 0]);
}

#[test]
fn a_wrong_length_is_answered_false_by_0x02_and_0x03_and_not_at_all_by_0x12() {
    for (command, allowed) in [(0x02, 4), (0x03, 8), (0x12, 4)] {
        for length in (0..=255).filter(|length| *length != allowed) {
            let mut bench = Bench::new();
            let reply = exchange(&mut bench, command, &vec![1; length]);
            let expected = if command == 0x12 {
                None
            } else {
                answer(command, &[0])
            };
            assert_eq!(reply, expected, "0x{command:02X} with {length} bytes");
            assert_eq!(bench.codes(), ["wrong_length"]);
            assert_eq!(bench.device.power_status(), 0);
            assert_eq!(bench.duty(), [0.0, 0.0]);
            assert!(
                !bench.device.control().by_client.power,
                "it takes no control"
            );
        }
    }
}

#[test]
fn an_unknown_command_gets_no_reply_and_changes_nothing() {
    let known = [0x02, 0x03, 0x04, 0x05, 0x06, 0x07, 0x12, 0xF0];
    for command in (0..=255).filter(|command| !known.contains(command)) {
        let mut bench = Bench::new();
        assert_eq!(exchange(&mut bench, command, &[1, 0, 0, 0]), None);
        assert_eq!(bench.codes(), ["unknown_command"]);
        assert!(!bench.device.control().by_client.power);
    }
}

#[test]
fn a_bad_crc_gets_no_reply_and_changes_nothing() {
    for bit in 0..8 * 6 {
        let mut bench = Bench::new();
        let mut frame = Request::PowerControl { on: 1 }.encode();
        let at = frame.len() - 6 + bit / 8; // the parameters and the CRC
        frame[at] ^= 1 << (bit % 8);
        assert_eq!(bench.send(&frame), None);
        assert_eq!(bench.codes(), ["bad_crc"], "bit {bit}");
        assert_eq!(bench.device.power_status(), 0);
    }
}

/// Each assumption about a command can be chosen otherwise.
#[test]
fn other_choices() {
    let mut bench = Bench::with(|s| s.reply_command = ReplyCommand::HighBit);
    assert_eq!(exchange(&mut bench, 0x07, &[]), answer(0x87, &[1]));

    let mut bench = Bench::with(|s| s.on_unknown_command = RefusalReply::False);
    assert_eq!(exchange(&mut bench, 0x99, &[]), answer(0x99, &[0]));

    let mut bench = Bench::with(|s| s.on_wrong_length = RefusalReply::Silent);
    assert_eq!(exchange(&mut bench, 0x02, &[]), None);

    let mut bench = Bench::with(|s| s.on_duty_out_of_range = OutOfRange::Clamp);
    let sent = [10, 0, 0xE9, 0x03, 0xFF, 0xFF, 0xE8, 0x03];
    assert_eq!(exchange(&mut bench, 0x03, &sent), answer(0x03, &[1]));
    assert_eq!(bench.device.control().outputs.pwm, [10, 1000, 1000, 1000]);

    let mut bench = Bench::with(|s| s.on_motors_out_of_range = OutOfRange::Refuse);
    bench.drive(100, 200);
    bench.drive(1001, 0);
    assert_eq!(bench.duty(), [0.1, 0.2]);

    let mut bench = Bench::with(|s| {
        s.hardware_version = Version([1, 2, 3, 4]);
        s.version_order = VersionOrder::MajorLow;
    });
    let expected = [1, 2, 3, 4, 1, 0, 0, 0];
    assert_eq!(exchange(&mut bench, 0xF0, &[]), answer(0xF0, &expected));

    let mut bench = Bench::with(|s| s.voltage_48v = Voltage48v::Output);
    assert_eq!(bench.info().voltage_48v, 51_200);
}

#[test]
fn events_carry_the_bytes_as_they_were() {
    let mut bench = Bench::with(|s| s.reply_command = ReplyCommand::HighBit);
    let sent = encode(0x07, b"abc");
    let replied = bench.send(&sent).unwrap();
    let events = bench.events();
    let bytes: Vec<_> = events.iter().filter_map(EventKind::bytes).collect();
    assert_eq!(bytes, [&sent[..], &replied[..]]);
    for bad in [
        encode(0x99, &[1]),
        encode(0x12, &[1]),
        encode(0x02, &[0xFF; 4]),
    ] {
        bench.send(&bad);
        let events = bench.events();
        assert!(
            events
                .iter()
                .any(|e| e.is_client_error() && e.bytes() == Some(&bad[..])),
            "{events:?}"
        );
    }
}

#[test]
fn a_reply_begins_after_the_reply_delay() {
    let delay = Duration::from_millis(3);
    let mut bench = Bench::with(|s| s.reply_delay = delay);
    assert_eq!(exchange(&mut bench, 0x07, &[]), None);
    bench.after(delay - QUANTUM);
    assert_eq!(bench.reply(), None);
    bench.after(QUANTUM);
    assert_eq!(bench.reply(), answer(0x07, &[1]));
}

/// Mean and standard deviation of what was read.
fn spread(read: &[f64]) -> [f64; 2] {
    let count = read.len() as f64;
    let mean = read.iter().sum::<f64>() / count;
    let square = read.iter().map(|x| (x - mean).powi(2)).sum::<f64>();
    [mean, (square / count).sqrt()]
}

#[test]
fn by_default_every_reading_of_0x06_has_the_noise_of_its_kind() {
    let defaults = NoiseSettings::default();
    let mut bench = Bench::with(|s| s.noise = defaults.clone());
    bench.power(0b11_1111);
    let seen: Vec<_> = (0..500).map(|_| bench.info()).collect();
    let of = |read: &dyn Fn(&SystemInfo) -> f64| seen.iter().map(read).collect::<Vec<_>>();
    let mut cases = vec![
        (
            of(&|i| f64::from(i.voltage_48v) / 1e3),
            51.25,
            defaults.voltage,
        ),
        (
            of(&|i| f64::from(i.current_48v) / 1e3),
            7.0,
            defaults.current,
        ),
        (
            of(&|i| f64::from(i.temp_12v[0]) / 10.0),
            31.25,
            defaults.temperature,
        ),
        (
            of(&|i| f64::from(i.temp_12v[1]) / 10.0),
            40.0,
            defaults.temperature,
        ),
    ];
    for (rail, (volts, amperes)) in [(12.01, 1.5), (0.0, 0.0), (11.98, 0.25), (12.0, 3.125)]
        .into_iter()
        .enumerate()
    {
        if volts > 0.0 {
            let read = of(&|i| f64::from(i.voltage_12v[rail]) / 1e3);
            cases.push((read, volts, defaults.voltage));
        }
        // Without current, too, the reading has noise, and may be a little below zero.
        let read = of(&|i| f64::from(i.current_12v[rail]) / 1e3);
        cases.push((read, amperes, defaults.current));
    }
    for (read, value, deviation) in cases {
        let [mean, spread] = spread(&read);
        assert!((mean - value).abs() < 0.2 * deviation, "{mean} for {value}");
        // The step of the field of temperatures is as large as the noise.
        let ratio = spread / deviation;
        assert!((0.85..1.2).contains(&ratio), "{spread} for {value}");
    }
    // A voltage cannot be negative, so an output that is off reads 0 half of the time.
    let off: Vec<_> = seen.iter().map(|info| info.voltage_12v[1]).collect();
    let zeros = off.iter().filter(|mv| **mv == 0).count();
    assert!((150..350).contains(&zeros), "{zeros}");
    assert!(off.iter().all(|mv| *mv < 60), "{off:?}");
}

#[test]
fn each_kind_of_noise_is_a_setting_of_its_own() {
    type Change = fn(&mut NoiseSettings);
    let kinds: [(Change, &str); 3] = [
        (|noise| noise.voltage = 1.0, "voltages"),
        (|noise| noise.current = 1.0, "currents"),
        (|noise| noise.temperature = 1.0, "temperatures"),
    ];
    for (change, wanted) in kinds {
        let mut bench = Bench::with(|s| change(&mut s.noise));
        let exact = Bench::new().info();
        let info = bench.info();
        let differ = [
            ("voltages", info.voltage_48v != exact.voltage_48v),
            ("currents", info.current_12v != exact.current_12v),
            ("temperatures", info.temp_12v != exact.temp_12v),
        ];
        let found: Vec<_> = differ.iter().filter(|(_, differs)| *differs).collect();
        assert_eq!(found, [&(wanted, true)]);
    }
}

#[test]
fn speeds_have_noise_while_a_motor_turns_and_none_while_it_stands() {
    let defaults = NoiseSettings::default();
    let mut bench = Bench::with(|s| s.noise = defaults.clone());
    let replies = |bench: &mut Bench| -> Vec<f64> {
        let one = |bench: &mut Bench| match bench.device.motor_reply() {
            Reply::Motors(motors) => f64::from(motors.right_rpm),
            other => panic!("{other:?}"),
        };
        (0..500).map(|_| one(bench)).collect()
    };
    assert_eq!(replies(&mut bench), [0.0; 500]);
    bench.spin();
    let [mean, deviation] = spread(&replies(&mut bench));
    assert!((mean - 1512.6).abs() < 3.0, "{mean}");
    let ratio = deviation / defaults.speed;
    assert!((0.85..1.2).contains(&ratio), "{deviation}");
}

#[test]
fn all_commands_and_no_others_have_names() {
    for byte in 0..=255 {
        let unknown = Request::parse(byte, &[]) == Err(command::Refusal::UnknownCommand(byte));
        assert_eq!(command::name(byte).is_none(), unknown, "0x{byte:02X}");
    }
}
