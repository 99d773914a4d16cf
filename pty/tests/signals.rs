//! Signals wake the waiter. One test alone in its process, since signals go
//! to the whole of it.

use std::time::{Duration, Instant};

use rustix::process::{Signal, getpid, kill_process};
use sim_pty::{TerminationSignal, Waiter};

#[test]
fn each_signal_wakes_the_waiter_once_and_is_named() {
    let patience = Duration::from_secs(20);
    let mut waiter = Waiter::new().unwrap();
    waiter.catch_signals().unwrap();
    waiter.catch_signals().unwrap();
    for (signal, expected) in [
        (Signal::INT, TerminationSignal::Interrupt),
        (Signal::TERM, TerminationSignal::Terminate),
        (Signal::HUP, TerminationSignal::Hangup),
    ] {
        let sender = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            kill_process(getpid(), signal).unwrap();
        });
        let start = Instant::now();
        let caught = loop {
            if let Some(caught) = waiter.wait(Some(patience)).unwrap().signal() {
                break caught;
            }
            assert!(
                start.elapsed() < patience,
                "{expected} did not wake the waiter"
            );
        };
        assert_eq!(caught, expected);
        sender.join().unwrap();
        assert_eq!(waiter.wait(Some(Duration::ZERO)).unwrap().signal(), None);
    }
}
