//! How the R150 moves, on default settings. None of these figures is an input.

mod common;

use common::{Bench, FRICTION};
use rigsim_physics::faults::MotorFaults;
use rigsim_physics::r150::Side;
use rigsim_physics::world::Obstacle;
use rigsim_physics::{Ground, Plant as _, Pose, R150Plant, R150PlantSettings, Wrench};

#[test]
fn a_little_duty_does_not_move_it_and_a_little_more_does() {
    let moved = |duty: f64, change: fn(&mut R150PlantSettings)| {
        let mut settings = R150PlantSettings::default();
        change(&mut settings);
        let mut bench = Bench::with(&settings);
        bench.drive(duty, duty);
        bench.run(3.0);
        bench.plant.truth().motion.pose.x
    };
    assert!(moved(0.02, |_| {}).abs() < 1e-4, "within the dead band");
    assert!(moved(0.03, |_| {}) > 0.02, "beyond it");
    let no_band = |s: &mut R150PlantSettings| s.motor.dead_band = 0.0;
    assert!(moved(0.02, no_band) > 0.01, "a driver without one");
    // A gear that stands holds by ten times as much as one that turns.
    let sticky = |s: &mut R150PlantSettings| s.motor.stiction = 10.0;
    assert!(moved(0.03, sticky).abs() < 1e-3, "it is held");
}

#[test]
fn full_ahead_on_the_flat_is_1_4_metres_a_second() {
    let mut bench = Bench::new();
    bench.drive(1.0, 1.0);
    bench.run(3.0);
    let rpm = bench.plant.measurements().motor_rpm;
    println!(
        "full ahead: {:.4} m/s, {:.1} rpm, {:?}",
        bench.speed(),
        rpm.right,
        bench.plant.truth()
    );
    assert!((bench.speed() / 1.4 - 1.0).abs() < 0.03);
    assert!((rpm.right / 1513.0 - 1.0).abs() < 0.03);
    assert!((rpm.left / 1513.0 - 1.0).abs() < 0.03);
}

#[test]
fn a_fuller_battery_drives_faster() {
    let speeds = [10.0, 50.0, 80.0, 100.0].map(|soc| {
        let mut settings = R150PlantSettings::default();
        settings.battery.initial_soc = soc;
        let mut bench = Bench::with(&settings);
        bench.drive(1.0, 1.0);
        bench.run(3.0);
        bench.speed()
    });
    println!("at 10, 50, 80 and 100 % charge: {speeds:.3?} m/s");
    assert!(speeds.is_sorted());
    assert!(speeds[3] > 1.15 * speeds[0]);
}

#[test]
fn a_standing_vehicle_is_woken_by_what_hits_it() {
    let mut bench = Bench::new();
    let pose = Pose {
        x: 3.0,
        ..Pose::default()
    };
    let settings = R150PlantSettings::default();
    let mut other = R150Plant::new("other", &settings, &mut bench.world, pose);
    bench.drive(1.0, 1.0);
    let mut rested = false;
    for _ in 0..1000 {
        bench.plant.before_step(&mut bench.world);
        other.before_step(&mut bench.world);
        bench.world.step().unwrap();
        bench.plant.after_step(&mut bench.world);
        other.after_step(&mut bench.world);
        rested |= other.at_rest();
        // A plant that says it rests really stands.
        assert!(!other.at_rest() || bench.world.is_still(other.body()));
    }
    assert!(rested);
    assert!(bench.world.collisions(other.body()) > 0);
    let moved = other.truth().motion.pose.x - 3.0;
    println!(
        "shoved {moved:.2} m in {} collisions",
        bench.world.collisions(other.body())
    );
    assert!(moved > 0.05 && !other.at_rest());
}

#[test]
fn astern_is_ahead_mirrored() {
    let mut bench = Bench::new();
    bench.drive(-1.0, -1.0);
    bench.run(3.0);
    assert!((bench.speed() / -1.4 - 1.0).abs() < 0.03);
}

#[test]
fn it_slows_on_a_slope_and_climbs_15_degrees_loaded() {
    let mut flat = 1.4;
    for (degrees, payload) in [(5.0, 0.0), (10.0, 0.0), (15.0, 0.0), (15.0, 150.0)] {
        let mut bench = Bench::on_slope(degrees, payload);
        bench.drive(1.0, 1.0);
        bench.run(4.0);
        println!("{degrees} deg with {payload} kg: {:.3} m/s", bench.speed());
        assert!(bench.speed() < flat - 0.01);
        assert!(bench.speed() > 0.8);
        flat = bench.speed();
    }
}

/// Source of the range: A. Mandow et al., "Experimental kinematics for wheeled skid-steer mobile
/// robots", IROS 2007, and the steering efficiency figures that later papers give.
#[test]
fn turning_on_the_spot_its_effective_track_is_that_of_skid_steer_vehicles() {
    for duty in [0.3, 0.6, 1.0] {
        let mut bench = Bench::new();
        bench.drive(duty, -duty);
        bench.run(4.0);
        let truth = bench.plant.truth();
        let rim = (truth.wheel_speed.right - truth.wheel_speed.left) * 0.25;
        let ratio = rim / truth.motion.yaw_rate / 0.60;
        println!(
            "duty {duty}: yaw {:.3} rad/s, effective track ratio {ratio:.3}",
            truth.motion.yaw_rate
        );
        assert!((1.5..2.0).contains(&ratio));
        assert!(truth.motion.forward_speed.abs() < 0.01);
        assert!(truth.motion.pose.x.hypot(truth.motion.pose.y) < 0.05);
    }
}

#[test]
fn it_stops_within_half_a_metre_of_the_duty_going_to_zero() {
    for payload in [0.0, 150.0] {
        let mut bench = Bench::on_slope(0.0, payload);
        bench.drive(1.0, 1.0);
        bench.run(3.0);
        let from = bench.plant.truth().motion.pose.x;
        bench.drive(0.0, 0.0);
        let took = bench.run_while(10.0, |bench| !bench.plant.at_rest());
        let stretch = bench.plant.truth().motion.pose.x - from;
        println!("with {payload} kg: stops in {stretch:.3} m, rests after {took:.2} s");
        assert!(bench.plant.at_rest());
        assert!((0.0..0.5).contains(&stretch));
    }
}

#[test]
fn parked_on_a_slope_it_stays_and_rests() {
    for (heading, payload) in [(0.0, 150.0), (1.0, 0.0), (1.6, 150.0), (3.1, 150.0)] {
        let mut bench = Bench::on_slope(15.0, payload);
        let pose = Pose {
            heading,
            ..Pose::default()
        };
        bench.plant.place(&mut bench.world, pose);
        bench.command(|commands| commands.parking_brake = true);
        let took = bench.run_while(5.0, |bench| !bench.plant.at_rest());
        let truth = bench.plant.truth();
        println!(
            "heading {heading}: rests after {took:.2} s at {:?}",
            truth.motion.pose
        );
        assert!(bench.plant.at_rest());
        // It has settled onto its tyres and not a step further, also when made to look again.
        let settled = truth.motion.pose;
        assert!(settled.x.hypot(settled.y) < 0.03);
        for _ in 0..20 {
            bench.plant.wake();
            bench.run(1.0);
        }
        let later = bench.plant.truth().motion.pose;
        assert!(
            (later.x - settled.x).hypot(later.y - settled.y) < 1e-3,
            "{later:?}"
        );
    }
}

#[test]
fn without_the_brake_the_shorted_motors_let_it_creep_and_open_ones_let_it_run() {
    let mut bench = Bench::on_slope(15.0, 0.0);
    bench.run(3.0);
    let creep = bench.speed();
    println!("shorted on 15 deg: {creep:.4} m/s");
    assert!((-0.1..-0.001).contains(&creep));
    bench.command(|commands| commands.propulsion_power = false);
    bench.run(2.0);
    println!("open on 15 deg: {:.4} m/s", bench.speed());
    assert!(bench.speed() < -1.0);
}

#[test]
fn pushed_when_released_and_unpowered_it_rolls() {
    let mut bench = Bench::new();
    bench.command(|commands| commands.propulsion_power = false);
    bench.push(Wrench {
        ahead: 200.0,
        ..Wrench::default()
    });
    bench.run(2.0);
    println!("pushed with 200 N for 2 s: {:.3} m/s", bench.speed());
    assert!(bench.speed() > 0.5);
    bench.push(Wrench::default());
    bench.run_while(20.0, |bench| !bench.plant.at_rest());
    assert!(bench.plant.at_rest());
    // Parked, the same push does not move it.
    bench.command(|commands| commands.parking_brake = true);
    let from = bench.plant.truth().motion.pose.x;
    bench.push(Wrench {
        ahead: 200.0,
        ..Wrench::default()
    });
    bench.run(2.0);
    assert!((bench.plant.truth().motion.pose.x - from).abs() < 0.02);
}

#[test]
fn blocked_wheels_draw_stall_current_and_sag_the_battery() {
    let mut bench = Bench::unlimited();
    let voltage = bench.plant.measurements().bus_voltage;
    for side in Side::ALL {
        bench.plant.set_side_faults(
            side,
            MotorFaults {
                blocked: true,
                ..MotorFaults::default()
            },
        );
    }
    bench.drive(1.0, 1.0);
    bench.step();
    let at_once = bench.plant.truth();
    println!(
        "blocked: {:.1} A a motor, bus {voltage:.2} V to {:.2} V",
        at_once.motor_current.right, at_once.battery_voltage
    );
    assert!(at_once.motor_current.right > 80.0);
    assert!(at_once.battery_voltage < voltage - 2.0);
    assert!(at_once.battery_voltage > 39.0);
    bench.run(1.0);
    assert!(bench.plant.truth().motion.pose.x.abs() < 1e-6);
    assert!(bench.plant.truth().motor_current.left > 80.0);
}

#[test]
fn against_a_wall_it_stalls_or_slips() {
    for (duty, friction) in [(0.1, FRICTION), (1.0, FRICTION), (1.0, 0.1)] {
        let mut bench = Bench::new();
        bench.world.set_ground(Ground::flat(friction));
        bench
            .world
            .add_obstacle(Obstacle::wall([1.0, -2.0], [1.0, 2.0], 0.1))
            .unwrap();
        bench.drive(duty, duty);
        bench.run(20.0);
        let truth = bench.plant.truth();
        println!(
            "wall at duty {duty}, friction {friction}: x {:.3} m, {:.3} m/s, wheels {:.3} m/s, {:.1} A, {} collisions",
            truth.motion.pose.x,
            truth.motion.forward_speed,
            truth.wheel_speed.right * 0.25,
            truth.motor_current.right,
            bench.world.collisions(bench.plant.body())
        );
        assert!(bench.world.is_touching(bench.plant.body()));
        assert!(bench.world.collisions(bench.plant.body()) > 0);
        assert!(truth.motion.forward_speed.abs() < 0.02);
        assert!(truth.motion.pose.x < 0.5);
        assert!(truth.motor_current.right > 3.0);
    }
}

#[test]
fn one_blocked_side_pulls_it_around() {
    let mut bench = Bench::new();
    bench.plant.set_side_faults(
        Side::Left,
        MotorFaults {
            blocked: true,
            ..MotorFaults::default()
        },
    );
    bench.drive(1.0, 1.0);
    bench.run(2.0);
    let truth = bench.plant.truth();
    println!("left blocked: yaw rate {:.3} rad/s", truth.motion.yaw_rate);
    assert!(truth.motion.yaw_rate > 0.3);
}

#[test]
fn left_alone_on_the_flat_it_never_gains_speed() {
    for propulsion_power in [true, false] {
        let mut bench = Bench::new();
        bench.command(|commands| commands.propulsion_power = propulsion_power);
        let velocity = [150.0 / 130.0, 80.0 / 130.0];
        let body = bench.plant.body();
        bench.world.set_velocity(body, velocity, 20.0 / 16.0);
        let energy = |bench: &Bench| {
            let truth = bench.plant.truth();
            let [ahead, left] = [truth.motion.forward_speed, truth.motion.leftward_speed];
            130.0 * (ahead * ahead + left * left) / 2.0 + 16.0 * truth.motion.yaw_rate.powi(2) / 2.0
        };
        let bumped = 130.0 / 2.0 * ((150.0_f64 / 130.0).powi(2) + (80.0_f64 / 130.0).powi(2))
            + 16.0 / 2.0 * (20.0_f64 / 16.0).powi(2);
        let mut steps = 0;
        let mut peak = bumped;
        while !bench.plant.at_rest() {
            bench.run(0.5);
            // Within half a second a tyre may give a little of its strain back.
            assert!(
                energy(&bench) <= peak * 1.001 + 1e-3,
                "{} {peak}",
                energy(&bench)
            );
            peak = energy(&bench);
            steps += 100;
            assert!(steps < 20_000);
        }
    }
}
