//! What a step costs beside bare rapier2d, printed by
//! `cargo test --release -p rigsim-physics --test step_cost -- --ignored --nocapture`.
#![expect(
    clippy::disallowed_types,
    clippy::disallowed_methods,
    reason = "measuring needs a clock; nothing measured feeds the simulation"
)]
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

mod common;

use std::time::Instant;

use common::{Bench, TICK};
use rigsim_physics::mecanum::PortCommand;
use rigsim_physics::{
    BodyShape, MecanumCommands, MecanumPlant, MecanumPlantSettings, Plant as _, Pose, R150Commands,
    R150Plant, R150PlantSettings, World, WorldMap, WorldSettings,
};

const STEPS: u32 = 200_000;

fn nanoseconds_each(count: u32, mut work: impl FnMut()) -> f64 {
    let start = Instant::now();
    for _ in 0..count {
        work();
    }
    start.elapsed().as_secs_f64() * 1e9 / f64::from(count)
}

/// The same body moving at the same speed, without a plant.
fn bare(vehicles: u32, steps: u32) -> f64 {
    let mut world = World::new(&WorldSettings::default());
    let shape = BodyShape {
        length: 0.98,
        width: 0.66,
        mass: 130.0,
        inertia: 16.0,
    };
    for lane in 0..vehicles {
        let pose = Pose {
            y: f64::from(lane) * 3.0,
            ..Pose::default()
        };
        let body = world.add_body("bare", shape, pose);
        world.set_velocity(body, [1.4, 0.0], 0.0);
    }
    nanoseconds_each(steps, || world.step().unwrap())
}

fn driving(vehicles: u32, steps: u32, left: f64) -> f64 {
    let mut world = World::new(&WorldSettings::default());
    let mut plants: Vec<R150Plant> = (0..vehicles)
        .map(|lane| {
            let pose = Pose {
                y: f64::from(lane) * 3.0,
                ..Pose::default()
            };
            R150Plant::new("r150", &R150PlantSettings::default(), &mut world, pose)
        })
        .collect();
    let mut commands = R150Commands::default();
    let mut step = 0_u32;
    nanoseconds_each(steps, || {
        // A client at 20 Hz that changes its mind every time.
        if step.is_multiple_of(10) {
            commands.motor_duty.right = 0.9 + f64::from(step / 10 % 2) * 0.05;
            commands.motor_duty.left = commands.motor_duty.right * left;
        }
        step += 1;
        for plant in &mut plants {
            plant.set_commands(&commands);
            plant.before_step(&mut world);
        }
        world.step().unwrap();
        for plant in &mut plants {
            plant.after_step(&mut world);
        }
    })
}

/// One car that strafes to and fro in a world, with a change of mind ten times a second.
fn strafing(map: &WorldMap, steps: u32) -> f64 {
    let mut world = World::with_map(&WorldSettings::default(), map);
    let settings = MecanumPlantSettings::default();
    let mut car = MecanumPlant::new("mecanum", &settings, &mut world, Pose::default());
    let mut commands = MecanumCommands {
        speed_voltage: 0.5,
        ..MecanumCommands::default()
    };
    let mut step = 0_u32;
    nanoseconds_each(steps, || {
        if step.is_multiple_of(20) {
            let right = step / 200 % 2 == 1;
            for (port, reverse) in [(0, !right), (1, right), (3, right), (4, !right)] {
                commands.ports[port] = PortCommand {
                    reverse,
                    brake: false,
                };
            }
            commands.speed_voltage = 0.5 + f64::from(step / 20 % 2) * 0.05;
            car.set_commands(&commands);
        }
        step += 1;
        car.before_step(&mut world);
        world.step().unwrap();
        car.after_step(&mut world);
    })
}

#[test]
#[ignore = "prints figures and judges nothing"]
fn step_cost_of_cars() {
    let yard = include_str!("../../worlds/yard.toml");
    let line = include_str!("../../worlds/line-loop.toml");
    for (name, text) in [("empty", "schema = 1"), ("yard", yard), ("line-loop", line)] {
        let map = WorldMap::from_toml(text, name).unwrap();
        let best = (0..5).fold(f64::INFINITY, |best: f64, _| {
            best.min(strafing(&map, STEPS))
        });
        println!(
            "one car, {name}: {best:.0} ns a step, {:.0} times real time",
            5e6 / best
        );
    }
    let map = WorldMap::from_toml(yard, "yard").unwrap();
    let mut world = World::with_map(&WorldSettings::default(), &map);
    let settings = MecanumPlantSettings::default();
    let mut car = MecanumPlant::new("mecanum", &settings, &mut world, Pose::default());
    for _ in 0..400 {
        car.before_step(&mut world);
        world.step().unwrap();
        car.after_step(&mut world);
    }
    assert!(car.at_rest());
    let rest = nanoseconds_each(STEPS, || car.rest(TICK));
    println!("one car at rest: {rest:.0} ns per 100 ms tick");
    let beside = nanoseconds_each(STEPS, || {
        car.before_step(&mut world);
        car.after_step(&mut world);
    });
    println!("one car at rest beside a moving one: {beside:.0} ns a step on top of the world's");
}

#[test]
#[ignore = "prints figures and judges nothing"]
fn step_cost() {
    for vehicles in [1, 10, 100] {
        let steps = STEPS / vehicles;
        let (mut bare_best, mut driving_best) = (f64::INFINITY, f64::INFINITY);
        for _ in 0..5 {
            bare_best = bare_best.min(bare(vehicles, steps));
            driving_best = driving_best.min(driving(vehicles, steps, 1.0));
        }
        println!(
            "{vehicles} vehicles: bare {bare_best:.0} ns a step, driving {driving_best:.0} ns, \
             ratio {:.2}, {:.0} times real time",
            driving_best / bare_best,
            5e6 / driving_best
        );
    }
    println!(
        "turning on the spot: {:.0} ns a step",
        driving(1, STEPS, -1.0)
    );
    let mut bench = Bench::new();
    bench.run_while(5.0, |bench| !bench.plant.at_rest());
    let rest = nanoseconds_each(STEPS, || bench.plant.rest(TICK));
    println!(
        "rest: {rest:.0} ns per 100 ms tick, {:.0} times real time",
        1e8 / rest
    );
    let read = nanoseconds_each(STEPS, || {
        std::hint::black_box(bench.plant.measurements());
    });
    println!("measurements: {read:.0} ns");
    let truth = nanoseconds_each(STEPS, || {
        std::hint::black_box(bench.plant.truth());
    });
    println!("truth: {truth:.0} ns");
}
