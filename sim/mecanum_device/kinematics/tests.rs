use super::*;
use proptest::prelude::*;

#[test]
fn courses_are_numbered_as_on_the_wire() {
    let numbered = [
        Course::Ahead,
        Course::Rotate,
        Course::Strafe,
        Course::LeftFront,
        Course::RightFront,
    ];
    assert_eq!(Course::ALL, numbered);
}

#[test]
fn a_positive_turn_is_to_the_right_and_a_positive_strafe_to_the_left() {
    let body = |course| {
        let movement = Movement {
            course,
            negative: false,
        };
        body_speed(movement.rotations().map(f64::from), 0.22)
    };
    assert_eq!(body(Course::Ahead), [1.0, 0.0, 0.0]);
    assert_eq!(body(Course::Strafe), [0.0, 1.0, 0.0]);
    assert_eq!(body(Course::LeftFront), [0.5, 0.5, 0.0]);
    assert_eq!(body(Course::RightFront), [0.5, -0.5, 0.0]);
    let [ahead, left, turn] = body(Course::Rotate);
    assert_eq!([ahead, left], [0.0, 0.0]);
    assert!((turn + 1.0 / 0.22).abs() < 1e-12);
}

proptest! {
    #[test]
    fn the_inverse_is_one(
        ahead in -9.0..9.0f64, left in -9.0..9.0f64, turn in -9.0..9.0f64, arm in 0.01..2.0f64,
    ) {
        let back = body_speed(wheel_speeds([ahead, left, turn], arm), arm);
        for (there, back) in [ahead, left, turn].into_iter().zip(back) {
            prop_assert!((there - back).abs() < 1e-9, "{there} {back}");
        }
    }
}
