//! Signals wake the waiter. One test alone in its process, since signals go
//! to the whole of it.
#![allow(
    clippy::unwrap_used,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

use std::time::{Duration, Instant};

use rigsim_pty::Waiter;
use rustix::process::{Signal, getpid, kill_process};

#[test]
fn each_signal_wakes_the_waiter_once() {
    let patience = Duration::from_secs(120);
    let mut waiter = Waiter::new().unwrap();
    waiter.catch_signals().unwrap();
    waiter.catch_signals().unwrap();
    for signal in [Signal::INT, Signal::TERM, Signal::HUP] {
        if signal == Signal::HUP && is_ignored_from_the_start() {
            println!("skipped: SIGHUP is ignored from the start, as under nohup");
            continue;
        }
        let sender = std::thread::spawn(move || {
            std::thread::sleep(Duration::from_millis(20));
            kill_process(getpid(), signal).unwrap();
        });
        let start = Instant::now();
        while !waiter.wait(Some(patience)).unwrap().is_signalled() {
            assert!(
                start.elapsed() < patience,
                "{signal:?} did not wake the waiter"
            );
        }
        sender.join().unwrap();
        assert!(!waiter.wait(Some(Duration::ZERO)).unwrap().is_signalled());
    }
}

/// Whether the parent of this process made it ignore `SIGHUP`, which the waiter respects.
fn is_ignored_from_the_start() -> bool {
    let status = std::fs::read_to_string("/proc/self/status").unwrap();
    let ignored = status.lines().find_map(|line| line.strip_prefix("SigIgn:"));
    let ignored = u64::from_str_radix(ignored.unwrap().trim(), 16).unwrap();
    ignored & 1 << (Signal::HUP.as_raw() - 1) != 0
}
