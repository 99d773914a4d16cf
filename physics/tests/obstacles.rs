//! Obstacles that come, move and go while vehicles are there.
#![allow(clippy::unwrap_used, reason = "a failed step fails the test")]

#[path = "common/car.rs"]
mod car;

use car::Car;
use rigsim_physics::world::{EDGE_M, Obstacle, ObstacleError, ObstacleShape, Rectangle, Tag};
use rigsim_physics::{MecanumPlantSettings, Plant as _, World, WorldMap, WorldSettings};

fn gate() -> Obstacle {
    let gate = Rectangle::new([0.52, 0.0], 0.0, 0.1, 2.0);
    Obstacle::new(ObstacleShape::Box(gate)).named("gate")
}

/// A car with a gate across its way, whose face is 0.3 m before its nose.
fn before_a_gate() -> Car {
    let mut car = Car::new();
    car.world.add_obstacle(gate()).unwrap();
    car
}

/// A change of the world wakes those in it.
fn look_again(car: &mut Car) {
    car.plant.wake();
    car.run(0.2);
}

fn front(car: &Car) -> Option<f64> {
    car.plant.measurements().echoes[1]
}

#[test]
fn one_that_comes_moves_or_goes_is_seen_so() {
    let mut car = before_a_gate();
    car.run_while(5.0, |car| !car.plant.at_rest());
    look_again(&mut car);
    assert!((front(&car).unwrap() - 0.3).abs() < 1e-3);
    let old = car.world.move_obstacle("gate", [1.52, 0.0], None).unwrap();
    assert_eq!((old.x, old.y, old.heading), (0.52, 0.0, 0.0));
    look_again(&mut car);
    assert!((front(&car).unwrap() - 1.3).abs() < 1e-3);
    // Turned by a right angle and aside it is behind everything the sensor sees.
    car.world
        .move_obstacle("gate", [0.5, 3.0], Some(std::f64::consts::FRAC_PI_2))
        .unwrap();
    look_again(&mut car);
    assert_eq!(front(&car), None);
    car.world
        .move_obstacle("gate", [0.52, 0.0], Some(0.0))
        .unwrap();
    look_again(&mut car);
    assert!(front(&car).is_some());
    let gate = car.world.remove_obstacle("gate").unwrap();
    assert_eq!(gate.pose().x, 0.52);
    look_again(&mut car);
    assert_eq!(front(&car), None);
    assert_eq!(car.world.obstacles().count(), 0);
    // It can be put back as it was.
    car.world.add_obstacle(gate).unwrap();
    look_again(&mut car);
    assert!((front(&car).unwrap() - 0.3).abs() < 1e-3);
}

#[test]
fn a_vehicle_that_rests_against_one_drives_on_when_it_is_gone() {
    for aside in [false, true] {
        let mut car = before_a_gate();
        car.turn([1; 4], 0.5);
        car.run(4.0);
        let leaning = car.gone()[0];
        assert!((0.28..0.31).contains(&leaning), "{leaning}");
        car.brake();
        let waited = car.run_while(10.0, |car| !car.plant.at_rest());
        assert!(waited < 5.0);
        if aside {
            car.world.move_obstacle("gate", [0.5, 5.0], None).unwrap();
        } else {
            car.world.remove_obstacle("gate").unwrap();
        }
        // Standing it stays where it is.
        look_again(&mut car);
        assert!((car.gone()[0] - leaning).abs() < 0.005, "{:?}", car.gone());
        assert!(!car.world.is_touching(car.plant.body()));
        car.turn([1; 4], 0.5);
        car.run(3.0);
        assert!(car.gone()[0] > leaning + 0.3, "{:?}", car.gone());
    }
}

#[test]
fn one_that_comes_to_stand_on_a_vehicle_pushes_it_out() {
    for resting in [false, true] {
        let mut car = before_a_gate();
        if resting {
            car.run_while(5.0, |car| !car.plant.at_rest());
        }
        // 50 mm into its nose.
        car.world.move_obstacle("gate", [0.17, 0.0], None).unwrap();
        car.plant.wake();
        car.run(5.0);
        let [x, y, heading] = car.gone();
        assert!((-0.08..-0.035).contains(&x), "{x}");
        assert!(y.abs() < 0.02 && heading.abs() < 0.2, "{y} {heading}");
        assert!(car.world.collisions(car.plant.body()) > 0);
        assert!(car.plant.at_rest());
    }
}

#[test]
fn one_that_lies_on_the_middle_of_a_vehicle_breaks_nothing() {
    let mut car = Car::new();
    car.world
        .add_obstacle(Obstacle::circle([0.0, 0.0], 0.05).named("post"))
        .unwrap();
    car.plant.wake();
    car.run(5.0);
    assert!(car.gone().iter().all(|part| part.is_finite()));
    car.world.remove_obstacle("post").unwrap();
    look_again(&mut car);
    assert!(!car.world.is_touching(car.plant.body()));
}

#[test]
fn a_wall_moves_and_turns_about_its_first_point() {
    let mut world = World::new(&WorldSettings::default());
    let fence = ObstacleShape::Wall {
        points: vec![[1.0, 1.0], [3.0, 1.0], [3.0, 2.0]],
        closed: false,
        thickness: 0.1,
    };
    world
        .add_obstacle(Obstacle::new(fence).named("fence"))
        .unwrap();
    let shape = |world: &World| match world.obstacles().next().unwrap().shape() {
        ObstacleShape::Wall { points, .. } => points.clone(),
        other => panic!("{other:?}"),
    };
    let close = |found: Vec<[f64; 2]>, wanted: [[f64; 2]; 3]| {
        for (found, wanted) in found.iter().flatten().zip(wanted.iter().flatten()) {
            assert!((found - wanted).abs() < 1e-12, "{found} {wanted}");
        }
    };
    let quarter = std::f64::consts::FRAC_PI_2;
    let old = world
        .move_obstacle("fence", [0.0, 0.0], Some(quarter))
        .unwrap();
    assert_eq!((old.x, old.y, old.heading), (1.0, 1.0, 0.0));
    close(shape(&world), [[0.0, 0.0], [0.0, 2.0], [-1.0, 2.0]]);
    // Without a heading it keeps the one it has.
    world.move_obstacle("fence", [5.0, 5.0], None).unwrap();
    close(shape(&world), [[5.0, 5.0], [5.0, 7.0], [4.0, 7.0]]);
    world
        .move_obstacle("fence", [old.x, old.y], Some(old.heading))
        .unwrap();
    close(shape(&world), [[1.0, 1.0], [3.0, 1.0], [3.0, 2.0]]);
}

#[test]
fn places_out_of_the_plane_are_held_at_its_edge() {
    let mut world = World::new(&WorldSettings::default());
    world
        .add_obstacle(Obstacle::circle([0.0; 2], 1.0).named("post"))
        .unwrap();
    world
        .move_obstacle("post", [f64::NAN, 1e9], Some(f64::INFINITY))
        .unwrap();
    let pose = world.obstacles().next().unwrap().pose();
    assert_eq!((pose.x, pose.y), (0.0, EDGE_M));
    world.step().unwrap();
}

#[test]
fn names_are_given_once_and_what_has_none_stays() {
    let mut world = World::new(&WorldSettings::default());
    let post = || Obstacle::circle([5.0, 0.0], 0.1);
    world.add_obstacle(post()).unwrap();
    let error = world.remove_obstacle("gate").unwrap_err().to_string();
    assert_eq!(error, "no obstacle is named `gate`; none has a name");
    world.add_obstacle(post().named("a")).unwrap();
    world.add_obstacle(post().named("b")).unwrap();
    let taken = ObstacleError::NameTaken { name: "a".into() };
    assert_eq!(world.add_obstacle(post().named("a")), Err(taken.clone()));
    let error = world.move_obstacle("c", [0.0; 2], None).unwrap_err();
    assert_eq!(
        error.to_string(),
        "no obstacle is named `c`; there are `a`, `b`"
    );
    // A map with a name that is taken is refused as a whole.
    let mut map = WorldMap::default();
    map.obstacles.add(post().named("new")).unwrap();
    map.obstacles.add(post().named("a")).unwrap();
    assert!(map.obstacles.add(post().named("new")).is_err());
    map.tags.push(Tag {
        at: [0.0, 0.0],
        number: 1,
    });
    assert_eq!(world.add_map(&map), Err(taken));
    assert_eq!(world.obstacles().count(), 3);
    assert_eq!(world.tag_near([0.0; 2], 1.0), None);
    // A name is free again when its obstacle is gone.
    world.remove_obstacle("a").unwrap();
    world.add_map(&map).unwrap();
    assert_eq!(world.obstacles().count(), 4);
    assert!(world.tag_near([0.0; 2], 1.0).is_some());
}

#[test]
fn a_gate_that_opens_and_closes_again_leaves_the_run_repeatable() {
    let run = || {
        let mut car = Car::with(&MecanumPlantSettings::default());
        car.world.add_obstacle(gate()).unwrap();
        car.turn([1; 4], 1.0);
        for _ in 0..3 {
            car.run(1.0);
            car.world.move_obstacle("gate", [0.52, 4.0], None).unwrap();
            car.plant.wake();
            car.run(0.5);
            car.world.move_obstacle("gate", [1.0, 0.0], None).unwrap();
            car.plant.wake();
        }
        car.gone().map(f64::to_bits)
    };
    assert_eq!(run(), run());
}
