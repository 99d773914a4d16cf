//! What the port makes of it, and what clients get to see.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod common;

use std::time::{Duration, Instant};

use common::{Bench, Client, until};
use rigsim_pty::{ClientLine, Event, PtySetup, open_unlinked_port};
use rustix::event::epoll;
use rustix::fd::OwnedFd;
use rustix::termios::{ControlModes, InputModes, LocalModes, OutputModes, QueueSelector, tcflush};

#[test]
fn a_fresh_port_is_raw_at_the_device_s_own_baud() {
    for baud in [115_200, 9_600, 250_000, 1_234_567] {
        let port = open_unlinked_port(PtySetup::raw(baud)).unwrap();
        let client = Client::open(port.path());
        let termios = client.termios();
        assert_eq!(termios.output_speed(), baud);
        assert_eq!(termios.input_speed(), baud);
        assert!(
            !termios
                .local_modes
                .intersects(LocalModes::ECHO | LocalModes::ICANON)
        );
        assert!(!termios.output_modes.contains(OutputModes::OPOST));
        assert!(
            !termios
                .input_modes
                .intersects(InputModes::ICRNL | InputModes::IXON)
        );
        assert_eq!(
            port.client_line().unwrap(),
            Some(ClientLine {
                baud,
                parity: false,
                stop_bits: 1,
                rts_cts: false,
                raw: true
            })
        );
    }
}

#[test]
fn every_byte_passes_both_ways_and_none_is_echoed() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    let all: Vec<u8> = (0..=255).collect();
    client.send(&all);
    assert_eq!(bench.expect_bytes(256), all);
    assert_eq!(bench.port.write(&all).unwrap(), 256);
    assert_eq!(client.receive(256), all);
    assert_eq!(client.try_receive(), b"");
    bench.expect_quiet();
    assert_eq!(bench.port.counters().received_bytes, 256);
    assert_eq!(bench.port.counters().sent_bytes, 256);
}

#[test]
fn a_baud_rate_of_zero_is_refused_by_name() {
    let error = open_unlinked_port(PtySetup::raw(0))
        .unwrap_err()
        .to_string();
    assert!(error.contains("baud rate is 0"), "{error}");
}

#[test]
fn a_hang_up_is_reported_once_after_the_last_byte() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    client.send(b"last words");
    drop(client);
    bench.expect(Event::Attached);
    assert_eq!(bench.expect_bytes(10), b"last words");
    bench.expect(Event::Detached);
    bench.expect_quiet();
    assert!(!bench.port.is_attached());
    assert_eq!(bench.port.counters().attached, 1);
}

#[test]
fn a_client_that_only_listens_is_reported_too() {
    let mut bench = Bench::unlinked();
    bench.expect_quiet();
    let client = bench.client();
    bench.expect(Event::Attached);
    assert_eq!(bench.port.write(b"telemetry").unwrap(), 9);
    assert_eq!(client.receive(9), b"telemetry");
}

#[test]
fn without_a_waiter_reading_tells_as_much() {
    let mut port = open_unlinked_port(PtySetup::raw(115_200)).unwrap();
    let mut buf = [0; 16];
    for _ in 0..3 {
        assert_eq!(port.read(&mut buf).unwrap(), Event::Idle);
        let client = Client::open(port.path());
        assert_eq!(port.read(&mut buf).unwrap(), Event::Attached);
        assert_eq!(port.read(&mut buf).unwrap(), Event::Idle);
        drop(client);
        assert_eq!(port.read(&mut buf).unwrap(), Event::Detached);
    }
}

#[test]
fn nothing_wakes_the_waiter_while_no_client_is_there() {
    let window = Duration::from_millis(300);
    let mut bench = Bench::unlinked();
    for visit in 0..2 {
        if visit > 0 {
            drop(bench.client());
            bench.expect(Event::Attached);
            bench.expect(Event::Detached);
        }
        bench.expect_quiet();
        let start = Instant::now();
        let mut wakes = 0;
        while start.elapsed() < window {
            let left = window.saturating_sub(start.elapsed());
            wakes += usize::from(!bench.waiter.wait(Some(left)).unwrap().ready().is_empty());
        }
        assert_eq!(wakes, 0);
    }
}

#[test]
fn a_second_program_that_looks_in_is_no_change_of_clients() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    bench.expect_quiet();
    let _ = bench.port.write(b"reply").unwrap();
    drop(bench.client());
    bench.expect_quiet();
    assert_eq!(client.receive(5), b"reply");
}

#[test]
fn settings_of_one_client_do_not_outlive_it() {
    let mut bench = Bench::unlinked();
    bench.expect_quiet();
    let client = bench.client();
    client.set_termios(|termios| {
        termios.set_speed(9_600).unwrap();
        termios.local_modes |= LocalModes::ECHO | LocalModes::ICANON;
        termios.input_modes |= InputModes::ICRNL;
        termios.control_modes |= ControlModes::CSTOPB;
    });
    assert!(!bench.port.client_line().unwrap().unwrap().raw);
    // It never sent a byte and is gone before the first look, like stty.
    drop(client);
    bench.expect(Event::Attached);
    bench.expect(Event::Detached);
    let line = bench.port.client_line().unwrap().unwrap();
    assert_eq!((line.baud, line.raw), (115_200, true));
}

#[test]
fn a_client_that_never_reads_stalls_no_other_and_loses_the_rest() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    let mut accepted = 0;
    for _ in 0..100 {
        accepted += bench.port.write(&[0x55; 1_000]).unwrap();
    }
    assert!(
        (70_000..100_000).contains(&accepted),
        "{accepted} bytes were accepted"
    );
    let counters = bench.port.counters();
    assert_eq!(counters.sent_bytes, accepted as u64);
    assert_eq!(counters.dropped_full_bytes, 100_000 - accepted as u64);
    // The client gets what was accepted, and the last of all, once it reads.
    assert_eq!(bench.port.write(b"!").unwrap(), 0);
    let mut read = Vec::new();
    until("it has read all", || {
        read.extend(client.try_receive());
        let wake = bench.waiter.wait(Some(Duration::ZERO)).unwrap();
        if !wake.ready().is_empty() {
            assert_eq!(bench.port.read(&mut [0; 64]).unwrap(), Event::Idle);
        }
        read.len() == accepted
    });
    assert_eq!(read.last(), Some(&b'!'));
    bench.expect_quiet();
    assert_eq!(bench.port.write(b"?").unwrap(), 1);
    assert_eq!(client.receive(1), b"?");
}

#[test]
fn what_is_kept_for_a_client_is_gone_when_it_flushes_its_input_or_leaves() {
    let mut bench = Bench::unlinked();
    for flushes in [true, false] {
        for seen in [true, false] {
            let mut client = bench.client();
            bench.expect(Event::Attached);
            assert_eq!(bench.port.write(&[b'x'; 50_000]).unwrap(), 50_000);
            if flushes {
                tcflush(&client, QueueSelector::IFlush).unwrap();
            } else {
                drop(client);
                if seen {
                    bench.expect(Event::Detached);
                }
                client = bench.client();
            }
            if flushes && !seen {
                // It may be looked at late, with a request behind it.
                client.send(b"request");
                bench.expect_bytes(7);
            } else if flushes {
                bench.expect_quiet();
            } else {
                client.send(b"request");
                let next = [Event::Detached, Event::Attached, Event::Data(7)];
                for event in &next[usize::from(seen)..] {
                    bench.expect(*event);
                }
            }
            assert_eq!(bench.port.write(b"reply").unwrap(), 5);
            assert_eq!(client.receive(5), b"reply");
            assert_eq!(client.try_receive(), b"");
            drop(client);
            bench.expect(Event::Detached);
        }
    }
}

#[test]
fn a_client_may_flush_what_it_has_not_read() {
    let mut bench = Bench::unlinked();
    let client = bench.client();
    bench.expect(Event::Attached);
    let _ = bench.port.write(b"old").unwrap();
    until("the bytes have arrived", || {
        rustix::io::ioctl_fionread(&client) == Ok(3)
    });
    tcflush(&client, QueueSelector::IFlush).unwrap();
    assert_eq!(client.try_receive(), b"");
    let _ = bench.port.write(b"new").unwrap();
    assert_eq!(client.receive(3), b"new");
}

/// Two openings in a row are reported as one, so that no client seems to be left when one of two leaves.
#[test]
fn a_client_that_opened_together_with_another_is_still_served_when_that_one_leaves() {
    let mut bench = Bench::unlinked();
    let (listener, talker) = (bench.client(), bench.client());
    bench.expect(Event::Attached);
    drop(bench.client());
    drop(talker);
    // Whether one of them counts as the next client or not, a client is there in the end.
    let mut buf = [0; 64];
    while bench
        .waiter
        .wait(Some(Duration::from_millis(20)))
        .unwrap()
        .ready()
        == [7]
    {
        let _ = bench.port.read(&mut buf).unwrap();
    }
    assert!(bench.port.is_attached());
    assert_eq!(bench.port.write(b"reply").unwrap(), 5);
    assert_eq!(listener.receive(5), b"reply");
    listener.send(b"request");
    assert_eq!(bench.expect_bytes(7), b"request");
    drop(listener);
    bench.expect(Event::Detached);
    bench.expect_quiet();
}

/// Sets from which the system has to take what is closed, which takes its time.
fn epoll_sets() -> Vec<OwnedFd> {
    (0..500)
        .map(|_| epoll::create(epoll::CreateFlags::CLOEXEC).unwrap())
        .collect()
}

fn add_to(sets: &[OwnedFd], client: &Client) {
    for set in sets {
        let data = epoll::EventData::new_u64(0);
        epoll::add(set, client, data, epoll::EventFlags::IN).unwrap();
    }
}

/// A client that closes the port while another does is not taken for the next.
#[test]
fn two_clients_that_close_together_come_and_go_once() {
    let mut bench = Bench::unlinked();
    bench.longest_wait = Duration::ZERO;
    let sets = epoll_sets();
    let (close, closing) = std::sync::mpsc::channel::<[Client; 2]>();
    let closer = std::thread::spawn(move || closing.into_iter().for_each(drop));
    for round in 1..=200 {
        let slow = bench.client();
        add_to(&sets, &slow);
        bench.expect(Event::Attached);
        let quick = bench.client();
        // Reports of openings that are taken one by one are kept apart.
        let _ = bench.waiter.wait(Some(Duration::ZERO)).unwrap();
        close.send([quick, slow]).unwrap();
        bench.expect(Event::Detached);
        assert_eq!(bench.port.counters().attached, round);
    }
    drop(close);
    closer.join().unwrap();
    bench.expect_quiet();
    assert_eq!(bench.port.counters().attached, 200);
}

/// The system reports a close before it hangs the port up, so that a poll may come in between: for
/// as long as it takes out of epoll sets what is closed.
#[test]
fn a_client_that_is_seen_as_it_closes_comes_and_goes_once() {
    let mut bench = Bench::unlinked();
    bench.longest_wait = Duration::ZERO;
    let path = bench.port.path().to_owned();
    let (next, rounds) = std::sync::mpsc::channel();
    let client = std::thread::spawn(move || {
        let sets = epoll_sets();
        for () in rounds {
            add_to(&sets, &Client::open(&path));
        }
    });
    for round in 1..=200 {
        next.send(()).unwrap();
        bench.expect(Event::Attached);
        bench.expect(Event::Detached);
        assert_eq!(bench.port.counters().attached, round);
    }
    drop(next);
    client.join().unwrap();
    bench.expect_quiet();
    assert_eq!(bench.port.counters().attached, 200);
}
