//! The scenarios with the tag `drive` judge clients that only drive ahead: one that hopes for the
//! best fails many of them, one that takes care passes them all.
//!
//! Both clients run in simulated time. Each is a thread that does one thing after another, as any
//! client does; whatever it asks of its port is done before the thread goes on, so a run is always
//! the same.

#![expect(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a test, and it reads the files for the pure library"
)]

mod common;
mod drive_clients;

use std::time::Duration;

use sim_core::SimTime;
use sim_core::rig::PortId;
use sim_scenarios::{Outcome, Run, RunOptions};

use common::Loaded;
use drive_clients::{Client, careful, naive};

const PORT: PortId = PortId { device: 0, link: 0 };
/// How often a client that waits looks at its port.
const TICK: Duration = Duration::from_micros(500);

/// What a client asks of its port.
enum Ask {
    Open,
    Close,
    Write(Vec<u8>),
    /// So many bytes, or what there is when the time is over.
    Read(usize, Option<Duration>),
    Sleep(Duration),
}

/// What the port says: bytes, none unless asked for, and the time; nothing when it hung up.
type Answer = Option<(SimTime, Vec<u8>)>;

/// A port in simulated time.
struct Port {
    run: Run,
    now: SimTime,
    open: bool,
    received: Vec<u8>,
}

impl Port {
    /// Goes on for a while; says whether the port is still there.
    fn pass(&mut self, time: Duration) -> bool {
        self.now += time;
        self.run.advance(self.now).unwrap();
        if self.open && self.run.rig().cable_pulled(PORT) {
            self.close();
            return false;
        }
        self.run.client_reads(PORT, &mut self.received);
        true
    }

    fn close(&mut self) {
        self.received.clear();
        if std::mem::take(&mut self.open) {
            self.run.detach(PORT, self.now).unwrap();
        }
    }

    fn answer(&mut self, ask: Ask) -> Answer {
        let mut bytes = Vec::new();
        if !self.pass(TICK) {
            return None;
        }
        match ask {
            Ask::Open => {
                if self.run.rig().cable_pulled(PORT) {
                    return None;
                }
                self.run.attach(PORT, self.now).unwrap();
                self.open = true;
            }
            Ask::Close => self.close(),
            Ask::Write(_) | Ask::Read(..) if !self.open => return None,
            Ask::Write(bytes) => self.run.client_sends(PORT, self.now, &bytes).unwrap(),
            Ask::Read(wanted, timeout) => {
                let due = timeout.map(|timeout| self.now + timeout);
                while self.received.len() < wanted && due.is_none_or(|due| self.now < due) {
                    if !self.pass(TICK) || self.run.finished().is_some() {
                        return None;
                    }
                }
                let count = wanted.min(self.received.len());
                bytes.extend(self.received.drain(..count));
            }
            Ask::Sleep(time) => {
                if !self.pass(time) {
                    return None;
                }
            }
        }
        Some((self.now, bytes))
    }
}

/// Plays a scenario with a real client in the place of the scripted one, to its end.
fn play(loaded: &Loaded, client: fn(&Client) -> Option<()>) -> Outcome {
    let options = RunOptions {
        live: true,
        ..RunOptions::scripted(1)
    };
    let mut port = Port {
        run: loaded.run(options),
        now: SimTime::ZERO,
        open: false,
        received: Vec::new(),
    };
    let (client_end, asks, answers) = Client::new();
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || client(&client_end));
        while let Ok(ask) = asks.recv() {
            // Whoever is asked nothing any more is told so, and ends.
            let over = port.run.finished().is_some();
            let answer = if over { None } else { port.answer(ask) };
            if answers.send(answer).is_err() {
                break;
            }
        }
        if thread.join().unwrap().is_none() && port.run.finished().is_none() {
            port.run.fail("the client ended with an error".to_owned());
        }
    });
    port.close();
    port.run.play(&mut |_| {}).unwrap().clone()
}

/// Names of the drives that a client does not pass, with the reasons.
fn failed(client: fn(&Client) -> Option<()>) -> Vec<(String, String)> {
    let mut failed = Vec::new();
    for file in common::files() {
        let loaded = Loaded::read(&file).unwrap();
        if !loaded.scenario.tags.iter().any(|tag| tag == "drive") {
            continue;
        }
        let outcome = play(&loaded, client);
        if !outcome.passed {
            let reasons: Vec<String> = outcome.failures.iter().map(ToString::to_string).collect();
            failed.push((common::name(&file), reasons.join("; ")));
        }
    }
    failed
}

#[test]
fn a_careful_client_passes_every_drive() {
    let failed = failed(careful);
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn a_naive_client_passes_the_plain_drive_and_fails_where_it_should() {
    let failed = failed(naive);
    let names: Vec<&str> = failed.iter().map(|(name, _)| name.as_str()).collect();
    assert!(!names.contains(&"r150/plain-drive"), "{failed:#?}");
    for name in [
        "r150/bytes-lost",
        "r150/cable-pulled",
        "r150/camera-shorted",
        "r150/emergency-stop",
        "r150/line-mute",
        "r150/module-restarts",
        "r150/remote-control-takes-over",
        "r150/replies-missing",
        "r150/wheel-blocked",
    ] {
        assert!(names.contains(&name), "passes {name}, fails {names:?}");
    }
}
