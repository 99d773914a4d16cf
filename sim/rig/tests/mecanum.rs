//! The mecanum car in the rig: firmware, line, hardware and world together.

use rigsim_physics::Plant as _;
use std::time::Duration;

use rigsim_physics::faults::{BodyFaults, MotorFaults};
use rigsim_physics::mecanum::Wheel;
use rigsim_physics::r150::Load;
use rigsim_physics::world::Obstacle;

use super::*;
use crate::mecanum::{Mecanum, MecanumSettings};
use crate::mecanum_device::codec;
use crate::mecanum_device::packet::{Request as Packet, Status};
use crate::mecanum_device::settings::{ByteOrder, IdleWheels};
use crate::scanner::Decoded;

const MAIN: PortId = PortId { device: 0, link: 0 };
const ROS: PortId = PortId { device: 0, link: 1 };

fn car_in(map: WorldMap, ros: bool, change: impl FnOnce(&mut MecanumSettings)) -> Rig {
    let world = WorldSettings::default();
    let mut rig = Rig::new(RigSettings {
        world,
        map,
        wire: Wire::Bare,
        seed: 1,
    });
    let mut settings = MecanumSettings::default();
    change(&mut settings);
    let setup = Setup {
        links: if ros { 2 } else { 1 },
        ..Setup::new("car", &settings)
    };
    rig.add(&crate::mecanum::MECANUM_SPEC, &setup);
    rig.attach(MAIN, SimTime::ZERO).unwrap();
    rig.attach(ROS, SimTime::ZERO).unwrap();
    rig
}

fn car(ros: bool) -> Rig {
    car_in(WorldMap::default(), ros, |_| {})
}

fn motion(moving_idx: u8, s: u16, v: i16) -> Vec<u8> {
    Packet::Motion {
        seq: 0,
        is_reset: 1,
        moving_idx,
        s,
        v,
    }
    .encode()
}

/// Advances and reads so that the line never fills.
fn run(rig: &mut Rig, port: PortId, span: Duration) -> Vec<u8> {
    let end = rig.now() + span;
    let mut bytes = Vec::new();
    while rig.now() < end {
        let next = (rig.now() + Duration::from_millis(50)).min(end);
        rig.advance(next).unwrap();
        rig.client_reads(port, &mut bytes);
    }
    bytes
}

fn statuses(bytes: &[u8]) -> Vec<Status> {
    let mut decoder = codec::decoder::<Status>(Duration::from_secs(1));
    let mut found = Vec::new();
    for &byte in bytes {
        for decoded in decoder.push(SimTime::ZERO, byte) {
            match decoded {
                Decoded::Frame(packet) => {
                    found.extend(codec::parse::<Status>(&packet, ByteOrder::Little))
                }
                other => panic!("{other:?}"),
            }
        }
    }
    found
}

#[test]
fn status_packets_come_ten_times_a_second_and_number_themselves() {
    let mut rig = car(false);
    let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(30)));
    assert!((299..=300).contains(&seen.len()), "{}", seen.len());
    for (index, status) in seen.iter().enumerate() {
        assert_eq!(
            usize::from(status.seq),
            (usize::from(seen[0].seq) + index) % 256
        );
    }
}

#[test]
fn ten_tenths_forward_turn_each_wheel_once_on_either_link() {
    for ros in [false, true] {
        let mut rig = car(ros);
        if ros {
            rig.client_sends(ROS, SimTime::from_millis(5), b"X10 \n")
                .unwrap();
        } else {
            rig.client_sends(MAIN, SimTime::from_millis(5), &motion(0, 10, 300))
                .unwrap();
        }
        let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(5)));
        let circumference = std::f64::consts::TAU * 0.05;
        let truth = rig.device::<Mecanum>(0).unwrap().truth();
        assert!(
            (truth.motion.pose.x / circumference - 1.0).abs() < 0.05,
            "{truth:?}"
        );
        let last = seen.last().unwrap();
        assert!((10..=11).contains(&last.axis_x), "{last:?}");
    }
}

#[test]
fn a_tall_load_that_would_tip_it_is_reported_of_once() {
    for (height, reported) in [(0.2, 0), (0.6, 1)] {
        let mut rig = car_in(WorldMap::default(), false, |settings| {
            settings.plant.body.payload_height = height;
        });
        load(&mut rig, 8.0);
        let now = rig.now();
        // It is held at the end of its way.
        rig.client_sends(MAIN, now, &motion(0, 10, 500)).unwrap();
        run(&mut rig, MAIN, Duration::from_secs(3));
        let events = std::iter::from_fn(|| rig.poll_event());
        let tipping = events.filter(|event| event.kind.code().name == "tipping");
        assert_eq!(tipping.count(), reported, "{height}");
    }
}

/// What is asked of a car that rested acts from then on, whichever other vehicle was woken in that step.
#[test]
fn a_car_that_rests_beside_one_that_wakes_drives_like_one_that_is_alone() {
    let drive = |with_neighbour: bool| {
        let mut rig = car(false);
        let away = Pose {
            y: 5.0,
            ..Pose::default()
        };
        let settings = MecanumSettings::default();
        let setup = Setup {
            pose: away,
            ..Setup::new("neighbour", &settings)
        };
        rig.add(&crate::mecanum::MECANUM_SPEC, &setup);
        let neighbour = PortId { device: 1, link: 0 };
        rig.attach(neighbour, SimTime::ZERO).unwrap();
        if with_neighbour {
            let at = SimTime::from_micros(1_050_000);
            rig.client_sends(neighbour, at, &motion(0, 10, 300))
                .unwrap();
        }
        let at = SimTime::from_micros(1_050_500);
        rig.client_sends(MAIN, at, &motion(0, 10, 300)).unwrap();
        let mut course = Vec::new();
        for _ in 0..40 {
            run(&mut rig, MAIN, Duration::from_millis(50));
            course.push(rig.motion(0).unwrap());
        }
        course
    };
    let alone = drive(false);
    assert!(alone.last().unwrap().pose.x > 0.2);
    assert_eq!(drive(true), alone);
}

/// 17 million pulses a second would take the simulator minutes for one.
#[test]
fn pulses_without_number_are_taken_together() {
    let mut rig = car_in(WorldMap::default(), false, |settings| {
        let motor = &mut settings.plant.motor;
        (motor.full_speed, motor.ramp_time) = (10_000.0, Duration::from_millis(1));
        (motor.torque_limit, motor.speed_gain) = (1000.0, 100.0);
        settings.plant.encoder.pulses_per_revolution = 100_000;
    });
    let now = rig.now();
    rig.client_sends(MAIN, now, &motion(0, 65_535, 500))
        .unwrap();
    let pulses = |rig: &Rig| {
        rig.device::<Mecanum>(0)
            .unwrap()
            .plant
            .measurements()
            .pulses[0]
    };
    let (mut rounds, before) = (0, pulses(&rig));
    let end = rig.now() + Duration::from_millis(100);
    while let Some(due) = rig.next_deadline().filter(|due| *due < end) {
        rig.advance(due).unwrap();
        rounds += 1;
    }
    let came = pulses(&rig).wrapping_sub(before);
    assert!(
        came > 100_000 && rounds < 11_000,
        "{came} pulses in {rounds} rounds"
    );
}

#[test]
fn the_ros_link_may_have_another_speed_and_another_stop_bit() {
    let between_bytes = |change: fn(&mut MecanumSettings)| {
        let mut rig = car_in(WorldMap::default(), true, change);
        let now = rig.now();
        rig.client_sends(MAIN, now, &motion(0, 10, 500)).unwrap();
        let mut times = Vec::new();
        while times.len() < 2 {
            let next = [rig.next_deadline(), rig.next_for_client(ROS)];
            rig.advance(next.into_iter().flatten().min().unwrap())
                .unwrap();
            let mut bytes = Vec::new();
            rig.client_reads(ROS, &mut bytes);
            times.extend(bytes.iter().map(|_| rig.now()));
            read(&mut rig);
        }
        times[1].since(times[0]).as_nanos()
    };
    let bits = |count: u128, baud: u128| (count * 1_000_000_000).div_ceil(baud);
    for (change, wanted) in [
        ((|_| {}) as fn(&mut MecanumSettings), bits(10, 9600)),
        (|s| s.firmware.ros_baud = 19_200, bits(10, 19_200)),
    ] {
        let seen = between_bytes(change);
        assert!(seen.abs_diff(wanted) <= 1, "{seen} ns, not {wanted}");
    }
}

#[test]
fn report_lines_follow_on_the_ros_link() {
    let mut rig = car(true);
    rig.client_sends(ROS, SimTime::from_millis(5), b"X10 \n")
        .unwrap();
    let text = String::from_utf8(run(&mut rig, ROS, Duration::from_secs(4))).unwrap();
    // The last line may still be on its way.
    let whole = &text[..=text.rfind('\n').unwrap()];
    let lines: Vec<&str> = whole.lines().collect();
    assert!((39..=40).contains(&lines.len()), "{lines:?}");
    assert!(lines.iter().any(|line| line.starts_with("V50 S")), "{text}");
    assert!(lines.last().unwrap().starts_with("V0 S100"), "{text}");
}

/// Forward, strafe left, back, strafe right by one revolution each.
#[test]
fn a_square_ends_near_where_it_began() {
    let mut rig = car(false);
    for (moving_idx, v) in [(0, 300), (2, 300), (0, -300), (2, -300)] {
        let now = rig.now();
        rig.client_sends(MAIN, now, &motion(moving_idx, 20, v))
            .unwrap();
        run(&mut rig, MAIN, Duration::from_secs(6));
    }
    let truth = rig.device::<Mecanum>(0).unwrap().truth();
    assert!(truth.motion.distance > 1.0, "{truth:?}");
    assert!(
        truth.motion.pose.x.hypot(truth.motion.pose.y) < 0.05,
        "{truth:?}"
    );
}

#[test]
fn a_strafe_is_shorter_than_odometry_says() {
    let mut rig = car(false);
    rig.client_sends(MAIN, SimTime::ZERO, &motion(2, 50, 300))
        .unwrap();
    let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(14)));
    let truth = rig.device::<Mecanum>(0).unwrap().truth();
    let odometry = f64::from(seen.last().unwrap().axis_y) / 10.0 * std::f64::consts::TAU * 0.05;
    let delivered = truth.motion.pose.y / odometry;
    assert!((0.80..=0.92).contains(&delivered), "{delivered}");
}

#[test]
fn a_blocked_wheel_keeps_the_motion_running_and_pulls_the_car_off_line() {
    let mut rig = car(false);
    rig.with_device(0, |car: &mut Mecanum, _, _| {
        let faults = MotorFaults {
            blocked: true,
            ..MotorFaults::default()
        };
        car.plant.set_wheel_faults(Wheel::LeftFront, faults);
    });
    let now = rig.now();
    rig.client_sends(MAIN, now, &motion(0, 30, 300)).unwrap();
    run(&mut rig, MAIN, Duration::from_secs(8));
    let car = rig.device::<Mecanum>(0).unwrap();
    let truth = car.truth();
    assert!(
        truth.motion.pose.heading.abs() > 0.1 || truth.motion.pose.y.abs() > 0.05,
        "{truth:?}"
    );
    assert!(
        car.device.running().is_some(),
        "its wheel has not turned far enough"
    );
}

#[test]
fn a_wall_ahead_is_seen_and_stops_the_car_while_odometry_runs_on() {
    let mut map = WorldMap::default();
    map.obstacles
        .add(Obstacle::wall([0.6, -2.0], [0.6, 2.0], 0.1))
        .unwrap();
    let mut rig = car_in(map, false, |_| {});
    let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(1)));
    assert!(
        seen.last().unwrap().ut_f.iter().any(|mm| *mm < 600),
        "{:?}",
        seen.last()
    );
    let now = rig.now();
    rig.client_sends(MAIN, now, &motion(0, 60, 300)).unwrap();
    let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(14)));
    let truth = rig.device::<Mecanum>(0).unwrap().truth();
    let odometry = f64::from(seen.last().unwrap().axis_x) / 10.0 * std::f64::consts::TAU * 0.05;
    assert!(truth.motion.pose.x < 0.45, "{truth:?}");
    assert!(odometry > truth.motion.pose.x + 0.1, "{odometry} {truth:?}");
    assert_eq!(seen.last().unwrap().infra, 1);
    assert!(
        rig.world()
            .collisions(rig.device::<Mecanum>(0).unwrap().plant.body())
            > 0
    );
}

#[test]
fn an_obstacle_that_comes_or_goes_is_in_the_next_packets_and_in_the_way() {
    let mut rig = car(false);
    run(&mut rig, MAIN, Duration::from_secs(5));
    let gate = Obstacle::wall([0.6, -2.0], [0.6, 2.0], 0.1).named("gate");
    rig.with_world(|world| world.add_obstacle(gate)).unwrap();
    let nearest = |rig: &mut Rig| {
        let seen = statuses(&run(rig, MAIN, Duration::from_secs(1)));
        seen.last().unwrap().ut_f.into_iter().min().unwrap()
    };
    let seen = nearest(&mut rig);
    assert!((379..=381).contains(&seen), "{seen}");
    let now = rig.now();
    rig.client_sends(MAIN, now, &motion(0, 60, 300)).unwrap();
    run(&mut rig, MAIN, Duration::from_secs(5));
    let leaning = rig.device::<Mecanum>(0).unwrap().truth().motion.pose.x;
    assert!(leaning < 0.4, "{leaning}");
    rig.with_world(|world| world.remove_obstacle("gate"))
        .unwrap();
    assert_eq!(nearest(&mut rig), 4500);
    let now = rig.now();
    rig.client_sends(MAIN, now, &motion(0, 20, 300)).unwrap();
    run(&mut rig, MAIN, Duration::from_secs(6));
    assert!(rig.device::<Mecanum>(0).unwrap().truth().motion.pose.x > leaning + 0.5);
}

/// Without a direction in the pulses the board takes a push back for a drive forward.
#[test]
fn a_car_that_is_pushed_back_believes_that_it_drove_forward() {
    let mut rig = car_in(WorldMap::default(), false, |settings| {
        settings.firmware.idle_wheels = IdleWheels::Release;
    });
    let mut faults = BodyFaults::default();
    faults.push.ahead = -30.0;
    rig.with_any_device(0, |car, world, _| {
        car.plant_mut().set_body_faults(world, &faults);
    });
    let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(1)));
    let truth =
        rig.device::<Mecanum>(0).unwrap().truth().motion.pose.x / (std::f64::consts::TAU * 0.05);
    assert!(truth < -1.0, "{truth}");
    let believed = f64::from(seen.last().unwrap().axis_x) / 10.0;
    // The last packet is a tenth of a second older than the truth.
    let share = believed / -truth;
    assert!((0.6..1.0).contains(&share), "{share}");
}

#[test]
fn the_magnetic_bar_reads_nothing_while_the_ros_link_has_its_uart() {
    for (ros, hit) in [(false, true), (true, false)] {
        let mut map = WorldMap::default();
        let points = vec![[-1.0, 0.0], [1.0, 0.0]];
        map.strips.push(rigsim_physics::world::Strip {
            points,
            ..Default::default()
        });
        let mut rig = car_in(map, ros, |_| {});
        let seen = statuses(&run(&mut rig, MAIN, Duration::from_secs(1)));
        assert_eq!(seen.last().unwrap().magn != 0, hit);
    }
}

#[test]
fn vehicles_of_both_kinds_share_a_world_and_collide() {
    let mut rig = car(false);
    let pose = Pose {
        x: 1.2,
        ..Pose::default()
    };
    let settings = R150Settings::default();
    let setup = Setup {
        pose,
        ..Setup::new("r150", &settings)
    };
    rig.add(&crate::r150::R150_SPEC, &setup);
    rig.with_device(1, |r150: &mut R150, _, _| {
        r150.plant
            .set_load(rigsim_physics::r150::Rail::V48, Load::Open);
    });
    rig.client_sends(MAIN, SimTime::ZERO, &motion(0, 100, 500))
        .unwrap();
    run(&mut rig, MAIN, Duration::from_secs(6));
    let car = rig.device::<Mecanum>(0).unwrap();
    assert!(rig.world().collisions(car.plant.body()) > 0);
    assert!(car.truth().motion.pose.x < 0.75, "the R150 is in the way");
}

/// Packets, torn packets, lines and noise for both links, with pauses before them.
fn inputs() -> impl Strategy<Value = Vec<(u64, PortId, Vec<u8>)>> {
    let packet = (any::<u8>(), 0u8..7, 0u16..40, any::<i16>()).prop_map(|(is_reset, idx, s, v)| {
        let request = Packet::Motion {
            seq: 0,
            is_reset,
            moving_idx: idx,
            s,
            v,
        };
        (MAIN, request.encode())
    });
    let line = ("[XYZABQ]", any::<i32>())
        .prop_map(|(letter, number)| (ROS, format!("{letter}{number} \n").into_bytes()));
    let noise = prop::collection::vec(any::<u8>(), 0..20);
    let noise =
        (any::<bool>(), noise).prop_map(|(ros, bytes)| (if ros { ROS } else { MAIN }, bytes));
    let sent = (0u64..300_000_000, prop_oneof![packet, line, noise]);
    prop::collection::vec(
        sent.prop_map(|(pause, (port, bytes))| (pause, port, bytes)),
        0..12,
    )
}

/// Everything that can be seen of a run.
fn transcript(inputs: &[(u64, PortId, Vec<u8>)]) -> String {
    let mut rig = car(true);
    let mut seen = [Vec::new(), Vec::new()];
    for (pause, port, bytes) in inputs {
        let at = rig.now() + Duration::from_nanos(*pause);
        rig.client_sends(*port, at, bytes).unwrap();
        for port in [MAIN, ROS] {
            rig.client_reads(port, &mut seen[port.link]);
        }
    }
    let end = rig.now() + Duration::from_secs(1);
    rig.advance(end).unwrap();
    let events: Vec<String> = std::iter::from_fn(|| rig.poll_event())
        .map(|event| format!("{} {}", event.at, event.kind))
        .collect();
    format!(
        "{seen:?}\n{events:#?}\n{:?}",
        rig.device::<Mecanum>(0).unwrap().truth()
    )
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(24))]

    #[test]
    fn the_same_bytes_on_both_links_give_the_same_run(inputs in inputs()) {
        prop_assert_eq!(transcript(&inputs), transcript(&inputs));
    }
}

#[test]
fn golden_car() {
    let mut rig = car(true);
    let mut output = Vec::new();
    for (moving_idx, v) in [(0, 450), (1, 200), (2, -300), (3, 300), (4, -500)] {
        let now = rig.now();
        rig.client_sends(MAIN, now, &motion(moving_idx, 12, v))
            .unwrap();
        output.extend(run(&mut rig, MAIN, Duration::from_secs(2)));
        rig.client_reads(ROS, &mut output);
    }
    let pose = rig.device::<Mecanum>(0).unwrap().truth().motion.pose;
    let seen = (
        output.len(),
        format!("{:.3} {:.3} {:.3}", pose.x, pose.y, pose.heading),
        digest(&output, pose),
    );
    let expected = (
        4858,
        "0.374 0.052 -0.994".to_owned(),
        6_767_885_603_098_037_021,
    );
    assert_eq!(
        seen, expected,
        "if the change is meant, say in the commit what moved it"
    );
}
