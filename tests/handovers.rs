//! One client after another on the same port, as fast as they can: the one that stays is answered.
//!
//! `SIM_HANDOVERS=3000 cargo test --test handovers -- --nocapture` is the campaign; without the
//! variable it is a short one.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs::File;
use std::io::Write as _;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

use harness::car::{FORWARD, MainClient, RosClient, STRAFE, motion};
use harness::client::{BAUD, Client};
use harness::wire::frame;
use harness::{PATIENCE, Sim};
use rustix::process::Signal;
use rustix::termios::{OptionalActions, QueueSelector, tcflush, tcgetattr, tcsetattr};

const JSON: [&str; 2] = ["--log-format", "json"];
/// Handovers of each kind without the variable.
const FEW: u32 = 40;

/// What one client does before the next comes.
type Visit = fn(&Path);

/// Opens the port as a shell does, with the settings as they are.
fn open(port: &Path) -> File {
    let mut options = File::options();
    options.read(true).write(true);
    options.open(port).unwrap()
}

fn open_at(port: &Path, baud: u32) -> File {
    let client = open(port);
    let mut termios = tcgetattr(&client).unwrap();
    termios.make_raw();
    termios.set_speed(baud).unwrap();
    tcsetattr(&client, OptionalActions::Now, &termios).unwrap();
    client
}

fn killed(port: &Path, script: &str) {
    let script = format!("exec 3<>\"$0\"; {script} kill -KILL $$");
    let mut shell = Command::new("sh");
    shell.args(["-c", &script]).arg(port);
    shell.stderr(Stdio::null()).status().unwrap();
}

const KINDS: &[(&str, Visit)] = &[
    ("opened and closed at once", |port| drop(open(port))),
    ("two of these", |port| {
        drop(open(port));
        drop(open(port));
    }),
    ("half a frame left behind", |port| {
        open(port).write_all(&frame(0x06, &[])[..4]).unwrap();
    }),
    ("a request left behind", |port| {
        open(port).write_all(&frame(0x06, &[])).unwrap();
    }),
    ("many requests left behind", |port| {
        open(port).write_all(&frame(0x07, &[]).repeat(300)).unwrap();
    }),
    ("killed in the middle of a frame", |port| {
        killed(port, r"printf '\252\125\004\022' >&3;");
    }),
    ("at another speed", |port| {
        open_at(port, 9_600).write_all(&frame(0x06, &[])).unwrap();
    }),
    ("at a low speed", |port| {
        open_at(port, 50).write_all(&frame(0x06, &[])).unwrap();
    }),
    ("at speed 0", |port| {
        open_at(port, 0).write_all(&frame(0x06, &[])).unwrap();
    }),
    ("output held back", |port| {
        let client = open(port);
        rustix::termios::tcflow(&client, rustix::termios::Action::OOff).unwrap();
    }),
];

/// One test at a time: a process that another test starts has open what this one has, until it has
/// become another program, so that what is closed here is closed a moment later.
fn alone() -> MutexGuard<'static, ()> {
    static ALONE: Mutex<()> = Mutex::new(());
    ALONE.lock().unwrap_or_else(PoisonError::into_inner)
}

fn handovers() -> u32 {
    match std::env::var("SIM_HANDOVERS") {
        Ok(text) => text.parse().expect("SIM_HANDOVERS is a number"),
        Err(_) => FEW,
    }
}

#[test]
fn a_client_that_stays_is_answered_whichever_was_there_before() {
    let _alone = alone();
    for wire in ["paced", "instant"] {
        let sim = Sim::start(&[&JSON[..], &["--quiet", "--wire", wire]].concat());
        for (kind, visit) in KINDS {
            let mut slowest = Duration::ZERO;
            for round in 0..handovers() {
                visit(sim.port());
                let mut client = sim.client();
                let begun = Instant::now();
                client.send(&frame(0xF0, &[]));
                let reply = client.skip_to(0xF0, PATIENCE);
                let what = || format!("{kind}, {wire}, round {round}");
                assert_eq!(reply.map(|reply| reply.len()), Some(8), "{}", what());
                slowest = slowest.max(begun.elapsed());
                if round % 20 == 0 {
                    std::thread::sleep(Duration::from_millis(50));
                    client.reset_input();
                    for _ in 0..3 {
                        assert_eq!(client.ask(0x07, &[]), [1], "{}", what());
                    }
                }
            }
            println!("{wire}, {kind}: slowest answer after {slowest:?}");
        }
        sim.stop().expect_clean();
    }
}

/// What waits for room on the line is read while simulated time catches up, and who comes and goes meanwhile
/// is reported in order.
#[test]
fn a_client_is_answered_while_what_another_left_is_caught_up_with() {
    let _alone = alone();
    let sim = Sim::start(&[&JSON[..], &["--speed", "100"]].concat());
    for round in 0..handovers() {
        let mut left = open(sim.port());
        left.write_all(&frame(0x07, &[]).repeat(900)).unwrap();
        std::thread::sleep(Duration::from_millis(u64::from(round % 5) * 2));
        drop(left);
        let mut client = sim.client();
        client.send(&frame(0xF0, &[]));
        assert!(client.skip_to(0xF0, PATIENCE).is_some(), "round {round}");
    }
    let lines = sim.stop().expect_clean().json();
    let codes = lines.iter().filter_map(|line| line["code"].as_str());
    let visits: Vec<&str> = codes
        .filter(|code| ["client_attached", "client_detached"].contains(code))
        .collect();
    assert!(visits.windows(2).all(|two| two[0] != two[1]), "{visits:?}");
}

/// No client is served while several come and go: all that they left lies mixed when the simulator wakes.
#[test]
fn a_client_that_stays_is_answered_by_a_simulator_that_was_asleep() {
    let _alone = alone();
    let sim = Sim::start(&[&JSON[..], &["--quiet"]].concat());
    // A client that holds its output back does so until the simulator wakes up.
    let kinds = KINDS[..KINDS.len() - 1].iter();
    for round in 0..handovers() {
        sim.signal(Signal::STOP);
        for (_, visit) in kinds
            .clone()
            .cycle()
            .skip(round as usize % KINDS.len())
            .take(2)
        {
            visit(sim.port());
        }
        let mut client = sim.client();
        client.send(&frame(0xF0, &[]));
        sim.signal(Signal::CONT);
        let reply = client.skip_to(0xF0, PATIENCE);
        assert_eq!(reply.map(|reply| reply.len()), Some(8), "round {round}");
    }
    sim.stop().expect_clean();
}

/// Writes whole requests and leaves.
fn leave_behind(port: &Path, request: &[u8], bytes: usize) {
    let client = open_at(port, tcgetattr(open(port)).unwrap().output_speed());
    rustix::io::ioctl_fionbio(&client, true).unwrap();
    let whole = bytes / request.len() * request.len();
    // The system may keep less than that, and then a part of the last one.
    let _ = rustix::io::write(&client, &request.repeat(bytes)[..whole]);
}

/// Sends, if need be with the simulator awake, which makes room.
fn send_and_wake(sim: &Sim, client: &mut Client, request: &[u8]) {
    let sent = client.send_some(request);
    sim.signal(Signal::CONT);
    client.send(&request[sent..]);
}

/// What was left may be no client's or the next one's as far as can be known: its replies are many times
/// what the line holds, and more than the system keeps for a client.
#[test]
fn a_client_is_answered_however_much_another_has_left_unread() {
    let _alone = alone();
    for wire in ["paced", "instant"] {
        let sim = Sim::start(&[&JSON[..], &["--quiet", "--wire", wire]].concat());
        for command in [0x06, 0x07] {
            for bytes in [300, 3_000, 12_000, 30_000] {
                sim.signal(Signal::STOP);
                leave_behind(sim.port(), &frame(command, &[]), bytes);
                let mut client = sim.client();
                send_and_wake(&sim, &mut client, &frame(0xF0, &[]));
                let reply = client.skip_to(0xF0, PATIENCE).map(|reply| reply.len());
                assert_eq!(reply, Some(8), "{wire}, {bytes} bytes of {command:#04x}");
                // What may have reached it before that is its own again.
                assert_eq!(client.ask(0x07, &[]), [1]);
            }
        }
        sim.stop().expect_clean();
    }
}

#[test]
fn the_car_obeys_a_client_however_much_another_has_left_unread() {
    let _alone = alone();
    for wire in ["paced", "instant"] {
        let dir = tempfile::tempdir().unwrap();
        let (main, ros) = (dir.path().join("car"), dir.path().join("car-ros"));
        let mut command = harness::command();
        command.args(["--device", "mecanum", "--quiet", "--wire", wire, "--pty"]);
        command.arg(&main).arg("--ros-pty").arg(&ros);
        let sim = Sim::spawn(&mut command, main.clone(), Some(dir));
        sim.wait_ready();
        // Whole packets, which the system keeps: behind a part of one the next would be no packet either.
        for bytes in [3_000, 6_000] {
            sim.signal(Signal::STOP);
            leave_behind(&main, &motion(FORWARD, 1, 400), bytes);
            let mut client = MainClient::open(&main);
            client.send(&motion(STRAFE, 5, 400));
            sim.signal(Signal::CONT);
            let before = client.status().axis[1];
            harness::until("it has gone to the side", || {
                client.status().axis[1] - before >= 5
            });
        }
        sim.signal(Signal::STOP);
        leave_behind(&ros, b"X1 \n", 5_000);
        let mut client = RosClient::open(&ros);
        client.send("X-5 \n");
        sim.signal(Signal::CONT);
        harness::until("it goes back", || client.report().0 < 0);
        drop(client);
        sim.stop().expect_clean();
    }
}

/// Signals come at any moment while it serves, also in the middle of what it asks of the system.
#[test]
fn a_client_that_stays_is_answered_whatever_signals_come_meanwhile() {
    let _alone = alone();
    let sim = Sim::start(&[&JSON[..], &["--quiet"]].concat());
    let done = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            while !done.load(Ordering::Relaxed) {
                sim.signal(Signal::STOP);
                sim.signal(Signal::CONT);
                std::thread::sleep(Duration::from_micros(50));
            }
        });
        let _done = Done(&done);
        for (kind, visit) in KINDS.iter().cycle().take(handovers() as usize) {
            visit(sim.port());
            let mut client = sim.client();
            client.send(&frame(0xF0, &[]));
            let reply = client.skip_to(0xF0, PATIENCE);
            assert_eq!(reply.map(|reply| reply.len()), Some(8), "{kind}");
        }
    });
    sim.stop().expect_clean();
}

/// Makes a thread end, also when the test fails.
struct Done<'a>(&'a AtomicBool);

impl Drop for Done<'_> {
    fn drop(&mut self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Bytes at the right speed are never taken for garbage because of the one who was there before.
#[test]
fn the_next_client_hears_the_car_s_ros_link_at_its_own_speed() {
    let _alone = alone();
    let dir = tempfile::tempdir().unwrap();
    let ros = dir.path().join("car-ros");
    let main = dir.path().join("car");
    let mut command = harness::command();
    command.args(["--device", "mecanum", "--quiet", "--pty"]);
    command.arg(&main).arg("--ros-pty").arg(&ros);
    let sim = Sim::spawn(&mut command, main, Some(dir));
    sim.wait_ready();
    for round in 0..4 {
        for (baud, right) in [(115_200, false), (0, false), (9_600, true)] {
            let client = open_at(&ros, baud);
            let mut heard = Vec::new();
            let begun = Instant::now();
            let long = if right {
                PATIENCE
            } else {
                Duration::from_millis(150)
            };
            while begun.elapsed() < long && heard.len() < 40 {
                let mut bytes = [0; 64];
                let wanted = rustix::io::ioctl_fionread(&client).unwrap();
                if wanted > 0 {
                    let count = rustix::io::read(&client, &mut bytes).unwrap();
                    heard.extend_from_slice(&bytes[..count]);
                }
                std::thread::sleep(Duration::from_millis(2));
            }
            if right {
                let text = String::from_utf8(heard).unwrap();
                let fine = |c: char| c.is_ascii_graphic() || c == ' ' || c == '\n';
                assert!(
                    text.len() > 10 && text.chars().all(fine),
                    "{round}: {text:?}"
                );
            }
        }
    }
    sim.stop();
}

#[test]
fn commands_that_a_client_takes_back_are_not_carried_out() {
    let _alone = alone();
    harness::until("they are taken back in time", take_back);
}

/// Says whether it was in time: all of the commands take 0.26 s on the line.
fn take_back() -> bool {
    let sim = Sim::start(&JSON);
    let client = open_at(sim.port(), BAUD);
    let commands = frame(0x06, &[]).repeat(500);
    let mut asked = &client;
    let begun = Instant::now();
    asked.write_all(&commands).unwrap();
    std::thread::sleep(Duration::from_millis(20));
    tcflush(&client, QueueSelector::OFlush).unwrap();
    let took = begun.elapsed();
    asked.write_all(&frame(0xF0, &[])).unwrap();
    let mut client = sim.client();
    assert!(client.skip_to(0xF0, PATIENCE).is_some());
    drop(client);
    let summary = sim.stop().expect_clean().summary();
    let requests = summary["requests"].as_u64().unwrap();
    let in_time = took < Duration::from_millis(150);
    assert!(requests < 400 || !in_time, "{requests} after {took:?}");
    in_time
}
