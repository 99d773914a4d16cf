//! What batteries, fuses and slopes do to an R150 at their limits.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

mod common;

use common::Bench;
use sim_physics::Ground;

#[test]
fn a_pushed_motor_with_its_driver_off_is_held_by_the_diodes() {
    let mut bench = Bench::new();
    bench.command(|commands| commands.propulsion_power = false);
    bench.plant.set_push(900.0, 0.0, 0.0);
    bench.run(5.0);
    let truth = bench.plant.truth();
    println!(
        "pushed with 900 N: {:.2} m/s, {:.0} A",
        bench.speed(),
        truth.battery_current
    );
    // No-load speed is 1.4 m/s; what is above it feeds the battery.
    assert!((1.4..2.0).contains(&bench.speed()));
    assert!(truth.battery_current < -10.0);
}

#[test]
fn loaded_it_begins_to_tip_where_geometry_says() {
    for (degrees, payload, tips) in [
        (29.0, 150.0, false),
        (33.0, 150.0, true),
        (33.0, 0.0, false),
    ] {
        let mut bench = Bench::on_slope(degrees, payload);
        bench
            .world
            .set_ground(Ground::new(1.2, f64::to_radians(degrees), 0.0));
        bench.command(|commands| commands.parking_brake = true);
        bench.run(0.5);
        assert_eq!(bench.plant.health().tipping, tips, "{degrees} deg");
    }
}
