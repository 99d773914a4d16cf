//! Between a client and a vehicle: what passes, what is recorded, and what a recording tells.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::io::{Read as _, Write as _};
use std::path::{Path, PathBuf};
use std::sync::mpsc::{Receiver, channel};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

use harness::client::Client;
use harness::live::Folder;
use harness::wire::frame;
use harness::{PATIENCE, Sim, command, json_lines, python, run, until};
use rigsim_pty::{Event, PtySetup, Waiter, open_port};
use serde_json::Value;
use tempfile::TempDir;

/// A recorder between `dir/client` and the vehicle at `dir/vehicle`, which is there already.
fn tap(dir: &TempDir, args: &[&str]) -> Sim {
    let [client, vehicle, trace] = ["client", "vehicle", "drive.jsonl"].map(|f| dir.path().join(f));
    let mut command = command();
    command.arg("tap").arg(vehicle).arg("--pty").arg(&client);
    command.arg("--trace").arg(trace).args(args);
    let sim = Sim::spawn(&mut command, client, None);
    sim.wait_ready();
    sim
}

/// The bytes of a recording, of one kind of record.
fn recorded(dir: &TempDir, kind: &str) -> Vec<u8> {
    let of_kind = records(&dir.path().join("drive.jsonl"));
    let of_kind = of_kind.iter().filter(|record| record["kind"] == kind);
    let bytes = |record: &Value| {
        let digits = record["bytes"].as_str().unwrap().as_bytes().to_vec();
        let pairs = digits
            .chunks(2)
            .map(|pair| std::str::from_utf8(pair).unwrap().to_owned());
        pairs
            .map(|pair| u8::from_str_radix(&pair, 16).unwrap())
            .collect::<Vec<_>>()
    };
    of_kind.flat_map(bytes).collect()
}

fn records(path: &Path) -> Vec<Value> {
    json_lines(&std::fs::read_to_string(path).unwrap())
}

/// Bytes that do not repeat soon.
fn noise(count: usize, seed: u32) -> Vec<u8> {
    let mut state = seed;
    let next = || {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        state.to_be_bytes()[0]
    };
    std::iter::repeat_with(next).take(count).collect()
}

/// A device at `dir/vehicle` that says what comes, and sends.
struct Vehicle {
    came: Receiver<Vec<u8>>,
    thread: JoinHandle<()>,
}

impl Vehicle {
    /// Sends `bytes` once something has come; ends, as if unplugged, when what comes is not listened to.
    fn start(dir: &TempDir, bytes: Vec<u8>) -> Self {
        Self::paced(dir, bytes, f64::INFINITY)
    }

    /// The same with at most so many bytes a second.
    fn paced(dir: &TempDir, bytes: Vec<u8>, rate: f64) -> Self {
        let path = dir.path().join("vehicle");
        let mut port = open_port(path, PtySetup::raw(115_200)).unwrap();
        let (tell, came) = channel();
        let thread = std::thread::spawn(move || {
            let mut waiter = Waiter::new().unwrap();
            waiter.add(0, &mut port).unwrap();
            let (mut buf, mut sent, mut begun) = ([0; 4096], 0, None);
            loop {
                waiter.wait(Some(Duration::from_millis(1))).unwrap();
                let event = port.read(&mut buf).unwrap();
                if matches!(event, Event::Data(_)) {
                    begun.get_or_insert(Instant::now());
                }
                match event {
                    Event::Data(n) if tell.send(buf[..n].to_vec()).is_err() => return,
                    // So it learns that it is to end.
                    Event::Idle if tell.send(Vec::new()).is_err() => return,
                    _ => {}
                }
                if let Some(begun) = begun {
                    let due = due(begun, rate).min(bytes.len());
                    let most = due.saturating_sub(sent).min(port.room());
                    sent += port.write(&bytes[sent..sent + most]).unwrap();
                }
            }
        });
        Self { came, thread }
    }

    /// Waits until so many bytes have come.
    fn receive(&self, count: usize) -> Vec<u8> {
        let mut all = Vec::new();
        while all.len() < count {
            all.extend(
                self.came
                    .recv_timeout(PATIENCE)
                    .expect("the vehicle is there"),
            );
        }
        all
    }

    fn end(self) {
        drop(self.came);
        self.thread.join().unwrap();
    }
}

/// Bytes that may have been sent by now.
#[expect(
    clippy::cast_possible_truncation,
    clippy::cast_sign_loss,
    reason = "a cast from a float saturates"
)]
fn due(begun: Instant, rate: f64) -> usize {
    (begun.elapsed().as_secs_f64().max(1e-3) * rate) as usize
}

/// Sends so many bytes from either side at most at a rate, in bytes a second.
fn pass_both_ways(count: usize, rate: f64) {
    let dir = tempfile::tempdir().unwrap();
    let (ahead, back) = (noise(count, 1), noise(count, 2));
    let vehicle = Vehicle::paced(&dir, back.clone(), rate);
    let tap = tap(&dir, &[]);
    let mut port = Client::try_open(tap.port(), 115_200).unwrap();
    let mut reader = port.try_clone_native().unwrap();
    let read = std::thread::spawn(move || {
        serialport::SerialPort::set_timeout(&mut reader, PATIENCE).unwrap();
        let mut bytes = vec![0; count];
        reader.read_exact(&mut bytes).unwrap();
        bytes
    });
    serialport::SerialPort::set_timeout(&mut port, PATIENCE).unwrap();
    let to_send = ahead.clone();
    let write = std::thread::spawn(move || {
        let (begun, mut sent) = (Instant::now(), 0);
        while sent < count {
            let due = due(begun, rate).min(count);
            port.write_all(&to_send[sent..due]).unwrap();
            sent = due;
            std::thread::sleep(Duration::from_millis(u64::from(sent < count)));
        }
        port
    });
    let came = vehicle.receive(count);
    let read = read.join().unwrap();
    drop(write.join().unwrap());
    assert!(came == ahead, "what the vehicle got is not what was sent");
    assert!(read == back, "what the client got is not what was sent");
    let out = tap.stop().expect_clean().out;
    vehicle.end();
    let summary = format!("{count} bytes to the vehicle, {count} bytes from it");
    assert!(out.contains(&summary), "{out}");
    assert!(recorded(&dir, "in") == ahead && recorded(&dir, "out") == back);
}

#[test]
fn no_byte_is_lost_or_added_at_full_speed() {
    pass_both_ways(1_000_000, f64::INFINITY);
}

/// Bytes a second at 115200 baud.
const LINE: f64 = 11_520.0;

#[test]
fn no_byte_is_lost_or_added_at_the_speed_of_a_line() {
    pass_both_ways(30_000, LINE);
}

#[test]
#[ignore = "takes long; it is the same with more"]
fn no_byte_of_ten_million_is_lost_or_added() {
    pass_both_ways(10_000_000, f64::INFINITY);
    pass_both_ways(10_000_000, LINE);
}

#[test]
fn what_a_client_wrote_before_it_left_reaches_the_vehicle() {
    hang_up(20);
}

#[test]
#[ignore = "takes long; it is the same with more"]
fn no_byte_of_ten_million_of_clients_that_hang_up_is_lost_or_added() {
    hang_up(5000);
}

/// Sends 2000 bytes from each of so many clients, which then hang up.
fn hang_up(clients: u32) {
    let dir = tempfile::tempdir().unwrap();
    let vehicle = Vehicle::start(&dir, Vec::new());
    let tap = tap(&dir, &[]);
    let (mut all, mut left) = (Vec::new(), 0);
    for client in 0..clients {
        let bytes = noise(2000, client);
        let mut port = None;
        until("the port can be opened", || {
            port = Client::try_open(tap.port(), 115_200).ok();
            port.is_some()
        });
        port.unwrap().write_all(&bytes).unwrap();
        assert!(vehicle.receive(2000) == bytes, "client {client}");
        all.extend(bytes);
        left += 1;
        until("it is noticed that the client has left", || {
            tap.printed().matches("[client_detached]").count() == left
        });
    }
    tap.stop().expect_clean();
    vehicle.end();
    assert!(recorded(&dir, "in") == all);
    let kinds = records(&dir.path().join("drive.jsonl"));
    let count = |kind: &str| kinds.iter().filter(|record| record["kind"] == kind).count();
    assert_eq!((count("attach"), count("end")), (left, 1));
}

#[test]
fn a_vehicle_that_is_unplugged_hangs_up_and_is_found_again() {
    let dir = tempfile::tempdir().unwrap();
    let vehicle = Vehicle::start(&dir, b"first".to_vec());
    let tap = tap(&dir, &[]);
    let mut client = Client::open(tap.port());
    client.send(b"one");
    assert_eq!(vehicle.receive(3), b"one");
    assert_eq!(client.read_count(5), b"first");
    vehicle.end();
    tap.wait_line(&["[vehicle_gone]"]);
    drop(client);
    let vehicle = Vehicle::start(&dir, b"second".to_vec());
    tap.wait_line(&["[vehicle_back]"]);
    let mut client = Client::open(tap.port());
    client.send(b"two");
    assert_eq!(vehicle.receive(3), b"two");
    until("all is recorded", || {
        std::thread::sleep(Duration::from_millis(50));
        recorded(&dir, "out").ends_with(b"second")
    });
    tap.stop().expect_clean();
    vehicle.end();
    assert_eq!(recorded(&dir, "in"), b"onetwo");
    assert_eq!(recorded(&dir, "out"), b"firstsecond");
}

#[test]
fn the_line_is_set_as_the_client_sets_it_and_traffic_is_put_into_words() {
    let dir = tempfile::tempdir().unwrap();
    let vehicle = Sim::start_at(&dir.path().join("vehicle"), &["--log-format", "json"]);
    let tap = tap(&dir, &["-v"]);
    let mut client = Client::open_at(tap.port(), 9600);
    client.send(&[0x00]);
    vehicle.wait_event("baud_mismatch");
    tap.wait_line(&["the client has set 9600 baud", "[baud_mismatch]"]);
    drop(client);
    vehicle.wait_event("client_detached");
    let mut client = tap.client();
    assert_eq!(client.ask(0x07, &[]), [1]);
    vehicle.wait_events("client_attached", 2);
    tap.wait_line(&["->", "0x07 heartbeat", "| AA 55 00 07"]);
    tap.wait_line(&["<-", "0x07 heartbeat success true", "| AA 55 01 07 01"]);
    drop(client);
    tap.stop().expect_clean();
    let recorded_before = recorded(&dir, "in");
    let paths = ["vehicle", "client", "drive.jsonl"].map(|name| dir.path().join(name));
    let [at, place, trace] = paths.each_ref().map(|path| path.to_str().unwrap());
    let again = |trace| run(&["tap", at, "--pty", place, "--trace", trace]);
    again(trace).expect_refusal(2, &["drive.jsonl is there already"]);
    again("/dev/full").expect_refusal(3, &["/dev/full", "No space left"]);
    assert_eq!(recorded(&dir, "in"), recorded_before);
    vehicle.stop().expect_clean();
    let lines = records(&dir.path().join("drive.jsonl"));
    let bauds = lines.iter().filter(|record| record["kind"] == "line");
    let bauds: Vec<u64> = bauds
        .map(|record| record["baud"].as_u64().unwrap())
        .collect();
    assert!(
        bauds.contains(&9600) && bauds.ends_with(&[115_200]),
        "{bauds:?}"
    );
    assert_eq!(lines[0]["kind"], "header");
    assert!(recorded(&dir, "in").ends_with(&frame(0x07, &[])));
}

#[test]
fn the_page_shows_what_the_vehicle_replies_and_a_model_that_the_client_drives() {
    let dir = tempfile::tempdir().unwrap();
    let charge = ["--set", "r150.battery.initial_soc=37 %"];
    let vehicle = Sim::start_at(&dir.path().join("vehicle"), &charge);
    let tap = tap(&dir, &["--control", "127.0.0.1:0"]);
    let line = tap.wait_line(&["control on"]);
    let url = line.trim().trim_start_matches("control on ").to_owned();
    let get = |names: &[&str]| -> Vec<f64> {
        let out = run(&[&["ctl", "--url", &url, "get"], names].concat()).expect_clean();
        let value = |line: &str| line.split_whitespace().last()?.parse().ok();
        let values: Option<Vec<f64>> = out.out.lines().map(value).collect();
        values.unwrap_or_else(|| panic!("{}", out.out))
    };
    let mut client = tap.client();
    let mut asked = 0.0;
    until("the model has driven", || {
        let reply = client.ask(0x12, &[0xE8, 0x03, 0xE8, 0x03]);
        assert_eq!(u16::from_le_bytes([reply[4], reply[5]]) / 10, 37);
        asked += 1.0;
        std::thread::sleep(Duration::from_millis(60));
        get(&["truth.distance_m"])[0] > 0.2
    });
    until("all that passed has been shown", || {
        get(&["count.replies"]) == [asked]
    });
    // The model has the usual charge, which no reply of the vehicle's says.
    let shown = get(&["reported.soc_percent", "truth.soc_percent"]);
    assert!(
        (36.0..=37.0).contains(&shown[0]) && shown[1] > 79.0,
        "{shown:?}"
    );
    vehicle.stop().expect_clean();
    tap.wait_line(&["[vehicle_gone]"]);
    until("the client is known to have lost its port", || {
        let get = ["ctl", "--url", &url, "get", "client.attached"];
        run(&get).expect_clean().out.contains("false")
    });
    tap.stop().expect_clean();
}

#[test]
fn both_links_of_a_car_pass() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
    let car = path("car");
    let ros = path("car-ros");
    let args = ["--device", "mecanum", "--ros-pty", &ros];
    let _car = Sim::start_at(Path::new(&car), &args);
    let (main_end, ros_end, trace) = (path("main"), path("ros"), path("drive.jsonl"));
    let mut command = command();
    command.args([
        "tap", &car, &ros, "--device", "mecanum", "--trace", &trace, "-v",
    ]);
    command.args(["--pty", &main_end, "--pty", &ros_end]);
    let tap = Sim::spawn(&mut command, PathBuf::new(), None);
    tap.wait_ready();
    let _main = Client::open(Path::new(&main_end));
    let _ros = Client::open_at(Path::new(&ros_end), 9600);
    tap.wait_line(&["mecanum/main", "<-", "status seq"]);
    tap.wait_line(&["mecanum/ROS", "<-", "report"]);
    tap.stop().expect_clean();
    let lines = records(&dir.path().join("drive.jsonl"));
    for link in [0, 1] {
        let from = |record: &&Value| record["kind"] == "out" && record["port"][1] == link;
        assert!(lines.iter().any(|record| from(&record)), "link {link}");
    }
}

#[test]
fn a_capture_made_elsewhere_becomes_a_recording() {
    let dir = tempfile::tempdir().unwrap();
    let [csv, trace] = ["capture.csv", "drive.jsonl"].map(|f| dir.path().join(f));
    std::fs::write(&csv, "t,who,bytes\n5.0,client,AA 55\n5.25,vehicle,0102\n").unwrap();
    let [csv, trace] = [&csv, &trace].map(|path| path.to_str().unwrap());
    let read = run(&["tap", "--csv", csv, "--trace", trace]).expect_clean();
    assert_eq!(read.out, "2 bytes to the vehicle, 2 bytes from it\n");
    let refused = run(&["tap", "--csv", csv, "--usb", "1.5", "--trace", trace]);
    refused.expect_refusal(2, &["--usb"]);
    assert_eq!(
        (recorded(&dir, "in"), recorded(&dir, "out")),
        (vec![0xAA, 0x55], vec![1, 2])
    );
    // No run of the model is the same to the last byte.
    run(&["trace", trace]).expect_refusal(2, &["recording of a vehicle", "sim compare"]);
    // What cannot be read is not as documented, and no setting explains it.
    std::fs::write(csv, "5.0,client,AA550007C784\n5.25,vehicle,0102\n").unwrap();
    run(&["tap", "--csv", csv, "--trace", trace]);
    let compare = run(&["compare", trace, "--only", "r150.over_rate"]);
    assert_eq!(compare.code(), Some(1), "{}{}", compare.out, compare.err);
    assert!(
        compare
            .out
            .contains("nothing that the vehicle sent can be read")
    );
    let toml = dir.path().join("vehicle.toml");
    let fit = ["fit", trace, "--only", "r150.over_rate", "--output"];
    let fit = run(&[&fit[..], &[toml.to_str().unwrap()]].concat()).expect_clean();
    assert!(fit.out.ends_with("(no setting explains what differs)\n"));
    std::fs::write(csv, "5.0,client,AA 5").unwrap();
    run(&["tap", "--csv", csv, "--trace", trace])
        .expect_refusal(2, &["capture.csv", "line 1", "hexadecimal"]);
    let tap = |paths: &[&str]| {
        let ends = paths.iter().flat_map(|_| ["--pty", "x"]);
        let args = ["tap", "--trace", trace].into_iter().chain(ends);
        run(&args.chain(paths.iter().copied()).collect::<Vec<_>>())
    };
    tap(&["/dev/null/no"]).expect_refusal(3, &["cannot open /dev/null/no"]);
    tap(&["/dev/no", "/dev/none"]).expect_refusal(2, &["has one link, not 2"]);
    tap(&["/dev/no", "/dev/no"]).expect_refusal(2, &["the same DEVICE is named twice"]);
}

/// Passes on a byte as simply as can be: the least that any relay adds.
fn relay(from: PathBuf, to: PathBuf) {
    use rustix::event::{PollFd, PollFlags, poll};
    let mut inner = serialport::new(from.to_string_lossy(), 115_200)
        .open_native()
        .unwrap();
    let outer = rigsim_pty::open_terminal(&PtySetup::raw(115_200)).unwrap();
    std::os::unix::fs::symlink(&outer.1, &to).unwrap();
    std::thread::spawn(move || {
        use std::os::fd::AsFd as _;
        // Kept open, so that it does not hang up before the client comes.
        let _slave = std::fs::File::open(&outer.1).unwrap();
        let fd = std::os::fd::AsRawFd::as_raw_fd(&inner);
        let read_end = std::fs::File::open(format!("/proc/self/fd/{fd}")).unwrap();
        let mut buf = [0; 4096];
        loop {
            let mut fds = [
                PollFd::from_borrowed_fd(read_end.as_fd(), PollFlags::IN),
                PollFd::new(&outer.0, PollFlags::IN),
            ];
            poll(&mut fds, None).unwrap();
            let ready = [0, 1].map(|at| fds[at].revents().contains(PollFlags::IN));
            if ready[0] {
                let n = inner.read(&mut buf).unwrap();
                rustix::io::write(&outer.0, &buf[..n]).unwrap();
            }
            if ready[1]
                && let Ok(n) = rustix::io::read(&outer.0, &mut buf)
            {
                inner.write_all(&buf[..n]).unwrap();
            }
        }
    });
}

/// Prints how long a byte takes there and back: straight, through a bare relay, through the recorder.
#[test]
#[ignore = "measures; docs/performance.md has the figures"]
fn delay_beside_a_bare_relay() {
    let dir = tempfile::tempdir().unwrap();
    let echo = |name: &str| {
        let path = dir.path().join(name);
        let mut port = open_port(&path, PtySetup::raw(115_200)).unwrap();
        std::thread::spawn(move || {
            let mut waiter = Waiter::new().unwrap();
            waiter.add(0, &mut port).unwrap();
            let mut buf = [0; 64];
            loop {
                waiter.wait(None).unwrap();
                if let Event::Data(n) = port.read(&mut buf).unwrap() {
                    port.write(&buf[..n]).unwrap();
                }
            }
        });
        path
    };
    let straight = echo("straight");
    relay(echo("behind"), dir.path().join("relayed"));
    echo("vehicle");
    let tap = tap(&dir, &[]);
    let ways = [straight, dir.path().join("relayed"), tap.port().to_owned()];
    let mut clients = ways.map(|path| Client::try_open(&path, 115_200).unwrap());
    let mut times: [Vec<Duration>; 3] = Default::default();
    for client in &mut clients {
        serialport::SerialPort::set_timeout(client, PATIENCE).unwrap();
    }
    for _ in 0..20_000 {
        for (client, times) in clients.iter_mut().zip(&mut times) {
            let start = Instant::now();
            client.write_all(&[0x55]).unwrap();
            client.read_exact(&mut [0]).unwrap();
            times.push(start.elapsed());
        }
    }
    for (name, times) in ["straight", "bare relay", "sim tap"].iter().zip(&mut times) {
        times.sort();
        let part = |part: usize| times[times.len() * part / 1000];
        println!(
            "{name}: p50 {:?}, p99 {:?}, p99.9 {:?}",
            part(500),
            part(990),
            part(999)
        );
    }
}

/// A client that performs a manoeuvre of the plan, and its scenario.
const DRIVE: &str = r#"
schema = 1
title = "A drive"
good_client = "Performs a part of the plan."
limit = "40 s"
device = [{ kind = "r150" }]
"#;
const PERFORM: &str = r#"
import json, os, sys, time
port = os.environ.get("SIM_R150_PORT") or os.environ["SIM_MECANUM_PORT"]
port = os.open(port, os.O_RDWR | os.O_NOCTTY)
os.set_blocking(port, False)
for frame in next(one for one in json.load(open("plan.json")) if one["name"] == sys.argv[1])["frames"]:
    os.write(port, bytes.fromhex(frame["bytes"]))
    time.sleep(frame["wait_ms"] / 1e3)
    try:
        os.read(port, 4096)
    except BlockingIOError:
        pass
"#;
/// Settings that the manoeuvres below identify.
const TOLD: &str = "r150.reply,r150.version,r150.on_,r150.over_rate,r150.motor_reply";

/// Drives an R150 with these settings by a manoeuvre of its plan; returns the trace.
fn driven(folder: &Folder, manoeuvre: &str, seed: usize, settings: &[&str]) -> String {
    drive("r150", folder, manoeuvre, seed, settings)
}

/// The same of another device, which `drive.toml` has.
fn drive(device: &str, folder: &Folder, manoeuvre: &str, seed: usize, settings: &[&str]) -> String {
    let plan = ["fit", "--plan", "--json", "--device", device];
    let plan = folder.sim(&plan).expect_clean().out;
    std::fs::write(folder.file("plan.json"), plan).unwrap();
    let (seed, output) = (seed.to_string(), format!("drive-{seed}"));
    let mut args = vec![
        "run", "--time", "lockstep", "--seed", &seed, "--output", &output,
    ];
    args.extend(settings.iter().flat_map(|one| ["--set", one]));
    args.extend(["drive.toml", "--", "python3", "perform.py", manoeuvre]);
    folder.sim(&args).expect_clean();
    format!("{output}/drive.trace.jsonl")
}

fn settings(report: &str, verdict: &str) -> Vec<String> {
    let report: Value = serde_json::from_str(report).unwrap();
    let all = report["settings"].as_array().unwrap().clone();
    let some = all.iter().filter(|row| row["verdict"] == verdict);
    some.map(|row| row["key"].as_str().unwrap().to_owned())
        .collect()
}

#[test]
fn a_plan_is_for_the_settings_that_are_given() {
    let folder = Folder::with(&[("big.toml", "mecanum.byte_order = \"big\"\n")]);
    let plan = |more: &[&str]| {
        let plan = ["fit", "--plan", "--json", "--device", "mecanum"];
        folder.sim(&[&plan[..], more].concat()).expect_clean().out
    };
    let [usual, file, set] = [
        &[][..],
        &["--config", "big.toml"],
        &["--set", "mecanum.byte_order=big"],
    ]
    .map(plan);
    assert!(usual != file && file == set, "{file}");
}

#[test]
fn what_differs_is_found_and_explains_the_vehicle() {
    let folder = Folder::with(&[("drive.toml", DRIVE), ("perform.py", PERFORM)]);
    let changes = ["r150.version_order=major-low", "r150.reply_delay=4ms"];
    let trace = driven(&folder, "questions", 3, &changes);
    let trace = trace.as_str();
    let compare = ["compare", trace, "--only", TOLD, "--json"];
    let compared = folder.sim(&compare).expect_clean().out;
    let changed = ["r150.reply_delay", "r150.version_order"];
    assert_eq!(settings(&compared, "contradicted"), changed);
    let fit = ["fit", trace, "--only", TOLD, "--output", "vehicle.toml"];
    let fitted = folder.sim(&fit).expect_clean().out;
    assert!(fitted.trim_end().ends_with("(better)"), "{fitted}");
    let toml = folder.read("vehicle.toml");
    assert!(toml.contains("\nr150.reply_delay = \"4ms\"\n"), "{toml}");
    assert!(toml.contains("\nr150.version_order = \"major-low\"\n"));
    let again = ["--config", "vehicle.toml", "--report", "page.html"];
    let again = folder.sim(&[&compare[..], &again].concat()).expect_clean();
    assert_eq!(settings(&again.out, "contradicted"), [""; 0]);
    let supported = settings(&again.out, "supported");
    assert!(
        changed
            .iter()
            .all(|key| supported.iter().any(|one| one == key))
    );
    let page = folder.read("page.html");
    assert!(page.contains("system_info.voltage_48v"));
    // What the vehicle did is hidden by nothing.
    let figure = page.split("<figure>").nth(1).expect("there is a plot");
    let places = ["curve2", "curve1", "curve0"].map(|curve| figure.rfind(curve));
    assert!(places[0].is_some() && places.is_sorted(), "{figure}");
    // What is torn off at the end is left out; what is wrong elsewhere is named.
    let whole = folder.read(trace);
    let torn = ["compare", "torn.jsonl", "--only", "r150.over_rate"];
    let torn = [&torn[..], &["--set", changes[0]]].concat();
    std::fs::write(folder.file("torn.jsonl"), &whole[..whole.len() - 20]).unwrap();
    folder
        .sim(&torn)
        .expect_refusal(0, &["torn.jsonl", "the last one, is torn"]);
    std::fs::write(
        folder.file("torn.jsonl"),
        whole.clone() + &"\0".repeat(4096),
    )
    .unwrap();
    folder
        .sim(&torn)
        .expect_refusal(0, &["torn.jsonl", "the last one, is torn"]);
    let first = whole.lines().next().unwrap();
    std::fs::write(folder.file("none.jsonl"), first).unwrap();
    let none = folder.sim(&["compare", "none.jsonl"]);
    none.expect_refusal(2, &["0 bytes from the client, 0 from the vehicle"]);
    std::fs::write(folder.file("wrong.jsonl"), whole.replacen("\n", "\n{\n", 2)).unwrap();
    let refused = folder.sim(&["compare", "wrong.jsonl"]);
    refused.expect_refusal(2, &["wrong.jsonl", "line 2"]);
    // Of a recording machine that stalls all the time, nothing is left to judge by.
    let real = whole.lines().filter(|line| !line.contains("lockstep"));
    let mut stalls = real.collect::<Vec<_>>().join("\n");
    for second in 1..60 {
        let t = second * 1_000_000_000_u64;
        stalls += &format!("\n{{\"kind\":\"late\",\"t\":{t},\"by\":1000000000,\"stood\":0}}");
    }
    std::fs::write(folder.file("stalls.jsonl"), stalls).unwrap();
    let little = folder.sim(&["compare", "stalls.jsonl", "--only", "r150.over_rate"]);
    assert_eq!(little.code(), Some(3), "{}{}", little.out, little.err);
    assert!(little.out.contains("too little is left for a verdict"));
    let fit = ["fit", "stalls.jsonl", "--only", "r150.over_rate"];
    let little = folder.sim(&[&fit[..], &["--output", "little.toml"]].concat());
    assert_eq!(little.code(), Some(3), "{}{}", little.out, little.err);
    assert!(little.out.contains("too little is left for a verdict"));
    assert!(
        little.out.ends_with("(nothing is written)\n"),
        "{}",
        little.out
    );
    assert!(!folder.file("little.toml").exists());
    // Each part of --only has to be one.
    let refused = folder.sim(&["compare", trace, "--only", "r150.reply, r150.nosuch"]);
    refused.expect_refusal(2, &["--only", "`r150.nosuch`"]);
    // Its file is not a recording, and the page replaces nothing else.
    let refused = folder.sim(&["compare", "drive.toml"]);
    refused.expect_refusal(2, &["drive.toml", "no trace"]);
    let refused = folder.sim(&[&compare[..4], &["--report", "drive.toml"]].concat());
    refused.expect_refusal(2, &["drive.toml"]);
}

#[test]
fn nothing_is_contradicted_over_ten_drives_of_a_vehicle_as_assumed() {
    let folder = Folder::with(&[("drive.toml", DRIVE), ("perform.py", PERFORM)]);
    let plan = ["fit", "--plan", "--json", "--device", "r150"];
    let plan = folder.sim(&plan).expect_clean().out;
    let plan: Value = serde_json::from_str(&plan).unwrap();
    let manoeuvres = plan.as_array().unwrap().iter();
    let names = manoeuvres.map(|one| one["name"].as_str().unwrap());
    for (seed, manoeuvre) in (0..10).zip(names.cycle()) {
        let trace = driven(&folder, manoeuvre, seed, &[]);
        let report = ["compare", &trace, "--only", TOLD, "--json"];
        let report = folder.sim(&report).expect_clean().out;
        assert_eq!(
            settings(&report, "contradicted"),
            [""; 0],
            "{manoeuvre}, seed {seed}"
        );
        assert!(!settings(&report, "supported").is_empty());
        let report: Value = serde_json::from_str(&report).unwrap();
        assert_eq!(report["unexplained"], serde_json::json!([]));
        for row in report["commands"].as_array().unwrap() {
            assert_eq!(
                row["answered"][0], row["answered"][1],
                "{manoeuvre}, seed {seed}: {row}"
            );
        }
    }
}

#[test]
fn settings_of_a_car_are_found_in_what_it_sends_by_itself() {
    let folder = Folder::with(&[
        ("drive.toml", &DRIVE.replace("r150", "mecanum")),
        ("perform.py", PERFORM),
    ]);
    let changes = ["mecanum.status_seq=echo", "mecanum.heading_range=half-turn"];
    for changes in [&changes[..], &[]] {
        let trace = drive("mecanum", &folder, "coordinates", 3, changes);
        let only = "mecanum.status,mecanum.heading,mecanum.inter,mecanum.acknowledge";
        let fit = ["fit", &trace, "--only", only, "--output", "vehicle.toml"];
        folder.sim(&fit).expect_clean();
        let toml = folder.read("vehicle.toml");
        let mut found: Vec<&str> = toml
            .lines()
            .filter(|line| line.starts_with("mecanum."))
            .collect();
        found.sort_unstable();
        let expected = [
            "mecanum.heading_range = \"half-turn\"",
            "mecanum.status_seq = \"echo\"",
        ];
        assert_eq!(found, expected[..changes.len()], "{toml}");
    }
}

/// Where the vehicle of a drive was, as a file of poses with another clock and another place and direction.
fn poses(folder: &Folder, trace: &str) -> String {
    let (sin, cos) = 40_f64.to_radians().sin_cos();
    let mut text = "# of a test\nheading_deg, x_m, y_m, seconds\n".to_owned();
    let poses = records(&folder.file(trace));
    for record in poses.iter().filter(|record| record["kind"] == "pose") {
        let [t, x, y, heading] =
            ["t", "x", "y", "heading"].map(|key| record[key].as_f64().unwrap());
        let (x, y, heading) = (
            x * cos - y * sin - 7.0,
            x * sin + y * cos + 3.0,
            heading.to_degrees() + 40.0,
        );
        text += &format!(
            "{},{x},{y},{}\n",
            (heading + 180.0).rem_euclid(360.0) - 180.0,
            t / 1e9 + 1e6
        );
    }
    text
}

#[test]
fn poses_tell_what_the_vehicle_does_not_report() {
    let folder = Folder::with(&[("drive.toml", DRIVE), ("perform.py", PERFORM)]);
    let change = "r150.tyre.wheel_radius=0.23 m";
    let trace = driven(&folder, "turns on the spot and with one side", 5, &[change]);
    std::fs::write(folder.file("poses.csv"), poses(&folder, &trace)).unwrap();
    let only = "r150.tyre.wheel_radius,r150.body.track,r150.motor.ramp_up";
    let fit = ["fit", &trace, "--only", only, "--output", "vehicle.toml"];
    let at = ["--poses", "poses.csv", "--poses-offset=-1000000s"];
    folder.sim(&[&fit[..], &at].concat()).expect_clean();
    let toml = folder.read("vehicle.toml");
    let line = toml
        .lines()
        .find(|line| line.starts_with("r150."))
        .expect(&toml);
    let radius = line
        .strip_prefix("r150.tyre.wheel_radius = \"")
        .expect(&toml);
    let radius: f64 = radius.strip_suffix(" m\"").unwrap().parse().unwrap();
    assert!((radius - 0.23).abs() < 0.001, "{toml}");
    // The clock of the file is found, and what is left is equal.
    let compare = ["compare", &trace, "--only", only, "--poses", "poses.csv"];
    let more = ["--config", "vehicle.toml", "--report", "page.html"];
    let text = folder
        .sim(&[&compare[..], &more].concat())
        .expect_clean()
        .out;
    assert!(text.contains("poses: -1000000.00"), "{text}");
    assert!(text.contains("pose.heading"), "{text}");
    assert!(folder.read("page.html").contains("pose.speed"));
}

#[test]
fn what_is_wrong_with_poses_is_named() {
    let folder = Folder::with(&[("drive.toml", DRIVE), ("perform.py", PERFORM)]);
    let trace = driven(&folder, "questions", 5, &[]);
    let head = "seconds,x_m,y_m,heading_deg\n";
    for (text, why) in [
        (
            "seconds,x_m,y_m\n0,0,0\n".to_owned(),
            "no column is named `heading_deg`; commas stand between columns, and these are `seconds`, `x_m`, `y_m`",
        ),
        (
            format!("{head}0,0,0,0\n1,0,left,0\n"),
            "line 3, column y_m: `left` is not a number",
        ),
        (
            format!("{head}0,NaN,0,0\n"),
            "line 2, column x_m: `NaN` is not a number",
        ),
        (
            format!("{head}0,0,0,0\n1,0,0\n"),
            "line 3, column heading_deg: `` is not a number",
        ),
        (
            format!("{head}1,0,0,0\n1,0,0,0\n"),
            "line 3, column seconds: time goes back",
        ),
        (
            format!("{head}1,0,0,0\n9999,0,0,0\n"),
            "line 3, column seconds: more than an hour",
        ),
        (format!("{head}1,0,0,0\n"), "fewer than two poses"),
        (
            format!("{head}1,0,0,0\n2,0,0,0\n"),
            "do not move as the model does",
        ),
    ] {
        std::fs::write(folder.file("poses.csv"), text).unwrap();
        let compare = [
            "compare",
            &trace,
            "--only",
            "r150.over_rate",
            "--poses",
            "poses.csv",
        ];
        folder.sim(&compare).expect_refusal(2, &["poses.csv", why]);
    }
    std::fs::write(
        folder.file("poses.csv"),
        format!("{head}1,0,0,0\n2,0,0,0\n"),
    )
    .unwrap();
    for (offset, why) in [
        ("1h", "no pose is of the recording's"),
        ("soon", "--poses-offset"),
    ] {
        let compare = [
            "compare",
            &trace,
            "--poses",
            "poses.csv",
            "--poses-offset",
            offset,
        ];
        folder.sim(&compare).expect_refusal(2, &[why]);
    }
}

/// Drives of which at least one can be compared, unless a machine stalls all the time: `sim tap` notes when it
/// woke up late, late replies show by themselves, and the fit says how much is left.
const DRIVES: usize = 5;

#[test]
fn what_was_changed_is_found_through_pseudo_terminals_in_real_time() {
    let Some(python) = python() else { return };
    // Every reply shows both, so that a stall of the machine hides neither.
    let changes = ["r150.reply_command=high-bit", "r150.reply_delay=45ms"];
    let mut shares = Vec::new();
    for _ in 0..DRIVES {
        let dir = tempfile::tempdir().unwrap();
        let path = |name: &str| dir.path().join(name).to_str().unwrap().to_owned();
        std::fs::write(path("drive.toml"), "r150.over_rate = \"silent\"\n").unwrap();
        let args: Vec<&str> = changes.iter().flat_map(|one| ["--set", one]).collect();
        let vehicle = Sim::start_at(&dir.path().join("vehicle"), &args);
        let tap = tap(&dir, &["--plan"]);
        let mut client = std::process::Command::new(python);
        client.arg(concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/docs/examples/identify.py"
        ));
        let sim = Path::new(command().get_program())
            .parent()
            .unwrap()
            .to_owned();
        let places = std::env::var_os("PATH").unwrap_or_default();
        let places = std::iter::once(sim).chain(std::env::split_paths(&places));
        client.env("PATH", std::env::join_paths(places).unwrap());
        client.args([
            "--yes",
            "--only",
            "questions",
            "--config",
            &path("drive.toml"),
        ]);
        let driven = client.arg(tap.port()).output().unwrap();
        assert!(driven.status.success(), "{driven:?}");
        let printed = tap.stop().expect_clean().out;
        // A machine that stalls may have taken too long for it.
        let is_done = printed.contains("done: questions [manoeuvre_done]");
        assert!(is_done || printed.contains("questions took"), "{printed}");
        let last = printed.lines().last().unwrap();
        let missing = last.strip_prefix("missing of the plan: ").expect(last);
        assert_eq!(missing.contains("questions"), !is_done, "{printed}");
        vehicle.stop().expect_clean();
        let (trace, output) = (path("drive.jsonl"), path("vehicle.toml"));
        let fit = ["fit", &trace, "--only", TOLD, "--output", &output, "--json"];
        let fitted = run(&fit);
        let report: Value = serde_json::from_str(&fitted.out).unwrap();
        let used = report["used"].as_f64().unwrap();
        shares.push(used);
        if used < 0.5 {
            assert_eq!(fitted.code(), Some(3), "{}", fitted.err);
            continue;
        }
        fitted.expect_clean();
        let toml = std::fs::read_to_string(output).unwrap();
        let written = toml.lines().filter(|line| line.starts_with("r150."));
        let keys: Vec<&str> = written
            .clone()
            .filter_map(|line| line.split(' ').next())
            .collect();
        for key in &keys {
            let is_changed = changes
                .iter()
                .any(|one| one.starts_with(&format!("{key}=")));
            assert!(is_changed, "{key} was not changed\n{toml}");
        }
        assert_eq!(keys.len(), changes.len(), "{toml}");
        assert!(
            toml.contains("\nr150.reply_command = \"high-bit\"\n"),
            "{toml}"
        );
        let delay = report["settings"].as_array().unwrap().iter();
        let mut delay = delay.filter(|row| row["key"] == "r150.reply_delay");
        let delay = 1e3 * delay.next().unwrap()["number"][0].as_f64().unwrap();
        // 5 %, and what a computer adds until a client's byte is read.
        assert!((42.0..50.0).contains(&delay), "{delay} ms\n{toml}");
        return;
    }
    panic!("this machine stalled in each drive; used: {shares:?}");
}
