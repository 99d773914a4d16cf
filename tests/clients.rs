//! Clients that come, go, die, and do not read.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::io::{BufRead as _, BufReader, Write as _};
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use harness::client::{BAUD, Client};
use harness::process::Process;
use harness::wire::frame;
use harness::{PATIENCE, Sim, unprivileged};
use rustix::process::Signal;

const JSON: [&str; 2] = ["--log-format", "json"];

#[test]
fn a_client_may_come_again_and_again() {
    let sim = Sim::start(&JSON);
    // At once, so that the simulator may not even notice that it was gone.
    for round in 0..100 {
        assert_eq!(sim.client().ask(0xF0, &[]).len(), 8, "round {round}");
    }
    let summary = sim.stop().expect_clean().summary();
    assert_eq!(summary["requests"], 100);
}

#[test]
fn what_a_client_has_not_read_is_gone_with_it() {
    let sim = Sim::start(&JSON);
    for round in 0..60 {
        let mut client = sim.client();
        for _ in 0..5 {
            client.send(&frame(0x06, &[]));
        }
        // At different stages: requests under way, replies under way, replies waiting.
        std::thread::sleep(Duration::from_millis(round % 20 * 3));
        drop(client);
        let gone = usize::try_from(round).unwrap() * 2 + 1;
        sim.wait_events("client_detached", gone);
        let mut client = sim.client();
        // What the module says to the last of it is on the cable for some more milliseconds, and longer
        // where simulated time stands still.
        std::thread::sleep(Duration::from_millis(50));
        client.reset_input();
        client.send(&frame(0x07, &[]));
        let (command, _) = client.receive();
        drop(client);
        sim.wait_events("client_detached", gone + 1);
        let late = sim.printed().contains("simulator_stalled");
        assert!(command == 0x07 || late, "{command} in round {round}");
    }
    sim.stop().expect_clean();
}

#[test]
fn what_had_not_begun_its_way_when_a_client_left_is_not_sent() {
    let sim = Sim::start(&JSON);
    for (round, baud) in [BAUD, 9_600].into_iter().enumerate() {
        let mut client = Client::open_at(sim.port(), baud);
        client.send(&frame(0x07, &[]).repeat(1000));
        // It is unknown whose bytes those are that were not read before the next client comes.
        sim.wait_events("client_attached", 2 * round + 1);
        std::thread::sleep(Duration::from_millis(50));
        drop(client);
        let mut client = sim.client();
        let begun = Instant::now();
        client.send(&frame(0xF0, &[]));
        assert!(client.skip_to(0xF0, PATIENCE).is_some());
        println!("answered after {:?}", begun.elapsed());
    }
    let summary = sim.stop().expect_clean().summary();
    assert!(summary["requests"].as_u64() < Some(2000), "{summary}");
}

#[test]
fn a_client_whose_port_is_set_wrongly_gets_advice() {
    use rustix::termios::{ControlModes, LocalModes, OptionalActions, tcgetattr, tcsetattr};
    let sim = Sim::start(&JSON);
    let flags = rustix::fs::OFlags::RDWR | rustix::fs::OFlags::NOCTTY;
    let client = rustix::fs::open(sim.port(), flags, rustix::fs::Mode::empty()).unwrap();
    let mut termios = tcgetattr(&client).unwrap();
    termios.local_modes |= LocalModes::ECHO;
    termios.control_modes |= ControlModes::CSTOPB;
    tcsetattr(&client, OptionalActions::Now, &termios).unwrap();
    rustix::io::write(&client, &frame(0x07, &[])).unwrap();
    let said = sim.wait_event("line_not_raw");
    assert_eq!(said["level"], "warning");
    let text = said["text"].as_str().unwrap();
    assert!(text.contains("stty") && text.contains("pyserial"), "{text}");
    let said = sim.wait_event("stop_bits");
    assert!(said["text"].as_str().unwrap().contains("with 1"), "{said}");
    drop(client);
    sim.wait_event("client_detached");
    let summary = sim.stop().expect_clean().summary();
    let events = summary["events"].as_array().unwrap();
    for code in ["line_not_raw", "stop_bits"] {
        let event = &harness::with_code(events, code)[0];
        assert_eq!(
            (&event["count"], &event["client_faults"]),
            (&1.into(), &1.into())
        );
    }
}

#[test]
fn a_client_that_does_not_read_loses_bytes_and_stalls_no_other() {
    let sim = Sim::start(&JSON);
    let mut client = sim.client();
    let requests = frame(0x06, &[]).repeat(100);
    let start = Instant::now();
    // Until no more is kept for it, which takes eight seconds of simulated time at this baud rate.
    while !sim.printed().contains(r#""code":"overrun""#) {
        assert!(start.elapsed() < 4 * PATIENCE, "nothing was lost");
        // No faster than the line carries them, so that each of these is there as a whole.
        client.send(&requests);
        std::thread::sleep(Duration::from_millis(60));
    }
    // It comes to its senses and reads, what was kept first.
    client.send(&frame(0xF0, &[]));
    assert!(client.skip_to(0xF0, PATIENCE).is_some());
    drop(client);
    sim.wait_event("client_detached");
    let mut client = sim.client();
    assert_eq!(client.ask(0x02, &[1, 0, 0, 0]), [1]);
    drop(client);

    let finished = sim.stop().expect_clean();
    let whole = finished.json().pop().unwrap();
    let summary = finished.summary();
    let find = |code: &str| harness::with_code(summary["events"].as_array().unwrap(), code);
    // Unless all of it came while the machine stalled the simulator, which is then no error of it.
    let is_excused = whole["excused"].as_u64() > Some(0);
    let overrun = find("overrun");
    assert!(is_excused || !overrun.is_empty(), "{whole}");
    for said in &overrun {
        assert!(said["client_faults"].as_u64() > Some(0), "{said}");
        assert!(said["first"].as_str().unwrap().contains("bytes lost"));
    }
    assert!(is_excused || !find("line_full").is_empty(), "{whole}");
    assert!(find("bad_crc").is_empty() && find("noise").is_empty());
}

#[test]
fn a_client_killed_with_the_port_to_itself_does_not_keep_others_out() {
    let dir = tempfile::tempdir().unwrap();
    let mut scene = unprivileged::rerun("scene_of_a_killed_client", dir.path());
    let status = Process::spawn(&mut scene).wait();
    assert!(status.success(), "failed as an ordinary user: {status}");
}

#[test]
#[ignore = "run by another test in its own process, not as root"]
fn scene_of_a_killed_client() {
    if !unprivileged::is_rerun() {
        return;
    }
    assert!(!rustix::process::geteuid().is_root());
    let sim = Sim::start(&JSON);
    for _ in 0..3 {
        let mut command = Command::new(std::env::current_exe().unwrap());
        command
            .args(["--exact", "killed_client", "--ignored", "--nocapture"])
            .env(VICTIM_PORT, sim.port())
            .stdout(Stdio::piped());
        let mut victim = Process::spawn(&mut command);
        let said = BufReader::new(victim.child().stdout.take().unwrap());
        assert!(said.lines().any(|line| line.unwrap().contains(HOLDING)));
        assert!(
            Client::try_open(sim.port(), BAUD).is_err(),
            "it has the port to itself"
        );
        victim.signal(Signal::KILL);
        victim.wait();

        let mut client = sim.client();
        assert_eq!(client.ask(0xF0, &[]).len(), 8);
    }
    sim.stop().expect_clean();
}

const VICTIM_PORT: &str = "SIM_TEST_VICTIM_PORT";
const HOLDING: &str = "holding the port";

#[test]
#[ignore = "run by another test, which kills it"]
fn killed_client() {
    let Some(port) = std::env::var_os(VICTIM_PORT).map(PathBuf::from) else {
        return;
    };
    let mut client = Client::open(&port);
    assert_eq!(client.ask(0xF0, &[]).len(), 8);
    println!("\n{HOLDING}");
    std::io::stdout().flush().unwrap();
    // Killed long before, and no longer there for ever if not.
    std::thread::sleep(PATIENCE);
}
