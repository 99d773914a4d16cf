//! Momentum and gravity as a body turns: on ice nothing but them is there.

#![allow(
    clippy::unwrap_used,
    reason = "a test fails by panicking, and clippy takes helpers for production code"
)]

use std::time::Duration;

use rigsim_physics::faults::BodyFaults;
use rigsim_physics::{Plant, Pose, R150Plant, R150PlantSettings, World, WorldSettings, Wrench};

const STEPS_US: [u64; 3] = [500, 5_000, 10_000];

/// Ice on a slope of so many degrees, uphill along x.
fn ice(step_us: u64, slope: f64) -> World {
    World::new(&WorldSettings {
        step: Duration::from_micros(step_us),
        friction: 0.0,
        slope,
        ..WorldSettings::default()
    })
}

fn add(world: &mut World, name: &str, x: f64, y: f64) -> R150Plant {
    let pose = Pose { x, y, heading: 0.0 };
    R150Plant::new(name, &R150PlantSettings::default(), world, pose)
}

fn advance(world: &mut World, plants: &mut [R150Plant], seconds: f64) {
    let step = world.step_length().as_secs_f64();
    let mut passed = 0.0;
    while passed < seconds - step / 2.0 {
        for plant in &mut *plants {
            plant.before_step(world);
        }
        world.step().unwrap();
        for plant in &mut *plants {
            plant.after_step(world);
        }
        passed += step;
    }
}

#[test]
fn what_slides_downhill_goes_straight_down_however_it_turns() {
    for step in STEPS_US {
        let mut world = ice(step, 10.0);
        let plant = add(&mut world, "r150", 0.0, 0.0);
        world.set_velocity(plant.body(), [0.0; 2], 2.0);
        advance(&mut world, &mut [plant.clone()], 5.0);
        let found = world.motion(plant.body());
        let fall = 9.81 * 10_f64.to_radians().sin() * 25.0 / 2.0;
        assert!((found.x + fall).abs() < 0.001, "{step}: {} m", found.x);
        assert!(found.y.abs() < 0.001, "{step}: {} m aside", found.y);
    }
}

#[test]
fn what_is_spun_up_keeps_its_way() {
    for step in STEPS_US {
        let mut world = ice(step, 0.0);
        let mut plant = add(&mut world, "r150", 0.0, 0.0);
        world.set_velocity(plant.body(), [1.4, 0.0], 0.0);
        let push = Wrench {
            turn: 16.0,
            ..Wrench::default()
        };
        let faults = BodyFaults {
            push,
            ..BodyFaults::default()
        };
        plant.set_body_faults(&mut world, &faults);
        advance(&mut world, &mut [plant.clone()], 4.0);
        let found = world.motion(plant.body());
        assert!(found.yaw_rate > 3.0, "{}", found.yaw_rate);
        assert!((found.vx - 1.4).abs() < 1e-9, "{step}: {} m/s", found.vx);
        assert!(found.vy.abs() < 1e-9, "{step}: {} m/s", found.vy);
    }
}

#[test]
fn a_collision_off_the_middle_keeps_momentum() {
    for step in STEPS_US {
        let mut world = ice(step, 0.0);
        let mut plants = [
            add(&mut world, "one", 0.0, 0.0),
            add(&mut world, "other", 1.2, 0.4),
        ];
        let [one, other] = plants.each_ref().map(Plant::body);
        world.set_velocity(one, [1.4, 0.0], 0.0);
        advance(&mut world, &mut plants, 4.0);
        let (one, other) = (world.motion(one), world.motion(other));
        assert!(one.yaw_rate.abs() > 0.1, "they met");
        assert!((one.vx + other.vx - 1.4).abs() < 1e-6, "{step}");
        assert!((one.vy + other.vy).abs() < 1e-6, "{step}");
    }
}

#[test]
fn what_a_braking_vehicle_runs_into_does_not_throw_it_back() {
    for step in STEPS_US {
        let mut world = World::new(&WorldSettings {
            step: Duration::from_micros(step),
            ..WorldSettings::default()
        });
        let mut braked = add(&mut world, "braked", 1.05, 0.0);
        let mut commands = *braked.commands();
        commands.parking_brake = true;
        braked.set_commands(&commands);
        let mut plant = add(&mut world, "r150", 0.0, 0.0);
        plant.set_commands(&commands);
        world.set_velocity(plant.body(), [1.4, 0.0], 0.0);
        let mut plants = [plant, braked];
        let body = plants[0].body();
        for _ in 0..500 {
            let once = world.step_length().as_secs_f64();
            advance(&mut world, &mut plants, once);
            if world.collisions(body) > 0 {
                break;
            }
        }
        assert_eq!(world.collisions(body), 1, "they met");
        // Later both swing back on their tyres.
        assert!(world.motion(body).vx > 0.0, "{step}");
    }
}
