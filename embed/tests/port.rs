//! The client's end of a port: it is a serial port in simulated time.

#![expect(clippy::unwrap_used, reason = "a test")]

use std::io::{ErrorKind, Read, Write};
use std::time::Duration;

use rigsim_embed::{ClientPort, Device, Error, NewDevice, Simulation};
use serialport::{ClearBuffer, DataBits, Parity, SerialPort, StopBits};

const HEARTBEAT: [u8; 6] = [0xAA, 0x55, 0x00, 0x07, 0xC7, 0x84];
const ALIVE: [u8; 7] = [0xAA, 0x55, 0x01, 0x07, 0x01, 0xC6, 0x53];
const MS: fn(u64) -> Duration = Duration::from_millis;

/// Each byte of its replies comes by itself, at the nanosecond at which its stop bit ends.
fn r150() -> (Simulation, Device, ClientPort) {
    let sim = Simulation::builder().device("r150");
    let sim = sim.set("r150.adapter", "bytes").build().unwrap();
    let device = sim.device("r150").unwrap();
    let port = device.open().unwrap();
    (sim, device, port)
}

fn ask(port: &mut dyn SerialPort) -> std::io::Result<[u8; 7]> {
    port.write_all(&HEARTBEAT)?;
    let mut reply = [0; 7];
    port.read_exact(&mut reply)?;
    Ok(reply)
}

fn faults(device: &Device) -> Vec<&'static str> {
    let report = device.report();
    report.client_errors().map(|(code, _)| code).collect()
}

#[test]
fn a_read_waits_until_a_byte_is_there_and_no_longer() {
    let (sim, device, mut port) = r150();
    port.write_all(&HEARTBEAT).unwrap();
    let mut buf = [0; 100];
    // Whatever has arrived, which is one byte after seven.
    assert_eq!(port.read(&mut buf).unwrap(), 1);
    // The module takes a moment to answer.
    let took = sim.now().as_nanos();
    assert!((7 * 86_806..8 * 86_806).contains(&took), "{took}");
    sim.advance(MS(10)).unwrap();
    assert_eq!(port.bytes_to_read().unwrap(), 6);
    assert_eq!(port.read(&mut buf).unwrap(), 6);
    assert_eq!(buf[..6], ALIVE[1..]);
    assert_eq!(faults(&device), [""; 0]);
}

#[test]
fn a_read_that_gets_nothing_is_over_when_its_time_is() {
    let (sim, _, mut port) = r150();
    for timeout in [MS(300), Duration::from_secs(10), MS(1)] {
        port.set_timeout(timeout).unwrap();
        let before = sim.now();
        let error = port.read(&mut [0; 8]).unwrap_err();
        assert_eq!(error.kind(), ErrorKind::TimedOut);
        assert_eq!(sim.now().since(before), timeout);
    }
}

#[test]
fn a_client_that_only_looks_gets_on() {
    let (sim, _, mut port) = r150();
    port.set_timeout(Duration::ZERO).unwrap();
    port.write_all(&HEARTBEAT).unwrap();
    let mut looks = 0;
    while port.bytes_to_read().unwrap() < 7 {
        looks += 1;
        // It stays at what has arrived, as soon as there is something.
        if port.bytes_to_read().unwrap() > 0 {
            sim.advance(MS(1)).unwrap();
        }
        assert!(looks < 100);
    }
    let mut reply = [0; 7];
    port.read_exact(&mut reply).unwrap();
    assert_eq!(reply, ALIVE);
    assert_eq!(
        port.read(&mut reply).unwrap_err().kind(),
        ErrorKind::TimedOut
    );
}

#[test]
fn a_wrong_speed_garbles_and_the_right_one_mends_it() {
    let (_, device, mut port) = r150();
    assert_eq!(port.baud_rate().unwrap(), 115_200);
    port.set_baud_rate(57_600).unwrap();
    assert!(ask(&mut port).map_or(true, |reply| reply != ALIVE));
    assert!(faults(&device).contains(&"baud_mismatch"));
    port.set_baud_rate(115_200).unwrap();
    port.clear(ClearBuffer::All).unwrap();
    assert_eq!(ask(&mut port).unwrap(), ALIVE);
    assert!(port.set_baud_rate(0).is_err());
}

#[test]
fn stop_bits_are_reported_and_other_framings_refused() {
    let (_, device, mut port) = r150();
    assert_eq!(port.stop_bits().unwrap(), StopBits::One);
    port.set_stop_bits(StopBits::Two).unwrap();
    assert_eq!(ask(&mut port).unwrap(), ALIVE);
    assert_eq!(faults(&device), ["stop_bits"]);
    port.set_data_bits(DataBits::Eight).unwrap();
    port.set_parity(Parity::None).unwrap();
    assert!(port.set_data_bits(DataBits::Seven).is_err());
    assert!(port.set_parity(Parity::Even).is_err());
    assert!(!port.read_clear_to_send().unwrap());
    port.write_data_terminal_ready(true).unwrap();
}

#[test]
fn a_flush_waits_until_the_line_has_carried_it() {
    let (sim, _, mut port) = r150();
    port.write_all(&HEARTBEAT).unwrap();
    assert_eq!(port.bytes_to_write().unwrap(), 6);
    port.flush().unwrap();
    assert_eq!(port.bytes_to_write().unwrap(), 0);
    assert_eq!(sim.now().as_nanos() / 1000, 6 * 86_806 / 1000);
    // More than the line holds is written as it drains.
    port.write_all(&[0; 10_000]).unwrap();
    port.flush().unwrap();
    assert!(sim.now().as_secs_f64() > 10_006.0 * 10.0 / 115_200.0);
}

#[test]
fn clones_are_one_client_and_a_second_client_has_to_wait() {
    let (sim, device, mut port) = r150();
    let mut clone = port.try_clone().unwrap();
    port.write_all(&HEARTBEAT).unwrap();
    let mut reply = [0; 7];
    clone.read_exact(&mut reply).unwrap();
    assert_eq!(reply, ALIVE);
    drop(port);
    assert!(matches!(device.open(), Err(Error::PortInUse { .. })));
    assert_eq!(ask(&mut *clone).unwrap(), ALIVE);
    drop(clone);
    let codes = |sim: &Simulation| -> Vec<_> {
        let events = sim.events().into_iter();
        events.map(|event| event.kind.code().name).collect()
    };
    assert_eq!(codes(&sim).last(), Some(&"client_detached"));
    assert_eq!(ask(&mut device.open().unwrap()).unwrap(), ALIVE);
}

#[test]
fn a_pulled_cable_is_a_broken_pipe_until_the_port_is_opened_again() {
    let (sim, device, mut port) = r150();
    let pulled = device.fault("kind = \"cable-pulled\"").unwrap();
    let broken = |port: &mut ClientPort| ask(port).unwrap_err().kind() == ErrorKind::BrokenPipe;
    assert!(broken(&mut port));
    assert!(matches!(device.open(), Err(Error::CablePulled { .. })));
    sim.advance(MS(100)).unwrap();
    pulled.clear().unwrap();
    assert!(broken(&mut port));
    let mut again = device.open().unwrap();
    assert!(broken(&mut port));
    drop(port);
    assert_eq!(ask(&mut again).unwrap(), ALIVE);
    assert_eq!(pulled.hits(), 1);
}

#[test]
fn a_client_that_does_not_read_loses_what_comes_late_and_an_event_says_so() {
    let car = NewDevice::new("mecanum").named("car").with("ros", true);
    let sim = Simulation::builder().device(car).build().unwrap();
    let car = sim.device("car").unwrap();
    let (mut main, _ros) = (car.open().unwrap(), car.open_link(1).unwrap());
    assert!(matches!(car.open_link(2), Err(Error::NoSuchPort { .. })));
    // It talks by itself.
    sim.advance(Duration::from_secs(600)).unwrap();
    assert_eq!(main.bytes_to_read().unwrap(), 20_480);
    assert!(faults(&car).contains(&"overrun"));
    let mut unread = vec![0; 20_480];
    main.read_exact(&mut unread).unwrap();
    assert!(main.read(&mut unread).unwrap() < 100);
}

#[test]
fn a_port_can_go_to_another_thread() {
    let (_, _, port) = r150();
    let mut port: Box<dyn SerialPort> = Box::new(port);
    let reply = std::thread::spawn(move || ask(&mut *port).unwrap());
    assert_eq!(reply.join().unwrap(), ALIVE);
}
