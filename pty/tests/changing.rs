//! Clients that follow one another, seen or faster than the port is looked at.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};

use common::{Bench, Client, PATIENCE};
use rigsim_pty::Event;
use rustix::io::Errno;
use rustix::termios::{QueueSelector, tcflush};

/// Fills the kernel's buffer, and says with how much.
fn fill(client: &Client) -> usize {
    let mut sent = 0;
    loop {
        match rustix::io::write(client, &[b'x'; 100]) {
            Ok(n) => sent += n,
            Err(Errno::AGAIN) => return sent,
            Err(errno) => panic!("the client writes {errno}"),
        }
    }
}

/// All that the port has to tell until nothing is left, and the bytes.
fn all(bench: &mut Bench) -> (Vec<Event>, Vec<u8>) {
    let (mut events, mut bytes) = (Vec::new(), Vec::new());
    let mut buf = [0; 4096];
    let quiet = Duration::from_millis(20);
    while !bench.waiter.wait(Some(quiet)).unwrap().ready().is_empty() {
        match bench.port.read(&mut buf).unwrap() {
            Event::Idle => {}
            Event::Data(n) => bytes.extend_from_slice(&buf[..n]),
            event => events.push(event),
        }
    }
    (events, bytes)
}

const CHANGE: [Event; 2] = [Event::Detached, Event::Attached];

#[test]
fn bytes_of_one_client_and_the_next_come_in_order() {
    let mut bench = Bench::unlinked();
    drop(bench.client());
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
    for _ in 0..50 {
        let first = bench.client();
        bench.expect(Event::Attached);
        bench.expect_quiet();
        first.send(b"half a ");
        drop(first);
        let second = bench.client();
        second.send(b"request");
        let (events, bytes) = all(&mut bench);
        assert_eq!(bytes, b"half a request");
        assert_eq!(events, CHANGE);
        assert_eq!(bench.port.write(b"reply").unwrap(), 5);
        assert_eq!(second.receive(5), b"reply");
        drop(second);
        bench.expect(Event::Detached);
        assert!(!bench.port.is_attached());
    }
}

#[test]
fn what_a_client_has_not_read_is_not_the_next_one_s() {
    let mut bench = Bench::unlinked();
    for seen in [true, false] {
        for size in [1, 4_096, 9_000, 100_000] {
            let client = bench.client();
            bench.expect(Event::Attached);
            bench.expect_quiet();
            assert!(bench.port.write(&vec![b'x'; size]).unwrap() > 0);
            drop(client);
            if seen {
                bench.expect(Event::Detached);
                assert_eq!(bench.port.write(b"no client there").unwrap(), 0);
            }
            let next = bench.client();
            next.send(b"hello");
            let (events, bytes) = all(&mut bench);
            assert_eq!(events, if seen { &CHANGE[1..] } else { &CHANGE[..] });
            assert_eq!(bytes, b"hello");
            assert_eq!(bench.port.write(b"fresh").unwrap(), 5);
            assert_eq!(next.receive(5), b"fresh");
            drop(next);
            bench.expect(Event::Detached);
        }
    }
}

#[test]
fn a_reply_does_not_wait_behind_what_a_former_client_has_not_read() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    let _ = bench.port.write(b"for the first").unwrap();
    drop(first);
    let second = bench.client();
    second.send(b"request");
    // That it is another's is reported before, so that an answer to it is not taken for the other's.
    let mut buf = [0; 4];
    for event in CHANGE.into_iter().chain([Event::Data(4), Event::Data(3)]) {
        assert_eq!(bench.port.read(&mut buf).unwrap(), event);
    }
    assert_eq!(bench.port.write(b"reply").unwrap(), 5);
    assert_eq!(second.receive(5), b"reply");
    assert_eq!(second.try_receive(), b"");
}

#[test]
fn what_was_not_read_before_a_client_left_is_thrown_away() {
    let mut bench = Bench::unlinked();
    for seen in [true, false] {
        let first = bench.client();
        bench.expect(Event::Attached);
        let backlog = fill(&first);
        assert!(backlog > 4_096);
        let mut buf = [0; 16];
        assert_eq!(bench.port.read(&mut buf).unwrap(), Event::Data(16));
        // The caller has no room for more.
        assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
        drop(first);
        if seen {
            assert_eq!(bench.port.read(&mut []).unwrap(), Event::Detached);
        }
        let second = bench.client();
        if !seen {
            assert_eq!(bench.port.read(&mut []).unwrap(), Event::Detached);
        }
        second.send(b"hello");
        let (_, bytes) = all(&mut bench);
        assert!(bytes.ends_with(b"hello"));
        if seen {
            assert_eq!(bytes, b"hello");
        } else {
            // It cannot be known whose bytes those are that were on their way to where they are counted.
            assert!(bytes.len() <= backlog - 16 + 5);
        }
        drop(second);
        bench.expect(Event::Detached);
    }
}

#[test]
fn a_client_may_take_back_what_it_has_written_and_was_not_read() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    for count in [100, 1_000, 4_095, 20_000] {
        let commands = vec![b'x'; count];
        let written = rustix::io::write(&client, &commands).unwrap();
        assert!(written >= count.min(4_095));
        let mut buf = [0; 16];
        assert_eq!(bench.waiter.wait(Some(PATIENCE)).unwrap().ready(), [7]);
        assert_eq!(bench.port.read(&mut buf).unwrap(), Event::Data(16));
        assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
        tcflush(&client, QueueSelector::OFlush).unwrap();
        client.send(b"stop");
        let bytes = all(&mut bench).1;
        assert!(bytes.ends_with(b"stop"));
        // What arrived since the last look may be from before or after.
        assert!(bytes.len() <= 16 + 4, "{} of {count}", bytes.len());
    }
    // Without a look in between it is kept: nothing that comes after a flush may be lost.
    client.send(b"before");
    tcflush(&client, QueueSelector::OFlush).unwrap();
    client.send(b"after");
    assert!(all(&mut bench).1.ends_with(b"after"));
}

#[test]
fn the_speed_is_that_of_the_client_that_has_the_port_open() {
    let mut bench = Bench::unlinked();
    let baud = |bench: &Bench| bench.port.client_line().unwrap().unwrap().baud;
    let first = bench.client();
    bench.expect(Event::Attached);
    first.set_termios(|termios| termios.set_speed(9_600).unwrap());
    assert_eq!(baud(&bench), 9_600);
    drop(first);
    bench.expect(Event::Detached);
    assert_eq!(baud(&bench), 115_200);
    let second = bench.client();
    bench.expect(Event::Attached);
    second.set_termios(|termios| termios.set_speed(57_600).unwrap());
    drop(second);
    let third = bench.client();
    third.set_termios(|termios| termios.set_speed(38_400).unwrap());
    assert_eq!(all(&mut bench).0, CHANGE);
    assert_eq!(baud(&bench), 38_400);
}

#[test]
fn a_change_of_clients_is_reported_to_a_caller_without_room() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    drop(client);
    let ready = bench.waiter.wait(Some(PATIENCE)).unwrap().ready();
    assert_eq!(ready, [7]);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Detached);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    let first = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    first.send(b"waits");
    // Until it has arrived.
    assert_eq!(bench.waiter.wait(Some(PATIENCE)).unwrap().ready(), [7]);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    drop(first);
    let second = bench.client();
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Detached);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Attached);
    // What the caller had no room for was the first one's.
    second.send(b"hello");
    assert_eq!(bench.expect_bytes(5), b"hello");
}

/// Of what one read gives, what was there when the caller had no room is the first one's.
#[test]
fn what_waits_together_is_kept_apart_as_far_as_it_was_seen() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    first.send(b"waits");
    assert_eq!(bench.waiter.wait(Some(PATIENCE)).unwrap().ready(), [7]);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    drop(first);
    let second = bench.client();
    second.send(b"hello");
    assert_eq!(all(&mut bench), (CHANGE.to_vec(), b"hello".to_vec()));
}

#[test]
fn what_is_sent_while_a_change_of_clients_is_reported_is_the_next_one_s() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    drop(first);
    let second = bench.client();
    bench.expect(Event::Detached);
    assert_eq!(bench.port.write(b"rest").unwrap(), 4);
    bench.expect(Event::Attached);
    assert_eq!(second.receive(4), b"rest");
    drop(second);
    bench.expect(Event::Detached);
    assert_eq!(bench.port.write(b"rest").unwrap(), 0);
}

/// Makes a thread end, also when the test fails.
struct Stop<'a>(&'a AtomicBool);

impl Drop for Stop<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Echoes until it is to stop, asleep whenever there is nothing to do.
fn echo(bench: &mut Bench, stop: &AtomicBool) {
    let mut buf = [0; 64];
    while !stop.load(Ordering::Relaxed) {
        let wake = bench.waiter.wait(Some(Duration::from_millis(100)));
        let called = !wake.unwrap().ready().is_empty();
        if called && let Event::Data(n) = bench.port.read(&mut buf).unwrap() {
            let _ = bench.port.write(&buf[..n]).unwrap();
        }
    }
}

/// After any number of clients that come and go as fast as they can, one that stays is heard.
#[test]
fn a_port_never_goes_deaf() {
    const HANDOVERS: usize = 10_000;
    let mut bench = Bench::unlinked();
    let path = bench.port.path().to_owned();
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        let server = scope.spawn(|| echo(&mut bench, &stop));
        let stop = Stop(&stop);
        for round in 0..HANDOVERS {
            for visit in 0..round % 3 {
                let visitor = Client::open(&path);
                if visit == 1 {
                    visitor.send(b"half");
                }
            }
            let client = Client::open(&path);
            client.send(b"!");
            let start = Instant::now();
            let mut heard = Vec::new();
            while !heard.ends_with(b"!") {
                client.wait();
                heard.extend(client.try_receive());
                assert!(start.elapsed() < PATIENCE, "deaf in round {round}");
            }
        }
        drop(stop);
        server.join().unwrap();
    });
}
