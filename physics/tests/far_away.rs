//! A drive goes as far wherever on the plane it begins.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;
mod common;

use car::Car;
use common::Bench;
use rigsim_physics::world::EDGE_M;
use rigsim_physics::{MecanumPlantSettings, Plant as _, Pose, World, WorldSettings};

/// Ten kilometres out, in a corner of the plane.
const FAR: Pose = Pose {
    x: 10_000.0,
    y: -10_000.0,
    heading: 0.0,
};

/// Whether two displacements agree within 0.1 % of the way.
fn agree(near: f64, far: f64) {
    assert!(near.abs() > 0.05, "hardly moved: {near}");
    assert!((near - far).abs() < 1e-3 * near.abs(), "{near} {far}");
}

#[test]
fn an_r150_drives_as_far_at_ten_kilometres_as_at_the_origin() {
    // Crawling and full ahead.
    for (duty, seconds) in [(0.03, 10.0), (1.0, 3.0)] {
        let drive = |start: Pose| {
            let mut bench = Bench::new();
            bench.plant.place(&mut bench.world, start);
            bench.drive(duty, duty);
            bench.run(seconds);
            bench.plant.truth().motion.pose.x - start.x
        };
        agree(drive(Pose::default()), drive(FAR));
    }
}

/// A vehicle that leaves the plane runs into the wall around it, and stays there.
#[test]
fn the_plane_ends_at_a_wall() {
    let quarter = std::f64::consts::FRAC_PI_2;
    for (x, y, heading) in [
        (EDGE_M, 0.0, 0.0),
        (0.0, EDGE_M, quarter),
        (-EDGE_M, 0.0, 2.0 * quarter),
        (0.0, -EDGE_M, 3.0 * quarter),
    ] {
        let mut bench = Bench::new();
        bench.plant.place(&mut bench.world, Pose { x, y, heading });
        bench.drive(1.0, 1.0);
        bench.run(4.0);
        assert!(!bench.world.is_touching(bench.plant.body()), "{heading}");
        bench.run(8.0);
        assert!(bench.world.is_touching(bench.plant.body()), "{heading}");
        let truth = bench.plant.truth();
        // Half its length, 0.49 m, before the wall.
        let gone = (truth.motion.pose.x - x).abs() + (truth.motion.pose.y - y).abs();
        assert!((9.4..9.7).contains(&gone), "{heading}: {gone}");
        assert!(
            truth.motion.forward_speed.abs() < 0.01,
            "{heading}: {truth:?}"
        );
    }
}

#[test]
fn a_car_drives_and_strafes_as_far_at_ten_kilometres_as_at_the_origin() {
    for rotations in [[1, 1, 1, 1], [-1, 1, 1, -1]] {
        let drive = |start: Pose| {
            let world = World::new(&WorldSettings::default());
            let mut car = Car::within(world, &MecanumPlantSettings::default());
            car.plant.place(&mut car.world, start);
            car.turn(rotations, 0.2);
            car.run(4.0);
            let pose = car.plant.truth().motion.pose;
            (pose.x - start.x) + (pose.y - start.y)
        };
        agree(drive(Pose::default()), drive(FAR));
    }
}
