//! Clients that follow one another faster than anybody can look.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::time::Duration;

use common::Bench;
use rustix::io::Errno;
use rustix::termios::LocalModes;
use sim_pty::{Event, Port, PtyPort, Waiter};

/// Fills the kernel's buffer, and says with how much.
fn fill(client: &common::Client) -> usize {
    let mut sent = 0;
    loop {
        match rustix::io::write(client, &[b'x'; 100]) {
            Ok(n) => sent += n,
            Err(Errno::AGAIN) => return sent,
            Err(errno) => panic!("the client writes {errno}"),
        }
    }
}

#[test]
fn the_last_words_of_one_client_are_not_the_next_one_s() {
    let mut bench = Bench::unlinked();
    for _ in 0..50 {
        let first = bench.client();
        bench.expect(Event::Attached);
        bench.expect_quiet();
        first.send(b"last words");
        drop(first);
        let second = bench.client();
        assert_eq!(bench.expect_bytes(10), b"last words");
        assert_eq!(bench.port.write(b"to nobody").unwrap().accepted, 0);
        bench.expect(Event::Detached);
        bench.expect(Event::Attached);
        second.send(b"hello");
        assert_eq!(bench.expect_bytes(5), b"hello");
        assert_eq!(second.try_receive(), b"");
        drop(second);
        bench.expect(Event::Detached);
    }
}

#[test]
fn the_first_words_of_one_client_are_not_the_last_one_s() {
    let mut bench = Bench::unlinked();
    for _ in 0..50 {
        let first = bench.client();
        bench.expect(Event::Attached);
        first.send(b"read");
        assert_eq!(bench.expect_bytes(4), b"read");
        bench.expect_quiet();
        drop(first);
        let second = bench.client();
        second.send(b"hello");
        // Even if it is gone, too, by the time anybody looks.
        drop(second);
        bench.expect(Event::Detached);
        bench.expect(Event::Attached);
        assert_eq!(bench.expect_bytes(5), b"hello");
        bench.expect(Event::Detached);
    }
}

#[test]
fn the_first_words_of_one_who_stays_are_not_forgotten() {
    let mut bench = Bench::unlinked();
    let mut former = bench.client();
    bench.expect(Event::Attached);
    for _ in 0..50 {
        former.send(b"read");
        assert_eq!(bench.expect_bytes(4), b"read");
        bench.expect_quiet();
        drop(former);
        let next = bench.client();
        next.send(b"hello");
        bench.expect(Event::Detached);
        bench.expect(Event::Attached);
        // Nothing but these bytes is left to wake anybody.
        assert_eq!(bench.expect_bytes(5), b"hello");
        former = next;
    }
}

#[test]
fn bytes_that_lie_mixed_are_the_former_client_s() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    first.send(b"one");
    drop(first);
    let second = bench.client();
    second.send(b"two");
    assert_eq!(bench.expect_bytes(6), b"onetwo");
    bench.expect(Event::Detached);
    bench.expect(Event::Attached);
    bench.expect_quiet();
}

#[test]
fn an_echo_of_one_client_s_port_is_not_another_client() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    client.set_termios(|termios| termios.local_modes |= LocalModes::ECHO);
    client.send(b"x");
    assert_eq!(bench.expect_bytes(1), b"x");
    bench.expect_quiet();
    let _ = bench.port.write(b"reply").unwrap();
    common::until("the echo has come back", || {
        rustix::io::ioctl_fionread(&client) == Ok(5)
    });
    drop(client);
    assert_eq!(bench.expect_bytes(5), b"reply");
    bench.expect(Event::Detached);
    bench.expect_quiet();
    assert_eq!(bench.port.counters().attached, 1);
}

#[test]
fn settings_with_which_bytes_were_sent_are_told_with_them() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    first.set_termios(|termios| termios.set_speed(9_600).unwrap());
    first.send(b"slow");
    drop(first);
    assert_eq!(bench.expect_bytes(4), b"slow");
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!(line.baud, 9_600);
    bench.expect(Event::Detached);
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!(line.baud, 115_200);
}

#[test]
fn a_change_of_clients_is_noticed_behind_any_backlog() {
    let mut bench = Bench::unlinked();
    let first = bench.client();
    bench.expect(Event::Attached);
    let backlog = fill(&first);
    drop(first);
    // The hang-up is seen while all this is still to be read; the caller
    // takes no more than a little of it, and the next client comes.
    let mut buf = [0; 100];
    assert_eq!(bench.port.read(&mut buf).unwrap(), Event::Data(100));
    let second = bench.client();
    second.send(b"hello");
    assert_eq!(bench.expect_bytes(backlog - 100).len(), backlog - 100);
    bench.expect(Event::Detached);
    bench.expect(Event::Attached);
    assert_eq!(bench.expect_bytes(5), b"hello");
}

/// No time-out is so short that a busy machine could not exceed it, so these
/// are waits for nothing: long enough to show a spinning waiter.
const A_WHILE: Duration = Duration::from_millis(50);

#[test]
fn a_paused_port_is_not_named_for_its_bytes_but_for_a_departure() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    bench.port.set_paused(true).unwrap();
    client.send(b"waits");
    let mut other = Port::from(PtyPort::open_unlinked(9_600).unwrap());
    bench.waiter.add(8, &mut other).unwrap();
    assert_eq!(
        bench.waiter.wait(Some(common::PATIENCE)).unwrap().ready(),
        [8]
    );
    assert_eq!(other.read(&mut [0; 8]).unwrap(), Event::Idle);
    let named = |waiter: &mut Waiter| !waiter.wait(Some(A_WHILE)).unwrap().ready().is_empty();
    // Writing may be noticed, though nothing is made of it.
    let wakes = (0..6).filter(|_| named(&mut bench.waiter)).count();
    assert_eq!(wakes, 0);

    drop(client);
    let ready = bench.waiter.wait(Some(common::PATIENCE)).unwrap().ready();
    assert_eq!(ready, [7]);
    // There is no room for its last words, which come first.
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    let next = bench.client();
    next.send(b"hello");
    bench.port.set_paused(false).unwrap();
    assert_eq!(bench.expect_bytes(5), b"waits");
    bench.expect(Event::Detached);
    bench.expect(Event::Attached);
    assert_eq!(bench.expect_bytes(5), b"hello");
}

#[test]
fn a_departure_without_last_words_is_told_to_a_caller_without_room() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    bench.port.set_paused(true).unwrap();
    drop(client);
    let ready = bench.waiter.wait(Some(common::PATIENCE)).unwrap().ready();
    assert_eq!(ready, [7]);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Detached);
    assert_eq!(bench.port.read(&mut []).unwrap(), Event::Idle);
    bench.port.set_paused(false).unwrap();
    drop(bench.client());
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
}
