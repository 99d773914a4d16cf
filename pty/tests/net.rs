//! Ports on the network, with clients on plain sockets.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::io::{ErrorKind, Read as _, Write as _};
use std::net::{Shutdown, TcpStream};

use common::PATIENCE;
use rigsim_pty::{Event, ListenAddress, Port, PtySetup, Waiter, open_port};

const IAC: u8 = 255;
/// WILL COM-PORT-OPTION.
const WILL: [u8; 3] = [IAC, 251, 44];

/// A subnegotiation of COM-PORT-OPTION.
fn command(number: u8, value: &[u8]) -> Vec<u8> {
    [&[IAC, 250, 44, number], value, &[IAC, 240]].concat()
}

struct Bench {
    waiter: Waiter,
    port: Box<dyn Port>,
    address: String,
}

impl Bench {
    fn new(scheme: &str) -> Self {
        let url = format!("{scheme}://127.0.0.1:0");
        let mut port = open_port(url, PtySetup::raw(115_200)).unwrap();
        assert!(!port.is_public());
        let url = port.path().to_str().unwrap();
        let address = url.split_once("://").unwrap().1.to_owned();
        let mut waiter = Waiter::new().unwrap();
        waiter.add(7, &mut port).unwrap();
        Self {
            waiter,
            port,
            address,
        }
    }

    fn client(&self) -> TcpStream {
        let client = TcpStream::connect(&self.address).unwrap();
        client.set_read_timeout(Some(PATIENCE)).unwrap();
        client
    }

    /// The next event other than idle, and its bytes.
    fn next(&mut self) -> (Event, Vec<u8>) {
        let mut buf = [0; 64];
        loop {
            let wake = self.waiter.wait(Some(PATIENCE)).unwrap();
            assert_eq!(wake.ready(), [7], "in vain waited for an event");
            match self.port.read(&mut buf).unwrap() {
                Event::Idle => {}
                Event::Data(n) => return (Event::Data(n), buf[..n].to_vec()),
                event => return (event, Vec::new()),
            }
        }
    }

    fn expect(&mut self, event: Event) {
        assert_eq!(self.next().0, event);
    }

    fn expect_bytes(&mut self, bytes: &[u8]) {
        let mut found = Vec::new();
        while found.len() < bytes.len() {
            let (event, data) = self.next();
            assert!(matches!(event, Event::Data(_)), "{event:?}");
            found.extend(data);
        }
        assert_eq!(found, bytes);
    }
}

#[test]
fn urls_are_known_from_paths_and_lack_nothing() {
    for path in [
        "/tmp/r150",
        "r150",
        "http://127.0.0.1:80",
        "tcp:127.0.0.1:1",
    ] {
        assert_eq!(ListenAddress::parse(path), None, "{path}");
    }
    for url in [
        "tcp://",
        "tcp://127.0.0.1",
        "rfc2217://:1",
        "rfc2217://a:70000",
    ] {
        let why = ListenAddress::parse(url).unwrap().unwrap_err();
        assert!(why.contains("127.0.0.1:2217"), "{why}");
    }
    let address = ListenAddress::parse("rfc2217://[::1]:2217")
        .unwrap()
        .unwrap();
    assert_eq!(address.to_string(), "rfc2217://[::1]:2217");
}

#[test]
fn an_address_that_is_taken_or_elsewhere_is_refused_in_words() {
    let bench = Bench::new("tcp");
    for (address, word) in [
        (bench.address.as_str(), "listens there"),
        ("192.0.2.1:1", "not an address"),
    ] {
        let refused = open_port(format!("tcp://{address}"), PtySetup::raw(1));
        let error = refused.unwrap_err().to_string();
        assert!(error.contains(word), "{error}");
    }
}

#[test]
fn bytes_pass_both_ways_and_clients_follow_one_another() {
    let mut bench = Bench::new("tcp");
    for _ in 0..200 {
        let mut client = bench.client();
        client.write_all(&[1, IAC, 0]).unwrap();
        bench.expect(Event::Attached);
        bench.expect_bytes(&[1, IAC, 0]);
        assert_eq!(bench.port.write(&[IAC, 2]).unwrap(), 2);
        let mut heard = [0; 2];
        client.read_exact(&mut heard).unwrap();
        assert_eq!(heard, [IAC, 2]);
        // The next one comes before that is noticed.
        drop(client);
        let mut next = bench.client();
        next.write_all(b"!").unwrap();
        bench.expect(Event::Detached);
        bench.expect(Event::Attached);
        bench.expect_bytes(b"!");
        next.shutdown(Shutdown::Both).unwrap();
        bench.expect(Event::Detached);
    }
    assert_eq!(bench.port.counters().attached, 400);
}

#[test]
fn a_second_client_is_let_go_and_the_first_is_served_on() {
    let mut bench = Bench::new("tcp");
    let mut first = bench.client();
    bench.expect(Event::Attached);
    let mut second = bench.client();
    first.write_all(b"still here").unwrap();
    bench.expect_bytes(b"still here");
    let begun = std::time::Instant::now();
    while begun.elapsed() < std::time::Duration::from_millis(300) {
        let _ = bench.port.read(&mut [0; 8]).unwrap();
    }
    match second.read(&mut [0; 8]) {
        Ok(count) => assert_eq!(count, 0),
        Err(error) => assert_eq!(error.kind(), ErrorKind::ConnectionReset),
    }
}

#[test]
fn a_client_that_does_not_read_loses_the_rest_and_stalls_no_other() {
    for scheme in ["tcp", "rfc2217"] {
        let mut bench = Bench::new(scheme);
        let _client = bench.client();
        bench.expect(Event::Attached);
        let mut dropped = 0;
        for _ in 0..10_000 {
            dropped += 4096 - bench.port.write(&[0; 4096]).unwrap();
            if dropped > 0 {
                break;
            }
        }
        assert!(dropped > 0);
        assert_eq!(bench.port.counters().dropped_full_bytes, dropped as u64);
    }
}

#[test]
fn rfc_2217_sets_the_line_and_its_lines_answer() {
    let mut bench = Bench::new("rfc2217");
    let mut client = bench.client();
    bench.expect(Event::Attached);
    client.write_all(&WILL).unwrap();
    client
        .write_all(&command(1, &9_600_u32.to_be_bytes()))
        .unwrap();
    client.write_all(&command(3, &[3])).unwrap();
    client.write_all(&command(5, &[3])).unwrap();
    client.write_all(&[b'a', IAC, IAC, b'b']).unwrap();
    bench.expect_bytes(&[b'a', IAC, b'b']);
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!((line.baud, line.parity, line.rts_cts), (9_600, true, true));
    // RTS off: CTS follows.
    client.write_all(&command(5, &[12])).unwrap();
    client.write_all(b"c").unwrap();
    bench.expect_bytes(b"c");
    assert_eq!(bench.port.write(&[IAC]).unwrap(), 1);
    let wanted = command(107, &[0b1010_0001]);
    let mut heard = Vec::new();
    let mut buf = [0; 256];
    while !heard.ends_with(&[IAC, IAC]) || !heard.windows(wanted.len()).any(|part| part == wanted) {
        let count = client.read(&mut buf).unwrap();
        assert_ne!(count, 0, "{heard:02X?}");
        heard.extend_from_slice(&buf[..count]);
    }
    // The next one finds the device's own settings again.
    drop(client);
    bench.expect(Event::Detached);
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!(
        (line.baud, line.parity, line.rts_cts),
        (115_200, false, false)
    );
}

#[test]
fn what_a_client_purges_is_not_sent_and_a_break_is_a_zero() {
    let mut bench = Bench::new("rfc2217");
    let mut client = bench.client();
    bench.expect(Event::Attached);
    let mut sent = WILL.to_vec();
    sent.extend([b'x'; 100]);
    sent.extend(command(12, &[2]));
    sent.extend(b"stop");
    sent.extend(command(5, &[5]));
    client.write_all(&sent).unwrap();
    // The client does not read until all of it is there.
    let patient = std::time::Instant::now();
    while bench.port.read(&mut []).unwrap() != Event::Idle {
        assert!(patient.elapsed() < PATIENCE);
    }
    std::thread::sleep(std::time::Duration::from_millis(50));
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    bench.expect_bytes(b"stop\0");
}
