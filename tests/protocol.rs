//! Requests good and bad over the real line: what is answered, what is not, and what is reported.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::time::Duration;

use harness::wire::{frame, holds_frame, i16_at, motors, u32_at};
use harness::{Sim, with_code};
use serde_json::Value;

const JSON: [&str; 2] = ["--log-format", "json"];

fn sim_with(args: &[&str]) -> Sim {
    Sim::start(&[&JSON, args].concat())
}

#[test]
fn every_command_is_answered() {
    let sim = sim_with(&[]);
    let mut client = sim.client();
    let anything: Vec<u8> = (0..=254).collect();

    // 0x02 power control: 12 V B, 48 V and 5 V on.
    assert_eq!(client.ask(0x02, &[0b11_0010, 0, 0, 0]), [1]);
    // 0x03 and 0x04: what is set comes back; a duty above 100 % is refused and changes nothing.
    let duty = [0x2C, 0x01, 0, 0, 0xE8, 0x03, 1, 0];
    assert_eq!(client.ask(0x03, &duty), [1]);
    assert_eq!(client.ask(0x04, &[]), duty);
    assert_eq!(client.ask(0x03, &[0xE9, 0x03, 0, 0, 0, 0, 0, 0]), [0]);
    assert_eq!(client.ask(0x04, &anything), duty);
    // 0x05: nothing is wired to the inputs.
    assert_eq!(client.ask(0x05, &[]), [0; 24]);
    assert_eq!(client.ask(0x05, &anything), [0; 24]);
    // 0x06: this client is in control; outputs A, C and D have a duty above 0.
    let info = client.ask(0x06, &anything);
    assert_eq!(info.len(), 76);
    assert_eq!(info[52..56], [0, 0, 0b11_0010, 0b1101]);
    assert_eq!(u32_at(&info, 48), 0, "no fault in sysStatus");
    assert_eq!(u32_at(&info, 40), 250, "12 V AB is at 25.0 °C");
    assert_eq!(info[56..], [0; 20], "reserved bytes");
    // 0x07 heartbeat, 0xF0 version.
    assert_eq!(client.ask(0x07, &anything), [1]);
    assert_eq!(client.ask(0xF0, &anything).len(), 8);
    // 0x12: standing, with some charge left.
    let motors = client.ask(0x12, &[0, 0, 0, 0]);
    assert_eq!((motors.len(), &motors[..4]), (8, &[0; 4][..]));
    assert!(i16_at(&motors, 4) > 0);
    assert_eq!(motors[6..], [0; 2], "reserved bytes");

    sim.wait_event("duty_out_of_range");
    let summary = sim.stop().expect_clean().summary();
    assert_eq!(summary["requests"], 11);
    assert_eq!(summary["replies"], 11);
}

#[test]
fn frames_that_are_no_requests_are_reported_and_not_answered() {
    let sim = sim_with(&[]);
    let mut client = sim.client();

    // The last bit of the CRC is wrong.
    let mut wrong = frame(0xF0, &[]);
    wrong[5] ^= 0x80;
    client.send(&wrong);
    client.expect_silence_until_heartbeat();
    let event = sim.wait_event("bad_crc");
    assert_eq!(event["bytes"], "AA 55 00 F0 F7 87");
    let text = event["text"].as_str().unwrap();
    assert!(
        text.contains("AA 55 00 F0 F7 87") && text.contains("F7 07"),
        "{text}"
    );

    client.send(&frame(0x55, &[1, 2]));
    client.expect_silence_until_heartbeat();
    assert!(text_of(&sim.wait_event("unknown_command")).contains("0x55"));

    client.send(&frame(0x12, &[0xE8, 0x03]));
    client.expect_silence_until_heartbeat();
    assert!(text_of(&sim.wait_event("wrong_length")).contains("set_motors takes 4"));
    // The two commands whose reply can say no do so.
    assert_eq!(client.ask(0x02, &[1]), [0]);
    assert_eq!(client.ask(0x03, &[]), [0]);

    client.send(&motors(1001, -3000));
    assert_eq!(client.receive().0, 0x12);
    assert!(text_of(&sim.wait_event("motors_out_of_range")).contains("-3000"));

    assert_eq!(client.ask(0x06, &[])[54], 0, "no rail was switched on");
    let summary = sim.stop().expect_clean().summary();
    for (code, count) in [("bad_crc", 1), ("unknown_command", 1), ("wrong_length", 3)] {
        let entry = with_code(summary["events"].as_array().unwrap(), code).remove(0);
        assert_eq!(
            (&entry["count"], &entry["client_faults"]),
            (&count.into(), &count.into())
        );
    }
}

fn text_of(event: &Value) -> &str {
    event["text"].as_str().unwrap()
}

#[test]
fn a_valid_frame_after_garbage_is_answered() {
    // Some of it looks like a frame until a pause ends it, and a busy machine must not make one.
    let sim = sim_with(&["--set", "r150.inter_byte_timeout=400ms"]);
    let mut client = sim.client();
    let garbage: [&[u8]; 6] = [
        &[0x00],
        &[0xAA],
        // What looks like the beginning of the longest frame there is.
        &[0xAA, 0x55, 0xFF, 0x06],
        &[0xAA, 0x55, 0xAA, 0x55],
        &[0xAA, 0x55, 0x04, 0x12, 0xE8, 0x03],
        &[0x5A; 1000],
    ];
    for garbage in garbage {
        // In one write, so that only the content tells them apart.
        client.send(&[garbage, &frame(0xF0, &[])].concat());
        let (command, reply) = client.receive();
        assert_eq!((command, reply.len()), (0xF0, 8), "after {garbage:02X?}");
    }
    sim.wait_event("noise");
    client.expect_silence_until_heartbeat();
    sim.stop().expect_clean();
}

#[test]
fn a_frame_may_come_byte_by_byte_but_not_pause_for_too_long() {
    // Much longer pauses than the machine makes by itself, and an even longer timeout.
    let sim = sim_with(&["--set", "r150.inter_byte_timeout=20s"]);
    let mut client = sim.client();
    for byte in frame(0x02, &[1, 0, 0, 0]) {
        client.send(&[byte]);
        std::thread::sleep(Duration::from_millis(25));
    }
    assert_eq!(client.receive(), (0x02, vec![1]));
    drop(client);
    let finished = sim.stop().expect_clean();
    assert!(with_code(&finished.json(), "partial_frame").is_empty());

    let sim = sim_with(&[]);
    let mut client = sim.client();
    let request = frame(0xF0, &[]);
    client.send(&request[..3]);
    // The module gives up after 20 ms by itself.
    assert_eq!(sim.wait_event("partial_frame")["bytes"], "AA 55 00");
    client.send(&request[3..]);
    client.expect_silence_until_heartbeat();
    sim.stop().expect_clean();
}

#[test]
fn a_wrong_baud_rate_garbles_and_is_reported_once() {
    let sim = sim_with(&[]);
    for (round, baud) in [9600, 57_600].into_iter().enumerate() {
        let mut client = harness::client::Client::open_at(sim.port(), baud);
        for _ in 0..5 {
            client.send(&frame(0xF0, &[]));
            // A valid reply would take 2 ms; there is none to wait for.
            let garbled = client.read_for(Duration::from_millis(60));
            assert!(!holds_frame(&garbled), "{garbled:02X?} at {baud} baud");
        }
        drop(client);
        sim.wait_events("client_detached", 2 * round + 1);
        let mut client = sim.client();
        assert_eq!(client.ask(0xF0, &[]).len(), 8, "after {baud} baud");
        drop(client);

        // The end of the mismatch comes after every event about it.
        sim.wait_events("baud_matched", round + 1);
        let said = sim.wait_events("baud_mismatch", round + 1);
        assert_eq!(said.len(), round + 1, "one event for each speed");
        let text = text_of(&said[round]);
        assert!(text.contains(&baud.to_string()), "{text}");
        assert!(text.contains("open the port at 115200 baud"), "{text}");
    }
    let summary = sim.stop().expect_clean().summary();
    let said = with_code(summary["events"].as_array().unwrap(), "baud_mismatch");
    assert_eq!(said[0]["client_faults"], 2);
}

#[test]
fn a_request_whose_byte_meets_another_speed_on_its_way_is_not_answered() {
    use std::io::Write as _;

    use serialport::SerialPort as _;

    let sim = Sim::start(&["--log-format", "json"]);
    let mut port = harness::client::Client::try_open(sim.port(), 110).unwrap();
    // Its first byte takes 91 ms.
    port.write_all(&frame(0x07, &[])).unwrap();
    std::thread::sleep(Duration::from_millis(30));
    port.set_baud_rate(115_200).unwrap();
    let mut client = harness::client::Client::over(port);
    // What is answered first is the next request.
    assert_eq!(client.ask(0xF0, &[]).len(), 8);
    sim.stop().expect_clean();
}
