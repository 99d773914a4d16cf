//! The scenarios with the tag `drive` judge clients that do one job, ahead with an R150 and around a
//! rectangle with a mecanum car: one that hopes for the best fails many of them, one that takes care
//! passes them all. The others are for their scripts, and judge of a client what holds for any.
//!
//! Both clients run in simulated time. Each is a thread that does one thing after another, as any
//! client does; whatever it asks of its ports is done before the thread goes on, so a run is always
//! the same.

#![expect(
    clippy::unwrap_used,
    clippy::disallowed_methods,
    reason = "a test, and it reads the files for the pure library"
)]

mod books;
mod common;
mod drive_clients;

use std::time::Duration;

use rigsim_core::SimTime;
use rigsim_core::rig::PortId;
use rigsim_runner::{Outcome, Run, RunOptions};

use books::{Books, STEP};
use common::Loaded;
use drive_clients::{Client, car, idle, r150};

/// How often a client that waits looks at its port.
const TICK: Duration = Duration::from_micros(500);

/// What a client asks of its ports, by link.
enum Ask {
    Open(usize),
    Close(usize),
    Write(usize, Vec<u8>),
    /// So many bytes, or what there is when the time is over.
    Read(usize, usize, Option<Duration>),
    Sleep(Duration),
}

/// What a port says: bytes, none unless asked for, and the time; nothing when it has hung up.
type Answer = Option<(SimTime, Vec<u8>)>;

/// The ports of a device in simulated time.
struct Ports {
    run: Run,
    now: SimTime,
    /// What each link has received; `None` where it is not open.
    links: [Option<Vec<u8>>; 2],
    /// Kept after each step of the physics, and when the next one is.
    books: Option<(Books, SimTime)>,
}

fn port(link: usize) -> PortId {
    PortId { device: 0, link }
}

impl Ports {
    fn pass(&mut self, time: Duration) {
        self.now += time;
        if let Some((books, next)) = &mut self.books {
            while *next <= self.now {
                self.run.advance(*next).unwrap();
                books.look(&self.run);
                *next += STEP;
            }
        }
        self.run.advance(self.now).unwrap();
        for link in 0..self.links.len() {
            if let Some(received) = &mut self.links[link] {
                self.run.read(port(link), received);
                if self.run.rig().cable_pulled(port(link)) {
                    self.close(link);
                }
            }
        }
    }

    fn close(&mut self, link: usize) {
        if self.links[link].take().is_some() {
            self.run.detach(port(link), self.now).unwrap();
        }
    }

    fn answer(&mut self, ask: Ask) -> Answer {
        self.pass(TICK);
        let mut bytes = Vec::new();
        match ask {
            Ask::Open(link) => {
                if self.run.rig().cable_pulled(port(link)) {
                    return None;
                }
                self.run.attach(port(link), self.now).unwrap();
                self.links[link] = Some(Vec::new());
            }
            Ask::Close(link) => self.close(link),
            Ask::Write(link, bytes) => {
                self.links[link].as_ref()?;
                self.run.send(port(link), self.now, &bytes).unwrap();
            }
            Ask::Read(link, wanted, timeout) => {
                let due = timeout.map(|timeout| self.now + timeout);
                while self.links[link].as_ref()?.len() < wanted
                    && due.is_none_or(|due| self.now < due)
                {
                    self.pass(TICK);
                    if self.run.finished().is_some() {
                        return None;
                    }
                }
                let received = self.links[link].as_mut()?;
                bytes.extend(received.drain(..wanted.min(received.len())));
            }
            Ask::Sleep(time) => self.pass(time),
        }
        Some((self.now, bytes))
    }
}

fn live(seed: u64) -> RunOptions {
    RunOptions {
        live: true,
        ..RunOptions::scripted(seed)
    }
}

/// Plays a run with a real client in the place of the scripted one, to its end.
fn play(run: Run, client: fn(&Client) -> Option<()>) -> Outcome {
    let (run, _) = play_with(run, client, None);
    run.finished().unwrap().clone()
}

/// The same with books; returns the run at its end.
fn play_with(
    mut run: Run,
    client: fn(&Client) -> Option<()>,
    books: Option<Books>,
) -> (Run, Option<Books>) {
    if books.is_some() {
        Books::open(&mut run);
    }
    let mut ports = Ports {
        run,
        now: SimTime::ZERO,
        links: [None, None],
        books: books.map(|books| (books, SimTime::ZERO + STEP)),
    };
    let (client_end, asks, answers) = Client::new();
    std::thread::scope(|scope| {
        let thread = scope.spawn(move || client(&client_end));
        while let Ok(ask) = asks.recv() {
            // A client whose run is over gets no answer, and ends.
            let over = ports.run.finished().is_some();
            let answer = if over { None } else { ports.answer(ask) };
            if answers.send(answer).is_err() {
                break;
            }
        }
        if thread.join().unwrap().is_none() && ports.run.finished().is_none() {
            ports.run.fail("the client ended with an error".to_owned());
        }
    });
    for link in 0..2 {
        ports.close(link);
    }
    while ports.books.is_some() && ports.run.finished().is_none() {
        ports.pass(STEP);
    }
    ports.run.play(&mut |_| {}).unwrap();
    (ports.run, ports.books.map(|(books, _)| books))
}

/// Names of the drives of this kind of device that a client does not pass, with the reasons.
fn failed(kind: &str, client: fn(&Client) -> Option<()>) -> Vec<(String, String)> {
    let mut drives = 0;
    let mut failed = Vec::new();
    for file in common::files() {
        let loaded = Loaded::read(&file).unwrap();
        let tagged = loaded.scenario.tags.iter().any(|tag| tag == "drive");
        if !tagged || loaded.scenario.rig.devices[0].device.id != kind {
            continue;
        }
        drives += 1;
        let outcome = play(loaded.run(live(1)), client);
        if !outcome.passed {
            let reasons: Vec<String> = outcome.failures.iter().map(ToString::to_string).collect();
            failed.push((common::name(&file), reasons.join("; ")));
        }
    }
    assert!(drives >= 8, "only {drives} drives of {kind}");
    failed
}

#[test]
fn a_careful_client_passes_every_drive_of_the_r150() {
    let failed = failed("r150", r150::careful);
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn a_careful_client_passes_every_drive_of_the_car() {
    let failed = failed("mecanum", car::careful);
    assert!(failed.is_empty(), "{failed:#?}");
}

#[test]
fn a_client_that_stops_by_falling_silent_passes_every_drive_of_the_r150() {
    let failed = failed("r150", r150::silent);
    assert!(failed.is_empty(), "{failed:#?}");
}

/// What a file says of the script's way is not said of other clients: of one that only stands there it
/// finds nothing wrong, and mostly that it gave no occasion.
#[test]
fn a_client_that_only_stands_there_breaks_no_rule() {
    let (mut judged, mut skipped) = (0, 0);
    for file in common::files() {
        let loaded = Loaded::read(&file).unwrap();
        if loaded.scenario.tags.iter().any(|tag| tag == "drive") {
            continue;
        }
        judged += 1;
        let outcome = play(loaded.run(live(1)), idle);
        let name = common::name(&file);
        assert_eq!(outcome.failures, [], "{name}");
        skipped += usize::from(outcome.is_skipped());
        assert_ne!(outcome.passed, outcome.is_skipped(), "{name}");
    }
    assert!(judged > 40 && skipped > 20, "{skipped} of {judged}");
}

#[test]
fn energy_and_friction_add_up_in_every_drive() {
    let mut wrong = Vec::new();
    for file in common::files() {
        let loaded = Loaded::read(&file).unwrap();
        if !loaded.scenario.tags.iter().any(|tag| tag == "drive") {
            continue;
        }
        let client = match loaded.scenario.rig.devices[0].device.id {
            "r150" => r150::careful,
            _ => car::careful,
        };
        let (run, books) = play_with(loaded.run(live(1)), client, Some(Books::default()));
        if let Err(why) = books.unwrap().close(&run) {
            wrong.push(format!("{}: {why}", common::name(&file)));
        }
    }
    assert!(wrong.is_empty(), "{wrong:#?}");
}

/// Whatever chance brings, a scenario judges the client by what it does: each is played with the scripted
/// client and, if it is a drive, with the careful one. `SIM_SEEDS` is the first seed and how many of them;
/// `SIM_SEEDS_OF` is a part of the names of the files.
#[test]
fn no_seed_fails_a_good_client() {
    let variable = |name| std::env::var(name).ok();
    let seeds = variable("SIM_SEEDS").unwrap_or_else(|| "1 1".to_owned());
    let (first, count) = seeds.split_once(' ').unwrap();
    let first: u64 = first.parse().unwrap();
    let seeds = first..first + count.parse::<u64>().unwrap();
    let of = variable("SIM_SEEDS_OF").unwrap_or_default();
    let mut failed = Vec::new();
    let mut played = 0;
    for file in common::files() {
        let loaded = Loaded::read(&file).unwrap();
        let name = common::name(&file);
        if !name.contains(&of) {
            continue;
        }
        let is_drive = loaded.scenario.tags.iter().any(|tag| tag == "drive");
        let careful = match loaded.scenario.rig.devices[0].device.id {
            "r150" => r150::careful,
            _ => car::careful,
        };
        for seed in seeds.clone() {
            let mut scripted = loaded.run_with_seed(RunOptions::scripted(seed));
            let outcome = scripted.play(&mut |_| {}).unwrap();
            let mut outcomes = vec![("scripted", outcome.clone())];
            if is_drive {
                let run = loaded.run_with_seed(live(seed));
                outcomes.push(("careful", play(run, careful)));
            }
            played += outcomes.len();
            for (client, outcome) in outcomes.into_iter().filter(|(_, one)| !one.passed) {
                let why = outcome.failures.first().map(ToString::to_string);
                failed.push(format!("{name}, {client} client, seed {seed}: {why:?}"));
            }
        }
    }
    assert!(played > 0, "no scenario's name contains {of}");
    assert!(
        failed.is_empty(),
        "{} of {played} failed:\n{}",
        failed.len(),
        failed.join("\n")
    );
}

#[test]
fn a_naive_client_of_the_r150_fails_where_it_should() {
    let failing = [
        "r150/faults/bytes-lost",
        "r150/faults/cable-pulled",
        "r150/faults/camera-shorted",
        "r150/faults/emergency-stop",
        "r150/faults/line-mute",
        "r150/faults/remote-control-takes-over",
        "r150/faults/replies-missing",
        "r150/faults/vehicle-deaf",
        "r150/faults/wheel-blocked",
    ];
    naive_fails("r150", r150::naive, "r150/jobs/camera-drive", &failing);
}

#[test]
fn a_naive_client_of_the_car_fails_where_it_should() {
    let failing = [
        "mecanum/faults/board-wants-signs-of-life",
        "mecanum/faults/cable-pulled",
        "mecanum/faults/distance-stuck-and-person",
        "mecanum/faults/encoder-lost-on-the-way",
        "mecanum/faults/lines-garbled",
        "mecanum/faults/order-lost",
        "mecanum/faults/person-in-the-way",
        "mecanum/faults/place-forgotten",
        "mecanum/faults/status-silent",
        "mecanum/faults/status-spoilt",
        "mecanum/faults/wheel-blocked-on-the-way",
    ];
    naive_fails("mecanum", car::naive, "mecanum/jobs/rectangle", &failing);
}

fn naive_fails(kind: &str, client: fn(&Client) -> Option<()>, passing: &str, failing: &[&str]) {
    let failed = failed(kind, client);
    let names: Vec<&str> = failed.iter().map(|(name, _)| name.as_str()).collect();
    assert!(!names.contains(&passing), "{failed:#?}");
    for name in failing {
        assert!(names.contains(name), "passes {name}, fails {names:?}");
    }
}
