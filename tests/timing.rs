//! What it costs, and how time passes.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::fs;
use std::time::{Duration, Instant};

use harness::client::Client;
use harness::wire::{frame, motors};
use harness::{PATIENCE, Sim, command, until, with_code};
use rustix::process::Signal;
use serde_json::Value;

/// User and system time used so far, in clock ticks of 10 ms.
fn cpu_ticks(pid: u32) -> u64 {
    let stat = fs::read_to_string(format!("/proc/{pid}/stat")).unwrap();
    // The name in parentheses may hold anything; the third field is the first behind it.
    let fields = stat.rsplit_once(')').unwrap().1;
    let field = |number: usize| -> u64 {
        fields
            .split_whitespace()
            .nth(number - 3)
            .unwrap()
            .parse()
            .unwrap()
    };
    field(14) + field(15)
}

/// How many threads and open files it has.
fn threads_and_files(pid: u32) -> (usize, usize) {
    let count = |what| fs::read_dir(format!("/proc/{pid}/{what}")).unwrap().count();
    (count("task"), count("fd"))
}

#[test]
fn idling_costs_nothing() {
    let sim = Sim::start(&[]);
    // A client has been there, switched something on, driven, and left it rolling.
    let mut client = sim.client();
    assert_eq!(client.ask(0x02, &[1, 0, 0, 0]), [1]);
    client.send(&motors(500, 500));
    drop(client);
    sim.wait_line(&["[heartbeat_lost]"]);
    let before = cpu_ticks(sim.pid());
    std::thread::sleep(Duration::from_secs(4));
    let used = cpu_ticks(sim.pid()) - before;
    // 1 % of a core are 4 ticks; one more since ticks are counted whole. What others do on this
    // machine does not count.
    assert!(used <= 5, "{used} ticks of 10 ms in 4 s");
    sim.stop().expect_clean();
}

#[test]
fn a_hundred_clients_leave_nothing_behind() {
    let sim = Sim::start(&[]);
    let visit = || assert_eq!(sim.client().ask(0xF0, &[]).len(), 8);
    visit();
    sim.wait_line(&["[client_detached]"]);
    let before = threads_and_files(sim.pid());
    for _ in 0..100 {
        visit();
    }
    // The last client is noticed to be gone a moment later.
    until("threads and files are as many as before", || {
        threads_and_files(sim.pid()) == before
    });
    sim.stop().expect_clean();
}

/// How long a system info request and its reply take.
fn exchange(client: &mut Client) -> Duration {
    let start = Instant::now();
    assert_eq!(client.ask(0x06, &[]).len(), 76);
    start.elapsed()
}

/// The same at 115200 baud: 6 bytes there and 82 back, of ten bits each.
const ON_THE_LINE: Duration = Duration::from_micros(88 * 10 * 1_000_000 / 115_200);

#[test]
fn bytes_take_as_long_as_on_a_cable() {
    let sim = Sim::start(&[]);
    let mut client = sim.client();
    for _ in 0..20 {
        let took = exchange(&mut client);
        assert!(took >= ON_THE_LINE, "{took:?}, sooner than {ON_THE_LINE:?}");
    }
    sim.stop().expect_clean();
}

#[test]
fn bytes_take_no_time_on_an_instant_wire() {
    let sim = Sim::start(&["--wire", "instant"]);
    let mut client = sim.client();
    // Once is enough: no machine is so slow that it is never fast for a few milliseconds, and on
    // a paced line it could not happen at all.
    until("a reply comes sooner than on a cable", || {
        exchange(&mut client) < ON_THE_LINE
    });
    sim.stop().expect_clean();
}

#[test]
fn simulated_time_runs_at_the_speed_asked_for() {
    let sim = Sim::start(&["--speed", "4", "--log-format", "json"]);
    let mut client = sim.client();
    let start = Instant::now();
    let mut fired = 0;
    loop {
        let sent = Instant::now();
        client.send(&motors(100, 100));
        fired += 1;
        // One is printed for each command, since each is given up before the next.
        sim.wait_events("watchdog_fired", fired);
        let took = sent.elapsed();
        // 500 ms of simulated time are 125 ms; never sooner, but a slow machine may print late.
        assert!(took >= Duration::from_millis(125), "fired after {took:?}");
        if took < Duration::from_millis(400) {
            break;
        }
        assert!(start.elapsed() < PATIENCE, "never sooner than {took:?}");
    }
    sim.stop().expect_clean();
}

#[test]
fn a_busy_machine_is_no_error_of_the_client() {
    until("this test itself has had its time", || {
        drive_past_a_pause() < Duration::from_millis(400)
    });
}

/// Says how far apart commands were at most, beyond which the client is in error.
fn drive_past_a_pause() -> Duration {
    let sim = Sim::start(&["--log-format", "json"]);
    let mut client = sim.client();
    // Ten commands a second: far from both the least pause of 50 ms and the watchdog's 500 ms.
    let mut sent = 0;
    let mut last = Instant::now();
    let mut longest = Duration::ZERO;
    let mut send_for = |time: Duration| {
        let start = Instant::now();
        while start.elapsed() < time {
            client.send(&motors(300, 300));
            sent += 1;
            longest = longest.max(last.elapsed());
            last = Instant::now();
            std::thread::sleep(Duration::from_millis(100));
        }
    };
    send_for(Duration::from_secs(1));
    // What a machine does that has no time for the simulator, for longer than any timeout of the
    // module: the heartbeat's is 3 s.
    sim.signal(Signal::STOP);
    send_for(Duration::from_millis(3500));
    sim.signal(Signal::CONT);
    send_for(Duration::from_secs(1));

    let late = sim.wait_event("simulator_stalled");
    assert_eq!(late["level"], "warning");
    // Of those that came in one burst after the pause one is answered for all.
    for reply in 0..sent - 36 {
        let answer = client.skip_to(0x12, PATIENCE);
        assert!(answer.is_some(), "{reply} of {sent} answered");
    }
    let finished = sim.stop().expect_clean();
    let summary = finished.summary();
    let events = summary["events"].as_array().unwrap();
    let in_rhythm = longest < Duration::from_millis(400);
    for code in ["watchdog_fired", "over_rate", "heartbeat_lost"] {
        let has_error = !with_code(events, code).is_empty();
        assert!(!has_error || !in_rhythm, "{longest:?} {events:?}");
    }
    let late = &with_code(events, "simulator_stalled")[0];
    assert_eq!(late["client_faults"], 0);
    longest
}

/// Sends motor commands every `period` for `time`, while the machine stops the simulator for each of
/// `stops`. Returns whether the client was steady by its own clock, and what the simulator reports.
fn drive_steadily(period: Duration, time: Duration, stops: &[Duration]) -> (bool, Vec<Value>) {
    let sim = Sim::start(&["--log-format", "json"]);
    let mut client = sim.client();
    let mut sent = Vec::new();
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for stop in stops {
                std::thread::sleep(Duration::from_millis(650));
                sim.signal(Signal::STOP);
                std::thread::sleep(*stop);
                sim.signal(Signal::CONT);
            }
        });
        let start = Instant::now();
        while start.elapsed() < time {
            let due = period * u32::try_from(sent.len()).unwrap();
            std::thread::sleep(due.saturating_sub(start.elapsed()));
            let before = Instant::now();
            client.send(&motors(300, 300));
            sent.push((before, Instant::now()));
        }
    });
    let windows = sent.windows(22);
    let is_steady = windows.map(|sent| sent[21].0 - sent[0].1).min() > Some(Duration::from_secs(1));
    let summary = sim.stop().expect_clean().summary();
    (is_steady, summary["events"].as_array().unwrap().clone())
}

#[test]
fn a_stopped_simulator_does_not_make_a_steady_client_too_fast() {
    let stops = |stops: &[u64]| -> Vec<Duration> {
        stops.iter().map(|ms| Duration::from_millis(*ms)).collect()
    };
    for (period, stops) in [
        (55, stops(&[300])),
        (50, stops(&[52, 120, 240])),
        (50, stops(&[30, 30, 30, 30])),
    ] {
        until("the client has its time", || {
            let time = Duration::from_millis(4000);
            let (is_steady, events) = drive_steadily(Duration::from_millis(period), time, &stops);
            let has_error = !with_code(&events, "over_rate").is_empty();
            assert!(!has_error || !is_steady, "{period} {stops:?} {events:?}");
            is_steady
        });
    }
    // A client that is too fast is found, stopped or not.
    let time = Duration::from_millis(4000);
    let (_, events) = drive_steadily(Duration::from_millis(25), time, &stops(&[52, 120]));
    assert!(!with_code(&events, "over_rate").is_empty(), "{events:?}");
}

#[test]
fn replies_to_motor_commands_keep_their_distance_on_a_busy_machine() {
    let sim = Sim::start(&["-v", "--log-format", "json"]);
    let mut client = sim.client();
    // 200 Hz, over stops that are too short and long enough for simulated time to stand still.
    for turn in 0..400 {
        match turn % 100 {
            20 | 60 => sim.signal(Signal::STOP),
            22 | 99 => sim.signal(Signal::CONT),
            _ => {}
        }
        client.send(&motors(300, 300));
        std::thread::sleep(Duration::from_millis(5));
    }
    let lines = sim.stop().expect_clean().json();
    let replies = with_code(&lines, "reply");
    let times = replies
        .iter()
        .map(|reply| reply["time_s"].as_f64().unwrap());
    let times: Vec<f64> = times.collect();
    assert!(times.len() > 10, "{times:?}");
    for pair in times.windows(2) {
        // Times are printed in microseconds.
        assert!(pair[1] - pair[0] > 0.049_998, "{pair:?}");
    }
}

#[test]
fn commands_that_a_busy_machine_delivers_unevenly_are_all_answered() {
    const COMMANDS: u32 = 40;
    let sim = Sim::start(&["--log-format", "json"]);
    let mut client = sim.client();
    // 60 ms apart, and every other one is read 15 ms late: too little for time to stand still, but
    // the next comes 45 ms later. However busy the machine is, none of them was sent too soon.
    for command in 0..COMMANDS {
        let hold = command.is_multiple_of(2);
        if hold {
            sim.signal(Signal::STOP);
        }
        client.send(&motors(300, 300));
        std::thread::sleep(Duration::from_millis(15));
        if hold {
            sim.signal(Signal::CONT);
        }
        std::thread::sleep(Duration::from_millis(45));
    }
    for reply in 0..COMMANDS {
        let answer = client.skip_to(0x12, PATIENCE);
        assert!(answer.is_some(), "{reply} of {COMMANDS} answered");
    }
    let finished = sim.stop().expect_clean();
    let events = finished.summary()["events"].as_array().unwrap().clone();
    assert!(with_code(&events, "over_rate").is_empty(), "{events:?}");
}

#[test]
fn what_a_client_has_written_goes_out_without_a_pause_on_a_busy_machine() {
    const REQUESTS: usize = 60;
    let sim = Sim::start(&["-v", "--log-format", "json"]);
    let mut client = sim.client();
    let request = frame(0x07, &[]);
    client.send(&request.repeat(REQUESTS));
    // Too little for time to stand still, and longer than a UART has bytes to send.
    until("all are read", || {
        sim.signal(Signal::STOP);
        std::thread::sleep(Duration::from_millis(12));
        sim.signal(Signal::CONT);
        std::thread::sleep(Duration::from_millis(3));
        sim.printed().matches("\"code\":\"request\"").count() == REQUESTS
    });
    let lines = sim.stop().expect_clean().json();
    let read = with_code(&lines, "request");
    let time = |request: &Value| request["time_s"].as_f64().unwrap();
    let span = time(&read[REQUESTS - 1]) - time(&read[0]);
    // 8N1 at 115200 baud; and no pause that is longer than a byte.
    let bytes = (REQUESTS - 1) * request.len();
    let least = bytes as f64 * 10.0 / 115_200.0;
    assert!(
        (least * 0.999..least * 1.1).contains(&span),
        "{span} s instead of {least} s"
    );
}

#[test]
fn on_a_machine_that_is_too_slow_an_event_says_so_and_vehicles_obey() {
    // Twelve million steps of a vehicle for each second of real time: no machine does that, even if
    // all but one stand and cost little.
    let dir = tempfile::tempdir().unwrap();
    let port = dir.path().join("r150-0");
    let devices: Vec<String> = (0..60)
        .map(|n| {
            let pose = format!("{{ x = \"{} m\", y = \"0 m\" }}", n * 3);
            format!("[[device]]\nkind = \"r150\"\nport = \"r150-{n}\"\npose = {pose}\n")
        })
        .collect();
    let rig = dir.path().join("rig.toml");
    fs::write(&rig, format!("schema = 1\n{}", devices.concat())).unwrap();
    let mut command = command();
    command.arg("--rig").arg(rig);
    command.args(["--speed", "100", "--set", "world.step=500us"]);
    let sim = Sim::spawn(
        command.args(["--seed", "1", "--log-format", "json"]),
        port,
        Some(dir),
    );
    sim.wait_ready();
    let mut client = sim.client();
    let start = Instant::now();
    while !sim.printed().contains("simulator_too_slow") {
        assert!(start.elapsed() < PATIENCE, "it keeps up");
        // At this speed the watchdog is a matter of milliseconds.
        client.send(&motors(1000, 1000));
        std::thread::sleep(Duration::from_millis(2));
    }
    // It looks at its ports all the while.
    assert!(client.skip_to(0x12, PATIENCE).is_some());
    drop(client);
    let finished = sim.stop().expect_clean();
    let said = with_code(&finished.json(), "simulator_too_slow");
    // Once for each device.
    assert_eq!(said.len(), 60);
}
