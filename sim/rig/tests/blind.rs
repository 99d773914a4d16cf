//! Clients that drive 50 m straight ahead and never look where they are.

use super::*;
use crate::mecanum::MecanumSettings;
use crate::mecanum_device::packet::Request as Packet;

/// How far they go, m.
const WAY: f64 = 50.0;

fn empty() -> Rig {
    Rig::new(RigSettings {
        world: WorldSettings::default(),
        map: WorldMap::default(),
        wire: Wire::Bare,
        seed: 1,
    })
}

/// Sends this from a client every 100 ms until the way is gone; how far to the left of its line it ends.
fn beside(mut rig: Rig, bytes: &[u8]) -> f64 {
    rig.attach(PORT, SimTime::ZERO).unwrap();
    for tick in 0..5_000 {
        let now = SimTime::from_millis(100 * tick);
        rig.client_sends(PORT, now, bytes).unwrap();
        read(&mut rig);
        let motion = rig.motion(0).unwrap();
        if motion.distance >= WAY {
            return motion.pose.y;
        }
    }
    panic!("it does not get there: {:?}", rig.motion(0));
}

fn r150(name: &str, change: impl FnOnce(&mut R150Settings)) -> f64 {
    let mut settings = R150Settings::default();
    change(&mut settings);
    let mut rig = empty();
    rig.add(&crate::r150::R150_SPEC, &Setup::new(name, &settings));
    let (right, left) = (700, 700);
    beside(rig, &Request::SetMotors { right, left }.encode())
}

fn car(name: &str, change: impl FnOnce(&mut MecanumSettings)) -> f64 {
    let mut settings = MecanumSettings::default();
    change(&mut settings);
    let mut rig = empty();
    rig.add(&crate::mecanum::MECANUM_SPEC, &Setup::new(name, &settings));
    let ahead = Packet::Motion {
        seq: 0,
        is_reset: 1,
        moving_idx: 0,
        s: 1000,
        v: 500,
    };
    beside(rig, &ahead.encode())
}

/// Motors that are off by 0.3 % at most and wheels by 0.1 % make the sides of a vehicle differ by up to
/// 0.8 %. It turns by that share of the way over its effective track, and half as far again beside
/// the line as that angle and the way make.
fn most(track: f64) -> f64 {
    0.008 / track * WAY * WAY / 2.0
}

#[test]
fn an_r150_ends_beside_its_line() {
    let names = ["r150", "r150-2", "r150-3"];
    let beside = names.map(|name| r150(name, |_| {}));
    println!("r150: {beside:.2?} m");
    for beside in beside {
        assert!((0.05..most(0.6)).contains(&beside.abs()), "{beside} m");
    }
    assert!(beside[0] != beside[1] && beside[1] != beside[2]);
    // The same vehicle every time.
    assert_eq!(r150("r150", |_| {}).to_bits(), beside[0].to_bits());
    let alike = r150("r150", |settings| {
        let tolerance = &mut settings.plant.tolerance;
        (tolerance.motor, tolerance.wheel) = (0.0, 0.0);
    });
    assert!(alike.abs() < 0.001, "{alike} m");
}

#[test]
fn a_car_ends_beside_its_line() {
    let names = ["car", "car-2", "car-3"];
    let beside = names.map(|name| car(name, |_| {}));
    println!("car: {beside:.2?} m");
    for beside in beside {
        assert!((0.05..most(0.24)).contains(&beside.abs()), "{beside} m");
    }
    assert!(beside[0] != beside[1] && beside[1] != beside[2]);
    assert_eq!(car("car", |_| {}).to_bits(), beside[0].to_bits());
    let alike = car("car", |settings| {
        let tolerance = &mut settings.plant.tolerance;
        (tolerance.motor, tolerance.wheel) = (0.0, 0.0);
        settings.plant.wheel.roller_spread = 0.0;
    });
    assert!(alike.abs() < 0.001, "{alike} m");
}
