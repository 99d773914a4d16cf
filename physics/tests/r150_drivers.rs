//! What the motor drivers and the battery allow, and what heat, weight and slopes do.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

mod common;

use std::time::Duration;

use common::Bench;
use rigsim_physics::faults::MotorFaults;
use rigsim_physics::r150::Side;
use rigsim_physics::{Ground, Plant as _, R150PlantSettings, Wrench};

fn with(change: impl FnOnce(&mut R150PlantSettings)) -> Bench {
    let mut settings = R150PlantSettings::default();
    change(&mut settings);
    Bench::with(&settings)
}

fn blocked(bench: &mut Bench) {
    for side in Side::ALL {
        let faults = MotorFaults {
            blocked: true,
            ..MotorFaults::default()
        };
        bench.plant.set_side_faults(side, faults);
    }
}

/// Most current of a motor, of the battery either way, and most slip of a wheel, over a launch and a
/// full reversal.
fn launch_and_reverse(bench: &mut Bench) -> [f64; 3] {
    let mut most = [0.0_f64; 3];
    for duty in [1.0, -1.0] {
        bench.drive(duty, duty);
        for _ in 0..400 {
            bench.step();
            let truth = bench.plant.truth();
            let slip = truth.wheel_speed.right * 0.25 - truth.motion.forward_speed;
            for (most, now) in
                most.iter_mut()
                    .zip([truth.motor_current.right, truth.battery_current, slip])
            {
                *most = most.max(now.abs());
            }
        }
    }
    most
}

#[test]
fn ramps_keep_launches_and_reversals_within_what_tyres_and_fuses_take() {
    let [motor, battery, slip] = launch_and_reverse(&mut Bench::new());
    println!("limited: motor {motor:.0} A, battery {battery:.0} A, slip {slip:.2} m/s");
    assert!(motor < 30.0 && battery < 50.0 && slip < 0.15);
    let [motor, battery, slip] = launch_and_reverse(&mut Bench::unlimited());
    println!("unlimited: motor {motor:.0} A, battery {battery:.0} A, slip {slip:.2} m/s");
    assert!(motor > 65.0 && battery > 200.0 && slip > 0.5);
}

#[test]
fn a_stalled_motor_draws_its_limit_and_no_fuse_blows() {
    for limit in [45.0, 20.0] {
        let mut bench = with(|s| s.motor.current_limit = Some(limit));
        blocked(&mut bench);
        bench.drive(1.0, 1.0);
        bench.run(5.0);
        let truth = bench.plant.truth();
        assert!((truth.motor_current.left - limit).abs() < 0.5, "{truth:?}");
        assert_eq!(truth.health.fuse_blown, [false; 4]);
    }
}

#[test]
fn ramps_take_their_time() {
    let took = |up, down| {
        let mut bench = with(|s| {
            s.motor.ramp_up = Duration::from_millis(up);
            s.motor.ramp_down = Duration::from_millis(down);
        });
        bench.drive(1.0, 1.0);
        let rise = bench.run_while(5.0, |bench| bench.speed() < 1.3);
        bench.drive(0.0, 0.0);
        let fall = bench.run_while(5.0, |bench| bench.speed() > 0.1);
        [rise, fall]
    };
    let [[rise, fall], [slow_rise, slow_fall]] = [took(500, 250), took(1500, 1000)];
    println!("{rise:.2} s and {fall:.2} s, {slow_rise:.2} s and {slow_fall:.2} s");
    assert!((0.4..0.7).contains(&rise) && (0.2..0.4).contains(&fall));
    assert!((1.3..1.7).contains(&slow_rise) && (0.85..1.2).contains(&slow_fall));
}

#[test]
fn a_pushed_motor_with_its_driver_off_is_held_by_the_diodes() {
    for charge in [80.0, 100.0] {
        let mut bench = with(|s| s.battery.initial_soc = charge);
        bench.command(|commands| commands.propulsion_power = false);
        bench.push(Wrench {
            ahead: 900.0,
            ..Wrench::default()
        });
        bench.run(5.0);
        let truth = bench.plant.truth();
        println!(
            "pushed with 900 N at {charge} %: {:.2} m/s, {:.0} A",
            bench.speed(),
            truth.battery_current
        );
        // No-load speed is 1.4 m/s; what is above it feeds the battery, or the brake resistor.
        assert!(bench.speed() < 3.0);
        assert_eq!(truth.battery_current < -15.0, charge < 100.0);
        assert!(truth.motor_current.right < -10.0);
    }
}

#[test]
fn a_motor_that_is_stalled_for_long_is_derated_and_shut_off_and_cools() {
    let mut bench = Bench::new();
    blocked(&mut bench);
    bench.drive(1.0, 1.0);
    bench.run(240.0);
    let hot = bench.plant.truth();
    println!(
        "{:.0} A, driver {:.0} degC",
        hot.motor_current.right, hot.driver_celsius.right
    );
    assert!(hot.health.derated.right && hot.motor_current.right < 40.0);
    assert!((80.0..95.0).contains(&hot.driver_celsius.right));
    bench.drive(0.0, 0.0);
    bench.run(1.0);
    bench.plant.rest(Duration::from_secs(600));
    let cool = bench.plant.truth();
    assert!(!cool.health.derated.right && cool.driver_celsius.right < 40.0);
    // One that is too hot from the start does nothing until it has cooled.
    let mut bench = with(|s| {
        s.thermal.ambient = 96.0;
    });
    bench.drive(1.0, 1.0);
    bench.run(2.0);
    assert!(bench.plant.truth().health.shut_off.left);
    assert!(bench.plant.truth().motion.pose.x.abs() < 1e-6);
}

#[test]
fn every_figure_of_the_warming_counts() {
    let heat = |change: &dyn Fn(&mut R150PlantSettings)| {
        let mut bench = with(change);
        blocked(&mut bench);
        bench.drive(1.0, 1.0);
        bench.run(10.0);
        bench.plant.truth().motor_celsius.left
    };
    let motor = heat(&|_| {});
    assert!(heat(&|s| s.motor_thermal.motor_rise = 160.0) > motor + 1.0);
    let slow = heat(&|s| s.motor_thermal.motor_time_constant = Duration::from_secs(9000));
    assert!(slow < motor - 1.0);
    let derated = |change: &dyn Fn(&mut R150PlantSettings)| {
        let mut bench = with(change);
        bench.run(0.1);
        (
            bench.plant.truth().health.derated.left,
            bench.plant.truth().health.shut_off.left,
        )
    };
    assert_eq!(
        derated(&|s| s.motor_thermal.motor_derating = 20.0),
        (true, false)
    );
    assert_eq!(
        derated(&|s| s.motor_thermal.motor_shut_off = 20.0),
        (true, true)
    );
}

fn charged(charge: f64, degrees: f64) -> Bench {
    let mut bench = with(|s| s.battery.initial_soc = charge);
    bench
        .world
        .set_ground(Ground::new(0.8, degrees.to_radians(), 0.0));
    bench.plant.wake();
    bench
}

#[test]
fn a_full_battery_takes_no_charge_downhill_and_its_motors_brake_all_the_same() {
    let downhill = |charge, degrees, duty| {
        let mut bench = charged(charge, degrees);
        bench.drive(duty, duty);
        let mut least = f64::INFINITY;
        for _ in 0..600 {
            bench.step();
            least = least.min(bench.plant.truth().battery_current);
        }
        (least, bench.plant.truth().soc, bench.speed())
    };
    for degrees in [-5.0, -10.0, -15.0] {
        for duty in [0.0, 0.5, 1.0] {
            let (current, _, speed) = downhill(80.0, degrees, duty);
            println!("{degrees} deg at {duty}: {current:.2} A, {speed:.2} m/s");
            if degrees < -12.0 && duty > 0.0 {
                assert!(current < -1.0, "it feeds the battery: {current} A");
            }
            let (current, _, full) = downhill(100.0, degrees, duty);
            println!("  full: {current:.2} A, {full:.2} m/s");
            assert!(current > -1e-9, "{current} A");
            // A full battery has 6 % more voltage.
            let more = 1.1 * speed.abs() + 0.02;
            assert!(full.abs() < more, "{full} m/s after {speed} m/s");
        }
    }
}

#[test]
fn a_stop_takes_as_far_with_a_full_battery() {
    let stop = |charge| {
        let mut bench = charged(charge, 0.0);
        bench.drive(1.0, 1.0);
        bench.run(4.0);
        let from = bench.plant.truth().motion.distance;
        bench.drive(0.0, 0.0);
        bench.run(3.0);
        assert!(bench.speed().abs() < 1e-3);
        bench.plant.truth().motion.distance - from
    };
    let (usual, full) = (stop(80.0), stop(100.0));
    println!("full: {full:.3} m after {usual:.3} m");
    assert!(full < 1.15 * usual);
}

#[test]
fn no_two_vehicles_drive_alike_and_none_drives_straight() {
    let beside = |name: &str, tolerance: f64, left: f64| {
        use rigsim_physics::{Pose, R150Plant, World, WorldSettings};
        let mut settings = R150PlantSettings::default();
        settings.tolerance.motor *= tolerance;
        settings.tolerance.wheel *= tolerance;
        settings.body.payload_left = left;
        let mut world = World::new(&WorldSettings::default());
        let plant = R150Plant::new(name, &settings, &mut world, Pose::default());
        let mut bench = Bench {
            world,
            plant,
            commands: rigsim_physics::R150Commands::default(),
        };
        bench.load(100.0);
        bench.drive(1.0, 1.0);
        bench.run_while(60.0, |bench| bench.plant.truth().motion.distance < 50.0);
        bench.plant.truth().motion.pose.y
    };
    let (first, again, second) = (
        beside("r150", 1.0, 0.005),
        beside("r150", 1.0, 0.005),
        beside("r150-2", 1.0, 0.005),
    );
    println!("50 m on: {first:.2} m and {second:.2} m beside the line");
    assert_eq!(first.to_bits(), again.to_bits());
    assert_ne!(first, second);
    for beside in [first, second] {
        assert!((0.05..5.0).contains(&beside.abs()), "{beside} m");
    }
    assert!(beside("r150", 0.0, 0.0).abs() < 1e-3);
    assert!(beside("r150", 5.0, 0.0).abs() > 2.0 * first.abs());
    let loaded = beside("r150", 0.0, 0.1);
    println!("with 100 kg 100 mm to the left: {loaded:.2} m");
    assert!(loaded > 0.05, "it pulls to the side of the load");
}

/// The moment of taking its weight up is none in which it would tip.
#[test]
fn placed_on_a_slope_it_tips_from_the_first_step_on_or_never() {
    for (degrees, tips) in [(30.2, false), (31.0, false), (31.4, true)] {
        let mut bench = Bench::new();
        bench.load(150.0);
        bench
            .world
            .set_ground(Ground::new(1.2, f64::to_radians(degrees), 0.0));
        bench.command(|commands| commands.parking_brake = true);
        for step in 0..200 {
            bench.run(0.005);
            let tipping = bench.plant.is_tipping();
            assert_eq!(tipping, tips, "{degrees} deg, step {step}");
        }
    }
}

/// Loaded with 150 kg, the centre of mass is above the rear axle at 31.2°.
#[test]
fn loaded_it_begins_to_tip_where_geometry_says() {
    for (degrees, payload, ahead, tips) in [
        (20.0, 150.0, 0.0, false),
        (29.0, 150.0, 0.0, false),
        (33.0, 150.0, 0.0, true),
        (33.0, 0.0, 0.0, false),
        // Further back it tips earlier.
        (25.0, 150.0, -0.2, true),
    ] {
        let mut bench = with(|s| s.body.payload_ahead = ahead);
        bench.load(payload);
        bench
            .world
            .set_ground(Ground::new(1.2, f64::to_radians(degrees), 0.0));
        bench.command(|commands| commands.parking_brake = true);
        bench.run(1.0);
        assert_eq!(
            bench.plant.is_tipping(),
            tips,
            "{degrees} deg with {payload} kg"
        );
    }
}

#[test]
fn the_height_of_its_centre_of_mass_says_on_which_slope_it_tips() {
    for (height, tips) in [(0.3, false), (0.7, true)] {
        let mut bench = with(|s| s.body.centre_of_mass_height = height);
        bench
            .world
            .set_ground(Ground::new(1.2, f64::to_radians(33.0), 0.0));
        bench.command(|commands| commands.parking_brake = true);
        bench.run(1.0);
        assert_eq!(bench.plant.is_tipping(), tips, "{height} m");
    }
}

#[test]
fn with_a_weak_parking_brake_it_rolls_down_a_slope() {
    for (torque, stands) in [(200.0, true), (20.0, false)] {
        let mut bench = with(|s| {
            s.motor.brake_torque = torque;
            s.motor.gear_friction = 0.0;
        });
        bench
            .world
            .set_ground(Ground::new(1.2, f64::to_radians(15.0), 0.0));
        bench.command(|commands| {
            commands.parking_brake = true;
            commands.propulsion_power = false;
        });
        bench.run(2.0);
        let way = bench.plant.truth().motion.distance;
        assert_eq!(way < 0.01, stands, "{torque} N*m: {way} m");
    }
}
