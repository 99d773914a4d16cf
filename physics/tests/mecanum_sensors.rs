//! What the car's sensors make of the world around it.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;

use car::Car;
use rigsim_physics::world::{Obstacle, Strip, Tag};
use rigsim_physics::{
    MecanumMeasurements, MecanumPlant, MecanumPlantSettings, Plant as _, Pose, World, WorldMap,
    WorldSettings,
};

/// A car whose sensors measure exactly.
fn within(map: &WorldMap) -> Car {
    let mut settings = MecanumPlantSettings::default();
    (settings.ultrasonic.noise, settings.ultrasonic.crosstalk) = (0.0, 0.0);
    Car::within(World::with_map(&WorldSettings::default(), map), &settings)
}

fn at(x: f64, y: f64, heading: f64) -> Pose {
    Pose { x, y, heading }
}

fn read_at(car: &mut Car, pose: Pose) -> MecanumMeasurements {
    car.plant.place(&mut car.world, pose);
    car.plant.measurements()
}

/// A straight strip along x.
fn along_x() -> WorldMap {
    WorldMap {
        strips: vec![Strip {
            points: vec![[-5.0, 0.0], [5.0, 0.0]],
            ..Strip::default()
        }],
        ..WorldMap::default()
    }
}

#[test]
fn in_an_empty_world_there_is_nothing() {
    let read = Car::new().plant.measurements();
    assert_eq!(read, MecanumMeasurements::default());
}

#[test]
fn echoes_come_in_the_order_of_the_packet() {
    let mut car = within(&WorldMap::default());
    car.world
        .add_obstacle(Obstacle::wall([1.0, -9.0], [1.0, 9.0], 0.02))
        .unwrap();
    car.world
        .add_obstacle(Obstacle::circle([-1.0, 0.6], 0.1))
        .unwrap();
    let echoes = read_at(&mut car, at(0.0, 0.0, 0.0)).echoes;
    println!("{echoes:.3?}");
    for front in &echoes[1..3] {
        assert!((front.unwrap() - 0.82).abs() < 1e-6);
    }
    // Of the rear sensors the leftmost looks to the rear left.
    assert!((echoes[4].unwrap() - 0.83_f64.hypot(0.48) + 0.1).abs() < 1e-6);
    assert_eq!(echoes[7], None);
    // Turned about, the wall is behind.
    let echoes = read_at(&mut car, at(0.0, 0.0, std::f64::consts::PI)).echoes;
    assert!((echoes[5].unwrap() - 0.82).abs() < 1e-6);
    assert!(echoes[1].is_none_or(|echo| echo > 0.5));
}

#[test]
fn the_infrared_sensor_sees_300_mm() {
    let mut car = Car::new();
    car.world
        .add_obstacle(Obstacle::wall([1.0, -9.0], [1.0, 9.0], 0.02))
        .unwrap();
    let mut seen = |gap: f64| read_at(&mut car, at(0.99 - 0.17 - gap, 0.0, 0.0)).obstacle_ahead;
    assert!(seen(0.299) && seen(0.05));
    assert!(!seen(0.301));
}

#[test]
fn of_the_bar_bit_0_is_leftmost() {
    let mut car = within(&along_x());
    let mut bar = |y| read_at(&mut car, at(0.0, y, 0.0)).magnetic_bar;
    // Under the middle: channels that are 5, 15 and 25 mm off to either side.
    assert_eq!(bar(0.0), 0b0000_0111_1110_0000);
    // The car has moved to the right, so the strip is on its left.
    let left = bar(-0.06);
    println!("{left:016b}");
    assert!(left & 1 == 1 && left & (1 << 15) == 0);
    assert!(bar(0.06) & (1 << 15) != 0);
    assert_eq!(bar(0.2), 0);
}

#[test]
fn tags_pass_under_the_reader() {
    let map = WorldMap {
        tags: vec![Tag {
            at: [0.3, 0.01],
            number: 0xDEAD_BEEF,
        }],
        ..WorldMap::default()
    };
    let mut car = within(&map);
    car.turn([1; 4], 1.0);
    let mut seen = Vec::new();
    for _ in 0..400 {
        car.step();
        let tag = car.plant.measurements().tag;
        if seen.last() != Some(&tag) {
            seen.push(tag);
        }
    }
    assert_eq!(seen, [0, 0xDEAD_BEEF, 0]);
}

#[test]
fn at_rest_it_still_sees_others_come() {
    let mut car = Car::new();
    car.run_while(5.0, |car| !car.plant.at_rest());
    assert!(car.plant.at_rest());
    let settings = MecanumPlantSettings::default();
    let mut other = MecanumPlant::new("other", &settings, &mut car.world, at(2.0, 0.0, 0.0));
    let mut last = f64::INFINITY;
    for _ in 0..100 {
        other.place(&mut car.world, at(2.0 - 0.01 * last.min(1.0), 0.0, 0.0));
        car.step();
        last = car.plant.measurements().echoes[1].unwrap_or(f64::INFINITY);
    }
    assert!(car.plant.at_rest());
    assert!((1.4..1.7).contains(&last), "{last}");
}

/// Drives along the shipped loop by the bar alone, as a client would with 20 status packets a
/// second, and reports the tags that it passes.
#[test]
fn the_shipped_loop_can_be_followed_and_passes_its_tags_in_order() {
    let text = include_str!("../../worlds/line-loop.toml");
    let map = WorldMap::from_toml(text, "line-loop.toml").unwrap();
    let mut car = within(&map);
    let mut tags = Vec::new();
    let mut lost = 0;
    for step in 0..20_000 {
        if step % 10 == 0 {
            let read = car.plant.measurements();
            let channels: Vec<i32> = (0..16)
                .filter(|bit| read.magnetic_bar >> bit & 1 == 1)
                .collect();
            if channels.is_empty() {
                lost += 1;
            } else {
                let count = i32::try_from(channels.len()).unwrap();
                let off = 2 * channels.iter().sum::<i32>() - 15 * count;
                match off {
                    _ if off < -2 * count => car.turn([-1, 1, -1, 1], 0.3),
                    _ if off > 2 * count => car.turn([1, -1, 1, -1], 0.3),
                    _ => car.turn([1; 4], 0.8),
                }
            }
            if read.tag != 0 && tags.last() != Some(&read.tag) {
                tags.push(read.tag);
            }
        }
        car.step();
        if tags.len() == 5 {
            break;
        }
    }
    println!(
        "{tags:?}, {lost} readings without a line, {:?}",
        car.plant.truth()
    );
    assert_eq!(tags, [101, 102, 103, 104, 101]);
    assert_eq!(lost, 0);
    assert_eq!(car.world.collisions(car.plant.body()), 0);
}

#[test]
fn on_the_shipped_slope_the_ground_is_another() {
    let text = include_str!("../../worlds/slope.toml");
    let map = WorldMap::from_toml(text, "slope.toml").unwrap();
    let world = World::with_map(&WorldSettings::default(), &map);
    let [x, y] = world.ground_at(7.0, 1.0).downhill();
    assert!((x + 10.0_f64.to_radians().sin()).abs() < 1e-12 && y.abs() < 1e-12);
    assert_eq!(world.ground_at(7.0, 1.0).friction(), 0.8);
    assert_eq!(world.ground_at(7.0, -1.0).friction(), 0.3);
    assert_eq!(
        world.ground_at(4.9, 1.0).downhill(),
        [0.0, 0.0].map(|zero: f64| -zero)
    );
}

/// What the front sensors read at a wall 0.5 m ahead of them while the car creeps along it, left to
/// right, for so many pings.
fn pings(pings: usize, change: impl FnOnce(&mut MecanumPlantSettings)) -> Vec<[Option<f64>; 8]> {
    let mut settings = MecanumPlantSettings::default();
    (settings.ultrasonic.noise, settings.ultrasonic.crosstalk) = (0.0, 0.0);
    change(&mut settings);
    let mut map = WorldMap::default();
    // The left half of the wall is nearer.
    for (x, from, to) in [(0.67, 0.0, 9.0), (0.97, -9.0, 0.0)] {
        let wall = Obstacle::wall([x + 0.05, from], [x + 0.05, to], 0.1);
        map.obstacles.add(wall).unwrap();
    }
    let world = World::with_map(&WorldSettings::default(), &map);
    let mut car = Car::within(world, &settings);
    car.turn([-1, 1, 1, -1], 0.02);
    (0..pings)
        .map(|_| {
            car.run(0.06);
            car.plant.measurements().echoes
        })
        .collect()
}

#[test]
fn echoes_are_noisy_when_they_are_to_be() {
    let spread = |noise: f64| {
        let echoes = pings(200, |s| s.ultrasonic.noise = noise);
        let left: Vec<f64> = echoes.iter().map(|echo| echo[1].unwrap()).collect();
        let mean = left.iter().sum::<f64>() / 200.0;
        (left.iter().map(|echo| (echo - mean).powi(2)).sum::<f64>() / 200.0).sqrt()
    };
    let (none, some) = (spread(0.0), spread(0.01));
    println!("spread {none:.5} m and {some:.5} m");
    assert!(none < 0.001 && (0.007..0.013).contains(&some));
}

#[test]
fn a_sensor_may_hear_its_neighbour() {
    let first = |crosstalk: f64| {
        let echoes = pings(100, |s| {
            s.ultrasonic.half_angle = 1.0;
            // The first sensor looks aside, where there is nothing.
            s.ultrasonic.angle[0] = 90.0;
            s.ultrasonic.crosstalk = crosstalk;
        });
        echoes.iter().filter(|echo| echo[0].is_some()).count()
    };
    assert_eq!((first(0.0), first(100.0)), (0, 100));
    assert!((20..80).contains(&first(50.0)));
}

#[test]
fn a_surface_that_lies_aslant_sends_no_echo() {
    for (incidence, seen) in [(90.0, true), (60.0, true), (30.0, false)] {
        let mut settings = MecanumPlantSettings::default();
        settings.ultrasonic.incidence = incidence;
        settings.ultrasonic.half_angle = 2.0;
        let mut map = WorldMap::default();
        // At 45° across the way of the second sensor.
        let wall = Obstacle::wall([-1.0, -2.0], [3.0, 2.0], 0.02);
        map.obstacles.add(wall).unwrap();
        let world = World::with_map(&WorldSettings::default(), &map);
        let mut car = Car::within(world, &settings);
        car.plant.place(
            &mut car.world,
            Pose {
                x: 0.0,
                y: 0.5,
                ..Pose::default()
            },
        );
        assert_eq!(
            car.plant.measurements().echoes[1].is_some(),
            seen,
            "{incidence}"
        );
    }
}
