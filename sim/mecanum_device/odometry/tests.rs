use super::super::kinematics::Course;
use super::*;
use proptest::prelude::*;
use std::f64::consts::{FRAC_PI_2, TAU};

const ALL: Option<Movement> = Some(Movement {
    course: Course::Ahead,
    negative: false,
});

fn new() -> Odometry {
    Odometry::new(OdometrySettings::default())
}

fn close(found: [f64; 2], wanted: [f64; 2]) {
    let off = (found[0] - wanted[0]).abs() + (found[1] - wanted[1]).abs();
    assert!(off < 1e-9, "{found:?} {wanted:?}");
}

#[test]
fn a_revolution_of_all_wheels_is_a_revolution_along_the_heading() {
    let mut odometry = new();
    odometry.add([60; 4], ALL);
    close(odometry.position, [1.0, 0.0]);
    odometry.add([-60, 60, 60, -60], ALL);
    close(odometry.position, [1.0, 1.0]);
    odometry.set_pose([-3.0, 2.0], FRAC_PI_2);
    odometry.add([60; 4], ALL);
    close(odometry.position, [-3.0, 3.0]);
    close(odometry.to_frame([1.0, 0.0]), [0.0, 1.0]);
    assert_eq!(odometry.mileage, 3.0);
    assert!((odometry.mileage_m() - 3.0 * TAU * 0.05).abs() < 1e-12);
}

#[test]
fn turning_is_wheel_travel_over_the_arm() {
    let mut odometry = new();
    odometry.add([60, -60, 60, -60], ALL);
    // To the right; the arm is 0.10 m + 0.12 m.
    assert!((odometry.heading() + TAU * 0.05 / 0.22).abs() < 1e-12);
    close(odometry.position, [0.0, 0.0]);
    odometry.add([-60, 60, -60, 60], ALL);
    assert_eq!(odometry.heading(), 0.0);
    assert_eq!(odometry.mileage, 2.0);
}

#[test]
fn the_mileage_is_of_the_wheels_driven_or_of_the_path() {
    let diagonal = [0, 60, 60, 0];
    let counted = Some(Movement {
        course: Course::LeftFront,
        negative: false,
    });
    let mut odometry = new();
    odometry.add(diagonal, counted);
    assert_eq!(odometry.mileage, 1.0);
    let mut odometry = Odometry::new(OdometrySettings {
        mileage: Mileage::Path,
        ..OdometrySettings::default()
    });
    odometry.add(diagonal, counted);
    assert!((odometry.mileage - 0.5_f64.sqrt()).abs() < 1e-12);
    odometry.add([60, -60, 60, -60], ALL);
    assert!((odometry.mileage - 0.5_f64.sqrt()).abs() < 1e-12);
}

#[test]
fn setting_the_pose_may_clear_the_mileage() {
    for clears in [false, true] {
        let mut odometry = Odometry::new(OdometrySettings {
            set_pose_clears_mileage: clears,
            ..OdometrySettings::default()
        });
        odometry.add([60; 4], ALL);
        odometry.set_pose([0.0, 0.0], 0.0);
        assert_eq!(odometry.mileage, if clears { 0.0 } else { 1.0 });
        odometry.add([60; 4], ALL);
        assert_eq!(odometry.mileage, if clears { 1.0 } else { 2.0 });
    }
}

#[test]
fn the_mileage_may_be_counted_down_or_from_the_last_motion_on() {
    let mut odometry = new();
    odometry.add([60; 4], ALL);
    odometry.begin_motion();
    let back = Some(Movement {
        course: Course::Ahead,
        negative: true,
    });
    odometry.add([-30; 4], back);
    assert_eq!(odometry.mileage, 1.5);
    assert_eq!(odometry.net_mileage, 0.5);
    assert_eq!(odometry.motion_mileage(), 0.5);
}

proptest! {
    #[test]
    fn any_pulses_leave_numbers(pulses in prop::collection::vec(prop::array::uniform4(any::<i32>()), 0..50)) {
        let mut odometry = new();
        for pulses in pulses {
            odometry.add(pulses.map(i64::from), ALL);
        }
        prop_assert!(odometry.heading().is_finite());
        prop_assert!(odometry.position.iter().all(|axis| axis.is_finite()));
    }

    #[test]
    fn steps_along_an_arc_end_where_the_arc_does(go in -9i64..=9, turn in 1i64..=3, steps in 1i64..2000) {
        let mut odometry = new();
        for _ in 0..steps {
            odometry.add([go - turn, go + turn, go - turn, go + turn], ALL);
        }
        let angle = odometry.heading();
        let radius = (go * steps) as f64 / 60.0 / angle;
        let [x, y] = odometry.position;
        let off = (x - radius * angle.sin()).abs() + (y - radius * (1.0 - angle.cos())).abs();
        prop_assert!(off <= 0.002 * radius.abs() + 1e-9, "{off} of {radius}");
    }
}
