//! The figures of `docs/fidelity.md`, computed again, within what is known of them.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;
mod common;

use std::time::Duration;

use car::Car;
use common::{Bench, FRICTION};
use rigsim_physics::mecanum::MecanumFaults;
use rigsim_physics::r150::Sides;
use rigsim_physics::{
    BodyShape, Ground, Plant as _, Pose, R150Commands, R150Plant, R150PlantSettings, World,
    WorldSettings,
};

/// A vehicle whose sides are alike.
fn even() -> R150PlantSettings {
    let mut settings = R150PlantSettings::default();
    (settings.tolerance.motor, settings.tolerance.wheel) = (0.0, 0.0);
    settings
}

fn full_speed() -> f64 {
    let mut bench = Bench::with(&even());
    bench.drive(1.0, 1.0);
    bench.run(4.0);
    bench.speed()
}

fn effective_track() -> f64 {
    let mut bench = Bench::with(&even());
    bench.drive(0.6, -0.6);
    bench.run(4.0);
    let truth = bench.plant.truth();
    (truth.wheel_speed.right - truth.wheel_speed.left) * 0.25 / truth.motion.yaw_rate / 0.60
}

/// Speed up 15° with 150 kg, m/s.
fn loaded_uphill() -> f64 {
    let mut bench = Bench::on_slope(15.0, 150.0);
    bench.drive(1.0, 1.0);
    bench.run(5.0);
    bench.speed()
}

/// Where the loaded vehicle begins to tip, degrees.
fn tips_at() -> f64 {
    let tips = |degrees: f64| {
        let mut bench = Bench::on_slope(0.0, 150.0);
        bench
            .world
            .set_ground(Ground::new(1.2, degrees.to_radians(), 0.0));
        bench.command(|commands| commands.parking_brake = true);
        bench.run(1.0);
        bench.plant.is_tipping()
    };
    let (mut stands, mut falls) = (20.0, 40.0);
    while falls - stands > 0.01 {
        let middle = (stands + falls) / 2.0;
        if tips(middle) {
            falls = middle;
        } else {
            stands = middle;
        }
    }
    stands
}

/// Most current of a motor and of the battery in a launch and a full reversal, A, and the most
/// acceleration, as a share of what friction gives.
fn launch_and_reversal(limited: bool) -> [f64; 3] {
    let mut bench = if limited {
        Bench::new()
    } else {
        Bench::unlimited()
    };
    let mut most = [0.0_f64; 3];
    let mut before = 0.0;
    for duty in [1.0, -1.0] {
        bench.drive(duty, duty);
        for _ in 0..400 {
            bench.step();
            let truth = bench.plant.truth();
            let acceleration = (truth.motion.forward_speed - before) / 0.005;
            before = truth.motion.forward_speed;
            let now = [
                truth.motor_current.right,
                truth.battery_current,
                acceleration / (FRICTION * 9.81),
            ];
            for (most, now) in most.iter_mut().zip(now) {
                *most = most.max(now.abs());
            }
        }
    }
    most
}

/// What is missing of the battery's energy over a drive once the rails, the windings and what the
/// motors did are counted, %.
fn missing_energy() -> f64 {
    let mut bench = Bench::with(&even());
    let rails = {
        bench.step();
        let truth = bench.plant.truth();
        truth.battery_voltage * truth.battery_current
    };
    let (mut given, mut counted) = (0.0, 0.0);
    for (right, left) in [
        (1.0, 1.0),
        (0.4, 0.9),
        (-0.6, 0.6),
        (0.2, 0.2),
        (-1.0, -1.0),
        (0.5, 0.5),
    ] {
        bench.drive(right, left);
        for _ in 0..400 {
            bench.step();
            let truth = bench.plant.truth();
            given += 0.005 * truth.battery_voltage * truth.battery_current;
            counted += 0.005 * rails;
            for (speed, current) in [
                (truth.wheel_speed.right, truth.motor_current.right),
                (truth.wheel_speed.left, truth.motor_current.left),
            ] {
                let back_emf = speed * 28.3 * 0.3188;
                counted += 0.005 * (current * current * 0.5 + back_emf * current);
            }
        }
    }
    100.0 * (given - counted).abs() / given
}

/// What two bodies lose of their momentum when they collide, %.
fn lost_momentum() -> f64 {
    let mut world = World::new(&WorldSettings::default());
    let mut body = |name: &str, x: f64, y: f64, mass: f64| {
        let shape = BodyShape {
            length: 1.0,
            width: 0.6,
            mass,
            inertia: mass / 8.0,
        };
        let pose = Pose {
            x,
            y,
            ..Pose::default()
        };
        world.add_body(name, shape, pose)
    };
    let (heavy, light) = (body("heavy", 0.0, 0.0, 130.0), body("light", 2.0, 0.2, 8.0));
    world.set_velocity(heavy, [1.4, 0.0], 0.0);
    for _ in 0..400 {
        world.step().unwrap();
    }
    assert!(world.motion(light).vx > 0.5, "they met");
    let after = 130.0 * world.motion(heavy).vx + 8.0 * world.motion(light).vx;
    100.0 * (after / (130.0 * 1.4) - 1.0).abs()
}

/// How far apart 20 s end with steps of 5 ms and of 500 µs: % of the way, and degrees.
fn disagreement() -> [f64; 2] {
    let drive = |step: u64| {
        let settings = WorldSettings {
            step: Duration::from_micros(step),
            ..WorldSettings::default()
        };
        let mut world = World::new(&settings);
        let mut plant = R150Plant::new(
            "r150",
            &R150PlantSettings::default(),
            &mut world,
            Pose::default(),
        );
        let mut commands = R150Commands::default();
        for at in 0..20_000_000 / step {
            let duties = [
                (1.0, 1.0),
                (0.6, 1.0),
                (1.0, 0.3),
                (-0.5, 0.5),
                (0.0, 0.0),
                (-0.8, -0.8),
            ];
            let index = usize::try_from(at * step / 500_000).unwrap() % duties.len();
            let (right, left) = duties[index];
            commands.motor_duty = Sides { right, left };
            plant.set_commands(&commands);
            plant.before_step(&mut world);
            world.step().unwrap();
            plant.after_step(&mut world);
        }
        plant.truth()
    };
    let (coarse, fine) = (drive(5000), drive(500));
    let apart = (coarse.motion.pose.x - fine.motion.pose.x)
        .hypot(coarse.motion.pose.y - fine.motion.pose.y);
    let turn = (coarse.motion.pose.heading - fine.motion.pose.heading).to_degrees();
    [100.0 * apart / fine.motion.distance, turn.abs()]
}

fn strafe_share(payload: f64) -> f64 {
    let mut car = Car::new();
    car.load(payload);
    car.turn([-1, 1, 1, -1], 0.6);
    car.run(5.0);
    car.plant.truth().motion.distance / car.by_wheels()[1]
}

/// How hard the car slows down that rolls freely, m/s².
fn coasting(sideways: bool) -> f64 {
    let mut car = Car::new();
    car.turn(if sideways { [-1, 1, 1, -1] } else { [1; 4] }, 1.0);
    car.run(2.0);
    let speed = |car: &Car| {
        let truth = car.plant.truth();
        truth
            .motion
            .forward_speed
            .hypot(truth.motion.leftward_speed)
    };
    let from = speed(&car);
    let unsupplied = MecanumFaults {
        unsupplied: true,
        ..MecanumFaults::default()
    };
    car.plant.set_faults(&unsupplied);
    let seconds = car.run_while(5.0, |car| speed(car) > 0.1 * from);
    0.9 * from / seconds
}

/// How much of the load of its rear wheels the car loses when it brakes at full speed, %.
fn lifted_in_braking(payload: f64) -> f64 {
    let mut car = Car::new();
    car.load(payload);
    car.turn([1; 4], 1.0);
    car.run(1.0);
    let rear = |car: &Car| {
        let [.., left, right] = car.plant.gear().on_ground();
        left.load + right.load
    };
    let standing = car.plant.truth().motion.mass * 9.81 / 2.0;
    car.brake();
    let mut least = standing;
    for _ in 0..100 {
        car.step();
        least = least.min(rear(&car));
    }
    100.0 * (1.0 - least / standing)
}

/// A row of the page: its name, what the model gives, its decimals, and the least and the most that
/// it may be.
type Row = (&'static str, f64, usize, f64, f64);

fn rows() -> Vec<Row> {
    let [motor, battery, grip] = launch_and_reversal(true);
    let [.., spinning] = launch_and_reversal(false);
    let [apart, turn] = disagreement();
    vec![
        ("R150, speed at full PWM", full_speed(), 2, 1.37, 1.43),
        (
            "R150, effective track by its own",
            effective_track(),
            2,
            1.3,
            2.2,
        ),
        (
            "R150, speed up 15° with 150 kg",
            loaded_uphill(),
            2,
            0.1,
            1.4,
        ),
        (
            "R150, slope at which it tips with 150 kg",
            tips_at(),
            1,
            31.1,
            31.3,
        ),
        (
            "R150, most current of a motor in launch and reversal",
            motor,
            0,
            1.0,
            45.0,
        ),
        (
            "R150, most current of the battery in them",
            battery,
            0,
            1.0,
            100.0,
        ),
        (
            "R150, most acceleration in them by friction",
            grip,
            2,
            0.0,
            1.0001,
        ),
        (
            "the same without limits of its drivers",
            spinning,
            2,
            0.5,
            1.0001,
        ),
        ("car, strafe by wheels", strafe_share(0.0), 2, 0.74, 0.92),
        (
            "the same with 8 kg",
            strafe_share(8.0),
            2,
            0.74,
            strafe_share(0.0),
        ),
        ("car, coasting forward", coasting(false), 2, 0.88, 1.05),
        (
            "car, coasting sideways by forward",
            coasting(true) / coasting(false),
            2,
            1.4,
            2.8,
        ),
        (
            "car, load that leaves its rear wheels when it brakes",
            lifted_in_braking(0.0),
            0,
            1.0,
            54.0,
        ),
        (
            "the same with 8 kg on its deck",
            lifted_in_braking(8.0),
            0,
            1.0,
            99.0,
        ),
        (
            "energy of the battery that is not accounted for",
            missing_energy(),
            1,
            0.0,
            1.0,
        ),
        (
            "momentum lost in a collision",
            lost_momentum(),
            3,
            0.0,
            0.01,
        ),
        (
            "R150, 20 s in steps of 5 ms against 500 µs, way",
            apart,
            2,
            0.0,
            0.5,
        ),
        ("the same, heading", turn, 2, 0.0, 0.5),
    ]
}

#[test]
fn the_page_gives_the_figures_of_the_model_and_they_are_as_known() {
    let page = include_str!("../../docs/fidelity.md");
    let mut wrong = Vec::new();
    for (name, value, decimals, least, most) in rows() {
        let figure = format!("{value:.decimals$}");
        println!("{name}: {figure}");
        assert!((least..=most).contains(&value), "{name}: {value}");
        let row = page
            .lines()
            .find(|line| line.starts_with(&format!("| {name} |")));
        let shown = row.and_then(|row| row.split('|').nth_back(1));
        if shown.and_then(|shown| shown.split_whitespace().next()) != Some(figure.as_str()) {
            wrong.push(format!("{name}: {figure}"));
        }
    }
    assert!(wrong.is_empty(), "docs/fidelity.md is to say {wrong:#?}");
}
