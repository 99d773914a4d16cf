//! Waiting: for many ports at once, for as long as asked, and no longer.

mod common;

use std::time::{Duration, Instant};

use common::{Client, PATIENCE};
use rigsim_pty::{Event, Port, PtySetup, Waiter, open_unlinked_port, sharpen_timers};

#[test]
fn of_many_ports_those_with_events_are_named() {
    const PORTS: usize = 200;
    let mut waiter = Waiter::new().unwrap();
    let mut ports: Vec<Box<dyn Port>> = (0..PORTS)
        .map(|_| open_unlinked_port(PtySetup::raw(9_600)).unwrap())
        .collect();
    for (token, port) in ports.iter_mut().enumerate() {
        waiter.add(token, port).unwrap();
    }
    // Each is named once at the start, whether it has events or not.
    let all: Vec<usize> = (0..PORTS).collect();
    assert_eq!(waiter.wait(None).unwrap().ready(), all);
    assert!(
        waiter
            .wait(Some(Duration::ZERO))
            .unwrap()
            .ready()
            .is_empty()
    );

    let clients: Vec<Client> = ports.iter().map(|port| Client::open(port.path())).collect();
    for (token, client) in clients.iter().enumerate() {
        client.send(&token.to_le_bytes());
    }
    let mut received: Vec<Vec<u8>> = vec![Vec::new(); PORTS];
    let start = Instant::now();
    while received
        .iter()
        .any(|bytes| bytes.len() < size_of::<usize>())
    {
        assert!(start.elapsed() < PATIENCE, "some port was never named");
        let ready = waiter.wait(Some(PATIENCE)).unwrap().ready().to_vec();
        assert!(ready.is_sorted_by(|a, b| a < b));
        for token in ready {
            // Three bytes at a time: what is left is named again.
            let mut buf = [0; 3];
            if let Event::Data(n) = ports[token].read(&mut buf).unwrap() {
                received[token].extend(&buf[..n]);
            }
        }
    }
    for (token, bytes) in received.iter().enumerate() {
        assert_eq!(*bytes, token.to_le_bytes());
    }

    // Each is named until it has nothing more to tell.
    loop {
        let ready = waiter.wait(Some(Duration::ZERO)).unwrap().ready().to_vec();
        if ready.is_empty() {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "the waiter spins");
        for token in ready {
            assert_eq!(ports[token].read(&mut [0; 3]).unwrap(), Event::Idle);
        }
    }

    // Only the one that hangs up is named now.
    let mut clients = clients;
    drop(clients.swap_remove(3));
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [3]);
    assert_eq!(ports[3].read(&mut [0; 8]).unwrap(), Event::Detached);
}

#[test]
fn a_wait_is_never_too_short() {
    sharpen_timers().unwrap();
    let mut waiter = Waiter::new().unwrap();
    for timeout in [0, 1, 86_806, 999_999, 1_000_001, 20_000_000].map(Duration::from_nanos) {
        let start = Instant::now();
        let wake = waiter.wait(Some(timeout)).unwrap();
        assert!(wake.ready().is_empty() && !wake.is_signalled());
        assert!(
            start.elapsed() >= timeout,
            "{:?} of {timeout:?}",
            start.elapsed()
        );
    }
}

#[test]
fn a_port_is_forgotten_with_its_last_events() {
    let mut waiter = Waiter::new().unwrap();
    let mut port = open_unlinked_port(PtySetup::raw(9_600)).unwrap();
    waiter.add(0, &mut port).unwrap();
    let client = Client::open(port.path());
    client.send(b"unheard");
    drop(port);
    assert!(
        waiter
            .wait(Some(Duration::ZERO))
            .unwrap()
            .ready()
            .is_empty()
    );
}

#[test]
fn a_port_may_move_to_another_waiter_with_its_client() {
    let mut first = Waiter::new().unwrap();
    let mut second = Waiter::new().unwrap();
    let mut port = open_unlinked_port(PtySetup::raw(9_600)).unwrap();
    first.add(0, &mut port).unwrap();
    let client = Client::open(port.path());
    assert_eq!(port.read(&mut [0; 8]).unwrap(), Event::Attached);
    second.add(1, &mut port).unwrap();
    assert_eq!(second.wait(Some(PATIENCE)).unwrap().ready(), [1]);
    client.send(b"hello");
    assert_eq!(second.wait(Some(PATIENCE)).unwrap().ready(), [1]);
    assert_eq!(port.read(&mut [0; 8]).unwrap(), Event::Data(5));
    assert!(first.wait(Some(Duration::ZERO)).unwrap().ready().is_empty());
}

#[test]
fn a_client_from_before_the_watch_is_not_taken_for_another() {
    let mut port = open_unlinked_port(PtySetup::raw(9_600)).unwrap();
    let client = Client::open(port.path());
    let mut waiter = Waiter::new().unwrap();
    waiter.add(0, &mut port).unwrap();
    assert_eq!(port.read(&mut [0; 8]).unwrap(), Event::Attached);
    drop(Client::open(port.path()));
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [0]);
    assert_eq!(port.read(&mut [0; 8]).unwrap(), Event::Idle);
    client.send(b"still me");
    assert_eq!(port.read(&mut [0; 8]).unwrap(), Event::Data(8));
}

#[test]
fn something_else_to_read_ends_a_wait_and_so_does_its_end() {
    let mut waiter = Waiter::new().unwrap();
    let (ours, theirs) = std::os::unix::net::UnixStream::pair().unwrap();
    waiter.watch(7, &ours).unwrap();
    assert!(
        waiter
            .wait(Some(Duration::ZERO))
            .unwrap()
            .ready()
            .is_empty()
    );
    drop(theirs);
    assert_eq!(waiter.wait(Some(PATIENCE)).unwrap().ready(), [7]);
}
