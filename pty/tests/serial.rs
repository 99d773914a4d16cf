//! A real serial port, for which a pseudo-terminal stands in.

mod common;

use common::{Bench, PATIENCE};
use rigsim_pty::{ClientLine, Event, PortErrorKind, Waiter, open_serial_port};

#[test]
fn bytes_pass_both_ways_and_the_line_is_set() {
    let mut cable = Bench::unlinked();
    let mut port = open_serial_port(cable.port.path(), 250_000).unwrap();
    let mut waiter = Waiter::new().unwrap();
    waiter.add(0, &mut port).unwrap();
    cable.expect(Event::Attached);
    let line = cable.port.client_line().unwrap().unwrap();
    assert_eq!((line.baud, line.raw), (250_000, true));

    let mut buf = [0; 300];
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [0]);
    assert_eq!(port.read(&mut buf).unwrap(), Event::Attached);
    assert!(port.is_attached());
    assert_eq!(port.read(&mut buf).unwrap(), Event::Idle);
    assert_eq!(port.client_line().unwrap(), None);

    let all: Vec<u8> = (0..=255).collect();
    assert_eq!(cable.port.write(&all).unwrap(), 256);
    let mut received: Vec<u8> = Vec::new();
    while received.len() < 256 {
        assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [0]);
        if let Event::Data(n) = port.read(&mut buf).unwrap() {
            received.extend(&buf[..n]);
        }
    }
    assert_eq!(received, all);
    assert_eq!(port.write(&all).unwrap(), 256);
    assert_eq!(cable.expect_bytes(256), all);
}

#[test]
fn one_or_two_stop_bits_are_set() {
    for (stop_bits, set) in [(1, 1), (2, 2)] {
        let cable = Bench::unlinked();
        let mut port = open_serial_port(cable.port.path(), 9600).unwrap();
        let given = ClientLine {
            stop_bits,
            ..ClientLine::at(9600)
        };
        port.set_line(given).unwrap();
        let line = cable.port.client_line().unwrap().unwrap();
        assert_eq!((line.baud, line.stop_bits), (9600, set));
    }
}

#[test]
fn a_peer_that_never_reads_stalls_no_caller() {
    let cable = Bench::unlinked();
    let mut port = open_serial_port(cable.port.path(), 115_200).unwrap();
    let accepted = port.write(&[0; 200_000]).unwrap();
    assert!((1..200_000).contains(&accepted), "{accepted}");
    let dropped = 200_000 - accepted as u64;
    assert_eq!(port.counters().dropped_full_bytes, dropped);
}

#[test]
fn unplugging_is_an_error_and_wakes_no_caller_twice() {
    let cable = Bench::unlinked();
    let mut port = open_serial_port(cable.port.path(), 115_200).unwrap();
    let mut waiter = Waiter::new().unwrap();
    waiter.add(0, &mut port).unwrap();
    let mut buf = [0; 8];
    assert_eq!(port.read(&mut buf).unwrap(), Event::Attached);
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [0]);

    drop(cable);
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [0]);
    let error = port.read(&mut buf).unwrap_err();
    assert!(
        matches!(error.kind(), PortErrorKind::Unplugged),
        "{error:?}"
    );
    assert!(error.to_string().contains("unplugged"), "{error}");
    assert!(!port.is_attached());
    let wake = waiter
        .wait(Some(std::time::Duration::from_millis(20)))
        .unwrap();
    assert!(wake.ready().is_empty());
    assert!(matches!(
        port.write(b"?").unwrap_err().kind(),
        PortErrorKind::Unplugged
    ));
}

#[test]
fn what_cannot_be_opened_is_explained() {
    let dir = tempfile::tempdir().unwrap();
    let missing = open_serial_port(dir.path().join("ttyUSB0"), 115_200).unwrap_err();
    assert!(
        matches!(missing.kind(), PortErrorKind::NoSuchDevice),
        "{missing:?}"
    );
    assert!(missing.to_string().contains("check the cable"), "{missing}");

    let cable = Bench::unlinked();
    let _holder = open_serial_port(cable.port.path(), 115_200).unwrap();
    let busy = open_serial_port(cable.port.path(), 115_200).unwrap_err();
    assert!(matches!(busy.kind(), PortErrorKind::Busy), "{busy:?}");

    for path in [dir.path(), "/dev/null".as_ref()] {
        let no_port = open_serial_port(path, 115_200).unwrap_err();
        let kind = no_port.kind();
        assert!(matches!(kind, PortErrorKind::NotSerial), "{no_port:?}");
    }
    let zero = open_serial_port(cable.port.path(), 0).unwrap_err();
    assert!(matches!(zero.kind(), PortErrorKind::ZeroBaud), "{zero:?}");
}
