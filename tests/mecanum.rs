//! The mecanum car as its users have it: the real binary, both of its links, and a world.
#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::panic,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

mod harness;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use harness::car::{FORWARD, MainClient, RosClient, STRAFE, motion};
use harness::{Sim, command, run, with_code};

/// A shipped world.
fn world(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("worlds")
        .join(name)
}

/// A car with its main link, and with its ROS link at the second path if that is wanted.
fn car(ros: bool, args: &[&str]) -> (Sim, PathBuf) {
    let dir = tempfile::tempdir().unwrap();
    let (main_path, ros_path) = (dir.path().join("car"), dir.path().join("car-ros"));
    let mut command = command();
    command.args(["--device", "mecanum", "--seed", "1", "--pty"]);
    command.arg(&main_path).args(args);
    if ros {
        command.arg("--ros-pty").arg(&ros_path);
    }
    let sim = Sim::spawn(&mut command, main_path, Some(dir));
    sim.wait_ready();
    (sim, ros_path)
}

#[test]
fn status_packets_come_ten_times_a_second_and_decode() {
    let (sim, _) = car(false, &["-v", "--log-format", "json"]);
    let start = Instant::now();
    let mut client = MainClient::open(sim.port());
    let first = client.status();
    assert_eq!((first.axis, first.ori, first.v), ([0, 0], 0, [0, 0]));
    assert_eq!((first.rfid, first.magn, first.infra), (0, 0, 0));
    assert_eq!((first.moto_state, first.mile), (0, 0));
    // No echo in an empty field.
    assert_eq!((first.ut_f, first.ut_b), ([4500; 4], [4500; 4]));
    for count in 1..=30 {
        assert_eq!(client.status().seq, first.seq.wrapping_add(count));
    }
    // Thirty periods, less what the simulator may have been late with the first.
    assert!(start.elapsed() > Duration::from_millis(2700));
    drop(client);

    // In simulated time the period is exact, whatever the machine does.
    let log = sim.stop().expect_clean().json();
    let times: Vec<f64> = with_code(&log, "reply")
        .iter()
        .map(|reply| reply["time_s"].as_f64().unwrap())
        .collect();
    assert!(times.len() >= 31, "{times:?}");
    for pair in times.windows(2) {
        assert!((pair[1] - pair[0] - 0.1).abs() < 1e-6, "{pair:?}");
    }
}

#[test]
fn both_links_drive_a_square_that_ends_where_it_began() {
    let yard = world("yard.toml");
    // Nothing here depends on how soon the client is, so four times as fast is as good.
    let fast = ["--world", yard.to_str().unwrap(), "--speed", "4"];
    let (sim, ros_path) = car(true, &fast);
    let mut main = MainClient::open(sim.port());
    let mut ros = RosClient::open(&ros_path);
    // Odometry in 1/10 revolution; a wheel runs on for a pulse or two, which is 1/60 each.
    let check = |axis: [i16; 2], corner: [i16; 2]| {
        let near = (0..2).all(|at| (axis[at] - corner[at]).abs() <= 2);
        assert!(near, "at {axis:?}, not {corner:?}");
    };

    let corners = [[20, 0], [20, 20], [0, 20], [0, 0]];
    let sides = [
        (FORWARD, 400),
        (STRAFE, 400),
        (FORWARD, -400),
        (STRAFE, -400),
    ];
    for ((moving_idx, v), corner) in sides.into_iter().zip(corners) {
        main.send(&motion(moving_idx, 20, v));
        let status = main.finish();
        check(status.axis, corner);
        assert!(status.ori.abs() <= 20, "{status:?}");
    }
    for (line, corner) in ["X20 \n", "Y20 \n", "X-20 \n", "Y-20 \n"]
        .into_iter()
        .zip(corners)
    {
        ros.send(line);
        check(main.finish().axis, corner);
    }
    drop((main, ros));
    let finished = sim.stop().expect_clean();
    assert!(
        finished
            .out
            .contains("the client did nothing that the protocol forbids"),
        "{}",
        finished.out
    );
}

#[test]
fn ten_tenths_turn_each_wheel_once_and_report_lines_follow() {
    let (sim, ros_path) = car(true, &[]);
    let mut main = MainClient::open(sim.port());
    let mut ros = RosClient::open(&ros_path);
    assert_eq!(ros.report(), (0, 0));
    ros.send("X10 \n");
    let status = main.finish();
    // Straight ahead and not turned: the four wheels have turned alike.
    assert!((10..=11).contains(&status.axis[0]), "{status:?}");
    assert_eq!((status.axis[1], status.ori), (0, 0), "{status:?}");
    // One revolution of a wheel of 50 mm.
    assert!((314..=330).contains(&status.mile), "{status:?}");

    // 30 r/min are half a revolution a second; at the end it stands. The reports have waited.
    let mut reports = vec![ros.report()];
    while !matches!(reports.last(), Some((0, 100..))) {
        reports.push(ros.report());
    }
    assert!(reports.iter().any(|report| report.0 == 50), "{reports:?}");
    assert!(reports.is_sorted_by_key(|report| report.1), "{reports:?}");
    let mileage = reports.last().unwrap().1;
    assert!((100..=103).contains(&mileage), "{reports:?}");
    drop((main, ros));
    sim.stop().expect_clean();
}

#[test]
fn the_magnetic_sensor_is_off_while_the_ros_link_has_its_uart() {
    let line = world("line-loop.toml");
    for ros in [false, true] {
        let (sim, _) = car(ros, &["--world", line.to_str().unwrap()]);
        let magn = MainClient::open(sim.port()).status().magn;
        // It stands on the strip, with the channels in the middle above it.
        let middle = 0b0000_0011_1100_0000;
        assert_eq!(magn & middle, if ros { 0 } else { middle });
        assert_eq!(magn == 0, ros, "{magn:#018b}");
        sim.stop().expect_clean();
    }
}

#[test]
fn what_is_no_packet_and_no_line_is_reported_and_skipped() {
    let (sim, ros_path) = car(true, &["--log-format", "json"]);
    let mut main = MainClient::open(sim.port());
    let mut ros = RosClient::open(&ros_path);
    main.send(
        &[
            &[0x7F, 0x00, 0x13][..],
            &motion(7, 5, 300),
            &motion(FORWARD, 5, 300),
        ]
        .concat(),
    );
    main.finish();
    ros.send("forward!\nX40000\nX5 \n");
    main.finish();
    for (code, part) in [
        ("noise", "7F 00 13"),
        ("bad_moving_idx", "0 to 4"),
        ("bad_line", "forward!"),
        ("bad_number", "X40000"),
    ] {
        let event = sim.wait_event(code);
        assert!(event["text"].as_str().unwrap().contains(part), "{event}");
    }
    assert!(
        (10..=12).contains(&main.status().axis[0]),
        "both good ones ran"
    );
    sim.stop().expect_clean();
}

#[test]
fn wrong_worlds_and_flags_are_refused_by_name() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("my-world.toml");
    let shown = path.to_str().unwrap();
    let at = |place: &str| format!("{shown}:{place}: ");
    let device = ["--device", "mecanum", "--pty", "/tmp/never-made", "--world"];
    for (text, place, says) in [
        ("schema = 2\n", "1:10", ["`schema`", "from 1 to 1"]),
        (
            "schema = 1\n[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"5\"\n",
            "4:13",
            ["`wall.thickness`", "lacks a unit"],
        ),
        (
            "schema = 1\n[[wall]]\npoints_m = [[0, 0], [1, 0]]\nthickness = \"5 V\"\n",
            "4:13",
            ["`wall.thickness`", "in m from 0.001 to 10000"],
        ),
        (
            "schema = 1\n[[tag]]\nat_m = [1, 2]\nnumbr = 4\n",
            "4:1",
            ["`tag.numbr`", "unknown key"],
        ),
        ("schema = 1\n[[tag\n", "2:6", ["", ""]),
    ] {
        std::fs::write(&path, text).unwrap();
        let refused = run(&[&device[..], &[shown]].concat());
        refused.expect_refusal(2, &[&at(place), says[0], says[1]]);
    }
    let refused = run(&[&device[..], &["/nowhere/world.toml"]].concat());
    refused.expect_refusal(2, &["cannot read the world file /nowhere/world.toml"]);
    let no_car = run(&["--pty", "/tmp/never-made", "--ros-pty", "/tmp/never-made-2"]);
    no_car.expect_refusal(2, &["--ros-pty", "--device mecanum"]);
    assert!(!Path::new("/tmp/never-made").exists());
}

#[test]
fn schemas_of_the_files_are_printed_as_shipped() {
    for kind in ["world", "rig"] {
        let printed = run(&["schema", kind]).expect_clean().out;
        let shipped = std::fs::read_to_string(world(&format!("{kind}.schema.json"))).unwrap();
        assert!(printed == shipped, "{kind}: ./regenerate");
    }
    run(&["schema", "house"]).expect_refusal(2, &["house", "world, rig"]);
}
