//! A first session, as a user has it: look, switch something on, drive, stop.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::os::fd::OwnedFd;
use std::path::PathBuf;
use std::time::{Duration, Instant};

use harness::client::Client;
use harness::wire::{frame, i16_at, motors, u32_at};
use harness::{PATIENCE, Sim, command, json_lines, until, with_code};
use rustix::fs::{Mode, OFlags};
use rustix::termios::{ControlModes, tcgetattr};
use serde_json::Value;
use serialport::{SerialPort as _, TTYPort};

/// Full ahead on the flat: 1.4 m/s on wheels of 0.25 m through a gear of 28.3.
const FULL_RPM: f64 = 1513.0;
const LOG: [&str; 3] = ["-v", "--log-format", "json"];

#[test]
fn a_first_session_over_a_pseudo_terminal() {
    let sim = Sim::start(&LOG);
    let client = sim.client();
    first_session(sim, client);
}

#[test]
fn the_same_session_over_a_serial_port() {
    let (sim, client, held) = start_on_serial_port(&LOG);
    drop(held);
    first_session(sim, Client::over(client));
}

#[test]
fn a_serial_port_gets_one_stop_bit() {
    let (sim, _client, held) = start_on_serial_port(&["--device", "mecanum"]);
    let line = tcgetattr(&held).unwrap();
    assert!(!line.control_modes.contains(ControlModes::CSTOPB));
    assert!(sim.printed().contains("8N1"), "{}", sim.printed());
    sim.stop().expect_clean();
}

/// A simulator on a serial port, the other end of the cable, and the port once more.
fn start_on_serial_port(args: &[&str]) -> (Sim, TTYPort, OwnedFd) {
    // A second pseudo-terminal is the cable; the client has the other end of it.
    let (master, mut slave) = TTYPort::pair().unwrap();
    slave.set_exclusive(false).unwrap();
    let device = PathBuf::from(slave.name().unwrap());
    // An end that no process has open hangs up, so it is held until the simulator has it; but not by
    // the crate, which would keep the simulator out.
    let held = OFlags::RDWR | OFlags::NOCTTY | OFlags::CLOEXEC;
    let held = rustix::fs::open(&device, held, Mode::empty()).unwrap();
    drop(slave);
    let mut command = command();
    command.arg("--serial").arg(&device).args(["--seed", "1"]);
    let sim = Sim::spawn(command.args(args), device, None);
    sim.wait_ready();
    (sim, master, held)
}

fn first_session(sim: Sim, mut client: Client) {
    // Version 1.0.0.0 of both, the major number last on the wire.
    assert_eq!(client.ask(0xF0, &[]), [0, 0, 0, 1, 0, 0, 0, 1]);
    switch_a_rail_on(&mut client);
    let (driven, commands) = drive(&mut client);
    let asked = stop_sending(&sim, &mut client);

    let finished = sim.stop().expect_clean();
    let summary = finished.summary();
    let distance = summary["distance_m"].as_f64().unwrap();
    // At 1.4 m/s (3 % more at most) from the first command until half a second of watchdog and
    // half a metre of braking after the last; one second more for the machine being slow.
    let most = 1.45 * (driven + Duration::from_millis(1500)).as_secs_f64() + 0.5;
    // At least what the vehicle needs to get to full speed, which it did.
    assert!((1.0..most).contains(&distance), "{distance} of {most} m");
    // Each was understood: five more for the version, the rail and a sign of life.
    let requests = commands + asked + 5;
    assert_eq!(summary["requests"], requests);
    let replies = summary["replies"].as_u64().unwrap();
    assert!((7..=requests).contains(&replies), "{replies}");
    check_watchdog_time(&finished.json());
}

fn switch_a_rail_on(client: &mut Client) {
    let before = client.ask(0x06, &[]);
    assert_eq!(before.len(), 76);
    assert_eq!((before[54], u32_at(&before, 0)), (0, 0), "12 V A is off");
    let supply = u32_at(&before, 16);
    assert!((45_000..57_000).contains(&supply), "{supply} mV");

    assert_eq!(client.ask(0x02, &1_u32.to_le_bytes()), [1]);
    let after = client.ask(0x06, &[]);
    let rail = u32_at(&after, 0);
    assert_eq!(after[54], 1, "power status shows 12 V A and nothing else");
    assert!((11_400..12_600).contains(&rail), "{rail} mV");
    assert_eq!(u32_at(&after, 4), 0, "12 V B is off");
}

/// Full ahead at 20 Hz for two seconds; says how long it took, and how many commands.
fn drive(client: &mut Client) -> (Duration, u64) {
    let start = Instant::now();
    let mut next = start;
    let mut rpm = (0, 0);
    let mut commands = 0;
    let is_full = |rpm: i16| (f64::from(rpm) / FULL_RPM - 1.0).abs() <= 0.03;
    // A machine that pauses this process for half a second trips the watchdog, so the vehicle may
    // need longer than it does on a good day; two seconds it drives in any case.
    while start.elapsed() < Duration::from_secs(2) || !(is_full(rpm.0) && is_full(rpm.1)) {
        assert!(start.elapsed() < PATIENCE, "no full speed but {rpm:?}");
        client.send(&motors(1000, 1000));
        commands += 1;
        next = (next + Duration::from_millis(50)).max(Instant::now());
        // Commands that come a little too soon get no reply.
        while let Some(left) = next.checked_duration_since(Instant::now()) {
            if let Some((command, reply)) = client.receive_within(left) {
                assert_eq!((command, reply.len()), (0x12, 8));
                rpm = (i16_at(&reply, 0), i16_at(&reply, 2));
                let soc = i16_at(&reply, 4);
                // It begins at 80 % unless a setting says otherwise.
                assert!((780..=800).contains(&soc), "{soc} of 1000");
            }
        }
    }
    (start.elapsed(), commands)
}

/// The motors stop by themselves; says how often they were asked whether they stand.
fn stop_sending(sim: &Sim, client: &mut Client) -> u64 {
    // What comes from here on is about nothing that was sent before.
    client.send(&frame(0x07, &[]));
    assert_eq!(client.skip_to(0x07, PATIENCE), Some(vec![1]));
    until("the watchdog has fired for the last command", || {
        let log = json_lines(&sim.printed());
        let last = |is: &dyn Fn(&Value) -> bool| log.iter().rposition(is);
        last(&|event| event["code"] == "watchdog_fired") > last(&is_drive)
    });
    let said = sim.wait_event("watchdog_fired");
    assert_eq!(said["level"], "warning");
    // Only the reply to a motor command tells the speed.
    let mut asked = 0;
    until("the vehicle stands", || {
        std::thread::sleep(Duration::from_millis(200));
        client.send(&motors(0, 0));
        asked += 1;
        let reply = client.skip_to(0x12, Duration::from_secs(1));
        reply.is_some_and(|reply| (i16_at(&reply, 0), i16_at(&reply, 2)) == (0, 0))
    });
    asked
}

fn is_drive(event: &Value) -> bool {
    let text = event["text"].as_str().unwrap_or_default();
    event["code"] == "request" && text.contains("set_motors right 1000 left 1000")
}

/// In simulated time the watchdog is exact, whatever the machine does.
fn check_watchdog_time(log: &[Value]) {
    let fired = with_code(log, "watchdog_fired").pop().unwrap();
    let fired_at = fired["time_s"].as_f64().unwrap();
    let last = log.iter().rfind(|event| is_drive(event)).unwrap();
    let silence = fired_at - last["time_s"].as_f64().unwrap();
    assert!((silence - 0.5).abs() < 1e-6, "fired after {silence} s");
}

#[test]
fn a_locked_vehicle_answers_and_does_not_move() {
    // Every command is to be answered, also where a busy machine delivers two close together.
    let sim = Sim::start(&["--start", "locked", "--set", "r150.over_rate=answer"]);
    let mut client = sim.client();
    let start = Instant::now();
    // Long enough for a vehicle that is ready to have moved more than a metre.
    while start.elapsed() < Duration::from_secs(1) {
        let reply = client.ask(0x12, &[0xE8, 0x03, 0xE8, 0x03]);
        assert_eq!(reply[..4], [0; 4], "both motors stand");
        std::thread::sleep(Duration::from_millis(50));
    }
    sim.wait_line(&["not_driving", "does not move the vehicle", "locked"]);
    let finished = sim.stop().expect_clean();
    let still = "0.00 m driven";
    assert!(finished.out.contains(still), "{}", finished.out);
}
