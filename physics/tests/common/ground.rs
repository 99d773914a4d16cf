//! What holds of the wheels of any vehicle and of its energy, whatever it does.
#![allow(unreachable_pub, reason = "shared by including the file")]

use rigsim_physics::Energy;
use rigsim_physics::traction::GroundForce;

/// No wheel pushes harder than friction allows under its load, and none is pulled down.
pub fn check_friction(wheels: [GroundForce; 4]) {
    for wheel in wheels {
        let [along, across] = wheel.force;
        assert!(wheel.load >= 0.0, "{wheel:?}");
        assert!(
            along.hypot(across) <= wheel.most * (1.0 + 1e-9) + 1e-9,
            "{wheel:?}"
        );
    }
}

/// The same on a ground of one friction, where all together carry the weight, N.
pub fn check_wheels(wheels: [GroundForce; 4], friction: f64, weight: f64) {
    check_friction(wheels);
    let loads: f64 = wheels.iter().map(|wheel| wheel.load).sum();
    assert!((loads - weight).abs() <= 1e-9 * weight, "{loads} {weight}");
    for wheel in wheels {
        let most = friction * wheel.load;
        assert!((wheel.most - most).abs() <= 1e-9 * weight, "{wheel:?}");
    }
}

/// The most that rubber holds like a spring under this weight, J: up to the limit of friction and,
/// where it gives easily across, up to what is shed as fast as it strains. `stiffness` is of the
/// load, along and across, and `relaxation` a length in m.
pub fn most_strain(weight: f64, friction: f64, stiffness: [f64; 2], relaxation: f64) -> f64 {
    let limit = friction * friction;
    let [along, across] = stiffness;
    weight * relaxation / 2.0 * (limit / along + across.min(limit / across))
}

/// What was given is heat or motion, J, and heat never comes back; `strain` is the most that the
/// rubber holds.
pub fn check_energy(energy: Energy, motion: f64, strain: f64) {
    let Energy {
        motors,
        outside,
        held,
        tyres,
    } = energy;
    let size = motors.abs() + outside.abs() + held + tyres.abs() + motion;
    let missing = motors + outside - held - tyres - motion;
    assert!(missing.abs() <= 1e-6 * size + 1e-6, "{energy:?} {motion}");
    assert!(held >= -1e-9 * size - 1e-9, "{energy:?}");
    // Rubber that is pressed harder while it is strained holds more than was put into it.
    assert!(
        tyres >= -0.01 * size - 0.1 * strain - 1e-6,
        "{energy:?} {strain}"
    );
}
