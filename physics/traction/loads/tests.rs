use super::*;

const STANCE: Stance = Stance {
    half_wheelbase: 0.325,
    half_track: 0.3,
    centre_height: 0.5375,
    centre: [0.0; 2],
    carried: None,
};

/// The loaded R150 tips where its centre of mass stands above its rear axle: at 31.2°.
#[test]
fn a_vehicle_tips_where_its_centre_of_mass_is_above_its_axle() {
    for (degrees, tips) in [(0.0_f64, false), (31.0, false), (31.3, true)] {
        let (sin, cos) = degrees.to_radians().sin_cos();
        let (loads, lifts) = STANCE.loads([-2747.0 * sin, 0.0], 2747.0 * cos);
        assert_eq!(lifts, tips, "{degrees}");
        assert!((loads.iter().sum::<f64>() - 2747.0 * cos).abs() < 1e-6);
        assert!(loads[0] <= loads[2]);
    }
}

#[test]
fn a_payload_to_the_left_presses_the_left_wheels() {
    let stance = Stance {
        centre: [0.0, 0.03],
        ..STANCE
    };
    let ([front_left, front_right, ..], _) = stance.loads([0.0; 2], 1000.0);
    assert!((front_left - 275.0).abs() < 1e-9 && (front_right - 225.0).abs() < 1e-9);
}

#[test]
fn loads_follow_the_tyres_after_a_moment() {
    let mut stance = STANCE;
    let push = [500.0, 0.0];
    let (first, _) = stance.carry([0.0; 2], push, 1000.0, 0.005);
    let mut last = first;
    for _ in 0..100 {
        (last, _) = stance.carry([0.0; 2], push, 1000.0, 0.005);
    }
    // Accelerating it leans on its rear wheels: 500 N on 0.5375 m over a wheelbase of 0.65 m.
    assert!(first[2] > 250.0 && first[2] < last[2]);
    assert!(
        (last[2] - (250.0 + 500.0 * 0.5375 / 1.3)).abs() < 0.1,
        "{last:?}"
    );
}
