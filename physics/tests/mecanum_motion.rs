//! How the mecanum car moves. None of these figures is an input.

#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;

use car::{ARM, Car, FULL, MOTIONS, RADIUS};
use rigsim_physics::faults::MotorFaults;
use rigsim_physics::mecanum::{MecanumFaults, PlugSwaps, Port, WHEELS, Wheel};
use rigsim_physics::world::{FrictionPatch, Obstacle, Rectangle, Shape};
use rigsim_physics::{Ground, MecanumPlantSettings, Plant as _, Pose, WorldMap};

fn unsupplied() -> MecanumFaults {
    MecanumFaults {
        unsupplied: true,
        ..MecanumFaults::default()
    }
}

const FORWARD: [i8; WHEELS] = [1; WHEELS];
const LEFT: [i8; WHEELS] = [-1, 1, 1, -1];

#[test]
fn without_drag_it_moves_as_the_closed_form_says() {
    for (name, rotations, _) in MOTIONS {
        for speed in [0.2, 0.6, 1.0] {
            let mut car = Car::ideal();
            car.turn(rotations, speed);
            car.run(1.0);
            let truth = car.plant.truth();
            let [lf, rf, lr, rr] = rotations.map(|r| f64::from(r) * speed * FULL * RADIUS);
            let expected = [
                (lf + rf + lr + rr) / 4.0,
                (-lf + rf + lr - rr) / 4.0,
                (-lf + rf - lr + rr) / (4.0 * ARM),
            ];
            let found = [
                truth.motion.forward_speed,
                truth.motion.leftward_speed,
                truth.motion.yaw_rate,
            ];
            println!("{name} at {speed}: {found:.4?}, closed form {expected:.4?}");
            let scale = [1.0, 1.0, ARM];
            let size = (0..3).fold(0.0_f64, |most, axis| {
                most.max((expected[axis] * scale[axis]).abs())
            });
            for axis in 0..3 {
                let error = (found[axis] - expected[axis]) * scale[axis];
                assert!(error.abs() < 0.01 * size, "{name}: {found:?} {expected:?}");
            }
        }
    }
}

/// Seconds from full speed to a tenth of it, freely rolling, ahead or to the side.
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
    car.plant.set_faults(&unsupplied());
    let seconds = car.run_while(5.0, |car| speed(car) > 0.1 * from);
    0.9 * from / seconds
}

/// Robots of teams that tune themselves with Pedro Pathing: 0.88 to 1.05 m/s² ahead, and from 1.4
/// to 2.8 times as much to the side.
#[test]
fn it_coasts_to_a_stand_more_than_twice_as_hard_sideways_as_forward() {
    let (ahead, aside) = (coasting(false), coasting(true));
    println!("coasting: {ahead:.2} m/s^2 ahead, {aside:.2} to the side");
    assert!((0.88..1.05).contains(&ahead), "{ahead}");
    let ratio = aside / ahead;
    assert!((1.4..2.8).contains(&ratio), "{ratio}");
}

/// Where a car called so ends that rolls 20 m straight ahead.
fn beside(name: &str, tolerance: f64) -> f64 {
    let mut settings = MecanumPlantSettings::default();
    settings.tolerance.wheel *= tolerance;
    settings.tolerance.motor *= tolerance;
    settings.wheel.roller_spread *= tolerance;
    let mut world = rigsim_physics::World::new(&rigsim_physics::WorldSettings::default());
    let pose = Pose::default();
    let plant = rigsim_physics::MecanumPlant::new(name, &settings, &mut world, pose);
    let mut car = Car { world, plant };
    car.turn([1; 4], 1.0);
    car.run_while(120.0, |car| car.plant.truth().motion.distance < 20.0);
    car.gone()[1]
}

#[test]
fn no_two_cars_roll_alike_and_none_straight() {
    let (first, second) = (beside("car", 1.0), beside("other", 1.0));
    println!("20 m on: {first:.2} m and {second:.2} m beside the line");
    assert_eq!(first.to_bits(), beside("car", 1.0).to_bits());
    assert!((first - second).abs() > 0.01);
    for off in [first, second] {
        assert!((0.005..3.0).contains(&off.abs()), "{off}");
    }
    assert!(beside("car", 0.0).abs() < 1e-6);
    assert!(beside("car", 3.0).abs() > 2.0 * first.abs());
}

/// Rollers drag with 0.18 of their load, which the ground gives them by friction: what is left of
/// it pushes the car aside.
#[test]
fn a_strafe_needs_friction_to_turn_its_rollers() {
    let share = |friction: f64| {
        let mut car = Car::new();
        car.world.set_ground(Ground::flat(friction));
        car.turn(LEFT, 0.6);
        car.run(4.0);
        let share = car.gone()[1] / car.by_wheels()[1];
        println!("friction {friction}: {share:.4} of what the wheels turned");
        share
    };
    for grip in [0.3, 0.8, 1.2] {
        assert!((0.8..0.9).contains(&share(grip)), "{grip}");
    }
    let slippery = share(0.21);
    assert!((-0.1..0.7).contains(&slippery), "{slippery}");
    for ice in [0.02, 0.1, 0.15] {
        assert!(share(ice).abs() < 0.1, "{ice}");
    }
    // A car that drives straight needs no rollers, and goes on ice.
    let mut car = Car::new();
    car.world.set_ground(Ground::flat(0.15));
    car.turn(FORWARD, 0.6);
    car.run(4.0);
    let ahead = car.gone()[0] / car.by_wheels()[0];
    assert!(ahead > 0.9, "{ahead}");
}

#[test]
fn a_car_that_stops_stands_without_rocking() {
    for (axis, rotations) in [FORWARD, LEFT, [-1, 1, -1, 1]].into_iter().enumerate() {
        let mut car = Car::new();
        car.turn(rotations, 1.0);
        car.run(1.0);
        car.brake();
        car.run(0.1);
        let place = |car: &Car| {
            let [x, y, heading] = car.gone();
            [x, y, heading * ARM]
        };
        let (mut path, mut back) = (0.0, 0.0_f64);
        let mut last = place(&car);
        for _ in 0..400 {
            car.step();
            let now = place(&car);
            let step: [f64; 3] = std::array::from_fn(|axis| now[axis] - last[axis]);
            path += step.iter().map(|step| step * step).sum::<f64>().sqrt();
            back += step[axis].min(0.0);
            last = now;
        }
        println!("{rotations:?}: a path of {path:.5} m after the brake, {back:.5} m of it back");
        assert!(path < 0.03, "{rotations:?}: {path}");
        assert!(back > -0.001, "{rotations:?}: {back}");
    }
}

/// At the lowest speeds too, what gear and rollers cost is made up for.
#[test]
fn a_wheel_turns_as_fast_as_it_is_asked_to() {
    for (rotations, speed) in [(FORWARD, 0.02), (LEFT, 0.02), (FORWARD, 0.5), (LEFT, 0.5)] {
        let turned = |integral| {
            let mut settings = MecanumPlantSettings::default();
            settings.motor.speed_integral = integral;
            settings.tolerance.motor = 0.0;
            let mut car = Car::with(&settings);
            car.turn(rotations, speed);
            car.run(2.0);
            let before = car.plant.truth().wheel_angle[1];
            car.run(5.0);
            (car.plant.truth().wheel_angle[1] - before) / (5.0 * speed * FULL)
        };
        let share = turned(std::time::Duration::from_millis(100));
        assert!(
            (share - 1.0).abs() < 0.005,
            "{rotations:?} {speed}: {share}"
        );
        // A control without that part droops.
        let without = turned(std::time::Duration::ZERO);
        assert!(without < share - 0.002, "{rotations:?} {speed}: {without}");
    }
}

#[test]
fn with_drag_a_strafe_loses_what_published_cars_lose_and_forward_nothing() {
    for speed in [0.1, 0.3, 0.6, 1.0] {
        let share = |rotations, axis: usize| {
            let mut car = Car::new();
            car.turn(rotations, speed);
            car.run(4.0);
            car.brake();
            car.run(1.0);
            car.gone()[axis] / car.by_wheels()[axis]
        };
        let (forward, left) = (share(FORWARD, 0), share(LEFT, 1));
        let right = share(LEFT.map(|rotation| -rotation), 1);
        let turn = share([-1, 1, -1, 1], 2);
        println!("at {speed}: forward {forward:.4}, strafe {left:.4} {right:.4}, turn {turn:.4}");
        assert!(forward > 0.97 && forward < 1.005);
        assert!((0.80..0.92).contains(&left));
        assert!((left - right).abs() < 0.002);
    }
}

#[test]
fn the_ten_motions_move_the_body_as_tabulated() {
    for (name, rotations, direction) in MOTIONS {
        let mut car = Car::new();
        car.turn(rotations, 0.6);
        car.run(2.0);
        let turned = car.plant.truth().wheel_angle;
        for wheel in Wheel::ALL {
            let wanted = f64::from(rotations[wheel.index()]);
            let turned = turned[wheel.index()];
            assert!(turned * wanted > 5.0 || wanted == 0.0 && turned.abs() < 1e-9);
        }
        let found = signs(&car);
        println!("{name}: {:.3?}", car.gone());
        assert_eq!(found, direction, "{name}: {:?}", car.gone());
    }
}

/// The direction of the way it has gone: what is under a tenth of the whole is none.
fn signs(car: &Car) -> [i8; 3] {
    let [ahead, left, turn] = car.gone();
    let way = [ahead, left, turn * ARM];
    let size = way.iter().fold(0.0_f64, |most, part| most.max(part.abs()));
    assert!(size > 0.1, "{way:?}");
    way.map(|part| {
        if part.abs() < 0.1 * size {
            0
        } else if part > 0.0 {
            1
        } else {
            -1
        }
    })
}

#[test]
fn a_miswired_car_goes_the_wrong_way() {
    let straight = PlugSwaps::default();
    let car = |swaps, reversed| {
        let drive = |rotations| {
            let mut car = Car::swapped(swaps);
            let faults = MotorFaults {
                reversed,
                ..MotorFaults::default()
            };
            for wheel in Wheel::ALL {
                car.fault(wheel, faults);
            }
            car.turn(rotations, 0.6);
            car.run(2.0);
            car
        };
        (signs(&drive(FORWARD)), drive(LEFT))
    };
    // Left and right front motors swapped: it still goes forward, but instead of strafing it turns.
    let (forward, strafing) = car(straight.and(Port::X, Port::Y), false);
    assert_eq!(forward, [1, 0, 0]);
    println!("front swapped, strafing: {:.3?}", strafing.gone());
    assert!(strafing.gone()[1].abs() < 0.1 && strafing.gone()[2].abs() > 0.5);
    // All motors turn the other way: it goes backward.
    let (forward, strafing) = car(straight, true);
    assert_eq!(forward, [-1, 0, 0]);
    assert_eq!(signs(&strafing), [0, -1, 0]);
    // Wired as the article's later line says, for a firmware that follows the table: the left rear
    // motor, at port Z, gets nothing and is held.
    let later = straight.and(Port::E0, Port::Z).and(Port::E1, Port::E0);
    let (forward, _) = car(later, false);
    println!("later line under the table's firmware: {forward:?}");
    assert_ne!(forward, [1, 0, 0]);
}

#[test]
fn a_wheel_that_is_blocked_dragging_or_free_pulls_the_car_off_line() {
    let drive = |faults: Option<MotorFaults>| {
        let mut car = Car::new();
        if let Some(faults) = faults {
            car.fault(Wheel::LeftFront, faults);
        }
        car.turn(FORWARD, 0.6);
        car.run(3.0);
        println!("{faults:?}: {:.3?}", car.gone());
        car.gone()
    };
    let none = MotorFaults::default();
    let whole = drive(None);
    assert!(whole[1].abs() < 1e-3 && whole[2].abs() < 1e-3);
    let blocked = drive(Some(MotorFaults {
        blocked: true,
        ..none
    }));
    // The others push on; the front left corner stays behind, so it turns to the left.
    assert!(blocked[2] > 0.1 && blocked[0] < 0.9 * whole[0]);
    let dragging = drive(Some(MotorFaults {
        drag_torque: 2.5,
        ..none
    }));
    assert!(dragging[2] > 0.05);
    let free = drive(Some(MotorFaults {
        free_wheeling: true,
        ..none
    }));
    assert!(free[2].abs() < blocked[2] && (free[2].abs() > 1e-3 || free[1].abs() > 1e-3));
}

#[test]
fn against_a_wall_wheels_spin_or_stall_and_their_pulses_run_away() {
    // Strong motors spin the wheels; weak ones stall on a floor that holds.
    for (friction, torque_limit, spins) in [(0.8, 1.5, true), (0.2, 1.5, true), (2.0, 0.5, false)] {
        let mut settings = MecanumPlantSettings::default();
        settings.motor.torque_limit = torque_limit;
        let mut car = Car::with(&settings);
        car.world.set_ground(Ground::flat(friction));
        car.world
            .add_obstacle(Obstacle::wall([0.5, -2.0], [0.5, 2.0], 0.1))
            .unwrap();
        car.turn(FORWARD, 0.6);
        car.run(10.0);
        let truth = car.plant.truth();
        println!(
            "friction {friction}: x {:.4} m, by wheels {:.3} m, wheels {:.3?} rad/s, {:.3?} N*m",
            truth.motion.pose.x,
            car.by_wheels()[0],
            truth.wheel_speed,
            truth.motor_torque
        );
        assert!(car.world.is_touching(car.plant.body()));
        assert!((truth.motion.pose.x - 0.28).abs() < 0.01);
        assert!(truth.motion.forward_speed.abs() < 0.01);
        if spins {
            assert!(car.by_wheels()[0] > truth.motion.pose.x + 0.5);
            let pulses = car.plant.measurements().pulses[Port::X.index()];
            assert!(f64::from(pulses) / 60.0 * 2.0 * std::f64::consts::PI * RADIUS > 1.0);
        } else {
            assert!(car.by_wheels()[0] < truth.motion.pose.x + 0.05);
            for torque in truth.motor_torque {
                assert!((torque - torque_limit).abs() < 0.01);
            }
        }
    }
}

#[test]
fn the_speed_control_takes_its_ramp_and_the_brake_is_quick() {
    let mut car = Car::new();
    car.turn(FORWARD, 1.0);
    let rise = car.run_while(2.0, |car| car.plant.truth().wheel_speed[0] < 0.95 * FULL);
    car.run(1.0);
    let from = car.gone()[0];
    car.brake();
    let stop = car.run_while(2.0, |car| !car.plant.at_rest());
    println!(
        "95 % after {:.0} ms; stops within {:.1} mm, rests after {:.0} ms",
        rise * 1e3,
        (car.gone()[0] - from) * 1e3,
        stop * 1e3
    );
    assert!((0.18..0.22).contains(&rise));
    assert!(car.gone()[0] - from < 0.02 && stop < 1.0);
}

#[test]
fn ten_tenths_of_a_revolution_are_sixty_pulses_on_each_port() {
    let mut car = Car::new();
    car.turn(FORWARD, 0.6);
    car.run_while(5.0, |car| {
        car.plant.truth().wheel_angle[0] < std::f64::consts::TAU
    });
    let pulses = car.plant.measurements().pulses;
    assert_eq!(pulses, [60, 60, 0, 60, 60]);
}

#[test]
fn braked_on_a_slope_it_stays_and_released_it_runs() {
    for heading in [0.0_f64, 0.8, 1.57, 3.0, -1.57] {
        let mut car = Car::new();
        car.world
            .set_ground(Ground::new(0.8, 17.0_f64.to_radians(), 0.0));
        let pose = Pose {
            heading,
            ..Pose::default()
        };
        car.plant.place(&mut car.world, pose);
        let took = car.run_while(5.0, |car| !car.plant.at_rest());
        let settled = car.plant.truth().motion.pose;
        println!("heading {heading}: rests after {took:.2} s at {settled:?}");
        assert!(car.plant.at_rest());
        assert!(settled.x.hypot(settled.y) < 0.01);
        for _ in 0..10 {
            car.plant.wake();
            car.run(1.0);
        }
        let later = car.plant.truth().motion.pose;
        assert!((later.x - settled.x).hypot(later.y - settled.y) < 1e-3);
        car.plant.set_faults(&unsupplied());
        car.run(2.0);
        println!("released: {:?}", car.plant.truth().motion.pose);
        // Sideways the rollers' drag may hold it.
        let lies_across = heading.cos().abs() < 0.1;
        assert!(lies_across || car.plant.truth().motion.pose.x < -0.2);
    }
}

#[test]
fn hit_by_another_it_wakes() {
    let mut car = Car::new();
    let pose = Pose {
        x: 1.0,
        ..Pose::default()
    };
    let settings = MecanumPlantSettings::default();
    let mut other = rigsim_physics::MecanumPlant::new("other", &settings, &mut car.world, pose);
    // Its motors would hold it about as hard as the other can push.
    other.set_faults(&unsupplied());
    car.turn(FORWARD, 1.0);
    let mut rested = false;
    for _ in 0..1000 {
        car.plant.before_step(&mut car.world);
        other.before_step(&mut car.world);
        car.world.step().unwrap();
        car.plant.after_step(&mut car.world);
        other.after_step(&mut car.world);
        rested |= other.at_rest();
        assert!(!other.at_rest() || car.world.is_still(other.body()));
    }
    println!("shoved {:.3} m", other.truth().motion.pose.x - 1.0);
    assert!(rested && other.truth().motion.pose.x > 1.02);
}

#[test]
fn leaning_on_a_wall_it_still_comes_to_rest_and_stays_there() {
    let mut car = Car::new();
    car.world
        .add_obstacle(Obstacle::wall([0.5, -2.0], [0.5, 2.0], 0.1))
        .unwrap();
    car.turn(FORWARD, 0.6);
    car.run(4.0);
    car.brake();
    car.run_while(2.0, |car| !car.plant.at_rest());
    for _ in 0..2000 {
        car.step();
        assert!(car.plant.at_rest());
    }
}

#[test]
fn each_wheel_stands_on_its_own_ground() {
    let mut car = Car::new();
    // Ice under the left wheels only.
    let ice = Rectangle::new([5.0, 0.5], 0.0, 20.0, 1.0);
    let frictions = vec![FrictionPatch {
        area: Shape::Rectangle(ice),
        friction: 0.02,
    }];
    let map = WorldMap {
        frictions,
        ..WorldMap::default()
    };
    car.world.add_map(&map).unwrap();
    car.turn(FORWARD, 1.0);
    car.run(0.3);
    println!("half on ice: {:.4?}", car.gone());
    // The right wheels push, the left ones spin.
    assert!(car.gone()[2] > 0.01);
    assert!(car.world.ground_at(0.0, 0.12).friction() < 0.1);
    assert!(car.world.ground_at(0.0, -0.12).friction() > 0.5);
}

/// Heading in degrees and share of the wheels' way after a strafe of 6 s at full speed, with a payload in kg.
fn strafe(payload: f64, change: impl FnOnce(&mut MecanumPlantSettings)) -> (f64, f64) {
    let mut settings = MecanumPlantSettings::default();
    (settings.tolerance.wheel, settings.tolerance.motor) = (0.0, 0.0);
    change(&mut settings);
    let mut car = Car::with(&settings);
    car.load(payload);
    car.turn(LEFT, 1.0);
    car.run(6.0);
    let way = car.plant.truth().motion.distance;
    (car.gone()[2].to_degrees(), way / car.by_wheels()[1])
}

#[test]
fn rollers_that_drag_unlike_turn_a_strafing_car() {
    let (none, _) = strafe(0.0, |s| s.wheel.roller_spread = 0.0);
    let (usual, _) = strafe(0.0, |_| ());
    let (much, _) = strafe(0.0, |s| s.wheel.roller_spread = 50.0);
    println!("6 s of strafing turn it by {none:.3}, {usual:.3} and {much:.3} deg");
    assert!(none.abs() < 1e-6);
    assert!((0.02..8.0).contains(&usual.abs()));
    assert!(much.abs() > 2.0 * usual.abs());
}

#[test]
fn a_loaded_car_loses_more_of_a_strafe() {
    let (_, empty) = strafe(0.0, |_| ());
    let (_, loaded) = strafe(8.0, |_| ());
    let (_, even) = strafe(8.0, |s| s.wheel.roller_drag_growth = 0.0);
    println!(
        "a strafe moves {empty:.3} of the wheels' way empty, {loaded:.3} loaded, {even:.3} without growth"
    );
    assert!(loaded < empty - 0.02 && (even - empty).abs() < 0.01);
    assert!((0.74..=0.92).contains(&loaded));
}

/// Loads of the front wheels less those of the rear ones, and of the left less the right ones, N.
fn leaning(car: &Car) -> [f64; 2] {
    let [lf, rf, lr, rr] = car.plant.gear().on_ground().map(|wheel| wheel.load);
    [lf + rf - lr - rr, lf + lr - rf - rr]
}

#[test]
fn it_leans_backward_when_it_starts_and_to_the_right_when_it_starts_to_the_left() {
    for (rotations, axis) in [(FORWARD, 0), (LEFT, 1)] {
        let mut car = Car::new();
        car.turn(rotations, 1.0);
        let mut most = 0.0_f64;
        for _ in 0..40 {
            car.step();
            most = most.max(-leaning(&car)[axis]);
        }
        // In the 200 ms of its ramp it gains 0.26 m/s, a little less to the left: 8 kg and 1.3 m/s²,
        // 0.08 m above axles that are 0.2 m apart, and wheels 0.24 m.
        let [whole, half] = [8.0 * 1.31 * 0.08, [0.1, 0.12][axis]];
        assert!(
            (0.6..1.2).contains(&(most / (whole / half))),
            "{axis}: {most}"
        );
        car.run(2.0);
        assert!(leaning(&car)[axis].abs() < 0.2, "it drives steadily");
    }
}

#[test]
fn a_tall_load_would_tip_it_when_it_brakes_and_a_low_one_not() {
    for (height, tips) in [(0.2, false), (0.6, true)] {
        let mut settings = MecanumPlantSettings::default();
        settings.body.payload_height = height;
        let mut car = Car::with(&settings);
        car.load(8.0);
        car.turn(FORWARD, 1.0);
        car.run(1.0);
        assert!(!car.plant.is_tipping());
        car.brake();
        let tipped = car.run_while(1.0, |car| !car.plant.is_tipping()) < 0.99;
        assert_eq!(tipped, tips, "{height}");
    }
}

#[test]
fn a_load_beside_the_middle_presses_its_wheels_and_turns_a_strafing_car() {
    let place = |ahead, left| {
        move |settings: &mut MecanumPlantSettings| {
            settings.wheel.roller_spread = 0.0;
            (settings.body.payload_ahead, settings.body.payload_left) = (ahead, left);
        }
    };
    let mut settings = MecanumPlantSettings::default();
    place(0.05, -0.03)(&mut settings);
    let mut car = Car::with(&settings);
    car.load(8.0);
    car.run(0.5);
    // 8 kg, each by its way from the middle over that of the wheels.
    let weight = 8.0 * 9.80665;
    let [ahead, left] = leaning(&car);
    assert!((ahead - weight * 0.05 / 0.10).abs() < 0.1, "{ahead} N");
    assert!((left - weight * -0.03 / 0.12).abs() < 0.1, "{left} N");
    // Strafing to the left, the left front wheel pulls back and the right one ahead, which turns it to the
    // left, and the rear ones to the right: those with the greater load win.
    let (middle, _) = strafe(8.0, place(0.0, 0.0));
    let (nose, _) = strafe(8.0, place(0.05, 0.0));
    let (tail, _) = strafe(8.0, place(-0.05, 0.0));
    println!("strafing to the left it turns by {middle:.3}, {nose:.3} and {tail:.3} deg");
    assert!(middle.abs() < 1e-6 && nose > 5.0 && tail < -5.0);
}
