//! Rig files: several devices of both kinds in one world and one process, each with its client.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::path::{Path, PathBuf};
use std::sync::Barrier;
use std::thread;
use std::time::{Duration, Instant};

use harness::car::{FORWARD, MainClient, RosClient, motion};
use harness::client::Client;
use harness::wire::{i16_at, motors};
use harness::{PATIENCE, Sim, command, run};
use serde_json::Value;
use tempfile::TempDir;

/// The folder of the shipped worlds and rigs.
fn worlds() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("worlds")
}

/// Serves a rig, and waits until clients can connect.
fn serve(dir: TempDir, rig: &str, args: &[&str]) -> Sim {
    let path = dir.path().join("rig.toml");
    std::fs::write(&path, rig).unwrap();
    let mut command = command();
    command.arg("--rig").arg(&path).args(["--seed", "1"]);
    let sim = Sim::spawn(command.args(args), dir.path().to_owned(), Some(dir));
    sim.wait_ready();
    sim
}

/// Drives until the wheels turn as fast as they are to, for a second and a half at least;
/// says what speed that was.
fn drive_r150(path: &Path, duty: i16, started: &Barrier) -> i16 {
    let mut client = Client::open(path);
    assert_eq!(client.ask(0xF0, &[]).len(), 8);
    started.wait();
    let start = Instant::now();
    let mut rpm = 0;
    while start.elapsed() < Duration::from_millis(1500) || (rpm - duty).abs() > duty.abs() {
        assert!(start.elapsed() < PATIENCE, "{rpm} rpm at {duty}");
        client.send(&motors(duty, duty));
        // A command that comes too soon for a reply, since the machine is busy, gets none.
        if let Some((0x12, reply)) = client.receive_within(Duration::from_millis(100)) {
            rpm = i16_at(&reply, 0);
        }
        thread::sleep(Duration::from_millis(60));
    }
    client.send(&motors(0, 0));
    rpm
}

#[test]
fn two_of_each_kind_serve_six_clients_at_once() {
    // The shipped example, with its ports where no other test looks.
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let paths = [
        "r150-1",
        "r150-2",
        "car-1",
        "car-1-ros",
        "car-2",
        "car-2-ros",
    ]
    .map(at);
    let rig = std::fs::read_to_string(worlds().join("two-and-two.toml")).unwrap();
    let rig = rig
        .replace("/tmp/", &format!("{}/", dir.path().display()))
        .replace("yard.toml", worlds().join("yard.toml").to_str().unwrap());
    let sim = serve(dir, &rig, &["--log-format", "json"]);
    assert!(paths.iter().all(|path| path.exists()));

    let [r150_1, r150_2, car_1, car_1_ros, car_2, car_2_ros] = &paths;
    // None moves before all are there.
    let started = &Barrier::new(6);
    thread::scope(|scope| {
        let first = scope.spawn(move || drive_r150(r150_1, 500, started));
        let second = scope.spawn(move || drive_r150(r150_2, -300, started));
        let ahead = scope.spawn(move || {
            let mut client = MainClient::open(car_1);
            client.status();
            started.wait();
            client.send(&motion(FORWARD, 20, 400));
            client.finish()
        });
        let watching = scope.spawn(move || {
            let mut client = RosClient::open(car_1_ros);
            started.wait();
            until_mileage(&mut client, 200)
        });
        let aside = scope.spawn(move || {
            let mut client = MainClient::open(car_2);
            client.status();
            started.wait();
            client.finish()
        });
        let ordering = scope.spawn(move || {
            let mut client = RosClient::open(car_2_ros);
            started.wait();
            client.send("Y-10 \n");
            until_mileage(&mut client, 100)
        });
        // Each client has moved its own device, and no other.
        let (first, second) = (first.join().unwrap(), second.join().unwrap());
        assert!(first > 400 && second < -200, "{first} and {second} rpm");
        let (ahead, aside) = (ahead.join().unwrap(), aside.join().unwrap());
        assert!((20..=22).contains(&ahead.axis[0]), "{ahead:?}");
        assert!(ahead.axis[1].abs() <= 1, "{ahead:?}");
        assert!((-12..=-10).contains(&aside.axis[1]), "{aside:?}");
        assert!(aside.axis[0].abs() <= 1, "{aside:?}");
        assert!((200..=205).contains(&watching.join().unwrap()));
        assert!((100..=105).contains(&ordering.join().unwrap()));
    });

    let summary = sim.stop().expect_clean().json().pop().unwrap();
    let devices = summary["devices"].as_array().unwrap();
    let names: Vec<&str> = devices
        .iter()
        .map(|d| d["device"].as_str().unwrap())
        .collect();
    assert_eq!(names, ["r150-1", "r150-2", "mecanum-1", "mecanum-2"]);
    let driven = |index: usize| devices[index]["distance_m"].as_f64().unwrap();
    // Half and a third of 1.4 m/s for at least a second and a half, less the time to speed up.
    assert!(driven(0) > 0.7 && driven(1) > 0.4, "{summary}");
    // Two revolutions ahead are 0.63 m; one aside is 0.31 m, of which rollers lose some.
    assert!((0.60..0.68).contains(&driven(2)), "{summary}");
    assert!((0.22..0.32).contains(&driven(3)), "{summary}");
    for device in devices {
        let codes: Vec<&Value> = device["events"]
            .as_array()
            .unwrap()
            .iter()
            .map(|e| &e["code"])
            .collect();
        for garbled in ["bad_crc", "noise", "bad_line", "partial_packet"] {
            assert!(!codes.iter().any(|code| *code == garbled), "{device}");
        }
    }
}

/// Waits until this many hundredths of a revolution are reported and the car stands.
fn until_mileage(client: &mut RosClient, enough: i64) -> i64 {
    let start = Instant::now();
    loop {
        let (speed, mileage) = client.report();
        if speed == 0 && mileage >= enough {
            return mileage;
        }
        assert!(start.elapsed() < PATIENCE, "V{speed} S{mileage}");
    }
}

#[test]
fn devices_in_one_world_see_one_another() {
    let dir = tempfile::tempdir().unwrap();
    let paths = ["car", "r150"].map(|name| dir.path().join(name));
    let rig = "schema = 1\n\
        [[device]]\nkind = \"mecanum\"\nport = \"car\"\n\
        [[device]]\nkind = \"r150\"\nport = \"r150\"\npose = { x = \"3 m\" }\n";
    let sim = serve(dir, rig, &[]);
    let mut car = MainClient::open(&paths[0]);
    let ahead = |car: &mut MainClient| car.status().ut_f[1];
    let before = ahead(&mut car);
    assert!((1000..3000).contains(&before), "{before} mm to the R150");

    let mut r150 = Client::open(&paths[1]);
    let start = Instant::now();
    let mut now = before;
    while now < before + 500 {
        assert!(start.elapsed() < PATIENCE, "{now} mm after {before} mm");
        r150.send(&motors(500, 500));
        now = ahead(&mut car);
    }
    drop((car, r150));
    sim.stop().expect_clean();
}

#[test]
fn wrong_rigs_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("my-rig.toml");
    let shown = path.to_str().unwrap();
    let one = "schema = 1\n[[device]]\nkind = \"r150\"\nport = \"never-made\"\n";
    for (text, place, says) in [
        ("schema = 3\n", "1:10", "`schema`"),
        (
            "schema = 1\n[[device]]\nkind = \"boat\"\n",
            "3:8",
            "`device.kind`",
        ),
        (
            &format!("{one}colour = \"red\"\n"),
            "5:1",
            "`device.colour`",
        ),
        (
            &format!("{one}pose = {{ x = \"1 V\" }}\n"),
            "5:14",
            "`device.pose.x`",
        ),
        (
            &format!("{one}settings = {{ heartbeat_timeout = \"5h\" }}\n"),
            "5:34",
            "`r150.heartbeat_timeout`",
        ),
        (
            &format!("{one}ros_port = \"never-made-2\"\n"),
            "5:12",
            "`device.ros_port`",
        ),
        (&format!("{one}[[device\n"), "5:", ""),
    ] {
        std::fs::write(&path, text).unwrap();
        run(&["--rig", shown]).expect_refusal(2, &[&format!("{shown}:{place}"), says]);
    }

    // A world is looked for beside the rig, and its errors name it, not the rig.
    std::fs::write(&path, format!("world = \"my-world.toml\"\n{one}")).unwrap();
    let world = dir.path().join("my-world.toml");
    let refusal = || run(&["--rig", shown]);
    refusal().expect_refusal(2, &["cannot read the world file", world.to_str().unwrap()]);
    std::fs::write(&world, "schema = 1\n[[box]]\nat_m = [1]\n").unwrap();
    let place = format!("{}:3:8: `box.at_m`", world.display());
    refusal().expect_refusal(2, &[&place, "2 values are wanted, 1 given"]);

    run(&["--rig", "/nowhere/rig.toml"]).expect_refusal(2, &["the rig file /nowhere/rig.toml"]);
    run(&["--rig", shown, "--pty", "/tmp/never-made"]).expect_refusal(2, &["cannot be used with"]);
    assert!(!dir.path().join("never-made").exists());
}
